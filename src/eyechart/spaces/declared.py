"""Answers whose fields are declared: one name, several fields at once, numbers and vectors.

An action is the answer in words, such as ``throttle=Increase steer=Left``, so that statistics and
records compare it like any named action.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

from eyechart.errors import SpecError, counted, raising
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.fields import (
    AnswerField,
    Value,
    candidates_of,
    read_answer_fields,
    read_declared,
    require_readable,
)
from eyechart.spaces.space import Answer, Decision, unparsed

_ACTIONS_AT_MOST = 1000
_READINGS_KEPT = 1000


@dataclass(frozen=True, slots=True)
class AnswerSpace(Discrete):
    """The space of answers with declared fields.

    ``actions`` are all combinations of the fields' values; empty where a field's values are not
    known beforehand, such as those of a vector. ``candidates`` are the names that the columns of a
    frame allow, by field. A combination brakes if one of its fields does, and the levels of its
    fields add up. Reflection exchanges the values of each field.
    """

    fields: tuple[AnswerField, ...] = ()
    candidates: tuple[tuple[str, tuple[str, ...]], ...] = ()

    def __post_init__(self) -> None:
        """Check nothing: the fields were checked, and the actions follow from them."""

    @classmethod
    def of(
        cls, name: str, fields: Sequence[AnswerField], candidates: tuple[tuple[str, tuple[str, ...]], ...] = ()
    ) -> "AnswerSpace":
        """Return the space of these fields; raises SpecError for too many combinations."""
        values = _values(fields, candidates)
        count = 1
        for some in values:
            count *= len(some)
        if count > _ACTIONS_AT_MOST and not candidates:
            raise SpecError(
                f"[answer]: its fields have {count} combinations of values, more than {_ACTIONS_AT_MOST}; "
                "declare fewer values"
            )
        fields = tuple(fields)
        parts = list(product(*values)) if count <= _ACTIONS_AT_MOST else []
        level = {_symbol(fields, part): _level(fields, part) for part in parts}
        pairs = {_symbol(fields, part): _symbol(fields, _reflected(fields, part)) for part in parts}
        roles = {_symbol(fields, part): _role(fields, part) for part in parts}
        return cls(
            name=name,
            actions=tuple(level),
            mirror_pairs=tuple((one, other) for at, (one, other) in enumerate(pairs.items()) if at < _at(pairs, other)),
            brake=tuple(sorted((one for one in level if roles[one] == "brake"), key=lambda one: -level[one])),
            proceed=tuple(one for one in level if roles[one] == "proceed"),
            fields=fields,
            candidates=candidates,
        )

    @property
    def choices(self) -> tuple[str, ...]:
        """Return the names that a prompt must say: those of the fields that are names."""
        return tuple(dict.fromkeys(one for field in self.fields if field.kind == "name" for one in field.values))

    @property
    def columns(self) -> tuple[str, ...]:
        """Return the prompt columns with the names that a frame allows."""
        return tuple(field.from_column for field in self.fields if field.from_column is not None)

    def on(self, own: Discrete) -> Discrete:
        """Return the space with the ``own`` actions of a bank for a single name without values."""
        if isinstance(own, AnswerSpace):
            return own
        (first, *others) = self.fields
        return self if others or not _is_bare(first) else AnswerSpace.of(self.name, [_with_values(first, own)])

    def among(self, rows: Iterable[Mapping[str, object]]) -> "AnswerSpace":
        """Return the space of frames with these fields, whose names are the union of theirs."""
        if not self.columns:
            return self
        names: dict[str, dict[str, None]] = {field.name: {} for field in self.fields if field.from_column}
        for frame in rows:
            for field in self.fields:
                if field.from_column is not None:
                    names[field.name] |= dict.fromkeys(candidates_of(frame.get(field.from_column, "")))
        found = tuple((name, tuple(some)) for name, some in names.items())
        return replace(AnswerSpace.of(self.name, self.fields, found), reader=self.reader)

    def given(self, row: Mapping[str, object]) -> "AnswerSpace":
        """Return the space of one frame whose words state these fields."""
        return _given(self, tuple(str(row.get(name, "")) for name in self.columns)) if self.columns else self

    def turn(self, symbol: str) -> str:
        """Return an action's fields that a reflection exchanges; another text as it is."""
        return _turns(self)[0].get(symbol, symbol)

    def opposite(self, turn: str) -> str:
        """Return the turn that the reflected world calls for."""
        return _turns(self)[1].get(turn, turn)

    @property
    def turns(self) -> tuple[str, ...]:
        """Return the parts of the actions that a reflection exchanges, without the other fields."""
        return tuple(one for one, other in _turns(self)[1].items() if one != other)

    def schema(self) -> dict[str, object]:
        """Return the JSON schema of an answer, with each field at its key or else under its name.

        A name in words is asked for as ``action``, which the reader of words finds.
        """
        result: dict[str, object] = {}
        allowed = dict(self.candidates)
        for field in self.fields:
            names = allowed.get(field.name, ())
            of = {**field.schema(), **({"enum": list(names)} if names else {})}
            in_words = field.kind == "name" and field.pattern is None
            place(result, (field.key or ("action" if in_words else field.name)).split("."), of)
        return result

    def read(self, reply: Answer) -> Decision[str]:
        """Return the answer in a reply: the values of all fields, or the reason why one lacks."""
        return _read_declared(self, reply.text, reply.finish_reason, reply.error)

    def project(self, action: str, axis: str) -> float | None:
        """Return how hard an answer brakes: the sum of its fields' levels; None for another axis.

        None too where no combination is known to brake.
        """
        if axis != "brake" or not self.brake:
            return None
        return _levels(self).get(action, 0.0)

    def as_dict(self) -> dict[str, object]:
        """Return the space as plain JSON values."""
        return {"name": self.name, "fields": [field.as_dict() for field in self.fields]}

    def written(self) -> dict[str, object]:
        """Return the space as plain JSON values, under its name in a prompt."""
        return {"answer": self.as_dict()}

    @classmethod
    def from_dict(cls, values: object) -> "AnswerSpace":
        """Build a space from plain values; raises SpecError that names the fault."""
        plain = dict(values) if isinstance(values, Mapping) else {}
        name = str(plain.pop("name", "answer"))
        return _space_of(read_answer_fields(plain, "the prompt"), "the prompt", name)


