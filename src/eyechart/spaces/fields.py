"""Declared fields of an answer: where each one stands in a reply, and of which kind it is.

A field stands under a key of a JSON object, or in the group of a pattern, or is the whole reply in
words. It is read strictly: two values, another unit or a part of a word is no answer.
"""

import ast
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, cast

from eyechart.errors import SpecError, raising
from eyechart.records import LARGEST, Name, build, parse_json, to_json_fields
from eyechart.spaces.failures import says_failed, says_no_picture
from eyechart.spaces.linear_pattern import LinearPattern, TooLongText
from eyechart.spaces.reader import READER, ActionNames, read_by, spelled
from eyechart.spaces.space import (
    READ_AT_MOST,
    UNPARSED,
    Decision,
    is_too_deep,
    json_objects,
    refuses,
    unparsed,
    why_unanswered,
    without_thinking,
)

FieldKind = Literal["name", "number", "vector"]

Value = str | float | tuple[float, ...]
"""A name, a number, or the numbers of a vector in order."""

NoValue = Literal[
    "no_answer",  # the key or the pattern is not in the reply
    "several_values",  # the field stands there with different values
    "malformed",  # the key stands in an object that is broken or cut off
    "wrong_type",  # true, null, a list or an object for a name or a number
    "other_value",  # a name outside the field's values, a number outside its ranges
    "part_of_a_word",  # a pattern cut the value out of a longer word or number
    "not_a_number",
    "not_finite",  # NaN, infinite, or too large
    "other_unit",
    "not_a_vector",
    "wrong_size",
    "says_error",  # the reply reports a failure or no picture
    "too_long",
]
"""Why a reply holds no value of a field."""

_VALUES_AT_MOST = 500
_SIZE_AT_MOST = 10_000
_LONGEST_NAME = 200
_NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_WITH_UNIT = re.compile(rf"({_NUMBER})\s*(.*)", re.DOTALL)
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf(?:inity)?)\b.*", re.IGNORECASE | re.DOTALL)
_RANGE = re.compile(rf"(<=?|>=?)\s*({_NUMBER})|({_NUMBER})\s*\.\.\s*({_NUMBER})")
_MINUS = str.maketrans({"−": "-", "–": "-", "‐": "-", "‑": "-", "﹣": "-", "－": "-"})
_FENCE = re.compile(r"\s*```[\w-]*\s*(.*?)\s*```\s*", re.DOTALL)
_AROUND = " \t\r\n\"'`*"
_VECTOR = re.compile(r"[\[(][\d\s.,+\-eE()\[\]]*[\])]")
_UNITS = re.compile(
    r"\s?(km/h|kmh|kph|mph|m/s\^?2?|ms|cm|mm|km|ft|feet|m|metres?|meters?|s|seconds?|rad(?:ians?)?|deg(?:rees?)?|[°º%])"
    r"(?![^\W_])",
    re.IGNORECASE,
)
_FURTHER_UNITS = re.compile(
    r"\s?(?:knots?|kts?|kn|mi(?:les?)?|yards?|yd|inch(?:es)?|min(?:utes?)?|h(?:ours?|rs?)?|percent|fps|"
    r"(?:kilo|centi|milli)?met(?:re|er)s?|kilomet(?:re|er)s?|g)\b"
)
_PER = re.compile(r"\s?(?:/|per\b)\s?(?:\w+)", re.IGNORECASE)
"""What makes another unit of a unit: "5 m per second" is no 5 m."""
_THOUSANDS = re.compile(r"[ \u00a0\u202f\u2009'’_]\d{3}(?!\d)")
_SIGN_WORD = re.compile(r"\b(?:minus|negative)\s*\Z", re.IGNORECASE)
_DENIED = re.compile(
    r"\b(?:not|n't|never|no longer|avoid|instead of|rather than|neither|nor|without)\s+(?:[\w\"'`]+\s*){0,2}[:=]?\s*\Z"
    r"|(?<=n't)\s+(?:[\w\"'`]+\s*){0,2}[:=]?\s*\Z",
    re.IGNORECASE,
)
_EXAMPLE = re.compile(r"\b(?:(?:for )?example|e\.g\.?|for instance|format)\s*[:,=]?\s*(?:```\w*\s*)?\Z", re.IGNORECASE)
_SAID = r"(?:\s*(?:[:=]|\b(?:is|was|will be|should be|shall be|must be|becomes|to|of)\b))"
_UNIT_SAID = r"(?:(?:is|are|was|given|measured|expressed|stated)\s+){0,3}(?:in\b\s*|\[\s*|\(\s*(?:in\b\s*)?)"
_UNIT_ALONE = (
    r"(?:\(\s*in\b\s*|\b(?:all|angles?|numbers?|values?)\s+(?:is|are)?\s*in\b\s*|\bunits?\s*(?:[:=]|is|are)\s*)"
)
_UNIT_WORDS = {
    "°": ("deg", "º"),
    "rad": ("rad",),
    "%": ("percent",),
    "km": ("kilomet",),
    "cm": ("centimet",),
    "mm": ("millimet",),
    "m": ("met",),
    "mi": ("mile",),
    "ft": ("feet", "foot"),
    "s": ("sec",),
    "min": ("min",),
    "h": ("hour", "hr"),
    "kn": ("knot", "kt"),
    "km/h": ("kmh", "kph"),
    "m/s": ("mps",),
    "mi/h": ("mph",),
}
"""The beginnings of other spellings of units."""
_PER_TIME = re.compile(
    r"\s?(?:/|per\b)\s?(?:s(?:ec(?:ond)?s?)?|min(?:ute)?s?|h(?:ou)?r?s?)(?:\^?2|²)?(?![^\W_])", re.IGNORECASE
)
_SQUARED = re.compile(r"\s?(?:\^2|²|squared\b)")
_OBJECT_AT_MOST = 20_000


