"""A photograph taken apart: what leads, what else is seen, and copies of the lead in other places."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from eyechart.edits.fill import Plate
from eyechart.edits.geometry import Box, Layer, Lines, Mask, Planes, as_pixels, box_of, cut, laid_over, scaled
from eyechart.frames import RGB

_EDGE = 0.15
"""The share of the lower end of an object that has the road's shadow beside it."""


@dataclass(frozen=True)
class Cutout:
    """A thing of a photograph: its mask (h, w), its box in pixels and its distance, if known."""

    mask: Mask
    box: Box
    distance_m: float | None
    where: str = ""

    @property
    def foot(self) -> float:
        """Return the row on which it stands."""
        return self.box.y1


@dataclass(frozen=True, slots=True)
class CopyPlace:
    """A place on the road: metres ahead, and metres to the left of where the thing stood across."""

    distance_m: float
    left_m: float = 0.0


@dataclass(frozen=True)
class EditScene:
    """A photograph (h, w, 3) taken apart, with its vanishing lines and its camera's height.

    ``share`` (h, w) is how much of a pixel is cut out with the lead, its shadow on the road too.
    ``own`` is the visible part of the own vehicle, which nothing covers. Without ``eye_m`` nothing
    can be moved across.
    """

    picture: Planes
    lead: Cutout
    share: Planes
    others: tuple[Cutout, ...]
    own: Mask
    lines: Lines
    eye_m: float | None = None

    @property
    def hole(self) -> Mask:
        """Return what is to be filled where the lead was."""
        return np.asarray(self.share > 0, np.bool_)

    @property
    def kept(self) -> Mask:
        """Return the other things and the own vehicle."""
        made = self.own.copy()
        for one in self.others:
            made |= one.mask
        return made

    @property
    def distance_m(self) -> float:
        """Return the lead's distance."""
        assert self.lead.distance_m is not None
        return self.lead.distance_m

    def scale(self, place: CopyPlace) -> float:
        """Return how much the lead grows at a place."""
        return self.lines.scale(self.distance_m, place.distance_m)

    def shift_px(self, place: CopyPlace) -> float:
        """Return how far to the right a copy of the lead is moved across at a place, in pixels."""
        if not place.left_m or self.eye_m is None:
            return 0.0
        foot = self.lines.row(self.lead.foot, self.scale(place))
        return -self.lines.aside_px(foot, place.left_m / self.eye_m)

    def box_at(self, place: CopyPlace) -> Box:
        """Return the box of a copy of the lead, also beyond the picture."""
        scale, shift, box = self.scale(place), self.shift_px(place), self.lead.box
        about = self.lines.column
        left, right = (about + scale * (one - about) + shift for one in (box.x0, box.x1))
        return Box(left, self.lines.row(box.y0, scale), right, self.lines.row(box.y1, scale))

    def aside_m(self, box: Box) -> float:
        """Return how far to the left of the camera's line a box stands, in metres."""
        assert self.eye_m is not None
        return -((box.x0 + box.x1) / 2 - self.lines.column) / (box.y1 - self.lines.horizon) * self.eye_m

    @property
    def width_m(self) -> float:
        """Return the lead's width in metres."""
        assert self.eye_m is not None
        return (self.lead.box.x1 - self.lead.box.x0) / (self.lead.foot - self.lines.horizon) * self.eye_m

    @cached_property
    def _cut(self) -> Planes:
        return cut(self.picture, self.share)

    def layer(self, place: CopyPlace) -> Layer | None:
        """Return the cut-out of the lead at a place, None outside of the picture.

        The edge of an enlarged one stays sharp.
        """
        scale, shift = self.scale(place), self.shift_px(place)
        window = self._window(scale, shift)
        if window.x1 <= window.x0 or window.y1 <= window.y0:
            return None
        planes = scaled(self._cut, scale, self.lines, shift, window)
        if scale > 1:
            planes = _sharp(planes, scale)
        return Layer(place.distance_m, planes, int(window.x0), int(window.y0))

    def _window(self, scale: float, shift: float) -> Box:
        """Return the part of the picture that a copy may cover."""
        x0, y0, x1, y1 = box_of(self.hole)
        rows, columns = self.share.shape
        reach = 3 + 2 * scale
        left, right = (self.lines.column + scale * (one - self.lines.column) + shift for one in (x0, x1))
        top, bottom = (self.lines.row(one, scale) for one in (y0, y1))
        return Box(
            max(math.floor(left - reach), 0),
            max(math.floor(top - reach), 0),
            min(math.ceil(right + reach), columns),
            min(math.ceil(bottom + reach), rows),
        )

    def composed(self, plate: Plate, *places: CopyPlace) -> RGB:
        """Return a plate with copies of the lead at places; what is nearer covers what is not."""
        layers = [layer for place in places if (layer := self.layer(place)) is not None]
        for one in self.others:
            x0, y0, x1, y1 = box_of(one.mask)
            part = np.s_[y0:y1, x0:x1]
            layers.append(Layer(one.distance_m or 0.0, cut(self.picture[part], one.mask[part]), x0, y0))
        made = laid_over(plate.picture, layers)
        made[self.own] = self.picture[self.own]
        return as_pixels(made)

    def softened(self, sigma: float) -> "EditScene":
        """Return the scene with a lead as soft as this sigma makes it, in its own place."""
        alone = self.lead.mask.astype(np.float32)
        weight = np.maximum(gaussian_filter(alone, sigma), 1e-3)[..., None]
        soft = gaussian_filter(self.picture * alone[..., None], (sigma, sigma, 0)) / weight
        made = self.picture.copy()
        made[self.lead.mask] = soft[self.lead.mask]
        return replace(self, picture=made)


def _sharp(planes: Planes, scale: float) -> Planes:
    """Return an enlarged cut-out whose edge is as steep as it was."""
    share = planes[..., 3:]
    steep = np.clip((share - 0.5) * scale + 0.5, 0, 1)
    colours = planes[..., :3] / np.maximum(share, 1e-6)
    return np.dstack([colours * steep, steep]).astype(np.float32)


def with_shadow(mask: Mask, free: Mask, height: float) -> Planes:
    """Return the share (h, w) of a cut-out with the strip of road around its foot.

    The strip is ``height`` of the thing's height wide and fades outwards. It lies only where the
    picture is ``free`` of other things.
    """
    share = mask.astype(np.float32)
    x0, y0, x1, y1 = box_of(mask)
    reach = height * (y1 - y0)
    if reach < 1:
        return share
    pad = math.ceil(reach) + 1
    part = np.s_[max(y0 - pad, 0) : y1 + pad, max(x0 - pad, 0) : x1 + pad]
    low = mask[part].copy()
    low[: max(int(y1 - _EDGE * (y1 - y0)) - max(y0 - pad, 0), 0)] = False
    away = np.asarray(distance_transform_edt(~low), np.float32)
    strip = np.clip(1 - away / reach, 0, 1) * free[part]
    strip[: max(int(y1 - _EDGE * (y1 - y0)) - max(y0 - pad, 0), 0)] = 0
    share[part] = np.maximum(share[part], strip)
    return share
