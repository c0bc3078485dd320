"""Input conditions: what a query shows of a frame; the rest of the query stays the same."""

from bisect import bisect_right
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import chain
from typing import Any

import numpy as np

from eyechart.channels import ALONE, CAMERA, CAMERAS, INSTRUCTION, MOVES, STATE, TOLD, partner_of, partner_place
from eyechart.corruptions import CORRUPTIONS, LEAST_SIDE, STEPS, Corruption, step_of
from eyechart.errors import BankError, SpecError, did_you_mean, require_known
from eyechart.frames import PATCHED, RGB, Camera, Frame, FrameBank, PictureEncoding, Source, Stimulus, decode, noises
from eyechart.seeds import key_seed
from eyechart.stats.partners import NOBODY

MID_GREY = 128
OVER = "@"
"""Separates a condition from its camera, channel or corruption: ``blank@wrist``, ``swapped@state``,
``lead_near@fog_3``."""
FROZEN = "frozen"
"""The first picture of a drive, or of a bank's window, at every instant."""
ONE_INSTANT = "the bank holds earlier instants, and has no such pictures of them"
"""Why a frame with a past cannot be shown a picture in which one thing was changed."""
NO_HISTORY = "the bank holds no instants before a frame; make it with 'eyechart frames import' and --history N"
"""Why other banks cannot show `FROZEN`."""
AGAIN, ABSENT = "real_again", "lead_absent"
"""The true picture in the stage of the picture without the lead, for frames with both."""
EXCHANGED = "exchanged"
"""Drawn pictures that are shown of one camera alone too.

The state stays, so an effect is no change of pose.
"""
_MODELS, _POLICIES = frozenset({"model"}), frozenset({"policy"})


@dataclass(frozen=True, slots=True)
class Condition:
    """One row of Table t:conditions: what it shows, and the question that it answers.

    ``make(frame, source, seed)`` returns the stimulus, and raises BankError if the source cannot
    supply it. ``seed`` is the frame's own, so the order of calls has no effect.

    ``needs`` names what a source must have. It is an ``axis`` of reflection, a ``partner`` in the
    scenario, a ``stranger`` of another scenario, or a ``counterfactual`` picture with one change.
    It may also be a ``text`` in the prompt, or a ``drive``. A ``control`` can remove a claim, never
    make one. ``drawn`` is the counterfactual that it is made of, if that has another name.

    ``over`` says what may follow its name: a ``camera``, nothing (""), or a ``channel``. A channel
    must follow, and is the first argument of ``make``. ``subjects`` names them: a ``model``, a
    ``policy``, or both.
    """

    name: str
    image: str
    asks: str
    make: Callable[..., Stimulus]
    needs: frozenset[str] = frozenset()
    drawn: str = ""
    over: str = "camera"
    subjects: frozenset[str] = _MODELS


def _shown(frame: Frame, images: Mapping[str, bytes]) -> Stimulus:
    """Return other pictures with a frame's fields and state."""
    return Stimulus(images, frame.fields, frame.state)


def _each(shown: Callable[..., Stimulus], *frames: Frame) -> Stimulus:
    """Return what ``shown`` makes of frames, and of the instants before them.

    With two frames, it gets the instants of both that are equally long ago.
    """
    past = tuple(shown(*many) for many in zip(*(one.past for one in frames), strict=True))
    now = shown(*frames)
    return replace(now, past=past) if past else now


def _real(frame: Frame, source: Source, _: int) -> Stimulus:
    return _each(lambda one: _shown(one, source.images(one)), frame)


def _again(frame: Frame, source: Source, seed: int) -> Stimulus:
    if ABSENT not in frame.counterfactuals:
        raise BankError(f"frame '{frame.id}' has no picture {ABSENT}, which {AGAIN} needs")
    return _real(frame, source, seed)


def _blank(frame: Frame, source: Source, _: int) -> Stimulus:
    def grey(one: Frame) -> Stimulus:
        return _shown(one, {name: _grey(shape, source.encoding) for name, shape in source.shapes(one).items()})

    return _each(grey, frame)


