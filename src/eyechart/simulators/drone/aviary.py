"""gym-pybullet-drones' Crazyflie in the layouts of eyechart's own drone world.

Its commands are those of that world; physics and contacts are PyBullet's. Settings that differ from
the library's, and why:

- ``SPEED_LIMIT`` is 0.25 m/s by default.
- A plain road, which a mirror leaves as it is, replaces the floor's checkerboard.
- Contacts are read after every step, because no flag reports them.
- The camera is eyechart's own, level and straight ahead: the stock camera distorts and sees its
  own propellers.
- Light is even. PyBullet shades a cylinder brighter on one side for every place of the light, so
  that a flipped picture could not have been drawn.
"""

import contextlib
import io
import os
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from eyechart.cameras import Colour, ForwardView
from eyechart.errors import SpecError
from eyechart.frames import RGB
from eyechart.simulators.camera import Cylinder
from eyechart.simulators.drone.world import INTENTS, MOST_SPEED_MPS, DroneWorld, Flight, Velocity, start
from eyechart.simulators.road import (
    DECISION_S,
    GOAL_M,
    TRACKS_M,
    RoadDrive,
    cylinders,
    make_layout,
    next_track,
    verge_of,
)

HZ = 240
"""Steps a second of PyBullet and of the controller."""

SOURCE = "git+https://github.com/utiasDSL/gym-pybullet-drones@90b178aba69b09085dd70e7a1e88bb58ca00b4c9"
_CLIMB_MPS = 1.0
_CLIMB_GAIN = 2.0
_FLOOR_M = (400.0, 400.0, 1.0)
_FLOOR_BEGINS_M = -50.0
_ROAD_RISES_M = 0.02
IN_FRONT_M = 0.15
_NEAR_M, _FAR_M = 0.05, 300.0


class Aviary:
    """A drone at its eye's height, flown by velocity commands.

    ``touched`` says whether it ever touched anything.
    """

    def __init__(self, cylinders: Iterable[Cylinder], view: ForwardView, verge: Colour, *, y: float) -> None:
        self._bullet, environment = require()
        self._view, self._height = view, view.eye_m
        with (
            contextlib.redirect_stdout(io.StringIO()),
            warnings.catch_warnings(),
        ):  # it prints the drone's data
            warnings.simplefilter("ignore")  # and warns that its spaces are of single precision
            self._env = environment(
                initial_xyzs=np.array([[0.0, y, view.eye_m]]), pyb_freq=HZ, ctrl_freq=HZ, user_debug_gui=False
            )
        self._env.SPEED_LIMIT = MOST_SPEED_MPS
        self._client: int = self._env.CLIENT
        self._bullet.removeBody(self._env.PLANE_ID, physicsClientId=self._client)
        self._lay_floor(verge)
        for cylinder in cylinders:
            self._stand(cylinder)
        self.touched = False

    @property
    def position(self) -> tuple[float, float]:
        """Return the drone's distance along the road and to the left of its middle, in metres."""
        return float(self._env.pos[0, 0]), float(self._env.pos[0, 1])

    @property
    def velocity(self) -> Velocity:
        """Return the drone's velocity."""
        return Velocity(float(self._env.vel[0, 0]), float(self._env.vel[0, 1]))

    def fly(self, command: Velocity) -> None:
        """Fly by a command for one step, and hold the height."""
        climb = float(np.clip(_CLIMB_GAIN * (self._height - self._env.pos[0, 2]), -_CLIMB_MPS, _CLIMB_MPS))
        wanted = np.array([command.ahead, command.left, climb])
        speed = float(np.linalg.norm(wanted))
        direction = wanted / speed if speed else wanted
        self._env.step(np.array([[*direction, min(speed / MOST_SPEED_MPS, 1.0)]]))
        contacts = self._bullet.getContactPoints(bodyA=int(self._env.DRONE_IDS[0]), physicsClientId=self._client)
        self.touched = self.touched or bool(contacts)

    def draw(self) -> RGB:
        """Return the picture of a level camera at the nose, shape (height, width, 3), uint8."""
        bullet, view = self._bullet, self._view
        x, y, z = map(float, self._env.pos[0])
        aside, up = view.width / 2 / view.focal_px * _NEAR_M, view.horizon / view.focal_px * _NEAR_M
        down = (view.height - view.horizon) / view.focal_px * _NEAR_M
        nose = x + IN_FRONT_M
        _, _, pixels, _, _ = bullet.getCameraImage(
            view.width,
            view.height,
            bullet.computeViewMatrix([nose, y, z], [nose + 1.0, y, z], [0.0, 0.0, 1.0]),
            bullet.computeProjectionMatrix(-aside, aside, -down, up, _NEAR_M, _FAR_M),
            lightAmbientCoeff=1.0,
            lightDiffuseCoeff=0.0,
            lightSpecularCoeff=0.0,
            shadow=0,
            renderer=bullet.ER_TINY_RENDERER,
            flags=bullet.ER_NO_SEGMENTATION_MASK,
            physicsClientId=self._client,
        )
        return np.ascontiguousarray(np.reshape(pixels, (view.height, view.width, 4))[:, :, :3], dtype=np.uint8)

    def state(self, decimals: int | None = None) -> bytes:
        """Return position, attitude and both velocities as 64-bit floats, rounded on request."""
        env = self._env
        numbers = np.concatenate([env.pos[0], env.quat[0], env.vel[0], env.ang_v[0]]).astype(np.float64)
        return (numbers if decimals is None else numbers.round(decimals) + 0.0).tobytes()

    def close(self) -> None:
        """Disconnect from PyBullet."""
        with contextlib.suppress(self._bullet.error):
            self._env.close()

    def _lay_floor(self, verge: Colour) -> None:
        """Lay a plain floor with its upper side at zero, and a visible road without contact."""
        length, width, thick = _FLOOR_M
        grey = (self._view.surface,) * 3
        middle = _FLOOR_BEGINS_M + length / 2
        for half_width, rises, colour in ((width / 2, 0.0, verge), (self._view.half_width_m, _ROAD_RISES_M, grey)):
            half = [length / 2, half_width, thick / 2]
            self._place(
                self._bullet.GEOM_BOX, {"halfExtents": half}, colour, (middle, 0.0, rises - thick / 2), felt=not rises
            )

    def _stand(self, cylinder: Cylinder) -> None:
        where = (cylinder.x, cylinder.y, cylinder.base + cylinder.height / 2)
        self._place(
            self._bullet.GEOM_CYLINDER, {"radius": cylinder.radius, "height": cylinder.height}, cylinder.colour, where
        )

    def _place(
        self,
        shape: int,
        size: dict[str, Any],
        colour: Colour,
        where: tuple[float, float, float],
        *,
        felt: bool = True,
    ) -> None:
        bullet, client = self._bullet, self._client
        seen = {("length" if name == "height" else name): value for name, value in size.items()}
        paint = [*(channel / 255 for channel in colour), 1.0]
        visual = bullet.createVisualShape(shape, rgbaColor=paint, physicsClientId=client, **seen)
        solid = bullet.createCollisionShape(shape, physicsClientId=client, **size) if felt else -1
        bullet.createMultiBody(0, solid, visual, where, physicsClientId=client)


