"""Input channels of a policy: cameras, state and instruction; a condition exchanges one of them.

A condition over a channel is written ``swapped@camera:wrist``. The bank alone decides which frame's
channel is shown with which frame: every run on it shows the same. The partner never belongs to the
frame's own episode.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from eyechart.errors import BankError, SpecError, counted
from eyechart.frames import Frame, FrameBank, Source, Stimulus
from eyechart.records import build, parse_json
from eyechart.seeds import key_seed
from eyechart.spaces.motion import MotionSpace, reflect
from eyechart.spaces.rotations import Rotation, about_their_mean
from eyechart.stats.outliers import outlying, recurs
from eyechart.stats.partners import NOBODY, Places, balanced_partners, matched_partners, near_partners, reaches

CAMERAS, STATE, INSTRUCTION = "cameras", "state", "instruction"
CAMERA = "camera:"
"""Prefix of the name of a single camera as a channel."""
ALONE = "alone"
"""The condition that shows one channel of the frame whose pictures `swapped` shows. All subsets of
channels then have one partner."""
BY_STATE = ("matched", "near")
"""The conditions whose partner is chosen by its state."""
OBJECTS = ("named", "other")
"""The objects that a world moves: the object that the instruction names, and another."""
LEAST_REACH = 0.8
"""A picture of the same episode is as far off as the matched one if each number changes by at least
this share of the matched squared change."""
STILL = 1e-3
"""A number of the state whose share of the squared change is below this never changes within an
episode."""
TOLD = "told_"
"""Prefix of the name of a moved object if the instruction is exchanged too."""
MOVES = tuple(f"{which}_{side}" for which in OBJECTS for side in ("plus", "minus"))

_SIGNS = re.compile(r"[!\"(),:;?\[\]{}`“”…«»。，！？]|[.\-–—](?!\s*\d)")
"""Punctuation of a text, without the punctuation of numbers and without arrows."""
_APOSTROPHES = str.maketrans("", "", "'’‘")


def channels_of(bank: FrameBank) -> tuple[str, ...]:
    """Return the channels of a bank.

    These are all cameras together, each camera if there are several, the state and the instruction.
    """
    names = [camera.name for camera in bank.frames[0].cameras]
    found = [CAMERAS, *(f"{CAMERA}{name}" for name in names if len(names) > 1)]
    found += [STATE] if bank.manifest.state else []
    return (*found, *([INSTRUCTION] if instruction_column(bank) else []))


def reads(channel: str, declared: Sequence[str]) -> bool:
    """Return whether a channel is among the declared ones.

    ``cameras`` stands for each camera, and any declared camera stands for ``cameras``.
    """
    if channel == CAMERAS:
        return any(one == channel or one.startswith(CAMERA) for one in declared)
    return channel in declared or (channel.startswith(CAMERA) and CAMERAS in declared)


@dataclass(frozen=True)
class InputShapes:
    """What a policy takes and returns: picture sizes (h, w) by camera, and counts of numbers.

    ``state`` and ``action`` count the numbers of a state and of a step, ``steps`` those of a chunk.
    """

    cameras: Mapping[str, tuple[int, int]]
    state: int
    action: int
    steps: int

    FACT: ClassVar[str] = "shapes"

    def facts(self) -> dict[str, str]:
        """Return it as a fact of a model."""
        return {self.FACT: json.dumps({**asdict(self), "cameras": dict(self.cameras)})}

    @classmethod
    def of(cls, facts: Mapping[str, str]) -> "InputShapes | None":
        """Return what a model's facts say of it; None if they say nothing."""
        return build(cls, parse_json(facts[cls.FACT])) if cls.FACT in facts else None


def require_inputs(spec: str, facts: Mapping[str, str], bank: FrameBank) -> None:
    """Raise SpecError if a policy takes or returns what the bank does not have.

    A chunk may be longer than the bank's motions: its first steps are taken.
    """
    shapes, space = InputShapes.of(facts), bank.manifest.motion
    if shapes is not None and space is not None:
        _require_shapes(spec, shapes, space, bank)
    require_channels(spec, tuple(filter(None, facts.get("channels", "").split(", "))), bank)


