"""What a policy is given comes by channels: cameras, state, instruction; a condition exchanges one of them.

A condition over a channel is written ``swapped@camera:wrist``. Whose channel a frame is shown belongs to the bank:
every run on it shows the same, and no frame is shown what another frame of its own episode has.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import numpy.typing as npt

from eyechart.conditions import CONDITIONS, OVER, Condition, Source, available, find_condition
from eyechart.conditions import show as show_pictures
from eyechart.conditions import sources as picture_sources
from eyechart.errors import BankError, SpecError, meant
from eyechart.frames import Frame, FrameBank, Stimulus
from eyechart.patterns import pattern
from eyechart.seeds import key_seed
from eyechart.spaces.motion import MotionSpace, reflect
from eyechart.stats.outliers import outlying, recurs
from eyechart.stats.partners import NOBODY, Places, balanced_partners, matched_partners, near_partners, reaches
from eyechart.stats.shapley import Subset, subsets

CAMERAS, STATE, INSTRUCTION = "cameras", "state", "instruction"
CAMERA = "camera:"
"""Stands before the name of a camera that is a channel of its own."""
ALONE = "alone"
"""Shows a channel of the frame whose pictures `swapped` shows, so that all subsets of channels have one partner."""
PARTNERS = ("swapped", "matched", "near", "kept", ALONE)
"""The conditions that show another frame's channel: any, one of a similar state, of the own episode; all but one."""
BY_STATE = ("matched", "near")
"""Those of them whose frame is chosen by its state."""
OBJECTS = ("named", "other")
"""What a world moves: what the instruction names, and what it does not."""
LEAST_MATCHED = 0.25
"""Of fewer frames with a partner at a similar state nothing is asked of those that have one."""
LEAST_REACH = 0.8
"""A picture of the own episode is as far off as the matched one where each number changes by so much of its square."""
STILL = 1e-3
"""A number of the state that changes by less of it never changes within an episode."""
TOLD = "told_"
"""Stands before the name of a moved object where the instruction is another's too."""
MOVES = tuple(f"{which}_{side}" for which in OBJECTS for side in ("plus", "minus"))

_ASKS = {
    "swapped": ("another episode's", "does the channel decide?"),
    "matched": ("that of another episode at a similar state", "does it tell more than the state?"),
    "near": (
        "that of its own episode, as far off in its state as the matched one or farther",
        "is it no more than the pose?",
    ),
    "kept": ("its own, all others another episode's", "is the channel enough?"),
    ALONE: ("that of the moment whose pictures are swapped", "what is its Shapley share?"),
}
_DRAWN = {
    **{name: (f"same moment, {name.replace('_', ' moved ')}", "is the object followed?") for name in MOVES},
    **{
        f"{TOLD}{name}": (
            f"same moment, {name.replace('_', ' moved ')}, another instruction",
            "is the named one followed?",
        )
        for name in MOVES
    },
    "exchanged": ("same moment, the objects' colours exchanged", "does it know which is which?"),
    "recoloured": ("same moment, another table", "does paint decide?"),
    "decoys": ("same moment, further objects", "do others distract it?"),
}
_SIGNS = pattern(r"[!\"(),:;?\[\]{}`“”…«»。，！？]|[.\-–—](?!\s*\d)")
"""Punctuation of a text; not that of a number, nor an arrow."""
_APOSTROPHES = str.maketrans("", "", "'’‘")
_PLAIN = ("real", "real_repeat", "nudged", "blank", "noise", "mirrored")
EXCHANGED = "exchanged"
"""The drawn pictures that are shown of one camera alone too: the state stays, so that what they change is no pose."""


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


