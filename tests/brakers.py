"""Controllers as callables, (prompt, image) to an action: one that is blind to a kind of scene, one of photographs."""

import random

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
