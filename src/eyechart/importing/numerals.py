"""Number formats of tables: marks that mean "none", decimal signs, thousands, and units."""

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from eyechart.errors import SourceError, SpecError
from eyechart.importing.cells import Cell, Row

STYLES: dict[str, tuple[str, str]] = {
    "1234.5": ("", "."),
    "1234,5": ("", ","),
    "1.234,5": (".", ","),
    "1 234,5": (" ", ","),
    "1'234.5": ("'", "."),
    "1,234.5": (",", "."),
}
"""The examples of ``--numbers``: each with its sign between thousands and its decimal sign."""

UNITS: dict[str, tuple[str, ...]] = {
    "mm": ("millimeter", "millimeters", "millimetre", "millimetres"),
    "cm": ("centimeter", "centimeters", "centimetre", "centimetres"),
    "m": ("meter", "meters", "metre", "metres"),
    "km": ("kilometer", "kilometers", "kilometre", "kilometres"),
    "dm": ("decimeter", "decimeters", "decimetre", "decimetres"),
    "in": ("inch", "inches"),
    "ft": ("foot", "feet"),
    "yd": ("yard", "yards"),
    "mi": ("mile", "miles"),
    "px": ("pixel", "pixels"),
    "nmi": ("nm", "nauticalmile", "nauticalmiles"),
    "deg": ("degree", "degrees", "°"),
    "%": ("percent", "pct", "perc"),
    "ms": ("millisecond", "milliseconds"),
    "s": ("sec", "second", "seconds"),
}
"""Units that a column's name may end with, as in ``distance_m``, and their names in words."""

_SPACES = "\u00a0\u202f\u2009 "
_UNITED = re.compile(r"(?P<number>.*\d\.?)\s*(?P<unit>[^\W\d_]+)")
_PLAIN = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}")
"""A number whose point may be a decimal point or separate thousands."""
_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+|\d+")
_WITHIN = frozenset(
    {"mm", "cm", "km", "ft", "feet"}
    | {f"{many}{unit}" for many in ("", "milli", "centi", "deci", "kilo") for unit in ("meters", "metres")}
)
"""Words that are units also within a name. Others mean something else there, as in
``gap_second_car_in_lane``."""
_LENGTHS = {
    "mm": 0.001,
    "cm": 0.01,
    "dm": 0.1,
    "m": 1.0,
    "km": 1000.0,
    "in": 0.0254,
    "ft": 0.3048,
    "yd": 0.9144,
    "mi": 1609.344,
    "nmi": 1852.0,
}
"""Units of length in meters."""
_LEAST_MARK = 90.0
"""The least mark such as 99 or 999; smaller numbers of such digits are ordinary."""
_LARGE = 1e6
_ENDS = frozenset({*(2.0**bits - one for bits in (8, 15, 16, 31, 32, 63, 64) for one in (0, 1))})
_FAR = 2.0
_OFTEN, _FEW_DIGITS, _OTHERS = 3, 2, 5
"""A round number is taken for a mark if it occurs this often, far above at least this many others:
100, 500, 1000."""


def unit_named(words: str) -> str | None:
    """Return a unit by its sign or its name in words, None if it is unknown."""
    low = words.strip().lower()
    return next((unit for unit, names in UNITS.items() if low == unit or low in names), None)


def unit_of(column: str) -> str | None:
    """Return the unit in a column's name, as ``distance_cm`` or ``gap_cm_left``, else None.

    A unit at the end comes first. Within a name, only unmistakable units count.
    """
    parts = [part for part in re.split(r"[^A-Za-z0-9]+", column) if part]
    last = _WORDS.findall(parts[-1]) if parts else []
    if len(parts) + len(last) < 3:  # a name of one word is no unit of anything
        return None
    inner = [word for part in parts for word in (_WORDS.findall(part) if part.isalpha() else [part])]
    within = (unit_named(word) for word in reversed(inner) if word.lower() in _WITHIN)
    return unit_named(last[-1] if len(last) > 1 else parts[-1]) or next(filter(None, within), None)


