"""Rows and pictures become a bank, or words that say all that is wrong; nothing half-written stays.

A picture of one's own is copied as it is, after a look at whether every program shows the same of it.
"""

import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, count, repeat
from pathlib import Path
from typing import TypeVar, cast

from eyechart.channels import INSTRUCTION, STATE, channels_of, conditions_of
from eyechart.conditions import OVER, by_reason, undrawn_controls
from eyechart.errors import SourceError, finite_number, whole_number
from eyechart.frames import (
    IMPORTED,
    BankManifest,
    BankWriter,
    Frame,
    FrameBank,
    Gap,
    MirrorAxis,
    Scalar,
    alone,
    is_reserved,
    open_bank,
    read_axis,
)
from eyechart.importing import columns as reading
from eyechart.importing.cells import (
    MOST_CELL,
    Cell,
    Progress,
    Row,
    read_label,
    read_number,
    read_part,
    read_said,
    read_step,
    read_truth,
)
from eyechart.importing.faults import Faults
from eyechart.importing.logged import Log, tell
from eyechart.importing.notes import notes
from eyechart.importing.parquet import MOST_ROWS
from eyechart.importing.photographs import Convert, Photographs
from eyechart.importing.repeats import REPEATS, in_words, repeats
from eyechart.importing.tables import Table, open_table
from eyechart.records import plain
from eyechart.spaces.discrete import DRIVING, Discrete
from eyechart.spaces.motion import PLACES, MotionSpace

T = TypeVar("T")

MOST_FRAMES = 100_000
MOST_TEXT = 400_000_000
"""Characters of all kept cells together, with an allowance of 50 a cell."""
_LARGE = 3_000_000
"""Pixels from which on a picture leaves as 5 MB and more, by 1.7 bytes a pixel of a photograph."""
_SIDES = re.compile(r"\b(left|right)\b", re.IGNORECASE)
LEAST_BOUNDED = 6
"""Episodes below which no share of a policy's channel is bounded (docs/decisions/0050)."""
SAID = "said"
"""The setting of an imported bank with a line for each thing of the source that is not in it."""
KIND = "kind"
"""The setting of an imported bank that says by what the kind of its motions was told."""
ALL = "all"
"""The name of the one scenario, and of the one episode, of a bank whose source records none."""

Shown = tuple[Frame, Mapping[str, bytes], Mapping[str, Mapping[str, bytes]]]
"""A frame with its encoded pictures by camera, and those of its counterfactuals."""


UNDESCRIBED = "pictures of a camera"
"""What pictures are where nobody says."""


