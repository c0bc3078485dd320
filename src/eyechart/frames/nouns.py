"""A frame with its ground truth, and a bank of frames with the manifest that fixes it."""

import hashlib
import json
import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Literal, Protocol

import numpy as np

from eyechart.errors import BankError
from eyechart.frames.pictures import as_png, read_bounded, size_of
from eyechart.records import LARGEST, picked
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.motion import MotionSpace

MirrorAxis = Literal["vertical", "horizontal", "none"]
"""The flip that exchanges left and right: vertical for a top-down horizontal road, horizontal for a
forward camera."""

Scalar = str | int | float | bool | None
MAIN = "main"
"""The name of the camera where there is one alone."""
IMPORTED = "import"
"""The simulator's name in a bank whose pictures were taken from elsewhere."""

FORMAT = "eyechart-bank/1"
FILE_SUFFIX = "_file_name"
DISTANCES = ("lane_near_m", "lane_far_m", "lead_mid_near_m", "lead_mid_far_m", "lead_drawn_m", "exchange_m")
"""Columns that say where drawn controls put a vehicle; they belong to the pictures, not to the
moment."""

RESERVED = {"file_name", "frame_id", "scenario", "episode", "step", "mirror_axis"}
_EXACT = 2**53
_SMALLEST = 1e-6


@dataclass(frozen=True, slots=True)
class Gap:
    """Which column of ground truth the battery's gap tests read, in what unit, and what counts as near."""

    column: str
    threshold: float
    unit: str

    def __post_init__(self) -> None:
        if not abs(self.threshold) <= LARGEST:
            raise ValueError(f"the gap's threshold is {self.threshold!r}, not a number")

    def of(self, frame: "Frame") -> float:
        """Return a frame's gap, infinite where there is no lead; raises BankError where its column holds no number."""
        if self.column not in frame.truth:
            raise BankError(f"frame '{frame.id}' has no column '{self.column}', which the bank declares as its gap")
        value = frame.truth[self.column]
        if isinstance(value, bool | str):
            raise BankError(f"frame '{frame.id}': the gap '{self.column}' is {value!r}, not a number")
        return math.inf if value is None else float(value)

    def near(self, frame: "Frame") -> bool:
        """Return whether a frame's gap is below the threshold."""
        return self.of(frame) < self.threshold


LEAD_GAP = Gap(column="lead_gap_m", threshold=18.0, unit="m")
"""The gap to the lead vehicle, near below 18 m as in the paper; that it is centre to centre is
ours."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera: the axis of its reflection, and the other camera with which it exchanges there ("" for none).

    A picture of a left wrist's camera, flipped, is what the reflected world shows in the right
    wrist's.
    """

    name: str
    mirror_axis: MirrorAxis = "none"
    mirrors: str = ""

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[\w-]+", self.name):
            raise BankError(f"a camera's name has letters, digits, '_' and '-'; got {self.name!r}")


def require_exchanged(cameras: Sequence[Camera]) -> None:
    """Raise BankError where two cameras have one name, or one mirrors a camera that does not mirror it."""
    by_name = {one.name: one for one in cameras}
    if len(by_name) < len(cameras):
        raise BankError(f"two cameras have one name: {', '.join(one.name for one in cameras)}")
    for one in cameras:
        if one.mirrors and (one.mirrors not in by_name or by_name[one.mirrors].mirrors != one.name):
            raise BankError(f"camera '{one.name}' mirrors '{one.mirrors}', which must be there and mirror it too")


@cache
def alone(axis: MirrorAxis) -> tuple[Camera, ...]:
    """Return the camera of frames that have one alone."""
    return (Camera(MAIN, axis),)