@lru_cache(maxsize=8)
def _grey(shape: tuple[int, int, int], encoding: PictureEncoding) -> bytes:
    return encoding.picture(np.full(shape, MID_GREY, dtype=np.uint8))


def _noise(frame: Frame, source: Source, seed: int) -> Stimulus:
    written, shapes = source.encoding.noise, [source.shapes(one) for one in frame.window]
    drawn, each = noises(seed, [shape for one in shapes for shape in one.values()]), iter(shapes)

    def noise(one: Frame) -> Stimulus:
        return _shown(one, {name: written(next(drawn)) for name in next(each)})

    return _each(noise, frame)


def _other(name: str) -> Callable[[Frame, Source, int], Stimulus]:
    """Return the maker of the pictures of a frame's partner under this condition."""

    def make(frame: Frame, source: Source, seed: int) -> Stimulus:
        other = partner(frame, source, seed, name)
        return _each(lambda own, theirs: _shown(own, source.images(theirs)), frame, other)

    return make


def _mirrored(frame: Frame, source: Source, _: int) -> Stimulus:
    def mirrored(instant: Frame) -> Stimulus:
        if instant.mirror_axis == "none":
            raise BankError(f"frame '{instant.id}' has no mirror axis, so it cannot be shown mirrored")
        seen, axes = source.images(instant), {camera.name: camera.mirror_axis for camera in instant.cameras}
        images = {}
        for one in instant.cameras:
            other = one.mirrors or one.name
            pixels = flip(decode(seen[other], instant.pictures[other]), axes[other])
            images[one.name] = source.encoding.picture(pixels)
        return _shown(instant, images)

    return _each(mirrored, frame)


def _frozen(frame: Frame, source: Source, _: int) -> Stimulus:
    """Return the first picture of the drive, or of the frame's window, at every instant."""
    first = source.images(frame.past[0]) if frame.past else source.images(frame, FROZEN)
    return _each(lambda one: _shown(one, first), frame)


def _drawn(name: str) -> Callable[[Frame, Source, int], Stimulus]:
    """Return the maker of the counterfactual of this name.

    It shows one instant. A frame with a past has no such pictures of the others.
    """

    def make(frame: Frame, source: Source, _: int) -> Stimulus:
        if frame.past:
            raise BankError(f"frame '{frame.id}' cannot be shown {name}: {ONE_INSTANT}")
        return _shown(frame, source.images(frame, name))

    return make


def _nudged(name: str, of: str | None = None) -> Callable[[Frame, Source, int], Stimulus]:
    """Return the maker of nudged pictures, true or counterfactual.

    One value of one pixel changes by one level: other files, the same pictures. The pixel is in the
    first row, the sky or the verge of a road, where a reader of exact colours loses nothing. A
    picture of this name in the frame is shown as it is.
    """

    def make(frame: Frame, source: Source, seed: int) -> Stimulus:
        if name in frame.counterfactuals and not frame.past:
            return _shown(frame, source.images(frame, name))
        rng = np.random.default_rng(seed)

        def nudged(one: Frame) -> Stimulus:
            files, images = one.pictures if of is None else one.counterfactuals.get(of, {}), {}
            for camera, picture in source.images(one, of).items():
                pixels = decode(picture, files[camera]).copy()
                _, width, channels = pixels.shape
                pixels[0, int(rng.integers(width)), int(rng.integers(channels))] ^= 1
                images[camera] = source.encoding.picture(pixels)
            return _shown(one, images)

        return _each(nudged, frame)

    return make


def is_nudged(picture: bytes, of: bytes) -> bool:
    """Return whether a picture differs from another by one level of one pixel value."""
    one, other = (decode(each, "a picture").astype(np.int16) for each in (picture, of))
    return one.shape == other.shape and int(np.abs(one - other).sum()) == 1


def _text_only(frame: Frame, *_: object) -> Stimulus:
    return _each(lambda one: _shown(one, {}), frame)


