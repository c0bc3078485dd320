"""A rover among a layout's obstacles: the plant, the tracking law, and a world under decisions.

The plant is a kinematic bicycle, stepped by acceleration and steering angle. x and y are those of
the rear axle's middle, in metres. Yaw is counter-clockwise from the road's direction, in radians.
Source: J. Kong et al., "Kinematic and dynamic vehicle models for autonomous driving control
design", IV 2015, with the reference point at the rear axle. A mirrored state with the mirrored
steering gives the mirrored state to the bit.

In the tracking law an action sets a speed and a track, and acceleration and steering follow. LEFT
and RIGHT choose the next track to that side, if there is one; the others keep the last chosen
track. Another law, such as a model-predictive one, may replace it: it needs the plant and the
obstacles.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from eyechart.cameras import ROVER
from eyechart.simulators.road import DECISION_S, GOAL_M, ROAD_HALF_M, TRACKS_M, Layout, RoadWorld, next_track

WHEELBASE_M = 0.6
RADIUS_M = ROVER.radius_m
"""The radius of the disc around the reference point that contains the rover."""

MOST_STEERING = 0.5
MOST_ACCELERATION_MPS2 = 2.0
MOST_BRAKING_MPS2 = 5.0
"""About half of gravity: the braking of tyres on dry asphalt without sliding."""


@dataclass(frozen=True, slots=True)
class RoverState:
    """The rover's pose and speed, in m, rad and m/s; it does not drive backwards."""

    x: float
    y: float
    yaw: float
    speed: float

    def mirrored(self) -> "RoverState":
        """Return the state in the mirrored world."""
        return replace(self, y=-self.y, yaw=-self.yaw)

    def numbers(self) -> tuple[float, float, float, float]:
        """Return all numbers of the state."""
        return self.x, self.y, self.yaw, self.speed


def advance(state: RoverState, acceleration: float, steering: float, seconds: float) -> RoverState:
    """Return the state ``seconds`` later under one acceleration (m/s²) and steering angle (rad).

    A positive angle steers to the left. Both are limited to the rover's abilities. The pose is
    integrated by the midpoint rule.
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
"""The period of the law and of the plant."""

_MILD_MPS2 = 2.0
_MOST_ASIDE_MPS2 = 5.0
_MOST_YAW = 0.6
_YAW_A_METRE = 0.6
_YAW_S = 0.15
_LEAST_SPEED_MPS = 0.2


@dataclass(frozen=True, slots=True)
class RoverIntent:
    """An action's speed in m/s, its braking limit in m/s², and its number of tracks to the left."""

    speed: float
    braking: float = _MILD_MPS2
    tracks: int = 0


INTENTS: Mapping[str, RoverIntent] = {
    "STOP": RoverIntent(0.0, MOST_BRAKING_MPS2),
    "SLOW": RoverIntent(2.5),
    "STRAIGHT": RoverIntent(4.5),
    "LEFT": RoverIntent(4.0, tracks=1),
    "RIGHT": RoverIntent(4.0, tracks=-1),
}


def control(state: RoverState, intent: RoverIntent, track: int) -> tuple[float, float]:
    """Return acceleration (m/s²) and steering angle (rad) towards an intent's speed and track.

    The target yaw grows with the distance from the track. The yaw rate is limited by the tyres'
    sideways grip.
    """
    acceleration = min(max((intent.speed - state.speed) / INNER_S, -intent.braking), MOST_ACCELERATION_MPS2)
    aimed = min(max((TRACKS_M[track] - state.y) * _YAW_A_METRE, -_MOST_YAW), _MOST_YAW)
    speed = max(state.speed, _LEAST_SPEED_MPS)
    most = _MOST_ASIDE_MPS2 / speed
    rate = min(max((aimed - state.yaw) / _YAW_S, -most), most)
    return acceleration, math.atan(rate * WHEELBASE_M / speed)


START_SPEED_MPS = 1.0

Law = Callable[[RoverState, RoverIntent, int], tuple[float, float]]
"""A law maps state, intent and track to acceleration and steering, every ``INNER_S``."""


@dataclass(frozen=True)
class RoverWorld(RoadWorld[RoverState]):
    """A rover under way."""

    vehicle: ClassVar[str] = "rover"


def start(layout: Layout) -> RoverWorld:
    """Return a layout's world at its start: the rover in the middle of the road, at 1 m/s."""
    return RoverWorld(layout, RoverState(0.0, 0.0, 0.0, START_SPEED_MPS))


def decide(world: RoverWorld, action: str, law: Law = control) -> RoverWorld:
    """Return the world one decision later, or at the earlier end of the drive."""
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
    return any(
        math.hypot(obstacle.x - state.x, obstacle.y - state.y) < obstacle.radius + RADIUS_M
        for obstacle in layout.obstacles
    )
