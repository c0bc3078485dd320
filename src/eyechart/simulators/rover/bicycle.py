"""The plant: a kinematic bicycle, stepped by acceleration and steering angle.

x and y are those of the rear axle's middle, in metres, yaw is counter-clockwise from the road's direction in radians.
Source: J. Kong et al., "Kinematic and dynamic vehicle models for autonomous driving control design", IV 2015, with
the reference point at the rear axle. A mirrored state with the mirrored steering gives the mirrored state to the bit.
"""

import math
from dataclasses import dataclass, replace

from eyechart.cameras import ROVER

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