def _text_swapped(frame: Frame, source: Source, seed: int) -> Stimulus:
    other = text_source_frame(frame, source, seed)

    def swap(own: Frame, theirs: Frame) -> Stimulus:
        state = {name: (theirs if name in source.said else own).state[name] for name in own.state}
        return Stimulus(source.images(own), theirs.fields, state)

    return _each(swap, frame, other)


def _instructed(name: str) -> Callable[[Frame, Source, int], Stimulus]:
    """Return the maker of a counterfactual with another episode's instruction."""
    return lambda frame, source, seed: replace(
        _drawn(name)(frame, source, seed), fields=partner_of(frame, source, "swapped", INSTRUCTION).fields
    )


def _exchanged(base: str) -> Callable[[str, Frame, Source, int], Stimulus]:
    """Return the maker of a frame with one channel of its partner, or all but one (``kept``)."""

    def make(channel: str, frame: Frame, source: Source, _: int) -> Stimulus:
        other = partner_of(frame, source, base, channel)
        return mixed(other, frame, channel, source) if base == "kept" else mixed(frame, other, channel, source)

    return make


def mixed(given: Frame, taken: Frame, channel: str, source: Source) -> Stimulus:
    """Return the frame ``given`` with one channel of the frame ``taken``, at every instant."""

    def mix(own: Frame, other: Frame) -> Stimulus:
        images = dict(source.images(own))
        if channel == CAMERAS:
            images = dict(source.images(other))
        elif channel.startswith(CAMERA):
            name = channel.removeprefix(CAMERA)
            require_picture(name, own, images)
            images[name] = source.images(other)[name]
        fields = other.fields if channel == INSTRUCTION else own.fields
        return Stimulus(images, fields, other.state if channel == STATE else own.state)

    return _each(mix, given, taken)


def require_picture(camera: str, frame: Frame, images: Mapping[str, bytes]) -> None:
    """Raise BankError if a frame has no picture of a camera."""
    if camera not in images:
        raise BankError(f"frame '{frame.id}' has no camera '{camera}'; it has {', '.join(images)}")


_AXIS, _DRAWN = frozenset({"axis"}), frozenset({"counterfactual"})
_CONTROL = frozenset({"control"})
_BOTH = _MODELS | _POLICIES


def _moment(name: str, image: str, asks: str, also: frozenset[str] = frozenset(), **how: Any) -> Condition:  # noqa: ANN401
    """Return a condition that shows the same moment with one change."""
    return Condition(name, f"same moment, {image}", asks, _drawn(name), _DRAWN | also, **how)