@dataclass(frozen=True, slots=True)
class AnswerField:
    """A field of an answer, as a file declares it.

    ``key`` leads by dots through a JSON object of the reply. ``pattern`` has one group. Without
    either the whole reply is the value, in words. ``values`` are the names of a name, or the ranges
    of a number (``"< 2"``, ``"2..8"``), of which the first that holds counts. A number in none of
    them is no answer (``other_value``). ``from_column`` is the prompt column with the names that a
    frame allows. ``unit`` may follow a number, and no other may. ``size`` counts the numbers of a
    vector, ``width`` those of each of its rows, where it must have rows. ``brake``, ``proceed`` and
    ``mirror_pairs`` are those of named actions, in terms of ``values``. Raises SpecError for a
    contradiction.
    """

    name: Name
    kind: FieldKind = "name"
    key: Name | None = None
    pattern: Name | None = None
    unit: str = ""
    values: tuple[Name, ...] = ()
    from_column: Name | None = None
    size: int | None = None
    width: int | None = None
    brake: tuple[Name, ...] = ()
    proceed: tuple[Name, ...] = ()
    mirror_pairs: tuple[tuple[Name, Name], ...] = ()
    aliases: Mapping[str, str] | tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        if isinstance(self.aliases, Mapping):
            object.__setattr__(self, "aliases", tuple(self.aliases.items()))
        if not re.fullmatch(r"[^\W\d_][\w-]*", self.name):
            raise SpecError(f"{self._said}: a name has letters, digits, '_' and '-', and begins with a letter")
        if self.key is not None and self.pattern is not None:
            raise SpecError(f"{self._said} has a key and a pattern; keep the one that says where it stands")
        if self.key is not None and not all(self.key.split(".")):
            raise SpecError(f"{self._said}: key '{self.key}' has an empty part; write for example key = \"plan.speed\"")
        if self.pattern is not None:
            LinearPattern(self.pattern, self._said)
        if twice := next((one for one in self.values if self.values.count(one) > 1), None):
            raise SpecError(f"{self._said}: values has '{twice}' twice; leave one out")
        if len(self.values) > _VALUES_AT_MOST:
            raise SpecError(f"{self._said} has {len(self.values)} values; write at most {_VALUES_AT_MOST}")
        self._require_kind()
        self._require_roles()

    @property
    def _said(self) -> str:
        return f"answer field '{self.name}'"

    @property
    def aliased(self) -> tuple[tuple[str, str], ...]:
        """Return the aliases with their values."""
        return cast("tuple[tuple[str, str], ...]", self.aliases)

    def _require_kind(self) -> None:
        if self.kind == "vector":
            if self.size is None or not 1 <= self.size <= _SIZE_AT_MOST:
                raise SpecError(f"{self._said}: a vector needs its size, from 1 to {_SIZE_AT_MOST}; write size = 6")
            if self.width is not None and (self.width < 1 or self.size % self.width):
                raise SpecError(f"{self._said}: {self.size} numbers make no rows of {self.width}; write width = 2")
            if self.values or self.from_column or self.unit:
                raise SpecError(f"{self._said}: a vector has a size, and no values, from_column or unit")
        elif self.size is not None or self.width is not None:
            raise SpecError(f"{self._said}: only a vector has a size and a width, not a {self.kind}")
        elif self.kind == "number":
            self._require_ranges()
        else:
            self._require_names()

    def _require_ranges(self) -> None:
        if self.from_column or self.aliases:
            raise SpecError(f'{self._said}: a number has no from_column and no aliases; use kind = "name"')
        for one in self.values:
            _bounds(one, self._said)

    def _require_names(self) -> None:
        if self.unit:
            raise SpecError(f'{self._said}: a name has no unit; use kind = "number"')
        if self.from_column and (self.values or self.aliases):
            raise SpecError(f"{self._said}: its names come from values or from_column, not both")
        known: set[str] = set()
        written = (*self.values, *(alias for alias, _ in self.aliased))
        for one in written:
            plain = spelled(one)
            if not re.fullmatch(r"[+-]?[^\W_](.*[^\W_])?[°%]?", one) or one.upper() == UNPARSED or "=" in one:
                raise SpecError(
                    f"{self._said}: '{one}' cannot be read from a reply. A value is one line, begins and ends with a "
                    f"letter or a digit, has no '=', and is not {UNPARSED}"
                )
            if plain in known:
                raise SpecError(f"{self._said}: '{one}' is another value's name too, in other signs or capitals")
            known.add(plain)

    def _require_roles(self) -> None:
        paired = [one for pair in self.mirror_pairs for one in pair]
        meant = [one for _, one in self.aliased]
        for role, names in (("mirror_pairs", paired), ("brake", self.brake), ("proceed", self.proceed)):
            if len(set(names)) != len(names):
                raise SpecError(f"{self._said}: {role} names a value twice")
            self._require_values(role, names)
        self._require_values("aliases", meant if self.values else [])
        if both := set(self.brake) & set(self.proceed):
            raise SpecError(f"{self._said}: {sorted(both)} cannot both brake and proceed")

    def _require_values(self, role: str, names: Sequence[str]) -> None:
        for one in names:
            if one not in self.values:
                raise SpecError(f"{self._said}: {role} names '{one}', not one of its values {list(self.values)}")

    @property
    def names(self) -> ActionNames:
        """Return the field's names and their aliases, as read in words."""
        return ActionNames((*((one, one) for one in self.values), *self.aliased), self.mirror_pairs)

    def range_of(self, value: float) -> str | None:
        """Return the first range that holds a number; None if none does."""
        for one in self.values:
            least, most, strict = _bounds(one, self._said)
            if (least < value < most) if strict else (least <= value <= most):
                return one
        return None

    def schema(self) -> dict[str, object]:
        """Return the JSON schema of the field's value."""
        if self.kind == "vector":
            assert self.size is not None
            wide = self.width or self.size
            row: dict[str, object] = {"type": "array", "items": {"type": "number"}, "minItems": wide, "maxItems": wide}
            rows = self.size // wide
            return row if rows == 1 else {"type": "array", "items": row, "minItems": rows, "maxItems": rows}
        if self.kind == "number":
            return {"type": "number", **({"description": f"in {self.unit}"} if self.unit else {})}
        return {"type": "string", **({"enum": list(self.values)} if self.values else {})}

    def as_dict(self) -> dict[str, object]:
        """Return the field as plain JSON values, without what it does not declare."""
        given = to_json_fields(
            self, "name kind key pattern unit values from_column size width brake proceed mirror_pairs aliases"
        )
        return {name: value for name, value in given.items() if value not in (None, "", [], {})}


