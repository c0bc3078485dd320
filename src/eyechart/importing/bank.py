"""Rows and pictures become a bank, or a list of all faults; no partial bank stays.

A user's picture is copied unchanged, after a check that every program shows the same of it.
"""

from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, count, pairwise, repeat
from pathlib import Path
from typing import TypeVar

import numpy as np

from eyechart.conditions import NUDGES, is_nudged
from eyechart.errors import SourceError, SpecError, counted, finite_number, whole_number
from eyechart.frames import (
    DISTANCES,
    IMPORTED,
    MOST_HISTORY,
    PATCHED,
    BankManifest,
    BankWriter,
    Frame,
    FrameBank,
    Gap,
    MirrorAxis,
    Provenance,
    Scalar,
    alone,
    decode,
    is_reserved,
    open_bank,
    read_axis,
    size_of,
)
from eyechart.importing import columns as reading
from eyechart.importing.cells import (
    MOST_CELL,
    Cell,
    Progress,
    Row,
    alike,
    is_nothing,
    read_key,
    read_label,
    read_number,
    read_part,
    read_said,
    read_step,
    read_truth,
)
from eyechart.importing.edit_record import RecordedEdit, read_edit
from eyechart.importing.faults import Faults
from eyechart.importing.layout import given_name
from eyechart.importing.logged_rotations import LoggedRows, Of, tell_turned
from eyechart.importing.motion_log import MotionLog
from eyechart.importing.numerals import Numerals, distance, odd_gaps, unclear, unit_named, unit_of
from eyechart.importing.parquet import MOST_ROWS
from eyechart.importing.photographs import Convert, Photographs
from eyechart.importing.repeats import REPEATS, repeats
from eyechart.importing.tables import SourceTable, open_table
from eyechart.importing.windows import NumberedRow, RowsBefore, Windows
from eyechart.records import plain
from eyechart.spaces.discrete import DRIVING, Discrete

T = TypeVar("T")

MOST_FRAMES = 100_000
MOST_TEXT = 400_000_000
"""Characters of all kept cells together, with an allowance of 50 a cell."""
SAID = "said"
"""The setting of an imported bank with one line for each part of the source that is not in it."""
KIND = "kind"
"""The setting of an imported bank with the evidence for the kind of its motions."""
GUESSED = "guessed"
"""The setting of an imported bank with the columns, by place, that were taken by their usual names
alone."""
ALL = "all"
"""The name of the only scenario and of the only episode if the source records none."""

FramePictures = tuple[Frame, Mapping[str, bytes], Mapping[str, Mapping[str, bytes]]]
"""A frame with its encoded pictures by camera, and those of its counterfactuals."""


_MOVED = frozenset({*DISTANCES, *(f"{kind}_m" for kind in reading.PICTURED)})
"""The columns with distances in pictures that moved one thing, in the gap's unit."""
_NUMBERS = ("gap", "state ", "motion ")
"""The prefixes of the places whose cells are numbers."""
UNDESCRIBED = "pictures of a camera"
"""The default description of the pictures."""


@dataclass(frozen=True)
class Choices:
    """The options of an import.

    ``columns`` maps a place to a column, or to an empty name for none. Places are file, gap,
    episode, step, scenario, mirror, and the counterfactual pictures such as lead_near and lane_own.
    ``rig`` declares several cameras and the state. Without it, ``mirror`` is the only camera's
    axis, unless a column holds it for each frame. ``threshold`` and ``unit`` belong to the gap; a
    column such as ``gap_m`` implies its unit. ``independent`` declares frames without episodes as
    independent draws. ``prompt_columns`` are columns that a prompt may state, and ``strata``
    further groups for a claim next to the scenario. Every ``every``-th frame of an episode is
    taken. A frame has the ``history`` rows before it, each a step after the last; rows without them
    become no frames. ``convert`` makes pictures plain; without it, pictures that are not plain are refused.
    With ``keep_repeats``, a recording that occurs twice is imported twice. ``numerals`` declares
    how numbers are written and which mean "nothing ahead". ``strip`` is the prefix of another
    machine's paths. ``made`` declares how control pictures were made, and ``edit`` is the record of
    their edit, which the import finds beside the table. ``wrong`` lists impossible values among
    these options, as faults like those of the table.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    mirror: MirrorAxis = "none"
    space: Discrete = DRIVING
    threshold: float | None = None
    unit: str | None = None
    picture: str = UNDESCRIBED
    prompt_columns: tuple[str, ...] = ()
    strata: tuple[str, ...] = ()
    independent: bool = False
    every: int = 1
    history: int = 0
    rig: reading.SensorLayout | None = None
    convert: Convert | None = None
    keep_repeats: bool = False
    numerals: Numerals = field(default_factory=Numerals)
    strip: str = ""
    made: Provenance = ""
    edit: RecordedEdit | None = None
    wrong: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        whole_number("every", self.every, 1)
        whole_number("history", self.history, 0)
        if self.history > MOST_HISTORY:
            raise SpecError(f"--history takes 0 to {MOST_HISTORY} instants before a frame, not {self.history}")
        if self.threshold is not None:
            finite_number("threshold", self.threshold)


@dataclass(frozen=True)
class ImportSource:
    """The source of pictures: a folder, a generator of frames with pictures, and settings.

    While frames are made, ``converted`` counts conversions and ``said`` takes lines on omissions.
    """

    folder: Path
    pictures: Callable[[Sequence[Frame]], Iterator[FramePictures]]
    settings: Mapping[str, object] = field(default_factory=dict)
    converted: Mapping[str, int] = field(default_factory=dict)
    said: Sequence[str] = ()


@dataclass(frozen=True)
class BankRows:
    """The rows that become frames, with their numbers, the columns of places, and faults.

    With a history there are also the rows of the instants before frames. ``windows`` then has the
    numbers of those rows, the oldest first, by the number of each frame's row.
    """

    rows: list[Row]
    numbers: list[int]
    places: Mapping[str, str]
    table: SourceTable
    faults: Faults
    log: MotionLog | None = None
    windows: Mapping[int, tuple[int, ...]] | None = None
    said: Sequence[str] = ()

    def is_frame(self, place: int) -> bool:
        """Return whether the row at a place becomes a frame, and is not just before one."""
        return self.windows is None or self.numbers[place] in self.windows

    @property
    def framed(self) -> list[Row]:
        """Return the rows that become frames."""
        return [row for place, row in enumerate(self.rows) if self.is_frame(place)]

    def with_windows(self, past: RowsBefore) -> "BankRows":
        """Return the rows in the table's order, with those before each frame."""
        order = sorted(range(len(self.numbers)), key=self.numbers.__getitem__)
        return replace(
            self,
            rows=[self.rows[place] for place in order],
            numbers=[self.numbers[place] for place in order],
            windows=past.windows,
            said=tuple(past.said()),
        )

    def named(self) -> Iterator[tuple[Row, str]]:
        """Yield the rows with their names for messages."""
        return zip(self.rows, (f"{self.table.name}, row {number}" for number in self.numbers), strict=True)

    def read(self, column: str, reader: Callable[[Cell, str], T], what: str) -> list[T]:
        """Read the cells of a column of ``what``; an unreadable cell is a fault, and left out."""
        result = []
        for row, where in self.named():
            with self.faults.noted():
                result.append(reader(row.get(column), f"{where}: {what}"))
        return result