@dataclass(frozen=True)
class Choices:
    """What the owner of the pictures says of them.

    ``columns`` maps a place (file, gap, episode, step, scenario, mirror; lead_near, lane_own and the other pictures
    with one thing changed) to a column, an empty name to none; ``rig`` says which
    are of several cameras and of the state, and else ``mirror`` is the axis of the one, unless a column says it of each
    frame. ``threshold`` and ``unit`` belong to the gap; a column as ``gap_m`` tells its unit. ``independent`` declares
    frames without episodes to be independent draws, and ``prompt_columns`` what a prompt may say. Every ``every``-th
    frame of an episode is taken. ``convert`` says how pictures are made plain; without it those that are not are
    refused. With ``keep_repeats`` a recording that is there twice is imported twice.
    ``wrong`` says what of this was given in ways that cannot be: faults, as those of the table.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    mirror: MirrorAxis = "none"
    space: Discrete = DRIVING
    threshold: float | None = None
    unit: str | None = None
    picture: str = UNDESCRIBED
    prompt_columns: tuple[str, ...] = ()
    independent: bool = False
    every: int = 1
    rig: reading.Rig | None = None
    convert: Convert | None = None
    keep_repeats: bool = False
    wrong: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        whole_number("every", self.every, 1)
        if self.threshold is not None:
            finite_number("threshold", self.threshold)


@dataclass(frozen=True)
class Source:
    """Where pictures come from: the folder, what yields each frame with its own, in any order, and what to record.

    ``settings`` are known before; meanwhile ``converted`` counts what is done to make pictures plain, and ``said``
    takes a line for what is left out.
    """

    folder: Path
    pictures: Callable[[Sequence[Frame]], Iterator[Shown]]
    settings: Mapping[str, object] = field(default_factory=dict)
    converted: Mapping[str, int] = field(default_factory=dict)
    said: Sequence[str] = ()


@dataclass(frozen=True)
class Kept:
    """The rows that become frames, with the number of each in its table, the column of each place, and faults."""

    rows: list[Row]
    numbers: list[int]
    places: Mapping[str, str]
    table: Table
    faults: Faults
    log: Log | None = None

    def named(self) -> Iterator[tuple[Row, str]]:
        """Yield the rows with what a message calls each."""
        return zip(self.rows, (f"{self.table.name}, row {number}" for number in self.numbers), strict=True)

    def read(self, column: str, reader: Callable[[Cell, str], T], what: str) -> list[T]:
        """Read the cells of a column, which are ``what``; one that is not is a fault, and left out."""
        found = []
        for row, where in self.named():
            with self.faults.noted():
                found.append(reader(row.get(column), f"{where}: {what}"))
        return found


def import_table(
    folder: Path,
    table: Path,
    out: Path,
    choices: Choices,
    *,
    reads: Progress | None = None,
    progress: Progress | None = None,
) -> FrameBank:
    """Make a bank at ``out`` of the pictures in ``folder`` that a table (CSV, JSON lines, Parquet) lists.

    ``reads`` counts the table as it is read, ``progress`` the frames written. Raises SourceError that names all that is
    wrong, by row, and leaves nothing at ``out``.
    """
    if not folder.is_dir():
        raise SourceError(f"{folder} is no folder; the first argument is the folder of the pictures")
    photographs = Photographs(folder, table.parent, choices.convert)
    kept = keep(_opened(table, reads, choices), choices)
    cells = cells_of(kept, choices, photographs.locate)
    if kept.faults:
        for where, file in cells.files():
            with kept.faults.noted():
                photographs.read(file, where)
        kept.faults.require_none(table.name)

    def pictures(frames: Sequence[Frame]) -> Iterator[Shown]:
        for frame, (_, where) in zip(frames, kept.named(), strict=True):
            with kept.faults.noted():
                yield _shown(frame, where, photographs, choices)
        kept.faults.require_none(table.name)

    frames = frames_of(kept, choices, cells)
    source = Source(folder, pictures, _told(choices.rig, kept), converted=photographs.done)
    return write(out, source, frames, kept=kept, choices=choices, progress=progress)


def _told(rig: reading.Rig | None, kept: Kept) -> dict[str, object]:
    """Return what to record of the kind of a rig's motions: a warning where the data clearly say another."""
    if rig is None or rig.motion is None or kept.log is None:
        return {}
    columns = [column for many in rig.state.values() for column in many]
    named = [columns.index(one.state) if one.state else None for one in rig.motion.number]
    told = tell(kept.log.walks(), named)
    against = told.against(rig.motion.kind)
    said = [told.warning(rig.motion.kind, "[motion] of --rig")] if against else []
    return {KIND: {"by": "the rig says", "ratio": told.ratio, "said": said}}


def _opened(table: Path, reads: Progress | None, choices: Choices) -> Table:
    """Open a table; where it cannot be opened, what is wrong with the choices is said first."""
    try:
        return open_table(table, reads)
    except SourceError:
        faults = Faults()
        faults.take(choices.wrong)
        faults.require_none(table.name)
        raise


def _shown(frame: Frame, where: str, photographs: Photographs, choices: Choices) -> Shown:
    """Return a frame with its pictures, under the names that they get; raises SourceError where one is not plain."""

    def read(files: Mapping[str, str], under: Callable[[str], str]) -> tuple[dict[str, bytes], dict[str, str]]:
        found = {name: photographs.read(file.removeprefix(under(name)), where) for name, file in files.items()}
        return {name: one for name, (one, _) in found.items()}, {
            name: under(name) + to for name, (_, to) in found.items()
        }

    images, files = read(frame.pictures, lambda name: _under(choices, name))
    drawn = {kind: read(one, partial(_beside, choices, kind)) for kind, one in frame.counterfactuals.items()}
    changed = {kind: named for kind, (_, named) in drawn.items()}
    return (
        replace(frame, pictures=files, counterfactuals=changed),
        images,
        {kind: one for kind, (one, _) in drawn.items()},
    )