@dataclass(frozen=True, slots=True)
class FieldValues:
    """The values of all fields in order; or ``why`` in one word, of the ``field`` that lacks one."""

    values: tuple[Value, ...] | None
    why: NoValue | str | None = None
    field: str = ""


def read_answer_fields(values: object, where: str) -> tuple[AnswerField, ...]:
    """Return the fields of an ``[answer]`` table; raises SpecError that names the fault.

    ``where`` begins the error, for example the file's name.
    """
    if not isinstance(values, Mapping) or set(values) != {"fields"} or not isinstance(values["fields"], list):
        raise SpecError(
            f'{where}: [answer] has one list: fields = [{{name = "action", kind = "name", key = "action"}}]'
        )
    with raising(SpecError, where, of=(ValueError, SpecError)):
        fields = tuple(
            build(AnswerField, one, f"[answer] field {number}") for number, one in enumerate(values["fields"], 1)
        )
        require_fields(fields)
    return fields


def require_readable(fields: Sequence[AnswerField]) -> None:
    """Raise SpecError for a value that no reply can be read as, or that every reply has.

    Older prompts are read without it, since their runs had such values too.
    """
    for one in fields:
        if one.kind == "number":
            _require_each_held(one)
        elif one.kind == "name" and len(one.values) == 1:
            raise SpecError(
                f"answer field '{one.name}' has one value, '{one.values[0]}', so that every answer is the same; write "
                "its other values too, or leave the field out"
            )


def _require_each_held(field: AnswerField) -> None:
    """Raise SpecError for a range of which every number is in an earlier one, or is too large."""
    taken: list[tuple[_End, _End, str]] = [(_END[0], (-LARGEST, 0), ""), ((LARGEST, 1), _END[1], "")]
    for one in field.values:
        low, high = _ends(one)
        before = [each for each in sorted(taken) if each[0] < high and low < each[1]]
        left = low
        for begin, end, _ in before:
            left = max(left, end) if begin <= left else left
        if left >= high:
            named = " and ".join(f"'{name}'" for *_, name in before if name)
            why = f"every number in it is in {named} before it, and the first range that holds counts"
            why = why if named else f"numbers beyond {LARGEST:g} are not read"
            raise SpecError(f"answer field '{field.name}': the range '{one}' never holds: {why}; {_MEND}")
        taken.append((low, high, one))


_End = tuple[float, int]
"""An end of a range: a number, and 1 where the end lies just above it."""
_END: tuple[_End, _End] = (-math.inf, 0), (math.inf, 1)
_MEND = "put narrower ranges first, or leave it out"


def _ends(text: str) -> tuple[_End, _End]:
    """Return where a range of numbers begins and ends."""
    least, most, strict = _bounds(text, "a range")
    return (least, int(strict and least > -math.inf)), (most, int(not strict or most == math.inf))


