"""Imports of a LeRobotDataset: rows from Parquet files, pictures from videos or from those files."""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Protocol

import msgspec

from eyechart.errors import SourceError, SpecError, did_you_mean
from eyechart.frames import Frame, FrameBank
from eyechart.importing.bank import (
    KIND,
    BankRows,
    Choices,
    FramePictures,
    ImportSource,
    cells_of,
    frames_of,
    keep,
    write,
)
from eyechart.importing.cells import Progress, Row
from eyechart.importing.columns import PICTURED, CameraColumn, SensorLayout
from eyechart.importing.episode_files import EpisodeFiles
from eyechart.importing.faults import Faults
from eyechart.importing.layout import (
    MOST_CAMERAS,
    DataSetLayout,
    EpisodeTable,
    Feature,
    Info,
    columns_of,
    given_name,
    whole,
)
from eyechart.importing.logged_rotations import DeclaredRotation, LoggedRows, Of, in_degrees, tell_turned
from eyechart.importing.motion_log import CHANGES_ABOVE, LogDescription, LoggedMotion, MotionNumber
from eyechart.importing.pages import MOST_COMPONENTS
from eyechart.importing.parquet import has_column, open_parquet
from eyechart.importing.tables import SourceTable
from eyechart.importing.timeline import PLACES, Timeline
from eyechart.importing.videos import EmbeddedPictures, MissingPicture, Reel, Videos
from eyechart.spaces.motion import PLACES as RELATIVE
from eyechart.spaces.motion import Kind

FILE, STEP = "file", PLACES["step"]
"""The column of each frame's picture, which the data set itself does not have; and of its step."""
TASK, OBSERVED = "task", "observation."
STATE, ACTION = ("observation.state", "state"), ("action", "actions")
"""The usual names of both vectors. Features such as ``action.arm`` are parts of the first name."""


class RowTable(Protocol):
    """One file's rows: plain cells by column, in order."""

    @property
    def path(self) -> Path:
        """Return the file."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Return the columns of every row."""

    @property
    def count(self) -> int:
        """Return the number of rows."""

    def rows(self) -> Iterator[Row]:
        """Yield the rows; raises SourceError for an unreadable file."""


@dataclass(frozen=True)
class Dataset:
    """A data set: its files, its description, its cameras' videos, its episodes and its tasks.

    ``timeline`` records its rows as they are read; ``said`` collects the parts that are left out.
    ``task`` is the column with the number of each row's task.
    """

    layout: DataSetLayout
    info: Info
    reels: Mapping[str, Reel]
    episodes: EpisodeTable
    tasks: Mapping[int, str]
    timeline: Timeline
    task: str = "task_index"
    said: list[str] = field(default_factory=list)

    @property
    def features(self) -> Mapping[str, Feature]:
        """Return its features."""
        return self.info.features

    @property
    def about(self) -> Path:
        """Return the file that describes it, for messages."""
        return self.layout.root / "meta/info.json"

    @property
    def format(self) -> str:
        """Return its format and version."""
        return f"lerobot {self.info.codebase_version.partition('.')[0]}"

    def tables(self) -> "Sequence[RowTable]":
        """Return the data files in order."""
        vectors = columns_of(self.features)
        return [open_parquet(path, vectors=vectors, extra="lerobot") for path in self.layout.parquets("data")]

    def is_observed(self, name: str) -> bool:
        """Return whether a feature is of the observation by its name."""
        return name.startswith(OBSERVED)

    def usual(self) -> tuple[Sequence[str], Sequence[str]]:
        """Return the features that are the state and the action if the user names none."""
        return usual(self.features, STATE), usual(self.features, ACTION)


@dataclass(frozen=True, slots=True)
class Horizon:
    """The motions to make from a log: their steps, and their kind, which the data show if it is None.

    ``state`` and ``action`` name the features of both, in order; empty: the usual ones.
    ``rotations`` are declared as ``FEATURE[3:7]=quat_xyzw``. With None, nothing is declared, and
    numbers that look like a rotation are taken as they are.
    """

    horizon: int
    kind: Kind | None = None
    state: Sequence[str] = ()
    action: Sequence[str] = ()
    rotations: Sequence[str] | None = ()


