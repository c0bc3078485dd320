r"""Regular expressions of users, matched in time proportional to text times pattern.

Python's own expressions may take exponential time for a few characters of a reply. These have
literals, classes, groups, alternatives, repeats, ``^``, ``$`` and ``\b``, and no look-around or
back-reference. A pair of place and instruction that failed once is not tried again.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from eyechart.errors import SpecError, raising

_LONGEST = 500
_INSTRUCTIONS_AT_MOST = 2000
_LEVELS_AT_MOST = 50
_STEPS_AT_MOST = 5_000_000
"""Text times instructions; a longer text is not searched."""

_FLAGS = re.compile(r"\(\?([ims]+)\)")
_ESCAPE = re.compile(r"\\(?:[dDwWsSbBntr]|[^\w\s]|x[0-9a-fA-F]{2}|u[0-9a-fA-F]{4})", re.DOTALL)
_CLASS = re.compile(r"\[\^?\]?(?:[^\\\]]|\\.)*\]", re.DOTALL)
_COUNT = re.compile(r"\{(\d{1,4})(?:(,)(\d{0,4}))?\}")
_ASSERTIONS = frozenset(["^", "$", r"\b", r"\B"])

Test = Callable[[str, int], object]

_Node = tuple[str, Any]
"""A part of a pattern: its kind and its content."""


class TooLongText(Exception):  # noqa: N818 - no error: a text that is not searched
    """A text is too long for a pattern."""


@dataclass(frozen=True, slots=True)
class FoundGroup:
    """The group of one match: its text and its span."""

    text: str
    start: int
    end: int


@dataclass(frozen=True)
class LinearPattern:
    """A pattern with one group, whose time is bounded.

    Raises SpecError for anything else, beginning with ``where``.
    """

    text: str
    where: str = "the pattern"

    def __post_init__(self) -> None:
        _program(self.text, self.where)

    def search(self, text: str) -> Iterator[FoundGroup]:
        """Yield the group of each match from left to right; raises TooLongText.

        Matches do not overlap. A match without the group is left out.
        """
        program = _program(self.text, self.where)
        if len(text) * len(program) > _STEPS_AT_MOST:
            raise TooLongText
        start, failed = 0, dict[int, int]()
        while start <= len(text):
            found = _match(program, text, start, failed)
            if found is None:
                start += 1
                continue
            end, begin, behind = found
            if begin >= 0 and behind >= begin:
                yield FoundGroup(text[begin:behind], begin, behind)
            failed.pop(end, None)
            start = max(end, start + 1)


_Instruction = tuple[str, Any]
"""Its kind, and its test or the places of the ways on."""


def _match(
    program: tuple[_Instruction, ...], text: str, start: int, failed: dict[int, int]
) -> tuple[int, int, int] | None:
    """Return the end of a match and the span of its group; records what ``failed`` by place."""
    stack = [(0, start, -1, -1)]
    while stack:
        at, place, begin, behind = stack.pop()
        known = failed.get(place, 0)
        if known >> at & 1:
            continue
        failed[place] = known | 1 << at
        kind, content = program[at]
        if kind == "test":
            if place < len(text) and content(text, place):
                stack.append((at + 1, place + 1, begin, behind))
        elif kind == "assert":
            if content(text, place):
                stack.append((at + 1, place, begin, behind))
        elif kind == "split":  # the first way is tried first, and lies on top
            stack += [(way, place, begin, behind) for way in reversed(content)]
        elif kind == "open":
            stack.append((at + 1, place, place, behind))
        elif kind == "close":
            stack.append((at + 1, place, begin, place))
        else:
            return place, begin, behind
    return None


@lru_cache(maxsize=256)
def _program(text: str, where: str) -> tuple[_Instruction, ...]:
    """Return the instructions of a pattern; raises SpecError that says what is wrong."""
    if not text or len(text) > _LONGEST:
        raise SpecError(f"{where}: a pattern has 1 to {_LONGEST} characters, not {len(text)}")
    if text.count("(") > _LEVELS_AT_MOST:
        raise SpecError(f"{where}: a pattern has at most {_LEVELS_AT_MOST} groups")
    with raising(SpecError, f"{where}: '{text}' is no regular expression", of=re.error):
        groups = re.compile(text).groups
    parser = _Parser(text, where)
    node = parser.whole()
    if groups != 1:
        raise SpecError(
            f"{where}: '{text}' has {groups} groups; put the answer alone in (...), and write (?:...) for the others"
        )
    made: list[_Instruction] = []
    _emit(node, made, where)
    return (*made, ("match", None))


class _Parser:
    """Parses a pattern into nodes."""

    def __init__(self, text: str, where: str) -> None:
        flags = _FLAGS.match(text)
        self._text, self._where, self._at = text, where, 0 if flags is None else flags.end()
        letters = "" if flags is None else flags[1]
        self._flags = sum(getattr(re, letter.upper()) for letter in {*letters})

    def whole(self) -> _Node:
        node = self._either()
        if self._at < len(self._text):
            raise self._refused(self._text[self._at])
        return node

    def _refused(self, what: str) -> SpecError:
        return SpecError(
            f"{self._where}: '{self._text}' uses '{what}', which this reader lacks; it has literals, classes, "
            r"(...), (?:...), |, repeats, ^, $ and \b, so that no reply takes long to read"
        )

    def _either(self) -> _Node:
        ways = [self._row()]
        while self._at < len(self._text) and self._text[self._at] == "|":
            self._at += 1
            ways.append(self._row())
        return ways[0] if len(ways) == 1 else ("either", ways)

    def _row(self) -> _Node:
        parts: list[_Node] = []
        while self._at < len(self._text) and self._text[self._at] not in "|)":
            parts.append(self._repeated(self._one()))
        return "row", parts

    def _one(self) -> _Node:
        sign = self._text[self._at]
        if sign == "(":
            return self._group()
        if sign == "[":
            return self._tested(_CLASS)
        if sign == "\\":
            return self._tested(_ESCAPE)
        self._at += 1
        return ("assert" if sign in _ASSERTIONS else "test"), self._test(sign)

    def _group(self) -> _Node:
        rest = self._text[self._at :]
        if rest.startswith("(?") and not rest.startswith("(?:"):
            raise self._refused(rest[:3])
        kept = not rest.startswith("(?:")
        self._at += 1 if kept else 3
        inner = self._either()
        self._at += 1  # ")" is there: the expression compiled
        return ("row", [("open", None), inner, ("close", None)]) if kept else inner

    def _tested(self, of: re.Pattern[str]) -> _Node:
        found = of.match(self._text, self._at)
        if found is None:
            raise self._refused(self._text[self._at : self._at + 2])
        self._at = found.end()
        return ("assert" if found[0] in _ASSERTIONS else "test"), self._test(found[0])

    def _test(self, sign: str) -> Test:
        """Return the test of one character, or of a place, as Python's own expression has it."""
        return re.compile(sign, self._flags).match

    def _repeated(self, node: _Node) -> _Node:
        if self._at >= len(self._text):
            return node
        sign, least, most = self._text[self._at], 0, -1
        if sign in "*+?":
            least, most = int(sign == "+"), 1 if sign == "?" else -1
            self._at += 1
        elif (found := _COUNT.match(self._text, self._at)) is not None:
            least, most = int(found[1]), int(found[1]) if found[2] is None else int(found[3] or -1)
            self._at = found.end()
        else:
            return node
        lazy = self._text[self._at : self._at + 1] == "?"
        self._at += lazy
        if self._text[self._at : self._at + 1] in {"*", "+", "?"} or node[0] == "assert":
            raise self._refused(self._text[self._at - 1 - lazy : self._at + 1])
        return "repeat", (node, least, most, lazy)