def import_table(
    folder: Path,
    table: Path,
    out: Path,
    choices: Choices,
    *,
    reads: Progress | None = None,
    progress: Progress | None = None,
) -> FrameBank:
    """Make a bank at ``out`` from ``folder``'s pictures that a table lists.

    The table is CSV, JSON lines or Parquet. ``reads`` counts the rows read, ``progress`` the frames
    written. Raises SourceError with all faults, by row, and leaves nothing at ``out``.
    """
    if not folder.is_dir():
        raise SourceError(f"{folder} is not a folder; give the folder of the pictures")
    edit = read_edit(table.parent)
    if edit is not None:
        choices = replace(choices, edit=edit, made=edit.agreed(choices.made, table))
    photographs = Photographs(folder, table.parent, choices.convert, strip=choices.strip, edit=edit, made=choices.made)
    return import_rows(_opened(table, reads, choices), photographs, out, choices, progress)


def import_rows(
    table: SourceTable, photographs: Photographs, out: Path, choices: Choices, progress: Progress | None = None
) -> FrameBank:
    """Make a bank at ``out`` from an open table's rows and picture files; see `import_table`."""
    kept = keep(table, choices)
    cells = cells_of(kept, choices, photographs.locate)
    if kept.faults:
        for where, file in cells.files():
            with kept.faults.noted():
                photographs.read(file, where)
        kept.faults.require_none(table.name)

    said: list[str] = []

    def pictures(frames: Sequence[Frame]) -> Iterator[FramePictures]:
        same = 0
        for frame, (_, where) in zip(frames, kept.named(), strict=True):
            with kept.faults.noted():
                shown = _shown(frame, where, photographs, choices)
                same += len(frame.counterfactuals) - len(shown[0].counterfactuals)
                yield shown
        kept.faults.require_none(table.name)
        if same:
            said.append(f"{counted(same, 'picture')} of {_RECOLOURED} repeat the file, and count as missing")

    frames = frames_of(kept, choices, cells)
    source = ImportSource(
        photographs.folder, pictures, _kind_record(choices.rig, kept), converted=photographs.done, said=said
    )
    return write(out, source, frames, kept=kept, choices=choices, progress=progress)


def _kind_record(rig: reading.SensorLayout | None, kept: BankRows) -> dict[str, object]:
    """Return the record of a rig's kind of motion, with a warning if the data contradict it."""
    if rig is None or rig.motion is None or kept.log is None:
        return {}
    columns = [column for many in rig.state.values() for column in many]
    named = [columns.index(one.state) if one.state else None for one in rig.motion.number]
    walks, turns = [walk for walk in kept.log.walks() if len(walk.done)], rig.motion.rotations
    if walks and turns:
        names = [one.column for one in rig.motion.number]
        every: dict[Of, Sequence[str]] = {"motion": names, "state": columns}
        places: dict[Of, list[tuple[str, int]]] = {
            of: [(of, place) for place in range(len(many))] for of, many in every.items()
        }
        if faults := LoggedRows.of(walks, places, every).faults(turns):
            raise SourceError("; ".join(f"--rig: a rotation of the {fault}" for fault in faults))
    evidence = tell_turned(walks, named, turns, len(columns))
    against = evidence.contradicts(rig.motion.kind)
    said = [evidence.warning(rig.motion.kind, "[motion] of --rig")] if against else []
    return {KIND: {"by": "the rig says", "ratio": evidence.ratio, "said": said}}


