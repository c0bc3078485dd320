"""The geometry of an edit: what is moved along a flat road is scaled about its vanishing point.

A point of the road at distance d is seen at horizon + k/d. So what is moved from d to d' is scaled
by d/d' about the point where the road vanishes. Neither the focal length nor a lens is needed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import affine_transform, binary_dilation, gaussian_filter

Mask = NDArray[np.bool_]
Planes = NDArray[np.float32]

SHARPEST = 0.95
"""A larger scale is not smoothed before pixels are taken."""

_SIGMA = 0.45
_REACH = 4.0
"""The smoothing reaches this many times its sigma."""

_SQUARE = np.ones((3, 3), np.bool_)


class Box(NamedTuple):
    """A box in pixels from the picture's corner; the right and lower ends are outside of it."""

    x0: float
    y0: float
    x1: float
    y1: float


@dataclass(frozen=True, slots=True)
class Lines:
    """The vanishing point of the own way: its column and the horizon's row, from the corner.

    ``behind_m`` is how far the camera stands behind the point that distances are measured from.
    """

    column: float
    horizon: float
    behind_m: float = 0.0

    def scale(self, from_m: float, to_m: float) -> float:
        """Return by how much a thing grows that is moved between two distances, in metres."""
        return (from_m + self.behind_m) / (to_m + self.behind_m)

    def row(self, row: float, scale: float) -> float:
        """Return where a row lies after scaling."""
        return self.horizon + scale * (row - self.horizon)

    def aside_px(self, foot: float, aside_per_eye: float) -> float:
        """Return the pixels to the right of a way aside, in camera heights, at the row of a foot."""
        return aside_per_eye * (foot - self.horizon)


def grown(mask: Mask, by: int) -> Mask:
    """Return a mask (h, w) that is larger by some pixels on all sides."""
    if not by or not mask.any():
        return mask
    x0, y0, x1, y1 = box_of(mask)
    part = np.s_[max(y0 - by, 0) : y1 + by, max(x0 - by, 0) : x1 + by]
    made = np.zeros(mask.shape, np.bool_)
    made[part] = binary_dilation(mask[part], _SQUARE, by)
    return made


def box_of(mask: Mask) -> tuple[int, int, int, int]:
    """Return the columns and rows (x0, y0, x1, y1) of a mask that is not empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def smoothing(scale: float) -> float:
    """Return the sigma that a picture needs before it is shrunk, in its own pixels."""
    return _SIGMA * math.sqrt(1 / scale**2 - 1) if scale < SHARPEST else 0.0


def blur_of(scale: float) -> float:
    """Return the sigma that makes a thing at its own place as soft as its magnification is."""
    return _SIGMA * math.sqrt(max(scale**2 - 1, 0.0))


def scaled(planes: Planes, scale: float, lines: Lines, shift: float = 0.0, window: Box | None = None) -> Planes:
    """Return planes (h, w, c) scaled about the vanishing point and moved to the right by a shift.

    What is shrunk is smoothed first; outside of the planes is zero. ``window`` is the part of the
    result that is wanted, in whole pixels; its shape is that of the window.
    """
    height, width = planes.shape[:2]
    left, top, right, bottom = (int(one) for one in window or Box(0, 0, width, height))
    sigma = smoothing(scale)
    rows = _sources((top, bottom), scale, lines.horizon, height, sigma)
    columns = _sources((left - shift, right - shift), scale, lines.column, width, sigma)
    made = np.zeros((bottom - top, right - left, planes.shape[2]), np.float32)
    if rows[0] >= rows[1] or columns[0] >= columns[1]:
        return made
    part = planes[rows[0] : rows[1], columns[0] : columns[1]]
    # The middle of pixel i is at i + 0.5: output o comes from (o + 0.5 - at) / scale + at - 0.5.
    first_row = (top + 0.5 - lines.horizon) / scale + lines.horizon - 0.5 - rows[0]
    first_column = (left + 0.5 - shift - lines.column) / scale + lines.column - 0.5 - columns[0]
    for number in range(planes.shape[2]):
        plane = np.ascontiguousarray(part[..., number], np.float32)
        affine_transform(
            gaussian_filter(plane, sigma, truncate=_REACH, mode="constant") if sigma else plane,
            (1 / scale, 1 / scale),
            (first_row, first_column),
            output_shape=made.shape[:2],
            output=made[..., number],
            order=1,
        )
    return made


def _sources(ends: tuple[float, float], scale: float, about: float, size: int, sigma: float) -> tuple[int, int]:
    """Return the first and last pixel of a line that a scaled part is made from."""
    low, high = ((end - about) / scale + about for end in ends)
    reach = _REACH * sigma + 2
    return max(math.floor(low - reach), 0), min(math.ceil(high + reach), size)


def cut(picture: Planes, share: Planes | Mask) -> Planes:
    """Return the planes (h, w, 4) of what is cut out: colours times its share, and the share."""
    return np.dstack([picture * share[..., None], share]).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Layer:
    """Planes (h, w, 4) of a cut-out, the column and row of their corner, and the ordering distance."""

    distance_m: float
    planes: Planes
    left: int = 0
    top: int = 0


def laid_over(ground: Planes, layers: Sequence[Layer]) -> Planes:
    """Return a picture (h, w, 3) with layers over it, the farthest first."""
    made = ground.copy()
    for layer in sorted(layers, key=lambda one: -one.distance_m):
        height, width = layer.planes.shape[:2]
        part = made[layer.top : layer.top + height, layer.left : layer.left + width]
        part[...] = layer.planes[..., :3] + part * (1 - layer.planes[..., 3:])
    return made


def as_pixels(picture: Planes) -> NDArray[np.uint8]:
    """Return a picture (h, w, 3) of whole values from 0 to 255."""
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)
