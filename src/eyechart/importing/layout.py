"""The files of a LeRobotDataset, with no access outside of it, and its ``meta`` folder.

Layout of version 3 (github.com/huggingface/lerobot, ``src/lerobot/datasets``):

- ``meta/info.json`` has the features, the frames a second and the path templates.
- ``meta/episodes/chunk-*/file-*.parquet`` has, for each episode, its data file and, for each
  camera, its video file and first second there.
- ``data/chunk-*/file-*.parquet`` has a row a frame, and the pictures of cameras without video.
- ``meta/tasks.parquet`` has the words of each task.

Versions 2.0 and 2.1 have the same features and rows, but each episode has its own data file, and
its own video for each camera. ``meta/episodes.jsonl`` and ``meta/tasks.jsonl`` have the rest.
GR00T writes version 2 with a ``meta/modality.json``, and without a column ``frame_index``.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import Annotated, Any, ClassVar

import msgspec

from eyechart.errors import SourceError, raising, read_at_most
from eyechart.importing.cells import Cell, Row, is_nothing, quoted
from eyechart.importing.pages import MOST_COMPONENTS
from eyechart.importing.parquet import listed_texts, open_parquet
from eyechart.importing.tables import MOST_COLUMNS

MOST_INFO = 4_000_000
"""Bytes of info.json; a data set of a hundred features has less than a hundredth of them."""
MOST_FILES = 100_000
"""Parquet files of one kind."""
MOST_CAMERAS = 64
SLOWEST, FASTEST = 1e-3, 1e5
"""The slowest and the fastest rate of a camera, in frames a second."""
MOST_SECONDS = 1e7
"""Seconds of one video; a hundred days."""
MOST_LINES = 64_000_000
"""Bytes of a file of lines in ``meta``; a hundred thousand episodes need a third of them."""
_TEXTS = {"video", "image", "string", "language"}
_EXACT = 2**53
_NAME = re.compile(r"\{(video_key|chunk_index|file_index|episode_chunk|episode_index)(?::0([1-9])d)?\}")


class Feature(msgspec.Struct, frozen=True):
    """A feature as info.json declares it; names and shape are checked where they are used."""

    dtype: str = ""
    shape: Any = None
    names: Any = None
    info: Any = None
    video_info: Any = None

    @property
    def is_picture(self) -> bool:
        """Return whether it is a camera's."""
        return self.dtype in {"video", "image"}

    @property
    def is_depth(self) -> bool:
        """Return whether its pictures are marked as depths, in any place that LeRobot reads.

        These are ``is_depth_map`` or the older ``video.is_depth_map`` of ``info``, or the latter of
        ``video_info``.
        """
        marks = (
            (self.info, "is_depth_map"),
            (self.info, "video.is_depth_map"),
            (self.video_info, "video.is_depth_map"),
        )
        return any(isinstance(one, dict) and bool(one.get(name)) for one, name in marks)

    @property
    def is_grey(self) -> bool:
        """Return whether its pictures have one channel."""
        return isinstance(self.shape, list) and len(self.shape) == 3 and 1 in (self.shape[0], self.shape[2])

    @property
    def size(self) -> tuple[int, ...]:
        """Return the numbers along each axis, empty if it is no array of numbers."""
        whole = isinstance(self.shape, list) and all(type(one) is int and one > 0 for one in self.shape)
        return tuple(self.shape) if whole and self.dtype not in _TEXTS else ()


class Info(msgspec.Struct, frozen=True):
    """The parts of info.json that are read."""

    codebase_version: str
    fps: float
    features: dict[str, Feature]
    video_path: str | None = None
    chunks_size: Annotated[int, msgspec.Meta(ge=1)] = 1000

    @property
    def is_of_episodes(self) -> bool:
        """Return whether each episode has its own files, as in version 2."""
        return self.codebase_version.startswith("v2.")


@dataclass(frozen=True, slots=True)
class Clip:
    """An episode's video in the data set, and the seconds of its beginning and end there."""

    video: str
    start_s: float
    end_s: float | None = None