def _opened(table: Path, reads: Progress | None, choices: Choices) -> SourceTable:
    """Open a table; if that fails, faults of the options are reported first."""
    try:
        return open_table(table, reads)
    except SourceError:
        Faults(choices.wrong).require_none(table.name)
        raise


def _shown(frame: Frame, where: str, photographs: Photographs, choices: Choices) -> FramePictures:
    """Return a frame with its pictures and file names; raises SourceError if one is not plain."""

    def read(files: Mapping[str, str], under: Callable[[str], str]) -> tuple[dict[str, bytes], dict[str, str]]:
        found = {name: photographs.read(file.removeprefix(under(name)), where) for name, file in files.items()}
        files = {name: under(name) + to for name, (_, to) in found.items()}
        return {name: one for name, (one, _) in found.items()}, files

    images, files = read(frame.pictures, lambda name: _under(choices, name))
    drawn = {kind: read(one, partial(_beside, choices, kind)) for kind, one in frame.counterfactuals.items()}
    changed = {kind: named for kind, (_, named) in drawn.items()}
    if images == drawn.get(_RECOLOURED, ({}, {}))[0]:  # it is not a separate picture
        changed.pop(_RECOLOURED), drawn.pop(_RECOLOURED)
    _require_patched(images, drawn.get(PATCHED, ({}, {}))[0], where, choices.made)
    shown = {kind: one for kind, (one, _) in drawn.items()}
    _require_nudged(shown, where)
    _require_moved(shown, where)
    _require_of_one_size(images, shown, where)
    return replace(frame, pictures=files, counterfactuals=changed), images, shown


def _require_patched(images: Mapping[str, bytes], patched: Mapping[str, bytes], where: str, made: Provenance) -> None:
    """Raise SourceError if a patched picture is the true one, or if nothing is said to be edited."""
    if patched and made in {"rendered", "staged"}:
        raise SourceError(f"{where}: a picture of the kind '{PATCHED}' is edited, but --made says {made}")
    for camera, picture in patched.items():
        if np.array_equal(decode(picture, PATCHED), decode(images[camera], "file")):
            raise SourceError(
                f"{where}: {PATCHED} and file are the same picture, but one must be edited as the other control "
                "pictures are; leave the cell of a missing picture empty"
            )


def _require_nudged(drawn: Mapping[str, Mapping[str, bytes]], where: str) -> None:
    """Raise SourceError unless a nudged picture differs by one level in one value."""
    for name, of in NUDGES.items():
        for camera, picture in drawn.get(name, {}).items():
            if of not in drawn or not is_nudged(picture, drawn[of][camera]):
                raise SourceError(
                    f"{where}: the {name} is not its {of} with one value of one pixel changed by one level; leave the "
                    f"column out (--map {name}=), and it is made of {of}"
                )


_RECOLOURED = "recoloured"
_UNLIKE = (
    ("lead_near", "lead_far"),
    ("lead_near", "lead_absent"),
    ("exchange_own", "exchange_beside"),
    ("exchange_own", "exchange_apart"),
    ("exchange_beside", "exchange_apart"),
    ("lane_own", "lane_beside"),
)
"""Pairs of pictures of one moment that must differ because something was moved."""


def _require_moved(shown: Mapping[str, Mapping[str, bytes]], where: str) -> None:
    """Raise SourceError if two pictures are equal although something must be moved between them."""
    for one, other in _UNLIKE:
        if one in shown and shown[one] == shown.get(other):
            raise SourceError(
                f"{where}: {one} and {other} are the same picture, but something must be moved between them. Leave "
                f"the cell of a missing picture empty, or leave the column out (--map {other}=)"
            )


def _require_of_one_size(images: Mapping[str, bytes], shown: Mapping[str, Mapping[str, bytes]], where: str) -> None:
    """Raise SourceError if pictures of one moment differ in size, by which a model could tell them apart."""
    for kind, pictures in shown.items():
        for camera, picture in pictures.items():
            (wide, high), (width, height) = size_of(picture, kind), size_of(images[camera], "file")
            if (wide, high) != (width, height):
                raise SourceError(
                    f"{where}: {kind} has {wide}×{high} pixels, and the true picture {width}×{height}: pictures of one "
                    "moment need one size, else a model could tell them apart by it"
                )


