"""A forward camera of our own: each column of the picture is a ray over a flat road, past shaded cylinders, into haze.

A mirrored world renders to the flipped picture, bit for bit. Three things make it so: the columns' directions are
exactly antisymmetric, light falls along the road only, and every number of a column is made by operations that IEEE 754
rounds alike for a number and its negative (no sine of a column, no sum over columns).

Metres and radians, as in ROS: x along the road, y to the left, z up, yaw counter-clockwise. The road's middle is y = 0.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from eyechart.frames import RGB
from eyechart.perception.forward import HAZE, Colour, haze_share

_Floats = npt.NDArray[np.float32]
_Doubles = npt.NDArray[np.float64]

WHITE: Colour = (255, 255, 255)

_LEAST_DEPTH_M = 0.05
_SHADE, _LIT = 0.45, 0.55
_CAP = 1.15


@dataclass(frozen=True)
class Lens:
    """A pinhole that looks along the horizon: size and focal length in pixels, and the row above which is sky."""

    width: int = 320
    height: int = 240
    focal_px: float = 160.0
    horizon: int = 96

    @cached_property
    def aside(self) -> _Doubles:
        """Return each column's tangent to the left, shape (width,): exactly antisymmetric."""
        return np.asarray((self.width / 2 - (np.arange(self.width) + 0.5)) / self.focal_px, np.float64)

    @cached_property
    def below(self) -> _Doubles:
        """Return how many pixels the middle of each ground row lies below the horizon, shape (height - horizon,)."""
        return np.arange(self.height - self.horizon, dtype=np.float64) + 0.5

    def project(self, eye: "Eye", places: npt.ArrayLike) -> _Doubles:
        """Return where places on the ground lie in the picture, shape (n, 2); ``places`` are x and y in metres.

        Column and row in pixels from the upper left corner, so that the first pixel's middle is (0.5, 0.5); beyond the
        picture's edges too. NaN for a place that is not before the eye.
        """
        away = np.asarray(places, np.float64).reshape(-1, 2) - (eye.x, eye.y)
        cos, sin = math.cos(eye.yaw), math.sin(eye.yaw)
        depth = away[:, 0] * cos + away[:, 1] * sin
        depth = np.where(depth > _LEAST_DEPTH_M, depth, np.nan)
        to_left = away[:, 1] * cos - away[:, 0] * sin
        scale = self.focal_px / depth
        return np.column_stack([self.width / 2 - scale * to_left, self.horizon + scale * eye.height])


@dataclass(frozen=True, slots=True)
class Eye:
    """Where a camera is, and where along the ground it looks; it is level, as on a gimbal."""

    x: float
    y: float
    height: float = 1.2
    yaw: float = 0.0

    def mirrored(self) -> "Eye":
        """Return the eye in the mirrored world."""
        return replace(self, y=-self.y, yaw=-self.yaw)


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


@dataclass(frozen=True, slots=True)
class Road:
    """A straight flat road between two solid edges, with dashed marks at equal distances left and right of its middle.

    ``dashed`` are these distances; 0 is one line in the middle. Surface and marks are grey, so that the road has no
    colour; ``verge`` is what lies beside it, ``zenith`` the sky's colour in the first row. The middle of a dash lies
    wherever x is a multiple of ``period``.
    """

    half_width: float = 4.5
    dashed: tuple[float, ...] = (1.0,)
    mark: float = 0.14
    dash: float = 2.0
    period: float = 5.0
    surface: int = 88
    verge: Colour = (104, 140, 72)
    zenith: Colour = (96, 150, 214)


