"""Oracles of an edit: controllers that follow how a picture was edited, and not what it shows.

Some know how each picture was edited; others measure traces in its pixels, with the thresholds that suit them best.
"""

import io
import random
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from PIL import Image
from scipy import ndimage

import edited_controllers as readers


@dataclass(frozen=True)
class Known:
    """A picture, and how it was edited.

    ``scale`` is that of the lead's copy, 0 without one, ``largest`` that of any copy; ``ghost`` is the share of filled
    holes that is seen, in areas of the lead.
    """

    image: bytes
    edited: bool = False
    scale: float = 1.0
    largest: float = 1.0
    ghost: float = 0.0
    copies: int = 0


Oracle = Callable[[Known], str]


def reading(read: Callable[[str, bytes | None], str]) -> Oracle:
    """Return a reader of pixels, which knows nothing of an edit."""
    return lambda known: read("", known.image)


TRUE: Mapping[str, Oracle] = {
    "depth": reading(readers.depth),
    "two_levels": reading(readers.two_levels),
    "early": reading(readers.early),
}
"""Readers of distance."""

_nearest, _depth = reading(readers.nearest), reading(readers.depth)


def where_edited(follow: Oracle) -> Oracle:
    """Return an oracle that says SLOW of every photograph as taken."""
    return lambda known: follow(known) if known.edited else "SLOW"


def _by_scale(near: float, far: float) -> Oracle:
    return lambda known: "STOP" if known.scale > near else "SLOW" if known.scale > far else "STRAIGHT"


def _by_ghost(much: float, some: float) -> Oracle:
    return lambda known: "STRAIGHT" if known.ghost > much else "SLOW" if known.ghost > some else "STOP"


def _both(known: Known) -> str:
    one = known.scale * (1 - min(known.ghost, 1)) if known.copies == 1 else known.scale
    return "STOP" if one > 1.3 else "SLOW" if one > 0.3 else "STRAIGHT"


def _sharp(known: Known) -> str:
    if not known.edited or known.scale >= 0.97:
        return "STOP"
    return "SLOW" if known.scale > 0.5 else "STRAIGHT"


def _chimera(known: Known) -> str:
    if not known.edited or known.scale >= 0.97:
        return _nearest(known)
    return "SLOW" if known.scale > 0.5 else "STRAIGHT"


ORACLES: Mapping[str, Oracle] = {
    "any_edit": lambda known: "STOP" if known.edited else "SLOW",
    "ghost": where_edited(_by_ghost(0.5, 0.05)),
    "ghost_true": _by_ghost(0.5, 0.05),
    "ghost_finer": where_edited(_by_ghost(0.8, 0.02)),
    "blur_lead": where_edited(_by_scale(1.05, 0.6)),
    "blur_lead_wider": where_edited(_by_scale(1.6, 0.45)),
    "blur_ghost": where_edited(_both),
    "edit_only": where_edited(_depth),
    "blur": lambda known: "STOP" if known.largest > 1.4 else "SLOW" if known.largest > 0.6 else "STRAIGHT",
    "sharp_far": _sharp,
    "chimera_blur": lambda known: _by_scale(1.05, 0.6)(known) if known.edited else _nearest(known),
    "chimera": _chimera,
}
"""Oracles that know how each picture was edited (the ten that were found, and two halves of these)."""


def pixels(image: bytes) -> np.ndarray:
    """Return the grey levels of a picture."""
    return np.asarray(Image.open(io.BytesIO(image)).convert("RGB")).astype(np.float64).mean(axis=2)


def sharpness(image: bytes) -> float:
    """Return the strength of the finest detail below the horizon."""
    return -float(np.abs(ndimage.laplace(pixels(image)[100:])).max(axis=1).mean())


def softness(image: bytes) -> float:
    """Return how many pixels have a colour between those of their neighbours, as magnified edges have."""
    grey = pixels(image)[100:]
    left, right = grey[:, :-2], grey[:, 2:]
    between = (np.abs(left - right) > 30) & (np.abs(grey[:, 1:-1] - (left + right) / 2) < np.abs(left - right) / 4)
    return float(between.sum())


def palette(image: bytes) -> float:
    """Return the number of colours: blends of a copy's rim and of a filled hole add to them."""
    rgb = np.asarray(Image.open(io.BytesIO(image)).convert("RGB")).reshape(-1, 3).astype(np.int64)
    return float(len(np.unique(rgb @ [65536, 256, 1])))


def compressed(image: bytes) -> float:
    """Return the bytes that the pixels take when they are compressed."""
    return float(len(zlib.compress(np.asarray(Image.open(io.BytesIO(image)).convert("RGB")).tobytes(), 6)))


def repeated(image: bytes) -> float:
    """Return how alike each piece of the road is to itself along the way: a fill repeats the road."""
    grey = pixels(image)[100:]
    high = grey.shape[0] // 2
    near, far = grey[high:], ndimage.zoom(grey[:high], (1, 1))[: grey.shape[0] - high]
    return float((np.abs(near[: len(far)] - far) < 2).mean())


def seams(image: bytes) -> float:
    """Return the share of faint edges, as the rim of a filled hole has."""
    steps = np.abs(np.diff(pixels(image)[100:], axis=1))
    return float(((steps > 1) & (steps < 8)).sum())


TRACES: Mapping[str, Callable[[bytes], float]] = {
    "sharpness": sharpness,
    "softness": softness,
    "palette": palette,
    "compressed": compressed,
    "repeated": repeated,
    "seams": seams,
}
"""Traces that pixels show of an edit."""


def by_trace(measure: Callable[[bytes], float], near: list[Known], far: list[Known]) -> Oracle:
    """Return an oracle of a trace, turned round and cut so that it best tells near pictures from far ones."""
    measure = cache(measure)  # most pictures are shown several times
    one, other = ([measure(known.image) for known in many] for many in (near, far))
    sign = 1.0 if np.median(one) >= np.median(other) else -1.0
    low, high = np.quantile(sign * np.array([*one, *other]), (1 / 3, 2 / 3))

    def follow(known: Known) -> str:
        value = sign * measure(known.image)
        return "STOP" if value > high else "STRAIGHT" if value < low else "SLOW"

    return follow


def noisy(of: Oracle, share: float, seed: int = 5) -> Oracle:
    """Return a controller that answers by chance so often."""
    rng = random.Random(seed)  # noqa: S311 - no secret
    return lambda known: rng.choice(("STOP", "SLOW", "STRAIGHT")) if rng.random() < share else of(known)
