"""Compare what a bundle prints with what its ledger gives, by values and words, not by bytes."""

import bisect
import csv
import io
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from eyechart.records import JsonRecord

TOLERANCE = 1e-9
"""Two numbers are the same up to this difference, relative to the larger."""
NOISE = 1e-14
"""The rest after subtracting equal numbers; numbers this close are the same, except p-values."""
DRAWN = 0.02
"""Positions in a drawing are the same up to this difference, in its units (1/72 inch)."""
_NUMBER = re.compile(r"[-+]?(?:\d+\.\d+|\d+)(?:[eE][-+]?\d+)?")
_SHOWN = 160


@dataclass(frozen=True, slots=True)
class PrintedDifference(JsonRecord):
    """A figure that does not follow from the ledger: its place, and both values."""

    where: str
    printed: str
    recomputed: str

    def __str__(self) -> str:
        return f"{printable(self.where)}: printed {_short(self.printed)}, recomputed {_short(self.recomputed)}"


def printable(text: str) -> str:
    """Return a foreign text without characters that move or colour terminal output."""
    return "".join(sign if sign.isprintable() else " " for sign in text)


def _short(text: str) -> str:
    plain = printable(text)
    return f"'{plain}'" if len(plain) <= _SHOWN else f"'{plain[:_SHOWN]}…'"


def is_same_number(one: float, other: float, noise: float = NOISE) -> bool:
    """Return whether two numbers agree within the tolerance, or within ``noise``."""
    return one == other or abs(one - other) <= max(noise, TOLERANCE * max(abs(one), abs(other)))


@dataclass(frozen=True)
class RoundedNumbers:
    """All recomputed numbers, to tell a tie in rounding from a changed digit."""

    values: tuple[float, ...]

    @classmethod
    def of(cls, results: object) -> "RoundedNumbers":
        """Return the rounding of all numbers in plain JSON values."""
        return cls(tuple(sorted({float(value) for value in _numbers(results) if math.isfinite(value)})))

    def is_same(self, printed: str, recomputed: str) -> bool:
        """Return whether two texts agree, up to ties in rounding."""
        return printed == recomputed or _is_alike(printed, recomputed, self._is_tie)

    def _is_tie(self, one: str, other: str) -> bool:
        """Return whether a recomputed number lies midway between two, one last digit apart."""
        digits = {len(text.partition(".")[2]) for text in (one, other)}
        a, b = float(one), float(other)
        if len(digits) != 1 or 0 in digits or "e" in f"{one}{other}".lower():
            return False
        unit = 10.0 ** -digits.pop()
        middle, off = (a + b) / 2, TOLERANCE * max(1.0, abs(a))
        if abs(abs(a - b) - unit) > unit / 100:
            return False
        near = bisect.bisect_left(self.values, middle - off)
        return near < len(self.values) and self.values[near] <= middle + off


def _numbers(values: object) -> Iterator[float]:
    if isinstance(values, dict | list):
        for value in values.values() if isinstance(values, dict) else values:
            yield from _numbers(value)
    elif isinstance(values, int | float) and not isinstance(values, bool):
        yield float(values)


Path = tuple[str | int, ...]
Name = Callable[[Path], str]


def compare_values(
    printed: object, recomputed: object, rounding: RoundedNumbers, name: Name, path: Path = ()
) -> Iterator[PrintedDifference]:
    """Yield the differences of two plain JSON values, from ``path`` on; ``name`` words a place."""
    if isinstance(printed, dict) and isinstance(recomputed, dict):
        for key in [*recomputed, *(key for key in printed if key not in recomputed)]:
            if key not in printed or key not in recomputed:
                yield PrintedDifference(
                    name((*path, key)), *(str(side.get(key, "nothing")) for side in (printed, recomputed))
                )
            else:
                yield from compare_values(printed[key], recomputed[key], rounding, name, (*path, key))
    elif isinstance(printed, list) and isinstance(recomputed, list):
        if len(printed) != len(recomputed):
            yield PrintedDifference(name(path), f"{len(printed)} values", f"{len(recomputed)} values")
        for place, (one, other) in enumerate(zip(printed, recomputed, strict=False)):
            yield from compare_values(one, other, rounding, name, (*path, place))
    elif not _is_same_leaf(printed, recomputed, rounding, 0.0 if "holm" in path or path[-1:] == ("p",) else NOISE):
        yield PrintedDifference(name(path), str(printed), str(recomputed))


