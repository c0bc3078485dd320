"""A LeRobotDataset v3 becomes a bank: rows from its Parquet files, pictures from its videos or from those files.

Layout (github.com/huggingface/lerobot, ``src/lerobot/datasets``, codebase version v3.0): ``meta/info.json`` has the
features, the frames a second and the path templates; ``meta/episodes/chunk-*/file-*.parquet`` says for each episode in
which data file and, for each camera, in which video file and from which second on it lies; ``data/chunk-*/
file-*.parquet`` has a row a frame, and the pictures of cameras that have no video; ``meta/tasks.parquet`` the words of
each task.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import msgspec

from eyechart.errors import SourceError, SpecError, meant
from eyechart.frames import Frame, FrameBank
from eyechart.importing.bank import KIND, Choices, Kept, Shown, Source, cells_of, frames_of, keep, write
from eyechart.importing.cells import Progress, Row
from eyechart.importing.columns import PICTURED, Column, Rig
from eyechart.importing.faults import Faults
from eyechart.importing.logged import Logged, Number, tell
from eyechart.importing.pages import MOST_COMPONENTS
from eyechart.importing.parquet import ParquetTable, open_parquet
from eyechart.importing.reels import Clip, Embedded, Reel, Videos
from eyechart.importing.tables import Table
from eyechart.spaces.motion import PLACES as RELATIVE
from eyechart.spaces.motion import Kind

FILE = "file"
"""The column that names each frame's picture; the data set has none of its own."""
PLACES = {"episode": "episode_index", "step": "frame_index"}
_CONVERTER = "lerobot.scripts.convert_dataset_v21_to_v30"
TASK, STATE, ACTION = "task", "observation.state", "action"


@dataclass(frozen=True)
class Dataset:
    """What the ``meta`` folder says: frames a second, the reels of the cameras, features, and words of tasks."""

    root: Path
    fps: float
    reels: Mapping[str, Reel]
    features: Mapping[str, Any]
    tasks: Mapping[int, str]


@dataclass(frozen=True, slots=True)
class Ahead:
    """How a log becomes motions: so many steps ahead, of a ``kind``; without one it is told by the data."""

    horizon: int
    kind: Kind | None = None


def import_lerobot(
    folder: Path,
    out: Path,
    choices: Choices,
    *,
    camera: str | None = None,
    ahead: Ahead | None = None,
    reads: Progress | None = None,
    progress: Progress | None = None,
) -> FrameBank:
    """Make a bank at ``out`` of a LeRobotDataset v3; episodes and steps are those of the data set.

    With ``ahead`` it is one for policies: of all cameras, or of the one named, with the state, the task as what a
    policy is told, and the actions of so many steps from each frame on; a rig says what is reflected. What kind of
    motions these are is told by the data where ``ahead`` does not say it. Without, it is of one camera. The columns are
    those of its data files; components of vectors come as ``observation.state.NAME`` (or ``.0``, ``.1``, …), the words
    of the task as ``task``. Raises SourceError, and leaves nothing at ``out``.
    """
    wrong = Faults()
    wrong.take(choices.wrong)
    wrong.require_none(str(folder))
    data = read_meta(folder, camera, every=ahead is not None)
    if choices.rig is not None:
        if ahead is None:
            raise SpecError("--rig of a LeRobotDataset says what is reflected in a bank for policies: give --horizon")
        _require_cameras(data, choices.rig)
    if drawn := set(PICTURED) & choices.columns.keys():
        raise SourceError(f"--map {min(drawn)}=…: a LeRobotDataset holds no pictures with one thing changed")
    own = {"file", "episode", "step"} & choices.columns.keys()
    if own:
        raise SourceError(f"--map {min(own)}=…: a LeRobotDataset says itself which {min(own)} a frame is")
    columns = {**dict.fromkeys(PICTURED, ""), **PLACES, **choices.columns}
    chosen = replace(choices, columns={**columns, "file": FILE})
    if ahead is not None:
        said = choices.prompt_columns or _instruction(data)
        chosen = replace(
            choices, columns={**PLACES, **choices.columns}, prompt_columns=said, rig=_rig(data, ahead, choices)
        )
    kept = keep(_table(data, reads, tuple(data.reels) if ahead is not None else (FILE,)), chosen)
    if TASK in chosen.prompt_columns:
        _require_words(kept)
    cells = cells_of(kept, chosen, lambda name, what: name)  # noqa: ARG005 - made here, so it leads nowhere else
    frames = frames_of(kept, chosen, cells)
    settings: dict[str, object] = {"format": "lerobot v3", "camera": ", ".join(data.reels)}
    if ahead is not None and chosen.rig is not None:
        rig, settings[KIND] = _told(chosen.rig, frames, ahead)
        chosen = replace(chosen, rig=rig)
    source = Source(folder, partial(_pictures, data, kept.numbers), settings)
    return write(out, source, frames, kept=kept, choices=chosen, progress=progress)