TABLE: dict[str, Condition] = {
    one.name: one
    for one in (
        Condition("real", "true frame", "reference", _real, subjects=_BOTH),
        Condition("real_repeat", "true frame, 2nd call", "noise floor", _real, subjects=_BOTH),
        Condition("blank", "uniform mid-grey", "is the image read at all?", _blank, subjects=_BOTH),
        Condition("noise", "uniform random RGB", "is any content used?", _noise, subjects=_BOTH),
        Condition(
            "shuffled", "other frame, same scenario", "is this frame used?", _other("shuffled"), frozenset({"partner"})
        ),
        Condition(
            "cross_scenario",
            "frame, other scenario",
            "is scene context used?",
            _other("cross_scenario"),
            frozenset({"stranger"}),
        ),
        Condition(
            "text_only",
            "none",
            "prompt alone sufficient?",
            _text_only,
        ),
        Condition("mirrored", "flip across lane axis", "lateral grounding", _mirrored, _AXIS, subjects=_BOTH),
        _moment("lead_near", "lead vehicle near", "does distance decide?"),
        _moment("lead_far", "lead vehicle far", "does distance decide?"),
        *(
            Condition(
                f"{TOLD}{name}" if instructed else name,
                f"same moment, {name.replace('_', ' moved ')}{', another instruction' if instructed else ''}",
                "is the named one followed?" if instructed else "is the object followed?",
                _instructed(name) if instructed else _drawn(name),
                _DRAWN,
                name,
                over="",
                subjects=_POLICIES,
            )
            for instructed in (False, True)
            for name in MOVES
        ),
        _moment(EXCHANGED, "the objects' colours exchanged", "does it know which is which?", subjects=_POLICIES),
        _moment("recoloured", "ego recoloured", "does paint decide?", subjects=_BOTH),
        _moment("decoys", "further objects", "do others distract it?", over="", subjects=_POLICIES),
        _moment("lane_own", "lead near, neighbour far", "does it matter which one is near?", _CONTROL),
        _moment("lane_beside", "neighbour near, lead far", "does it matter which one is near?", _CONTROL),
        _moment("lead_mid_near", "lead at 9.1 to 20 m", "does its braking fall with distance?", _CONTROL),
        _moment("lead_mid_far", "lead at 20 to 49 m", "does its braking fall with distance?", _CONTROL),
        _moment(PATCHED, "lead cut out and pasted back, a hole filled elsewhere", "does the edit decide?", _CONTROL),
        _moment("lead_absent", "no lead vehicle", "does any lead decide, however far?", _CONTROL),
        Condition(
            "real_again", "true frame, with lead_absent", "has its answer changed by then?", _again, _CONTROL, ABSENT
        ),
        Condition(
            "nudged",
            "true frame, one value off by one",
            "picture or file?",
            _nudged("nudged"),
            _CONTROL,
            subjects=_BOTH,
        ),
        *(
            Condition(
                f"{name}_nudged" if again else name,
                f"same moment, {image}{', one value off by one' if again else ''}",
                "does it repeat its answer?" if again else asks,
                _nudged(f"{name}_nudged", name) if again else _drawn(name),
                _DRAWN | _CONTROL,
                name,
            )
            for name, image, asks, both in (
                ("lead_near", "lead vehicle near", "does distance decide?", (True,)),
                ("lead_drawn", "lead anywhere", "does its braking fall with distance?", (False, True)),
                ("exchange_own", "lead anywhere, neighbour far", "does it matter which one is near?", (False, True)),
                ("exchange_beside", "neighbour anywhere, lead far", "does it matter which one is near?", (False,)),
                ("exchange_apart", "lead and neighbour far", "what does it answer with no vehicle near?", (False,)),
            )
            for again in both
        ),
        Condition(
            "text_swapped",
            "true frame, other text",
            "does the text decide?",
            _text_swapped,
            frozenset({"text"}),
            over="",
        ),
        *(
            Condition(base, image, asks, _exchanged(base), over="channel", subjects=_POLICIES)
            for base, image, asks in (
                ("swapped", "another episode's", "does the channel decide?"),
                ("matched", "that of another episode at a similar state", "does it tell more than the state?"),
                (
                    "near",
                    "that of its own episode, as far off in its state as the matched one or farther",
                    "is the effect more than the pose?",
                ),
                ("kept", "its own, all others another episode's", "is the channel enough?"),
                (ALONE, "that of the moment whose pictures are swapped", "what is its Shapley share?"),
            )
        ),
        Condition(
            FROZEN,
            "first picture of the drive, or of the instants shown",
            "is the current picture used?",
            _frozen,
            frozenset({"drive"}),
            subjects=_BOTH,
        ),
    )
}
"""All conditions: of banks, of worlds that are driven, and of a policy's channels."""


def _corrupted(what: Corruption, step: int, make: Callable[..., Stimulus] = _real) -> Callable[..., Stimulus]:
    """Return the maker of pictures at a step of a corruption; ``make`` is that of the pictures.

    Each camera has one draw for all instants, as dirt on a lens has.
    """

    def corrupted(frame: Frame, source: Source, seed: int) -> Stimulus:
        def seen(one: Stimulus) -> Stimulus:
            images = {
                name: source.encoding.picture(
                    what.applied(decode(picture, f"{name} of frame '{frame.id}'"), step, key_seed(seed, name))
                )
                for name, picture in one.images.items()
            }
            return replace(one, images=images, past=tuple(map(seen, one.past)))

        return seen(make(frame, source, seed))

    return corrupted


