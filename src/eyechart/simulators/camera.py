"""A forward camera that draws a flat road, shaded cylinders and haze, one ray a column.

A mirrored world renders to the flipped picture, bit for bit, for three reasons. The columns'
directions are exactly antisymmetric. Light falls along the road only. Every operation on a column
rounds alike for a number and its negative under IEEE 754 (no sine of a column, no sum over
columns).

Metres and radians, as in ROS: x along the road, y to the left, z up, yaw counter-clockwise. The
road's middle is y = 0.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from eyechart.cameras import HAZE, LEAST_DEPTH_M, ROVER, Colour, Eye, ForwardView, haze_share
from eyechart.frames import RGB

_Floats = npt.NDArray[np.float32]
_Doubles = npt.NDArray[np.float64]

WHITE: Colour = (255, 255, 255)

_SHADE, _LIT = 0.45, 0.55
_CAP = 1.15


@dataclass(frozen=True, slots=True)
class Cylinder:
    """An upright cylinder on the ground, from ``base`` to ``base + height`` above it."""

    x: float
    y: float
    radius: float
    height: float
    colour: Colour
    base: float = 0.0

    def mirrored(self) -> "Cylinder":
        """Return the cylinder in the mirrored world."""
        return replace(self, y=-self.y)


@dataclass(frozen=True)
class RoadCamera:
    """Draws a view of its road between two verges."""

    view: ForwardView = ROVER
    verge: Colour = ROVER.verges["meadow"]

    def draw(self, eye: Eye, cylinders: Iterable[Cylinder] = (), *, hood: Colour | None = None) -> RGB:
        """Return the picture, shape (height, width, 3), uint8.

        The own vehicle's ``hood`` is at the lower edge. Cylinders may not overlap one another; one
        that contains the eye is not drawn.
        """
        canvas = np.empty((self.view.height, self.view.width, 3), dtype=np.float32)
        canvas[: self.view.horizon] = self._sky[:, None, :]
        canvas[self.view.horizon :] = self._ground(eye)
        # The power of the eye orders bodies that do not overlap exactly by depth.
        for cylinder in sorted(cylinders, key=lambda one: _order(one, eye), reverse=True):
            self._draw_cylinder(canvas, eye, cylinder)
        canvas += 0.5
        picture = canvas.astype(np.uint8)
        if hood is not None:
            picture[self.hood] = hood
        return picture

    # ---- parts that are the same in every picture

    @cached_property
    def _sky(self) -> _Floats:
        """Return the sky's colours, shape (horizon, 3), haze at its foot."""
        height = np.linspace(1.0, 0.0, self.view.horizon, dtype=np.float32)[:, None]
        return np.asarray(self.view.zenith, np.float32) * height + np.asarray(HAZE, np.float32) * (1 - height)

    @cached_property
    def hood(self) -> npt.NDArray[np.bool_]:
        """Return the mask of the own vehicle, shape (height, width): a low arc over the middle."""
        reach = np.abs(self.view.aside) * (2 * self.view.focal_px / self.view.width)
        square = (reach / 0.8) * (reach / 0.8)
        high = 0.11 * self.view.height * np.sqrt(np.clip(1.0 - square * square, 0.0, 1.0))
        return np.asarray((np.arange(self.view.height) + 0.5)[:, None] > self.view.height - high)

    # ---- ground

    @cached_property
    def _grounds(self) -> dict[Eye, _Floats]:
        """Hold the ground that the previous eye saw."""
        return {}

    def _ground(self, eye: Eye) -> _Floats:
        """Return the rows below the horizon; moments that differ only in bodies share them."""
        seen = self._grounds.get(eye)
        if seen is None:
            seen = np.empty((self.view.height - self.view.horizon, self.view.width, 3), dtype=np.float32)
            self._draw_ground(seen, eye)
            self._grounds.clear()
            self._grounds[eye] = seen
        return seen

    def _draw_ground(self, canvas: _Floats, eye: Eye) -> None:
        """Fill the rows below the horizon, shape (rows, width, 3)."""
        view = self.view
        depth = (view.focal_px * eye.height / view.below)[:, None]
        ahead, aside = _directions(view, eye)
        to_left = depth * aside
        from_middle: _Floats = np.abs((eye.y + to_left).astype(np.float32))
        # A pixel's width on the ground, and for stripes that lie flat in the picture its height.
        wide = np.maximum(depth / view.focal_px, np.abs(to_left) / view.below[:, None]).astype(np.float32)
        long = (depth * depth / (view.focal_px * eye.height)).astype(np.float32)
        surface = np.clip((view.half_width_m - from_middle) / wide + 0.5, 0.0, 1.0)
        marks = _cover(from_middle - view.half_width_m, view.mark_m, wide)
        if view.dashed_m:
            along = (math.fmod(eye.x, view.period_m) + depth * ahead).astype(np.float32) / view.period_m
            along -= np.floor(along)
            from_dash = (0.5 - np.abs(along - 0.5)) * view.period_m
            dashes = np.clip((view.dash_m / 2 - from_dash) / long + 0.5, 0.0, 1.0)
            for offset in view.dashed_m:
                marks = np.maximum(marks, _cover(from_middle - offset, view.mark_m, wide) * dashes)
        fade = haze_share(depth).astype(np.float32)
        for channel in range(3):
            beside = np.float32(self.verge[channel])
            shade = beside + surface * (view.surface - beside)
            shade += marks * (WHITE[channel] - shade)
            shade += fade * (HAZE[channel] - shade)
            canvas[:, :, channel] = shade

    # ---- cylinders

    def _draw_cylinder(self, canvas: _Floats, eye: Eye, body: Cylinder) -> None:
        """Paint one cylinder over the bodies behind it."""
        view = self.view
        ahead, aside = _directions(view, eye)
        to_x, to_y = body.x - eye.x, body.y - eye.y
        power = to_x * to_x + to_y * to_y - body.radius * body.radius
        along = ahead * to_x + aside * to_y
        length = 1.0 + view.aside * view.aside
        inside = along * along - length * power
        columns = np.flatnonzero((inside > 0) & (along > 0))
        if power <= 0 or not columns.size:
            return
        span = slice(int(columns[0]), int(columns[-1]) + 1)
        root = np.sqrt(inside[span])
        near = np.maximum((along[span] - root) / length[span], LEAST_DEPTH_M)
        top, foot = _rows(view, eye, body.base + body.height, near), _rows(view, eye, body.base, near)
        # Light comes along the road from behind the eye: both sides of a body are equally bright.
        facing = np.clip((to_x - near * ahead[span]) / body.radius, 0.0, 1.0)
        paint = np.multiply.outer(_SHADE + _LIT * facing, np.asarray(body.colour, np.float64))
        _paint(canvas[:, span], top, foot, _hazed(paint, near))
        if eye.height > body.base + body.height:
            far = (along[span] + root) / length[span]
            cap = np.minimum(np.asarray(body.colour, np.float64) * _CAP, 255.0)
            back = _rows(view, eye, body.base + body.height, far)
            _paint(canvas[:, span], back, top, _hazed(np.broadcast_to(cap, paint.shape), near))


