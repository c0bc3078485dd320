"""A rover among a layout's obstacles: the plant, the law that tracks an intent, and a world driven by decisions.

The plant is a kinematic bicycle, stepped by acceleration and steering angle. x and y are those of
the rear axle's middle, in metres, yaw is counter-clockwise from the road's direction in radians.
Source: J. Kong et al., "Kinematic and dynamic vehicle models for autonomous driving control
design", IV 2015, with the reference point at the rear axle. A mirrored state with the mirrored
steering gives the mirrored state to the bit.

In the tracking law an action asks for a speed and a track, and acceleration and steering follow.
LEFT and RIGHT ask for the next track to that side, as far as there is one; the others keep the
track that was asked for last. Another law, such as a model predictive one, may stand in its place:
it needs the plant and the obstacles.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from eyechart.cameras import ROVER
from eyechart.simulators.road import DECISION_S, GOAL_M, ROAD_HALF_M, TRACKS_M, Layout, RoadWorld, next_track

WHEELBASE_M = 0.6
RADIUS_M = ROVER.radius_m
"""The disc around the reference point in which the rover lies."""

MOST_STEERING = 0.5
MOST_ACCELERATION_MPS2 = 2.0
MOST_BRAKING_MPS2 = 5.0
"""About half of gravity: what tyres on dry asphalt give without sliding."""


@dataclass(frozen=True, slots=True)
class RoverState:
    """Where the rover is, how it is turned, and how fast it goes, in m, rad and m/s; it does not go backwards."""

    x: float
    y: float
    yaw: float
    speed: float

    def mirrored(self) -> "RoverState":
        """Return the state in the mirrored world."""
        return replace(self, y=-self.y, yaw=-self.yaw)

    def numbers(self) -> tuple[float, float, float, float]:
        """Return all that the state consists of."""
        return self.x, self.y, self.yaw, self.speed


def advance(state: RoverState, acceleration: float, steering: float, seconds: float) -> RoverState:
    """Return the state after so many seconds under one acceleration (m/s²) and one steering angle (rad, left positive).

    Both are limited to what the rover can do. The pose is integrated by the midpoint rule.
    """
    acceleration = min(max(acceleration, -MOST_BRAKING_MPS2), MOST_ACCELERATION_MPS2)
    steering = min(max(steering, -MOST_STEERING), MOST_STEERING)
    speed = max(state.speed + acceleration * seconds, 0.0)
    moved = (state.speed + speed) / 2 * seconds
    turned = moved * math.tan(steering) / WHEELBASE_M
    middle = state.yaw + turned / 2
    return RoverState(
        x=state.x + moved * math.cos(middle),
        y=state.y + moved * math.sin(middle),
        yaw=state.yaw + turned,
        speed=speed,
    )


INNER_S = 0.05
"""The law's own period, and the plant's."""

_MILD_MPS2 = 2.0
_MOST_ASIDE_MPS2 = 5.0
_MOST_YAW = 0.6
_YAW_A_METRE = 0.6
_YAW_S = 0.15
_LEAST_SPEED_MPS = 0.2


@dataclass(frozen=True, slots=True)
class Intent:
    """What an action means: a speed in m/s, how hard it may be braked for in m/s², and how many tracks to the left."""

    speed: float
    braking: float = _MILD_MPS2
    tracks: int = 0


INTENTS: Mapping[str, Intent] = {
    "STOP": Intent(0.0, MOST_BRAKING_MPS2),
    "SLOW": Intent(2.5),
    "STRAIGHT": Intent(4.5),
    "LEFT": Intent(4.0, tracks=1),
    "RIGHT": Intent(4.0, tracks=-1),
}


def control(state: RoverState, intent: Intent, track: int) -> tuple[float, float]:
    """Return acceleration (m/s²) and steering angle (rad) towards the intent's speed and the middle of a track.

    The yaw aimed at grows with the distance from the track; the yaw rate is bounded by what the
    tyres give sideways.
    """
    acceleration = min(max((intent.speed - state.speed) / INNER_S, -intent.braking), MOST_ACCELERATION_MPS2)
    aimed = min(max((TRACKS_M[track] - state.y) * _YAW_A_METRE, -_MOST_YAW), _MOST_YAW)
    speed = max(state.speed, _LEAST_SPEED_MPS)
    most = _MOST_ASIDE_MPS2 / speed
    rate = min(max((aimed - state.yaw) / _YAW_S, -most), most)
    return acceleration, math.atan(rate * WHEELBASE_M / speed)


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
    return any(math.hypot(one.x - state.x, one.y - state.y) < one.radius + RADIUS_M for one in layout.obstacles)
