"""An input condition decides which picture is shown for a frame; everything else of the query stays the same."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eyechart.errors import BankError, SpecError
from eyechart.frames import RGB, Frame, FrameBank, decode, encode
from eyechart.seeds import key_seed

MID_GREY = 128


@dataclass(frozen=True, slots=True)
class Condition:
    """One row of Table t:conditions: its image, and the question that it answers.

    ``make(frame, bank, seed)`` returns the encoded picture, or None where the condition shows none; it raises
    BankError where the bank cannot supply it. ``seed`` is the frame's own, so the order of calls has no say.
    ``counterfactual`` marks pictures that the simulator drew of the same moment with one thing changed,
    ``swaps_text`` the condition that keeps the picture and says what a prompt says of another frame.
    """

    name: str
    image: str
    asks: str
    make: Callable[[Frame, FrameBank, int], bytes | None]
    counterfactual: bool = False
    swaps_text: bool = False


def _real(frame: Frame, bank: FrameBank, seed: int) -> bytes:
    del seed
    return bank.image(frame)


def _blank(frame: Frame, bank: FrameBank, seed: int) -> bytes:
    del seed
    return encode(grey(_pixels(frame, bank)))


def _noise(frame: Frame, bank: FrameBank, seed: int) -> bytes:
    return encode(static(_pixels(frame, bank), seed))


def _shuffled(frame: Frame, bank: FrameBank, seed: int) -> bytes:
    return bank.image(partner(frame, bank, seed, "shuffled"))


def _cross_scenario(frame: Frame, bank: FrameBank, seed: int) -> bytes:
    return bank.image(partner(frame, bank, seed, "cross_scenario"))


def _text_only(frame: Frame, bank: FrameBank, seed: int) -> None:
    del frame, bank, seed


def _mirrored(frame: Frame, bank: FrameBank, seed: int) -> bytes:
    del seed
    if frame.mirror_axis == "none":
        raise BankError(f"frame '{frame.id}' has no mirror axis, so it cannot be shown mirrored")
    return encode(flip(_pixels(frame, bank), frame.mirror_axis))


def _lead_near(frame: Frame, bank: FrameBank, seed: int) -> bytes:
    del seed
    return bank.image(frame, "lead_near")


def _lead_far(frame: Frame, bank: FrameBank, seed: int) -> bytes:
    del seed
    return bank.image(frame, "lead_far")


def _recoloured(frame: Frame, bank: FrameBank, seed: int) -> bytes:
    del seed
    return bank.image(frame, "recoloured")


CONDITIONS: dict[str, Condition] = {
    "real": Condition("real", "true frame", "reference", _real),
    "real_repeat": Condition("real_repeat", "true frame, 2nd call", "noise floor", _real),
    "blank": Condition("blank", "uniform mid-grey", "is the image read at all?", _blank),
    "noise": Condition("noise", "uniform random RGB", "is any content used?", _noise),
    "shuffled": Condition("shuffled", "other frame, same scenario", "is this frame used?", _shuffled),
    "cross_scenario": Condition("cross_scenario", "frame, other scenario", "is scene context used?", _cross_scenario),
    "text_only": Condition("text_only", "none", "prompt alone sufficient?", _text_only),
    "mirrored": Condition("mirrored", "flip across lane axis", "lateral grounding", _mirrored),
    "lead_near": Condition("lead_near", "same moment, lead vehicle near", "does distance decide?", _lead_near, True),
    "lead_far": Condition("lead_far", "same moment, lead vehicle far", "does distance decide?", _lead_far, True),
    "recoloured": Condition("recoloured", "same moment, ego recoloured", "does paint decide?", _recoloured, True),
    "text_swapped": Condition("text_swapped", "true frame, other text", "does the text decide?", _real, False, True),
}

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
"""The eight conditions of Table t:conditions; the paper's statistics are of these, whatever else is asked."""

COUNTERFACTUALS: tuple[str, ...] = tuple(name for name, condition in CONDITIONS.items() if condition.counterfactual)
"""Pictures of the same moment with one thing changed, where the simulator can draw them."""

_NEEDS_PARTNER = ("shuffled", "cross_scenario")