def import_lerobot(
    folder: Path,
    out: Path,
    choices: Choices,
    *,
    camera: str | None = None,
    ahead: Horizon | None = None,
    reads: Progress | None = None,
    progress: Progress | None = None,
    read: "ReadDataset | None" = None,
) -> FrameBank:
    """Make a bank at ``out`` of a LeRobotDataset v2.0, v2.1 or v3, with its episodes and steps.

    With ``ahead`` the bank is for policies. It then has all cameras, or the named one, the state,
    the task as the instruction, and the actions of the steps ahead of each frame. A rig declares
    the reflection. The kind of motion is inferred from the data if ``ahead`` does not give it.
    Without ``ahead`` the bank has one camera. The columns are those of the data files. Components
    of vectors become ``observation.state.NAME`` (or ``.0``, ``.1``, …), and the words of the task
    ``task``. ``read`` opens a data set of another format. Raises SourceError, and leaves nothing at
    ``out``.
    """
    Faults(choices.wrong).require_none(str(folder))
    data = (read or read_dataset)(folder, camera, every=ahead is not None)
    if choices.rig is not None:
        if ahead is None:
            raise SpecError("--rig of a data set declares a reflection in a bank for policies: give --horizon")
        _require_cameras(data, choices.rig)
    if drawn := set(PICTURED) & choices.columns.keys():
        raise SourceError(f"--map {min(drawn)}=…: a data set holds no pictures with one thing changed")
    own = {"file", "episode", "step"} & choices.columns.keys()
    if own:
        raise SourceError(f"--map {min(own)}=…: a data set declares the {min(own)} of a frame itself")
    columns = {**dict.fromkeys(PICTURED, ""), **PLACES, **choices.columns}
    chosen = replace(choices, columns={**columns, "file": FILE})
    if ahead is not None:
        said = choices.prompt_columns or _instruction(data)
        rig = _rig(data, ahead, choices)
        chosen = replace(choices, columns={**PLACES, **choices.columns}, prompt_columns=said, rig=rig)
        data.timeline.needed += _numbers(rig)
    table = _table(data, reads, tuple(data.reels) if ahead is not None else (FILE,))
    if ahead is not None:
        _require_numbers(data, _features_of(data, ahead), table.columns)
    kept = keep(table, chosen)
    if TASK in chosen.prompt_columns:
        _require_words(kept, data)
    elif data.tasks:
        data.said.extend(_wordless(kept, data))
    data.said.extend(_other_words(kept, data))
    frames = _frames(kept, chosen, data.timeline)
    settings: dict[str, object] = {
        "format": data.format,
        "camera": ", ".join(data.reels),
    }
    if ahead is not None and chosen.rig is not None:
        rig, settings[KIND] = _with_kind(_with_rotations(data, chosen.rig, kept, ahead), kept, ahead)
        chosen = replace(chosen, rig=rig)
        data.said.extend(_left_out(data, rig, *_features_of(data, ahead)))
    data.said.extend(data.timeline.said())
    source = ImportSource(folder, partial(_pictures, data, kept), settings, said=data.said)
    return write(out, source, frames, kept=kept, choices=chosen, progress=progress)


ReadDataset = Callable[..., Dataset]
"""Opens a data set: the folder, the camera's name and ``every``, as `read_dataset` takes them."""


def _frames(kept: BankRows, choices: Choices, timeline: Timeline) -> list[Frame]:
    """Return the frames of the kept rows; an error also lists the rows that were left out."""
    cells = cells_of(kept, choices, lambda name, what: name)  # noqa: ARG005 - made here, so it leads nowhere else
    try:
        return frames_of(kept, choices, cells)
    except SourceError as error:
        raise SourceError("; ".join([str(error), *(timeline.said() if kept.rows else ())])) from error