STEPPED: dict[str, Condition] = {
    f"{what.name}_{step}": Condition(
        f"{what.name}_{step}",
        f"true frame under {what.words}, step {step} of {len(STEPS)}: {what.quantity} {what.amounts[step - 1]:g}",
        f"does it still see under {what.words}?",
        _corrupted(what, step),
    )
    for what in CORRUPTIONS.values()
    for step in STEPS
}
"""The true picture at each step of each corruption. They are asked where they are named."""

CONDITIONS: dict[str, Condition] = {
    name: condition for name, condition in TABLE.items() if condition.subjects >= _MODELS
}
"""The conditions of models."""

PARTNERS: tuple[str, ...] = tuple(name for name, condition in TABLE.items() if condition.over == "channel")
"""Conditions that exchange channels with a partner: any one of another episode, one at a similar
state, or one of the own episode. ``kept`` exchanges all channels but the named one."""

CORRUPTIBLE = frozenset({"real_repeat", "shuffled"})
"""The conditions that a step of a corruption may follow, beside counterfactuals."""

BATTERY: tuple[str, ...] = (
    "real",
    "real_repeat",
    "blank",
    "noise",
    "shuffled",
    "cross_scenario",
    "text_only",
    "mirrored",
)
"""The eight conditions of Table t:conditions, which the paper's statistics use."""

CONTROLS: tuple[str, ...] = tuple(name for name, condition in CONDITIONS.items() if "control" in condition.needs)
"""Controls, which remove a claim that rests on something other than the lead's distance."""

NUDGES: Mapping[str, str] = {f"{name}_nudged": name for name in ("lead_near", "lead_drawn", "exchange_own")}
"""Controls that repeat a counterfactual with one value off by one; made here or kept in a bank."""

RANGED: tuple[str, ...] = (*NUDGES, "lead_drawn", "exchange_own", "exchange_beside", "exchange_apart")
"""Controls with distances over a world's whole range, and their companions."""

OLDER: tuple[str, ...] = ("lane_own", "lane_beside", "lead_mid_near", "lead_mid_far")
"""Controls with a few distances, for a bank without those over the whole range."""

FURTHER: tuple[str, ...] = tuple(name for name in CONTROLS if name not in {*RANGED, *OLDER, ABSENT, AGAIN, "nudged"})
"""Optional controls, asked with `RANGED` if the bank has them."""

COUNTERFACTUALS: tuple[str, ...] = tuple(
    name for name, condition in CONDITIONS.items() if "counterfactual" in condition.needs and name not in CONTROLS
)
"""Pictures of the same moment with one change, if the simulator can draw them."""

OF_BANKS: tuple[str, ...] = tuple(name for name, condition in CONDITIONS.items() if "drive" not in condition.needs)
"""The conditions that a bank of single instants may supply; a battery uses all of them but the
controls."""

OF_WORLDS: tuple[str, ...] = tuple(
    name for name, condition in CONDITIONS.items() if condition.needs <= {"axis", "partner", "drive"}
)
"""The conditions of a driven world: pictures of the moment, of other worlds, or of the start."""


def of_bank(bank: FrameBank) -> tuple[str, ...]:
    """Return the conditions that a bank may supply: with earlier instants, also `FROZEN`."""
    return (*OF_BANKS, FROZEN) if bank.manifest.history else OF_BANKS


def partner(frame: Frame, source: Source, seed: int, condition: str) -> Frame:
    """Return the frame whose picture ``shuffled`` or ``cross_scenario`` shows.

    It is never the frame itself. Raises BankError that names frame and scenario if the source has
    no such frame.
    """
    mine = source.scenarios[frame.scenario]
    if condition == "shuffled":
        others, need = len(mine) - 1, f"another frame in scenario '{frame.scenario}'"
    else:
        others, need = len(source.frames) - len(mine), f"a frame of another scenario than '{frame.scenario}'"
    if not others:
        raise BankError(f"frame '{frame.id}' has no partner for {condition}: the bank needs {need}")
    place = int(np.random.default_rng(seed).integers(others))
    if condition == "shuffled":
        return mine[place + (place >= source.places[frame.id])]
    elsewhere = [frames for scenario, frames in source.scenarios.items() if scenario != frame.scenario]
    while place >= len(elsewhere[0]):  # a list of their frames would be long
        place -= len(elsewhere.pop(0))
    return elsewhere[0][place]


