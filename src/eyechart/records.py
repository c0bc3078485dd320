"""Strict conversion of plain JSON and TOML values to records; errors name the place."""

import json
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, Protocol, TypeVar, runtime_checkable

import msgspec

T = TypeVar("T")
Name = Annotated[str, msgspec.Meta(min_length=1)]
Count = Annotated[int, msgspec.Meta(ge=0)]
Amount = Annotated[float, msgspec.Meta(ge=0)]
LARGEST = 1e30
"""The largest number in a file, so that moments and sums are finite; a seed may be larger."""

MOST_VALUES = 10_000_000
"""The most values in one JSON text; in memory they stay below 2 GB."""
_LONGEST = 60
_PLAIN = frozenset({str, int, float, bool, type(None)})
_SAID = re.compile(
    r"(?:Expected `(?P<kind>[^`]*)`(?P<bound>.*?)(?:, got `(?P<got>\w+)`)?|(?P<other>.*?))(?: - at `\$(?P<at>.*)`)?"
)
_KINDS = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "an object",
    "null": "null",
}
"""The kinds of values in words, by msgspec's names."""
_JSON = {"array": list, "object": dict, "str": str, "bool": bool, "int": int, "float": float, "null": type(None)}


def parse_json(text: str | bytes, most: int = MOST_VALUES, **how: Any) -> Any:  # noqa: ANN401 - as json.loads
    """Parse a JSON text; raises ValueError if it is none, or has more than ``most`` values.

    It counts the values by their signs first, because a value of three bytes takes up to a hundred
    in memory.
    """
    brace, bracket, comma = ("{", "[", ",") if isinstance(text, str) else (b"{", b"[", b",")
    if len(text) > most and sum(map(text.count, (brace, bracket, comma))) > most:  # type: ignore[arg-type]
        raise ValueError(f"it holds more than {most} values")
    return json.loads(text, **how)


def build(kind: type[T], raw: object, where: str = "it", *, foreign: bool = False) -> T:
    """Return the record of plain values; raises ValueError that names the place and the fault.

    An unknown field is an error, unless the values are ``foreign``. ``where`` names the whole.
    """
    try:
        made = msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        raise ValueError(_sentence(str(error), raw, where)) from error
    if not foreign:
        _refuse_strange(raw, msgspec.to_builtins(made), where)
    return made


@runtime_checkable
class JsonRecord(Protocol):
    """A record with `as_dict`; a dataclass derived from it is written as its fields."""

    __slots__ = ()

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {field.name: plain(getattr(self, field.name)) for field in fields(self)}  # type: ignore[arg-type]


def to_json_fields(record: object, names: str, /, **more: object) -> dict[str, Any]:
    """Return the attributes of a record that ``names`` has, and ``more`` keys, as plain JSON values."""
    values = {name: getattr(record, name) for name in names.split()} | more
    return {name: plain(value) for name, value in values.items()}


def plain(value: object) -> Any:  # noqa: ANN401 - JSON of the same shape
    """Return the plain JSON values of a record, a numpy number, or a collection of them."""
    if type(value) in _PLAIN:
        return value
    if isinstance(value, Mapping):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, tuple | list):
        return [plain(one) for one in value]
    if "numpy" in sys.modules and isinstance(value, sys.modules["numpy"].generic):
        return value.item()
    if isinstance(value, JsonRecord):
        return value.as_dict()
    return {one.name: plain(getattr(value, one.name)) for one in fields(value)} if is_dataclass(value) else value


def shown(value: object) -> str:
    """Return a value as one short line of JSON."""
    try:
        text = json.dumps(value, ensure_ascii=True)
    except (ValueError, TypeError, RecursionError):
        text = f"a {type(value).__name__}"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _sentence(said: str, raw: object, where: str) -> str:
    match = _SAID.fullmatch(said)
    assert match is not None
    at, value = _place(raw, match["at"] or "", match["got"])
    place = at.removeprefix(".") or where
    if match["kind"] is None:
        lacking = re.fullmatch(r"Object missing required field `(.*)`", match["other"])
        if match["other"].startswith("Invalid enum value"):
            return f"{place} is {shown(value)}, which is not one of its values"
        return f"{place} has no {lacking[1]}" if lacking else f"{place}: {match['other']}"
    kinds = set(match["kind"].split(" | ")) - ({"int"} if "float" in match["kind"] else set())
    wanted = " or ".join(words for kind, words in _KINDS.items() if kind in kinds) or match["kind"]
    return f"{place} is {shown(value)}, not {wanted}{match['bound']}"


def _place(raw: object, path: str, got: str | None) -> tuple[str, object]:
    """Return the name and value of a place; it resolves msgspec's unnamed mapping keys."""
    at, value = "", raw
    for name, index in re.findall(r"\.(\w+)|\[(\d+|\.\.\.)\]", path):
        if name:
            value = value[name] if isinstance(value, dict) else None
            at += f".{name}"
        elif index == "...":
            pairs: list[tuple[Any, Any]] = list(value.items()) if isinstance(value, dict) else []
            key, value = next(((key, one) for key, one in pairs if type(one) is _JSON.get(got or "")), ("…", None))
            at += f".{key}"
        else:
            value = value[int(index)] if isinstance(value, list | tuple) else None
            at += f"[{index}]"
    return at, value


def _refuse_strange(raw: Any, made: Any, where: str) -> None:  # noqa: ANN401 - plain values of any shape
    parts: Iterable[tuple[Any, Any]] = ()
    if isinstance(raw, dict) and isinstance(made, dict):
        parts = raw.items()
    elif isinstance(raw, list) and isinstance(made, list | tuple):
        parts = enumerate(raw)
    elif isinstance(raw, int | float) and not abs(raw) <= LARGEST:
        raise ValueError(f"{where} is {shown(raw)}, not a number up to {LARGEST:g}")
    for name, value in parts:
        if isinstance(raw, dict) and name not in made:
            raise ValueError(f"{where} has a field {shown(name)}, which this eyechart does not know")
        if isinstance(value, dict | list) or (isinstance(value, int | float) and not abs(value) <= LARGEST):
            at = f"{where}[{name}]" if isinstance(raw, list) else name if where == "it" else f"{where}.{name}"
            _refuse_strange(value, made[name], at)