def require_fields(fields: Sequence[AnswerField]) -> None:
    """Raise SpecError for no fields, for equal names or places, or if words are to hold several."""
    if not fields:
        raise SpecError("[answer] has no fields; declare at least one")
    places: dict[str, list[str | None]] = {
        "name": [one.name for one in fields],
        "key": [one.key for one in fields],
        "pattern": [one.pattern for one in fields],
    }
    for what, given in places.items():
        named = [one for one in given if one is not None]
        if len(set(named)) != len(named):
            raise SpecError(f"[answer]: two fields have one {what}: {', '.join(named)}")
    keys = [one.key for one in fields if one.key is not None]
    if inside := next(((one, other) for one in keys for other in keys if other.startswith(f"{one}.")), None):
        raise SpecError(f"[answer]: key '{inside[1]}' is inside '{inside[0]}', which is the value of another field")
    for one in fields:
        if len(fields) > 1 and one.key is None and one.pattern is None:
            raise SpecError(
                f"[answer]: field '{one.name}' is one of several, and needs a key or a pattern that says where it is"
            )


def read_fields(text: str, fields: Sequence[AnswerField]) -> FieldValues:
    """Return the values of all fields in a reply's text without thinking, or why there are none.

    A reply without the value of one field has no answer. ``why`` is a word of `NoValue`, or, for a
    name that is the whole reply in words, one of the reader of action names.
    """
    if len(text) > READ_AT_MOST:
        return FieldValues(None, "too_long", fields[0].name)
    objects, around = _objects(text) if any(one.key is not None for one in fields) else ((), [text])
    rest = "\n".join(around)
    values: list[Value] = []
    for one in fields:
        found = _field_in(text, one, objects, rest)
        if not isinstance(found, _NoFieldValue) and (
            _names_other_unit(one, objects, fields) or _says_other_unit(one, rest, fields)
        ):
            found = _NoFieldValue("other_unit")
        if one.key is not None and _corrects(one, found, around[-1]):
            found = _NoFieldValue("several_values")
        if isinstance(found, _NoFieldValue):
            return FieldValues(None, found.why, one.name)
        values.append(found)
    pairs_found = [one for pairs in objects for one in _plain_pairs(pairs)]
    known = {one.key.split(".")[-1] for one in fields if one.key is not None}
    if says_no_picture(rest) or says_failed(pairs_found, known):
        return FieldValues(None, "says_error", fields[0].name)
    return FieldValues(tuple(values))


def read_declared(
    text: str, finish_reason: str | None, error: str | None, fields: Sequence[AnswerField]
) -> Decision[tuple[Value, ...]]:
    """Return the values of all fields in a reply, or the reason why one lacks."""
    if (missing := why_unanswered(finish_reason, error)) is not None:
        return Decision(None, missing)
    visible = without_thinking(text).strip()
    if not visible:
        return Decision(None, "empty")
    found = read_fields(visible, fields)
    if found.values is not None:
        return Decision(found.values)
    if found.why == "refused" or (found.why == "no_answer" and refuses(visible)):
        return Decision(None, "refused")
    return unparsed(found.why or "no_answer")


@dataclass(frozen=True, slots=True)
class _NoFieldValue:
    """Why a text holds no value."""

    why: str


class _JsonPairs(list[tuple[str, object]]):
    """A JSON object as its names and values, in which a name may stand twice."""


def _field_in(text: str, field: AnswerField, objects: Sequence[_JsonPairs], rest: str) -> Value | _NoFieldValue:
    """Return a field's value in a text: by its key, its pattern, or the words."""
    if field.key is not None:
        found = _by_key(field, objects, rest)
    elif field.pattern is not None:
        found = _by_pattern(field, text)
    elif field.kind == "name" and field.values:
        decision = read_by(READER, text.replace("’", "'"), field.names)
        return (
            _NoFieldValue(decision.why or decision.missing or "") if decision.action is None else str(decision.action)
        )
    else:
        fenced = _FENCE.fullmatch(text)
        found = [_value(field, text if fenced is None else fenced[1])]
    return _only(found)


def _only(found: Sequence[Value | _NoFieldValue]) -> Value | _NoFieldValue:
    """Return the one value that is found, even if more than once."""
    if not found:
        return _NoFieldValue("no_answer")
    if len(set(found)) > 1:
        return _NoFieldValue("several_values")
    return found[0]


# By a key.


def _by_key(field: AnswerField, objects: Sequence[_JsonPairs], rest: str) -> list[Value | _NoFieldValue]:
    assert field.key is not None
    path = field.key.split(".")
    leaf = re.escape(path[-1])
    if re.search(rf"[\"'`]{leaf}[\"'`]\s*[:=]", rest):
        return [_NoFieldValue("malformed")]  # the broken object may correct the whole one
    found = [_value(field, one) for pairs in objects for one in _at(pairs, path)]
    if found and _says_more(field, leaf, rest):
        return [_NoFieldValue("several_values")]
    return found