@dataclass(frozen=True)
class Camera:
    """Draws what a lens sees of one road."""

    lens: Lens = field(default_factory=Lens)
    road: Road = field(default_factory=Road)

    def draw(self, eye: Eye, cylinders: Iterable[Cylinder] = (), *, hood: Colour | None = None) -> RGB:
        """Return the picture, shape (height, width, 3), uint8, with the own vehicle's ``hood`` at its lower edge.

        Cylinders may not overlap one another; one that the eye is inside of is not seen.
        """
        canvas = np.empty((self.lens.height, self.lens.width, 3), dtype=np.float32)
        canvas[: self.lens.horizon] = self._sky[:, None, :]
        self._draw_ground(canvas[self.lens.horizon :], eye)
        # For bodies that do not overlap, the power of the eye with respect to each is an exact order of depth.
        for cylinder in sorted(cylinders, key=lambda one: _order(one, eye), reverse=True):
            self._draw_cylinder(canvas, eye, cylinder)
        canvas += 0.5
        picture = canvas.astype(np.uint8)
        if hood is not None:
            picture[self.hood] = hood
        return picture

    # ---- what is the same in every picture

    @cached_property
    def _sky(self) -> _Floats:
        """Return the sky's colours, shape (horizon, 3), haze at its foot."""
        height = np.linspace(1.0, 0.0, self.lens.horizon, dtype=np.float32)[:, None]
        return np.asarray(self.road.zenith, np.float32) * height + np.asarray(HAZE, np.float32) * (1 - height)

    @cached_property
    def hood(self) -> npt.NDArray[np.bool_]:
        """Return which pixels, shape (height, width), show the own vehicle: a low arc over the middle."""
        reach = np.abs(self.lens.aside) * (2 * self.lens.focal_px / self.lens.width)
        square = (reach / 0.8) * (reach / 0.8)
        high = 0.11 * self.lens.height * np.sqrt(np.clip(1.0 - square * square, 0.0, 1.0))
        return np.asarray((np.arange(self.lens.height) + 0.5)[:, None] > self.lens.height - high)

    # ---- ground

    def _draw_ground(self, canvas: _Floats, eye: Eye) -> None:
        """Fill the rows below the horizon, shape (rows, width, 3)."""
        lens, road = self.lens, self.road
        depth = (lens.focal_px * eye.height / lens.below)[:, None]
        ahead, aside = _directions(lens, eye)
        to_left = depth * aside
        from_middle: _Floats = np.abs((eye.y + to_left).astype(np.float32))
        # A pixel's width on the ground, and for stripes that lie flat in the picture its height.
        wide = np.maximum(depth / lens.focal_px, np.abs(to_left) / lens.below[:, None]).astype(np.float32)
        long = (depth * depth / (lens.focal_px * eye.height)).astype(np.float32)
        surface = np.clip((road.half_width - from_middle) / wide + 0.5, 0.0, 1.0)
        marks = _cover(from_middle - road.half_width, road.mark, wide)
        if road.dashed:
            along = (math.fmod(eye.x, road.period) + depth * ahead).astype(np.float32) / road.period
            along -= np.floor(along)
            from_dash = (0.5 - np.abs(along - 0.5)) * road.period
            dashes = np.clip((road.dash / 2 - from_dash) / long + 0.5, 0.0, 1.0)
            for offset in road.dashed:
                marks = np.maximum(marks, _cover(from_middle - offset, road.mark, wide) * dashes)
        fade = haze_share(depth).astype(np.float32)
        for channel in range(3):
            beside = np.float32(road.verge[channel])
            shade = beside + surface * (road.surface - beside)
            shade += marks * (WHITE[channel] - shade)
            shade += fade * (HAZE[channel] - shade)
            canvas[:, :, channel] = shade

    # ---- cylinders

    def _draw_cylinder(self, canvas: _Floats, eye: Eye, body: Cylinder) -> None:
        """Paint one cylinder over what is behind it."""
        lens = self.lens
        ahead, aside = _directions(lens, eye)
        to_x, to_y = body.x - eye.x, body.y - eye.y
        power = to_x * to_x + to_y * to_y - body.radius * body.radius
        along = ahead * to_x + aside * to_y
        length = 1.0 + lens.aside * lens.aside
        inside = along * along - length * power
        columns = np.flatnonzero((inside > 0) & (along > 0))
        if power <= 0 or not columns.size:
            return
        span = slice(int(columns[0]), int(columns[-1]) + 1)
        root = np.sqrt(inside[span])
        near = np.maximum((along[span] - root) / length[span], _LEAST_DEPTH_M)
        rows = _Rows(lens, eye)
        top, foot = rows.of(body.base + body.height, near), rows.of(body.base, near)
        # Light comes along the road from behind the eye and is as bright on the left of a body as on its right.
        facing = np.clip((to_x - near * ahead[span]) / body.radius, 0.0, 1.0)
        paint = np.multiply.outer(_SHADE + _LIT * facing, np.asarray(body.colour, np.float64))
        _paint(canvas[:, span], top, foot, _hazed(paint, near))
        if eye.height > body.base + body.height:
            far = (along[span] + root) / length[span]
            cap = np.minimum(np.asarray(body.colour, np.float64) * _CAP, 255.0)
            back = rows.of(body.base + body.height, far)
            _paint(canvas[:, span], back, top, _hazed(np.broadcast_to(cap, paint.shape), near))


@dataclass(frozen=True, slots=True)
class _Rows:
    """From a height above the ground and a depth to a row of the picture, in pixels from its upper edge."""

    lens: Lens
    eye: Eye

    def of(self, height: float, depth: _Doubles) -> _Doubles:
        """Return the row of each column, shape as ``depth``, within the picture."""
        row = self.lens.horizon + self.lens.focal_px * (self.eye.height - height) / depth
        return np.clip(row, 0.0, self.lens.height)


def _order(body: Cylinder, eye: Eye) -> tuple[float, float, float, Colour]:
    """Return the power of the eye with respect to a body, and what tells equal ones apart in a mirror too."""
    to_x, to_y = body.x - eye.x, body.y - eye.y
    return to_x * to_x + to_y * to_y - body.radius * body.radius, body.radius, body.height, body.colour


def _directions(lens: Lens, eye: Eye) -> tuple[_Doubles, _Doubles]:
    """Return, for a metre of depth, how far each column's ray goes along the road and to the left."""
    cos, sin = math.cos(eye.yaw), math.sin(eye.yaw)
    return cos - lens.aside * sin, sin + lens.aside * cos


def _hazed(paint: _Doubles, depth: _Doubles) -> _Floats:
    """Return colours, shape (columns, 3), as they look from so far away."""
    return (paint + haze_share(depth)[:, None] * (np.asarray(HAZE, np.float64) - paint)).astype(np.float32)


def _cover(distance: _Floats, width: float, pixel: _Floats) -> _Floats:
    """Return how much of each pixel a stripe of this width covers, whose middle lies at this distance."""
    most = np.minimum(np.float32(width), pixel)
    covered = np.clip((np.float32(width) + pixel) / 2 - np.abs(distance), 0.0, most) / pixel
    return np.asarray(covered, np.float32)


def _paint(canvas: _Floats, top: _Doubles, foot: _Doubles, paint: _Floats) -> None:
    """Blend a colour a column, shape (columns, 3), into the rows from top to foot of a part of the picture."""
    first, last = int(np.floor(top.min())), int(np.ceil(foot.max()))
    if last <= first:
        return
    rows = np.arange(first, last, dtype=np.float64)[:, None]
    cover = np.clip(np.minimum(foot, rows + 1) - np.maximum(top, rows), 0.0, 1.0).astype(np.float32)[:, :, None]
    part = canvas[first:last]
    part += cover * (paint - part)
