"""A drone's drive in gym-pybullet-drones, through the layouts of our own world and by the same commands."""

from dataclasses import replace

from eyechart.frames import RGB
from eyechart.simulators.drone.aviary import HZ, Aviary
from eyechart.simulators.drone.flight import INTENTS, Velocity
from eyechart.simulators.drone.world import DroneWorld, Flight, start
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


class PybulletDrive(RoadDrive[DroneWorld]):
    """One of the drone's worlds in gym-pybullet-drones.

    The commands are those of our own drone, and the Crazyflie's controller and physics follow them as they can. Any
    contact is a crash. Raises SpecError for an unknown scenario, a seed out of range, and where gym-pybullet-drones is
    not installed.
    """

    def __init__(self, scenario: str, seed: int, *, mirrored: bool = False) -> None:
        layout = make_layout(scenario, seed, simulator="drone-pybullet", mirrored=mirrored)
        super().__init__(start(layout), self._fly, actions=INTENTS, top_mps=INTENTS["STRAIGHT"].speed)
        world = self.world
        verge = verge_of(scenario, world.view)
        self._aviary = Aviary(cylinders(world.layout), world.view, verge, y=world.state.y)
        self._command = Velocity()

    def picture(self) -> RGB:
        """Return what PyBullet's camera shows, shape (180, 320, 3), uint8."""
        return self._aviary.draw()

    def state(self, decimals: int | None = None) -> bytes:
        """Return the drone's state and the obstacles as raw 64-bit floats, rounded where it is asked for."""
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
