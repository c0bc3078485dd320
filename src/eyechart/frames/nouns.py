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

from eyechart.errors import BankError, SpecError, suggestion
from eyechart.frames.pictures import AS_STORED, ENCODINGS, PictureEncoding, as_png, read_bounded, size_of
from eyechart.records import LARGEST, to_json_fields
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.motion import MotionSpace

MirrorAxis = Literal["vertical", "horizontal", "none"]
"""The flip that exchanges left and right: vertical for a top-down horizontal road, horizontal for a
forward camera."""

Scalar = str | int | float | bool | None
MAIN = "main"
"""The name of an only camera."""
IMPORTED = "import"
"""The simulator's name in an imported bank."""

Provenance = Literal["rendered", "staged", "edited", ""]
"""How control pictures were made: drawn by a world, photographed of things that were moved, or
edited into photographs; "" where nobody said."""
MADE: tuple[Provenance, ...] = ("rendered", "staged", "edited")
PATCHED = "patched"
"""The control picture that only an edit makes."""

FORMAT = "eyechart-bank/1"
FILE_SUFFIX = "_file_name"
DISTANCES = ("lane_near_m", "lane_far_m", "lead_mid_near_m", "lead_mid_far_m", "lead_drawn_m", "exchange_m")
"""Columns with a vehicle's distance in drawn controls; they describe those pictures, not the
moment."""

MOST_HISTORY = 50
"""The most instants before a frame."""
RESERVED = {"file_name", "frame_id", "scenario", "episode", "step", "mirror_axis"}
_EXACT = 2**53
_SMALLEST = 1e-6


@dataclass(frozen=True, slots=True)
class Gap:
    """The gap for the battery's tests: its column of ground truth, its unit, and the near limit."""

    column: str
    threshold: float
    unit: str

    def __post_init__(self) -> None:
        if not abs(self.threshold) <= LARGEST:
            raise ValueError(f"the gap's threshold is {self.threshold!r}, not a number")

    def of(self, frame: "Frame") -> float:
        """Return a frame's gap, infinite without a lead; raises BankError if it is no number."""
        if self.column not in frame.truth:
            raise BankError(f"frame '{frame.id}' has no column '{self.column}', the gap that the bank declares")
        value = frame.truth[self.column]
        if isinstance(value, bool | str):
            raise BankError(f"frame '{frame.id}': the gap '{self.column}' is {value!r}, not a number")
        return math.inf if value is None else float(value)

    def is_near(self, frame: "Frame") -> bool:
        """Return whether a frame's gap is below the threshold."""
        return self.of(frame) < self.threshold


LEAD_GAP = Gap(column="lead_gap_m", threshold=18.0, unit="m")
"""The gap to the lead (the vehicle ahead). Below 18 m is near, as in the paper; measuring from
centre to centre is eyechart's choice."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera: the axis of its reflection, and the camera with which it exchanges ("" for none).

    A flipped picture of a left wrist's camera is what the right wrist's camera shows in the
    reflected world.
    """

    name: str
    mirror_axis: MirrorAxis = "none"
    mirrors: str = ""

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[\w-]+", self.name):
            raise BankError(f"a camera's name has letters, digits, '_' and '-'; got {self.name!r}")


def require_exchanged(cameras: Sequence[Camera]) -> None:
    """Raise BankError if two cameras share a name, or if a mirrored camera does not mirror back."""
    by_name = {camera.name: camera for camera in cameras}
    if len(by_name) < len(cameras):
        raise BankError(f"two cameras have the same name: {', '.join(camera.name for camera in cameras)}")
    for one in cameras:
        if one.mirrors and (one.mirrors not in by_name or by_name[one.mirrors].mirrors != one.name):
            raise BankError(f"camera '{one.name}' mirrors '{one.mirrors}', which must exist and mirror it too")


@cache
def alone(axis: MirrorAxis) -> tuple[Camera, ...]:
    """Return the camera of frames with only one."""
    return (Camera(MAIN, axis),)