def read_dataset(folder: Path, camera: str | None, *, every: bool = False) -> Dataset:
    """Read the ``meta`` folder; raises SourceError for an unread version or an unknown camera.

    With ``every``, all cameras are taken if none is named, except depth cameras and cameras without
    files. The exceptions are noted.
    """
    said, info = list[str](), DataSetLayout(folder).info()
    layout = EpisodeFiles(folder) if info.is_of_episodes else DataSetLayout(folder)
    cameras = _cameras(info.features, layout.root / "meta/info.json", said)
    videos = [name for name in cameras if info.features[name].dtype == "video"]
    episodes = layout.episodes(videos, info)
    lacking = {name: why for name in cameras if (why := _lacks(layout, info, episodes, name))}
    chosen = chosen_cameras(cameras, lacking, camera, layout.root / "meta/info.json", every=every)
    said += [f"camera '{name}' is left out: {why}" for name, why in lacking.items() if chosen != [name]]
    tasks = layout.tasks()
    task = layout.task_column(open_parquet(layout.parquets("data")[0], extra="lerobot").columns)
    timeline = Timeline(given_name(layout.root), info.fps, [task] if tasks else [], [])
    reels: dict[str, Reel] = {}
    for name in chosen:
        if info.features[name].dtype == "video":
            reels[name] = Videos(layout, episodes.clips[name], timeline)
        else:
            reels[name] = EmbeddedPictures(layout.parquets("data"), name)
    return Dataset(layout, info, reels, episodes, tasks, timeline, task, said)


def _cameras(features: Mapping[str, Feature], path: Path, said: list[str]) -> list[str]:
    """Return the cameras except depth cameras; exceptions and doubtful cases go into ``said``."""
    found = [name for name, feature in features.items() if feature.is_picture]
    cameras = [name for name in found if not features[name].is_depth]
    if not cameras:
        depth = ", all of them marked as depths" if found else ""
        raise SourceError(f"{path} lists no feature of dtype video or image{depth and ' of colours'}{depth}")
    if len(cameras) > MOST_CAMERAS:
        raise SourceError(f"{path} lists {len(cameras)} cameras; the limit is {MOST_CAMERAS}")
    said += [f"camera '{name}' is left out: its pictures are marked as depths" for name in found if name not in cameras]
    said += [
        f"camera '{name}' looks like a depth camera by its name or its one channel, but is not marked as one "
        "(is_depth_map): it is read as a colour camera"
        for name in cameras
        if features[name].is_grey or "depth" in name.lower()
    ]
    return cameras


def _lacks(layout: DataSetLayout, info: Info, episodes: EpisodeTable, camera: str) -> str:
    """Return why a listed camera has no picture at all, empty if it has some."""
    if info.features[camera].dtype == "image":
        there = any(has_column(path, camera, extra="lerobot") for path in layout.parquets("data"))
        return "" if there else "info.json lists it, but no data file has a column of it"
    clips = episodes.clips[camera]
    if not clips:
        return f"info.json lists it, but {layout.EPISODES} has no places of its videos"
    there = any(layout.file(video) is not None for video in sorted({clip.video for clip in clips.values()}))
    return "" if there else "info.json lists it, but none of its videos exists"


def chosen_cameras(
    cameras: Sequence[str], lacking: Mapping[str, str], camera: str | None, path: Path, *, every: bool
) -> Sequence[str]:
    """Return the cameras to take: the named one, else all that have pictures, or the only one.

    ``lacking`` has the reason why a camera has no picture, and ``path`` lists the cameras. Raises
    SourceError for an unknown name, and if no camera can be taken.
    """
    have = [name for name in cameras if name not in lacking]
    if camera is not None:
        of_name = [name for name in cameras if name == camera] or [name for name in cameras if _short(name) == camera]
        if len(of_name) != 1:
            near = did_you_mean(camera, [*cameras, *map(_short, cameras)])
            raise SourceError(f"--camera {camera}: {path} lists no such camera;{near} there are {', '.join(cameras)}")
        if of_name[0] in lacking:
            raise SourceError(f"--camera {camera}: {lacking[of_name[0]]}; download the data set again")
        return of_name
    if not have:
        raise SourceError(f"{path}: no camera has a picture: '{cameras[0]}': {lacking[cameras[0]]}; download it again")
    if len(have) > 1 and not every:
        raise SourceError(
            f"{path} lists several cameras; choose one with --camera: {', '.join(have)}; a bank for policies has all "
            "of them (--horizon)"
        )
    return have


def _rig(data: Dataset, ahead: Horizon, choices: Choices) -> SensorLayout:
    """Return the cameras, the state and the motions of a data set, as far as its names show."""
    names, done = (_numbered(data.features, many) for many in _features_of(data, ahead))
    state, action = tuple(names.values()), tuple(done.values())
    if not action:
        raise SourceError(_no_action(data))
    kind = ahead.kind or ("absolute" if done.keys() <= names.keys() else "delta")
    numbers = [MotionNumber(column, name, state=names.get(name, "")) for name, column in done.items()]
    by_name = [one | {column: column for column in one.values()} for one in (names, done)]
    reflection = None if choices.rig is None else choices.rig.reflection
    return SensorLayout(
        tuple(_named(name, choices) for name in data.reels),
        {"state": tuple(state)} if state else {},
        LoggedMotion(tuple(numbers), ahead.horizon, kind, data.info.fps, ACTION[0]),
        None if reflection is None else reflection.by_column(*by_name),
    )