def _says_more(field: AnswerField, leaf: str, rest: str) -> bool:
    """Return whether the words around the objects say the field again, as in "Actually speed is 4"."""
    if re.search(rf"(?<![\w.]){leaf}\s*[:=]", rest, re.IGNORECASE):
        return True
    value = r"[+-]?\.?\d" if field.kind == "number" else "|".join(map(re.escape, field.values)) or r"\Z(?!\Z)"
    return re.search(rf"(?<![\w.]){leaf}{_SAID}\s*[\"'`*]*(?:{value})(?!\w)", rest, re.IGNORECASE) is not None


_CORRECTED = re.compile(
    r"\b(?:actually|correction|on second thoughts?|scratch that|(?:sorry|wait)(?=\s*[,.:;!])"
    r"|i (?:change|correct|revise))\b",
    re.IGNORECASE,
)
_NUMBER_SAID = re.compile(rf"(?<![\w.,])(?<!\d[ -]){_NUMBER}(?![\w.,]*\d)")


def _corrects(field: AnswerField, value: Value | _NoFieldValue, rest: str) -> bool:
    """Return whether the words behind an object correct it, as "Wait, 2 m/s" or "Actually, right" does."""
    for one in _CORRECTED.finditer(rest):
        said = rest[one.end() : one.end() + _CORRECTS_WITHIN].partition("\n")[0].translate(_MINUS)
        if field.kind == "name" and isinstance(value, str):
            others = (name for name in field.values if name != value)
            if any(re.search(rf"(?<!\w){re.escape(name)}(?!\w)", said, re.IGNORECASE) for name in others):
                return True
        for number in _NUMBER_SAID.finditer(said) if isinstance(value, float) else ():
            behind = said[number.end() :]
            if float(number[0]) != value and not _has_other_unit(field, behind, _UNITS.match(behind)):
                return True
    return False


_CORRECTS_WITHIN = 60


def _at(value: object, path: Sequence[str]) -> Iterator[object]:
    """Yield every value at a path of names."""
    if not path:
        yield value
    elif isinstance(value, _JsonPairs):
        for name, inner in value:
            if name == path[0]:
                yield from _at(inner, path[1:])


def _names_other_unit(field: AnswerField, objects: Sequence[_JsonPairs], fields: Sequence[AnswerField]) -> bool:
    """Return whether an object gives another unit than a number's: ``"speed_unit": "km/h"``, ``"speed_kmh": 18``.

    ``"unit": "km/h"`` is another one if none of the ``fields`` is in it.
    """
    if field.key is None or field.kind != "number":
        return False
    path = field.key.split(".")
    beside = [
        pair for pairs in objects for depth in range(len(path)) for parent in _at(pairs, path[:depth])
        for pair in _pairs(parent)
    ]  # fmt: skip
    leaf = path[-1].casefold()
    declared = {one.key.split(".")[-1].casefold() for one in fields if one.key is not None}
    others = (declared | {name.casefold() for name, _ in beside}) - {leaf}
    further = [(name.casefold(), value) for name, value in beside if name.casefold() not in declared]
    named = [one for name, value in further for one in _units_of(name, value, leaf, others)]
    return any(
        _unit_word(unit) not in (_allowed_units(field, fields) if of != leaf else {_unit_word(field.unit)})
        for of, unit in named
    )


def _allowed_units(field: AnswerField, fields: Sequence[AnswerField]) -> set[str]:
    """Return the units of all fields, of which one that is said of no field must be."""
    return {_unit_word(one.unit) for one in fields if one.unit} or {_unit_word(field.unit)}


_UNIT_KEY = re.compile(r"(.*?)[ _-]*units?|units?[ _-]+(?:(?:of|for)[ _-]+)?(.+)")
_APART = re.compile(r"\s*(?:[,;|&\n]|\band\b)\s*")
_NO_UNITS = frozenset({"min", "in", "s", "h", "g"})
"""Ends of keys that have other meanings: ``speed_min`` is a bound."""


def _units_of(name: str, value: object, leaf: str, others: set[str]) -> Iterator[tuple[str, str]]:
    """Yield the units that a name and its value give, each with the name that it is said of; "" for none."""
    if name.startswith(leaf) and (unit := _unit_of_key(name[len(leaf) :])):
        yield leaf, unit
    found = _UNIT_KEY.fullmatch(name)
    if found is None or found[2] not in {None, leaf}:
        return
    of = found[1] or found[2] or ""
    inside = [(inner.casefold(), text) for inner, text in _pairs(value)]
    if any(inner in {leaf, *others} for inner, _ in inside):
        inside = [(inner, text) for inner, text in inside if inner == leaf]
    given = inside or [(of, one) for one in (value if isinstance(value, list) else [value])]
    for said, text in given:
        if isinstance(text, str) and said not in others:
            yield from ((said, one) for one in _APART.split(text.strip()) if one)


