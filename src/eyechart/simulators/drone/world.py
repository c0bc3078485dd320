"""A quadrotor among a layout's obstacles that flies at its commanded velocity; contact is a crash.

A mirrored world flown with mirrored actions ends in the mirrored state, bit for bit.

An intent becomes velocity commands within the published limits of the Crazyflie 2.1. Its firmware's
velocity loop tilts by 25 degrees for each m/s of error, up to 20 degrees. Its position loop
commands 2 m/s for each metre (Bitcraze, crazyflie-firmware,
``src/platform/interface/platform_defaults_cf2.h``: ``PID_VEL_X_KP``, ``PID_VEL_PITCH_MAX``,
``PID_POS_X_KP``). At these small angles a tilt is an acceleration, g times its tangent. Velocity
therefore answers as a first-order lag of 0.23 s with an acceleration of at most 3.6 m/s². The
greatest speed is 30 km/h (gym-pybullet-drones, ``assets/cf2x.urdf``: ``max_speed_kmh``); cruise
stays below half of it. By default the firmware's position loop commands at most 1 m/s
(``PID_POS_VEL_X_MAX``). That limit does not bound the velocity commands used here.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from eyechart.simulators.road import DECISION_S, GOAL_M, TRACKS_M, Layout, RoadWorld, next_track

MOST_SPEED_MPS = 30 / 3.6
GRAVITY = 9.81
MOST_ACCELERATION_MPS2 = GRAVITY * math.tan(math.radians(20.0))
LAG_S = 1 / (GRAVITY * math.radians(25.0))
POSITION_GAIN = 2.0
MOST_ASIDE_MPS = 2.0
"""The greatest speed of a change of tracks."""

BODY_RADIUS_M = 0.07
"""From the middle of a Crazyflie to the tip of a propeller: an arm of 46 mm (``ARM_LENGTH``) and a
blade of 23 mm."""


@dataclass(frozen=True, slots=True)
class DroneIntent:
    """The meaning of an action: a speed along the road in m/s, and tracks to the left."""

    speed: float
    tracks: int = 0


INTENTS: Mapping[str, DroneIntent] = {
    "STOP": DroneIntent(0.0),
    "SLOW": DroneIntent(2.5),
    "STRAIGHT": DroneIntent(4.0),
    "LEFT": DroneIntent(4.0, tracks=1),
    "RIGHT": DroneIntent(4.0, tracks=-1),
}


@dataclass(frozen=True, slots=True)
class Velocity:
    """A velocity in m/s, along the road and to the left."""

    ahead: float = 0.0
    left: float = 0.0

    @property
    def speed(self) -> float:
        """Return the size of the velocity."""
        return math.hypot(self.ahead, self.left)

    def mirrored(self) -> "Velocity":
        """Return the velocity in the mirrored world."""
        return replace(self, left=-self.left)

    def after(self, intent: DroneIntent, to_left: float, seconds: float) -> "Velocity":
        """Return the command ``seconds`` later, for a track that lies ``to_left`` m aside."""
        sideways = min(max(POSITION_GAIN * to_left, -MOST_ASIDE_MPS), MOST_ASIDE_MPS)
        ahead, left = (intent.speed - self.ahead) / LAG_S, (sideways - self.left) / LAG_S
        size = math.hypot(ahead, left)
        share = 1.0 if size <= MOST_ACCELERATION_MPS2 else MOST_ACCELERATION_MPS2 / size
        return Velocity(self.ahead + share * ahead * seconds, self.left + share * left * seconds)


HZ = 48
"""Steps a second. In one step a drone at full speed covers 17 cm, and obstacles are a metre
wide."""

RAISED = 3.0
"""Obstacles are pillars of 2.4 to 3.3 m for a drone, three times as high as for a rover, so that it
cannot fly over them."""


@dataclass(frozen=True, slots=True)
class Flight:
    """A drone's place in metres and its velocity; its gimbal keeps the camera along the road."""

    x: float
    y: float
    velocity: Velocity

    @property
    def yaw(self) -> float:
        """Return 0: the gimbal does not turn."""
        return 0.0

    @property
    def speed(self) -> float:
        """Return the speed in m/s."""
        return self.velocity.speed

    def mirrored(self) -> "Flight":
        """Return the state in the mirrored world."""
        return replace(self, y=-self.y, velocity=self.velocity.mirrored())

    def numbers(self) -> tuple[float, ...]:
        """Return all numbers of the state."""
        return self.x, self.y, self.velocity.ahead, self.velocity.left


@dataclass(frozen=True)
class DroneWorld(RoadWorld[Flight]):
    """A drone under way."""

    vehicle: ClassVar[str] = "drone"


def start(layout: Layout) -> DroneWorld:
    """Return a layout's world at its start: the drone hovers over the middle of the road."""
    return DroneWorld(layout.raised(RAISED), Flight(0.0, 0.0, Velocity()))


def decide(world: DroneWorld, action: str) -> DroneWorld:
    """Return the world one decision later, or at the earlier end of the drive."""
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
    return any(
        math.hypot(obstacle.x - state.x, obstacle.y - state.y) <= obstacle.radius + BODY_RADIUS_M
        for obstacle in layout.obstacles
    )
