"""Cells of a table, read as a number, a step, a name or ground truth."""

import math
import re
import sys
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence

from eyechart.errors import SourceError
from eyechart.frames import Scalar
from eyechart.importing.faults import Faults
from eyechart.records import LARGEST

Cell = str | int | float | bool | None
Row = Mapping[str, Cell]
Progress = Callable[[int, int], None]
"""Called with (done, total) during long work."""

MOST_CELL = 100_000
"""The most characters of one cell."""

_NUMBER = re.compile(r"[+-]?(0|[1-9]\d*)(\.\d*)?([eE][+-]?\d+)?|[+-]?\.\d+([eE][+-]?\d+)?")
_ZEROS = re.compile(r"(?<=[+-])0+(?=\d)|^0+(?=\d)")
"""Leading zeros of a padded counter. A column that was not declared as numbers keeps them as
text."""
_WHOLE = re.compile(r"[+-]?(0|[1-9]\d*)")
_EXACT = 2**53
_COMMA = re.compile(r"[+-]?\d+,\d+")
"""A number with a decimal comma, or with a mark of thousands."""
_SCIENTIFIC = re.compile(r"[+-]?\d(?:[.,](?P<digits>\d+))?[eE]\+(?P<places>\d{1,3})")
_NOTHING = re.compile(r"nan|<na>|#?n/a|nat|null")
"""Lower-case words that programs write into empty cells."""


def is_nothing(cell: Cell, *words: str) -> bool:
    """Return whether a cell is empty: blank, NaN, or a word that programs write for that.

    ``words`` are further such words, in lower case.
    """
    if isinstance(cell, float):
        return math.isnan(cell)
    text = "" if cell is None else str(cell).strip().lower()
    return not text or text in words or _NOTHING.fullmatch(text) is not None


def alike(label: str) -> str:
    """Return the common form of names that look the same.

    It has no invisible characters, no extra spaces, and no trailing decimal point.
    """
    found = unicodedata.normalize("NFKC", label)
    seen = (one for one in found if one.isspace() or unicodedata.category(one) not in {"Cf", "Cc"})
    text = " ".join("".join(seen).split())
    number = re.fullmatch(r"[+]?(\d+)(?:\.0*)?", text)
    return number[1] if number else text


def loosely_alike(label: str) -> str:
    """Return the common form of names that differ only in case and leading zeros."""
    text = alike(label).casefold()
    return text.lstrip("0") or "0" if text.isdigit() else text


def plain_name(column: str) -> str:
    """Return a column's name for comparisons: in lower case, with '_' for spaces and hyphens."""
    return re.sub(r"[\s-]+", "_", column.strip().lower())


def read_number(cell: Cell, what: str, *, marks: bool = True) -> float | None:
    """Return a cell as a finite number, None if empty.

    ``what`` names row and column in the SourceError. Leading zeros are ignored. With ``marks`` the
    message says how to declare a mark for "nothing ahead".
    """
    advice = _marked(cell) if marks else ""
    if cell is None:
        return None
    number = _number(cell)
    if number is None:
        if isinstance(cell, str) and _COMMA.fullmatch(cell.strip()):
            raise SourceError(f"{what} is {quoted(cell)}, not a number; a decimal comma is read with --numbers 1234,5")
        raise SourceError(f"{what} is {quoted(cell)}, not a number; leave the cell empty if there is none{advice}")
    return _held(number, what, advice)


def _marked(cell: Cell) -> str:
    """Return the advice that declares a cell as "nothing ahead", if it is short enough."""
    return f", or say --no-lead {cell}" if len(str(cell)) <= 30 and " " not in str(cell) else ""


def read_part(cell: Cell, what: str) -> float:
    """Return a cell as one number of a state; raises SourceError, beginning with ``what``."""
    number = _number(cell)
    if number is None:
        raise SourceError(f"{what} is {quoted(cell)}, not a number; every row needs all numbers of a state")
    return _held(number, what)


def _held(number: float, what: str, advice: str = "") -> float:
    """Return a number that a bank can hold; raises SourceError for a greater one."""
    if not abs(number) <= LARGEST:
        raise SourceError(f"{what} is {number:g}, not a number up to {LARGEST:g}{advice}")
    return number


def _number(cell: Cell) -> float | None:
    """Return a cell as a finite number, None if it is none."""
    if isinstance(cell, str) and _NUMBER.fullmatch(_ZEROS.sub("", cell.strip(), count=1)):
        cell = float(cell)
    if cell is None or isinstance(cell, bool | str) or not abs(cell) <= sys.float_info.max:
        return None
    return float(cell)