@dataclass(frozen=True)
class Numerals:
    """The declared format of a table's numbers.

    ``style`` is one of `STYLES`, or "" for a decimal point and nothing between thousands.
    ``no_lead`` are the numbers and words that mean "nothing ahead" in the gap's column. None
    declares nothing, and then a number that looks like a mark is refused. An empty sequence
    declares that every number is a distance.
    """

    style: str = ""
    no_lead: tuple[str, ...] | None = None
    counted: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        if self.style and self.style not in STYLES:
            raise SpecError(f"--numbers {self.style}: the format of numbers is one of {', '.join(STYLES)}")

    def row(self, row: Row, words: Iterable[str], where: str) -> Row:
        """Return a row with numbers as Python writes them, except in the columns of ``words``.

        Raises SourceError, beginning with ``where``, for a number in another format than declared.
        """
        if not self.style:
            return row
        kept = {*words}
        return {
            name: self._number(cell, f"{where}: '{name}'") if isinstance(cell, str) and name not in kept else cell
            for name, cell in row.items()
        }

    def _number(self, cell: str, what: str) -> str:
        """Return a number, also before a unit, as Python writes it; other text stays."""
        united = _UNITED.fullmatch(cell.strip())
        number, unit = (united["number"].strip(), f" {united['unit']}") if united else (cell.strip(), "")
        between, point = STYLES[self.style]
        if between == "'":
            number = re.sub(r"(?<=\d)[\u2019\u02bc](?=\d)", "'", number)
        if between == " ":
            number = re.sub(f"(?<=\\d)[{_SPACES}](?=\\d)", " ", number)
        if re.fullmatch(_written(between, point), number):
            return (
                number.replace(between, "").replace(point, ".") + unit if between else number.replace(point, ".") + unit
            )
        if _PLAIN.fullmatch(number):
            raise SourceError(f"{what} is '{cell[:60]}', not a number as --numbers {self.style} writes them")
        return cell

    def gap(self, cell: Cell, unit: str, what: str) -> Cell:
        """Return a gap's cell without its unit, None for a mark; ``what`` names row and column.

        Raises SourceError for another unit than the declared one.
        """
        number, said = _parted(cell)
        if cell is None or (mark := self._mark(cell) or self._mark(number)) is not None:
            self.counted.update([] if cell is None else [str(mark)])
            return None
        if not said:
            return cell
        if not unit:
            raise SourceError(f"{what} is '{str(cell)[:60]}'; say the unit: --unit {said}")
        if said != unit and (unit_named(said) or said) != (unit_named(unit) or unit):
            raise SourceError(f"{what} is '{str(cell)[:60]}', and the gap is in {unit}; a gap has one unit")
        return number

    def _mark(self, cell: Cell) -> str | None:
        """Return the mark for "nothing ahead" that a cell equals, else None."""
        return next((mark for mark in self.no_lead or () if _is_same(cell, mark)), None)


def distance(cell: Cell, unit: str, what: str) -> Cell:
    """Return a cell of distances as a number in ``unit``, which is also the default unit.

    Raises SourceError, beginning with ``what``, for a unit that cannot be converted.
    """
    number, said = _parted(cell)
    own, to = unit_named(said) or said, unit_named(unit) or unit
    if not said or not unit or own == to:
        return number
    if not {own, to} <= _LENGTHS.keys():
        raise SourceError(f"{what} is '{str(cell)[:60]}', which cannot be converted to the gap's {unit}")
    return float(str(number)) * _LENGTHS[own] / _LENGTHS[to]


def _parted(cell: Cell) -> tuple[Cell, str]:
    """Return a number and the unit behind it, or the cell as it is and no unit."""
    united = _UNITED.fullmatch(cell.strip()) if isinstance(cell, str) else None
    if united is None or not _PLAIN.fullmatch(number := united["number"].strip()):
        return cell, ""
    return number, united["unit"]