@dataclass(frozen=True, slots=True)
class Frame:
    """A moment as cameras saw it, with its place in the bank and its ground truth.

    No model sees the ground truth. ``pictures`` maps each of its ``cameras`` to a file inside the
    bank. ``counterfactuals`` maps a name to such files. ``truth`` maps a name with its unit
    (``lead_gap_m``) to a number, a flag, a word, or None for "there is none" (no lead). ``fields``
    maps the bank's prompt columns to values that a prompt may state. ``state`` maps a name to
    numbers that a controller may see, such as joint angles. Neither is ground truth. ``motion`` is
    the logged motion from here on, one row a step, and empty without a log; no controller sees it.
    ``placed`` are the columns of ``truth`` with a vehicle's distance in counterfactuals. ``strata``
    are further groups for a claim next to the scenario, such as the lead's colour. ``past`` holds
    the instants before it, the oldest first, as `instant` returns them.
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
    past: tuple["Frame", ...] = ()

    @property
    def file(self) -> str:
        """Return the file of the first camera's picture."""
        return self.pictures[self.cameras[0].name]

    @property
    def mirror_axis(self) -> MirrorAxis:
        """Return the first camera's axis, or none if any camera has none."""
        return "none" if any(camera.mirror_axis == "none" for camera in self.cameras) else self.cameras[0].mirror_axis

    @property
    def drive(self) -> str:
        """Return the episode's unique name; scenarios may use equal names of episodes."""
        return f"{self.scenario}/{self.episode}"

    @property
    def window(self) -> tuple["Frame", ...]:
        """Return the instants before it, the oldest first, and itself."""
        return (*self.past, self)

    def instant(self) -> "Frame":
        """Return what a controller may see of it; an instant before a frame has nothing else."""
        seen = (self.id, self.scenario, self.episode, self.step, self.cameras, self.pictures)
        return Frame(*seen, fields=self.fields, state=self.state)

    def stated(self, names: Sequence[str]) -> tuple[object, ...]:
        """Return what a prompt's words say of the frame: its columns, and named parts of its state."""
        return tuple(self.state[name] if name in self.state else self.fields[name] for name in names)

    def geometry(self) -> str:
        """Return the digest of the frame's identity and ground truth to 3 decimals.

        See docs/decisions/banks.md. Distances in counterfactuals are left out: they may be drawn
        again for the same moment.
        """
        truth = {name: _canonical(self.truth[name]) for name in sorted(self.truth) if name not in self.placed}
        parts = [self.id, self.scenario, self.episode, self.step, self.mirror_axis, truth]
        if self.fields:
            parts.append({name: _canonical(self.fields[name]) for name in sorted(self.fields)})
        if self.cameras != alone(self.cameras[0].mirror_axis):
            parts.append(["cameras", *([camera.name, camera.mirror_axis, camera.mirrors] for camera in self.cameras)])
        if self.state:
            parts.append(["state", {name: [*map(_canonical, self.state[name])] for name in sorted(self.state)}])
        if self.motion:
            parts.append(["motion", [[*map(_canonical, row)] for row in self.motion]])
        if self.past:
            parts.append(["past", [one.geometry() for one in self.past]])
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Stimulus:
    """Everything that a condition may change: pictures by camera, prompt values and the state.

    ``past`` holds the instants before it, the oldest first; they have no past of their own. It is
    immutable: one stimulus is shown to every model of a run, and again in a repeated call.
    """

    images: Mapping[str, bytes] = field(default_factory=dict)
    fields: Mapping[str, Scalar] = field(default_factory=dict)
    state: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    past: tuple["Stimulus", ...] = ()

    def __post_init__(self) -> None:
        for name in ("images", "fields", "state"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __reduce__(self) -> tuple[object, ...]:
        """Return the recipe of a copy: a read-only view cannot be pickled."""
        return Stimulus, (dict(self.images), dict(self.fields), dict(self.state), self.past)

    @property
    def pictures(self) -> tuple[bytes, ...]:
        """Return the encoded pictures of all its instants, the oldest first."""
        return tuple(image for one in (*self.past, self) for image in one.images.values())

    def window(self, history: int) -> tuple["Stimulus", ...]:
        """Return ``history`` instants before it, the oldest first, and itself.

        Raises ValueError if it has fewer.
        """
        if not 0 <= history <= len(self.past):
            raise ValueError(f"{history} instants before it are asked for, and it has {len(self.past)}")
        return (*self.past[len(self.past) - history :], self)

    @classmethod
    def of(cls, image: bytes | None) -> "Stimulus":
        """Return the stimulus of one picture, or of none."""
        return cls({} if image is None else {MAIN: image})


class Source(Protocol):
    """The source of a condition's pictures: a bank, or one moment of a world that is driven."""

    @property
    def frames(self) -> Sequence[Frame]:
        """All frames, in order."""

    @property
    def scenarios(self) -> Mapping[str, tuple[Frame, ...]]:
        """The frames of each scenario, in order."""

    @property
    def places(self) -> Mapping[str, int]:
        """The place of each frame among those of its scenario, by its id."""

    @property
    def said(self) -> tuple[str, ...]:
        """The prompt columns that the prompt states for a frame."""

    def alike(self, frame: Frame) -> tuple[Sequence[Frame], Sequence[int]]:
        """Return frames to take another text from, and the places of those with this frame's text.

        They are those of the frame's scenario, or all where these have one text.
        """

    @property
    def encoding(self) -> PictureEncoding:
        """How pictures that are made of its own are written."""

    def images(self, frame: Frame, counterfactual: str | None = None) -> Mapping[str, bytes]:
        """Return the encoded pictures of a frame, or of one of its counterfactuals, by camera."""

    def shapes(self, frame: Frame) -> Mapping[str, tuple[int, ...]]:
        """Return the shape (h, w, 3) of a frame's pictures by camera."""


def _canonical(value: Scalar) -> Scalar | list[str]:
    """Return a number as a list with its decimals, so that 5 equals 5.0 and no word does."""
    if value is None or isinstance(value, bool | str):
        return value
    return [f"{value}.000" if isinstance(value, int) else f"{round(value, 3) + 0.0:.3f}"]


def is_reserved(name: str) -> bool:
    """Return whether a bank reserves this column name."""
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
            raise BankError(f"frame '{frame_id}': truth '{name}' is too large to be exact; write it as a word")
        if not isinstance(value, str | int | float | bool | None):
            raise BankError(f"frame '{frame_id}': truth '{name}' is a {type(value).__name__}, not a plain value")
        rounded[name] = value
    return rounded


@dataclass(frozen=True, slots=True)
class Controls:
    """Distances of vehicles in counterfactuals, by frame id, and the seed of the controls.

    The seed is None if no seed drew them.
    """

    seed: int | None = None
    distances: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class BankManifest:
    """A bank's description of itself: the origin of its pictures, and the digests that fix them.

    ``picture`` is the kind of picture in words, for the scope of every verdict. ``geometry`` maps a
    frame id to its digest, ``images`` a file to its SHA-256. ``prompt_columns`` are the columns
    that prompts may state. ``absent`` are the places that the source did not record (scenario,
    episode, step). ``independent`` is the owner's statement that the frames are independent draws.
    ``cameras`` are those of every frame if there are several, and ``state`` the columns of numbers
    that a controller may see. Older banks have none of these. ``controls`` holds the truth of the
    control pictures. ``motion`` is the space of the logged motions and of a controller's answers,
    None without motions. ``history`` is the number of instants before each frame. ``span`` is the
    range of drawn distances in the gap's unit, None without them. ``strata`` maps a frame id to its
    further groups, and ``added`` to the columns of pictures that were added after its row. ``made``
    is what was declared of the control pictures, and ``edit`` what the record of their edit says.
    No digest covers these two: they may be declared after a run.
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
    history: int = 0
    span: tuple[float, float] | None = None
    strata: Mapping[str, Mapping[str, Scalar]] = field(default_factory=dict)
    added: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    made: Provenance = ""
    edit: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_exchanged(self.cameras)
        if not 0 <= self.history <= MOST_HISTORY:
            raise BankError(f"a bank holds 0 to {MOST_HISTORY} instants before each frame, not {self.history}")
        if self.made and self.made not in MADE:
            raise BankError(f"control pictures are {', '.join(MADE)}, or it is not said; not '{self.made}'")
        if self.span is not None and not _SMALLEST <= self.span[0] < self.span[1] <= LARGEST:
            raise BankError(f"distances are drawn from one above 0 to a greater one, not from {self.span}")

    @property
    def provenance(self) -> Provenance:
        """Return how the control pictures were made; a simulator rendered them."""
        return self.made or ("" if self.simulator == IMPORTED else "rendered")

    @property
    def fingerprint(self) -> str:
        """Return the digest of every frame's geometry in order; it does not depend on pixels."""
        lines = "\n".join(f"{frame}\x1f{digest}" for frame, digest in self.geometry.items())
        return hashlib.sha256(lines.encode()).hexdigest()

    @property
    def declaration(self) -> str:
        """Return the digest of the bank's declaration: picture, gap, actions and settings."""
        words = {name: value for name, value in self._declared().items() if name != "versions"}
        return hashlib.sha256(json.dumps(words, sort_keys=True).encode()).hexdigest()

    def as_dict(self) -> dict[str, object]:
        """Return the manifest as plain JSON values."""
        besides = [*(["controls"] if self.controls != Controls() else []), *(["span"] if self.span else [])]
        besides += [name for name in ("strata", "added", "made", "edit") if getattr(self, name)]
        return {
            "format": FORMAT,
            **to_json_fields(self, "fingerprint declaration"),
            **self._declared(),
            **to_json_fields(self, f"geometry images {' '.join(besides)}"),
        }

    def _declared(self) -> dict[str, object]:
        names = ("prompt_columns", "absent", "independent", "cameras", "state", "motion", "history")
        said = " ".join(name for name in names if getattr(self, name))
        return to_json_fields(self, f"simulator preset picture action_space gap {said} settings versions")


@dataclass(frozen=True)
class FrameBank:
    """Frames on disk with their manifest. Opening reads text only; pictures are read on demand.

    ``said`` are the prompt columns that a run's prompt states. With ``plain``, all pictures are
    read as 8-bit PNGs without metadata (`eyechart.frames.as_png`), so that no file's kind tells
    them apart. ``encoding`` is how such pictures, and those made of others, are written.
    ``unchecked`` pictures are read without a comparison with the manifest.
    """

    root: Path
    frames: tuple[Frame, ...]
    manifest: BankManifest
    said: tuple[str, ...] = ()
    plain: bool = False
    encoding: PictureEncoding = ENCODINGS[AS_STORED]
    unchecked: bool = False

    def __repr__(self) -> str:
        episodes = len({frame.episode for frame in self.frames})
        return f"<FrameBank {self.name}: {len(self)} frames, {episodes} episodes, in {self.root}>"

    def __iter__(self) -> Iterator[Frame]:
        return iter(self.frames)

    def __len__(self) -> int:
        return len(self.frames)

    def frame(self, frame_id: str) -> Frame:
        """Return the frame of this id; raises BankError if the bank has none."""
        if frame_id not in self._by_id:
            raise BankError(f"the bank {self.root} has no frame '{frame_id}'")
        return self._by_id[frame_id]

    @cached_property
    def _by_id(self) -> dict[str, Frame]:
        return {frame.id: frame for frame in self.frames}

    def images(self, frame: Frame, counterfactual: str | None = None) -> dict[str, bytes]:
        """Return the encoded pictures of a frame by camera, or those of one of its counterfactuals.

        Raises BankError for a missing counterfactual, a file outside the bank, or a too large file.
        """
        files = frame.pictures if counterfactual is None else frame.counterfactuals.get(counterfactual)
        if files is None:
            raise BankError(f"frame '{frame.id}' has no counterfactual picture '{counterfactual}'")
        return {camera: self.read(file) for camera, file in files.items()}

    def image(self, frame: Frame, counterfactual: str | None = None) -> bytes:
        """Return the encoded picture of the first camera, or that of a counterfactual."""
        return self.images(frame, counterfactual)[frame.cameras[0].name]

    def read(self, file: str) -> bytes:
        """Return an encoded picture from disk; raises BankError if it was changed.

        A bank is checked when it is opened, and may change during a run.
        """
        picture = read_bounded(self.root, file) if self.unchecked else self._as_recorded(file)
        return as_png(picture, file, self.encoding.picture) if self.plain else picture

    def _as_recorded(self, file: str) -> bytes:
        picture = read_bounded(self.root, file)
        if hashlib.sha256(picture).hexdigest() != self.manifest.images.get(file):
            raise BankError(
                f"'{file}' of {self.root} is not the picture in the bank's manifest: its SHA-256 differs; restore it"
            )
        return picture

    def shapes(self, frame: Frame) -> dict[str, tuple[int, int, int]]:
        """Return the shape (h, w, 3) of a frame's pictures by camera, from their headers."""
        sizes = {camera: size_of(self.read(file), file) for camera, file in frame.pictures.items()}
        return {camera: (high, wide, 3) for camera, (wide, high) in sizes.items()}

    def recorded(self, frame: Frame) -> bytes:
        """Return the encoded picture of a frame; raises BankError if it was changed."""
        return self._as_recorded(frame.file)

    @cached_property
    def scenarios(self) -> Mapping[str, tuple[Frame, ...]]:
        """Return the frames of each scenario, in the bank's order."""
        grouped = defaultdict[str, list[Frame]](list)
        for frame in self.frames:
            grouped[frame.scenario].append(frame)
        return {name: tuple(frames) for name, frames in grouped.items()}

    @cached_property
    def places(self) -> Mapping[str, int]:
        """Return the place of each frame among those of its scenario, by its id."""
        return {frame.id: place for frames in self.scenarios.values() for place, frame in enumerate(frames)}

    def alike(self, frame: Frame) -> tuple[Sequence[Frame], Sequence[int]]:
        """Return frames to take another text from, and the places of those with this frame's text.

        They are those of the frame's scenario, or all where these have one text.
        """
        text = frame.stated(self.said)
        near, same = self.scenarios[frame.scenario], self._by_text[frame.scenario].get(text, [])
        return (near, same) if len(same) < len(near) else (self.frames, self._by_text[None].get(text, []))

    @cached_property
    def _by_text(self) -> Mapping[str | None, Mapping[tuple[object, ...], list[int]]]:
        """Return the places of each text among a scenario's frames, and among all under None."""
        found: dict[str | None, dict[tuple[object, ...], list[int]]] = {}
        for group, frames in ((None, self.frames), *self.scenarios.items()):
            texts = found[group] = {}
            for place, frame in enumerate(frames):
                texts.setdefault(frame.stated(self.said), []).append(place)
        return found

    @property
    def name(self) -> str:
        """Return the bank's short name: its preset and the head of its fingerprint."""
        return f"{self.manifest.simulator}-{self.manifest.preset}@{self.manifest.fingerprint[:8]}"


def files_of(frame: Frame) -> list[str]:
    """Return a frame's files in the order in which a manifest lists them.

    Those of earlier instants are last; frames of one episode may share them.
    """
    drawn = (frame.counterfactuals[name] for name in sorted(frame.counterfactuals))
    past = (one.pictures for one in frame.past)
    return [file for files in (frame.pictures, *drawn, *past) for file in files.values()]


def read_made(word: str) -> Provenance:
    """Return how control pictures were made, "" if it is not said; raises SpecError for another word."""
    for one in MADE:
        if one == word:
            return one
    if word:
        raise SpecError(f"--made takes {', '.join(MADE)}, not '{word}'{suggestion(word, MADE)}")
    return ""


_FEW = 8
"""Frames that differ are named up to this number."""


@dataclass(frozen=True)
class SharedFrames:
    """The frames with equal names in two banks, in the order of the first.

    ``sizes`` are the numbers of frames of the banks. ``unlike`` maps each shared frame of different
    geometry to the names of what differs. ``furthest`` maps each shared number of the ground truth
    to its largest difference, in its own unit.
    """

    frames: tuple[str, ...]
    sizes: tuple[int, int]
    unlike: Mapping[str, tuple[str, ...]]
    furthest: Mapping[str, float]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            "shared": len(self.frames),
            "of": list(self.sizes),
            "equal": len(self.frames) - len(self.unlike),
            "unlike": {frame: list(what) for frame, what in self.unlike.items()},
            "largest_differences": dict(self.furthest),
        }

    def lines(self) -> list[str]:
        """Return how many frames are shared, how far their truth differs, and the first that differ."""
        (one, other), count, names = self.sizes, len(self.frames), list(self.unlike)
        if not count:
            return [f"the {one} and the {other} frames have no name in common"]
        both = f"({one} and {other} frames): {count - len(names)} are the same moments"
        words = [f"{count} frames are in both banks {both}"]
        words += [f"{name}: at most {by:.3f} apart" for name, by in self.furthest.items()]
        words += [f"{frame} differs in {', '.join(self.unlike[frame])}" for frame in names[:_FEW]]
        return [*words, *([f"and {len(names) - _FEW} more frames differ"] if len(names) > _FEW else [])]


