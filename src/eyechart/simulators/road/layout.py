"""Five seeded families of obstacles on a road of 100 m, in some worlds closed by a wall.

The road has three tracks, 2 m apart. At each station a layout leaves at least one track open. The
next open track is the same or the one beside it, and stations are far enough apart to change over.
Except for the walls of three discs, every world therefore has a way through.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from eyechart.cameras import ROVER
from eyechart.errors import SpecError, suggestion
from eyechart.seeds import key_seed
from eyechart.simulators.banks import check_seed

TRACKS_M = ROVER.tracks_m
"""The tracks' middles across the road, from right to left."""

ROAD_HALF_M = ROVER.half_width_m
GOAL_M = 100.0
WALL_SHARE = 2 / 25
WALL_FROM_M, WALL_TO_M = 60.0, 85.0
_WALL_RADIUS_M = 1.25
_WALL_OFFSETS_M = (-3.0, 0.0, 3.0)
_RADIUS_M = (0.5, 0.65)
_HEIGHT_M = (0.8, 1.1)
_PAINTS = 3


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A disc on the road, in metres, as high as it is, in one of a few paints."""

    x: float
    y: float
    radius: float
    height: float
    paint: int

    def mirrored(self) -> "Obstacle":
        """Return the obstacle in the mirrored world."""
        return replace(self, y=-self.y)


@dataclass(frozen=True, slots=True)
class Layout:
    """The obstacles on a road; ``closed`` if a wall leaves no way through."""

    family: str
    obstacles: tuple[Obstacle, ...]
    closed: bool = False

    def mirrored(self) -> "Layout":
        """Return the mirrored world."""
        return replace(self, obstacles=tuple(obstacle.mirrored() for obstacle in self.obstacles))

    def raised(self, times: float) -> "Layout":
        """Return the layout with obstacles so many times as high."""
        return replace(
            self, obstacles=tuple(replace(obstacle, height=times * obstacle.height) for obstacle in self.obstacles)
        )


_Rng = np.random.Generator


def make_layout(family: str, seed: int, *, simulator: str = "rover", mirrored: bool = False) -> Layout:
    """Return the obstacles of a simulator, a family and a seed, or their mirror image.

    Raises SpecError for an unknown family or a seed out of range.
    """
    check_seed(seed)
    layout = _make_layout(family, seed, simulator)
    return layout.mirrored() if mirrored else layout


def _make_layout(family: str, seed: int, simulator: str) -> Layout:
    if family not in FAMILIES:
        known = f"{', '.join(FAMILIES)}{suggestion(family, FAMILIES)}"
        raise SpecError(f"simulator '{simulator}' has no scenario '{family}'; known: {known}")
    rng = np.random.default_rng(key_seed("rover", "layout", family, seed))
    obstacles = _MAKERS[family](rng)
    rng = np.random.default_rng(key_seed("rover", "wall", family, seed))
    if rng.uniform() >= WALL_SHARE:
        return Layout(family, tuple(obstacles))
    x = float(rng.uniform(WALL_FROM_M, WALL_TO_M))
    wall = [
        replace(new_obstacle(x, y, rng), radius=_WALL_RADIUS_M, height=_HEIGHT_M[1], paint=0) for y in _WALL_OFFSETS_M
    ]
    return Layout(family, (*(obstacle for obstacle in obstacles if obstacle.x < x - 8.0), *wall), closed=True)


def new_obstacle(x: float, y: float, rng: _Rng) -> Obstacle:
    """Return an obstacle of a usual size at this place."""
    radius, height = float(rng.uniform(*_RADIUS_M)), float(rng.uniform(*_HEIGHT_M))
    return Obstacle(x, y, radius, height, int(rng.integers(_PAINTS)))


def _offset(rng: _Rng) -> list[Obstacle]:
    side = int(rng.choice([-1, 1]))
    return [
        new_obstacle(x + float(rng.uniform(-2, 2)), side * float(rng.uniform(0.75, 1.0)), rng)
        for x in (22.0, 46.0, 70.0)
    ]


def _slalom(rng: _Rng) -> list[Obstacle]:
    first, outer = int(rng.integers(2)), (TRACKS_M[-1], TRACKS_M[0])
    return [
        new_obstacle(18.0 + 17.0 * number, across + float(rng.uniform(-0.25, 0.25)), rng)
        for number in range(5)
        for across in ((0.0,) if (number + first) % 2 else outer)
    ]


def _stations(rng: _Rng, *, first: float, apart: float, blocked: tuple[int, int]) -> list[Obstacle]:
    """Return stations along the road that block some tracks, but never the way through."""
    way, stations = 1, []
    for x in np.arange(first, GOAL_M - 6.0, apart).tolist():
        way = int(np.clip(way + rng.integers(-1, 2), 0, len(TRACKS_M) - 1))
        others = rng.permutation([track for track in range(len(TRACKS_M)) if track != way]).tolist()
        for track in others[: int(rng.integers(blocked[0], blocked[1] + 1))]:
            across = TRACKS_M[track] + float(rng.uniform(-0.25, 0.25))
            stations.append(new_obstacle(x + float(rng.uniform(-0.8, 0.8)), across, rng))
    return stations


FAMILIES: Mapping[str, str] = {
    "offset": "Three obstacles beside the middle, all to the left or all to the right of it: one side stays open.",
    "single": "One obstacle in the middle of the road, which leaves both sides.",
    "slalom": "In turn one obstacle in the middle and a pair left and right of it, 17 m apart.",
    "gate": "Four pairs of obstacles, which leave one track in three.",
    "clutter": "Obstacles on up to two of three tracks every 9.5 m.",
}
"""The scenarios of drives and banks, described in words."""

_MAKERS: Mapping[str, Callable[[_Rng], list[Obstacle]]] = {
    "offset": _offset,
    "single": lambda rng: [new_obstacle(float(rng.uniform(25, 60)), float(rng.uniform(-0.2, 0.2)), rng)],
    "slalom": _slalom,
    "gate": partial(_stations, first=20.0, apart=20.0, blocked=(2, 2)),
    "clutter": partial(_stations, first=12.0, apart=9.5, blocked=(0, 2)),
}
