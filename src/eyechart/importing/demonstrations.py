"""Imports of demonstrations in HDF5, as robomimic, LIBERO and ACT (ALOHA) write them.

- robomimic: ``data/demo_N`` is an episode, with ``actions`` and the observations ``obs/NAME``;
  pictures have names such as ``agentview_image``. The attribute ``env_args`` of ``data`` is JSON.
- LIBERO: as robomimic, with ``obs/agentview_rgb`` and ``obs/eye_in_hand_rgb``. The attribute
  ``problem_info`` of ``data`` is JSON with the ``language_instruction``.
- ACT: a file is an episode, with ``action``, ``observations/qpos`` and
  ``observations/images/NAME``. With ``compress_len``, each picture is a padded JPEG.

The field names are those that these projects write, as far as they are known here. No file that
one of them wrote was read in a test.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby, islice
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from eyechart.errors import SourceError, printable, raising
from eyechart.frames import MAX_PIXELS, Frame, FrameBank, encode
from eyechart.importing.bank import Choices
from eyechart.importing.cells import Row
from eyechart.importing.hdf5 import Hdf5Array, Hdf5Group, opened
from eyechart.importing.layout import (
    FASTEST,
    MOST_CAMERAS,
    MOST_FILES,
    SLOWEST,
    DataSetLayout,
    EpisodeTable,
    Feature,
    Info,
    columns_of,
    given_name,
    vectors_of,
)
from eyechart.importing.lerobot import FILE, TASK, Dataset, RowTable, chosen_cameras, import_lerobot, usual
from eyechart.importing.pages import BATCH_ROWS
from eyechart.importing.tables import MOST_COLUMNS
from eyechart.importing.timeline import PLACES, Timeline
from eyechart.importing.videos import Picture, Reel, plain_picture
from eyechart.records import parse_json

ENDINGS = (".hdf5", ".h5")
STATES: Mapping[str, Sequence[str]] = {
    "robomimic": ("robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos"),
    "LIBERO": ("gripper_states", "joint_states"),
    "ACT": ("qpos",),
}
"""The observations that are a policy's state if the user names none."""
ACTIONS = {"robomimic": "actions", "LIBERO": "actions", "ACT": "action"}
_OWN = (*PLACES.values(), "task_index", TASK, FILE)
"""The columns that an import makes itself."""
_ROWS_OF_PICTURE = 4
"""The axes of an array of pictures: row, height, width, channel."""


@dataclass(frozen=True)
class Demonstration:
    """An episode: its file and group, its length, and the number of its instruction."""

    path: Path
    group: str
    length: int
    task: int | None


@dataclass(frozen=True)
class Contents:
    """What one episode holds: numbers and pictures by name, and each one's place in its group.

    ``beside`` has the other actions, which are not read.
    """

    features: Mapping[str, Feature]
    places: Mapping[str, tuple[str, ...]]
    length: int
    beside: set[str]


@dataclass(frozen=True)
class Demonstrations(Dataset):
    """The demonstrations of one or more HDF5 files; ``program`` wrote them."""

    program: str = ""
    episodes_of: Sequence[Demonstration] = ()
    places: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def about(self) -> Path:
        """Return its first file, for messages."""
        return self.episodes_of[0].path

    @property
    def format(self) -> str:
        """Return its format and the program that wrote it."""
        return f"hdf5 {self.program}"

    def tables(self) -> Sequence[RowTable]:
        """Return the files in order."""
        runs = groupby(enumerate(self.episodes_of), key=lambda one: one[1].path)
        return [DemonstrationTable(self, path, [*many]) for path, many in runs]

    def is_observed(self, name: str) -> bool:
        """Return whether a feature is of the observation."""
        return name != ACTIONS[self.program]

    def usual(self) -> tuple[Sequence[str], Sequence[str]]:
        """Return the usual state and action of its program."""
        numbers = [name for name in STATES[self.program] if usual(self.features, [name])]
        return numbers, usual(self.features, [ACTIONS[self.program]])