def read_meta(folder: Path, camera: str | None, *, every: bool = False) -> Dataset:
    """Read the ``meta`` folder; raises SourceError where it is none of version 3, or the camera is unknown.

    Of several cameras ``every`` one is taken where none is named.
    """
    path = folder / "meta" / "info.json"
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
        version, fps, features = str(info["codebase_version"]), float(info["fps"]), dict(info["features"])
        template = info.get("video_path")
    except FileNotFoundError as error:
        raise SourceError(f"{path} does not exist: {_where(folder)}") from error
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise SourceError(f"{path} is no description of a LeRobotDataset: {error!r}") from error
    if not version.startswith("v3"):
        convert = f"'python -m {_CONVERTER} --repo-id=OWNER/NAME --root={folder} --push-to-hub=false'"
        raise SourceError(
            f"{path} says version {version}, and this reads v3; LeRobot's own converter makes v3 of v2.1: {convert} "
            "(in older versions of LeRobot the module stands in lerobot.datasets.v30)"
        )
    if not math.isfinite(fps) or fps <= 0:
        raise SourceError(f"{path} says {fps:g} frames a second, which is no rate")
    reels: dict[str, Reel] = {}
    for name in _cameras(features, camera, path, every=every):
        if features[name]["dtype"] == "video":
            reels[name] = Videos(folder, _clips(folder, name, str(template)), fps)
        else:
            reels[name] = Embedded(_files(folder, "data"), name)
    return Dataset(folder, fps, reels, features, _tasks(folder))


def _where(folder: Path) -> str:
    """Return what may be wrong with a folder that is no data set: a name of the Hub was given, or another folder."""
    if folder.exists() or not re.fullmatch(r"[\w.-]+/[\w.-]+", folder.as_posix()):
        return f"is {folder} a LeRobotDataset?"
    name = folder.as_posix()
    kept = (
        f"~/.cache/huggingface/lerobot, or $HF_LEROBOT_HOME: {name} in it, or hub/datasets--{name.replace('/', '--')}"
    )
    return (
        f"there is no folder '{name}'; of a data set of the Hub give the folder: LeRobot keeps what it downloaded in "
        f"{kept}/snapshots; 'hf download {name} --repo-type dataset --local-dir {folder.name}' fetches it"
    )


def _cameras(features: Mapping[str, Any], camera: str | None, path: Path, *, every: bool) -> Sequence[str]:
    kinds = {"video", "image"}
    found = {name: one for name, one in features.items() if isinstance(one, dict) and one.get("dtype") in kinds}
    cameras = [name for name, one in found.items() if not _is_depth(one)]
    if not cameras:
        raise SourceError(f"{path} lists no feature of dtype video or image")
    if camera is None and len(cameras) > 1 and not every:
        raise SourceError(
            f"{path} lists several cameras; choose one with --camera: {', '.join(cameras)}; a bank for policies has "
            "all of them (--horizon)"
        )
    if camera is not None and camera not in cameras:
        if len(of_name := [one for one in cameras if _short(one) == camera]) == 1:
            return of_name
        near = meant(camera, [*cameras, *map(_short, cameras)])
        raise SourceError(f"--camera {camera}: {path} lists no such camera;{near} there are {', '.join(cameras)}")
    return cameras if camera is None else [camera]


def _is_depth(feature: Mapping[str, Any]) -> bool:
    """Return whether a camera's pictures are depths, which are no picture of red, green and blue."""
    info = feature.get("info")
    return isinstance(info, dict) and any(info.get(name) is True for name in ("is_depth_map", "video.is_depth_map"))


def _rig(data: Dataset, ahead: Ahead, choices: Choices) -> Rig:
    """Return the cameras, the state and the motions of a data set, these as far as names say what they are."""
    state, action = _columns(data.features, STATE), _columns(data.features, ACTION)
    if not action:
        has = f"{data.root / 'meta/info.json'} lists no feature '{ACTION}' of up to {MOST_COMPONENTS} numbers"
        raise SourceError(f"{has}, and a policy is held against what was done")
    names = dict(zip(_labels(data.features, STATE), state, strict=True))
    done = dict(zip(_labels(data.features, ACTION), action, strict=True))
    known = names if len(names) == len(state) and len(done) == len(action) else {}
    kind = ahead.kind or ("absolute" if done.keys() <= known.keys() else "delta")
    numbers = [
        Number(column, name, state=known.get(name, ""))
        for column, name in zip(action, _labels(data.features, ACTION), strict=True)
    ]
    by_name = [one | {column: column for column in one.values()} for one in (names, done)]
    reflection = None if choices.rig is None else choices.rig.reflection
    return Rig(
        tuple(_named(name, choices) for name in data.reels),
        {"state": tuple(state)} if state else {},
        Logged(tuple(numbers), ahead.horizon, kind, data.fps, ACTION),
        None if reflection is None else reflection.by_column(*by_name),
    )