def _numbers(rig: SensorLayout) -> list[str]:
    """Return the columns of a rig's states and motions."""
    done = () if rig.motion is None else rig.motion.number
    return [*(column for many in rig.state.values() for column in many), *(one.column for one in done)]


def _require_numbers(data: Dataset, features: Sequence[Sequence[str]], columns: Sequence[str]) -> None:
    """Raise SourceError if the data have no numbers of a feature that info.json describes as such."""
    for name in (name for many in features for name in many):
        if not {*_columns(data.features, name)} <= {*columns}:
            count = len(_columns(data.features, name))
            has = f"as no list of {count} numbers" if name in columns else "in no column that is read"
            raise SourceError(f"{data.about} describes '{name}' as {count} numbers, and the data files have it {has}")


def _no_action(data: Dataset) -> str:
    """Return the message that no action can be read, with the features that are numbers."""
    there = [
        f"'{name}' ({_sized(feature)})" for name, feature in data.features.items() if feature.size not in {(), (1,)}
    ]
    has = f"; of numbers it has {', '.join(there[:20])}" if there else ""
    return (
        f"{data.about} lists no feature '{ACTION[0]}' of up to {MOST_COMPONENTS} numbers, but a policy is compared "
        f"with the logged actions{has}; name the feature, or its parts with commas, with --action"
    )


def _sized(feature: Feature) -> str:
    return f"{'×'.join(map(str, feature.size))} number{'' if feature.size == (1,) else 's'}"


def _left_out(data: Dataset, rig: SensorLayout, state: Sequence[str], action: Sequence[str]) -> Iterator[str]:
    """Yield the observed numbers that are not in the policy's state, and actions that are not in its motion."""
    for of, taken, word in (("state", state if rig.state else (), ""), ("motion", action, ACTION[0])):
        left = [
            f"'{name}' ({_sized(feature)})"
            for name, feature in data.features.items()
            if feature.size and not feature.is_picture and name not in taken
            if word in name and data.is_observed(name) != bool(word)
        ]
        more = f", and {len(left) - 20} more" if len(left) > 20 else ""
        has = " and ".join(f"'{name}'" for name in taken) or "nothing"
        if left:
            yield f"left out of the {of}, which has {has}: {', '.join(left[:20])}{more}"


def _with_rotations(data: Dataset, rig: SensorLayout, kept: BankRows, ahead: Horizon) -> SensorLayout:
    """Return a rig with its declared rotations; SpecError for a wrong one, or one that is not declared."""
    if ahead.rotations is None or rig.motion is None or kept.log is None:
        return rig
    declared = [DeclaredRotation.read(text) for text in ahead.rotations]
    state, action = _features_of(data, ahead)
    every: dict[Of, Sequence[str]] = {"motion": action, "state": state}
    places: dict[Of, list[tuple[str, int]]] = {
        of: [(name, place) for name in names for place in range(len(_columns(data.features, name)))]
        for of, names in every.items()
    }
    walks = [walk for walk in kept.log.walks() if len(walk.done)]
    if not walks:
        return rig
    names: dict[Of, list[str]] = {of: [*_numbered(data.features, many)] for of, many in every.items()}
    found = LoggedRows.of(walks, places, names).rotations(declared)
    return msgspec.structs.replace(rig, motion=msgspec.structs.replace(rig.motion, rotations=found))


