"""Rows and pictures become a bank, or one line that says why not; nothing half-written stays.

A picture of one's own is copied as it is, after a look at whether every model would see the same in it.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path, PurePosixPath
from typing import TypeVar

from eyechart.conditions import undrawn_controls
from eyechart.errors import BankError, SourceError
from eyechart.frames import (
    IMPORTED,
    MAX_IMAGE_BYTES,
    BankManifest,
    BankWriter,
    Frame,
    FrameBank,
    Gap,
    MirrorAxis,
    alone,
    inside,
    is_reserved,
    open_bank,
    require_plain,
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
from eyechart.importing.parquet import MOST_ROWS
from eyechart.importing.tables import Table, open_table
from eyechart.spaces.discrete import DRIVING, Discrete

T = TypeVar("T")

MOST_FRAMES = 100_000
MOST_TEXT = 400_000_000
"""Characters of all kept cells together, with an allowance of 50 a cell."""
ALL = "all"
"""The name of the one scenario, and of the one episode, of a bank whose source records none."""

Shown = tuple[Frame, Mapping[str, bytes], Mapping[str, Mapping[str, bytes]]]
"""A frame with its encoded pictures by camera, and those of its counterfactuals."""


@dataclass(frozen=True)
class Choices:
    """What the owner of the pictures says of them.

    ``columns`` maps a place (file, gap, episode, step, scenario; lead_near, lane_own and the other pictures with one
    thing changed) to a column, an empty name to none; ``rig`` says which
    are of several cameras and of the state, and else ``mirror`` is the axis of the one. ``threshold`` and ``unit``
    belong to the gap. ``independent`` declares frames without episodes to be independent draws, and
    ``prompt_columns`` what a prompt may say. Every ``every``-th frame of an episode is taken.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    mirror: MirrorAxis = "none"
    space: Discrete = DRIVING
    threshold: float | None = None
    unit: str | None = None
    picture: str = "pictures of a camera"
    prompt_columns: tuple[str, ...] = ()
    independent: bool = False
    every: int = 1
    rig: reading.Rig | None = None