def require() -> tuple[Any, Any]:
    """Return PyBullet and the VelocityAviary; raises SpecError if they are not installed."""
    try:
        with warnings.catch_warnings(), _muted():
            warnings.simplefilter("ignore")  # pkg_resources, which it imports, is deprecated
            import pybullet  # noqa: PLC0415  (an extra)
            from gym_pybullet_drones.envs.VelocityAviary import VelocityAviary  # noqa: PLC0415
    except ImportError as error:
        raise SpecError(
            f"simulator 'drone-pybullet' needs gym-pybullet-drones ({error}): on Python 3.11, pip install "
            f"'eyechart[drone]', then pip install --no-deps {SOURCE}"
        ) from error
    return pybullet, VelocityAviary


@contextlib.contextmanager
def _muted() -> Iterator[None]:
    """Discard a C library's standard error; PyBullet writes its build date there."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


class PybulletDrive(RoadDrive[DroneWorld]):
    """One of the drone's worlds in gym-pybullet-drones.

    The commands are those of eyechart's own drone. The Crazyflie's controller and physics follow
    them as well as they can. Any contact is a crash. Raises SpecError for an unknown scenario, a
    seed out of range, and if gym-pybullet-drones is not installed.
    """

    def __init__(self, scenario: str, seed: int, *, mirrored: bool = False) -> None:
        layout = make_layout(scenario, seed, simulator="drone-pybullet", mirrored=mirrored)
        super().__init__(start(layout), self._fly, actions=INTENTS, top_mps=INTENTS["STRAIGHT"].speed)
        world = self.world
        verge = verge_of(scenario, world.view)
        self._aviary = Aviary(cylinders(world.layout), world.view, verge, y=world.state.y)
        self._command = Velocity()

    def picture(self) -> RGB:
        """Return the picture of PyBullet's camera, shape (180, 320, 3), uint8."""
        return self._aviary.draw()

    def state(self, decimals: int | None = None) -> bytes:
        """Return the drone's state and the obstacles as 64-bit floats, rounded on request."""
        return super().state(decimals) + self._aviary.state(decimals)

    def close(self) -> None:
        """Disconnect from PyBullet."""
        self._aviary.close()

    def _fly(self, world: DroneWorld, action: str) -> DroneWorld:
        intent, aviary = INTENTS[action], self._aviary
        track = next_track(world.track, intent.tracks)
        steps = round(DECISION_S * HZ)
        for number in range(1, steps + 1):
            x, y = aviary.position
            self._command = self._command.after(intent, TRACKS_M[track] - y, 1 / HZ)
            aviary.fly(self._command)
            x, y = aviary.position
            if aviary.touched or x >= GOAL_M or number == steps:
                break
        return replace(
            world,
            state=Flight(x, y, aviary.velocity),
            track=track,
            seconds=world.seconds + number / HZ,
            crashed=aviary.touched,
        )