def flip(pixels: RGB, axis: str) -> RGB:
    """Return the picture, shape (h, w, 3), flipped across the lane axis.

    It flips rows for ``vertical`` and columns for ``horizontal``. Raises SpecError for any other
    axis.
    """
    if axis not in {"vertical", "horizontal"}:
        raise SpecError(f"a picture is flipped across the axis vertical or horizontal, not '{axis}'")
    return pixels[::-1] if axis == "vertical" else pixels[:, ::-1]


def show(condition: str, frame: Frame, source: Source, run_seed: int) -> Stimulus:
    """Return a condition's stimulus for a frame.

    Its seed is made from (condition, frame, run seed), so every model sees the same one.
    """
    who = min(_row(condition).subjects)
    return find_condition(condition, who).make(frame, source, seed_of(condition, frame, run_seed))


def seed_of(condition: str, frame: Frame, run_seed: int) -> int:
    """Return the seed of a frame's stimulus under a condition.

    A corruption has one seed for all its steps and all pictures of the frame, so that they differ
    in nothing else.
    """
    if (found := corruption_of(condition)) is not None:
        return key_seed("corruption", run_seed, found[0].name, frame.id)
    kind = "text" if "text" in _row(condition).needs else "stimulus"
    return key_seed(kind, run_seed, condition, frame.id)


def corruption_of(condition: str) -> tuple[Corruption, int] | None:
    """Return the corruption of a condition and its step: of ``fog_3`` and ``lead_near@fog_3``."""
    base, _, what = condition.partition(OVER)
    return step_of(base) or step_of(what)


def sources(name: str, frame: Frame, source: Source, run_seed: int) -> tuple[str, ...]:
    """Return the bank's files behind a condition's pictures of a frame; none if it shows none."""
    base, over, camera = name.partition(OVER)
    over = "" if step_of(camera) else over
    row, many = _row(name), [one.pictures for one in frame.window]
    own = [file for files in many for file in files.values()] if over else []
    if row.over == "channel":
        many = [one.pictures for one in partner_of(frame, source, base, camera).window]
    elif base == "text_only":
        many = []
    elif base == FROZEN:
        many = many[:1]
    elif "counterfactual" in row.needs:
        files = frame.counterfactuals[base if base in frame.counterfactuals else row.drawn or base]
        many = [{camera: files[camera]} if over else files]
    elif row.needs & {"partner", "stranger"}:
        many = [one.pictures for one in partner(frame, source, seed_of(name, frame, run_seed), base).window]
    return tuple(dict.fromkeys((*own, *(file for files in many for file in files.values()))))


def text_source_frame(frame: Frame, source: Source, seed: int) -> Frame:
    """Return the frame whose text a prompt states under text_swapped.

    It differs in the prompt's fields, and is of the same scenario if possible. Raises BankError if
    all frames of the bank have the same text.
    """
    frames, same = source.alike(frame)
    if len(frames) == len(same):
        columns = [*frame.stated(source.said)]
        raise BankError(f"frame '{frame.id}' cannot get another frame's text: all frames have the same {columns}")
    place = int(np.random.default_rng(seed).integers(len(frames) - len(same)))
    before = bisect_right(range(len(same)), place, key=lambda skipped: same[skipped] - skipped)
    return frames[place + before]


