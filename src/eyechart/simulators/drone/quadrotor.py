"""A quadrotor of our own: it flies its commands exactly, touches what it meets, and looks level and straight ahead."""

import math
from collections.abc import Iterable

import numpy as np

from eyechart.simulators.camera import Cylinder
from eyechart.simulators.drone.flight import BODY_RADIUS_M, Command

HZ = 48


class Quadrotor:
    """A drone whose velocity is its command: the lag and the limits are the command's own.

    The mirrored drone among mirrored cylinders flies the mirrored way, bit for bit.
    """

    def __init__(self, cylinders: Iterable[Cylinder], *, y: float) -> None:
        self._cylinders = tuple((one.x, one.y, one.radius + BODY_RADIUS_M) for one in cylinders)
        self.position = (0.0, y)
        self.velocity = Command()
        self.touched = False

    def fly(self, command: Command) -> None:
        """Fly by a command for one step."""
        x, y = self.position
        self.position = (x + command.ahead / HZ, y + command.left / HZ)
        self.velocity = command
        x, y = self.position
        self.touched = self.touched or any(
            math.hypot(to_x - x, to_y - y) <= reach for to_x, to_y, reach in self._cylinders
        )

    def state(self) -> bytes:
        """Return position and velocity as raw 64-bit floats."""
        return np.array([*self.position, self.velocity.ahead, self.velocity.left]).tobytes()

    def close(self) -> None:
        """Hold nothing, so let go of nothing."""
