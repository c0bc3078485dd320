"""highway-env worlds whose road can be stepped, drawn from above, and changed for one picture.

The pictures are highway-env's own, drawn by its own functions without its viewer. The viewer opens
a display, draws nothing at all under ``SDL_VIDEODRIVER=dummy``, and draws fourteen more frames in
every later step.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import pygame

from eyechart.cameras import EGO_COLUMN, HEIGHT_PX, PALETTE, PX_PER_M, WIDTH_PX
from eyechart.frames import RGB
from eyechart.simulators.highway.stock import HighwayEnv, MergeEnv, RoadGraphics, WorldSurface

LANE_M = 4.0
VIEW_AHEAD_M = (WIDTH_PX - EGO_COLUMN) / PX_PER_M
"""76.4 m: a vehicle whose centre is nearer than this lies within the picture."""

VIEW_BEHIND_M = EGO_COLUMN / PX_PER_M
VIEW_ASIDE_M = HEIGHT_PX / 2 / PX_PER_M

SIMULATION_HZ = 15
CRASH_RED = PALETTE["red"][0]

_CENTRING = (EGO_COLUMN / WIDTH_PX, 0.5)

World = Any
"""An unwrapped highway-env environment (``AbstractEnv``); highway-env has no types of its own."""


class _NoObservation:
    """An empty replacement of highway-env's observations, which are not used."""

    def observe(self) -> None:
        """Return nothing."""


class _Highway(HighwayEnv):  # type: ignore[misc]
    def define_spaces(self) -> None:
        super().define_spaces()
        self.observation_type = _NoObservation()


class _Merge(MergeEnv):  # type: ignore[misc]
    def define_spaces(self) -> None:
        super().define_spaces()
        self.observation_type = _NoObservation()


_ROADS: Mapping[str, Any] = {"highway-v0": _Highway, "merge-v0": _Merge}


@dataclass(frozen=True, slots=True)
class EnvironmentSetting:
    """The environment of a scenario, and its changes of the configuration."""

    env: str
    config: Mapping[str, float]

    def open(self, seed: int) -> World:
        """Return the environment, reset with this seed and without observations."""
        world = _ROADS[self.env](config={**self.config, "simulation_frequency": SIMULATION_HZ})
        world.reset(seed=seed)
        return world

    def as_dict(self) -> dict[str, object]:
        """Return the setting as plain JSON values."""
        return {"env": self.env, **self.config}


def simulate(world: World) -> None:
    """Let every vehicle decide and move for one fifteenth of a second."""
    world.road.act()
    world.road.step(1 / SIMULATION_HZ)


class StockCamera:
    """Draws a world's stock picture; the road under an ego that does not move is drawn once."""

    def __init__(self, world: World) -> None:
        size = (WIDTH_PX, HEIGHT_PX)
        self._world = world
        self._surface = WorldSurface(size, 0, pygame.Surface(size))
        self._surface.scaling = PX_PER_M
        self._surface.centering_position = _CENTRING
        self._road = pygame.Surface(size)
        self._drawn_at: list[float] | None = None

    def draw(self) -> RGB:
        """Return the picture, shape (150, 600, 3), uint8."""
        road, surface = self._world.road, self._surface
        place = self._world.vehicle.position.tolist()
        if place != self._drawn_at:
            surface.move_display_window_to(self._world.vehicle.position)
            RoadGraphics.display(road, surface)
            self._road.blit(surface, (0, 0))
            self._drawn_at = place
        surface.blit(self._road, (0, 0))
        RoadGraphics.display_road_objects(road, surface, offscreen=True)
        RoadGraphics.display_traffic(road, surface, simulation_frequency=SIMULATION_HZ, offscreen=True)
        pixels = np.frombuffer(pygame.image.tobytes(surface, "RGB"), dtype=np.uint8)
        return pixels.reshape(HEIGHT_PX, WIDTH_PX, 3)


@contextmanager
def moved(vehicle: Any, x: float) -> Iterator[None]:  # noqa: ANN401  (highway-env has no types)
    """Move one vehicle along the road for the context."""
    before = vehicle.position
    vehicle.position = np.array([x, before[1]])
    try:
        yield
    finally:
        vehicle.position = before


@contextmanager
def recoloured(vehicle: Any) -> Iterator[None]:  # noqa: ANN401  (highway-env has no types)
    """Paint one vehicle in the red of a crash for the context."""
    vehicle.color = CRASH_RED
    try:
        yield
    finally:
        del vehicle.color