def _with_kind(rig: SensorLayout, kept: BankRows, ahead: Horizon) -> tuple[SensorLayout, dict[str, object]]:
    """Return a rig with its kind of motion, and the evidence for it.

    A place is relative to its paired number of the state. A kind that was given wins. Raises
    SourceError if neither the data nor the names show the kind.
    """
    motion, columns = rig.motion, [column for many in rig.state.values() for column in many]
    assert motion is not None
    assert kept.log is not None
    named = [columns.index(one.state) if one.state else None for one in motion.number]
    walks = [walk for walk in kept.log.walks() if len(walk.done)]
    evidence, units = tell_turned(walks, named, motion.rotations, len(columns)), in_degrees(walks, named)
    kind, by = _kind(evidence, ahead, named, units)
    said = [f"kind: {kind}, as {by}: {evidence.why()}{units}"]
    if ahead.kind and evidence.contradicts(kind):
        said = [evidence.warning(kind, "--kind")]
    elif by == _BY_NAMES:
        said = [f"kind: {kind}, as {by}; the data do not tell ({evidence.why()}); --kind declares another"]
    settled = _paired(motion, kind, evidence.pairs if evidence.kind in RELATIVE else named, columns)
    return msgspec.structs.replace(rig, motion=settled), {"by": by, "ratio": evidence.ratio, "said": said}


def _paired(motion: LoggedMotion, kind: Kind, pairs: Sequence[int | None], columns: Sequence[str]) -> LoggedMotion:
    """Return a motion of a kind, whose places are relative to their pairs of the state."""
    alone, turns = kind not in RELATIVE, motion.rotations
    turning = {number for one in turns if one.of == "motion" for number in one.numbers}
    states = ["" if alone or place is None or at in turning else columns[place] for at, place in enumerate(pairs)]
    number = tuple(msgspec.structs.replace(one, state=own) for one, own in zip(motion.number, states, strict=True))
    turns = tuple(replace(one, state=None) if alone else one for one in turns)
    return msgspec.structs.replace(motion, kind=kind, number=number, rotations=turns)


_BY_NAMES = "the names say"


def _kind(description: LogDescription, ahead: Horizon, named: Sequence[int | None], units: str) -> tuple[Kind, str]:
    """Return the kind of the motions and its source: the user, the data, or the state's names.

    Names count only for numbers that are no farther from the state's than their spread: one name
    may have two units.
    """
    if ahead.kind is not None:
        return ahead.kind, "--kind says"
    if description.kind is not None:
        return description.kind, "the data tell"
    if None not in named and (description.ratio is None or description.ratio <= CHANGES_ABOVE):
        return "absolute", _BY_NAMES
    raise SourceError(
        f"the data do not show the kind of the numbers of '{ACTION[0]}' ({description.why()}{units}): give it with "
        "--kind delta, absolute, velocity or waypoints"
    )


def _named(camera: str, choices: Choices) -> CameraColumn:
    """Return a camera by its short name, with its declared axis and partner."""
    for one in () if choices.rig is None else choices.rig.camera:
        if one.name == _short(camera):
            return msgspec.structs.replace(one, column=camera)
    return CameraColumn(_short(camera), camera, choices.mirror)


def _require_cameras(data: Dataset, rig: SensorLayout) -> None:
    """Raise SpecError if a rig names an unknown camera, or a reflection leaves one out."""
    there, named = [_short(name) for name in data.reels], [one.name for one in rig.camera]
    for name in named:
        if name not in there:
            raise SpecError(
                f"--rig names a camera '{name}';{did_you_mean(name, there)} the bank has {', '.join(there)}"
            )
    if rig.reflection is not None and (lacking := [name for name in there if name not in named]):
        raise SpecError(f"[reflection] of --rig needs the mirror_axis of every camera; '{lacking[0]}' is not named")


def _short(camera: str) -> str:
    """Return a camera's name without the common prefix, in allowed characters."""
    return re.sub(r"[^\w-]", "_", re.sub(r"^observation\.(images?\.)?", "", camera)) or "camera"


def _features_of(data: Dataset, ahead: Horizon) -> tuple[Sequence[str], Sequence[str]]:
    """Return the features of the state and of the action: the named ones, else the usual ones.

    Raises SourceError if a named feature is not a vector of numbers.
    """
    for option, names in (("--state", ahead.state), ("--action", ahead.action)):
        for name in names:
            if list(names).count(name) > 1:
                raise SourceError(f"{option} names '{name}' twice; name each feature once")
            if not _columns(data.features, name):
                numbers = [feature for feature in data.features if _columns(data.features, feature)]
                near = did_you_mean(name, numbers)
                raise SourceError(
                    f"{option} {name}: {data.about} lists no such feature of up to {MOST_COMPONENTS} numbers;{near} "
                    f"there are {', '.join(numbers)}"
                )
    state, action = data.usual()
    return ahead.state or state, ahead.action or action


