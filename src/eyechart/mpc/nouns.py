"""What a bicycle is, where it is, what it should do, and what was planned for it."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True)
class Bicycle:
    """A kinematic bicycle, and the bounds of its inputs: metres, seconds, radians.

    ``accel_mps2`` bounds the acceleration, ``brake_mps2`` the deceleration (positive), ``steer_rad`` the steering angle
    on either side, ``speed_mps`` the speed, which is never negative, ``aside_mps2`` the lateral acceleration.
    """

    wheelbase_m: float = 0.5
    accel_mps2: float = 2.0
    brake_mps2: float = 4.0
    steer_rad: float = 0.5
    speed_mps: float = 5.0
    aside_mps2: float = 4.0

    def most_steer(self, speed_mps: float) -> float:
        """Return the steering angle that the wheels allow, or at speed the lateral acceleration, in radians."""
        fast = speed_mps * speed_mps
        if fast * math.tan(self.steer_rad) <= self.aside_mps2 * self.wheelbase_m:
            return self.steer_rad
        return math.atan(self.aside_mps2 * self.wheelbase_m / fast)


@dataclass(frozen=True, slots=True)
class Road:
    """Half of the road's width that the vehicle's centre may use, in metres."""

    half_width_m: float = 4.0


@dataclass(frozen=True, slots=True)
class Weights:
    """What the cost is made of: squared deviations a stage, squared inputs and their changes, and slack."""

    speed: float = 1.0
    lateral: float = 1.0
    heading: float = 2.0
    accel: float = 0.05
    steer: float = 1.0
    accel_change: float = 0.05
    steer_change: float = 2.0
    slack: float = 200.0


@dataclass(frozen=True, slots=True)
class State:
    """Where a bicycle is: metres, radians, metres a second."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float


@dataclass(frozen=True, slots=True)
class Target:
    """What an intent asks of the controller: a speed, and a lateral offset from the road's middle, left positive."""

    speed_mps: float
    offset_m: float


@dataclass(frozen=True, slots=True)
class Plan:
    """The command for the next 0.2 s, and where the controller thinks that it leads.

    ``solved`` is False where the solver found no optimum: then the command is the hardest brake with the wheels
    straight, ``flag`` says why in the solver's own code, and ``path`` is that of braking. ``path`` has shape (8, 2), in
    metres.
    """

    accel_mps2: float
    steer_rad: float
    solved: bool
    flag: int
    path: npt.NDArray[np.float64]