@dataclass(frozen=True)
class DemonstrationTable:
    """The rows of one file's demonstrations, with their numbers in the whole data set."""

    data: Demonstrations
    path: Path
    many: Sequence[tuple[int, Demonstration]]

    @property
    def columns(self) -> tuple[str, ...]:
        """Return the columns of its rows."""
        task = (self.data.task,) if self.data.tasks else ()
        return (*PLACES.values(), *task, *(column for columns in self._vectors().values() for column in columns))

    @property
    def count(self) -> int:
        """Return the number of its rows."""
        return sum(one.length for _, one in self.many)

    def rows(self) -> Iterator[Row]:
        """Yield its rows in order, `BATCH_ROWS` in memory at a time."""
        vectors = self._vectors()
        with opened(self.path) as file:
            for number, one in self.many:
                arrays = {name: array_of(file, one, self.data.places[name]) for name in vectors}
                task = {} if one.task is None else {self.data.task: one.task}
                for start in range(0, one.length, BATCH_ROWS):
                    stop = min(start + BATCH_ROWS, one.length)
                    cells: dict[str, list[float]] = {}
                    for name, columns in vectors.items():
                        block = arrays[name].rows(start, stop).astype(float).reshape(stop - start, len(columns))
                        cells |= dict(zip(columns, block.T.tolist(), strict=True))
                    for place in range(stop - start):
                        where = dict(zip(PLACES.values(), (number, start + place), strict=True))
                        yield {**where, **task, **{name: many[place] for name, many in cells.items()}}

    def _vectors(self) -> dict[str, tuple[str, ...]]:
        return columns_of(self.data.features)


@dataclass(frozen=True)
class StoredPictures:
    """One camera's pictures in the files."""

    episodes: Sequence[Demonstration]
    place: tuple[str, ...]

    def pictures(self, frames: Sequence[Frame], rows: Sequence[int]) -> Iterator[Picture]:  # noqa: ARG002 - of `Reel`
        """Yield each frame's picture as PNG; a JPEG that cannot be read is missing."""
        for path, run in groupby(frames, key=lambda frame: self.episodes[int(frame.episode)].path):
            with opened(path) as file:
                for number, many in groupby(run, key=lambda frame: int(frame.episode)):
                    array = array_of(file, self.episodes[number], self.place)
                    for frame in many:
                        yield _shown(array.rows(frame.step, frame.step + 1)[0], f"{self.place[-1]} of {frame.id}")


def import_hdf5(folder: Path, out: Path, choices: Choices, *, rate: float | None = None, **options: Any) -> FrameBank:  # noqa: ANN401 - as of `import_lerobot`
    """Make a bank at ``out`` of demonstrations in HDF5: one file, or a folder of them.

    ``rate`` is the number of frames a second, which is needed if the files do not have it. The
    ``options`` are those of `eyechart.importing.lerobot.import_lerobot`. Raises SourceError, and
    leaves nothing at ``out``.
    """
    return import_lerobot(folder, out, choices, read=partial(read_demonstrations, rate=rate), **options)


def read_demonstrations(
    folder: Path, camera: str | None, *, every: bool = False, rate: float | None = None
) -> Demonstrations:
    """Read what the files hold; raises SourceError for another layout or for a contradiction."""
    found, said, tasks = list[Demonstration](), list[str](), dict[str, int]()
    first, program, rates, beside = None, "", set[float | None](), set[str]()
    for path in hdf5_files(folder):
        with opened(path) as file:
            own = _program(file)
            program = program or own
            if own != program:
                raise SourceError(f"{path} is of {own}, but the files before it are of {program}")
            rates.add(_rate_in(file))
            words = _instruction(file) if own == "LIBERO" else ""
            task = tasks.setdefault(words, len(tasks)) if words else None
            for group in _episodes(file, own):
                contents = _contents(group, own)
                beside |= contents.beside
                first = first or contents
                _require_same(first, contents, group.label)
                found.append(Demonstration(path, group.name, contents.length, task))
    if first is None:
        raise SourceError(f"{folder} has no demonstration")
    if tasks and any(one.task is None for one in found):
        raise SourceError(f"{folder}: some files have a language_instruction, and others have none")
    fps, root = _rate(rates, rate, folder), folder if folder.is_dir() else folder.parent
    info = Info("hdf5", fps, dict(first.features))
    reels = {name: StoredPictures(found, first.places[name]) for name in _cameras(info, folder, camera, said, every)}
    said += [f"left out, beside '{ACTIONS[program]}': '{printable(name)}'" for name in sorted(beside)]
    if program != "ACT":
        said.append("pictures are as they are stored: those of robosuite may be upside down")
    return Demonstrations(
        DataSetLayout(root),
        info,
        dict[str, Reel](reels),
        EpisodeTable({number: one.length for number, one in enumerate(found)}, {}),
        {number: words for words, number in tasks.items()},
        Timeline(given_name(folder), fps, ["task_index"] if tasks else [], []),
        said=said,
        program=program,
        episodes_of=found,
        places=first.places,
    )