def find_condition(name: str, who: str = "model") -> Condition:
    """Return the condition of this name, also over one camera or channel.

    ``who`` is the subject: a ``model`` or a ``policy``. Raises SpecError that lists the known ones.
    """
    base, over, what = name.partition(OVER)
    row = TABLE.get(base) or STEPPED.get(base)
    if row is None or who not in row.subjects or not _may_be_over(row, over, what):
        of, near = (" of a policy", name) if who == "policy" else ("", base)
        known = [f"{one.name}{OVER}CHANNEL" * (one.over == "channel") or one.name for one in asked_of(who)]
        if who == "model":
            near, known = name, [*known, *(f"{what}_{STEPS[0]} to {what}_{STEPS[-1]}" for what in CORRUPTIONS)]
        raise SpecError(f"unknown condition '{name}'{of};{did_you_mean(near, known)} known are {', '.join(known)}")
    if (step := step_of(what)) is not None:
        image = f"{row.image}, under {step[0].words}, step {step[1]} of {len(STEPS)}"
        return replace(row, name=name, image=image, make=_corrupted(*step, row.make))
    return _over(row, what) if over else row


def asked_of(who: str) -> list[Condition]:
    """Return the conditions of a ``model`` or a ``policy``."""
    return [condition for condition in TABLE.values() if who in condition.subjects]


def _may_be_over(row: Condition, over: str, what: str) -> bool:
    """Return whether a camera or channel may follow a condition's name."""
    if row.over == "channel":
        return what in {CAMERAS, STATE, INSTRUCTION} or what.startswith(CAMERA)
    if step_of(what) is not None:
        return row.name in CORRUPTIBLE or "counterfactual" in row.needs
    return not over or bool(row.over)


def _row(name: str) -> Condition:
    """Return the row of a condition for any subject; raises SpecError if there is none."""
    base = name.partition(OVER)[0]
    return TABLE.get(base) or STEPPED.get(base) or find_condition(name)


def by_reason(left_out: Mapping[str, str]) -> dict[str, str]:
    """Return the reasons why conditions are left out, by comma-separated names."""
    names: dict[str, list[str]] = {}
    for name, why in left_out.items():
        names.setdefault(why, []).append(name)
    return {", ".join(many): why for why, many in names.items()}


def require_shown(name: str, cameras: Sequence[Camera]) -> None:
    """Raise SpecError if a condition is not one of drives, or these cameras cannot show it."""
    base = name.partition(OVER)[0]
    require_known(f"condition '{base}' of a closed loop", base, OF_WORLDS)
    if "axis" in CONDITIONS[base].needs and any(camera.mirror_axis == "none" for camera in cameras):
        raise SpecError(f"condition '{name}' needs a simulator with a mirror axis, but this one has none")
    require_camera(name, cameras)


def require_camera(name: str, cameras: Sequence[Camera]) -> None:
    """Raise SpecError if a condition is over a camera that is none of these."""
    _, over, camera = name.partition(OVER)
    if over and step_of(camera) is None and camera not in (names := [one.name for one in cameras]):
        raise SpecError(
            f"condition '{name}': there is no camera '{camera}';{did_you_mean(camera, names)} there are "
            f"{', '.join(names)}"
        )


def require_corruptible(names: Iterable[str], bank: FrameBank) -> None:
    """Raise BankError if a condition is a step of a corruption and a picture is too small for one."""
    if not any(corruption_of(name) for name in names):
        return
    for frame in bank:
        for camera, (high, wide, _) in chain.from_iterable(bank.shapes(one).items() for one in frame.window):
            if min(high, wide) < LEAST_SIDE:
                raise BankError(
                    f"'{camera}' of frame '{frame.id}' has {wide}x{high} pixels, and a corruption needs {LEAST_SIDE} "
                    "on the shorter side: leave out --series and its steps, or import larger pictures"
                )


