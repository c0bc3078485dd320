"""Rows and pictures become a bank, or one line that says why not; nothing half-written stays."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from eyechart.errors import SourceError
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
)
from eyechart.importing import columns as reading
from eyechart.importing.pictures import place_of, read_picture
from eyechart.importing.tables import MOST_CELL, Cell, Progress, Row, Table, open_table
from eyechart.spaces.discrete import DRIVING, Discrete

MOST_FRAMES = 100_000
MOST_ROWS = 20_000_000
MOST_TEXT = 400_000_000
"""Characters of all kept cells together, with an allowance of 50 a cell."""
ALL = "all"
"""The name of the one scenario, and of the one episode, of a bank whose source records none."""

Pictures = Callable[[Sequence[Frame]], Iterator[tuple[Frame, Mapping[str, bytes]]]]
"""Yields every frame with its encoded pictures by camera, in any order."""


@dataclass(frozen=True)
class Choices:
    """What the owner of the pictures says of them.

    ``columns`` maps a place (file, gap, episode, step, scenario) to a column, an empty name to none; ``rig`` says which
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

    def pictures(frames: Sequence[Frame]) -> Iterator[tuple[Frame, Mapping[str, bytes]]]:
        for frame, number in zip(frames, kept.numbers, strict=True):
            what = f"{kept.table.name}, row {number}"
            files = {name: file.removeprefix(_under(choices, name)) for name, file in frame.pictures.items()}
            yield frame, {name: read_picture(folder, file, what) for name, file in files.items()}

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
        text += sum(50 + (len(cell) if isinstance(cell, str) else 0) for cell in row.values())
        _check_cells(table, number, row)
        _check_count(table, number, len(rows))
        if text > MOST_TEXT:
            raise SourceError(f"{table.name} holds more than {MOST_TEXT} characters; take every Nth row with --every N")
    if not rows:
        raise SourceError(f"{table.name} has no rows; each row is a frame")
    return Kept(rows, numbers, places, table)


def _check_cells(table: Table, number: int, row: Row) -> None:
    for name, cell in row.items():
        if isinstance(cell, str) and len(cell) > MOST_CELL:
            raise SourceError(f"{table.name}, row {number}: '{name}' has more than {MOST_CELL} characters")


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
    columns = {name: [row.get(name) for row in kept.rows] for name in kept.table.columns if name}
    truth_names, _ = reading.others(kept.places, choices.prompt_columns, kept.table.columns)
    truth: dict[str, list[Scalar]] = {
        name: reading.read_truth(columns[name], name, typed=kept.table.typed) for name in truth_names
    }
    whats = [f"{kept.table.name}, row {number}" for number in kept.numbers]
    roles = ("file", *(role for role in kept.places if role.startswith("camera ")))
    files = [_files(kept, role, columns, whats, locate) for role in roles]
    state = {} if choices.rig is None else _states(choices.rig, columns, whats)
    if clash := sorted(state.keys() & {*truth, *choices.prompt_columns}):
        raise SourceError(f"--rig: the state '{clash[0]}' has the name of a column that is kept; give it another name")
    cameras = alone(choices.mirror) if choices.rig is None else choices.rig.cameras
    if "gap" in kept.places:
        truth[kept.places["gap"]] = _gaps(kept, columns[kept.places["gap"]], whats)
    scenarios, episodes, steps = _placed(kept, columns, whats, independent=choices.independent)
    said = {
        name: [reading.read_said(cell, f"{what}: '{name}'") for cell, what in zip(columns[name], whats, strict=True)]
        for name in choices.prompt_columns
    }
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
            fields={name: column[place] for name, column in said.items()},
            state={name: column[place] for name, column in state.items()},
        )
        for place, file in enumerate(files[0])
    ]


def _gaps(kept: Kept, cells: Sequence[Cell], whats: Sequence[str]) -> list[Scalar]:
    """Return every row's gap; raises SourceError where no row has one."""
    name = kept.places["gap"]
    gaps = [reading.read_number(cell, f"{what}: the gap '{name}'") for cell, what in zip(cells, whats, strict=True)]
    if all(gap is None for gap in gaps):
        raise SourceError(f"{kept.table.name}: the gap '{name}' is empty in every row; leave it out with --map gap=")
    return list(gaps)