def hdf5_files(folder: Path) -> list[Path]:
    """Return the file itself, or the HDF5 files in a folder by name, with numbers in their order.

    Raises SourceError if there is none, or if one leads outside the folder.
    """
    if not folder.is_dir():
        return [folder]
    paths = [*islice((one for one in folder.iterdir() if one.suffix.lower() in ENDINGS), MOST_FILES + 1)]
    if not paths:
        raise SourceError(f"{folder} has no file that ends in {' or '.join(ENDINGS)}")
    if len(paths) > MOST_FILES:
        raise SourceError(f"{folder} has more than {MOST_FILES} files")
    layout = DataSetLayout(folder)
    for path in paths:
        if layout.file(path.name) is None:
            raise SourceError(f"{path} is a link to nothing")
    return sorted(paths, key=lambda path: _in_order(path.name))


def array_of(file: Hdf5Group, one: Demonstration, place: Sequence[str]) -> Hdf5Array:
    """Return an array of an episode; raises SourceError without it."""
    group: Hdf5Group | None = file
    for name in [*filter(None, one.group.split("/")), *place[:-1]]:
        group = None if group is None else group.child(name)
    array = None if group is None else group.array(place[-1])
    if array is None or array.shape[0] != one.length:
        raise SourceError(f"{one.path}: '{one.group}' has no array {'/'.join(place)} of {one.length} rows")
    return array


def _in_order(name: str) -> list[tuple[int, str]]:
    """Return a key that sorts names with their numbers by value: demo_2 before demo_10."""
    parts = re.findall(r"\d+|\D+", name)
    return [(int(part), "") if part.isdecimal() and len(part) < 20 else (-1, part) for part in parts]


def _program(file: Hdf5Group) -> str:
    """Return the program whose layout a file has; raises SourceError for another layout."""
    names = file.members()
    data = file.child("data")
    if data is not None and any(name.startswith("demo_") for name in data.members()):
        return "LIBERO" if data.has_attribute("problem_info") else "robomimic"
    if {"observations", "action"} <= {*names}:
        return "ACT"
    has = ", ".join(printable(name) for name in names[:20])
    raise SourceError(
        f"{file.path} has neither data/demo_N, as robomimic and LIBERO write, nor observations and action, as ACT "
        f"does; it has {has or 'nothing'}. Convert it to a LeRobotDataset, which --format lerobot reads"
    )


def _episodes(file: Hdf5Group, program: str) -> Iterator[Hdf5Group]:
    """Yield the groups of a file's episodes."""
    if program == "ACT":
        yield file
        return
    data = file.child("data")
    assert data is not None
    for name in sorted((one for one in data.members() if one.startswith("demo_")), key=_in_order):
        group = data.child(name)
        if group is None:
            raise SourceError(f"{data.label}/{printable(name)} is no group, as an episode is: remove or rename it")
        yield group


