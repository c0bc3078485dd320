"""Controllers that read pixels of the forward worlds, for banks that were rendered and edited.

Those that use the calibrated reader read distances; the others follow coarser things in the picture.
"""

import hashlib
import io
import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import find_objects, label

from eyechart.cameras import ForwardView
from eyechart.frames import RGB
from eyechart.perception.forward import ForwardReading, read_forward, view_of

ACTIONS = ("STOP", "SLOW", "STRAIGHT", "LEFT", "RIGHT")
_COLOURED, _LEAST_PX = 60, 12


@dataclass(frozen=True)
class Sight:
    """A picture with its view and its reading."""

    pixels: RGB
    view: ForwardView
    reading: ForwardReading

    @cached_property
    def bodies(self) -> tuple[tuple[int, int, float], ...]:
        """Return the heights, feet and columns of the bodies in it, in pixels."""
        view, colours = self.view, self.pixels.astype(np.int16)
        own = widest(np.abs(colours - colours[-1, view.width // 2])) < 6
        coloured = (widest(colours) + widest(-colours) > _COLOURED) & ~own
        coloured[: view.horizon] = False
        found = []
        for part in find_objects(label(coloured)[0]):
            high, wide = part[0].stop - part[0].start, part[1].stop - part[1].start
            if high * wide > _LEAST_PX and wide < view.width // 2:
                found.append((high, part[0].stop - view.horizon, (part[1].start + part[1].stop) / 2))
        return tuple(found)

    @property
    def gap_m(self) -> float:
        """Return the lead's distance, infinite without one."""
        return math.inf if self.reading.scene.gap_m is None else self.reading.scene.gap_m

    def ahead(self) -> tuple[int, int] | None:
        """Return height and foot of the lowest body near the picture's middle."""
        near = [(foot, high) for high, foot, x in self.bodies if abs(x - self.view.width / 2) < foot * 0.6 + 4]
        return max(near)[::-1] if near else None


def widest(colours: NDArray[np.int16]) -> NDArray[np.int16]:
    """Return the largest of each pixel's three channels; numpy's own maximum over so short an axis takes ten times."""
    return np.maximum(np.maximum(colours[..., 0], colours[..., 1]), colours[..., 2])


@lru_cache(maxsize=6000)
def _read(_: str, data: bytes) -> Sight | None:
    pixels = np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))
    view = view_of(pixels)
    reading = None if view is None else read_forward(pixels, view)
    if view is None or reading is None:
        return None
    return Sight(pixels, view, reading)


def _seen(image: bytes | None) -> Sight | None:
    return None if image is None else _read(hashlib.sha256(image).hexdigest(), image)


def _by(rule: Callable[[Sight], str]) -> Callable[[str, bytes | None], str]:
    def controller(prompt: str, image: bytes | None) -> str:
        del prompt
        sight = _seen(image)
        return "STOP" if sight is None else rule(sight)

    return controller


def graded(gap_m: float, stop_m: float = 5.0, free_m: float = 15.0) -> str:
    """Return the action for a gap, in three levels."""
    return "STOP" if gap_m < stop_m else "STRAIGHT" if gap_m > free_m else "SLOW"


def _nearest(sight: Sight) -> str:
    away = (math.hypot(one.ahead_m, one.aside_m) for one in sight.reading.others if one.ahead_m > 0)
    return graded(min(away, default=math.inf))


def _count(sight: Sight) -> str:
    return ("STRAIGHT", "SLOW", "STOP")[min(len(sight.bodies) // 2, 2)]


def _height(sight: Sight) -> str:
    found = sight.ahead()
    return "STRAIGHT" if found is None or found[0] <= 10 else "STOP" if found[0] > 28 else "SLOW"


def _foot(sight: Sight) -> str:
    found = sight.ahead()
    return "STRAIGHT" if found is None or found[1] <= 12 else "STOP" if found[1] > 38 else "SLOW"


def _before(sight: Sight) -> str:
    row = sight.pixels[sight.view.horizon + 70].astype(int)
    return "STOP" if (np.abs(row - sight.view.surface).max(axis=1) > 60).mean() > 0.05 else "SLOW"


def _colour(sight: Sight) -> str:
    blue = float(sight.pixels[..., 2].mean())
    return "STOP" if blue < 118 else "SLOW" if blue < 126 else "STRAIGHT"


_coin = random.Random(5)  # noqa: S311 - no secret


def noisy(prompt: str, image: bytes | None) -> str:
    """Brake by the distance in 7 of 10 answers, and else at random."""
    return _coin.choice(ACTIONS) if _coin.random() < 0.3 else depth(prompt, image)


def blind(prompt: str, image: bytes | None) -> str:
    """Say the same of everything."""
    del prompt, image
    return "SLOW"


depth = _by(lambda sight: graded(sight.gap_m))
two_levels = _by(lambda sight: "STOP" if sight.gap_m < 9 else "STRAIGHT")
early = _by(lambda sight: graded(sight.gap_m, 10, 20))
nearest = _by(_nearest)
count = _by(_count)
height = _by(_height)
foot = _by(_foot)
any_lead = _by(lambda sight: "STRAIGHT" if sight.gap_m == math.inf else "STOP")
colour = _by(_colour)
before = _by(_before)
paint = _by(lambda sight: "STOP" if sight.reading.ego_colour == "red" else "SLOW")
presence = _by(lambda _: "SLOW")
hole = _by(lambda sight: "STRAIGHT" if 6 <= sight.gap_m < 10 else graded(sight.gap_m))

CONTROLLERS = (
    *("depth", "noisy", "two_levels", "early", "nearest", "count", "height", "foot", "any_lead", "colour"),
    *("before", "paint", "blind", "presence", "hole"),
)
READERS = ("depth", "two_levels", "early")
"""Those that follow the lead's distance and nothing else, and draw nothing.

``noisy`` draws anew in every run, so two runs on one small bank may give it two labels.
"""