def _unit_of_key(end: str) -> str:
    """Return the unit that the end of a key is, as of ``speed_kmh`` or ``speed (m/s)``; "" for none."""
    unit = re.sub(r"^[ _(\[-]*(?:in[ _-]+)?|[ )\]]+$", "", end)
    if unit == end or unit in _NO_UNITS:
        return ""
    unit = re.sub(r"(?<=[a-z])_(?=[a-z])|(?<=^rad|^deg)p(?=s$)", "/", unit)
    spelled_out = "m/s" if unit == "mps" else unit
    return unit if _unit_at_start(spelled_out) == spelled_out else ""


def _says_other_unit(field: AnswerField, rest: str, fields: Sequence[AnswerField]) -> bool:
    """Return whether the words around the objects give another unit, as in "(steer in degrees)".

    "(in degrees)" is another one if none of the ``fields`` is in degrees.
    """
    if field.key is None or field.kind != "number" or not rest.strip():
        return False
    leaf = re.escape(field.key.split(".")[-1])
    heads = {rf"(?<![\w.]){leaf}[\"'`*]{{0,3}}\s*{_UNIT_SAID}": {_unit_word(field.unit)}}
    if len(fields) == 1 or any(one.unit for one in fields):
        heads[_UNIT_ALONE] = _allowed_units(field, fields)
    return any(
        (unit := _unit_at_start(rest[found.end() :])) is not None and _unit_word(unit) not in own
        for head, own in heads.items()
        for found in re.finditer(head, rest, re.IGNORECASE)
    )


def _unit_at_start(text: str) -> str | None:
    """Return the unit that a text begins with, as "metres per second"; None without one."""
    found = _UNITS.match(text) or _FURTHER_UNITS.match(text)
    if found is None:
        return None
    per = _PER_TIME.match(text, found.end()) or found
    squared = _SQUARED.match(text, per.end()) or per
    return text[: squared.end()]


def _unit_word(unit: str) -> str:
    """Return a unit in one spelling: "degrees" are "°", "metres per second" are "m/s"."""
    word = re.sub(r"\s*(?:/|\bper\b)\s*", "/", _SQUARED.sub("2", unit.strip().casefold()))
    return "/".join(_unit_part(part) for part in word.split("/"))


def _unit_part(word: str) -> str:
    found = next((one for one, heads in _UNIT_WORDS.items() if word.startswith(heads)), None)
    return word if found is None else f"{found}{'2' * word.endswith('2')}"


def _pairs(value: object) -> Sequence[tuple[str, object]]:
    """Return an object's names and values; none of what is no object."""
    return value if isinstance(value, _JsonPairs) else ()


def _objects(text: str) -> tuple[tuple[_JsonPairs, ...], list[str]]:
    """Return the outermost objects of a text, JSON or Python, and the texts around them."""
    found = list(json_objects(text, _JsonPairs))
    found += _python_objects(text, [(start, end) for start, end, _ in found])
    found.sort(key=lambda one: one[0])
    rest, end = [], 0
    for start, behind, _ in found:
        rest.append(text[end:start])
        end = behind
    meant = (pairs for start, _, pairs in found if _EXAMPLE.search(text, max(0, start - 40), start) is None)
    return tuple(meant), [*rest, text[end:]]


_PYTHON = re.compile(r"\{(?:[^{}\"']++|\"(?:[^\"\\\n]|\\.)*+\"|'(?:[^'\\\n]|\\.)*+'){0,400}+\}")
"""A Python dictionary without another inside."""


def _python_objects(text: str, json_spans: Sequence[tuple[int, int]]) -> list[tuple[int, int, _JsonPairs]]:
    """Return the dictionaries in Python's form outside the JSON objects."""
    result: list[tuple[int, int, _JsonPairs]] = []
    ends = [0, *(end for _, end in json_spans)]
    starts = [*(start for start, _ in json_spans), len(text)]
    for begin, behind in zip(ends, starts, strict=True):
        part = text[begin:behind]
        if "{" not in part or len(part) > _OBJECT_AT_MOST:
            continue
        for match in _PYTHON.finditer(part):
            pairs = _python_pairs(match[0])
            if pairs is not None:
                result.append((begin + match.start(), begin + match.end(), pairs))
    return result


def _python_pairs(text: str) -> _JsonPairs | None:
    if is_too_deep(text):
        return None
    try:
        made = ast.parse(text, mode="eval").body
        value = _plain_node(made)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None
    return value if isinstance(value, _JsonPairs) else None


def _plain_node(node: ast.expr) -> object:
    """Return the value of a literal; raises ValueError for anything else."""
    if isinstance(node, ast.Dict):
        names = [None if key is None else _plain_node(key) for key in node.keys]
        if not all(isinstance(name, str) for name in names):
            raise ValueError("a name is no text")
        return _JsonPairs((str(name), _plain_node(value)) for name, value in zip(names, node.values, strict=True))
    if isinstance(node, ast.List | ast.Tuple):
        return [_plain_node(one) for one in node.elts]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        number = _plain_node(node.operand)
        if isinstance(number, int | float) and not isinstance(number, bool):
            return -number if isinstance(node.op, ast.USub) else number
    if isinstance(node, ast.Constant) and isinstance(node.value, str | int | float | bool | None):
        return node.value
    raise ValueError("no plain value")


