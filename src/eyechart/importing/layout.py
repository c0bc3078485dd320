"""The files of a LeRobotDataset v3, none of them outside of it, and what its ``meta`` folder says, in bounded memory.

Layout (github.com/huggingface/lerobot, ``src/lerobot/datasets``, codebase version v3.0):
``meta/info.json`` has the features, the frames a second and the path templates;
``meta/episodes/chunk-*/file-*.parquet`` says for each episode in which data file and, for each
camera, in which video file and from which second on it lies; ``data/chunk-*/ file-*.parquet`` has a
row a frame, and the pictures of cameras that have no video; ``meta/tasks.parquet`` the words of
each task.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Any

import msgspec

from eyechart.errors import SourceError, raising, read_at_most
from eyechart.importing.cells import Cell, Row, is_nothing
from eyechart.importing.pages import MOST_COMPONENTS
from eyechart.importing.parquet import open_parquet
from eyechart.importing.tables import MOST_COLUMNS

MOST_INFO = 4_000_000
"""Bytes of info.json; of a data set of a hundred features it has less than a hundredth of them."""
MOST_FILES = 100_000
"""Parquet files of one kind."""
MOST_CAMERAS = 64
SLOWEST, FASTEST = 1e-3, 1e5
"""Frames a second that a camera may take."""
MOST_SECONDS = 1e7
"""Seconds of one video; a hundred days."""
_CONVERTER = "lerobot.scripts.convert_dataset_v21_to_v30"
_TEXTS = {"video", "image", "string", "language"}
_EXACT = 2**53
_NAME = re.compile(r"\{(video_key|chunk_index|file_index)(?::0([1-9])d)?\}")


class Feature(msgspec.Struct, frozen=True):
    """A feature as info.json declares it; what names and shape are is for whoever reads them."""

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
        """Return whether its pictures are marked as depths, in one of the three places that LeRobot itself reads.

        That is ``is_depth_map`` or the older ``video.is_depth_map`` of ``info``, or the latter of
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
        """Return how many numbers it has along each axis; none where it is no array of numbers."""
        whole = isinstance(self.shape, list) and all(type(one) is int and one > 0 for one in self.shape)
        return tuple(self.shape) if whole and self.dtype not in _TEXTS else ()


class Info(msgspec.Struct, frozen=True):
    """What is read of info.json; the rest of it is skipped."""

    codebase_version: str
    fps: float
    features: dict[str, Feature]
    video_path: str | None = None


@dataclass(frozen=True, slots=True)
class Clip:
    """Where an episode lies: its video's path in the data set, and the seconds at which it begins and ends there."""

    video: str
    start_s: float
    end_s: float | None = None


@dataclass(frozen=True)
class Episodes:
    """What meta/episodes says: the length of each episode, None where it says none, and the clips of each camera."""

    lengths: Mapping[int, int | None]
    clips: Mapping[str, Mapping[int, Clip]]


