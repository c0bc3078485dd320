"""What a driver is shown in place of the camera's picture: the conditions of a closed loop, in one literal dict."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eyechart.conditions import flip, grey, static
from eyechart.errors import SpecError
from eyechart.frames import RGB, MirrorAxis


@dataclass(frozen=True, slots=True)
class View:
    """One moment of the camera: what it shows now and at first, and what it shows in other worlds of the scenario.

    ``real()`` is drawn when it is asked for. ``pool()`` returns pictures of other worlds, none of them of this moment.
    ``seed`` belongs to the condition at this moment, whoever drives.
    """

    real: Callable[[], RGB]
    first: RGB
    pool: Callable[[], Sequence[Callable[[], RGB]]]
    mirror_axis: MirrorAxis
    seed: int


def _real(view: View) -> RGB:
    return view.real()


def _blank(view: View) -> RGB:
    return grey(view.first)


def _noise(view: View) -> RGB:
    return static(view.first, view.seed)


def _shuffled(view: View) -> RGB:
    pool = view.pool()
    return pool[int(np.random.default_rng(view.seed).integers(len(pool)))]()


def _frozen(view: View) -> RGB:
    return view.first


def _mirrored(view: View) -> RGB:
    return np.ascontiguousarray(flip(view.real(), view.mirror_axis))


SHOWN: Mapping[str, Callable[[View], RGB]] = {
    "real": _real,
    "blank": _blank,
    "noise": _noise,
    "shuffled": _shuffled,
    "frozen": _frozen,
    "mirrored": _mirrored,
}

MEANS: Mapping[str, str] = {
    "real": "the camera's picture",
    "blank": "uniform mid-grey",
    "noise": "uniform random colours, others at every step",
    "shuffled": "the picture of another moment, of another world of the same scenario",
    "frozen": "the first picture of the episode, for ever",
    "mirrored": "the camera's picture, left and right exchanged",
}
"""What each condition shows, in words."""


def require_shown(condition: str, mirror_axis: MirrorAxis) -> None:
    """Raise SpecError where a condition is unknown, or a world's pictures have no mirror axis to flip across."""
    if condition not in SHOWN:
        raise SpecError(f"unknown condition '{condition}' of a closed loop; known are {', '.join(SHOWN)}")
    if condition == "mirrored" and mirror_axis == "none":
        raise SpecError("condition 'mirrored' needs a simulator with a mirror axis, and this one has none")