def _contents(group: Hdf5Group, program: str) -> Contents:
    """Return what an episode holds; raises SourceError if its arrays differ in length."""
    found, action = _observed(group, program), ACTIONS[program]
    if action in found:
        raise SourceError(f"{group.label} has an observation '{action}' beside its actions: rename it")
    done = group.array(action)
    if done is None:
        raise SourceError(f"{group.label} has no array '{action}'")
    found[action] = (action,), done
    length = done.shape[0]
    _require_lengths(group, [array for _, array in found.values()], length)
    if len(found) > MOST_COLUMNS:
        raise SourceError(f"{group.label} has {len(found)} arrays; the limit is {MOST_COLUMNS}")
    features = {name: _feature(array, place) for name, (place, array) in found.items()}
    if program == "ACT":
        features = _paired(features)
    _require_names(group, features)
    beside = {name for name in group.members() if "action" in name and name != action}
    return Contents(features, {name: place for name, (place, _) in found.items()}, length, beside)


def _observed(group: Hdf5Group, program: str) -> dict[str, tuple[tuple[str, ...], Hdf5Array]]:
    """Return the place and the array of each observation by its name."""
    above = ("observations",) if program == "ACT" else ("obs",)
    observed, result = group.child(above[0]), dict[str, tuple[tuple[str, ...], Hdf5Array]]()
    shown = observed.child("images") if observed is not None and program == "ACT" else None
    for inside, places in ((observed, above), (shown, (*above, "images"))):
        for name in () if inside is None else inside.members():
            if inside is None or (array := inside.array(name)) is None:
                continue
            if name in result:
                raise SourceError(f"{group.label} has two observations '{name}'")
            result[name] = (*places, name), array
    return result


def _require_names(group: Hdf5Group, features: Mapping[str, Feature]) -> None:
    """Raise SourceError if two columns would have one name; the later one would hide the other."""
    columns = [*_OWN, *(column for _, many in vectors_of(features) for column in many), *features]
    if twice := next((name for name, count in Counter(columns).items() if count > 1), None):
        raise SourceError(f"{group.label} has an array '{printable(twice)}', which is a column of its own: rename it")


def _require_lengths(group: Hdf5Group, arrays: Sequence[Hdf5Array], length: int) -> None:
    for array in arrays:
        if array.shape[0] != length:
            raise SourceError(f"{array.name} has {array.shape[0]} rows, but the actions have {length}")
    declared = group.text("num_samples")
    if declared and declared != str(length):
        raise SourceError(f"{group.label} has num_samples {printable(declared)[:20]}, but {length} actions")


def _feature(array: Hdf5Array, place: tuple[str, ...]) -> Feature:
    """Return an array as a feature: a picture, or numbers."""
    shape = [*array.shape[1:]]
    if "images" in place or len(array.shape) >= _ROWS_OF_PICTURE or place[-1].endswith("_depth"):
        return Feature("image", shape, info={"is_depth_map": not _is_colour(array)})
    return Feature(array.dtype.name, shape or [1])


def _is_colour(array: Hdf5Array) -> bool:
    """Return whether an array has pictures of 8-bit RGB, or encoded ones."""
    if array.dtype != np.uint8 or array.name.endswith("_depth'"):
        return False
    return len(array.shape) == 2 or (len(array.shape) == _ROWS_OF_PICTURE and array.shape[3] == 3)


def _paired(features: Mapping[str, Feature]) -> dict[str, Feature]:
    """Return ACT's features, where an action is the place of the same number of ``qpos``."""
    state, action = features.get("qpos"), features["action"]
    if state is None or state.size != action.size or len(action.size) != 1:
        return dict(features)
    names = [f"joint_{place}" for place in range(action.size[0])]
    own = {name: Feature(features[name].dtype, features[name].shape, names) for name in ("qpos", "action")}
    return {**features, **own}


def _require_same(first: Contents, other: Contents, where: str) -> None:
    """Raise SourceError if an episode has other arrays, or other sizes, than the first one."""
    for name in dict.fromkeys([*first.features, *other.features]):
        one, two = first.features.get(name), other.features.get(name)
        if one is not None and two is not None and one.is_picture and two.is_picture and len(one.shape) == 1:
            continue  # encoded pictures are padded to each file's longest
        if one != two:
            had, has = ("none" if each is None else f"{each.dtype} {each.shape}" for each in (one, two))
            raise SourceError(f"{where}: '{printable(name)}' is {has}, and {had} in the first episode")