def _states(
    rig: reading.Rig, columns: Mapping[str, Sequence[Cell]], whats: Sequence[str]
) -> dict[str, list[tuple[float, ...]]]:
    """Return every state of a rig by its name, for each row."""

    def numbers(name: str, column: str) -> list[float]:
        cells = zip(columns[column], whats, strict=True)
        return [reading.read_part(cell, f"{what}: '{column}' of the state '{name}'") for cell, what in cells]

    return {name: list(zip(*(numbers(name, one) for one in parts), strict=True)) for name, parts in rig.state.items()}


def _under(choices: Choices, camera: str) -> str:
    """Return the folder of the bank in which a camera's pictures lie, as they lie in their own."""
    return "images/" if choices.rig is None else f"images/{camera}/"


def _files(
    kept: Kept,
    role: str,
    columns: Mapping[str, Sequence[Cell]],
    whats: Sequence[str],
    locate: Callable[[str, str], str],
) -> list[str]:
    name = kept.places[role]
    first: dict[str, int] = {}
    files = []
    for cell, what, number in zip(columns[name], whats, kept.numbers, strict=True):
        file = locate(reading.read_label(cell, f"{what}: the {role} '{name}'"), f"{what}: the {role} '{name}'")
        if file in first:
            raise SourceError(f"{what}: '{file}' stands in row {first[file]} already; a picture is one frame")
        first[file] = number
        files.append(file)
    return files


def _placed(
    kept: Kept, columns: Mapping[str, Sequence[Cell]], whats: Sequence[str], *, independent: bool
) -> tuple[list[str], list[str], list[int]]:
    """Return every frame's scenario, episode and step; those that the source does not record are made up here.

    Without episodes all frames are one, which no test can take for many; declared independent, each is its own.
    """
    count = len(kept.rows)

    def labels(place: str) -> list[str] | None:
        name = kept.places.get(place)
        if name is None:
            return None
        return [
            reading.read_label(cell, f"{what}: the {place} '{name}'")
            for cell, what in zip(columns[name], whats, strict=True)
        ]

    scenarios = labels("scenario") or [ALL] * count
    episodes = labels("episode") or ([f"frame {number}" for number in kept.numbers] if independent else [ALL] * count)
    name = kept.places.get("step")
    if name is None:
        turns: dict[tuple[str, str], int] = {}
        steps = []
        for key in zip(scenarios, episodes, strict=True):
            turns[key] = turns.get(key, -1) + 1
            steps.append(turns[key])
        return scenarios, episodes, steps
    steps = [
        reading.read_step(cell, f"{what}: the step '{name}'") for cell, what in zip(columns[name], whats, strict=True)
    ]
    if "episode" in kept.places:
        _check_steps(scenarios, episodes, steps, whats)
    return scenarios, episodes, steps


def _check_steps(scenarios: Sequence[str], episodes: Sequence[str], steps: Sequence[int], whats: Sequence[str]) -> None:
    seen: set[tuple[str, str, int]] = set()
    for key, what in zip(zip(scenarios, episodes, steps, strict=True), whats, strict=True):
        if key in seen:
            raise SourceError(f"{what}: step {key[2]} of episode '{key[1]}' stands there twice; a step is one frame")
        seen.add(key)


def write(
    out: Path,
    folder: Path,
    frames: Sequence[Frame],
    pictures: Pictures,
    *,
    kept: Kept,
    choices: Choices,
    progress: Progress | None,
    settings: Mapping[str, object] | None = None,
) -> FrameBank:
    """Write the bank, one picture in memory at a time."""
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
        for done, (frame, images) in enumerate(pictures(frames), 1):
            writer.add(frame, images, {})
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
    left_out = manifest.settings.get("left_out")
    if isinstance(left_out, list) and left_out:
        lines.append(f"left out, because a bank needs these names: {', '.join(map(str, left_out))}")
    return lines