def _over(whole: Condition, camera: str) -> Condition:
    """Return a condition over a channel or one camera; the others show the true pictures."""
    name = f"{whole.name}{OVER}{camera}"
    if whole.over == "channel":
        return replace(whole, name=name, image=f"{camera}: {whole.image}", make=partial(whole.make, camera))

    def merged(frame: Frame, source: Source, made: Stimulus) -> Stimulus:
        images = {**source.images(frame)}
        require_picture(camera, frame, images)
        if camera in made.images:
            images[camera] = made.images[camera]
        else:
            del images[camera]
        return replace(made, images=images)

    def make(frame: Frame, source: Source, seed: int) -> Stimulus:
        made = whole.make(frame, source, seed)
        past = tuple(merged(own, source, one) for own, one in zip(frame.past, made.past, strict=True))
        return replace(merged(frame, source, made), past=past)

    return replace(whole, name=name, image=f"{whole.image}, over {camera}", make=make)


def require_partners(names: Sequence[str], source: Source) -> None:
    """Raise BankError before any call if a frame lacks a condition's partner or other text."""
    for name in names:
        needs = find_condition(name).needs
        if needs & {"partner", "stranger"}:
            for frames in source.scenarios.values():
                partner(frames[0], source, 0, name.partition(OVER)[0])
        elif "text" in needs:
            text_source_frame(source.frames[0], source, 0)


def is_available(name: str, frame: Frame, source: Source | None = None) -> bool:
    """Return whether a frame can be shown under a condition.

    A condition over a channel needs the ``source`` too. A counterfactual picture that was not drawn
    and a missing mirror axis are absences, which scoring reports. A bank too small for ``shuffled``
    or ``cross_scenario`` is an error when its picture is made.
    """
    base, _, what = name.partition(OVER)
    row = _row(name)
    if row.over == "channel":
        return source is not None and partner_place(frame, source, base, what) != NOBODY
    if base == FROZEN:
        return bool(frame.past)
    if row.drawn or "counterfactual" in row.needs:
        return not frame.past and (base in frame.counterfactuals or row.drawn in frame.counterfactuals)
    return not ("axis" in row.needs and frame.mirror_axis == "none")


def is_of_one_instant(name: str, bank: FrameBank) -> bool:
    """Return whether a bank with earlier instants has a condition's pictures, of one instant alone."""
    row = _row(name)
    names = {row.name, row.drawn} if "counterfactual" in row.needs or row.drawn else set[str]()
    return any(frame.past and names & frame.counterfactuals.keys() for frame in bank)


SAMPLED, SHARE = (ABSENT, AGAIN), 0.05
"""Controls that are asked of a sample of frames: at most this share of a run's other calls."""
FEWEST = 25
"""Least frames in such a sample, if there are that many; fewer could never bound an effect."""


def sample(name: str, shown: Sequence[str], calls: int, seed: int) -> frozenset[str]:
    """Return the sample of frames for a control in `SAMPLED`, out of those ``shown`` under it.

    ``calls`` is the run's number of calls. The sample is the first part of `shuffled_order`. For
    `AGAIN`, the calls of `ABSENT` count as calls of the run.
    """
    most = min(len(shown), max(FEWEST, int(SHARE * calls + 1e-9)))
    if name == AGAIN:
        most = min(most, int(SHARE * (calls + most) + 1e-9))
    return frozenset(shuffled_order(shown, seed)[:most])


def shuffled_order(frames: Sequence[str], seed: int) -> list[str]:
    """Return frame ids in an order in which each place depends on the seed and the id alone."""
    return sorted(frames, key=lambda frame: (key_seed("stop early", seed, frame), frame))


def asked_in_stages(supplied: Collection[str]) -> tuple[str, ...]:
    """Return the controls for a run's stages: those over all distances, or the older ones."""
    left_out = OLDER if set(RANGED) <= set(supplied) else RANGED
    return tuple(name for name in CONTROLS if name in supplied and name not in left_out)


def undrawn_controls(source: Source) -> dict[str, int]:
    """Return how many frames lack each control that only some frames have; nudges do not count."""
    drawn = (name for name in CONTROLS if name not in {*NUDGES, AGAIN})
    have = {name: sum(is_available(name, frame) for frame in source.frames) for name in drawn}
    return {name: len(source.frames) - count for name, count in have.items() if 0 < count < len(source.frames)}