@dataclass(frozen=True)
class Layout:
    """The folder of a data set; every file of it is opened by a path from here."""

    root: Path

    def file(self, inner: str) -> Path | None:
        """Return the path of a file, None where it is not there.

        Raises SourceError where it leads outside the data set, or is no plain file: a pipe would be
        waited for. A link may lead to any place inside the data set, and of a snapshot in the Hub's
        cache to its own ``blobs``.
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
                raise SourceError(f"{path} is no plain file")
        except (OSError, ValueError, RuntimeError) as error:  # a name too long, with a NUL, or a loop of links
            raise SourceError(f"{inner[:200]!r} is no file of the data set {self.root}: {str(error)[:200]}") from error
        return path

    def parquets(self, inner: str) -> list[Path]:
        """Return the Parquet files of a kind, in order; raises SourceError where there is none."""
        found = sorted(islice((self.root / inner).glob("chunk-*/file-*.parquet"), MOST_FILES + 1))
        if not found:
            raise SourceError(f"{self.root / inner} holds no chunk-*/file-*.parquet: is the data set complete?")
        if len(found) > MOST_FILES:
            raise SourceError(f"{self.root / inner} holds more than {MOST_FILES} files")
        named = [(path, self.file(path.relative_to(self.root).as_posix())) for path in found]
        if lacking := [path for path, there in named if there is None]:
            raise SourceError(f"{lacking[0]} is a link to nothing: download the data set again")
        return found

    def info(self) -> Info:
        """Return what info.json says; raises SourceError where it is none of version 3, or says what cannot be."""
        path = self.root / "meta" / "info.json"
        if self.file("meta/info.json") is None:
            raise SourceError(f"{path} does not exist: {_where(self.root)}")
        wrong = f"{path} is no description of a LeRobotDataset"
        raw = read_at_most(path, MOST_INFO, SourceError, "the description of a data set")
        with raising(SourceError, wrong, of=(msgspec.MsgspecError, ValueError, RecursionError)):
            info = msgspec.json.decode(raw, type=Info)
        if not re.match(r"v3(\.|$)", info.codebase_version):
            convert = f"'python -m {_CONVERTER} --repo-id=OWNER/NAME --root={self.root} --push-to-hub=false'"
            raise SourceError(
                f"{path} says version {info.codebase_version[:20]}, and this reads v3; LeRobot's own converter makes "
                f"v3 of v2.1: {convert} (in older versions of LeRobot the module stands in lerobot.datasets.v30)"
            )
        if not SLOWEST <= info.fps <= FASTEST:
            raise SourceError(f"{path} says {info.fps:g} frames a second, which is no rate of a camera")
        if len(info.features) > MOST_COLUMNS:
            raise SourceError(f"{path} lists {len(info.features)} features; the limit is {MOST_COLUMNS}")
        return info

    def episodes(self, cameras: Sequence[str], template: str | None) -> Episodes:
        """Return what meta/episodes says of episodes, and where the ``cameras``' videos lie, by a path ``template``.

        A camera of which it says nothing has no clips. Raises SourceError where a cell is wrong, or
        an episode stands there twice with two places.
        """
        where, lengths, clips = (
            self.root / "meta/episodes",
            dict[int, int | None](),
            {one: dict[int, Clip]() for one in cameras},
        )
        files = self.parquets("meta/episodes")
        for row in chain.from_iterable(open_parquet(path, extra="lerobot").rows() for path in files):
            episode = _number(row, "episode_index", where)
            length = None if row.get("length") is None else _number(row, "length", where)
            if lengths.setdefault(episode, length) is None:
                lengths[episode] = length
            elif length is not None:
                _once(lengths, episode, length, f"{where}: the length of episode {episode}")
            for camera, found in clips.items():
                clip = _clip(row, camera, template, where)
                if clip is not None:
                    _once(found, episode, clip, f"{where}: the place of episode {episode} in the videos of '{camera}'")
        _require_own(clips, self.root)
        return Episodes(lengths, clips)

    def tasks(self) -> dict[int, str]:
        """Return the words of each task; none where there is no file of them."""
        path = self.file("meta/tasks.parquet")
        found: dict[int, str] = {}
        for row in () if path is None else open_parquet(path, extra="lerobot").rows():
            if (words := _words(row, str(path))) is None:
                continue
            number = whole(row.get("task_index"))
            if number is None:
                cell = row.get("task_index")
                raise SourceError(f"{path}: '{words[:60]}' has the task_index {cell!r}, no whole number of 0 or more")
            _once(found, number, words, f"{path}: the words of task {number}")
        return found


def _words(row: Row, where: str) -> str | None:
    """Return the words of a row of meta/tasks, by the names that LeRobot gives their column, else its only words."""
    named = [row[name] for name in ("task", "__index_level_0__") if isinstance(row.get(name), str)]
    found = dict.fromkeys(named or [cell for name, cell in row.items() if name != "task_index"])
    words = [one for one in found if isinstance(one, str) and not is_nothing(one)]
    if len(words) > 1:
        raise SourceError(
            f"{where}: task {row.get('task_index')} has several words, '{words[0][:60]}' and '{words[1][:60]}': call "
            "the column of what a policy is told 'task'"
        )
    return words[0] if words else None


def whole(cell: Cell) -> int | None:
    """Return a cell as a whole number of 0 or more that is exact, None where it is none."""
    if isinstance(cell, bool | str) or cell is None or not 0 <= cell <= _EXACT or cell != int(cell):
        return None
    return int(cell)


def vectors_of(features: Mapping[str, Feature]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the features that are short vectors, with the names of their components."""
    for name, feature in features.items():
        if len(feature.size) == 1 and 1 < feature.size[0] <= MOST_COMPONENTS:
            count, names = feature.size[0], feature.names
            given = names if isinstance(names, list) and len(set(map(str, names))) == count else range(count)
            yield name, tuple(f"{name}.{one}" for one in given)


