"""Columns get their places: which one names the picture, the gap, the episode; the others are kept as ground truth."""

import difflib
import math
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import msgspec

from eyechart.conditions import CONDITIONS
from eyechart.errors import BankError, SourceError, SpecError
from eyechart.frames import FILE_SUFFIX, Camera, MirrorAxis, Scalar, is_reserved, require_exchanged
from eyechart.importing.tables import Cell
from eyechart.spaces.discrete import read_toml

PICTURED = tuple(name for name, one in CONDITIONS.items() if "counterfactual" in one.needs)
"""Places of pictures of the same moment with one thing changed; a cell may be empty."""

ROLES: dict[str, tuple[str, ...]] = {
    "file": ("file", "file_name"),
    "gap": ("gap",),
    "episode": ("episode",),
    "step": ("step",),
    "scenario": ("scenario",),
    **{name: (name, f"{name}{FILE_SUFFIX}") for name in PICTURED},
}
"""The places of a bank, each with the columns that are taken for it where ``--map`` names none."""

_NUMBER = re.compile(r"[+-]?(0|[1-9]\d*)(\.\d*)?([eE][+-]?\d+)?|[+-]?\.\d+([eE][+-]?\d+)?")
_ZEROS = re.compile(r"(?<=[+-])0+(?=\d)|^0+(?=\d)")
"""Zeros at the head of a number, as counters are padded; a column that nobody named as a number keeps them as words."""
_WHOLE = re.compile(r"[+-]?(0|[1-9]\d*)")
_EXACT = 2**53