def usual(features: Mapping[str, Feature], names: Sequence[str]) -> Sequence[str]:
    """Return the first of the ``names`` that is a feature, else all parts of the first name."""
    known = [name for name in names if _columns(features, name)]
    return known[:1] or [name for name in features if name.startswith(f"{names[0]}.") and _columns(features, name)]


def _numbered(features: Mapping[str, Feature], names: Sequence[str]) -> dict[str, str]:
    """Return the columns of features by the names of their components; equal names get their feature's."""
    labels = [(name, label) for name in names for label in _labels(features, name)]
    often = Counter(label for _, label in labels)
    said = [label if often[label] == 1 else f"{name.rpartition('.')[2]}.{label}" for name, label in labels]
    columns = [column for name in names for column in _columns(features, name)]
    return dict(zip(said if len(set(said)) == len(said) else columns, columns, strict=True))


def _labels(features: Mapping[str, Feature], name: str) -> list[str]:
    """Return the names of a vector's components, or their numbers without names."""
    names, columns = features[name].names, _columns(features, name)
    if isinstance(names, dict) and len(names) == 1:
        (names,) = names.values()
    if isinstance(names, list) and len(names) == 1 != len(columns):
        (names,) = names
    if isinstance(names, list) and len({*map(str, names)}) == len(names) == len(columns):
        return [*map(str, names)]
    return [f"{name}.{place}" for place in range(len(columns))]


def _columns(features: Mapping[str, Feature], name: str) -> tuple[str, ...]:
    """Return the columns of a feature's numbers; empty without the feature, or for too many."""
    return columns_of(features).get(name, ())


def _instruction(data: Dataset) -> tuple[str, ...]:
    """Return the column of the instruction, empty if the data set has no tasks.

    Raises SourceError if its rows have tasks without words.
    """
    path, first = data.layout.root / data.layout.TASKS, data.tables()[0]
    numbered = data.task in first.columns
    if len(data.tasks) > 1 and not numbered:
        raise SourceError(
            f"{path} has the words of {len(data.tasks)} tasks, but {first.path} has no column '{data.task}' with each "
            "row's task; name the instruction's column with --prompt-columns"
        )
    if not data.tasks and numbered:
        lacking = "holds no words of tasks" if path.is_file() else "does not exist"
        raise SourceError(
            f"{path} {lacking}, but every row has a {data.task}. Without words there is no instruction: "
            "download the data set again with its whole meta folder, or name the instruction's column with "
            "--prompt-columns"
        )
    return (TASK,) if data.tasks else ()


def _require_words(kept: BankRows, data: Dataset) -> None:
    """Note as a fault, once a task, a row whose task has no words."""
    first = {row.get(data.task): where for row, where in reversed([*kept.named()]) if not row.get(TASK)}
    for number, where in reversed(first.items()):
        kept.faults.add(f"{where}: {data.layout.TASKS} has no words of task {number}; download the data set again")


def _wordless(kept: BankRows, data: Dataset) -> list[str]:
    """Return a note of the frames whose tasks have no words, if no prompt needs them."""
    lacking = [str(row.get(data.task)) for row in kept.framed if not row.get(TASK)]
    if not lacking:
        return []
    said, which = f"{len(lacking)} of {len(kept.framed)} frames have no words of their task", [*dict.fromkeys(lacking)]
    return [f"{said}: {data.layout.TASKS} has none of {', '.join(which[:20])}"]


def _other_words(kept: BankRows, data: Dataset) -> list[str]:
    """Return a note of episodes whose listed tasks lack the words of a row's task."""
    listed, found = data.episodes.tasks, dict[int, str]()
    for row in kept.rows:
        episode, said = whole(row.get(PLACES["episode"])), row.get(TASK)
        if episode is not None and isinstance(said, str) and said and said not in (listed.get(episode) or [said]):
            found.setdefault(episode, said)
    if not found:
        return []
    (episode, said), where = next(iter(found.items())), data.layout.EPISODES
    note = (
        f"{len(found)} episodes have tasks by their rows that {where} does not list: episode {episode} has "
        f"'{said[:60]}' by its {data.task}, and '{listed[episode][0][:60]}' in {where}; the rows' tasks are taken"
    )
    return [note]