@dataclass(frozen=True)
class Kept:
    """The rows that become frames, with the number of each in its table, and the column of each place."""

    rows: list[Row]
    numbers: list[int]
    places: Mapping[str, str]
    table: Table

    def named(self) -> Iterator[tuple[Row, str]]:
        """Yield the rows with what a message calls each."""
        return zip(self.rows, (f"{self.table.name}, row {number}" for number in self.numbers), strict=True)

    def read(self, column: str, reader: Callable[[Cell, str], T], what: str) -> list[T]:
        """Read the cells of a column, which are ``what``; raises SourceError, naming the row, for one that is not."""
        return [reader(row.get(column), f"{where}: {what}") for row, where in self.named()]


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

    ``reads`` counts the table as it is read, ``progress`` the frames written. Raises SourceError that names the row,
    and leaves nothing at ``out``.
    """
    if not folder.is_dir():
        raise SourceError(f"{folder} is no folder; the first argument is the folder of the pictures")
    kept = keep(open_table(table, reads), choices)

    def pictures(frames: Sequence[Frame]) -> Iterator[Shown]:
        for frame, (_, where) in zip(frames, kept.named(), strict=True):
            files = {name: file.removeprefix(_under(choices, name)) for name, file in frame.pictures.items()}
            drawn = {
                kind: {
                    name: read_picture(folder, file.removeprefix(_beside(kind)), where) for name, file in one.items()
                }
                for kind, one in frame.counterfactuals.items()
            }
            yield frame, {name: read_picture(folder, file, where) for name, file in files.items()}, drawn

    frames = frames_of(kept, choices, lambda name, what: place_of(folder, name, what))
    return write(out, folder, frames, pictures, kept=kept, choices=choices, progress=progress)


def keep(table: Table, choices: Choices) -> Kept:
    """Read the rows that become frames; raises SourceError where they are none, or too many to keep."""
    places = reading.places(choices.columns, table.columns, table.name, choices.rig)
    _check_choices(choices, places, table)
    rows: list[Row] = []
    numbers: list[int] = []
    seen: dict[object, int] = {}
    text = 0
    if table.count is not None:
        _check_count(table, table.count, -(-table.count // choices.every))
    for number, row in enumerate(table.rows, 1):
        episode = row.get(places.get("episode", ""))
        turn = seen[episode] = seen.get(episode, -1) + 1
        if turn % choices.every:
            continue
        rows.append(row)
        numbers.append(number)
        for name, cell in row.items():
            text += 50 + (len(cell) if isinstance(cell, str) else 0)
            if isinstance(cell, str) and len(cell) > MOST_CELL:
                raise SourceError(f"{table.name}, row {number}: '{name}' has more than {MOST_CELL} characters")
        _check_count(table, number, len(rows))
        if text > MOST_TEXT:
            raise SourceError(f"{table.name} holds more than {MOST_TEXT} characters; take every Nth row with --every N")
    if not rows:
        raise SourceError(f"{table.name} has no rows; each row is a frame")
    return Kept(rows, numbers, places, table)


def _check_count(table: Table, rows: int, frames: int) -> None:
    if frames > MOST_FRAMES:
        raise SourceError(f"{table.name} has more than {MOST_FRAMES} frames; take every Nth of them with --every N")
    if rows > MOST_ROWS:
        raise SourceError(f"{table.name} has more than {MOST_ROWS} rows; cut it into parts")


def _check_choices(choices: Choices, places: Mapping[str, str], table: Table) -> None:
    if choices.every < 1:
        raise SourceError(f"--every takes a number of 1 or more, not {choices.every}")
    if "gap" in places and (choices.threshold is None or not choices.unit):
        raise SourceError(
            f"the gap '{places['gap']}' needs what counts as near: --threshold and --unit, for example 18 and m"
        )
    if "gap" not in places and choices.threshold is not None:
        has = reading.no_column("gap", table.columns, table.name)
        raise SourceError(f"--threshold belongs to a gap, and {has}; name one with --map gap=COLUMN")
    if choices.independent and "episode" in places:
        raise SourceError(
            f"the frames of an episode are not independent: leave out --independent, or the column "
            f"'{places['episode']}' with --map episode="
        )
    for name in choices.prompt_columns:
        if name not in table.columns:
            raise SourceError(f"--prompt-columns {name}: {reading.no_column(name, table.columns, table.name)}")
        for place, column in places.items():
            if name == column:
                raise SourceError(f"--prompt-columns {name}: it is the {place} of a frame, which no prompt may say")
        if name == "actions" or is_reserved(name):
            raise SourceError(f"--prompt-columns {name}: this name is taken; rename the column")


def frames_of(kept: Kept, choices: Choices, locate: Callable[[str, str], str]) -> list[Frame]:
    """Return the frames that the rows say, no picture looked at yet; ``locate`` makes a path of a file's name.

    Raises SourceError, naming table and row, for a cell that is not what its place needs.
    """
    truth_names, _ = reading.others(kept.places, choices.prompt_columns, kept.table.columns)
    truth = {
        name: read_truth([row.get(name) for row in kept.rows], name, typed=kept.table.typed) for name in truth_names
    }
    roles = ("file", *(role for role in kept.places if role.startswith("camera ")))
    files = [_files(kept, role, locate) for role in roles]
    state = {} if choices.rig is None else _states(choices.rig, kept)
    if clash := sorted(state.keys() & {*truth, *choices.prompt_columns}):
        raise SourceError(f"--rig: the state '{clash[0]}' has the name of a column that is kept; give it another name")
    cameras = alone(choices.mirror) if choices.rig is None else choices.rig.cameras
    if name := kept.places.get("gap"):
        truth[name] = [*kept.read(name, read_number, f"the gap '{name}'")]
        if all(gap is None for gap in truth[name]):
            empty = f"{kept.table.name}: the gap '{name}' is empty in every row"
            raise SourceError(f"{empty}; leave it out with --map gap=")
    scenarios, episodes, steps = _placed(kept, independent=choices.independent)
    drawn = _changed(kept, cameras[0].name, locate)
    said = {name: kept.read(name, read_said, f"'{name}'") for name in choices.prompt_columns}
    return [
        Frame(
            id=file,
            scenario=scenarios[place],
            episode=episodes[place],
            step=steps[place],
            cameras=cameras,
            pictures={
                one.name: f"{_under(choices, one.name)}{many[place]}" for one, many in zip(cameras, files, strict=True)
            },
            truth={name: column[place] for name, column in truth.items()},
            counterfactuals=drawn[place],
            fields={name: column[place] for name, column in said.items()},
            state={name: column[place] for name, column in state.items()},
        )
        for place, file in enumerate(files[0])
    ]


def _states(rig: reading.Rig, kept: Kept) -> dict[str, list[tuple[float, ...]]]:
    """Return every state of a rig by its name, for each row."""
    numbers = {
        name: [kept.read(one, read_part, f"'{one}' of the state '{name}'") for one in parts]
        for name, parts in rig.state.items()
    }
    return {name: list(zip(*columns, strict=True)) for name, columns in numbers.items()}


def _under(choices: Choices, camera: str) -> str:
    """Return the folder of the bank in which a camera's pictures lie, as they lie in their own."""
    return "images/" if choices.rig is None else f"images/{camera}/"


def _changed(kept: Kept, camera: str, locate: Callable[[str, str], str]) -> list[dict[str, dict[str, str]]]:
    """Return each row's pictures with one thing changed, those that were taken."""
    files = {kind: _files(kept, kind, locate) for kind in reading.PICTURED if kind in kept.places}
    return [
        {kind: {camera: f"{_beside(kind)}{many[place]}"} for kind, many in files.items() if many[place]}
        for place in range(len(kept.rows))
    ]


