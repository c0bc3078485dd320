"""JSON values compared key by key, and the list of what differs on purpose (`differences.toml` beside what is kept)."""

import math
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

Key = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Difference:
    """What stands at a key in one value and otherwise, or not at all, in the other; ``kind`` is one of `KINDS`."""

    key: Key
    kind: str
    old: object = None
    new: object = None

    def __str__(self) -> str:
        """Return one line."""
        place = " > ".join(self.key) or "all"
        return f"{place}: {self.kind}, {_short(self.old)} → {_short(self.new)}"


KINDS = ("added", "removed", "changed")
NAMES = (
    "simulator",
    "policy",
    "condition",
    "run",
    "first",
    "second",
    "asks",
    "baseline",
    "model",
    "statistic",
    "controller",
    "key",
)
"""Fields that name the members of a list, so that a list to which some were added is compared member by member."""


@dataclass(frozen=True, slots=True)
class Expected:
    """A difference on purpose: patterns of the answer's name and of each part of the key, its kind, and the reason."""

    answer: str
    key: Key
    kind: str
    reason: str

    def covers(self, answer: str, found: Difference) -> bool:
        """Return whether a difference of an answer is this one."""
        return (
            fnmatchcase(answer, self.answer)
            and self.kind == found.kind
            and len(self.key) == len(found.key)
            and all(fnmatchcase(part, pattern) for part, pattern in zip(found.key, self.key, strict=True))
        )


def differences(old: object, new: object, key: Key = (), *, within: float = 0.0) -> Iterator[Difference]:
    """Yield where two JSON values differ. Numbers are of one kind and equal to the last bit; NaN equals NaN.

    Lists are compared place by place, and name by name where one is longer and its members have names (`NAMES`; a text
    names itself). ``within`` is how far apart floats may be, as a share of the larger and at most so much beside 0:
    another processor adds in another order.
    """
    if isinstance(old, list) and isinstance(new, list) and len(old) != len(new):
        old, new = _by_name(old, new)
    if isinstance(old, dict) and isinstance(new, dict):
        for name in [*old, *(name for name in new if name not in old)]:
            if name not in new:
                yield Difference((*key, name), "removed", old[name])
            elif name not in old:
                yield Difference((*key, name), "added", new=new[name])
            else:
                yield from differences(old[name], new[name], (*key, name), within=within)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for place, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from differences(one, other, (*key, str(place)), within=within)
    elif isinstance(old, float) and isinstance(new, float) and math.isclose(old, new, rel_tol=within, abs_tol=within):
        return
    elif type(old) is not type(new) or (old != new and not (old != old and new != new)):  # noqa: PLR0124 - NaN
        yield Difference(key, "changed", old, new)


def read_expected(path: Path) -> list[Expected]:
    """Read the list of what differs on purpose; raises ValueError where an entry lacks something or is of no kind."""
    result = []
    for group in tomllib.loads(path.read_text(encoding="utf-8")).get("difference", []):
        kinds = {kind: lines for kind, lines in group.items() if kind in KINDS}
        if set(group) != {"reason", *kinds} or not kinds or not group["reason"].strip():
            raise ValueError(f"{path}: {group} needs a reason, and lines of what is {', '.join(KINDS)}")
        for kind, lines in kinds.items():
            for line in lines:
                answer, _, key = line.partition(": ")
                result.append(Expected(answer, tuple(key.split(" > ")), kind, group["reason"]))
    return result


def unexpected(answer: str, found: Iterable[Difference], expected: Iterable[Expected]) -> list[str]:
    """Return the differences of an answer that no entry of the list covers, a line each."""
    listed = list(expected)
    return [str(one) for one in found if not any(entry.covers(answer, one) for entry in listed)]


def _by_name(old: list[object], new: list[object]) -> tuple[object, object]:
    """Return both lists by the names of their members; as they are, where a member has none, or two have the same."""
    named = [name for name in NAMES if all(isinstance(one, dict) and name in one for one in (*old, *new))]
    found = []
    for side in (old, new):
        if all(isinstance(one, str) for one in side):
            names = side
        elif named:
            names = [" ".join(str(one[name]) for name in named) for one in side]
        else:
            return old, new
        if len(set(names)) < len(names):
            return old, new
        found.append(dict(zip(names, side, strict=True)))
    return found[0], found[1]


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}…"
