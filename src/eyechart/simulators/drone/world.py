"""A quadrotor of our own among a layout's obstacles: its velocity is its command, and contact is a crash.

A mirrored world flown with mirrored actions ends in the mirrored state, bit for bit.
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from eyechart.simulators.drone.flight import BODY_RADIUS_M, INTENTS, Velocity
from eyechart.simulators.road import DECISION_S, GOAL_M, TRACKS_M, Layout, RoadWorld, next_track

HZ = 48
"""Steps a second; in one of them a drone at full speed makes 17 cm, and obstacles are a metre wide."""

RAISED = 3.0
"""Obstacles are pillars of 2.4 to 3.3 m for a drone, three times as high as for a rover: it cannot fly over them."""


@dataclass(frozen=True, slots=True)
class Flight:
    """Where a drone is, in metres, and how it moves; its camera's gimbal keeps looking along the road."""

    x: float
    y: float
    velocity: Velocity

    @property
    def yaw(self) -> float:
        """Return 0: the gimbal does not turn."""
        return 0.0

    @property
    def speed(self) -> float:
        """Return how fast it flies, in m/s."""
        return self.velocity.speed

    def mirrored(self) -> "Flight":
        """Return the state in the mirrored world."""
        return replace(self, y=-self.y, velocity=self.velocity.mirrored())

    def numbers(self) -> tuple[float, ...]:
        """Return all that the state consists of."""
        return self.x, self.y, self.velocity.ahead, self.velocity.left


@dataclass(frozen=True)
class DroneWorld(RoadWorld[Flight]):
    """A drone under way."""

    vehicle: ClassVar[str] = "drone"


def start(layout: Layout) -> DroneWorld:
    """Return the world of a layout at its beginning, with pillars: the drone hovers over the middle of the road."""
    return DroneWorld(layout.raised(RAISED), Flight(0.0, 0.0, Velocity()))


def decide(world: DroneWorld, action: str) -> DroneWorld:
    """Return the world one decision later, or where the drive ended before."""
    intent = INTENTS[action]
    track, state, crashed = next_track(world.track, intent.tracks), world.state, False
    steps = round(DECISION_S * HZ)
    for number in range(1, steps + 1):
        velocity = state.velocity.after(intent, TRACKS_M[track] - state.y, 1 / HZ)
        state = Flight(state.x + velocity.ahead / HZ, state.y + velocity.left / HZ, velocity)
        crashed = touches(state, world.layout)
        if crashed or state.x >= GOAL_M or number == steps:
            break
    return replace(world, state=state, track=track, seconds=world.seconds + number / HZ, crashed=crashed)


def touches(state: Flight, layout: Layout) -> bool:
    """Return whether the drone touches an obstacle."""
    return any(math.hypot(one.x - state.x, one.y - state.y) <= one.radius + BODY_RADIUS_M for one in layout.obstacles)