def answer_from(values: object, where: str, name: str, own: Discrete | None = None) -> AnswerSpace:
    """Build a space from a file's ``[answer]`` table; ``own`` are the file's actions.

    Raises SpecError, beginning with ``where``.
    """
    fields = read_answer_fields(values, where)
    if own is not None:
        if len(fields) > 1 or not _is_bare(fields[0]):
            raise SpecError(
                f"{where}: [action_space] names the values of one answer field without values; this [answer] has "
                f"{counted(len(fields), 'field')}: {', '.join(one.name for one in fields)}. Leave [action_space] out"
            )
        fields = (_with_values(fields[0], own),)
    with raising(SpecError, where, of=SpecError):
        require_readable(fields)
    return _space_of(fields, where, name)


def _space_of(fields: Sequence[AnswerField], where: str, name: str) -> AnswerSpace:
    if len(fields) > 1 and (bare := [one.name for one in fields if _is_bare(one)]):
        raise SpecError(f"{where}: answer field '{bare[0]}' needs values, because there are several fields")
    with raising(SpecError, where, of=SpecError):
        return AnswerSpace.of(name, fields)


def _is_bare(field: AnswerField) -> bool:
    return field.kind == "name" and not field.values and field.from_column is None


def _with_values(field: AnswerField, own: Discrete) -> AnswerField:
    return replace(
        field,
        values=own.actions,
        brake=own.brake,
        proceed=own.proceed,
        mirror_pairs=own.mirror_pairs,
        aliases=own.aliases,
    )


def _at(names: Mapping[str, str], name: str) -> int:
    return list(names).index(name)


def _values(
    fields: Sequence[AnswerField], candidates: tuple[tuple[str, tuple[str, ...]], ...]
) -> list[tuple[str, ...]]:
    """Return the values of each field, those of a column among its candidates."""
    return [dict(candidates).get(one.name, ()) if one.from_column else one.values for one in fields]


@lru_cache(maxsize=64)
def _levels(space: AnswerSpace) -> dict[str, float]:
    parts = product(*_values(space.fields, space.candidates)) if space.actions else ()
    return {_symbol(space.fields, part): _level(space.fields, part) for part in parts}


