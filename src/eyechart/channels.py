"""What a policy is given comes by channels: cameras, state, instruction; a condition exchanges one of them.

A condition over a channel is written ``swapped@camera:wrist``. Whose channel a frame is shown
belongs to the bank: every run on it shows the same, and no frame is shown what another frame of its
own episode has.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from eyechart.errors import BankError, SpecError
from eyechart.frames import Frame, FrameBank, Source, Stimulus
from eyechart.patterns import pattern
from eyechart.seeds import key_seed
from eyechart.spaces.motion import MotionSpace, reflect
from eyechart.stats.outliers import outlying, recurs
from eyechart.stats.partners import NOBODY, Places, balanced_partners, matched_partners, near_partners, reaches

CAMERAS, STATE, INSTRUCTION = "cameras", "state", "instruction"
CAMERA = "camera:"
"""Stands before the name of a camera that is a channel of its own."""
ALONE = "alone"
"""Shows a channel of the frame whose pictures `swapped` shows, so that all subsets of channels have
one partner."""
BY_STATE = ("matched", "near")
"""The conditions whose other frame is chosen by its state."""
OBJECTS = ("named", "other")
"""What a world moves: what the instruction names, and what it does not."""
LEAST_REACH = 0.8
"""A picture of the own episode is as far off as the matched one where each number changes by so
much of its square."""
STILL = 1e-3
"""A number of the state that changes by less of it never changes within an episode."""
TOLD = "told_"
"""Stands before the name of a moved object where the instruction is another's too."""
MOVES = tuple(f"{which}_{side}" for which in OBJECTS for side in ("plus", "minus"))

_SIGNS = pattern(r"[!\"(),:;?\[\]{}`“”…«»。，！？]|[.\-–—](?!\s*\d)")
"""Punctuation of a text; not that of a number, nor an arrow."""
_APOSTROPHES = str.maketrans("", "", "'’‘")


def channels_of(bank: FrameBank) -> tuple[str, ...]:
    """Return the channels of a bank: all cameras, each where there are several, the state and the instruction."""
    names = [one.name for one in bank.frames[0].cameras]
    found = [CAMERAS, *(f"{CAMERA}{name}" for name in names if len(names) > 1)]
    found += [STATE] if bank.manifest.state else []
    return (*found, *([INSTRUCTION] if instruction_column(bank) else []))


def reads(channel: str, declared: Sequence[str]) -> bool:
    """Return whether a channel is among the declared ones; ``cameras`` stand for each, and any one for all together."""
    if channel == CAMERAS:
        return any(one == channel or one.startswith(CAMERA) for one in declared)
    return channel in declared or (channel.startswith(CAMERA) and CAMERAS in declared)


def require_channels(spec: str, declared: Sequence[str], bank: FrameBank) -> None:
    """Raise SpecError where a policy declares a channel that the bank has not; a single camera may be named."""
    there = dict.fromkeys((*channels_of(bank), *(f"{CAMERA}{one.name}" for one in bank.frames[0].cameras)))
    for name in declared:
        if name not in there:
            raise SpecError(f"'{spec}' declares the channel '{name}', and the bank has {', '.join(there)}")


def instruction_column(bank: FrameBank) -> str | None:
    """Return the prompt column that tells a policy what to do: ``instruction``, or the one that there is, or none.

    Raises BankError where there are several and none has that name.
    """
    columns = bank.manifest.prompt_columns
    if INSTRUCTION in columns or len(columns) < 2:
        return INSTRUCTION if INSTRUCTION in columns else next(iter(columns), None)
    raise BankError(
        f"the bank {bank.root} may say {', '.join(columns)}: which is the instruction? name it 'instruction'"
    )


def reflected(seen: Stimulus, space: MotionSpace) -> Stimulus:
    """Return a mirrored stimulus with the words and the state of the reflected world, where the space says them."""
    if space.words:
        said = {name: space.reflect_text(one) if isinstance(one, str) else one for name, one in seen.fields.items()}
        seen = replace(seen, fields=said)
    if not space.state:
        return seen
    numbers = reflect(np.array(flat_state(seen.state)), space.state)
    found, at = {}, 0
    for name, values in seen.state.items():
        found[name] = tuple(map(float, numbers[at : at + len(values)]))
        at += len(values)
    return replace(seen, state=found)