def keep(table: SourceTable, choices: Choices) -> BankRows:
    """Read the rows that become frames; raises SourceError if there are none, or too many.

    Faults of the options are among the faults of the result.
    """
    faults = table.faults
    faults.take(choices.wrong)
    columns = {**choices.columns}
    if choices.mirror != "none" and choices.rig is None:
        if columns.get("mirror"):
            faults.add(f"--mirror and --map mirror={columns['mirror']} both say the mirror axis: leave out one")
        columns.setdefault("mirror", "")
    kept = (*choices.prompt_columns, *(() if choices.rig is None else choices.rig.places().values()))
    own = ["gap"] * (choices.threshold is None) + ["episode"] * choices.independent
    places = reading.places(columns, table, faults, rig=choices.rig, kept=kept, own=own)
    _check_choices(choices, places, table, faults)
    past = RowsBefore(choices.history, places, table.name, faults) if choices.history else None
    log = _log(choices, places, table, faults)
    if table.count is not None:
        _check_count(table, table.count, -(-table.count // choices.every))
    rows: list[Row] = []
    numbers: list[int] = []
    text = 0
    for number, row in _chosen(table, choices, places, log, past):
        where = f"{table.name}, row {number}"
        rows.append(_with_gap(row, where, choices, places, faults))
        numbers.append(number)
        text += _letters(row, where, faults)
        _check_count(table, number, len(rows))
        if text > MOST_TEXT:
            raise SourceError(f"{table.name} holds more than {MOST_TEXT} characters; take every Nth row with --every N")
    if past is not None:
        past.require_some()
    if not rows and not faults:
        faults.add(f"{table.name} has no rows; each row is a frame")
    result = BankRows(rows, numbers, places, table, faults, log)
    return result if past is None else result.with_windows(past)


def _chosen(
    table: SourceTable, choices: Choices, places: Mapping[str, str], log: MotionLog | None, past: RowsBefore | None
) -> Iterator[NumberedRow]:
    """Yield every ``every``-th row of an episode, after the rows before it; all go into the log.

    With a history only rows that have their window count.
    """
    words, seen = _wordy(choices, places), dict[object, int]()
    for number, found in enumerate(_whole(table), 1):
        if not found:
            continue
        row = found
        with table.faults.noted():
            row = choices.numerals.row(found, words, f"{table.name}, row {number}")
        episode = row.get(places.get("episode", ""))
        window = [] if past is None else past.window(row, number)
        turn = seen[episode] = seen.get(episode, -1) + (window is not None)
        chosen = window is not None and turn % choices.every == 0
        if log is not None:
            log.add(row, number, places, kept=chosen)
        if chosen:
            before = [] if past is None or window is None else past.take(window, number)
            yield from (*before, (number, row))


def _wordy(choices: Choices, places: Mapping[str, str]) -> set[str]:
    """Return the columns whose cells are words: files, names and prompt texts."""
    numbers = (*_NUMBERS, "step")
    return {*choices.prompt_columns, *(column for place, column in places.items() if not place.startswith(numbers))}


def _with_gap(row: Row, where: str, choices: Choices, places: Mapping[str, str], faults: Faults) -> Row:
    """Return a row with distances as plain numbers; the gap is None at a "nothing ahead" mark.

    Another unit is a fault of the gap; distances of moved things are converted to the gap's unit.
    """
    column, cells = places.get("gap"), dict(row)
    if column is None:
        return row
    unit = _unit(choices, places)
    with faults.noted():
        cells[column] = choices.numerals.gap(row.get(column), unit, f"{where}: the gap '{column}'")
    for name in _MOVED & row.keys() - {*places.values()}:
        with faults.noted():
            cells[name] = distance(row[name], unit, f"{where}: '{name}'")
    return cells


def _whole(table: SourceTable) -> Iterator[Row]:
    """Yield a table's rows as far as possible; an early end is one fault among the others."""
    with table.faults.noted():
        yield from table.rows


def _log(choices: Choices, places: Mapping[str, str], table: SourceTable, faults: Faults) -> MotionLog | None:
    """Return the log of a rig's motions; None without motions, or without one of their columns.

    A missing column is a fault already. Without episodes it is unknown which steps follow a row.
    """
    if choices.rig is None or choices.rig.motion is None:
        return None
    if "episode" not in places:
        faults.add(f"--rig: a motion needs the steps that follow; name the episode's column of {table.name}")
    known = all(one.column in table.columns for one in choices.rig.motion.number)
    state = [column for many in choices.rig.state.values() for column in many]
    return MotionLog(choices.rig.motion, state, faults, table.name) if known else None


def _letters(row: Row, where: str, faults: Faults) -> int:
    """Return a row's characters with an allowance for each cell; a too long cell is a fault."""
    for name, cell in row.items():
        if isinstance(cell, str) and len(cell) > MOST_CELL:
            faults.add(f"{where}: '{name}' has more than {MOST_CELL} characters")
    return sum(50 + (len(cell) if isinstance(cell, str) else 0) for cell in row.values())


def _check_count(table: SourceTable, rows: int, frames: int) -> None:
    if frames > MOST_FRAMES:
        raise SourceError(f"{table.name} has more than {MOST_FRAMES} frames; take every Nth of them with --every N")
    if rows > MOST_ROWS:
        raise SourceError(f"{table.name} has more than {MOST_ROWS} rows; cut it into parts")


def _check_choices(choices: Choices, places: Mapping[str, str], table: SourceTable, faults: Faults) -> None:
    column = places.get("gap", "")
    if column and (choices.threshold is None or not _unit(choices, places)):
        faults.add(f"the gap '{column}' needs a limit of near: --threshold and --unit, for example 18 and m")
    named = unit_of(column) or unit_named(column)
    if named and choices.unit and (unit_named(choices.unit) or choices.unit) != named:
        faults.add(
            f"--unit {choices.unit}: the gap's column '{column}' says {named}; leave out --unit, or rename the column "
            "if its name is wrong"
        )
    if "gap" not in places and choices.threshold is not None and not choices.columns.get("gap"):
        has = reading.no_column("gap", table.columns, table.name)
        faults.add(f"--threshold belongs to a gap, and {has}; name one with --map gap=COLUMN")
    if choices.independent and "episode" in places:
        faults.add(
            f"the frames of an episode are not independent: leave out --independent, or the column "
            f"'{places['episode']}' with --map episode="
        )
    _check_strata(choices, places, table, faults)
    for name in choices.prompt_columns:
        if name not in table.columns:
            faults.add(f"--prompt-columns {name}: {reading.no_column(name, table.columns, table.name)}")
        for place, column in places.items():
            if name == column:
                faults.add(f"--prompt-columns {name}: it is the {place} of a frame, which no prompt may say")
        if name == "actions" or is_reserved(name):
            faults.add(f"--prompt-columns {name}: this name is taken; rename the column")


def _check_strata(choices: Choices, places: Mapping[str, str], table: SourceTable, faults: Faults) -> None:
    for name in choices.strata:
        if name not in table.columns:
            faults.add(f"--strata {name}: {reading.no_column(name, table.columns, table.name)}")
        elif name in {*places.values(), *choices.prompt_columns} or is_reserved(name):
            faults.add(f"--strata {name}: this column is something else already; name one that is kept as ground truth")
        elif name == "range":
            faults.add(f"--strata {name}: a verdict calls the parts of the distance so; rename the column")


def _unit(choices: Choices, places: Mapping[str, str]) -> str:
    """Return the unit of the gap, as given or as in its column's name."""
    return choices.unit or unit_of(places["gap"]) or unit_named(places["gap"]) or ""


@dataclass(frozen=True)
class Cells:
    """The cells by column; each column has a cell for every row if it has no faults.

    ``pictures`` maps a camera to its files. ``changed`` maps a kind of counterfactual picture to
    such a mapping, in which an empty name is a missing picture.
    """

    pictures: Mapping[str, list[str]]
    changed: Mapping[str, Mapping[str, list[str]]]
    named: Sequence[str]
    truth: Mapping[str, Sequence[Scalar]]
    state: Mapping[str, Sequence[tuple[float, ...]]]
    said: Mapping[str, Sequence[Scalar]]
    axes: Sequence[MirrorAxis]
    placed: tuple[list[str], list[str], list[int]]

    def files(self) -> Iterator[tuple[str, str]]:
        """Yield every picture's file, and its row's name for messages, without faulty files."""
        for columns in (self.pictures, *self.changed.values()):
            for files in columns.values():
                yield from ((where, file) for where, file in zip(self.named, files, strict=True) if file)


def cells_of(kept: BankRows, choices: Choices, locate: Callable[[str, str], str]) -> Cells:
    """Read the cells of all columns; faults are noted in ``kept``, by row.

    ``locate`` makes a path of a file's name; no picture is opened.
    """
    cameras = alone(choices.mirror) if choices.rig is None else choices.rig.cameras
    first, *others = (camera.name for camera in cameras)
    pictures = {first: _files(kept, "file", locate)}
    pictures |= {name: _files(kept, f"camera {name}", locate) for name in others}
    if choices.rig is None:
        changed = {kind: {first: _files(kept, kind, locate)} for kind in reading.PICTURED if kind in kept.places}
    else:
        names = (first, *others)
        changed = {
            kind: {name: _files(kept, f"{kind} {name}", locate) for name in names} for kind in choices.rig.changed
        }
    _check_taken(kept, changed)
    truth, state = _truths(kept, choices), {} if choices.rig is None else _states(choices.rig, kept)
    for name in choices.strata:
        _check_alike(kept, f"stratum '{name}'", (one for one in truth.get(name, ()) if isinstance(one, str)))
    if clash := sorted(state.keys() & {*truth, *choices.prompt_columns}):
        kept.faults.add(f"--rig: the state '{clash[0]}' has the name of a column that is kept; give it another name")
    axis, free = kept.places.get("mirror"), {*kept.table.columns} - {*kept.places.values()}
    return Cells(
        pictures=pictures,
        changed=changed,
        named=[where for _, where in kept.named()],
        truth=truth,
        state=state,
        said={name: kept.read(name, read_said, f"'{name}'") for name in choices.prompt_columns if name in free},
        axes=[] if axis is None else kept.read(axis, _read_axis, f"the mirror axis '{axis}'"),
        placed=_placed(kept, independent=choices.independent),
    )


def _truths(kept: BankRows, choices: Choices) -> dict[str, Sequence[Scalar]]:
    """Return the columns of ground truth; the gap is last."""
    names, _ = reading.others(kept.places, choices.prompt_columns, kept.table.columns)
    truth: dict[str, Sequence[Scalar]] = {}
    numbers = [column for place, column in kept.places.items() if place.startswith(_NUMBERS)]
    gap, moved = kept.places.get("gap"), _MOVED.intersection(names)
    if not choices.numerals.style and (said := unclear(kept.named(), {*numbers, *moved})) is not None:
        kept.faults.add(said)
    for name in names:
        if gap and name in moved:
            truth[name] = [*kept.read(name, _read_moved, f"'{name}'")]
            continue
        cells, named = [row.get(name) for row in kept.rows], (f"{where}: '{name}'" for _, where in kept.named())
        truth[name] = read_truth(cells, named, typed=kept.table.typed, faults=kept.faults)
    if gap:
        truth[gap] = [*kept.read(gap, read_number, f"the gap '{gap}'")]
        if all(one is None for one in truth[gap]) and kept.rows and not kept.faults:
            kept.faults.add(f"{kept.table.name}: the gap '{gap}' is empty in every row; leave it out with --map gap=")
        _check_distances(kept, choices, truth, gap)
    return truth


def _check_distances(kept: BankRows, choices: Choices, truth: Mapping[str, Sequence[Scalar]], gap: str) -> None:
    """Note impossible distances as faults, of the gap and of counterfactual pictures."""
    named, marks = [where for _, where in kept.named()], not kept.faults
    if len(truth[gap]) == len(named):  # else some of its cells have faults
        numbers = [one if isinstance(one, int | float) else None for one in truth[gap]]
        kept.faults.take(odd_gaps(numbers, named, choices.numerals, gap, marks=marks))
    for name in sorted(_MOVED & truth.keys()):
        for where, one in zip(named, truth[name], strict=False):
            if isinstance(one, int | float) and one < 0:
                kept.faults.add(f"{where}: '{name}' is {one:g}, and no distance is below 0; leave the cell empty")
    _check_ends(kept, truth, named)


def _check_ends(kept: BankRows, truth: Mapping[str, Sequence[Scalar]], named: Sequence[str]) -> None:
    """Note as a fault a near distance that is not less than the far one of its row."""
    ends = [truth.get(name, ()) for name in ("lead_near_m", "lead_far_m")]
    if any(len(one) != len(named) for one in ends):
        return  # one is not there, or some of its cells have faults
    for where, near, far in zip(named, *ends, strict=True):
        if isinstance(near, int | float) and isinstance(far, int | float) and near >= far:
            kept.faults.add(
                f"{where}: 'lead_near_m' is {near:g} and 'lead_far_m' {far:g}, but near is less than far: are the "
                "columns exchanged, and their pictures too?"
            )


def _read_moved(cell: Cell, what: str) -> float | None:
    """Return a moved thing's distance, None for an empty cell; marks do not apply here."""
    return None if is_nothing(cell, "none") else read_number(cell, what, marks=False)


def _read_axis(cell: Cell, what: str) -> MirrorAxis:
    """Return a cell as a mirror axis, none if empty; raises SourceError for another word."""
    try:
        return read_axis(str(cell).strip().lower() if cell is not None else "none")
    except ValueError as error:
        raise SourceError(f"{what} is {str(cell)[:60]!r}, not vertical, horizontal or none") from error


def _check_taken(kept: BankRows, changed: Mapping[str, Mapping[str, list[str]]]) -> None:
    """Note as a fault a counterfactual picture that only some cameras of a rig have."""
    for kind, columns in changed.items():
        for (_, where), files in zip(kept.named(), zip(*columns.values(), strict=True), strict=True):
            if any(files) and not all(files):
                lacking = ", ".join(name for name, file in zip(columns, files, strict=True) if not file)
                kept.faults.add(f"{where}: {kind} has no picture of {lacking}; take it by every camera, or by none")


def frames_of(kept: BankRows, choices: Choices, cells: Cells) -> list[Frame]:
    """Return a frame of every row, without opening pictures; raises SourceError for a fault.

    With a history these are also the instants before frames, in the order of the rows.
    """
    kept.faults.require_none(kept.table.name)
    scenarios, episodes, steps = cells.placed
    cameras = alone(choices.mirror) if choices.rig is None else choices.rig.cameras
    if kept.log is not None:
        kept.log.require_some()
    motions = repeat(()) if kept.log is None else kept.log.motions()
    return [
        Frame(
            id=file,
            scenario=scenarios[place],
            episode=episodes[place],
            step=steps[place],
            cameras=alone(cells.axes[place]) if cells.axes else cameras,
            pictures={name: _under(choices, name) + files[place] for name, files in cells.pictures.items()},
            truth={name: column[place] for name, column in cells.truth.items()},
            counterfactuals={
                kind: {name: _beside(choices, kind, name) + files[place] for name, files in one.items()}
                for kind, one in cells.changed.items()
                if all(files[place] for files in one.values())
            },
            fields={name: column[place] for name, column in cells.said.items()},
            state={name: column[place] for name, column in cells.state.items()},
            motion=next(motions, ()) if kept.is_frame(place) else (),
            strata={name: cells.truth[name][place] for name in choices.strata},
        )
        for place, file in enumerate(next(iter(cells.pictures.values())))
    ]


def _states(rig: reading.SensorLayout, kept: BankRows) -> dict[str, list[tuple[float, ...]]]:
    """Return every state of a rig by its name, for each row."""
    numbers = {
        name: [
            kept.read(part, read_part, f"'{part}' of the state '{name}'")
            for part in parts
            if part in kept.table.columns
        ]
        for name, parts in rig.state.items()
    }
    return {name: list(zip(*columns, strict=not kept.faults)) for name, columns in numbers.items()}


def _under(choices: Choices, camera: str) -> str:
    """Return the bank's folder for a camera's pictures."""
    return "images/" if choices.rig is None else f"images/{camera}/"


def _beside(choices: Choices, kind: str, camera: str) -> str:
    """Return the bank's folder for counterfactual pictures, which may also be other frames' own."""
    return f"counterfactuals/{kind}/" if choices.rig is None else f"counterfactuals/{kind}/{camera}/"


def _files(kept: BankRows, role: str, locate: Callable[[str, str], str]) -> list[str]:
    """Return the file of each row, empty for an allowed empty cell and for a fault."""
    if role not in kept.places:
        return [""] * len(kept.rows)
    first: dict[str, int] = {}
    files = []
    may_lack = role.partition(" ")[0] in reading.PICTURED
    for (row, where), number in zip(kept.named(), kept.numbers, strict=True):
        what, cell = f"{where}: the {role} '{kept.places[role]}'", row.get(kept.places[role])
        file = ""
        if not (may_lack and (cell is None or not str(cell).strip())):
            with kept.faults.noted():
                file = locate(read_key(cell, what), what)
        if file and file in first:
            kept.faults.add(f"{where}: '{file}' is already in row {first[file]}; a picture is one frame")
            file = ""
        first[file] = number
        files.append(file)
    return files


def _placed(kept: BankRows, *, independent: bool) -> tuple[list[str], list[str], list[int]]:
    """Return every frame's scenario, episode and step, with defaults for missing columns.

    Without episodes all frames are one episode, which no test counts as many. Frames that are
    declared independent are an episode each.
    """

    def read(place: str, reader: Callable[[Cell, str], T]) -> list[T]:
        name = kept.places.get(place)
        return [] if name is None else kept.read(name, reader, f"the {place} '{name}'")

    made_up = [ALL] * len(kept.rows)
    scenarios = read("scenario", read_label) or made_up
    alike = [f"frame {number}" for number in kept.numbers] if independent else made_up
    episodes = read("episode", read_key) or alike
    steps = read("step", read_step)
    _check_steps(kept)
    for place, labels in (("scenario", scenarios), ("episode", episodes)):
        if place in kept.places:
            _check_alike(kept, f"{place} '{kept.places[place]}'", labels)
    if not len(scenarios) == len(episodes) == (len(steps) or len(kept.rows)) == len(kept.rows):
        return scenarios, episodes, steps  # some of their cells have faults
    if "episode" in kept.places and len({*zip(scenarios, episodes, strict=True)}) > len({*episodes}):
        _check_apart(kept, scenarios, episodes, steps)
    if not steps:
        turns: dict[tuple[str, str], Iterator[int]] = defaultdict(count)
        return scenarios, episodes, [next(turns[key]) for key in zip(scenarios, episodes, strict=True)]
    return scenarios, episodes, steps


def _check_apart(kept: BankRows, scenarios: Sequence[str], episodes: Sequence[str], steps: Sequence[int]) -> None:
    """Note as a fault an episode in several scenarios: its parts would count as separate drives.

    Repeated names of different drives are no fault. They show by a step that occurs in two
    scenarios, or by other episodes between the parts, as in frames that are numbered throughout.
    Without steps there is no decision.
    """
    where: dict[tuple[str, int], str] = {}
    rows = [*zip(episodes, steps, scenarios, strict=False)]
    if not rows or any(where.setdefault((one, step), scenario) != scenario for one, step, scenario in rows):
        return
    ordered, every = sorted(rows, key=lambda row: row[:2]), sorted({*steps})
    for (one, step, scenario), (other, later, elsewhere) in pairwise(ordered):
        if one == other and scenario != elsewhere and bisect_left(every, later) > bisect_right(every, step):
            return
    within = {one: scenario for one, _, scenario in reversed(rows)}
    one, scenario = next((one, scenario) for one, _, scenario in rows if within[one] != scenario)
    kept.faults.add(
        f"{kept.table.name}: episode '{one}' goes through the scenarios '{within[one]}' and '{scenario}'. Whole "
        "episodes are exchanged within a scenario, so its parts would count as separate drives: leave the scenario "
        "out with --map scenario=, or give different drives different names"
    )


def _check_alike(kept: BankRows, place: str, labels: Iterable[str]) -> None:
    """Note names that look the same as faults; `costs` reports other spellings.

    ``place`` names what they are of, and the column.
    """
    first: dict[str, str] = {}
    for label in dict.fromkeys(labels):
        if (other := first.setdefault(alike(label), label)) != label:
            kept.faults.add(
                f"{kept.table.name}: the {place} is {label!a} in some rows and {other!a} in others: if that is one "
                f"{place.split(maxsplit=1)[0]}, use one spelling; if it is two, use two distinct names"
            )


def _check_steps(kept: BankRows) -> None:
    """Note as a fault a step that occurs twice in an episode; unreadable rows are skipped."""
    if not {"episode", "step"} <= kept.places.keys():
        return
    scenario, seen = kept.places.get("scenario"), set[tuple[str, str, int]]()
    for row, where in kept.named():
        with suppress(SourceError):
            key = (
                ALL if scenario is None else read_label(row.get(scenario), ""),
                read_key(row.get(kept.places["episode"]), ""),
                read_step(row.get(kept.places["step"]), ""),
            )
            if key in seen:
                kept.faults.add(f"{where}: step {key[2]} of episode '{key[1]}' occurs twice; a step is one frame")
            seen.add(key)


def _described(picture: str, frames: Sequence[Frame]) -> str:
    """Return the description of the pictures: as given, or by their cameras if several."""
    names = [camera.name for camera in frames[0].cameras] if frames else []
    if picture != UNDESCRIBED or len(names) < 2:
        return picture
    return f"pictures of {len(names)} cameras ({', '.join(names)})"


def write(
    out: Path,
    source: ImportSource,
    frames: Sequence[Frame],
    *,
    kept: BankRows,
    choices: Choices,
    progress: Progress | None,
) -> FrameBank:
    """Write the bank, one picture in memory at a time."""
    gap = kept.places.get("gap")
    _, left_out = reading.others(kept.places, choices.prompt_columns, kept.table.columns)
    manifest = BankManifest(
        simulator=IMPORTED,
        preset=given_name(source.folder) or "frames",
        picture=_described(choices.picture, frames),
        action_space=choices.space,
        gap=None if gap is None else Gap(gap, float(choices.threshold or 0.0), _unit(choices, kept.places)),
        settings={
            "table": kept.table.name,
            "columns": dict(kept.places),
            "left_out": left_out,
            "every": choices.every,
            **_declared(kept, choices),
            **source.settings,
        },
        prompt_columns=choices.prompt_columns,
        absent=tuple(place for place in ("scenario", "episode", "step") if place not in kept.places),
        independent=choices.independent,
        cameras=() if choices.rig is None else choices.rig.cameras,
        state=() if choices.rig is None else tuple(choices.rig.state),
        motion=None if choices.rig is None else choices.rig.space,
        history=choices.history,
        made=choices.made,
        edit={} if choices.edit is None else choices.edit.summary(),
    )
    with BankWriter(out, manifest) as writer:
        added = []
        windows = None if kept.windows is None else Windows(frames, kept.numbers, kept.windows)
        for number, (frame, images, drawn) in enumerate(source.pictures(frames), 1):
            whole = frame if windows is None else windows.whole(frame)
            if whole is None:
                writer.add_instant(frame, images)
            else:
                writer.add(whole, images, drawn)
                added.append(whole)
            if progress is not None:
                progress(number, len(frames))
        said = [
            *kept.said,
            *source.said,
            *(f"column {one} is left out: it has no plain values" for one in kept.table.unread),
        ]
        if windows is not None:
            windows.require_some(added)
            said += windows.said()
        _require_several(writer, added, manifest)
        _take_once(writer, added, manifest.gap, keep=choices.keep_repeats)
        if source.converted:
            writer.note("converted", dict(sorted(source.converted.items())))
        if said:
            writer.note(SAID, said)
    return open_bank(out)


def _require_several(writer: BankWriter, added: Sequence[Frame], manifest: BankManifest) -> None:
    """Raise SourceError if all frames show one picture: no model could tell them apart by looking."""
    shown = {tuple(map(writer.digest, frame.pictures.values())) for frame in added}
    if manifest.motion is None and len(shown) == 1 < len(added):
        raise SourceError(
            f"all {len(added)} rows show one and the same picture, such as '{added[0].id}' and '{added[-1].id}': a "
            "model that looks and one that does not answer alike there. Was the camera frozen, or one file copied?"
        )


def _take_once(writer: BankWriter, added: Sequence[Frame], gap: Gap | None, *, keep: bool) -> None:
    """Note repeated episodes, and leave them out unless they are to be kept.

    Raises SourceError if a repeated moment has another gap: it is unknown which one is right.
    """
    found = repeats(added, writer.read, writer.digest)
    column = "" if gap is None else gap.column
    for one, other in chain.from_iterable(again.pairs for again in found if not keep):
        gap_now, before = one.truth.get(column), other.truth.get(column)
        if None in (gap_now, before) or gap_now == before:
            continue
        same = [[*map(writer.digest, frame.pictures.values())] for frame in (one, other)]
        if same[0] == same[1]:  # moments of a standstill share a state, and may still differ
            raise SourceError(
                f"'{one.id}' and '{other.id}' show the same, in a recording that occurs twice, but the gap '{column}' "
                f"is {gap_now:g} in the one row and {before:g} in the other. Correct it, leave one "
                "recording out of the table, or import both with --keep-repeats"
            )
    if found:
        writer.note(REPEATS, [one.as_dict() for one in found])
    for frame in chain.from_iterable(one.frames for one in found if not keep):
        writer.leave_out(frame)


def _declared(kept: BankRows, choices: Choices) -> dict[str, object]:
    """Return the record of unusual ways in which the table was read."""
    numerals, marks = choices.numerals, choices.numerals.no_lead
    guessed = {
        place: column
        for place, column in kept.places.items()
        if choices.rig is None and place not in choices.columns and column not in reading.ROLES.get(place, (column,))
    }
    found = {
        "convert": choices.convert and plain(choices.convert),
        "keep_repeats": choices.keep_repeats,
        GUESSED: guessed,
        "numbers": numerals.style,
        "no_lead": {mark: numerals.counted[mark] for mark in marks or ()},
        "strip": choices.strip,
    }
    return {name: one for name, one in found.items() if one}