@lru_cache(maxsize=64)
def _turns(space: AnswerSpace) -> tuple[dict[str, str], dict[str, str]]:
    """Return the turn of each action, and the opposite of each turn."""
    places = [at for at, field in enumerate(space.fields) if field.mirror_pairs]
    turning = [space.fields[at] for at in places]
    if not turning:
        return {}, {}
    found, opposite, alone = dict[str, str](), dict[str, str](), len(space.fields) == 1
    for part in product(*_values(space.fields, space.candidates)) if space.actions else ():
        own = [part[at] for at in places]
        turn = found[_symbol(space.fields, part)] = _symbol(turning, own, alone=alone)
        opposite[turn] = _symbol(turning, _reflected(turning, own), alone=alone)
    return found, opposite


def _level(fields: Sequence[AnswerField], part: Sequence[str]) -> float:
    """Return how hard a combination brakes."""
    return float(
        sum(
            len(field.brake) - field.brake.index(value)
            for field, value in zip(fields, part, strict=True)
            if value in field.brake
        )
    )


def _role(fields: Sequence[AnswerField], part: Sequence[str]) -> str:
    if _level(fields, part):
        return "brake"
    goes_on = any(value in field.proceed for field, value in zip(fields, part, strict=True))
    return "proceed" if goes_on else "other"


def _reflected(fields: Sequence[AnswerField], part: Sequence[str]) -> tuple[str, ...]:
    result = []
    for field, value in zip(fields, part, strict=True):
        both = {one: other for pair in field.mirror_pairs for one, other in (pair, pair[::-1])}
        result.append(both.get(value, value))
    return tuple(result)


def _symbol(fields: Sequence[AnswerField], values: Sequence[Value], *, alone: bool = True) -> str:
    """Return an answer in words: a single name as it is, else ``field=value`` with blanks between."""
    if alone and len(fields) == 1 and fields[0].kind == "name":
        return str(values[0])
    return " ".join(_worded(field, value) for field, value in zip(fields, values, strict=True))


def _worded(field: AnswerField, value: Value) -> str:
    if isinstance(value, tuple):
        return f"{field.name}=[{', '.join(f'{number + 0.0:.15g}' for number in value)}]"
    if isinstance(value, float):
        value = (field.range_of(value) if field.values else None) or f"{value + 0.0:.15g}"
    plain = value.replace(" ", "") if field.kind == "number" else json.dumps(value) if "=" in value else value
    return f"{field.name}{plain}" if plain[:1] in "<>" else f"{field.name}={plain}"


def place(into: dict[str, object], path: Sequence[str], of: Mapping[str, object]) -> None:
    """Put a field's schema at its path into the schema of an object."""
    if not into:
        into |= {"type": "object", "properties": {}, "required": [], "additionalProperties": False}
    properties, required = into["properties"], into["required"]
    assert isinstance(properties, dict)
    assert isinstance(required, list)
    if path[0] not in required:
        required.append(path[0])
    if len(path) == 1:
        properties[path[0]] = dict(of)
    else:
        place(properties.setdefault(path[0], {}), path[1:], of)


@lru_cache(maxsize=4096)
def _given(space: AnswerSpace, cells: tuple[str, ...]) -> AnswerSpace:
    allowed = zip((field.name for field in space.fields if field.from_column), map(candidates_of, cells), strict=True)
    return replace(space, candidates=tuple(allowed))


@lru_cache(maxsize=4096)
def _in_words(space: AnswerSpace, field: AnswerField) -> AnswerField:
    """Return a field without a place as one whose values are the frame's names, if words can hold them."""
    names = dict(space.candidates).get(field.name, ())
    if not names or field.key is not None or field.pattern is not None:
        return field
    try:
        return replace(field, from_column=None, values=names)
    except SpecError:
        return field


@lru_cache(maxsize=_READINGS_KEPT)
def _read_declared(space: AnswerSpace, text: str, finish_reason: str | None, error: str | None) -> Decision[str]:
    fields = [_in_words(space, field) for field in space.fields]
    found = read_declared(text, finish_reason, error, fields)
    if found.action is None:
        return Decision(None, found.missing, found.why)
    allowed, values = dict(space.candidates), list(found.action)
    for at, field in enumerate(space.fields):
        if field.name in allowed:
            names = {name.casefold(): name for name in allowed[field.name]}
            if (own := names.get(str(values[at]).casefold())) is None:
                return unparsed("other_value")
            values[at] = own
    return Decision(_symbol(space.fields, values))