def keep(table: Table, choices: Choices) -> Kept:
    """Read the rows that become frames; raises SourceError where they are none, or too many to keep.

    What is wrong with the choices is a fault of what is returned.
    """
    faults = table.faults
    faults.take(choices.wrong)
    asked = {**choices.columns}
    if choices.mirror != "none" and choices.rig is None:
        if asked.get("mirror"):
            faults.add(f"--mirror and --map mirror={asked['mirror']} both say the mirror axis: leave out one")
        asked.setdefault("mirror", "")
    kept = (*choices.prompt_columns, *(() if choices.rig is None else choices.rig.places().values()))
    own = (*(["gap"] if choices.threshold is None else []), *(["episode"] if choices.independent else []))
    places = reading.places(asked, table, faults, rig=choices.rig, kept=kept, own=own)
    _check_choices(choices, places, table, faults)
    rows: list[Row] = []
    numbers: list[int] = []
    seen: dict[object, int] = {}
    text, log = 0, _log(choices, places, table, faults)
    if table.count is not None:
        _check_count(table, table.count, -(-table.count // choices.every))
    for number, row in enumerate(_whole(table), 1):
        if not row:
            continue
        episode = row.get(places.get("episode", ""))
        turn = seen[episode] = seen.get(episode, -1) + 1
        if log is not None:
            log.add(row, number, places, kept=turn % choices.every == 0)
        if turn % choices.every:
            continue
        rows.append(row)
        numbers.append(number)
        text += _letters(row, f"{table.name}, row {number}", faults)
        _check_count(table, number, len(rows))
        if text > MOST_TEXT:
            raise SourceError(f"{table.name} holds more than {MOST_TEXT} characters; take every Nth row with --every N")
    if not rows and not faults:
        faults.add(f"{table.name} has no rows; each row is a frame")
    return Kept(rows, numbers, places, table, faults, log)


def _whole(table: Table) -> Iterator[Row]:
    """Yield a table's rows as far as it can be read; where that ends too early is one fault among the others."""
    with table.faults.noted():
        yield from table.rows


def _log(choices: Choices, places: Mapping[str, str], table: Table, faults: Faults) -> Log | None:
    """Return what takes note of the motions that a rig declares; without episodes no step is known to follow.

    None where a column of theirs is not in the table, which is a fault already.
    """
    if choices.rig is None or choices.rig.motion is None:
        return None
    if "episode" not in places:
        faults.add(f"--rig: a motion is of the steps that follow; say which column is the episode: {table.name}")
    known = all(one.column in table.columns for one in choices.rig.motion.number)
    state = [column for many in choices.rig.state.values() for column in many]
    return Log(choices.rig.motion, state, faults, table.name) if known else None


def _letters(row: Row, where: str, faults: Faults) -> int:
    """Return the characters that a row takes, with an allowance for each cell; one that is too long is a fault."""
    for name, cell in row.items():
        if isinstance(cell, str) and len(cell) > MOST_CELL:
            faults.add(f"{where}: '{name}' has more than {MOST_CELL} characters")
    return sum(50 + (len(cell) if isinstance(cell, str) else 0) for cell in row.values())


def _check_count(table: Table, rows: int, frames: int) -> None:
    if frames > MOST_FRAMES:
        raise SourceError(f"{table.name} has more than {MOST_FRAMES} frames; take every Nth of them with --every N")
    if rows > MOST_ROWS:
        raise SourceError(f"{table.name} has more than {MOST_ROWS} rows; cut it into parts")


def _check_choices(choices: Choices, places: Mapping[str, str], table: Table, faults: Faults) -> None:
    if "gap" in places and (choices.threshold is None or not _unit(choices, places)):
        faults.add(f"the gap '{places['gap']}' needs what counts as near: --threshold and --unit, for example 18 and m")
    if "gap" not in places and choices.threshold is not None and not choices.columns.get("gap"):
        has = reading.no_column("gap", table.columns, table.name)
        faults.add(f"--threshold belongs to a gap, and {has}; name one with --map gap=COLUMN")
    if choices.independent and "episode" in places:
        faults.add(
            f"the frames of an episode are not independent: leave out --independent, or the column "
            f"'{places['episode']}' with --map episode="
        )
    for name in choices.prompt_columns:
        if name not in table.columns:
            faults.add(f"--prompt-columns {name}: {reading.no_column(name, table.columns, table.name)}")
        for place, column in places.items():
            if name == column:
                faults.add(f"--prompt-columns {name}: it is the {place} of a frame, which no prompt may say")
        if name == "actions" or is_reserved(name):
            faults.add(f"--prompt-columns {name}: this name is taken; rename the column")


def _unit(choices: Choices, places: Mapping[str, str]) -> str:
    """Return the unit of the gap: that which was given, or that in its column's name."""
    return choices.unit or reading.unit_of(places["gap"]) or ""


@dataclass(frozen=True)
class Cells:
    """What the rows say, column by column, each as long as the rows where nothing in it is wrong.

    ``pictures`` maps a camera to its files, ``changed`` a kind of pictures with one thing changed to the same, where an
    empty name is a picture that was not taken.
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
        """Yield every picture's file, and what a message calls its row; a file that is wrong is left out."""
        for columns in (self.pictures, *self.changed.values()):
            for files in columns.values():
                yield from ((where, file) for where, file in zip(self.named, files, strict=True) if file)


def cells_of(kept: Kept, choices: Choices, locate: Callable[[str, str], str]) -> Cells:
    """Read the cells of all columns; what is wrong is noted as a fault of ``kept``, by row.

    ``locate`` makes a path of a file's name; no picture is looked at.
    """
    cameras = alone(choices.mirror) if choices.rig is None else choices.rig.cameras
    first, *others = (one.name for one in cameras)
    pictures = {first: _files(kept, "file", locate)}
    pictures |= {name: _files(kept, f"camera {name}", locate) for name in others}
    if choices.rig is None:
        changed = {kind: {first: _files(kept, kind, locate)} for kind in reading.PICTURED if kind in kept.places}
    else:
        names = (first, *others)
        changed = {kind: {one: _files(kept, f"{kind} {one}", locate) for one in names} for kind in choices.rig.changed}
    _check_taken(kept, changed)
    truth, state = _truths(kept, choices), {} if choices.rig is None else _states(choices.rig, kept)
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


def _truths(kept: Kept, choices: Choices) -> dict[str, Sequence[Scalar]]:
    """Return the columns of ground truth, the gap the last of them."""
    names, _ = reading.others(kept.places, choices.prompt_columns, kept.table.columns)
    truth: dict[str, Sequence[Scalar]] = {}
    for name in names:
        cells, named = [row.get(name) for row in kept.rows], (f"{where}: '{name}'" for _, where in kept.named())
        truth[name] = read_truth(cells, named, typed=kept.table.typed, faults=kept.faults)
    if gap := kept.places.get("gap"):
        truth[gap] = [*kept.read(gap, read_number, f"the gap '{gap}'")]
        if all(one is None for one in truth[gap]) and kept.rows and not kept.faults:
            kept.faults.add(f"{kept.table.name}: the gap '{gap}' is empty in every row; leave it out with --map gap=")
    return truth


def _read_axis(cell: Cell, what: str) -> MirrorAxis:
    """Return a cell as a mirror axis, none where it is empty; raises SourceError where it is none."""
    try:
        return read_axis(str(cell).strip().lower() if cell is not None else "none")
    except ValueError as error:
        raise SourceError(f"{what} is {str(cell)[:60]!r}, not vertical, horizontal or none") from error


def _check_taken(kept: Kept, changed: Mapping[str, Mapping[str, list[str]]]) -> None:
    """Note as a fault where a picture with one thing changed was taken by some cameras of a rig, and not by others."""
    for kind, columns in changed.items():
        for (_, where), files in zip(kept.named(), zip(*columns.values(), strict=True), strict=True):
            if any(files) and not all(files):
                lacking = ", ".join(name for name, file in zip(columns, files, strict=True) if not file)
                kept.faults.add(f"{where}: {kind} has no picture of {lacking}; take it by every camera, or by none")


def frames_of(kept: Kept, choices: Choices, cells: Cells) -> list[Frame]:
    """Return the frames that the cells say, no picture looked at yet; raises SourceError where any was a fault."""
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
            motion=motion,
        )
        for (place, file), motion in zip(enumerate(next(iter(cells.pictures.values()))), motions, strict=False)
    ]