def _plain_pairs(pairs: _JsonPairs) -> Iterator[tuple[str, object]]:
    """Yield names and values with inner objects as lists of names and values."""
    yield from ((name, list(value) if isinstance(value, _JsonPairs) else value) for name, value in pairs)


# By a pattern.


def _by_pattern(field: AnswerField, text: str) -> list[Value | _NoFieldValue]:
    assert field.pattern is not None
    try:
        found = list(LinearPattern(field.pattern, field.name).search(text))
    except TooLongText:
        return [_NoFieldValue("too_long")]
    return [_cut(field, text, one.start, one.end) or _value(field, one.text) for one in found]


def _cut(field: AnswerField, text: str, start: int, end: int) -> _NoFieldValue | None:
    """Return why a span of a text is a part of something longer, None if it is whole."""
    inner, before, behind = text[start:end], text[:start].translate(_MINUS), text[end:].translate(_MINUS)
    if not inner.strip():
        return None
    unit = _UNITS.match(behind) if inner[-1].isdigit() else None
    if _is_denied(inner, before):
        return _NoFieldValue("no_answer")
    if inner[-1].isdigit() and (_has_other_unit(field, behind, unit) or _is_under_other_unit(field, before)):
        return _NoFieldValue("other_unit")
    if _is_inside(inner, before, behind, followed=unit is not None):
        return _NoFieldValue("part_of_a_word")
    if _is_one_of_several(field, inner, behind if unit is None else behind[unit.end() :]):
        return _NoFieldValue("several_values")
    return None


def _is_denied(inner: str, before: str) -> bool:
    """Return whether the words before a value take it back: "not speed: 3"; "minus 3" is no 3."""
    last = before[-60:]
    return _DENIED.search(last) is not None or (inner[0].isdigit() and _SIGN_WORD.search(last) is not None)


def _has_other_unit(field: AnswerField, behind: str, unit: re.Match[str] | None) -> bool:
    """Return whether a number is followed by another unit than the field's."""
    if field.unit and re.match(rf"\s?{re.escape(field.unit)}(?![\w/^²])", behind):
        return _PER.match(behind, re.match(r"\s?", behind).end() + len(field.unit)) is not None  # type: ignore[union-attr]
    said = _UNIT_BEHIND.match(behind)
    apart = None if said is None else _unit_at_start(behind[said.end() :])
    if apart is not None and _unit_word(apart) != _unit_word(field.unit):
        return True
    return unit is not None or _FURTHER_UNITS.match(behind) is not None


_UNIT_BEHIND = re.compile(r"\s*[(\[]\s*(?:in\s+)?|\s+in\s+")
_UNIT_BEFORE = re.compile(r"(?:[(\[]\s*(?:in\s+)?|\bin\s+)([^\s()\[\]\d][^()\[\]\d]{0,30}?)\s*[)\]]?[\s:=*]*\Z")
"""A unit with brackets, or with "in", behind a number and before it: "speed (km/h): 5"."""


def _is_under_other_unit(field: AnswerField, before: str) -> bool:
    """Return whether the words before a number give another unit, as in "speed (km/h): 5"."""
    said = _UNIT_BEFORE.search(before, max(0, len(before) - 60))
    unit = None if said is None else _unit_at_start(said[1])
    return unit is not None and said is not None and unit == said[1] and _unit_word(unit) != _unit_word(field.unit)


def _is_inside(inner: str, before: str, behind: str, *, followed: bool) -> bool:
    """Return whether a value is a part of a longer word or number; ``followed`` by a unit or not."""
    if re.match(r"\w", inner) and re.search(r"\w\Z|\w-\Z", before[-2:]):
        return True
    if re.match(r"[\d.]", inner) and re.search(r"[+-]\s?\Z|\d[.,]\Z|\.\Z(?<=\W\.)", before[-3:]):
        return True
    if re.match(r"\w", inner[-1]) and re.match(r"\w|-[^\W\d]", behind) and not followed:
        return True
    if inner[-1].isdigit() and _THOUSANDS.match(behind):
        return True
    return inner[-1].isdigit() and re.match(r"[.,]\d|\s?[/×x*^]\s?\d|[eE][+-]?\d", behind) is not None


_OR = re.compile(r"\s*(?:to|until|through|or|and|,|/|\||\.{2,}|-)\s*(?:or\s+)?", re.IGNORECASE)


def _is_one_of_several(field: AnswerField, inner: str, behind: str) -> bool:
    """Return whether another value of the field follows, as in "0 to 15" or "Left, None or Right"."""
    after = _OR.match(behind)
    if after is None:
        return False
    if inner[-1].isdigit() and re.match(r"[+-]?\.?\d", behind[after.end() :]):
        return True
    rest = behind[after.end() : after.end() + _LONGEST_NAME].casefold()
    names = [one.casefold() for one in (*field.values, *(alias for alias, _ in field.aliased))]
    return field.kind == "name" and any(re.match(rf"{re.escape(one)}(?!\w)", rest) for one in names)


# The kinds.