def unclear(rows: Iterable[tuple[Row, str]], columns: Iterable[str]) -> str | None:
    """Return a message on a number that may be a thousand times as large, else None.

    ``rows`` have their names for messages. It is None if another number of the table has a point
    that must be a decimal point.
    """
    first, wanted = None, {*columns}
    for row, where in rows:
        for name, cell in row.items():
            if not isinstance(cell, str) or "." not in cell or not _PLAIN.fullmatch(text := cell.strip()):
                continue
            if not _GROUPED.fullmatch(text):
                return None
            if first is None and name in wanted:
                first = f"{where}: '{name}' is '{text}', which is {float(text):g} or {text.replace('.', '')}"
    if first is None:
        return None
    return f"{first}: declare the format of numbers with --numbers 1234.5 or --numbers 1.234,5"


def _written(between: str, point: str) -> str:
    whole = rf"(?:\d{{1,3}}(?:{re.escape(between)}\d{{3}})+|\d+)" if between else r"\d+"
    return rf"[+-]?(?:{whole})(?:{re.escape(point)}\d*)?(?:[eE][+-]?\d+)?"


def _is_same(cell: Cell, mark: str) -> bool:
    """Return whether a cell is a mark: the same number, or the same word in any case."""
    try:
        one, other = float(cell) if isinstance(cell, str | int | float) else math.nan, float(mark)
    except (ValueError, OverflowError):
        return str(cell).strip().lower() == mark.lower()
    return one == other or (math.isnan(one) and math.isnan(other))


def odd_gaps(
    numbers: Sequence[float | None], named: Iterable[str], numerals: Numerals, column: str, *, marks: bool
) -> list[str]:
    """Return the faults of the gap's numbers: below zero, and with ``marks``, undeclared marks.

    ``named`` names each row for messages. A distance is never below zero. Three kinds of number are
    taken for marks if they are far from all others: nines and the like (`_is_marklike`), a frequent
    round number, and a repeated zero.
    """
    where: dict[float, list[str]] = {}
    for number, name in zip(numbers, named, strict=True):
        if number is not None:
            where.setdefault(number, []).append(name)
    odd = [*_marks(where)] if marks and numerals.no_lead is None else []
    return [_odd_words(number, where[number], column) for number in (*(one for one in where if one < 0), *odd)]


def _odd_words(number: float, named: Sequence[str], column: str) -> str:
    """Return the fault of a number of the gap in the rows ``named``, and how to declare it."""
    rows = f"{named[0]}{f' and {len(named) - 1} more rows' if len(named) > 1 else ''}"
    what, written = f"{rows}: the gap '{column}' is {number:g}", repr(number).removesuffix(".0")
    if number < 0:
        return f"{what}, and no distance is below 0; if it means nothing ahead, say --no-lead {written}"
    return (
        f"{what}, far from all other numbers: if it means nothing ahead, say --no-lead {written}; if it is a "
        "distance, say --no-lead '' (no number is a mark)"
    )


def _marks(where: Mapping[float, Sequence[str]]) -> Iterator[float]:
    """Yield the numbers that look like marks."""
    ordered = sorted(number for number in where if number >= 0)
    for place, number in enumerate(ordered):
        lower = ordered[place - 1] if place else None
        far = lower is None or number > _FAR * lower
        often = place >= _OTHERS and len(where[number]) >= _OFTEN
        if (_is_marklike(number) and (far or number >= _LARGE)) or (far and often and _is_round(number)):
            yield number
    if ordered and ordered[0] == 0.0 and len(where[0.0]) > 1 and len(ordered) > 2:
        middle = ordered[len(ordered) // 2]
        if ordered[1] > middle / 10:
            yield 0.0


def _is_round(number: float) -> bool:
    """Return whether a number is round, as 100, 250, 1000: at most two digits, then zeros."""
    return number > _LEAST_MARK and len(f"{number:.15g}".rstrip("0")) <= _FEW_DIGITS


def _is_marklike(number: float) -> bool:
    """Return whether a number is nines (999, 9999.9), a power of ten from 1e6 on, or a limit."""
    digits = f"{number:g}".replace(".", "")
    nines = number > _LEAST_MARK and set(digits) == {"9"}
    power = number >= _LARGE and set(digits.split("e")[0]) <= {"1", "0"}
    return nines or power or (number in _ENDS and number > _LEAST_MARK) or number >= 1e9