@dataclass(frozen=True, slots=True)
class Frame:
    """A moment as cameras saw it, with its place in the bank and its ground truth, which no model sees.

    ``pictures`` maps each of its ``cameras`` to a file inside the bank, ``counterfactuals`` a name
    to the same. ``truth`` maps a name with its unit (``lead_gap_m``) to a number, a flag, a word,
    or None for "there is none" (no lead). ``fields`` maps the bank's prompt columns to what a
    prompt may say of the frame, ``state`` a name to numbers that a controller may see, such as the
    angles of its joints; neither is ground truth. ``motion`` is what was done from here on in the
    log, a row a step, and empty where nobody logged it; no controller sees it. ``placed`` are the
    columns of ``truth`` that say where pictures with one thing changed put a vehicle, and
    ``strata`` what a claim may be asked by besides the scenario, such as the colour of the lead.
    """

    id: str
    scenario: str
    episode: str
    step: int
    cameras: tuple[Camera, ...]
    pictures: Mapping[str, str]
    truth: Mapping[str, Scalar] = field(default_factory=dict)
    counterfactuals: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    fields: Mapping[str, Scalar] = field(default_factory=dict)
    state: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    motion: tuple[tuple[float, ...], ...] = ()
    placed: frozenset[str] = frozenset()
    strata: Mapping[str, Scalar] = field(default_factory=dict)

    @property
    def file(self) -> str:
        """Return the file of the first camera's picture."""
        return self.pictures[self.cameras[0].name]

    @property
    def mirror_axis(self) -> MirrorAxis:
        """Return the axis of the first camera; none where any camera has none: the frame cannot be mirrored."""
        return "none" if any(one.mirror_axis == "none" for one in self.cameras) else self.cameras[0].mirror_axis

    @property
    def drive(self) -> str:
        """Return the name of the frame's episode among all: names of episodes may recur in another scenario."""
        return f"{self.scenario}/{self.episode}"

    def geometry(self) -> str:
        """Return the digest of the frame's identity and its ground truth to 3 decimals (docs/decisions/banks.md).

        Where its pictures put a vehicle has no part in it: they may be drawn anew for the same
        moment.
        """
        truth = {name: _canonical(self.truth[name]) for name in sorted(self.truth) if name not in self.placed}
        parts = [self.id, self.scenario, self.episode, self.step, self.mirror_axis, truth]
        if self.fields:
            parts.append({name: _canonical(self.fields[name]) for name in sorted(self.fields)})
        if self.cameras != alone(self.cameras[0].mirror_axis):
            parts.append(["cameras", *([one.name, one.mirror_axis, one.mirrors] for one in self.cameras)])
        if self.state:
            parts.append(["state", {name: [*map(_canonical, self.state[name])] for name in sorted(self.state)}])
        if self.motion:
            parts.append(["motion", [[*map(_canonical, row)] for row in self.motion]])
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Stimulus:
    """All that a condition may change of a query: encoded pictures by camera, what a prompt may say, and the state.

    Nobody can change it: one stimulus is shown to every model of a run, and again where a call is
    made again.
    """

    images: Mapping[str, bytes] = field(default_factory=dict)
    fields: Mapping[str, Scalar] = field(default_factory=dict)
    state: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("images", "fields", "state"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __reduce__(self) -> tuple[object, ...]:
        """Return how a copy is made, also in another process: a read-only view cannot be pickled."""
        return Stimulus, (dict(self.images), dict(self.fields), dict(self.state))

    @classmethod
    def of(cls, image: bytes | None) -> "Stimulus":
        """Return the stimulus of one picture and nothing else, or of none."""
        return cls({} if image is None else {MAIN: image})


class Source(Protocol):
    """Where a condition finds pictures: a bank of frames, or one moment of a world that is driven."""

    @property
    def frames(self) -> Sequence[Frame]:
        """All frames, in order."""

    @property
    def scenarios(self) -> Mapping[str, tuple[Frame, ...]]:
        """The frames of each scenario, in order."""

    @property
    def said(self) -> tuple[str, ...]:
        """The prompt columns that the prompt says of a frame."""

    @property
    def stores_noise(self) -> bool:
        """Whether noise is made as a PNG that is not compressed: no compression makes it smaller."""

    def images(self, frame: Frame, counterfactual: str | None = None) -> Mapping[str, bytes]:
        """Return the encoded pictures of a frame, or of one of its counterfactuals, by camera."""

    def shapes(self, frame: Frame) -> Mapping[str, tuple[int, ...]]:
        """Return the shape (h, w, 3) of a frame's pictures by camera."""


def _canonical(value: Scalar) -> Scalar | list[str]:
    """Return a number as a list with its decimals, so that 5 is 5.0 and no word; all else as it is."""
    if value is None or isinstance(value, bool | str):
        return value
    return [f"{value}.000" if isinstance(value, int) else f"{round(value, 3) + 0.0:.3f}"]


def is_reserved(name: str) -> bool:
    """Return whether a bank needs this column's name for itself."""
    return name in RESERVED or name.endswith(FILE_SUFFIX)


def rounded_truth(truth: Mapping[str, object], frame_id: str) -> dict[str, Scalar]:
    """Return ground truth as plain values, floats to 3 decimals.

    Raises BankError for NaN, infinity, whole numbers above 2**53, and other types.
    """
    rounded: dict[str, Scalar] = {}
    for name, raw in truth.items():
        value = raw.item() if isinstance(raw, np.generic) else raw
        if isinstance(value, float):
            if not abs(value) <= LARGEST:
                raise BankError(
                    f"frame '{frame_id}': truth '{name}' is {value}, not a number up to {LARGEST:g}; use None for "
                    "'there is none'"
                )
            value = round(value, 3) + 0.0
        if isinstance(value, int) and abs(value) > _EXACT:
            raise BankError(f"frame '{frame_id}': truth '{name}' is too large a number to be exact; write it as a word")
        if not isinstance(value, str | int | float | bool | None):
            raise BankError(f"frame '{frame_id}': truth '{name}' is a {type(value).__name__}, not a plain value")
        rounded[name] = value
    return rounded


@dataclass(frozen=True, slots=True)
class Controls:
    """Where pictures with one thing changed put a vehicle: by frame id the distances, and the seed of the controls'.

    The seed is None where nobody drew them by one.
    """

    seed: int | None = None
    distances: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class BankManifest:
    """What a bank says of itself: where its pictures come from, and the digests that fix them.

    ``picture`` is the kind of picture in words, for the scope of every verdict. ``geometry`` maps a
    frame id to its digest, ``images`` a file to its SHA-256. ``prompt_columns`` are the columns
    that prompts may say, ``absent`` the places that the source did not record (scenario, episode,
    step), and ``independent`` its owner's word that the frames are independent draws. ``cameras``
    are those of every frame where there are several, ``state`` the columns of numbers that a
    controller may see; a bank that says none of these is as it always was. ``controls`` holds the
    truth of its control pictures. ``motion`` says what its logged motions are, and what a
    controller of motions answers with; None where it has none. ``span`` is the range over which
    `drawn` distances were drawn, in the gap's unit, None where none were. ``strata`` maps a frame
    id to what a claim may be asked by, and ``added`` to the columns of pictures that came later
    than its row.
    """

    simulator: str
    preset: str
    picture: str
    action_space: Discrete
    gap: Gap | None
    settings: Mapping[str, object] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    geometry: Mapping[str, str] = field(default_factory=dict)
    images: Mapping[str, str] = field(default_factory=dict)
    prompt_columns: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()
    independent: bool = False
    cameras: tuple[Camera, ...] = ()
    state: tuple[str, ...] = ()
    controls: Controls = field(default_factory=Controls)
    motion: MotionSpace | None = None
    span: tuple[float, float] | None = None
    strata: Mapping[str, Mapping[str, Scalar]] = field(default_factory=dict)
    added: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_exchanged(self.cameras)
        if self.span is not None and not _SMALLEST <= self.span[0] < self.span[1] <= LARGEST:
            raise BankError(f"distances are drawn from one above 0 to a greater one, not from {self.span}")

    @property
    def fingerprint(self) -> str:
        """Return the digest of the geometry of every frame in order; pixels have no part in it."""
        lines = "\n".join(f"{frame}\x1f{digest}" for frame, digest in self.geometry.items())
        return hashlib.sha256(lines.encode()).hexdigest()

    @property
    def declaration(self) -> str:
        """Return the digest of what the bank declares of itself: its picture in words, gap, actions and settings."""
        words = {name: value for name, value in self._declared().items() if name != "versions"}
        return hashlib.sha256(json.dumps(words, sort_keys=True).encode()).hexdigest()

    def as_dict(self) -> dict[str, object]:
        """Return the manifest as plain JSON values."""
        besides = [*(["controls"] if self.controls != Controls() else []), *(["span"] if self.span else [])]
        besides += [name for name in ("strata", "added") if getattr(self, name)]
        return {
            "format": FORMAT,
            **picked(self, "fingerprint declaration"),
            **self._declared(),
            **picked(self, f"geometry images {' '.join(besides)}"),
        }

    def _declared(self) -> dict[str, object]:
        names = ("prompt_columns", "absent", "independent", "cameras", "state", "motion")
        said = " ".join(name for name in names if getattr(self, name))
        return picked(self, f"simulator preset picture action_space gap {said} settings versions")


@dataclass(frozen=True)
class FrameBank:
    """Frames on disk with their manifest. Opening one reads text only; pictures are read when asked for.

    ``said`` are the prompt columns that the prompt of a run says of its frames. With ``plain`` all
    pictures are read as 8-bit PNGs of pixels alone (`eyechart.frames.as_png`), so that no file's
    kind tells them apart. ``stores_noise`` says that noise is made as a PNG that is not compressed.
    ``unchecked`` pictures are read as they lie there.
    """

    root: Path
    frames: tuple[Frame, ...]
    manifest: BankManifest
    said: tuple[str, ...] = ()
    plain: bool = False
    stores_noise: bool = False
    unchecked: bool = False

    def __repr__(self) -> str:
        episodes = len({frame.episode for frame in self.frames})
        return f"<FrameBank {self.name}: {len(self)} frames, {episodes} episodes, in {self.root}>"

    def __iter__(self) -> Iterator[Frame]:
        return iter(self.frames)

    def __len__(self) -> int:
        return len(self.frames)

    def frame(self, frame_id: str) -> Frame:
        """Return the frame of this id; raises BankError where the bank has none."""
        if frame_id not in self._by_id:
            raise BankError(f"the bank {self.root} has no frame '{frame_id}'")
        return self._by_id[frame_id]

    @cached_property
    def _by_id(self) -> dict[str, Frame]:
        return {frame.id: frame for frame in self.frames}

    def images(self, frame: Frame, counterfactual: str | None = None) -> dict[str, bytes]:
        """Return the encoded pictures of a frame by camera, or those of one of its counterfactuals.

        Raises BankError for a missing counterfactual, a file outside the bank, or one that is too
        large.
        """
        files = frame.pictures if counterfactual is None else frame.counterfactuals.get(counterfactual)
        if files is None:
            raise BankError(f"frame '{frame.id}' has no counterfactual picture '{counterfactual}'")
        return {camera: self.read(file) for camera, file in files.items()}

    def image(self, frame: Frame, counterfactual: str | None = None) -> bytes:
        """Return the encoded picture of a frame's first camera, or that of one of its counterfactuals."""
        return self.images(frame, counterfactual)[frame.cameras[0].name]

    def read(self, file: str) -> bytes:
        """Return an encoded picture, read from disk; raises BankError where it is not the one that was recorded.

        A bank is checked when it is opened, and may change under a run.
        """
        picture = read_bounded(self.root, file) if self.unchecked else self._as_recorded(file)
        return as_png(picture, file) if self.plain else picture

    def _as_recorded(self, file: str) -> bytes:
        picture = read_bounded(self.root, file)
        if hashlib.sha256(picture).hexdigest() != self.manifest.images.get(file):
            raise BankError(
                f"'{file}' of {self.root} is not the picture that the bank's manifest recorded: its SHA-256 "
                "differs; restore it"
            )
        return picture

    def shapes(self, frame: Frame) -> dict[str, tuple[int, int, int]]:
        """Return the shape (h, w, 3) of a frame's pictures by camera, as their headers say."""
        sizes = {camera: size_of(self.read(file), file) for camera, file in frame.pictures.items()}
        return {camera: (high, wide, 3) for camera, (wide, high) in sizes.items()}

    def recorded(self, frame: Frame) -> bytes:
        """Return the encoded picture of a frame; raises BankError where it is not the one that was recorded."""
        return self._as_recorded(frame.file)

    @cached_property
    def scenarios(self) -> Mapping[str, tuple[Frame, ...]]:
        """Return the frames of each scenario, in the bank's order."""
        grouped = defaultdict[str, list[Frame]](list)
        for frame in self.frames:
            grouped[frame.scenario].append(frame)
        return {name: tuple(frames) for name, frames in grouped.items()}

    @property
    def name(self) -> str:
        """Return the bank's short name: its preset and the head of its fingerprint."""
        return f"{self.manifest.simulator}-{self.manifest.preset}@{self.manifest.fingerprint[:8]}"


def files_of(frame: Frame) -> list[str]:
    """Return a frame's files in the order in which a manifest lists them."""
    drawn = (frame.counterfactuals[name] for name in sorted(frame.counterfactuals))
    return [file for files in (frame.pictures, *drawn) for file in files.values()]