def _told(rig: Rig, frames: Sequence[Frame], ahead: Ahead) -> tuple[Rig, dict[str, object]]:
    """Return a rig with the kind of motion that the data tell, and why it was taken.

    A place is relative to the number of the state that it is paired with. Where somebody gave a kind, that is taken.
    """
    motion, columns = rig.motion, [column for many in rig.state.values() for column in many]
    assert motion is not None
    told = tell(frames, [columns.index(one.state) if one.state else None for one in motion.number])
    kind = ahead.kind or told.kind or motion.kind
    by = "--kind says" if ahead.kind else "the data tell" if told.kind else "the names say"
    said = [f"kind: {kind}, as {by}: {told.why()}"]
    if ahead.kind and told.against(kind):
        said = [told.warning(kind, "--kind")]
    elif not ahead.kind and told.kind is None:
        said = [f"kind: {kind}, as the names say; the data do not tell ({told.why()}), and --kind says it"]
    pairs = [columns.index(one.state) if one.state else None for one in motion.number]
    if told.kind in RELATIVE:
        pairs = [*told.pairs]
    number = tuple(
        msgspec.structs.replace(one, state="" if place is None or kind not in RELATIVE else columns[place])
        for one, place in zip(motion.number, pairs, strict=True)
    )
    settled = msgspec.structs.replace(motion, kind=kind, number=number)
    return msgspec.structs.replace(rig, motion=settled), {"by": by, "ratio": told.ratio, "said": said}


def _named(camera: str, choices: Choices) -> Column:
    """Return a camera by its short name, with the axis and the partner that are declared of it."""
    for one in () if choices.rig is None else choices.rig.camera:
        if one.name == _short(camera):
            return msgspec.structs.replace(one, column=camera)
    return Column(_short(camera), camera, choices.mirror)


def _require_cameras(data: Dataset, rig: Rig) -> None:
    """Raise SpecError where a rig names a camera that the bank has not, or a reflection leaves one out."""
    there, named = [_short(name) for name in data.reels], [one.name for one in rig.camera]
    for name in named:
        if name not in there:
            raise SpecError(f"--rig names a camera '{name}';{meant(name, there)} the bank has {', '.join(there)}")
    if rig.reflection is not None and (lacking := [name for name in there if name not in named]):
        raise SpecError(f"[reflection] of --rig needs the mirror_axis of every camera; '{lacking[0]}' is not named")


def _short(camera: str) -> str:
    """Return a camera's name without the words that all have, and of letters that a name may have."""
    return re.sub(r"[^\w-]", "_", re.sub(r"^observation\.(images?\.)?", "", camera)) or "camera"


def _labels(features: Mapping[str, Any], name: str) -> list[str]:
    """Return what the data set calls the components of a vector; their numbers where it has no such names."""
    feature, count = features.get(name, {}), len(_columns(features, name))
    names = feature.get("names")
    if isinstance(names, dict) and len(names) == 1:
        (names,) = names.values()
    if isinstance(names, list) and len(names) == 1 != count:
        (names,) = names
    if isinstance(names, list) and len({*map(str, names)}) == len(names) == count:
        return [*map(str, names)]
    return [f"{name}.{place}" for place in range(count)]


def _columns(features: Mapping[str, Any], name: str) -> tuple[str, ...]:
    """Return the columns of a feature's numbers; none where it has no feature of this name, or too many of them."""
    feature = features.get(name)
    if isinstance(feature, dict) and feature.get("shape") == [1]:
        return (name,)
    return dict(_vectors(features)).get(name, ())


def _clips(folder: Path, camera: str, template: str) -> dict[int, Clip]:
    clips = {}
    prefix, episodes = f"videos/{camera}", _files(folder, "meta/episodes")
    for row in chain.from_iterable(open_parquet(path, extra="lerobot").rows() for path in episodes):
        try:
            chunk, file = int(str(row[f"{prefix}/chunk_index"])), int(str(row[f"{prefix}/file_index"]))
            video = template.format(video_key=camera, chunk_index=chunk, file_index=file)
            clips[int(str(row["episode_index"]))] = Clip(video, float(str(row[f"{prefix}/from_timestamp"])))
        except (LookupError, ValueError, AttributeError) as error:
            raise SourceError(
                f"{folder / 'meta/episodes'}: an episode does not say where its video is: {error}"
            ) from error
    return clips


