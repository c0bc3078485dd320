"""Finished episodes are the lines of a file: appended whole, and read strictly, so that damage is found where it is."""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn, get_args

from eyechart.episodes.nouns import Episode, EpisodeKey, Step
from eyechart.errors import LedgerError
from eyechart.frames import Scalar
from eyechart.spaces.discrete import Unparsed
from eyechart.spaces.scene import Unscened
from eyechart.spaces.space import MISSING, Decision

EPISODES = "episodes.jsonl"
"""A run's finished episodes, one a line, in the order in which they ended."""

_LONGEST = 60

Reader = Callable[[object, str], Any]
"""From a value and the name of its place to what it is; raises _AmissError where it is something else."""


def read_episodes(path: Path) -> Iterator[Episode]:
    """Yield the finished episodes of a run folder; what a kill cut at the end of the file is no episode.

    Raises LedgerError with the line, the field and what to do, for anything else that is none.
    """
    file = path / EPISODES
    if not file.is_file():
        return
    lines = file.read_bytes().split(b"\n")
    for number, line in enumerate(lines[:-1], 1):
        try:
            yield _episode(_parsed(line))
        except (_AmissError, RecursionError) as error:
            raise LedgerError(
                f"{file}: line {number} is no episode: {error}; restore the file from a copy, or delete this line: "
                "the command that began the run then drives its episode anew, and asks no finished call again"
            ) from error


def write_episodes(path: Path, episodes: Iterable[Episode]) -> None:
    """Append finished episodes to a run folder's file.

    Each is with the operating system when this returns, so that the kill of a process loses none.
    """
    with (path / EPISODES).open("a", encoding="utf-8", errors="backslashreplace") as file:
        for episode in episodes:
            file.write(episode.as_line() + "\n")
        file.flush()


def mend_episodes(path: Path) -> None:
    """Cut off the beginning of an episode that a kill left at the end of a run folder's file, before more is added."""
    file = path / EPISODES
    if file.is_file():
        text = file.read_bytes()
        whole = text.rfind(b"\n") + 1
        if whole < len(text):
            with file.open("r+b") as opened:
                opened.truncate(whole)


class _AmissError(Exception):
    """A value is not what its place wants."""


def _amiss(where: str, found: object, wanted: str) -> NoReturn:
    try:
        shown = json.dumps(found, ensure_ascii=True)
    except (ValueError, RecursionError):
        shown = f"a {type(found).__name__}"
    shown = shown if len(shown) <= _LONGEST else f"{shown[:_LONGEST]}…"
    raise _AmissError(f"{where} is {shown}, not {wanted}")


def _parsed(line: bytes) -> object:
    def refuse(word: str) -> NoReturn:
        raise _AmissError(f"it holds {word}, which is no number")

    try:
        return json.loads(line, parse_constant=refuse)
    except ValueError as error:
        raise _AmissError(f"it is no JSON: {error}") from error


def _episode(raw: object) -> Episode:
    found = _fields(raw, "it", _EPISODE, optional=("detail", "max_steps"))
    key = EpisodeKey(**found.pop("key"))
    each = enumerate(found.pop("steps"))
    steps = tuple(_step(one, f"steps[{number}]", key.frame(number), number) for number, one in each)
    return Episode(key=key, steps=steps, **found)


def _step(raw: object, where: str, frame: str, number: int) -> Step:
    found = _fields(raw, where, _STEP, optional=("facts", "error"))
    for name, due in (("step", number), ("frame", frame)):
        if found[name] != due:
            _amiss(f"{where}.{name}", found[name], f"{json.dumps(due)}, which is this step's")
    try:
        decision = Decision(**found["decision"])
    except ValueError as error:
        raise _AmissError(f"{where}.decision: {error}") from error
    return Step(**{**found, "decision": decision})


def _fields(raw: object, where: str, readers: Mapping[str, Reader], optional: Iterable[str] = ()) -> dict[str, Any]:
    """Return the fields of an object, each read; raises _AmissError for one that is missing, unknown or amiss."""
    if not isinstance(raw, dict):
        _amiss(where, raw, "an object")
    if lacking := [name for name in readers if name not in raw and name not in optional]:
        raise _AmissError(f"{where} has no {', '.join(lacking)}")
    for name in raw:
        if name not in readers:
            raise _AmissError(f"{where} has a field {json.dumps(name)[:_LONGEST]}, which this eyechart does not know")
    inside = "" if where == "it" else f"{where}."
    return {name: readers[name](value, f"{inside}{name}") for name, value in raw.items()}


def _text(raw: object, where: str) -> str:
    return raw if isinstance(raw, str) else _amiss(where, raw, "text")


def _name(raw: object, where: str) -> str:
    return raw if isinstance(raw, str) and raw else _amiss(where, raw, "a name")


def _flag(raw: object, where: str) -> bool:
    return raw if isinstance(raw, bool) else _amiss(where, raw, "true or false")


def _number(raw: object, where: str) -> float:
    if isinstance(raw, bool) or not isinstance(raw, int | float) or not _finite(raw):
        _amiss(where, raw, "a number")
    return raw


def _finite(raw: float) -> bool:
    try:
        return math.isfinite(raw)
    except OverflowError:
        return False


def _count(raw: object, where: str) -> int:
    if isinstance(raw, bool) or not isinstance(raw, int) or raw < 0:
        _amiss(where, raw, "a whole number from 0 on")
    return raw


def _one_of(names: Sequence[str]) -> Reader:
    return lambda raw, where: raw if raw in names else _amiss(where, raw, f"one of {', '.join(names)}")


def _maybe(read: Reader) -> Reader:
    return lambda raw, where: None if raw is None else read(raw, where)


def _list(raw: object, where: str) -> list[object]:
    return raw if isinstance(raw, list) else _amiss(where, raw, "a list")


def _scalars(raw: object, where: str) -> dict[str, Scalar]:
    if not isinstance(raw, dict):
        _amiss(where, raw, "an object")
    return {name: _scalar(value, f"{where}.{name}") for name, value in raw.items()}


def _scalar(raw: object, where: str) -> Scalar:
    return raw if raw is None or isinstance(raw, str | bool) else _number(raw, where)


_KEY: Mapping[str, Reader] = {
    "policy": _name,
    "simulator": _name,
    "scenario": _name,
    "seed": _count,
    "condition": _name,
}
_DECISION: Mapping[str, Reader] = {
    "action": _maybe(_name),
    "missing": _maybe(_one_of(MISSING)),
    "why": _maybe(_one_of((*get_args(Unparsed), *get_args(Unscened)))),
}
_STEP: Mapping[str, Reader] = {
    "step": _count,
    "frame": _name,
    "decision": lambda raw, where: _fields(raw, where, _DECISION, optional=("missing", "why")),
    "executed_action": _name,
    "truth": _scalars,
    "reward": _number,
    "speed_mps": _maybe(_number),
    "distance_m": _maybe(_number),
    "crashed": _flag,
    "facts": _scalars,
    "error": _text,
}
_EPISODE: Mapping[str, Reader] = {
    "key": lambda raw, where: _fields(raw, where, _KEY, optional=("condition",)),
    "steps": _list,
    "ended": _name,
    "state_sha256": _text,
    "detail": _text,
    "max_steps": _maybe(_count),
}