def flat_state(state: Mapping[str, tuple[float, ...]]) -> tuple[float, ...]:
    """Return all numbers of a state in its order, as a policy gets them."""
    return tuple(number for numbers in state.values() for number in numbers)


def state_names(bank: FrameBank) -> list[str]:
    """Return the name of each number of the state, that of its state where nobody names the numbers."""
    space = bank.manifest.motion
    named = [one.name for one in space.state] if space is not None else []
    return named or [name for name, many in bank.frames[0].state.items() for _ in many]


def partner_of(frame: Frame, source: Source, base: str, channel: str) -> Frame:
    """Return whose channel a frame is shown; raises BankError where nobody's can be."""
    place = partner_place(frame, source, base, channel)
    if place == NOBODY:
        raise BankError(f"frame '{frame.id}' has no partner for {base}@{channel}: no other episode differs there")
    return source.frames[place]


def partner_place(frame: Frame, source: Source, base: str, channel: str) -> int:
    """Return the place of the frame whose channel a frame is shown, `NOBODY` where nobody's can be."""
    images = source.manifest.images if isinstance(source, FrameBank) else None
    return int(partners(source.frames, *whose(base, channel), images)[_places(_Same(source.frames))[frame.id]])


def told(fields: Mapping[str, object]) -> tuple[object, ...]:
    """Return what a policy is told, equal where it differs in case, blanks or punctuation alone.

    Whether two other texts say the same, nobody can tell from them: "reach red" and "go to the red
    one" are two.
    """
    found = []
    for name, one in fields.items():
        plain = (
            " ".join(_SIGNS.sub(" ", one.casefold().translate(_APOSTROPHES)).split()) if isinstance(one, str) else ""
        )
        found.append((name, plain or one))
    return tuple(found)


def partners(frames: Sequence[Frame], how: str, channel: str, images: Mapping[str, str] | None = None) -> Places:
    """Return the place of each frame's partner, shape (n,), NOBODY where it has none.

    ``how`` is ``swapped``, ``matched`` or ``near``. ``images`` maps a picture's file to its digest:
    a partner's picture differs from the frame's own; without them all pictures are taken to differ.
    One camera's partners are those of all cameras, but where one of these has the same picture
    there.
    """
    return _partners(_Same(frames, images), how, channel)


def own_pictures(bank: FrameBank, channel: str, frames: Places | None = None) -> tuple[str, list[str]]:
    """Return in which number of the state pictures of the own episode (``near``) are nearer than the matched ones.

    In words, empty where in none: then a policy that reads its own pose answers to them as much as
    to the matched ones. And which numbers never change within an episode: where they are the fewer
    ones, nobody can be held to them. ``frames`` are places in the bank, by default of all frames
    that have both partners.
    """
    near, matched = (partners(bank.frames, name, channel, bank.manifest.images) for name in ("near", "matched"))
    asked = np.flatnonzero((near != NOBODY) & (matched != NOBODY)) if frames is None else frames
    if not len(asked):
        return "", []
    states = np.array([flat_state(frame.state) for frame in bank])
    ratios = reaches(states, asked, near[asked], matched[asked])
    names = state_names(bank)
    still = ratios < STILL
    if 2 * int(still.sum()) <= int(np.isfinite(ratios).sum()):
        ratios = np.where(still, np.inf, ratios)
    if not len(ratios) or ratios.min() >= LEAST_REACH:
        return "", [f"number {place + 1} ('{names[place]}')" for place in np.flatnonzero(still).tolist()]
    worst = int(ratios.argmin())
    which = f"number {worst + 1} of the state ('{names[worst]}')"
    less = f"{ratios[worst]:.0%} of the matched ones' squared change"
    return f"pictures of its own episode differ less in {which}: {less}", []


def far_off(bank: FrameBank) -> Mapping[str, tuple[str, ...]]:
    """Return of each frame whose logged motion holds a number that is a fault of the log which dimensions these are.

    It lies far from all others, by `eyechart.stats.outliers`, in one episode or few, relative to
    the state as motions are compared, and nobody declares the scale of its dimension. Such a frame
    counts as one without a logged motion: one row of a wrong unit would be the scale of its
    dimension.
    """
    space = bank.manifest.motion
    return {} if space is None else _far(_Same(bank.frames), space)[0]