@dataclass(frozen=True)
class EpisodeTable:
    """The length of each episode, None if unknown, the clips of each camera, and listed tasks.

    ``tasks`` has the words of each episode's tasks, as far as they are listed.
    """

    lengths: Mapping[int, int | None]
    clips: Mapping[str, Mapping[int, Clip]]
    tasks: Mapping[int, Sequence[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class DataSetLayout:
    """The folder of a data set of version 3, through which every file of it is opened.

    ``EPISODES`` and ``TASKS`` are the places of both descriptions, ``DATA`` is the pattern of data
    files.
    """

    EPISODES: ClassVar = "meta/episodes"
    TASKS: ClassVar = "meta/tasks.parquet"
    DATA: ClassVar = "chunk-*/file-*.parquet"

    root: Path

    def file(self, inner: str) -> Path | None:
        """Return the path of a file, None if it does not exist.

        Raises SourceError if the path leads outside the data set, or is no regular file: reading a
        pipe would block. A link may lead to any place inside the data set. In a snapshot of the
        Hub's cache it may also lead to the cache's own ``blobs``.
        """
        path = self.root / inner
        try:
            home, real = self.root.resolve(), path.resolve()
            outside = Path(inner).is_absolute() or ".." in Path(inner).parts
            if outside or not any(real.is_relative_to(one) for one in (home, *_blobs(home))):
                raise SourceError(f"{path} leads outside the data set {self.root}; copy what it links to into it")
            if not real.exists():
                return None
            if not real.is_file():
                raise SourceError(f"{path} is not a regular file")
        except (OSError, ValueError, RuntimeError) as error:  # a name too long, with a NUL, or a loop of links
            raise SourceError(f"{inner[:200]!r} is no file of the data set {self.root}: {str(error)[:200]}") from error
        return path

    def parquets(self, inner: str) -> list[Path]:
        """Return the Parquet files of a kind, in order; raises SourceError if there is none."""
        paths = sorted(islice((self.root / inner).glob(self.DATA), MOST_FILES + 1))
        if not paths:
            raise SourceError(f"{self.root / inner} has no {self.DATA}: is the data set complete?")
        if len(paths) > MOST_FILES:
            raise SourceError(f"{self.root / inner} holds more than {MOST_FILES} files")
        named = [(path, self.file(path.relative_to(self.root).as_posix())) for path in paths]
        if lacking := [path for path, there in named if there is None]:
            raise SourceError(f"{lacking[0]} is a link to nothing: download the data set again")
        return paths

    def info(self) -> Info:
        """Return info.json; raises SourceError for another version than 2 or 3, or impossible values."""
        path = self.root / "meta" / "info.json"
        if self.file("meta/info.json") is None:
            raise SourceError(f"{path} does not exist: {_where(self.root)}")
        wrong = f"{path} is no description of a LeRobotDataset"
        raw = read_at_most(path, MOST_INFO, SourceError, "the description of a data set")
        with raising(SourceError, wrong, of=(msgspec.MsgspecError, ValueError, RecursionError)):
            info = msgspec.json.decode(raw, type=Info)
        if not re.match(r"v(3|2\.[01])(\.|$)", info.codebase_version):
            raise SourceError(
                f"{path} has version {info.codebase_version[:20]}, but eyechart reads v2.0, v2.1 and v3: convert it "
                "with the LeRobot that wrote it"
            )
        if not SLOWEST <= info.fps <= FASTEST:
            raise SourceError(f"{path} gives {info.fps:g} frames a second, which is not a camera's rate")
        if len(info.features) > MOST_COLUMNS:
            raise SourceError(f"{path} lists {len(info.features)} features; the limit is {MOST_COLUMNS}")
        return info

    def episodes(self, cameras: Sequence[str], info: Info) -> EpisodeTable:
        """Return the episodes' lengths, and the places of the ``cameras``' videos.

        A camera without entries has no clips. Raises SourceError for a faulty cell, or an episode
        with two different places.
        """
        where, lengths, clips = (
            self.root / self.EPISODES,
            dict[int, int | None](),
            {one: dict[int, Clip]() for one in cameras},
        )
        files = self.parquets(self.EPISODES)
        for row in chain.from_iterable(open_parquet(path, extra="lerobot").rows() for path in files):
            episode = _number(row, "episode_index", where)
            length = None if row.get("length") is None else _number(row, "length", where)
            if lengths.setdefault(episode, length) is None:
                lengths[episode] = length
            elif length is not None:
                once(lengths, episode, length, f"{where}: the length of episode {episode}")
            for camera, found in clips.items():
                clip = _clip(row, camera, info.video_path, where)
                if clip is not None:
                    once(found, episode, clip, f"{where}: the place of episode {episode} in the videos of '{camera}'")
        require_own(clips, self.root)
        return EpisodeTable(lengths, clips, self._tasks_of(files))

    def _tasks_of(self, files: Sequence[Path]) -> dict[int, list[str]]:
        """Return the words of each episode's tasks; raises SourceError for too many."""
        result, count = dict[int, list[str]](), 0
        for path in files:
            for episode, texts in listed_texts(path, "episode_index", "tasks", extra="lerobot"):
                result[episode] = texts
                count += sum(map(len, texts))
                if count > MOST_LINES:
                    raise SourceError(f"{path}: the tasks have more than {MOST_LINES} characters in all")
        return result

    def task_column(self, columns: Sequence[str]) -> str:  # noqa: ARG002 - that GR00T has others
        """Return which of the data files' ``columns`` has the number of a row's task."""
        return "task_index"

    def tasks(self) -> dict[int, str]:
        """Return the words of each task; empty without their file."""
        path = self.file(self.TASKS)
        result: dict[int, str] = {}
        for row in () if path is None else open_parquet(path, extra="lerobot").rows():
            if (words := _words(row, str(path))) is None:
                continue
            number = whole(row.get("task_index"))
            if number is None:
                cell = row.get("task_index")
                raise SourceError(
                    f"{path}: '{words[:60]}' has the task_index {cell!r}, not a whole number of 0 or more"
                )
            once(result, number, words, f"{path}: the words of task {number}")
        return result


def _words(row: Row, where: str) -> str | None:
    """Return a task's words, by the names that LeRobot gives their column, or its only words."""
    named = [row[name] for name in ("task", "__index_level_0__") if isinstance(row.get(name), str)]
    found = dict.fromkeys(named or [cell for name, cell in row.items() if name != "task_index"])
    words = [one for one in found if isinstance(one, str) and not is_nothing(one)]
    if len(words) > 1:
        raise SourceError(
            f"{where}: task {row.get('task_index')} has several words, '{words[0][:60]}' and '{words[1][:60]}': name "
            "the instruction's column 'task'"
        )
    return words[0] if words else None


def whole(cell: Cell) -> int | None:
    """Return a cell as an exact whole number of 0 or more, None if it is none."""
    if isinstance(cell, bool | str) or cell is None or not 0 <= cell <= _EXACT or cell != int(cell):
        return None
    return int(cell)


def vectors_of(features: Mapping[str, Feature]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the features that are short vectors, with their components' names."""
    for name, feature in features.items():
        if len(feature.size) == 1 and 1 < feature.size[0] <= MOST_COMPONENTS:
            count, names = feature.size[0], feature.names
            given = names if isinstance(names, list) and len(set(map(str, names))) == count else range(count)
            yield name, tuple(f"{name}.{one}" for one in given)


def columns_of(features: Mapping[str, Feature]) -> dict[str, tuple[str, ...]]:
    """Return the columns of every feature of few numbers; one number, also in a list, is its own."""
    alone = {name: (name,) for name, feature in features.items() if feature.size == (1,)}
    return alone | dict(vectors_of(features))


def video_of(template: str | None, camera: str, **places: int) -> str:
    """Return a video's path by info.json's template; raises ValueError for a faulty template.

    Only ``video_key`` and the names of ``places`` are replaced, each with up to nine digits. A
    foreign template is never used as a Python format.
    """
    if not template:
        raise ValueError("it is missing, and the episodes have videos")
    values = {"video_key": camera, **places}
    rest = _NAME.sub(lambda found: "" if found[1] in values else "{", template)
    if "{" in rest or "}" in rest or "{video_key:" in template:
        *some, last = values
        raise ValueError(f"'{template[:200]}' is no path with {', '.join(some)} and {last} in braces")
    return _NAME.sub(lambda found: str(values[found[1]]).zfill(int(found[2] or 0)), template)


def _blobs(home: Path) -> Iterator[Path]:
    """Yield the ``blobs`` to which a Hub snapshot, ``datasets--*/snapshots/REVISION``, may link."""
    for one in (home, *home.parents):
        if one.parent.name == "snapshots" and one.parent.parent.name.startswith("datasets--"):
            yield one.parent.parent / "blobs"
            return


def _where(folder: Path) -> str:
    """Return a hint for a folder that is no data set: a Hub name was given, or another folder."""
    if folder.exists() or not re.fullmatch(r"[\w.-]+/[\w.-]+", folder.as_posix()):
        return f"is {folder} a LeRobotDataset?"
    name = folder.as_posix()
    kept = (
        f"~/.cache/huggingface/lerobot, or $HF_LEROBOT_HOME: {name} in it, or hub/datasets--{name.replace('/', '--')}"
    )
    return (
        f"there is no folder '{name}'; for a data set of the Hub give its folder: LeRobot keeps downloads in "
        f"{kept}/snapshots; 'hf download {name} --repo-type dataset --local-dir {folder.name}' fetches it"
    )


def _number(row: Mapping[str, Cell], name: str, where: Path) -> int:
    result = whole(row.get(name))
    if result is None:
        raise SourceError(f"{where}: '{name}' is {quoted(row.get(name))}, not a whole number of 0 or more")
    return result


def once(found: dict[int, Any], number: int, value: object, what: str) -> None:
    """Record a number's value; raises SourceError if it has another value already."""
    if found.setdefault(number, value) != value:
        raise SourceError(f"{what}: there are two different values; leave out the wrong one")


def _clip(row: Mapping[str, Cell], camera: str, template: str | None, where: Path) -> Clip | None:
    """Return the clip of a camera in a row of meta/episodes, None if the row has none."""
    names = {one: f"videos/{camera}/{one}" for one in ("chunk_index", "file_index", "from_timestamp", "to_timestamp")}
    if all(row.get(name) is None for name in names.values()):
        return None
    chunk, file = (_number(row, names[one], where) for one in ("chunk_index", "file_index"))
    start, end = (_seconds(row, names[one], where) for one in ("from_timestamp", "to_timestamp"))
    if start is None:
        raise SourceError(f"{where}: an episode has no place of its video: '{names['from_timestamp']}' is empty")
    with raising(SourceError, f"{where.parent / 'info.json'}: video_path", of=ValueError):
        return Clip(video_of(template, camera, chunk_index=chunk, file_index=file), start, end)


def _seconds(row: Mapping[str, Cell], name: str, where: Path) -> float | None:
    cell = row.get(name)
    if cell is None:
        return None
    if isinstance(cell, bool | str) or not 0 <= cell <= MOST_SECONDS:
        raise SourceError(f"{where}: '{name}' is {quoted(cell)}, not a second of a video")
    return float(cell)


def require_own(clips: Mapping[str, Mapping[int, Clip]], root: Path) -> None:
    """Raise SourceError if two cameras share a video: each would show the other's pictures."""
    owner: dict[str, str] = {}
    for camera, found in clips.items():
        for video in {one.video for one in found.values()}:
            if (other := owner.setdefault(video, camera)) != camera:
                raise SourceError(
                    f"{root / 'meta/info.json'}: the cameras '{other}' and '{camera}' share the video '{video}'"
                )


def given_name(folder: Path) -> str:
    """Return a folder's name as it was given, even if it is a link to another name."""
    return folder.absolute().name if folder.name != ".." else folder.resolve().name