def _cameras(info: Info, folder: Path, camera: str | None, said: list[str], every: bool) -> Sequence[str]:  # noqa: FBT001
    """Return the cameras to take; pictures without three 8-bit colours are left out and noted."""
    found = [name for name, feature in info.features.items() if feature.is_picture]
    left = {
        name: "its pictures are depths, or not of three 8-bit colours" for name in found if info.features[name].is_depth
    }
    for name in found:
        size = prod(info.features[name].shape)
        if not 0 < size <= 3 * MAX_PIXELS:
            raise SourceError(
                f"{folder}: '{name}' has pictures of {size} values; the limits are 1 and {3 * MAX_PIXELS}"
            )
    if not found or len(found) > MOST_CAMERAS:
        raise SourceError(
            f"{folder} has {len(found)} cameras, and eyechart takes 1 to {MOST_CAMERAS}; robomimic writes pictures "
            "with its script dataset_states_to_obs.py"
        )
    chosen = chosen_cameras(found, left, camera, folder, every=every)
    said += [f"camera '{name}' is left out: {why}" for name, why in left.items()]
    return chosen


def _attributes(file: Hdf5Group, name: str) -> Mapping[str, Any]:
    """Return a JSON attribute of ``data``, empty without it; raises SourceError for other text."""
    data = file.child("data")
    text = "" if data is None else data.text(name)
    with raising(SourceError, f"{file.path}: the attribute '{name}' is no JSON", of=(ValueError, RecursionError)):
        values = parse_json(text or "{}")
    return values if isinstance(values, dict) else {}


def _instruction(file: Hdf5Group) -> str:
    """Return the instruction of a LIBERO file, which may be a list of its letters."""
    said = _attributes(file, "problem_info").get("language_instruction")
    if isinstance(said, list) and all(isinstance(one, str) for one in said):
        if len(said) > 1 and max(map(len, said)) > 1:
            raise SourceError(f"{file.path}: the language_instruction has {len(said)} texts; a file has one")
        said = "".join(said)
    words = said.strip().strip('"').strip() if isinstance(said, str) else ""
    if not words:
        raise SourceError(f"{file.path}: the attribute 'problem_info' has no language_instruction")
    return words


def _rate_in(file: Hdf5Group) -> float | None:
    """Return the rate of a file's attributes, None without one."""
    options = _attributes(file, "env_args").get("env_kwargs")
    rate = options.get("control_freq") if isinstance(options, dict) else None
    if not isinstance(rate, int | float) or isinstance(rate, bool):
        return None
    with raising(SourceError, f"{file.path}: the control_freq of env_args", of=OverflowError):
        return float(rate)


def _rate(found: set[float | None], given: float | None, folder: Path) -> float:
    """Return the number of frames per second; raises SourceError if neither all files nor the user say it."""
    rates = {one for one in found if one is not None}
    if given is None and (len(rates) != 1 or None in found):
        has = ", ".join(f"{one:g}" for one in sorted(rates))
        has = f"the files have {has}{', and some have none' * (None in found)}" if rates else "the files do not have it"
        raise SourceError(f"{folder}: give the frames per second as --rate N ({has}); the ALOHA of ACT records 50")
    rate = next(iter(rates)) if given is None else float(given)
    if not SLOWEST <= rate <= FASTEST:
        raise SourceError(f"{folder}: {rate:g} frames a second is not a camera's rate")
    if rates and rates != {rate}:
        raise SourceError(f"{folder}: --rate {rate:g} contradicts the control_freq {min(rates):g} of env_args")
    return rate


def _shown(picture: Any, what: str) -> Picture:  # noqa: ANN401 - of NumPy
    """Return a stored picture as PNG; an encoded one has zeros behind its end."""
    if picture.ndim == 1:
        return plain_picture(picture.tobytes().rstrip(b"\0"), what)
    return encode(np.ascontiguousarray(picture))