def _states(rig: reading.Rig, kept: Kept) -> dict[str, list[tuple[float, ...]]]:
    """Return every state of a rig by its name, for each row."""
    numbers = {
        name: [
            kept.read(one, read_part, f"'{one}' of the state '{name}'") for one in parts if one in kept.table.columns
        ]
        for name, parts in rig.state.items()
    }
    return {name: list(zip(*columns, strict=not kept.faults)) for name, columns in numbers.items()}


def _under(choices: Choices, camera: str) -> str:
    """Return the folder of the bank in which a camera's pictures lie, as they lie in their own."""
    return "images/" if choices.rig is None else f"images/{camera}/"


def _beside(choices: Choices, kind: str, camera: str) -> str:
    """Return the folder of the bank for pictures with one thing changed; they may be other frames' true ones."""
    return f"counterfactuals/{kind}/" if choices.rig is None else f"counterfactuals/{kind}/{camera}/"


def _files(kept: Kept, role: str, locate: Callable[[str, str], str]) -> list[str]:
    """Return the file of each row, empty where a cell is that may be, or is wrong."""
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
                file = locate(read_label(cell, what), what)
        if file and file in first:
            kept.faults.add(f"{where}: '{file}' stands in row {first[file]} already; a picture is one frame")
            file = ""
        first[file] = number
        files.append(file)
    return files


