"""A LeRobotDataset v3 becomes a bank: rows from its Parquet files, pictures from its videos.

Layout (github.com/huggingface/lerobot, ``src/lerobot/datasets``, codebase version v3.0): ``meta/info.json`` has the
features, the frames a second and the path templates; ``meta/episodes/chunk-*/file-*.parquet`` says for each episode in
which data file and, for each camera, in which video file and from which second on it lies; ``data/chunk-*/
file-*.parquet`` has a row a frame; ``meta/tasks.parquet`` the words of each task.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from eyechart.errors import BankError, SourceError
from eyechart.frames import MAIN, MAX_PIXELS, Frame, FrameBank, encode, inside
from eyechart.importing.bank import Choices, Shown, Source, cells_of, frames_of, keep, write
from eyechart.importing.cells import Progress, Row
from eyechart.importing.columns import PICTURED
from eyechart.importing.pages import MOST_COMPONENTS
from eyechart.importing.parquet import ParquetTable, open_parquet, require
from eyechart.importing.tables import Table

FILE = "file"
"""The column that names each frame's picture; the data set has none of its own."""
PLACES = {"file": FILE, "episode": "episode_index", "step": "frame_index"}
_SEEK_S = 2.0
"""A wanted frame so far ahead is looked up instead of decoded up to."""


@dataclass(frozen=True, slots=True)
class Clip:
    """Where an episode lies: its video's path in the data set, and the second at which it begins there."""

    video: str
    start_s: float


@dataclass(frozen=True)
class Dataset:
    """What the ``meta`` folder says: frames a second, the camera, its clips by episode, features, words of tasks."""

    root: Path
    fps: float
    camera: str
    clips: Mapping[int, Clip]
    features: Mapping[str, Any]
    tasks: Mapping[int, str]


def import_lerobot(
    folder: Path,
    out: Path,
    choices: Choices,
    *,
    camera: str | None = None,
    reads: Progress | None = None,
    progress: Progress | None = None,
) -> FrameBank:
    """Make a bank at ``out`` of one camera of a LeRobotDataset v3; episodes and steps are those of the data set.

    The columns are those of its data files; components of vectors come as ``observation.state.NAME`` (or ``.0``,
    ``.1``, …), the words of the task as ``task``. Raises SourceError, and leaves nothing at ``out``.
    """
    data = read_meta(folder, camera)
    if drawn := set(PICTURED) & choices.columns.keys():
        raise SourceError(f"--map {min(drawn)}=…: a LeRobotDataset holds no pictures with one thing changed")
    own = {"file", "episode", "step"} & choices.columns.keys()
    if own:
        raise SourceError(f"--map {min(own)}=…: a LeRobotDataset says itself which {min(own)} a frame is")
    chosen = replace(choices, columns={**dict.fromkeys(PICTURED, ""), **PLACES, **choices.columns})
    kept = keep(_table(data, reads), chosen)
    cells = cells_of(kept, chosen, lambda name, what: name)  # noqa: ARG005 - made here, so it leads nowhere else
    frames = frames_of(kept, chosen, cells)
    source = Source(folder, partial(_pictures, data), {"format": "lerobot v3", "camera": data.camera})
    return write(out, source, frames, kept=kept, choices=chosen, progress=progress)


def read_meta(folder: Path, camera: str | None) -> Dataset:
    """Read the ``meta`` folder; raises SourceError where it is none of version 3, or the camera is unknown."""
    path = folder / "meta" / "info.json"
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
        version, fps, features = str(info["codebase_version"]), float(info["fps"]), dict(info["features"])
        template = info.get("video_path")
    except FileNotFoundError as error:
        raise SourceError(f"{path} does not exist: is {folder} a LeRobotDataset?") from error
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise SourceError(f"{path} is no description of a LeRobotDataset: {error!r}") from error
    if not version.startswith("v3") or not math.isfinite(fps) or fps <= 0:
        raise SourceError(
            f"{path} says version {version} at {fps:g} frames a second; this reads v3, convert older ones"
        )
    chosen = _camera(features, camera, path)
    clips = _clips(folder, chosen, str(template))
    return Dataset(folder, fps, chosen, clips, features, _tasks(folder))