def _require_shapes(spec: str, shapes: InputShapes, space: MotionSpace, bank: FrameBank) -> None:
    found = bank.shapes(bank.frames[0])
    for name, (high, wide) in shapes.cameras.items():
        if name not in found:
            raise SpecError(f"'{spec}' reads the camera '{name}', and the bank has {', '.join(found)}")
        if found[name][:2] != (high, wide):
            own = f"{found[name][1]}×{found[name][0]}"
            raise SpecError(
                f"'{spec}' reads pictures of {wide}×{high} of the camera '{name}', and the bank's have {own}. Import "
                "the data set that it was trained on, or write a callable that resizes them"
            )
    steps, numbers = space.shape
    state = len(flat_state(bank.frames[0].state))
    if shapes.state not in {0, state}:
        raise SpecError(f"'{spec}' reads {shapes.state} numbers of a state, and the bank's has {state}")
    if numbers != shapes.action:
        raise SpecError(f"'{spec}' answers with steps of {shapes.action} numbers, and the bank's have {numbers}")
    if steps > shapes.steps:
        raise SpecError(
            f"'{spec}' answers with {shapes.steps} steps, and the bank's motions have {steps}: import it again with "
            f"--horizon {shapes.steps} or less"
        )


def require_history(spec: str, history: int, bank: FrameBank) -> None:
    """Raise SpecError if a controller asks for more instants before a frame than the bank holds."""
    if history > bank.manifest.history:
        raise SpecError(
            f"'{spec}' declares history = {history}, and the bank {bank.root} holds "
            f"{counted(bank.manifest.history, 'instant')} before each frame; make the bank with 'eyechart frames "
            f"import' and --history {history}"
        )


def require_channels(spec: str, declared: Sequence[str], bank: FrameBank) -> None:
    """Raise SpecError if a policy declares a channel that the bank does not have."""
    there = dict.fromkeys((*channels_of(bank), *(f"{CAMERA}{camera.name}" for camera in bank.frames[0].cameras)))
    for name in declared:
        if name not in there:
            raise SpecError(f"'{spec}' declares the channel '{name}', and the bank has {', '.join(there)}")


def instruction_column(bank: FrameBank) -> str | None:
    """Return the prompt column that holds the instruction, None if the bank has no prompt column.

    It is the column ``instruction``, or the only column. Raises BankError if there are several and
    none has that name.
    """
    columns = bank.manifest.prompt_columns
    if INSTRUCTION in columns or len(columns) < 2:
        return INSTRUCTION if INSTRUCTION in columns else next(iter(columns), None)
    raise BankError(
        f"the bank {bank.root} has the prompt columns {', '.join(columns)}; name the instruction's 'instruction'"
    )


def reflected(stimulus: Stimulus, space: MotionSpace) -> Stimulus:
    """Return a mirrored stimulus whose words and state are reflected too, if the space says how."""
    if stimulus.past:
        stimulus = replace(stimulus, past=tuple(reflected(one, space) for one in stimulus.past))
    if space.words:
        said = {
            name: space.reflect_text(field) if isinstance(field, str) else field
            for name, field in stimulus.fields.items()
        }
        stimulus = replace(stimulus, fields=said)
    if not space.state:
        return stimulus
    numbers = reflect(np.array(flat_state(stimulus.state)), space.state)
    found, at = {}, 0
    for name, values in stimulus.state.items():
        found[name] = tuple(map(float, numbers[at : at + len(values)]))
        at += len(values)
    return replace(stimulus, state=found)


def flat_state(state: Mapping[str, tuple[float, ...]]) -> tuple[float, ...]:
    """Return all numbers of a state in the order in which a policy gets them."""
    return tuple(number for numbers in state.values() for number in numbers)


def state_names(bank: FrameBank) -> list[str]:
    """Return the name of each number of the state; a number without one gets its state's name."""
    space = bank.manifest.motion
    named = [one.name for one in space.state] if space is not None else []
    return named or [name for name, many in bank.frames[0].state.items() for _ in many]


def partner_of(frame: Frame, source: Source, base: str, channel: str) -> Frame:
    """Return the partner whose channel a frame is shown; raises BankError if there is none."""
    place = partner_place(frame, source, base, channel)
    if place == NOBODY:
        raise BankError(f"frame '{frame.id}' has no partner for {base}@{channel}: no other episode has a different one")
    return source.frames[place]


def partner_place(frame: Frame, source: Source, base: str, channel: str) -> int:
    """Return the place of a frame's partner among the frames, `NOBODY` if there is none."""
    images, space = (source.manifest.images, source.manifest.motion) if isinstance(source, FrameBank) else (None, None)
    return int(
        partners(source.frames, *whose(base, channel), images, space)[_places(_FrameKeys(source.frames))[frame.id]]
    )


def instruction_key(fields: Mapping[str, object]) -> tuple[object, ...]:
    """Return the texts without differences in case, spaces and punctuation.

    It cannot recognise two texts of one meaning: "reach red" and "go to the red one" stay
    different.
    """
    found = []
    for name, one in fields.items():
        plain = (
            " ".join(_SIGNS.sub(" ", one.casefold().translate(_APOSTROPHES)).split()) if isinstance(one, str) else ""
        )
        found.append((name, plain or one))
    return tuple(found)