def _beside(kind: str) -> str:
    """Return the folder of the bank for pictures with one thing changed; they may be other frames' true ones."""
    return f"counterfactuals/{kind}/"


def _files(kept: Kept, role: str, locate: Callable[[str, str], str]) -> list[str]:
    """Return the file of each row, empty where a cell is that may be."""
    first: dict[str, int] = {}
    files = []
    for (row, where), number in zip(kept.named(), kept.numbers, strict=True):
        what, cell = f"{where}: the {role} '{kept.places[role]}'", row.get(kept.places[role])
        if role in reading.PICTURED and (cell is None or not str(cell).strip()):
            files.append("")
            continue
        file = locate(read_label(cell, what), what)
        if file in first:
            raise SourceError(f"{where}: '{file}' stands in row {first[file]} already; a picture is one frame")
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
    if not steps:
        turns: dict[tuple[str, str], Iterator[int]] = defaultdict(count)
        return scenarios, episodes, [next(turns[key]) for key in zip(scenarios, episodes, strict=True)]
    seen: set[tuple[str, str, int]] = set()
    for key, (_, where) in zip(zip(scenarios, episodes, steps, strict=True), kept.named(), strict=True):
        if key in seen and "episode" in kept.places:
            raise SourceError(f"{where}: step {key[2]} of episode '{key[1]}' stands there twice; a step is one frame")
        seen.add(key)
    return scenarios, episodes, steps


def write(
    out: Path,
    folder: Path,
    frames: Sequence[Frame],
    pictures: Callable[[Sequence[Frame]], Iterator[Shown]],
    *,
    kept: Kept,
    choices: Choices,
    progress: Progress | None,
    settings: Mapping[str, object] | None = None,
) -> FrameBank:
    """Write the bank, one picture in memory at a time; ``pictures`` yields every frame, in any order."""
    gap = kept.places.get("gap")
    _, left_out = reading.others(kept.places, choices.prompt_columns, kept.table.columns)
    manifest = BankManifest(
        simulator=IMPORTED,
        preset=folder.resolve().name or "frames",
        picture=choices.picture,
        action_space=choices.space,
        gap=None if gap is None else Gap(gap, float(choices.threshold or 0.0), str(choices.unit)),
        settings={
            "table": kept.table.name,
            "columns": dict(kept.places),
            "left_out": left_out,
            "every": choices.every,
            **(settings or {}),
        },
        prompt_columns=choices.prompt_columns,
        absent=tuple(place for place in ("scenario", "episode", "step") if place not in kept.places),
        independent=choices.independent,
        cameras=() if choices.rig is None else choices.rig.cameras,
        state=() if choices.rig is None else tuple(choices.rig.state),
    )
    with BankWriter(out, manifest) as writer:
        for done, (frame, images, drawn) in enumerate(pictures(frames), 1):
            writer.add(frame, images, drawn)
            if progress is not None:
                progress(done, len(frames))
    return open_bank(out)


def costs(bank: FrameBank) -> list[str]:
    """Return what the bank's missing columns cost, one line each; each test that needs them says "cannot say"."""
    manifest, lines = bank.manifest, []
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
    left_out = manifest.settings.get("left_out")
    if isinstance(left_out, list) and left_out:
        lines.append(f"left out, because a bank needs these names: {', '.join(map(str, left_out))}")
    return lines


def place_of(folder: Path, name: str, what: str) -> str:
    """Return a picture's path inside the folder, with '/' between its parts; raises SourceError where it leads outside.

    ``what`` names row and column in the message.
    """
    path = name.strip()
    if "\\" in path and "/" not in path:
        path = path.replace("\\", "/")
    pure = PurePosixPath(path)
    if pure.is_absolute() and pure.is_relative_to(folder.resolve().as_posix()):
        pure = pure.relative_to(folder.resolve().as_posix())
    try:
        inside(folder, str(pure))
    except BankError as error:
        raise SourceError(f"{what} is '{name}', which leads outside {folder}, where the pictures must lie") from error
    return str(pure)


def read_picture(folder: Path, file: str, what: str) -> bytes:
    """Return a picture's bytes; raises SourceError, naming row and file, where it is not plain (`require_plain`)."""
    try:
        picture = _bytes_of(folder, file)
        require_plain(picture, file)
    except BankError as error:
        raise SourceError(f"{what}: {error}") from error
    return picture


def _bytes_of(folder: Path, file: str) -> bytes:
    path = folder / file
    try:
        if not path.is_file():
            raise BankError(f"there is no picture '{file}' in {folder}")
        if path.stat().st_size > MAX_IMAGE_BYTES:
            raise BankError(f"'{file}' has {path.stat().st_size} bytes; the limit is {MAX_IMAGE_BYTES}")
        return path.read_bytes()
    except OSError as error:
        raise BankError(f"'{file}' cannot be read: {error.strerror}") from error