class Column(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A camera of a rig, and the column of its pictures."""

    name: str
    column: str
    mirror_axis: MirrorAxis = "none"
    mirrors: str = ""


class Rig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The cameras of a table, and the columns of each state's numbers."""

    camera: Annotated[tuple[Column, ...], msgspec.Meta(min_length=1)]
    state: dict[str, tuple[str, ...]] = {}

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """Return the cameras as frames have them."""
        return tuple(Camera(one.name, one.mirror_axis, one.mirrors) for one in self.camera)

    def places(self) -> dict[str, str]:
        """Return the columns that it takes by what they are; the first camera's is the file."""
        first, *others = self.camera
        taken = {"file": first.column, **{f"camera {one.name}": one.column for one in others}}
        numbers = [(name, place, one) for name, many in self.state.items() for place, one in enumerate(many)]
        return taken | {f"state {name} {place}": one for name, place, one in numbers}


def read_rig(path: Path) -> Rig:
    """Read a rig from a TOML file: a ``[[camera]]`` each, with name, column, mirror_axis and mirrors, and ``[state]``.

    Raises SpecError naming the file and what is wrong in it.
    """
    try:
        rig = msgspec.convert(read_toml(path), Rig)
        require_exchanged(rig.cameras)
    except (msgspec.ValidationError, BankError) as error:
        raise SpecError(f"{path} is no rig of cameras: {error}") from error
    return rig


def places(asked: Mapping[str, str], columns: Sequence[str], table: str, rig: Rig | None = None) -> dict[str, str]:
    """Return the column of each place that has one, and those that a rig takes; an empty name leaves a place without.

    Pictures with one thing changed are of a bank of one camera. Raises SourceError for an unknown place, and for a
    column that the table has not, with the nearest that it has.
    """
    roles = {place: names for place, names in ROLES.items() if rig is None or place not in PICTURED}
    for place, column in asked.items():
        if place not in roles:
            raise SourceError(f"--map {place}={column}: there is no place '{place}'; places are {', '.join(roles)}")
        if column and column not in columns:
            raise SourceError(f"--map {place}={column}: {no_column(column, columns, table)}")
    found = {} if rig is None else rig.places()
    if lacking := [(place, column) for place, column in found.items() if column not in columns]:
        place, column = lacking[0]
        raise SourceError(f"--rig: the {place} is to be in column '{column}'; {no_column(column, columns, table)}")
    for place, names in roles.items():
        column = asked.get(place, next((name for name in names if name in columns), ""))
        if column and place not in found:
            found[place] = column
    if "file" not in found:
        raise SourceError(
            f"{table} has no column 'file'; name the pictures' column with --map file=COLUMN; {_has(columns)}"
        )
    taken = list(found.values())
    for place, column in found.items():
        if taken.count(column) > 1:
            raise SourceError(f"column '{column}' cannot be {place} and something else too")
    return found


def no_column(column: str, columns: Sequence[str], table: str) -> str:
    """Say that a table has no such column, which one may be meant, and which there are."""
    near = difflib.get_close_matches(column, columns, n=1, cutoff=0.4)
    return f"{table} has no column '{column}'{f'; did you mean {near[0]!r}?' if near else ';'} {_has(columns)}"


def _has(columns: Sequence[str]) -> str:
    shown = ", ".join(name for name in columns[:30] if name)
    return f"it has {shown}{', …' if len(columns) > 30 else ''}"


def others(taken: Mapping[str, str], said: Sequence[str], columns: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the columns that are kept as ground truth, and those left out because a bank needs their names."""
    free = [name for name in columns if name and name not in {*taken.values(), *said}]
    return [name for name in free if not is_reserved(name)], [name for name in free if is_reserved(name)]


def read_number(cell: Cell, what: str) -> float | None:
    """Return a cell as a finite number, None where it is empty; ``what`` names row and column in the SourceError.

    Zeros at its head are no part of a number.
    """
    if cell is None:
        return None
    number = _number(cell)
    if number is None:
        raise SourceError(f"{what} is {_quoted(cell)}, not a number; leave the cell empty where there is none")
    return number


def read_part(cell: Cell, what: str) -> float:
    """Return a cell as one number of a state; raises SourceError, beginning with ``what``, where it is none."""
    number = _number(cell)
    if number is None:
        raise SourceError(f"{what} is {_quoted(cell)}, not a number; every row needs all numbers of a state")
    return number


def _number(cell: Cell) -> float | None:
    """Return a cell as a finite number, None where it is none."""
    if isinstance(cell, str) and _NUMBER.fullmatch(_ZEROS.sub("", cell.strip(), count=1)):
        cell = float(cell)
    if cell is None or isinstance(cell, bool | str) or not abs(cell) <= sys.float_info.max:
        return None
    return float(cell)


def read_step(cell: Cell, what: str) -> int:
    """Return a cell as a whole number; raises SourceError, beginning with ``what``, where it is none."""
    number = _number(cell)
    if number is None or number != int(number) or abs(number) > _EXACT:
        raise SourceError(
            f"{what} is {_quoted(cell)}, not a whole number; a step counts the frames of an episode: every row needs "
            "one, or none: leave the column out with --map step="
        )
    return int(number)


def read_label(cell: Cell, what: str) -> str:
    """Return a cell as a name; 3.0 is '3'. Raises SourceError, beginning with ``what``, where it is empty."""
    text = (
        str(int(cell)) if isinstance(cell, float) and math.isfinite(cell) and cell == int(cell) else str(cell).strip()
    )
    if cell is None or not text:
        raise SourceError(f"{what} is empty; every row needs one, or none: leave the column out with an empty --map")
    return text


def read_said(cell: Cell, what: str) -> Scalar:
    """Return a cell as it will be said in a prompt: text as it stands. Raises SourceError where there is nothing."""
    if cell is None or (isinstance(cell, float) and not math.isfinite(cell)):
        raise SourceError(f"{what} is {_quoted(cell)}; a prompt column needs something to say in every row")
    return cell


def read_truth(cells: Sequence[Cell], name: str, *, typed: bool) -> list[Scalar]:
    """Return a column of ground truth, all numbers or all words; where it is not ``typed``, its text decides."""
    have = [cell for cell in cells if cell is not None]
    if not typed and (read := _numbers(have)) is not None:
        numbers = iter(read)
        return [None if cell is None else next(numbers) for cell in cells]
    kinds = {float if type(cell) is int else type(cell) for cell in have}
    if len(kinds) > 1:
        return [None if cell is None else str(cell) for cell in cells]
    return [_finite(cell, name, row) for row, cell in enumerate(cells, 1)]


def _numbers(cells: Sequence[Cell]) -> list[float] | None:
    """Return cells of text as exact numbers, whole ones where all are; None where they are no such."""
    texts = [str(cell).strip() for cell in cells]
    if not all(map(_NUMBER.fullmatch, texts)) or not all(abs(float(text)) < _EXACT for text in texts):
        return None
    return [float(text) for text in texts] if not all(map(_WHOLE.fullmatch, texts)) else [int(text) for text in texts]


def _finite(cell: Cell, name: str, row: int) -> Scalar:
    if isinstance(cell, float) and not math.isfinite(cell):
        if math.isnan(cell):
            return None
        raise SourceError(f"row {row}: '{name}' is {cell}, which no bank can hold; leave the cell empty")
    if isinstance(cell, int) and abs(cell) > _EXACT:
        return str(cell)
    return cell


def _quoted(cell: Cell) -> str:
    text = "empty" if cell is None else repr(cell)
    return text if len(text) <= 60 else f"{text[:60]}…"