def partners(
    frames: Sequence[Frame],
    how: str,
    channel: str,
    images: Mapping[str, str] | None = None,
    space: MotionSpace | None = None,
) -> Places:
    """Return the place of each frame's partner, shape (n,), NOBODY if it has none.

    ``how`` is ``swapped``, ``matched`` or ``near``. ``images`` maps a picture's file to its digest,
    and a partner's picture differs from the frame's own, or that of an instant before it. Without
    ``images`` all pictures are taken to differ. ``space`` says which numbers of the state are
    rotations. A single camera has the partners of all cameras, unless one of those has the same
    picture there.
    """
    return _partners(_FrameKeys(frames, images, () if space is None else space.rotations_of("state")), how, channel)


def own_pictures(bank: FrameBank, channel: str, frames: Places | None = None) -> tuple[str, list[str]]:
    """Return a note if pictures of the same episode are too near in one number of the state.

    The note names the number in which the ``near`` pictures are nearer than the matched ones. It is
    empty if there is none: a policy that reads only its own pose then answers to both kinds
    equally. Also returns the numbers that never change within an episode, if these are the
    minority: no policy can be tested on them. ``frames`` are places in the bank, by default of all
    frames that have both partners.
    """
    manifest = bank.manifest
    near, matched = (
        partners(bank.frames, name, channel, manifest.images, manifest.motion) for name in ("near", "matched")
    )
    chosen = np.flatnonzero((near != NOBODY) & (matched != NOBODY)) if frames is None else frames
    if not len(chosen):
        return "", []
    turns = () if manifest.motion is None else manifest.motion.rotations_of("state")
    ratios = reaches(_states(bank.frames, turns), chosen, near[chosen], matched[chosen])
    names = _compared_names(state_names(bank), turns, manifest.history)
    still = ratios < STILL
    if 2 * int(still.sum()) <= int(np.isfinite(ratios).sum()):
        ratios = np.where(still, np.inf, ratios)
    if not len(ratios) or ratios.min() >= LEAST_REACH:
        return "", [f"number {place + 1} ('{names[place]}')" for place in np.flatnonzero(still).tolist()]
    worst = int(ratios.argmin())
    which = f"number {worst + 1} of the state ('{names[worst]}')"
    less = f"{ratios[worst]:.0%} of the matched ones' squared change"
    return f"pictures of the same episode differ less in {which}: {less}", []


def far_off(bank: FrameBank) -> Mapping[str, tuple[str, ...]]:
    """Return, by frame, the dimensions in which its logged motion holds a fault of the log.

    Such a number lies far from all others (`eyechart.stats.outliers`), in one episode or few,
    relative to the state as motions are compared. Dimensions with a declared scale are exempt. Such
    a frame counts as one without a logged motion: one row in a wrong unit would set the scale of
    its dimension.
    """
    space = bank.manifest.motion
    return {} if space is None else _far(_FrameKeys(bank.frames), space)[0]


def rare(bank: FrameBank) -> frozenset[str]:
    """Return the dimensions of motion with a few far numbers, which are faults or rare moves."""
    space = bank.manifest.motion
    return frozenset() if space is None else _far(_FrameKeys(bank.frames), space)[1]


def relative_log(frames: Sequence[Frame], space: MotionSpace) -> npt.NDArray[np.float64]:
    """Return the logged motions of frames, relative as in `relative`; each frame must have one."""
    return relative(np.array([frame.motion for frame in frames]), frames, space)


def relative(motions: npt.NDArray[np.float64], frames: Sequence[Frame], space: MotionSpace) -> npt.NDArray[np.float64]:
    """Return motions relative to their frames' states, shape (frames, steps, dimensions)."""
    states = np.array([flat_state(frame.state) for frame in frames])
    return space.relative(motions, states if states.size else None)


def logs(bank: FrameBank) -> list[Frame]:
    """Return the frames with a logged motion, without those in which it is far off."""
    far = far_off(bank)
    return [frame for frame in bank if frame.motion and frame.id not in far]


def whose(base: str, channel: str) -> tuple[str, str]:
    """Return the partner condition and channel that decide which frame a condition shows."""
    return (base if base in BY_STATE else "swapped"), CAMERAS if base in {"kept", ALONE} else channel


