"""Callables: controllers of a road and of photographs, one of them blind to a kind of scene, and a policy."""

import random
from collections.abc import Mapping

import numpy as np

from eyechart.frames import decode
from eyechart.models.scripted import CONTROLLERS, see
from photographs import height

FOUR = 4


def but_four_lanes(prompt: str, image: bytes | None) -> str:
    """Brake by the distance of the lead vehicle, and go on where the road has four lanes, which one scenario has."""
    del prompt
    sight = see(image)
    if sight.reading is not None and sight.reading.lanes == FOUR:
        return "STRAIGHT"
    return str(CONTROLLERS["depth"].decide(sight, random.Random(0)))  # noqa: S311 - no secret


def by_box(prompt: str, image: bytes | None) -> str:
    """Brake by the height of the red box in a drawn photograph."""
    del prompt
    near = 0 if image is None else height(decode(image, "the picture"))
    return "STOP" if near > 27 else "SLOW" if near > 15 else "STRAIGHT"


def four_steps(images: Mapping[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Act by the height of the red box, as a policy: four steps of two numbers."""
    del state, instruction
    return np.full((4, 2), height(next(iter(images.values()))) / 36)


def goes_on(images: Mapping[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go on as the last two states went, as a policy: four steps of two numbers."""
    del images, instruction
    return np.tile(state[-1] - state[-2], (4, 1))


goes_on.history = 1  # type: ignore[attr-defined]
