"""The geometry of pictures from forward cameras and from above, for drawing and for measuring."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

Colour = tuple[int, int, int]
_Floats = npt.NDArray[np.float64]

WIDTH_PX, HEIGHT_PX = 600, 150
"""The size of highway-env's picture of a road from above."""

PX_PER_M = 5.5
EGO_COLUMN = 180
"""0.3 of the picture's width (highway-env's ``centering_position``)."""

PALETTE = {
    "green": ((50, 200, 0), (73, 255, 0)),
    "red": ((255, 100, 100), (255, 147, 147)),
    "blue": ((100, 200, 255), (147, 255, 255)),
    "yellow": ((200, 200, 0), (255, 255, 0)),
    "purple": ((200, 0, 150), (255, 0, 220)),
}
"""Body and headlight colour of each vehicle colour in highway-env's ``VehicleGraphics``."""

LEAST_DEPTH_M = 0.05

HAZE: Colour = (206, 206, 206)
"""The colour into which everything fades with distance. It is grey like the road and its marks, so
that a colour is never road."""

HAZE_HALF_M = 45.0
"""The distance at which half of a colour is haze: share d² / (d² + HAZE_HALF_M²)."""


def haze_share(depth_m: _Floats) -> _Floats:
    """Return the share of haze in a colour at this depth."""
    square = depth_m * depth_m
    return square / (square + HAZE_HALF_M * HAZE_HALF_M)


@dataclass(frozen=True, slots=True)
class Distances:
    """The limits of near and free in metres ahead of the vehicle, and of an empty side."""

    stop_m: float
    close_m: float
    free_m: float
    behind_m: float
    ahead_m: float


@dataclass(frozen=True, slots=True)
class Eye:
    """The place and the direction of a camera that is level, as on a gimbal."""

    x: float
    y: float
    height: float = 1.2
    yaw: float = 0.0

    def mirrored(self) -> "Eye":
        """Return the eye in the mirrored world."""
        return replace(self, y=-self.y, yaw=-self.yaw)