def read_step(cell: Cell, what: str) -> int:
    """Return a cell as a whole number; raises SourceError, beginning with ``what``."""
    number = _number(cell)
    if number is not None and number == int(number) and abs(number) > _EXACT:
        raise SourceError(
            f"{what} is {quoted(cell)}, too large for a step, which counts the frames of an episode. A time in "
            "nanoseconds is not a step: leave the column out with --map step=, and the rows count in their order"
        )
    if number is None or number != int(number):
        raise SourceError(
            f"{what} is {quoted(cell)}, not a whole number. A step counts the frames of an episode, and every row "
            "needs one; else leave the column out with --map step="
        )
    return int(number)


def read_label(cell: Cell, what: str) -> str:
    """Return a cell as a name (3.0 is '3'); raises SourceError if empty, or a rounded number."""
    if _is_rounded(cell):
        raise SourceError(
            f"{what} is {quoted(cell)}, a long number without its last digits, so that different names may be one "
            "here: save the column as text, with all digits"
        )
    text = (
        str(int(cell)) if isinstance(cell, float) and math.isfinite(cell) and cell == int(cell) else str(cell).strip()
    )
    if cell is None or not text or (isinstance(cell, float) and math.isnan(cell)):
        raise SourceError(_lacking(what, "empty"))
    return text


def _is_rounded(cell: Cell) -> bool:
    """Return whether a cell is a long number without its last digits, as a spreadsheet shows and saves it.

    "1.000000000000000000e+00" has all of them, as programs write a small number.
    """
    if isinstance(cell, float):
        return _EXACT <= abs(cell) < math.inf
    found = _SCIENTIFIC.fullmatch(cell.strip()) if isinstance(cell, str) else None
    return found is not None and int(found["places"]) > min(len(found["digits"] or ""), sys.float_info.dig)


def read_key(cell: Cell, what: str) -> str:
    """Return a cell as a file's or an episode's name; words for an empty cell are refused."""
    text = read_label(cell, what)
    if is_nothing(text, "none"):
        raise SourceError(_lacking(what, repr(text)))
    return text


def _lacking(what: str, said: str) -> str:
    return f"{what} is {said}; every row needs one; else leave the column out with an empty --map"


def read_said(cell: Cell, what: str) -> Scalar:
    """Return a cell unchanged as a prompt states it; raises SourceError if it is empty."""
    blank = isinstance(cell, str) and cell != "" and cell.strip().lower() in {"", "nan"}
    if cell is None or blank or (isinstance(cell, float) and not math.isfinite(cell)):
        raise SourceError(f"{what} is {quoted(cell)}; a prompt column needs a value in every row")
    return cell


def read_truth(cells: Sequence[Cell], named: Iterable[str], *, typed: bool, faults: Faults) -> list[Scalar]:
    """Return a column of ground truth, all numbers or all words.

    In a column that is not ``typed``, the text of its cells decides. ``named`` names each cell for
    messages; a cell that no bank can hold is a fault.
    """
    have = [cell for cell in cells if cell is not None]
    if not typed and (read := _numbers(have)) is not None:
        numbers = iter(read)
        return [None if cell is None else next(numbers) for cell in cells]
    kinds = {float if type(cell) is int else type(cell) for cell in have}
    if len(kinds) > 1:
        return [None if cell is None else str(cell) for cell in cells]
    result: list[Scalar] = []
    for cell, what in zip(cells, named, strict=True):
        result.append(None)
        with faults.noted():
            result[-1] = _finite(cell, what)
    return result


def _numbers(cells: Sequence[Cell]) -> list[float] | None:
    """Return texts as exact numbers, integers if all are; None if any is not a number."""
    texts = [str(cell).strip() for cell in cells]
    if not all(map(_NUMBER.fullmatch, texts)) or not all(abs(float(text)) < _EXACT for text in texts):
        return None
    return [float(text) for text in texts] if not all(map(_WHOLE.fullmatch, texts)) else [int(text) for text in texts]


def _finite(cell: Cell, what: str) -> Scalar:
    if isinstance(cell, float) and not abs(cell) <= LARGEST:
        if math.isnan(cell):
            return None
        raise SourceError(f"{what} is {cell:g}, which no bank can hold; leave the cell empty")
    if isinstance(cell, int) and abs(cell) > _EXACT:
        return str(cell)
    return cell


def quoted(cell: Cell) -> str:
    """Return a cell for messages."""
    text = "empty" if cell is None else repr(cell)
    return text if len(text) <= 60 else f"{text[:60]}…"