def shared_frames(one: FrameBank, other: FrameBank) -> SharedFrames:
    """Return the frames with equal names; geometry is compared to 3 decimals, pixels are not."""
    theirs = {frame.id: frame for frame in other}
    pairs = [(frame, theirs[frame.id]) for frame in one if frame.id in theirs]
    unlike = {mine.id: _unlike(mine, its) for mine, its in pairs if mine.geometry() != its.geometry()}
    furthest: dict[str, float] = {}
    for mine, its in pairs:
        for name in mine.truth.keys() & its.truth.keys():
            a, b = mine.truth[name], its.truth[name]
            if isinstance(a, int | float) and isinstance(b, int | float) and not isinstance(a, bool):
                furthest[name] = max(furthest.get(name, 0.0), abs(a - b))
    return SharedFrames(
        tuple(mine.id for mine, _ in pairs), (len(one), len(other)), unlike, dict(sorted(furthest.items()))
    )


def same_moments(manifest: BankManifest, other: BankManifest) -> tuple[str, ...]:
    """Return the frames with equal names and geometry in two banks, in the order of the first."""
    theirs = other.geometry
    return tuple(frame for frame, digest in manifest.geometry.items() if theirs.get(frame) == digest)


def _unlike(frame: Frame, other: Frame) -> tuple[str, ...]:
    """Return the names of the parts that differ between two frames."""
    parts = ("scenario", "episode", "step", "cameras", "fields", "state", "motion", "past")
    found = [name for name in parts if getattr(frame, name) != getattr(other, name)]
    names = sorted(frame.truth.keys() | other.truth.keys())
    return (*found, *(name for name in names if frame.truth.get(name, "") != other.truth.get(name, "")))
