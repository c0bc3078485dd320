"""A rover among a layout's obstacles, driven a decision at a time."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

from eyechart.simulators.road import DECISION_S, GOAL_M, ROAD_HALF_M, Layout, Obstacle, RoadWorld, next_track
from eyechart.simulators.rover.bicycle import RADIUS_M, RoverState, advance
from eyechart.simulators.rover.tracking import INNER_S, INTENTS, Intent, control

START_SPEED_MPS = 1.0

Law = Callable[[RoverState, Intent, int], tuple[float, float]]
"""From the state, the intent and the track to acceleration and steering, every ``INNER_S``."""


@dataclass(frozen=True)
class RoverWorld(RoadWorld[RoverState]):
    """A rover under way."""

    vehicle: ClassVar[str] = "rover"


def start(layout: Layout) -> RoverWorld:
    """Return the world of a layout at its beginning: the rover in the middle of the road, at 1 m/s."""
    return RoverWorld(layout, RoverState(0.0, 0.0, 0.0, START_SPEED_MPS))


def decide(world: RoverWorld, action: str, law: Law = control) -> RoverWorld:
    """Return the world one decision later, or where the drive ended before."""
    intent = INTENTS[action]
    track, state, crashed = next_track(world.track, intent.tracks), world.state, False
    steps = round(DECISION_S / INNER_S)
    for number in range(1, steps + 1):
        acceleration, steering = law(state, intent, track)
        state = advance(state, acceleration, steering, INNER_S)
        crashed = touches(state, world.layout)
        if crashed or state.x >= GOAL_M or number == steps:
            break
    return replace(world, state=state, track=track, seconds=world.seconds + number * INNER_S, crashed=crashed)


def touches(state: RoverState, layout: Layout) -> bool:
    """Return whether the rover touches an obstacle or leaves the road."""
    if abs(state.y) + RADIUS_M > ROAD_HALF_M:
        return True
    return any(_distance(state, one) < one.radius + RADIUS_M for one in layout.obstacles)


def _distance(state: RoverState, obstacle: Obstacle) -> float:
    return math.hypot(obstacle.x - state.x, obstacle.y - state.y)