def _emit(node: _Node, made: list[_Instruction], where: str) -> None:
    """Append the instructions of a node."""
    if len(made) > _INSTRUCTIONS_AT_MOST:
        raise SpecError(f"{where}: the pattern repeats too much: at most {_INSTRUCTIONS_AT_MOST} steps")
    kind, content = node
    if kind == "row":
        for part in content:
            _emit(part, made, where)
    elif kind == "either":
        _emit_either(content, made, where)
    elif kind == "repeat":
        _emit_repeat(content, made, where)
    else:
        made.append((kind, content))


def _emit_either(ways: list[_Node], made: list[_Instruction], where: str) -> None:
    ends = []
    for way in ways[:-1]:
        split = len(made)
        made.append(("split", ()))
        _emit(way, made, where)
        ends.append(len(made))
        made.append(("split", ()))
        made[split] = ("split", (split + 1, len(made)))
    _emit(ways[-1], made, where)
    for end in ends:
        made[end] = ("split", (len(made),))


def _emit_repeat(content: tuple[_Node, int, int, bool], made: list[_Instruction], where: str) -> None:
    """Append a node ``least`` times, and then optionally up to ``most`` times; -1 is no bound."""
    node, least, most, lazy = content

    def choose(inside: int, behind: int) -> _Instruction:
        return "split", (behind, inside) if lazy else (inside, behind)

    for _ in range(least):
        before = len(made)
        _emit(node, made, where)
        if len(made) == before:  # nothing, however often: the bound on steps would never end the loop
            break
    if most < 0:
        split = len(made)
        made.append(("split", ()))
        _emit(node, made, where)
        made.append(("split", (split,)))
        made[split] = choose(split + 1, len(made))
        return
    splits = []
    for _ in range(most - least):
        splits.append(len(made))
        made.append(("split", ()))
        _emit(node, made, where)
    for split in splits:
        made[split] = choose(split + 1, len(made))