def _placed(kept: Kept, *, independent: bool) -> tuple[list[str], list[str], list[int]]:
    """Return every frame's scenario, episode and step; those that the source does not record are made up here.

    Without episodes all frames are one, which no test can take for many; declared independent, each is its own.
    """

    def read(place: str, reader: Callable[[Cell, str], T]) -> list[T]:
        name = kept.places.get(place)
        return [] if name is None else kept.read(name, reader, f"the {place} '{name}'")

    made_up = [ALL] * len(kept.rows)
    scenarios = read("scenario", read_label) or made_up
    alike = [f"frame {number}" for number in kept.numbers] if independent else made_up
    episodes = read("episode", read_label) or alike
    steps = read("step", read_step)
    _check_steps(kept)
    if not len(scenarios) == len(episodes) == (len(steps) or len(kept.rows)) == len(kept.rows):
        return scenarios, episodes, steps  # some of their cells are faults
    if not steps:
        turns: dict[tuple[str, str], Iterator[int]] = defaultdict(count)
        return scenarios, episodes, [next(turns[key]) for key in zip(scenarios, episodes, strict=True)]
    return scenarios, episodes, steps


def _check_steps(kept: Kept) -> None:
    """Note as a fault where a step of an episode stands twice; a row with a cell that cannot be read says nothing."""
    if not {"episode", "step"} <= kept.places.keys():
        return
    scenario, seen = kept.places.get("scenario"), set[tuple[str, str, int]]()
    for row, where in kept.named():
        with suppress(SourceError):
            key = (
                ALL if scenario is None else read_label(row.get(scenario), ""),
                read_label(row.get(kept.places["episode"]), ""),
                read_step(row.get(kept.places["step"]), ""),
            )
            if key in seen:
                kept.faults.add(f"{where}: step {key[2]} of episode '{key[1]}' stands there twice; a step is one frame")
            seen.add(key)