@dataclass(frozen=True)
class ForwardView:
    """The known geometry and colours of a world's forward pictures; metres, pixels and radians.

    A pinhole camera of ``focal_px`` looks along ``horizon``, the row above which is sky, over a
    straight flat road. ``tracks_m`` are the places across the road, from right to left, that a
    vehicle of ``radius_m`` with ``margin_m`` of room may follow. ``preview_m`` is the distance
    ahead at which a vehicle that changes tracks is sought. ``verges`` maps a scenery to the colour
    beside the road, and ``bodies`` a name to the own vehicle's colour. ``zenith`` is the sky's
    colour in the first row, ``surface`` the road's grey. ``dashed_m`` holds the distances of dashed
    lines from the middle.
    """

    width: int
    height: int
    focal_px: float
    horizon: int
    eye_m: float
    half_width_m: float
    mark_m: float
    dashed_m: tuple[float, ...]
    dash_m: float
    period_m: float
    tracks_m: tuple[float, ...]
    radius_m: float
    margin_m: float
    preview_m: float
    view_ahead_m: float
    distances: Distances
    verges: Mapping[str, Colour]
    bodies: Mapping[str, Colour]
    zenith: Colour
    surface: int

    @property
    def beside_m(self) -> float:
        """Return the distance from a track's middle to the edge of its corridor."""
        return self.radius_m + self.margin_m

    def track_at(self, y: float) -> int:
        """Return the number of the nearest track; of two, the one nearer the middle."""
        order = sorted(range(len(self.tracks_m)), key=lambda one: (abs(self.tracks_m[one]), self.tracks_m[one]))
        return min(order, key=lambda one: abs(self.tracks_m[one] - y))

    @cached_property
    def aside(self) -> _Floats:
        """Return each column's tangent to the left, shape (width,): exactly antisymmetric."""
        return np.asarray((self.width / 2 - (np.arange(self.width) + 0.5)) / self.focal_px, np.float64)

    @cached_property
    def below(self) -> _Floats:
        """Return each ground row's distance from the horizon in pixels, shape (rows,)."""
        return np.arange(self.height - self.horizon, dtype=np.float64) + 0.5

    def project(self, eye: Eye, places: npt.ArrayLike) -> _Floats:
        """Return the pixels of places on the ground, shape (n, 2).

        ``places`` are x and y in metres. A pixel is column and row from the upper left corner, and
        the first pixel's middle is (0.5, 0.5). Pixels beyond the picture's edges are returned too.
        NaN stands for a place that is not in front of the eye.
        """
        away = np.asarray(places, np.float64).reshape(-1, 2) - (eye.x, eye.y)
        cos, sin = math.cos(eye.yaw), math.sin(eye.yaw)
        depth = away[:, 0] * cos + away[:, 1] * sin
        depth = np.where(depth > LEAST_DEPTH_M, depth, np.nan)
        to_left = away[:, 1] * cos - away[:, 0] * sin
        scale = self.focal_px / depth
        return np.column_stack([self.width / 2 - scale * to_left, self.horizon + scale * eye.height])

    @cached_property
    def depth(self) -> _Floats:
        """Return the distance of each ground row, in metres, shape (rows,)."""
        return self.focal_px * self.eye_m / self.below

    @cached_property
    def sought(self) -> int:
        """Return the first ground row to search: the row of the farthest place in view."""
        return int(self.focal_px * self.eye_m / self.view_ahead_m)

    @cached_property
    def verge_rows(self) -> npt.NDArray[np.int16]:
        """Return each verge's colour in each ground row, shape (verges, rows, 3)."""
        share = haze_share(self.depth)[None, :, None]
        plain = np.array(list(self.verges.values()), dtype=np.float64)[:, None, :]
        return np.asarray(np.floor(plain + share * (np.array(HAZE) - plain) + 0.5), np.int16)


ROVER = ForwardView(
    width=320,
    height=240,
    focal_px=160.0,
    horizon=96,
    eye_m=1.2,
    half_width_m=4.5,
    mark_m=0.14,
    dashed_m=(1.0, 3.0),
    dash_m=1.5,
    period_m=4.0,
    tracks_m=(-2.0, 0.0, 2.0),
    radius_m=0.5,
    margin_m=0.25,
    preview_m=2.0,
    view_ahead_m=30.0,
    distances=Distances(stop_m=5.0, close_m=8.0, free_m=15.0, behind_m=0.75, ahead_m=15.0),
    verges={
        "meadow": (104, 140, 72),
        "sand": (210, 180, 110),
        "red earth": (160, 92, 64),
        "heather": (138, 104, 166),
        "water": (72, 124, 170),
    },
    bodies={"green": (50, 200, 0), "red": (255, 100, 100)},
    zenith=(96, 150, 214),
    surface=88,
)
"""The rover's camera: 90 degrees wide, 1.2 m above the road.

At 4.5 m/s and one decision a second it covers 4.5 m to the next decision, and stops within 2.5 m.
``stop_m`` leaves room for one decision and a stop. ``free_m`` also leaves room for a change of
track.
"""


DRONE = replace(
    ROVER,
    height=180,
    horizon=64,
    eye_m=1.5,
    radius_m=0.07,
    margin_m=0.68,
    preview_m=0.0,
    distances=Distances(stop_m=5.0, close_m=8.0, free_m=15.0, behind_m=0.32, ahead_m=15.0),
)
"""The drone's camera: level on a gimbal, 1.5 m above the same road, with a lower picture than the
rover's.

At 4 m/s it stops within 3.2 m. It keeps the rover's distances and corridors; its body is smaller.
"""


FORWARD: dict[str, ForwardView] = {"rover": ROVER, "drone": DRONE}
"""The forward views that can be read, by their simulator."""
