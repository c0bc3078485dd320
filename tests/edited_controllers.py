"""Controllers that read pixels of the forward worlds, for banks that were rendered and edited."""

import hashlib
import io
import math
from functools import lru_cache

import numpy as np
from PIL import Image

from eyechart.perception.forward import ForwardReading, read_forward, view_of


@lru_cache(maxsize=4096)
def _read(_: str, data: bytes) -> tuple[ForwardReading | None, float]:
    pixels = np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))
    view = view_of(pixels)
    return (None if view is None else read_forward(pixels, view)), float(pixels[..., 2].mean())


def _seen(image: bytes | None) -> tuple[ForwardReading | None, float]:
    return (None, 0.0) if image is None else _read(hashlib.sha256(image).hexdigest(), image)


def graded(gap_m: float) -> str:
    """Return the action for a gap, in three levels."""
    return "STOP" if gap_m < 5 else "STRAIGHT" if gap_m > 15 else "SLOW"


def _gap(image: bytes | None) -> float | None:
    found, _ = _seen(image)
    if found is None:
        return None
    return math.inf if found.scene.gap_m is None else found.scene.gap_m


def depth(_: str, image: bytes | None) -> str:
    """Brake by the lead's distance."""
    gap = _gap(image)
    return "STOP" if gap is None else graded(gap)


def two_levels(_: str, image: bytes | None) -> str:
    """Stop for a near lead."""
    gap = _gap(image)
    return "STOP" if gap is None or gap < 9 else "STRAIGHT"


def nearest(_: str, image: bytes | None) -> str:
    """Brake by the distance of the nearest thing of any way."""
    found, _mean = _seen(image)
    if found is None:
        return "STOP"
    return graded(min((math.hypot(one.ahead_m, one.aside_m) for one in found.others if one.ahead_m > 0), default=99))


def any_lead(_: str, image: bytes | None) -> str:
    """Stop for any lead, however far."""
    gap = _gap(image)
    return "STOP" if gap is None or gap < math.inf else "STRAIGHT"


def colour(_: str, image: bytes | None) -> str:
    """Follow the mean blue."""
    _found, mean = _seen(image)
    return "STOP" if mean < 118 else "SLOW" if mean < 126 else "STRAIGHT"