def partner(frame: Frame, bank: FrameBank, seed: int, condition: str) -> Frame:
    """Return the frame whose picture ``shuffled`` or ``cross_scenario`` shows; never the frame itself.

    Raises BankError, naming frame and scenario, where the bank holds no such frame.
    """
    if condition == "shuffled":
        others = [other for other in bank.scenarios[frame.scenario] if other.id != frame.id]
        need = f"another frame in scenario '{frame.scenario}'"
    else:
        elsewhere = (frames for scenario, frames in bank.scenarios.items() if scenario != frame.scenario)
        others = list(itertools.chain.from_iterable(elsewhere))
        need = f"a frame of another scenario than '{frame.scenario}'"
    if not others:
        raise BankError(f"frame '{frame.id}' has no partner for {condition}: the bank needs {need}")
    return others[int(np.random.default_rng(seed).integers(len(others)))]


def grey(pixels: RGB) -> RGB:
    """Return a uniform mid-grey picture of the size of this one, shape (h, w, 3)."""
    return np.full_like(pixels, MID_GREY)


def static(pixels: RGB, seed: int) -> RGB:
    """Return a picture of uniform random colours of the size of this one, shape (h, w, 3)."""
    return np.random.default_rng(seed).integers(0, 256, pixels.shape, dtype=np.uint8)


def flip(pixels: RGB, axis: str) -> RGB:
    """Return the picture, shape (h, w, 3), flipped across the lane axis: rows for vertical, columns for horizontal.

    Raises SpecError for any other axis.
    """
    if axis not in {"vertical", "horizontal"}:
        raise SpecError(f"a picture is flipped across the axis vertical or horizontal, not '{axis}'")
    return pixels[::-1] if axis == "vertical" else pixels[:, ::-1]


def show(condition: str, frame: Frame, bank: FrameBank, run_seed: int) -> bytes | None:
    """Return the encoded picture that a condition shows for a frame, or None for no picture.

    The stimulus is seeded from (condition, frame, run seed), so every model sees the same one.
    """
    seed = key_seed("stimulus", run_seed, condition, frame.id)
    return find_condition(condition).make(frame, bank, seed)


def source(name: str, frame: Frame, bank: FrameBank, run_seed: int) -> str | None:
    """Return the file of the bank of which a condition's picture of a frame is made, None where it shows none."""
    if name == "text_only":
        return None
    if find_condition(name).counterfactual:
        return frame.counterfactuals[name]
    if name in _NEEDS_PARTNER:
        return partner(frame, bank, key_seed("stimulus", run_seed, name, frame.id), name).file
    return frame.file


def speaker(name: str, frame: Frame, bank: FrameBank, run_seed: int, fields: tuple[str, ...]) -> Frame:
    """Return the frame of which a prompt's ``fields`` speak under a condition: itself, or for text_swapped another.

    The other says something else in these fields; it is of the same scenario where there is such a frame. Raises
    BankError where no frame of the bank says anything else.
    """
    if not find_condition(name).swaps_text:
        return frame
    told = [frame.fields[field] for field in fields]
    others = [other for other in bank if [other.fields[field] for field in fields] != told]
    near = [other for other in others if other.scenario == frame.scenario] or others
    if not near:
        raise BankError(f"frame '{frame.id}' cannot be told another frame's text: all frames say the same {told}")
    return near[int(np.random.default_rng(key_seed("text", run_seed, name, frame.id)).integers(len(near)))]


def find_condition(name: str) -> Condition:
    """Return the condition of this name; raises SpecError that lists the known ones."""
    if name not in CONDITIONS:
        raise SpecError(f"unknown condition '{name}'; known are {', '.join(CONDITIONS)}")
    return CONDITIONS[name]


def available(name: str, frame: Frame) -> bool:
    """Return whether a frame can be shown under a condition.

    A counterfactual picture that was not drawn and a missing mirror axis are absences that scoring reports.
    A bank too small for ``shuffled`` or ``cross_scenario`` is an error, raised when its picture is made.
    """
    if find_condition(name).counterfactual:
        return name in frame.counterfactuals
    return not (name == "mirrored" and frame.mirror_axis == "none")


def require_partners(names: tuple[str, ...], bank: FrameBank, fields: tuple[str, ...] = ()) -> None:
    """Raise BankError before any call is made if a frame lacks the partner that a condition needs.

    ``fields`` are what the prompt says of a frame, for text_swapped.
    """
    for name in names:
        if name in _NEEDS_PARTNER:
            for frames in bank.scenarios.values():
                partner(frames[0], bank, 0, name)
        elif find_condition(name).swaps_text:
            speaker(name, bank.frames[0], bank, 0, fields)


def _pixels(frame: Frame, bank: FrameBank) -> RGB:
    return decode(bank.image(frame), frame.file)