def _camera(features: Mapping[str, Any], camera: str | None, path: Path) -> str:
    cameras = [name for name, one in features.items() if isinstance(one, dict) and one.get("dtype") == "video"]
    if not cameras:
        raise SourceError(f"{path} lists no feature of dtype video; pictures kept inside Parquet are not read")
    if camera is None and len(cameras) > 1:
        raise SourceError(f"{path} lists several cameras; choose one with --camera: {', '.join(cameras)}")
    if camera is not None and camera not in cameras:
        raise SourceError(f"--camera {camera}: {path} lists no such camera; there are {', '.join(cameras)}")
    return camera or cameras[0]


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


def _files(folder: Path, inner: str) -> list[Path]:
    paths = sorted((folder / inner).glob("chunk-*/file-*.parquet"))
    if not paths:
        raise SourceError(f"{folder / inner} holds no chunk-*/file-*.parquet: is the data set complete?")
    return paths


def _table(data: Dataset, reads: Progress | None) -> Table:
    vectors = dict(_vectors(data.features))
    files = [open_parquet(path, vectors=vectors, extra="lerobot") for path in _files(data.root, "data")]
    for place in ("episode_index", "frame_index"):
        if place not in files[0].columns:
            raise SourceError(f"{files[0].path} has no column '{place}', which every LeRobotDataset has")
    task = ("task",) if data.tasks and "task" not in files[0].columns else ()
    count = sum(one.count for one in files)
    columns = (FILE, *(name for name in files[0].columns if name != FILE), *task)
    return Table(data.root.resolve().name, columns, _data_rows(data, files, count, reads), typed=True, count=count)


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
            name = f"episode-{row['episode_index']}/frame-{row['frame_index']}.png"
            task = {"task": data.tasks.get(int(str(row.get("task_index", -1))), "")} if data.tasks else {}
            yield {**task, **row, FILE: name}


def _pictures(data: Dataset, frames: Sequence[Frame]) -> Iterator[Shown]:
    """Yield each frame with its picture, video by video and in the order of time in each."""
    wanted: dict[str, list[tuple[float, Frame]]] = {}
    for frame in frames:
        clip = data.clips.get(int(frame.episode))
        if clip is None:
            raise SourceError(
                f"{data.root / 'meta/episodes'} has no episode {frame.episode}, of which the data has frames"
            )
        wanted.setdefault(clip.video, []).append((clip.start_s + frame.step / data.fps, frame))
    for video, times in wanted.items():
        try:
            path = inside(data.root, video)
        except BankError as error:
            raise SourceError(
                f"{data.root / 'meta/info.json'}: the video '{video}' leads outside the data set"
            ) from error
        yield from _decoded(path, sorted(times, key=lambda one: one[0]), 0.5 / data.fps)


def _decoded(path: Path, times: Sequence[tuple[float, Frame]], tolerance_s: float) -> Iterator[Shown]:
    av = require("av", "PyAV", "lerobot")
    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            if stream.width * stream.height > MAX_PIXELS:
                raise SourceError(f"{path} has {stream.width}×{stream.height} pixels; the limit is {MAX_PIXELS}")
            shown = _shown(container, stream)
            now, pixels = -math.inf, None
            for time_s, frame in times:
                if time_s - now > _SEEK_S:
                    container.seek(max(0, int((time_s - tolerance_s) / stream.time_base)), stream=stream)
                    shown, now = _shown(container, stream), -math.inf
                while now < time_s - tolerance_s:
                    now, pixels = next(shown, (math.inf, None))
                if pixels is None or abs(now - time_s) > tolerance_s:
                    raise SourceError(f"{path} shows nothing at {time_s:.3f} s, where frame '{frame.id}' should be")
                yield frame, {MAIN: encode(np.asarray(pixels.to_ndarray(format="rgb24"), dtype=np.uint8))}, {}
    except (av.FFmpegError, OSError, IndexError) as error:
        raise SourceError(f"{path} cannot be read as a video: {str(error).splitlines()[0]}") from error


def _shown(container: Any, stream: Any) -> Iterator[tuple[float, Any]]:  # noqa: ANN401 - of PyAV
    for picture in container.decode(stream):
        if picture.time is not None:
            yield float(picture.time), picture