def _is_same_leaf(printed: object, recomputed: object, rounding: RoundedNumbers, noise: float) -> bool:
    if isinstance(printed, str) and isinstance(recomputed, str):
        return rounding.is_same(printed, recomputed)
    if isinstance(printed, float) and isinstance(recomputed, float):
        return is_same_number(printed, recomputed, noise)
    return type(printed) is type(recomputed) and printed == recomputed


def compare_tables(file: str, printed: str, recomputed: str, rounding: RoundedNumbers) -> Iterator[PrintedDifference]:
    """Yield the differences of two tables: by cell in CSV, else by line."""
    if file.endswith(".csv"):
        yield from _compare_csv(file, printed, recomputed, rounding)
        return
    mine, theirs = printed.split("\n"), recomputed.split("\n")
    if len(mine) != len(theirs):
        yield PrintedDifference(file, f"{len(mine)} lines", f"{len(theirs)} lines")
    for number, (one, other) in enumerate(zip(mine, theirs, strict=False), 1):
        if not rounding.is_same(one, other):
            yield _line_difference(f"{file}, line {number}", one, other)


def _line_difference(where: str, printed: str, recomputed: str) -> PrintedDifference:
    """Return how two lines of a table differ: the first different cells, if both have as many."""
    mine, theirs = (re.split(r"\s*[|&]\s*", line.strip("| ")) for line in (printed, recomputed))
    place = first_difference(mine, theirs)
    if len(mine) == len(theirs) > place:
        printed, recomputed = mine[place], theirs[place]
    return PrintedDifference(f"{where} ({' '.join(theirs[:2])})", printed, recomputed)


def _compare_csv(file: str, printed: str, recomputed: str, rounding: RoundedNumbers) -> Iterator[PrintedDifference]:
    try:
        mine, theirs = (list(csv.reader(io.StringIO(text), strict=True)) for text in (printed, recomputed))
    except csv.Error as error:
        yield PrintedDifference(file, f"no CSV: {error}", "a table")
        return
    if [len(row) for row in mine] != [len(row) for row in theirs]:
        yield PrintedDifference(file, f"{len(mine)} rows", f"{len(theirs)} rows, or of other lengths")
    header = theirs[0] if theirs else []
    for one, other in zip(mine, theirs, strict=False):
        for column, (cell, expected) in enumerate(zip(one, other, strict=False)):
            what = header[column] if column < len(header) else str(column)
            if not _is_same_cell(cell, expected, rounding, 0.0 if what in {"p", "Holm p"} else NOISE):
                row = " ".join(other[: 2 if file.endswith("statistics.csv") else 1])
                yield PrintedDifference(f"{file}, {row}, {what}", cell, expected)
    if skeleton(printed) != skeleton(recomputed):
        yield PrintedDifference(f"{file}, its writing", "other quotes, commas or ends of lines", "as they are written")


def skeleton(text: str) -> str:
    """Return a text without its numbers: the part that must be equal character by character."""
    return _NUMBER.sub("0", text)


def _is_same_cell(printed: str, recomputed: str, rounding: RoundedNumbers, noise: float) -> bool:
    if _NUMBER.fullmatch(printed) and _NUMBER.fullmatch(recomputed) and {"."} & {*printed, *recomputed}:
        return is_same_number(float(printed), float(recomputed), noise)
    return rounding.is_same(printed, recomputed)


def is_same_drawing(printed: str, recomputed: str) -> bool:
    """Return whether two attributes of a drawing put the same things at the same positions."""
    return _is_alike(printed, recomputed, lambda one, other: abs(float(one) - float(other)) <= DRAWN)


def _is_alike(printed: str, recomputed: str, same: Callable[[str, str], bool]) -> bool:
    """Return whether two texts differ only in numbers, and ``same`` holds for each pair."""
    if _NUMBER.split(printed) != _NUMBER.split(recomputed):
        return False
    pairs = zip(_NUMBER.findall(printed), _NUMBER.findall(recomputed), strict=True)
    return all(one == other or same(one, other) for one, other in pairs)


def first_difference(printed: Sequence[object], recomputed: Sequence[object]) -> int:
    """Return the index of the first difference, or the shorter length."""
    pairs = enumerate(zip(printed, recomputed, strict=False))
    return next((place for place, (one, other) in pairs if one != other), min(len(printed), len(recomputed)))


def is_same_writing(values: object, text: str, write: Callable[[object], str]) -> bool:
    """Return whether ``write`` gives this text for its values; never for NaN and infinity."""
    try:
        return write(values) == text
    except ValueError:
        return False
