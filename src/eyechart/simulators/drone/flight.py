"""How a quadrotor follows the five actions: an intent becomes velocity commands that its published limits allow.

The limits are the Crazyflie 2.1's. Its firmware's velocity loop tilts by 25 degrees for each m/s of error, up to 20
degrees, and its position loop asks for 2 m/s a metre (Bitcraze, crazyflie-firmware,
``src/platform/interface/platform_defaults_cf2.h``: ``PID_VEL_X_KP``, ``PID_VEL_PITCH_MAX``, ``PID_POS_X_KP``). At these
small angles a tilt is an acceleration, g times its tangent, so velocity answers as a first-order lag of 0.23 s whose
acceleration is at most 3.6 m/s². Its greatest speed is 30 km/h (gym-pybullet-drones, ``assets/cf2x.urdf``:
``max_speed_kmh``); cruise stays below half of it.
"""

import math
from dataclasses import dataclass, replace

GRAVITY = 9.81
MOST_SPEED_MPS = 30 / 3.6
MOST_TILT_RAD = math.radians(20.0)
MOST_ACCELERATION = GRAVITY * math.tan(MOST_TILT_RAD)
LAG_S = 1 / (GRAVITY * math.radians(25.0))
POSITION_GAIN = 2.0

CRUISE_MPS = 4.0
SLOW_MPS = 2.0
SIDEWAYS_MPS = 2.0
"""What STRAIGHT and SLOW ask for, and the most that a change of lane may take."""

BODY_RADIUS_M = 0.07
"""From the middle of a Crazyflie to the tip of a propeller: 46 mm arm and 23 mm blade."""


@dataclass(frozen=True, slots=True)
class Intent:
    """What the drone is about: how fast to fly forwards, in m/s, and on which line, in metres to the left."""

    speed_mps: float
    line_m: float


@dataclass(frozen=True, slots=True)
class Command:
    """A velocity to be flown, in m/s: forwards and to the left."""

    ahead: float = 0.0
    left: float = 0.0

    def after(self, intent: Intent, y: float, seconds: float) -> "Command":
        """Return the command so many seconds later for a drone at ``y`` metres to the left of the middle."""
        sideways = max(-SIDEWAYS_MPS, min(SIDEWAYS_MPS, POSITION_GAIN * (intent.line_m - y)))
        ahead, left = (intent.speed_mps - self.ahead) / LAG_S, (sideways - self.left) / LAG_S
        size = math.hypot(ahead, left)
        share = 1.0 if size <= MOST_ACCELERATION else MOST_ACCELERATION / size
        return replace(self, ahead=self.ahead + share * ahead * seconds, left=self.left + share * left * seconds)