def _rows(view: ForwardView, eye: Eye, height: float, depth: _Doubles) -> _Doubles:
    """Return each column's row of a height above the ground at this depth, within the picture."""
    row = view.horizon + view.focal_px * (eye.height - height) / depth
    return np.clip(row, 0.0, view.height)


def _order(body: Cylinder, eye: Eye) -> tuple[float, float, float, Colour]:
    """Return the power of the eye with respect to a body, and tie-breaks that a mirror keeps."""
    to_x, to_y = body.x - eye.x, body.y - eye.y
    return to_x * to_x + to_y * to_y - body.radius * body.radius, body.radius, body.height, body.colour


def _directions(view: ForwardView, eye: Eye) -> tuple[_Doubles, _Doubles]:
    """Return how far each ray goes along the road and to the left for a metre of depth."""
    cos, sin = math.cos(eye.yaw), math.sin(eye.yaw)
    return cos - view.aside * sin, sin + view.aside * cos


def _hazed(paint: _Doubles, depth: _Doubles) -> _Floats:
    """Return colours, shape (columns, 3), with the haze of this depth."""
    return (paint + haze_share(depth)[:, None] * (np.asarray(HAZE, np.float64) - paint)).astype(np.float32)


def _cover(distance: _Floats, width: float, pixel: _Floats) -> _Floats:
    """Return the share of each pixel that a stripe of this width and distance covers."""
    most = np.minimum(np.float32(width), pixel)
    covered = np.clip((np.float32(width) + pixel) / 2 - np.abs(distance), 0.0, most) / pixel
    return np.asarray(covered, np.float32)


def _paint(canvas: _Floats, top: _Doubles, foot: _Doubles, paint: _Floats) -> None:
    """Blend one colour a column, shape (columns, 3), into the rows from top to foot."""
    first, last = int(np.floor(top.min())), int(np.ceil(foot.max()))
    if last <= first:
        return
    rows = np.arange(first, last, dtype=np.float64)[:, None]
    cover = np.clip(np.minimum(foot, rows + 1) - np.maximum(top, rows), 0.0, 1.0).astype(np.float32)[:, :, None]
    part = canvas[first:last]
    part += cover * (paint - part)