def _pixels(bank: FrameBank) -> Iterator[int]:
    """Yield the pixels of some of the bank's pictures."""
    for frame in bank.frames[:: max(1, len(bank) // 20)]:
        for high, wide, _ in bank.shapes(frame).values():
            yield high * wide


def _described(picture: str, frames: Sequence[Frame]) -> str:
    """Return what the pictures are: in the words that were given, else by their cameras where there are several."""
    names = [one.name for one in frames[0].cameras] if frames else []
    if picture != UNDESCRIBED or len(names) < 2:
        return picture
    return f"pictures of {len(names)} cameras ({', '.join(names)})"


def write(
    out: Path, source: Source, frames: Sequence[Frame], *, kept: Kept, choices: Choices, progress: Progress | None
) -> FrameBank:
    """Write the bank, one picture in memory at a time."""
    gap = kept.places.get("gap")
    _, left_out = reading.others(kept.places, choices.prompt_columns, kept.table.columns)
    manifest = BankManifest(
        simulator=IMPORTED,
        preset=source.folder.resolve().name or "frames",
        picture=_described(choices.picture, frames),
        action_space=choices.space,
        gap=None if gap is None else Gap(gap, float(choices.threshold or 0.0), _unit(choices, kept.places)),
        settings={
            "table": kept.table.name,
            "columns": dict(kept.places),
            "left_out": left_out,
            "every": choices.every,
            **({} if choices.convert is None else {"convert": plain(choices.convert)}),
            **({"keep_repeats": True} if choices.keep_repeats else {}),
            **source.settings,
        },
        prompt_columns=choices.prompt_columns,
        absent=tuple(place for place in ("scenario", "episode", "step") if place not in kept.places),
        independent=choices.independent,
        cameras=() if choices.rig is None else choices.rig.cameras,
        state=() if choices.rig is None else tuple(choices.rig.state),
        motion=None if choices.rig is None else choices.rig.space,
    )
    with BankWriter(out, manifest) as writer:
        added = []
        for number, (frame, images, drawn) in enumerate(source.pictures(frames), 1):
            writer.add(frame, images, drawn)
            added.append(frame)
            if progress is not None:
                progress(number, len(frames))
        if found := repeats(added, writer.read):
            writer.note(REPEATS, [one.as_dict() for one in found])
        for frame in chain.from_iterable(one.frames for one in found if not choices.keep_repeats):
            writer.leave_out(frame)
        if source.converted:
            writer.note("converted", dict(sorted(source.converted.items())))
        if source.said:
            writer.note(SAID, [*source.said])
    return open_bank(out)


def taken(bank: FrameBank) -> list[str]:
    """Return what an imported bank took: columns of other names, how pictures changed, what its motions are.

    And which episodes are others again.
    """
    settings, lines = bank.manifest.settings, []
    columns, done, how = (settings.get(name) for name in ("columns", "converted", "convert"))
    own = {(place, of) for place, names in reading.ROLES.items() for of in names}
    asked = {} if not isinstance(columns, dict) else {one: columns[one] for one in columns if one in reading.ROLES}
    if other := {place: of for place, of in asked.items() if (place, of) not in own}:
        unit = f" in {bank.manifest.gap.unit}" if bank.manifest.gap is not None else ""
        said = (f"{place} from '{of}'{unit if place == 'gap' else ''}" for place, of in other.items())
        lines.append(f"columns: {', '.join(said)}")
    if isinstance(done, dict) and isinstance(how, dict):
        kinds = ", ".join(f"{count} {kind}" for kind, count in done.items() if kind != "pictures")
        lines.append(f"converted to PNG: {done.get('pictures')} pictures ({kinds}), over {how.get('background')}")
    if again := settings.get(REPEATS):
        lines.append(in_words(cast("list[dict[str, object]]", again), kept=bool(settings.get("keep_repeats"))))
    return [*lines, *_said(settings)]


def _said(settings: Mapping[str, object]) -> Iterator[str]:
    """Yield what an import said of the kind of its motions, and of what it left out."""
    told = settings.get(KIND)
    for many in (told.get("said") if isinstance(told, dict) else None, settings.get(SAID)):
        yield from map(str, many if isinstance(many, list) else ())


def costs(bank: FrameBank) -> list[str]:
    """Return what the bank's missing columns cost, one line each; each test that needs them says "cannot say"."""
    manifest, lines = bank.manifest, []
    if manifest.motion is not None:
        return _costs_of_policies(bank, manifest.motion)
    if manifest.gap is None:
        lines.append("no gap: whether decisions follow distance is not tested (depth_observational cannot say)")
    elif "episode" in manifest.absent and not manifest.independent:
        lines.append("no episodes, and not declared --independent: the gap tests cannot say")
    if "scenario" in manifest.absent:
        lines.append("no scenarios: cross_scenario is not shown (scene_cue cannot say)")
    if "step" in manifest.absent and "episode" not in manifest.absent:
        lines.append("no steps: the rows of an episode count as its steps, in their order")
    if all(frame.mirror_axis == "none" for frame in bank):
        lines.append("no mirror axis: mirrored is not shown (lateral is not_tested)")
    lines += [
        f"{name}: {lacking} of {len(bank)} frames have no such picture, and no part in its tests"
        for name, lacking in undrawn_controls(bank).items()
    ]
    lines += [
        f"no {name}_m for some pictures of {name}: these are in no range of distances that is tested"
        for name in ("lead_mid_near", "lead_mid_far")
        if any(name in one.counterfactuals and f"{name}_m" not in one.truth for one in bank)
    ]
    if (wide := max(_pixels(bank))) > _LARGE:
        lines.append(
            f"large pictures: they leave as PNG, about {wide * 1.7e-6:.0f} MB each, which many servers refuse; import "
            "them with --convert --longest 1280"
        )
    left_out = manifest.settings.get("left_out")
    if isinstance(left_out, list) and left_out:
        lines.append(f"left out, because a bank needs these names: {', '.join(map(str, left_out))}")
    return lines


def _costs_of_policies(bank: FrameBank, motion: MotionSpace) -> list[str]:
    """Return what a bank for policies has of motions, what it cannot show, and what looks wrong in its log."""
    steps, wide = motion.shape
    relative = sum(one.state is not None for one in motion.dimensions)
    rate = "" if motion.rate_hz is None else f" at {motion.rate_hz:g} Hz"
    kind = f"{motion.kind}, {relative} relative to the state" if motion.kind in PLACES else motion.kind
    lines = [f"motions: {steps} steps of {wide} numbers{rate}, {kind}"]
    if lacking := sum(not frame.motion for frame in bank):
        lines.append(f"{lacking} of {len(bank)} frames have no logged motion: fewer than {steps} steps follow them")
    if (episodes := len({frame.drive for frame in bank})) < LEAST_BOUNDED:
        lines.append(f"{episodes} episodes: nothing is bounded below {LEAST_BOUNDED}")
    if INSTRUCTION not in channels_of(bank):
        lines.append("no instruction: whether a policy follows it is not asked (no_power)")
    if STATE not in channels_of(bank):
        lines.append("no state: pictures at a similar state are not shown, so that use is undecided")
    unshown = {name: why for name, why in conditions_of(bank)[1].items() if OVER in name and "frame" in why}
    return [
        *lines,
        *(f"{names}: {why}" for names, why in by_reason(unshown).items()),
        *_costs_of_reflection(bank, motion),
        *notes(bank),
    ]


def _costs_of_reflection(bank: FrameBank, motion: MotionSpace) -> Iterator[str]:
    """Yield why the mirrored moment is not shown, or what its instructions may say wrongly."""
    if (why := conditions_of(bank)[1].get("mirrored")) is not None:
        yield f"mirrored: {why}" + ("" if motion.mirrored else "; [reflection] of a --rig says it")
        return
    said = {str(one) for frame in bank for one in frame.fields.values()}
    sided = sorted(one for one in said if _SIDES.search(one) and motion.reflect_text(one) == one)
    if sided:
        words = '[reflection.words] says what is exchanged, as left = "right"'
        named = f"{len(sided)} instructions name a side, such as '{sided[0][:60]}', and stay as they are"
        yield f"mirrored: {named}; {words}"
