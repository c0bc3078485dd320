"""Columns get their places: which one names the picture, the gap, the episode; the others are kept as ground truth."""

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import msgspec

from eyechart.conditions import CONDITIONS
from eyechart.errors import BankError, SourceError, SpecError
from eyechart.frames import FILE_SUFFIX, Camera, MirrorAxis, is_reserved, require_exchanged
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