def conditions_of(bank: FrameBank, *, reading: bool = True) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the conditions that a policy is asked on a bank, and why it is not asked the others.

    Without ``reading`` no picture is opened, which a run has no copy of: ``mirrored`` is not among them.
    """
    every, left_out = ["real", "real_repeat", "nudged"], {}
    for channel in channels_of(bank):
        over = channel.removeprefix(CAMERA) if channel.startswith(CAMERA) else ""
        every += [f"{name}{OVER}{channel}" for name in PARTNERS if name != ALONE and not (over and name == "kept")]
        if channel == CAMERAS:
            every += ["blank", "noise"]
        elif over:
            every.append(f"blank{OVER}{over}")
            every += [f"{EXCHANGED}{OVER}{over}"] if all(EXCHANGED in frame.counterfactuals for frame in bank) else []
    every += [*(["mirrored"] if reading else []), *_DRAWN]
    for name in every:
        if why := _lacking(name, bank):
            left_out[name] = why
    return tuple(name for name in every if name not in left_out), left_out


def further_conditions(bank: FrameBank) -> tuple[str, ...]:
    """Return the conditions that a bank can show and that are asked only where they are named.

    Noise in place of one camera's pictures, and that camera's alone kept; of several cameras.
    """
    names = [one.removeprefix(CAMERA) for one in channels_of(bank) if one.startswith(CAMERA)]
    wanted = [one for name in names for one in (f"noise{OVER}{name}", f"kept{OVER}{CAMERA}{name}")]
    return tuple(one for one in wanted if not _lacking(one, bank))


def listed_conditions() -> dict[str, str]:
    """Return the conditions of policies that stand over a channel or a camera, or are drawn, each in words."""
    found = {f"{name}{OVER}CHANNEL": f"{image}: {asks}" for name, (image, asks) in _ASKS.items()}
    found |= {name: f"{image}: {asks}" for name, (image, asks) in _DRAWN.items()}
    for name in ("blank", "noise", EXCHANGED):
        one = find_exchange(name)
        found[f"{name}{OVER}CAMERA"] = f"{one.image}, in one camera: {one.asks}"
    return found


def unshown_channels(bank: FrameBank) -> dict[str, str]:
    """Return the channels of a bank that cannot be exchanged, with why: of a camera, that its pictures are alike."""
    left_out = conditions_of(bank)[1]
    names = {channel: f"swapped{OVER}{channel}" for channel in channels_of(bank)}
    return {channel: left_out[name] for channel, name in names.items() if name in left_out}


def subset_conditions(bank: FrameBank) -> dict[Subset, str]:
    """Return under which condition each subset of the channels is the partner's: cameras, state and instruction.

    None of them is ``real``; all of them is the partner's own moment, which is no condition, and is left out. The
    partner is the same for all. Empty where the bank has no channel but its cameras.
    """
    whole = [name for name in channels_of(bank) if not name.startswith(CAMERA)]
    if len(whole) < 2:
        return {}
    return {some: _subset_condition(some, whole) for some in subsets(whole)[:-1]}


def _subset_condition(some: Subset, whole: Sequence[str]) -> str:
    if not some:
        return "real"
    if some == {CAMERAS}:
        return f"swapped{OVER}{CAMERAS}"
    if len(some) == len(whole) - 1:
        return f"kept{OVER}{next(name for name in whole if name not in some)}"
    return f"{ALONE}{OVER}{next(iter(some))}"


def _lacking(name: str, bank: FrameBank) -> str:
    """Return why a bank cannot show a condition, nothing where it can."""
    base, _, channel = name.partition(OVER)
    if base in PARTNERS:
        return _unpartnered(base, channel, bank)
    if base.startswith(TOLD) and instruction_column(bank) is None:
        return "the bank has no instruction"
    if name == "mirrored" and (bank.manifest.motion is None or not bank.manifest.motion.mirrored):
        return "the bank does not say what a reflected motion is"
    if name == "mirrored" and (pair := _unlike_pair(bank)):
        return f"the pictures of {pair}, which exchange places, have other sizes"
    lacking = sum(not shown(name, frame, bank) for frame in bank)
    what = "mirror axis" if name == "mirrored" else "such picture"
    return f"{lacking} of {len(bank)} frames have no {what}" if lacking else ""


def _unlike_pair(bank: FrameBank) -> str:
    """Return two cameras that exchange places under reflection and whose pictures have other sizes, in words."""
    first = bank.frames[0]
    pairs = [(one.name, one.mirrors) for one in first.cameras if one.mirrors]
    shapes = bank.shapes(first) if pairs else {}
    return next((f"'{one}' and '{other}'" for one, other in pairs if shapes[one] != shapes[other]), "")


def _unpartnered(base: str, channel: str, bank: FrameBank) -> str:
    """Return why not every frame has a partner, or of a similar state hardly one; nothing where they have."""
    if base in BY_STATE and channel in {STATE, INSTRUCTION}:
        return "only pictures are matched by the state"
    if base in BY_STATE and not bank.manifest.state:
        return "the bank has no state to match by"
    without = _alone("swapped", channel, bank)
    if without:
        return f"{without} of {len(bank)} frames have no frame of another episode that differs in {_its_name(channel)}"
    if base in BY_STATE and (without := _alone(base, channel, bank)) > (1 - LEAST_MATCHED) * len(bank):
        return f"{without} of {len(bank)} frames have no frame of another episode at a similar state"
    return ""


def _its_name(channel: str) -> str:
    return f"the {channel.removeprefix(CAMERA)} camera" if channel.startswith(CAMERA) else f"its {channel}"


def _alone(base: str, channel: str, bank: FrameBank) -> int:
    """Return how many frames have no partner."""
    return int((partners(bank.frames, *whose(base, channel), bank.manifest.images) == NOBODY).sum())


def find_exchange(name: str) -> Condition:
    """Return the condition of a policy of this name; raises SpecError that lists the known ones."""
    base, over, channel = name.partition(OVER)
    if base in PARTNERS and (channel in {CAMERAS, STATE, INSTRUCTION} or channel.startswith(CAMERA)):
        image, asks = _ASKS[base]
        return Condition(name, f"{channel}: {image}", asks, partial(_exchanged, base, channel))
    if base in _DRAWN and (not over or base == EXCHANGED):
        image, asks = _DRAWN[base]
        of_one = f"{image}, in the {channel} camera" if over else image
        return Condition(name, of_one, asks, partial(_moved, base, channel), frozenset({"counterfactual"}))
    if base in _PLAIN:
        return find_condition(name)
    known = (*_PLAIN, *(f"{one}{OVER}CHANNEL" for one in PARTNERS), *_DRAWN)
    raise SpecError(f"unknown condition '{name}' of a policy;{meant(name, known)} known are {', '.join(known)}")


def shown(name: str, frame: Frame, source: Source) -> bool:
    """Return whether a frame can be shown under a condition of a policy."""
    base, _, channel = name.partition(OVER)
    if base in _DRAWN:
        return base.removeprefix(TOLD) in frame.counterfactuals
    if base in PARTNERS:
        return _partnered(frame, source, base, channel) != NOBODY
    return available(name, frame)


def show(condition: str, frame: Frame, source: Source, run_seed: int) -> Stimulus:
    """Return what a policy is shown of a frame under a condition.

    Pictures that are drawn at random are seeded from (condition, frame, run seed).
    """
    if condition.partition(OVER)[0] in CONDITIONS.keys() - _DRAWN:
        return show_pictures(condition, frame, source, run_seed)
    return find_exchange(condition).make(frame, source, key_seed("stimulus", run_seed, condition, frame.id))


def sources(name: str, frame: Frame, source: Source, run_seed: int) -> tuple[str, ...]:
    """Return the files of the bank of which a condition's pictures of a frame are made."""
    base, _, channel = name.partition(OVER)
    if base in PARTNERS:
        other = partner_of(frame, source, base, channel).pictures
        return tuple(dict.fromkeys((*frame.pictures.values(), *other.values())))
    if base in _DRAWN:
        drawn = frame.counterfactuals[base.removeprefix(TOLD)]
        return tuple(dict.fromkeys([*frame.pictures.values(), drawn[channel]] if channel else drawn.values()))
    return picture_sources(name, frame, source, run_seed)


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
    place = _partnered(frame, source, base, channel)
    if place == NOBODY:
        raise BankError(f"frame '{frame.id}' has no partner for {base}{OVER}{channel}: no other episode differs there")
    return source.frames[place]