def video_of(template: str | None, camera: str, chunk: int, file: int) -> str:
    """Return the path of a video by info.json's template; raises ValueError where that is none.

    Only its three names are replaced, each with up to nine digits: a template of another's is no
    format of Python.
    """
    if not template:
        raise ValueError("it is missing, and the episodes have videos")
    values = {"video_key": camera, "chunk_index": chunk, "file_index": file}
    if "{" in (rest := _NAME.sub("", template)) or "}" in rest or "{video_key:" in template:
        raise ValueError(f"'{template[:200]}' is no path with video_key, chunk_index and file_index in braces")
    return _NAME.sub(lambda found: str(values[found[1]]).zfill(int(found[2] or 0)), template)


def _blobs(home: Path) -> Iterator[Path]:
    """Yield the folder that a snapshot of the Hub's cache may link to: ``datasets--*/snapshots/REVISION`` is one."""
    for one in (home, *home.parents):
        if one.parent.name == "snapshots" and one.parent.parent.name.startswith("datasets--"):
            yield one.parent.parent / "blobs"
            return


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


def _number(row: Mapping[str, Cell], name: str, where: Path) -> int:
    found = whole(row.get(name))
    if found is None:
        raise SourceError(f"{where}: '{name}' is {_quoted(row.get(name))}, not a whole number of 0 or more")
    return found


def _quoted(cell: Cell) -> str:
    return "empty" if cell is None else repr(cell)[:60]


def _once(found: dict[int, Any], number: int, value: object, what: str) -> None:
    """Take note of what a number has; raises SourceError where it has something else already."""
    if found.setdefault(number, value) != value:
        raise SourceError(f"{what} stands there twice, and not alike: which of both is right? Leave out the other")


def _clip(row: Mapping[str, Cell], camera: str, template: str | None, where: Path) -> Clip | None:
    """Return where a row of meta/episodes says that a camera's video lies, None where it says nothing of the camera."""
    names = {one: f"videos/{camera}/{one}" for one in ("chunk_index", "file_index", "from_timestamp", "to_timestamp")}
    if all(row.get(name) is None for name in names.values()):
        return None
    chunk, file = (_number(row, names[one], where) for one in ("chunk_index", "file_index"))
    start, end = (_seconds(row, names[one], where) for one in ("from_timestamp", "to_timestamp"))
    if start is None:
        raise SourceError(f"{where}: an episode does not say where its video is: '{names['from_timestamp']}' is empty")
    with raising(SourceError, f"{where.parent / 'info.json'}: video_path", of=ValueError):
        return Clip(video_of(template, camera, chunk, file), start, end)


def _seconds(row: Mapping[str, Cell], name: str, where: Path) -> float | None:
    cell = row.get(name)
    if cell is None:
        return None
    if isinstance(cell, bool | str) or not 0 <= cell <= MOST_SECONDS:
        raise SourceError(f"{where}: '{name}' is {_quoted(cell)}, which is no second of a video")
    return float(cell)


def _require_own(clips: Mapping[str, Mapping[int, Clip]], root: Path) -> None:
    """Raise SourceError where two cameras lie in one video: what each shows would be the other's."""
    owner: dict[str, str] = {}
    for camera, found in clips.items():
        for video in {one.video for one in found.values()}:
            if (other := owner.setdefault(video, camera)) != camera:
                raise SourceError(
                    f"{root / 'meta/info.json'}: the cameras '{other}' and '{camera}' lie in one video '{video}'"
                )


def given_name(folder: Path) -> str:
    """Return the name of a folder as it was given, also where it is a link to a folder of another name."""
    return folder.absolute().name if folder.name != ".." else folder.resolve().name