def _table(data: Dataset, reads: Progress | None, pictured: Sequence[str]) -> SourceTable:
    """Return the rows of all data files, with picture names in the columns ``pictured``."""
    files = data.tables()
    for place in PLACES.values():
        if place not in files[0].columns and not (place == STEP and data.info.is_of_episodes):
            raise SourceError(f"{files[0].path} has no column '{place}', which every LeRobotDataset has")
    task = (TASK,) if data.tasks and TASK not in files[0].columns else ()
    count = sum(file.count for file in files)
    counted = (STEP,) if data.info.is_of_episodes and STEP not in files[0].columns else ()
    columns = (*pictured, *(name for name in files[0].columns if name not in pictured), *counted, *task)
    for many in (data.timeline.needed, data.timeline.counted):
        many[:] = [name for name in many if name in columns]
    return SourceTable(
        data.timeline.name, columns, _data_rows(data, files, count, reads, pictured), typed=True, count=count
    )


def _data_rows(
    data: Dataset, files: Sequence[RowTable], count: int, reads: Progress | None, pictured: Sequence[str]
) -> Iterator[Row]:
    """Yield the rows with tasks and picture names; a row that is left out is empty."""
    done, timeline = 0, data.timeline
    for file in files:
        if file.columns != files[0].columns:
            raise SourceError(f"{file.path} has other columns than {files[0].path}")
        for raw in _numbered_rows(file) if STEP not in file.columns else file.rows():
            done += 1
            if reads is not None and done % 5000 == 0:
                reads(done, count)
            if row := timeline.add(raw):
                episode, step = (whole(row[name]) for name in PLACES.values())
                task = {TASK: _words(data, row)} if data.tasks else {}
                _require_one_task(task, row, f"{file.path}, row {done}", data)
                yield {**task, **row, **dict.fromkeys(pictured, f"episode-{episode}/frame-{step}.png")}
            else:
                yield row
    clips = {name: reel.clips for name, reel in data.reels.items() if isinstance(reel, Videos)}
    timeline.require(data.episodes.lengths, clips, data.layout.root / data.layout.EPISODES)


def _numbered_rows(file: RowTable) -> Iterator[Row]:
    """Yield the rows of an episode's file with their numbers; raises SourceError for two episodes."""
    first: Row = {}
    for number, row in enumerate(file.rows()):
        first = first or row
        if row.get(PLACES["episode"]) != first.get(PLACES["episode"]):
            raise SourceError(f"{file.path} has rows of several episodes, but no column '{STEP}' with their steps")
        yield {**row, STEP: number}


def _require_one_task(task: Row, row: Row, where: str, data: Dataset) -> None:
    """Raise SourceError if a row's own words of its task differ from those of its task's number."""
    own, said = row.get(TASK), task.get(TASK)
    if isinstance(own, str) and own and said and own != said:
        raise SourceError(
            f"{where}: its task is '{own[:60]}' by its own column, and '{str(said)[:60]}' by its {data.task} "
            f"{row.get(data.task)} and {data.layout.TASKS}; one of them is wrong"
        )


def _words(data: Dataset, row: Row) -> str:
    """Return the words of a row's task, or of the only task if rows have no number of it."""
    if data.task not in row:
        return next(iter(data.tasks.values())) if len(data.tasks) == 1 else ""
    return data.tasks.get(whole(row[data.task]) or 0, "")


def _pictures(data: Dataset, kept: BankRows, frames: Sequence[Frame]) -> Iterator[FramePictures]:
    """Yield the frame of each row that is kept, with its cameras' pictures.

    A frame without a camera's picture is left out and noted.
    """
    what = "frames" if kept.windows is None else "instants"
    reels = [reel.pictures(frames, kept.numbers) for reel in data.reels.values()]
    missed: dict[str, list[MissingPicture]] = {}
    for frame, *pictures in zip(frames, *reels, strict=True):
        shown = {}
        for camera, picture in zip(frame.cameras, pictures, strict=True):
            if isinstance(picture, MissingPicture):
                missed.setdefault(camera.name, []).append(picture)
            else:
                shown[camera.name] = picture
        if len(shown) == len(pictures):
            yield frame, shown, {}
    for name, many in missed.items():
        said = f"{len(many)} of {len(frames)} {what} are left out: '{name}' has no picture of them ({many[0].why})"
        if len(many) == len(frames):
            raise SourceError(said)
        data.said.append(said)