def _partnered(frame: Frame, source: Source, base: str, channel: str) -> int:
    images = source.manifest.images if isinstance(source, FrameBank) else None
    return int(partners(source.frames, *whose(base, channel), images)[_places(_Same(source.frames))[frame.id]])


def told(fields: Mapping[str, object]) -> tuple[object, ...]:
    """Return what a policy is told, equal where it differs in case, blanks or punctuation alone.

    Whether two other texts say the same, nobody can tell from them: "reach red" and "go to the red one" are two.
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

    ``how`` is ``swapped``, ``matched`` or ``near``. ``images`` maps a picture's file to its digest: a partner's picture
    differs from the frame's own; without them all pictures are taken to differ. One camera's partners are those of all
    cameras, but where one of these has the same picture there.
    """
    return _partners(_Same(frames, images), how, channel)


def own_pictures(bank: FrameBank, channel: str, frames: Places | None = None) -> tuple[str, list[str]]:
    """Return in which number of the state pictures of the own episode (``near``) are nearer than the matched ones.

    In words, empty where in none: then a policy that reads its own pose answers to them as much as to the matched ones.
    And which numbers never change within an episode: where they are the fewer ones, nobody can be held to them.
    ``frames`` are places in the bank, by default of all frames that have both partners.
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

    It lies far from all others, by `eyechart.stats.outliers`, in one episode or few, relative to the state as motions
    are compared, and nobody declares the scale of its dimension. Such a frame counts as one without a logged motion:
    one row of a wrong unit would be the scale of its dimension.
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


def _exchanged(base: str, channel: str, frame: Frame, source: Source, _: int) -> Stimulus:
    """Return a frame with one channel of its partner, or, where it is kept, with all of the partner's but one."""
    own, other = frame, partner_of(frame, source, base, channel)
    given, taken = (other, own) if base == "kept" else (own, other)
    images = dict(source.images(given))
    if channel == CAMERAS:
        images = dict(source.images(taken))
    elif channel.startswith(CAMERA):
        name = channel.removeprefix(CAMERA)
        if name not in images:
            raise BankError(f"frame '{frame.id}' has no camera '{name}'; it has {', '.join(images)}")
        images[name] = source.images(taken)[name]
    fields = taken.fields if channel == INSTRUCTION else given.fields
    return Stimulus(images, fields, taken.state if channel == STATE else given.state)


def _moved(name: str, camera: str, frame: Frame, source: Source, _: int) -> Stimulus:
    """Return the pictures of the same moment with something moved, with another's instruction where that is told.

    Of one ``camera`` alone where it is named.
    """
    fields, images = frame.fields, source.images(frame, name.removeprefix(TOLD))
    if name.startswith(TOLD):
        fields = partner_of(frame, source, "swapped", INSTRUCTION).fields
    if camera:
        if camera not in images:
            raise BankError(f"frame '{frame.id}' has no camera '{camera}'; it has {', '.join(images)}")
        images = {**source.images(frame), camera: images[camera]}
    return Stimulus(images, fields, frame.state)