def _value(field: AnswerField, given: object) -> Value | _NoFieldValue:
    """Return a text or a JSON value as a field's value."""
    if field.kind == "vector":
        return _vector(field, given)
    if isinstance(given, bool) or given is None or isinstance(given, list):
        return _NoFieldValue("wrong_type")
    if field.kind == "number":
        return _number(field, given)
    return _name(field, given)


def _name(field: AnswerField, given: object) -> str | _NoFieldValue:
    if isinstance(given, float) and given.is_integer():
        given = int(given)
    text = str(given).strip(_AROUND)
    if field.values:
        if isinstance(given, int | float):
            text = f"{given:+}".removeprefix("+")
        found = field.names.whole(text.removesuffix("."))
        return _NoFieldValue("other_value") if found is None else found
    if not text or len(text) > _LONGEST_NAME or "\n" in text or text.upper() == UNPARSED:
        return _NoFieldValue("other_value")
    return text


def _number(field: AnswerField, given: object) -> float | _NoFieldValue:
    number = _in_digits(field, given) if isinstance(given, str) else given
    if isinstance(number, _NoFieldValue):
        return number
    if not isinstance(number, int | float):
        return _NoFieldValue("wrong_type")
    if not abs(number) <= LARGEST:
        return _NoFieldValue("not_finite")
    outside = field.values and field.range_of(float(number)) is None
    return _NoFieldValue("other_value") if outside else float(number)


def _in_digits(field: AnswerField, given: str) -> float | _NoFieldValue:
    """Return the number that a text is, with its unit or without."""
    text = given.strip(_AROUND).translate(_MINUS)
    if _NOT_FINITE.fullmatch(text):
        return _NoFieldValue("not_finite")
    found = _WITH_UNIT.fullmatch(text)
    if found is None or re.match(r"[\d.,]", found[2]):
        return _NoFieldValue("not_a_number")
    if found[2].removesuffix(".") not in {"", field.unit}:
        return _NoFieldValue("other_unit" if _UNITS.match(found[2]) else "not_a_number")
    return float(found[1])


def _vector(field: AnswerField, given: object) -> tuple[float, ...] | _NoFieldValue:
    listed = _listed(given) if isinstance(given, str) else given
    if not isinstance(listed, list) or isinstance(listed, _JsonPairs):
        return _NoFieldValue("not_a_vector")
    rows = [one if isinstance(one, list) else [one] for one in listed]
    if len({(len(row), row is one) for row, one in zip(rows, listed, strict=True)}) > 1:
        return _NoFieldValue("not_a_vector")
    if field.width is not None and not _has_rows(field, listed, rows):
        return _NoFieldValue("wrong_size")
    numbers = [number for row in rows for number in row]
    if any(isinstance(number, bool) or not isinstance(number, int | float) for number in numbers):
        return _NoFieldValue("not_a_vector")
    if len(numbers) != field.size:
        return _NoFieldValue("wrong_size")
    return tuple(map(float, numbers)) if all(abs(one) <= LARGEST for one in numbers) else _NoFieldValue("not_finite")


def _has_rows(field: AnswerField, listed: list[object], rows: Sequence[list[object]]) -> bool:
    """Return whether a vector's rows have its width; numbers alone are one row, or rows of one."""
    if any(isinstance(one, list) for one in listed):
        return all(len(row) == field.width for row in rows)
    return field.width in {1, field.size}


def _listed(given: str) -> object:
    """Return the list that a text is, None if it is none."""
    text = given.strip(_AROUND).translate(_MINUS)
    if _VECTOR.fullmatch(text) is None or len(text) > _OBJECT_AT_MOST or is_too_deep(text.replace("(", "[")):
        return None
    try:
        return _plain_node(ast.parse(text, mode="eval").body)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None


@lru_cache(maxsize=1024)
def _bounds(text: str, where: str) -> tuple[float, float, bool]:
    """Return the bounds of a range of numbers, and whether they are outside it."""
    found = _RANGE.fullmatch(text.strip())
    if found is None:
        raise SpecError(f'{where}: \'{text}\' is no range of numbers; write "< 2", "<= 2", "> 2", ">= 2" or "2..8"')
    if found[1] is None:
        least, most = float(found[3]), float(found[4])
        if least > most:
            raise SpecError(f"{where}: the range '{text}' holds no number: write the smaller one first")
        return least, most, False
    bound, strict = float(found[2]), len(found[1]) == 1
    return (-math.inf, bound, strict) if found[1][0] == "<" else (bound, math.inf, strict)


def candidates_of(cell: object) -> tuple[str, ...]:
    """Return the names in a frame's column: a JSON list, or a text with commas or new lines.

    It is empty where the column holds none.
    """
    text = str(cell).strip()
    if text.startswith("["):
        try:
            listed = parse_json(text, most=_VALUES_AT_MOST)
        except (ValueError, RecursionError):
            listed = re.split(r"[,\n]", text.strip("[]"))
    else:
        listed = re.split(r"[,;\n]", text)
    plain = (str(one).strip(_AROUND) for one in listed if not isinstance(one, list | dict))
    return tuple(dict.fromkeys(one for one in plain if one))