def rare(bank: FrameBank) -> frozenset[str]:
    """Return the dimensions of the motion with a few numbers far from all others, faults or moves that are rare."""
    space = bank.manifest.motion
    return frozenset() if space is None else _far(_Same(bank.frames), space)[1]


def relative_log(frames: Sequence[Frame], space: MotionSpace) -> npt.NDArray[np.float64]:
    """Return the logged motions of frames that have one, as `relative` does."""
    return relative(np.array([frame.motion for frame in frames]), frames, space)


def relative(motions: npt.NDArray[np.float64], frames: Sequence[Frame], space: MotionSpace) -> npt.NDArray[np.float64]:
    """Return motions relative to the states of the frames that they belong to, shape (frames, steps, dimensions)."""
    states = np.array([flat_state(frame.state) for frame in frames])
    return space.relative(motions, states if states.size else None)


def logs(bank: FrameBank) -> list[Frame]:
    """Return the frames with a logged motion, but for those in which it is far off."""
    far = far_off(bank)
    return [frame for frame in bank if frame.motion and frame.id not in far]


def whose(base: str, channel: str) -> tuple[str, str]:
    """Return by which partners a condition is shown: with one channel kept, or alone, by those of all cameras."""
    return (base if base in BY_STATE else "swapped"), CAMERAS if base in {"kept", ALONE} else channel


class _Same:
    """Frames as a key, by which tuple they are, with the digests of their pictures."""

    def __init__(self, frames: Sequence[Frame], images: Mapping[str, str] | None = None) -> None:
        self.frames, self.images = frames, images

    def __hash__(self) -> int:
        return id(self.frames)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.frames is self.frames and other.images is self.images

    def seen(self, channel: str) -> Sequence[object]:
        """Return what each frame's pictures of a channel are, equal where they are the same to the byte."""
        every = [one.name for one in self.frames[0].cameras]
        names = [channel.removeprefix(CAMERA)] if channel.startswith(CAMERA) else every
        if self.images is None or not set(names) <= set(every):
            return range(len(self.frames))
        files = [[frame.pictures[name] for name in names] for frame in self.frames]
        return [tuple(self.images.get(file, file) for file in many) for many in files]


@lru_cache(maxsize=16)
def _far(same: _Same, space: MotionSpace) -> tuple[Mapping[str, tuple[str, ...]], frozenset[str]]:
    """Return which dimensions are far off in which frames by a fault, and which have numbers that are far at all."""
    frames, names = [frame for frame in same.frames if frame.motion], [one.name for one in space.dimensions]
    if not frames:
        return {}, frozenset()
    numbers = relative_log(frames, space)
    far = outlying(numbers.reshape(-1, len(names)), at_once=space.horizon).reshape(numbers.shape).any(axis=1)
    faults = far & ~recurs(far, [frame.drive for frame in frames])
    faults &= np.array([one.scale is None for one in space.dimensions])
    found = {
        frame.id: tuple(names[place] for place in np.flatnonzero(faults[row]))
        for row, frame in enumerate(frames)
        if faults[row].any()
    }
    return found, frozenset(names[place] for place in np.flatnonzero(far.any(axis=0)))


@lru_cache(maxsize=128)
def _partners(same: _Same, how: str, channel: str) -> Places:
    frames, seen = same.frames, same.seen(channel)
    if channel.startswith(CAMERA):
        shared = _partners(same, how, CAMERAS)
        if all(place == NOBODY or seen[number] != seen[place] for number, place in enumerate(shared)):
            return shared
    episodes = [frame.drive for frame in frames]
    if how in BY_STATE:
        states = [flat_state(frame.state) for frame in frames]
        if how == "matched":
            return matched_partners(episodes, states, seen)
        return near_partners(episodes, states, _partners(same, "matched", channel), seen)
    values: dict[str, Sequence[object]] = {
        STATE: [tuple(frame.state.items()) for frame in frames],
        INSTRUCTION: [told(frame.fields) for frame in frames],
    }
    seed = key_seed("partners", channel, *(frame.id for frame in frames))
    return balanced_partners(episodes, values.get(channel, seen), seed=seed)


@lru_cache(maxsize=16)
def _places(same: _Same) -> Mapping[str, int]:
    return {frame.id: place for place, frame in enumerate(same.frames)}