def _tasks(folder: Path) -> dict[int, str]:
    path = folder / "meta" / "tasks.parquet"
    if not path.is_file():
        return {}
    found = {}
    for row in open_parquet(path, extra="lerobot").rows():
        words = [value for name, value in row.items() if name != "task_index" and isinstance(value, str)]
        if isinstance(row.get("task_index"), int) and words:
            found[int(str(row["task_index"]))] = words[0]
    return found


def _instruction(data: Dataset) -> tuple[str, ...]:
    """Return the column of what a policy is told, none where the data set has no tasks.

    Raises SourceError where its rows have tasks and nobody has their words.
    """
    path, first = data.root / "meta" / "tasks.parquet", _files(data.root, "data")[0]
    if not data.tasks and "task_index" in open_parquet(first, extra="lerobot").columns:
        lacking = "holds no words of tasks" if path.is_file() else "does not exist"
        raise SourceError(
            f"{path} {lacking}, and every row has a task_index: without their words no policy is told what to do; "
            "download the data set again with its whole meta folder, or name what a policy is told with "
            "--prompt-columns"
        )
    return (TASK,) if data.tasks else ()


def _require_words(kept: Kept) -> None:
    """Note as a fault, once a task, where a row's task has no words."""
    first = {row.get("task_index"): where for row, where in reversed([*kept.named()]) if not row.get(TASK)}
    for number, where in reversed(first.items()):
        kept.faults.add(f"{where}: meta/tasks.parquet has no words of task {number}; download the data set again")


def _files(folder: Path, inner: str) -> list[Path]:
    paths = sorted((folder / inner).glob("chunk-*/file-*.parquet"))
    if not paths:
        raise SourceError(f"{folder / inner} holds no chunk-*/file-*.parquet: is the data set complete?")
    return paths


def _table(data: Dataset, reads: Progress | None, pictured: Sequence[str]) -> Table:
    """Return the rows of all data files, with what names each frame's picture in the columns ``pictured``."""
    vectors = dict(_vectors(data.features))
    files = [open_parquet(path, vectors=vectors, extra="lerobot") for path in _files(data.root, "data")]
    for place in ("episode_index", "frame_index"):
        if place not in files[0].columns:
            raise SourceError(f"{files[0].path} has no column '{place}', which every LeRobotDataset has")
    task = (TASK,) if data.tasks and TASK not in files[0].columns else ()
    count = sum(one.count for one in files)
    columns = (*pictured, *(name for name in files[0].columns if name not in pictured), *task)
    rows = _data_rows(data, files, count, reads)
    picture = "episode-{episode_index}/frame-{frame_index}.png"
    named = ({**row, **dict.fromkeys(pictured, picture.format_map(row))} for row in rows)
    return Table(data.root.resolve().name, columns, named, typed=True, count=count)


def _vectors(features: Mapping[str, Any]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the features that are short vectors, with the names of their components."""
    for name, feature in features.items():
        shape = feature.get("shape") if isinstance(feature, dict) else None
        if not isinstance(shape, list) or len(shape) != 1 or not isinstance(shape[0], int):
            continue
        if not 1 < shape[0] <= MOST_COMPONENTS or feature.get("dtype") in {"video", "image", "string"}:
            continue
        names = feature.get("names")
        given = names if isinstance(names, list) and len(set(map(str, names))) == shape[0] else range(shape[0])
        yield name, tuple(f"{name}.{one}" for one in given)


def _data_rows(data: Dataset, files: Sequence[ParquetTable], count: int, reads: Progress | None) -> Iterator[Row]:
    done = 0
    for file in files:
        if file.columns != files[0].columns:
            raise SourceError(f"{file.path} has other columns than {files[0].path}")
        for row in file.rows():
            done += 1
            if reads is not None and done % 5000 == 0:
                reads(done, count)
            task = {TASK: data.tasks.get(int(str(row.get("task_index", -1))), "")} if data.tasks else {}
            yield {**task, **row}


def _pictures(data: Dataset, rows: Sequence[int], frames: Sequence[Frame]) -> Iterator[Shown]:
    """Yield each frame with the pictures of its cameras; ``rows`` are the numbers of their rows."""
    reels = [reel.pictures(frames, rows) for reel in data.reels.values()]
    for frame, *pictures in zip(frames, *reels, strict=True):
        yield frame, {one.name: picture for one, picture in zip(frame.cameras, pictures, strict=True)}, {}