class _FrameKeys:
    """Frames as a cache key by the identity of their tuple, with the digests of their pictures."""

    def __init__(
        self, frames: Sequence[Frame], images: Mapping[str, str] | None = None, turns: tuple[Rotation, ...] = ()
    ) -> None:
        self.frames, self.images, self.turns = frames, images, turns

    def __hash__(self) -> int:
        return id(self.frames)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _FrameKeys):
            return False
        return other.frames is self.frames and other.images is self.images and other.turns == self.turns

    def seen(self, channel: str) -> Sequence[object]:
        """Return a key of each frame's pictures of a channel, equal for identical bytes."""
        every = [camera.name for camera in self.frames[0].cameras]
        names = [channel.removeprefix(CAMERA)] if channel.startswith(CAMERA) else every
        if self.images is None or not set(names) <= set(every):
            return range(len(self.frames))
        files = [[one.pictures[name] for one in frame.window for name in names] for frame in self.frames]
        return [tuple(self.images.get(file, file) for file in many) for many in files]


def _states(frames: Sequence[Frame], turns: tuple[Rotation, ...]) -> npt.NDArray[np.float64]:
    """Return the states as they are compared: a rotation is its turn from the mean, 3 numbers.

    Behind a frame's own state are the changes from instant to instant before it. A window also
    tells a velocity, and two moments at one place may differ in it.
    """
    windows = np.array([[flat_state(one.state) for one in frame.window] for frame in frames])
    count, instants, width = windows.shape
    states = windows.reshape(count * instants, width)
    states = about_their_mean(states, turns) if turns else states
    windows = states.reshape(count, instants, states.shape[1])
    changes = np.diff(windows, axis=1).reshape(count, (instants - 1) * states.shape[1])
    return np.concatenate([windows[:, -1], changes], axis=1)


def _compared_names(names: Sequence[str], turns: Sequence[Rotation], history: int) -> list[str]:
    """Return the names of the numbers of `_states`."""
    own = _turned_names(names, turns)
    return own + [f"change of {name}, {ago} before" for ago in range(history - 1, -1, -1) for name in own]


def _turned_names(names: Sequence[str], turns: Sequence[Rotation]) -> list[str]:
    """Return the names of a state's numbers, in which each rotation is three."""
    by_first, found = {one.first: one for one in turns}, list[str]()
    taken = {number for one in turns for number in one.numbers}
    for place, name in enumerate(names):
        if place in by_first:
            found += [f"rotation from {name} on, about {axis}" for axis in "xyz"]
        elif place not in taken:
            found.append(name)
    return found


@lru_cache(maxsize=16)
def _far(same: _FrameKeys, space: MotionSpace) -> tuple[Mapping[str, tuple[str, ...]], frozenset[str]]:
    """Return the faulty dimensions of each frame, and the dimensions with any far number."""
    frames, dimensions = (
        [frame for frame in same.frames if frame.motion],
        [space.dimensions[one] for one in space.plain],
    )
    if not frames or not dimensions:
        return {}, frozenset()
    names = [dimension.name for dimension in dimensions]
    numbers = relative_log(frames, space)[..., : len(names)]  # a rotation is bounded, and has no far number
    far = outlying(numbers.reshape(-1, len(names)), at_once=space.horizon).reshape(numbers.shape).any(axis=1)
    faults = far & ~recurs(far, [frame.drive for frame in frames])
    faults &= np.array([dimension.scale is None for dimension in dimensions])
    found = {
        frame.id: tuple(names[place] for place in np.flatnonzero(faults[row]))
        for row, frame in enumerate(frames)
        if faults[row].any()
    }
    return found, frozenset(names[place] for place in np.flatnonzero(far.any(axis=0)))


@lru_cache(maxsize=128)
def _partners(same: _FrameKeys, how: str, channel: str) -> Places:
    frames, seen = same.frames, same.seen(channel)
    if channel.startswith(CAMERA):
        shared = _partners(same, how, CAMERAS)
        if all(place == NOBODY or seen[number] != seen[place] for number, place in enumerate(shared)):
            return shared
    episodes = [frame.drive for frame in frames]
    if how in BY_STATE:
        states = _states(frames, same.turns)
        if how == "matched":
            return matched_partners(episodes, states, seen)
        return near_partners(episodes, states, _partners(same, "matched", channel), seen)
    values: dict[str, Sequence[object]] = {
        STATE: [tuple(frame.state.items()) for frame in frames],
        INSTRUCTION: [instruction_key(frame.fields) for frame in frames],
    }
    seed = key_seed("partners", channel, *(frame.id for frame in frames))
    return balanced_partners(episodes, values.get(channel, seen), seed=seed)


@lru_cache(maxsize=16)
def _places(same: _FrameKeys) -> Mapping[str, int]:
    return {frame.id: place for place, frame in enumerate(same.frames)}
