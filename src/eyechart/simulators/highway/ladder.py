"""The ladder's scenarios: 30 seconds of highway-env, a decision a second, in which policies are ranked.

The paper (Table t:baselines) prints no settings. Of those tried, these come nearest to its rows: distance counts from
the end of the first second, dense traffic is tight enough that the slowest policy crashes once in a while, and
"blocked" is a close start in traffic, because behind a vehicle that stands still SLOW crashes 7 times of 8 and could
not head the table.
"""

from collections.abc import Mapping

import numpy as np

from eyechart.errors import SpecError
from eyechart.frames import RGB, Scalar
from eyechart.simulators import StepResult
from eyechart.simulators.banks import check_seed
from eyechart.simulators.highway.speedups import speedups
from eyechart.simulators.highway.truth import read_truth
from eyechart.simulators.highway.world import Camera, Setting

DURATION_S = 30

LADDER: Mapping[str, Setting] = {
    "light": Setting("highway-v0", {"lanes_count": 3, "vehicles_count": 15, "duration": DURATION_S}),
    "dense": Setting(
        "highway-v0", {"lanes_count": 3, "vehicles_count": 20, "vehicles_density": 1.1, "duration": DURATION_S}
    ),
    "merge": Setting("merge-v0", {}),
    "blocked": Setting(
        "highway-v0", {"lanes_count": 3, "vehicles_count": 20, "ego_spacing": 1, "duration": DURATION_S}
    ),
}


class LadderDrive:
    """One of the ladder's scenarios under way.

    Its states are those of the stock environment bit for bit: highway-env's own ``step`` runs, with its faster parts
    in place and without the observation, which nobody reads. Source: paper, Table t:baselines.
    """

    def __init__(self, scenario: str, seed: int, commands: Mapping[str, str]) -> None:
        if scenario not in LADDER:
            raise SpecError(f"simulator 'highway' has no scenario '{scenario}'; known: {', '.join(LADDER)}")
        check_seed(seed)
        with speedups():
            self._world = LADDER[scenario].open(seed)
        self._world.observation_type = _Unobserved()
        numbers = self._world.action_type.actions_indexes
        self._commands = {action: numbers[command] for action, command in commands.items()}
        self._camera: Camera | None = None
        self._from_m: float | None = None
        self._ended = False

    def picture(self) -> RGB:
        """Return the stock picture, shape (150, 600, 3), uint8."""
        self._camera = self._camera or Camera(self._world)
        return self._camera.draw()

    def truth(self) -> Mapping[str, Scalar]:
        """Return the columns of the banks."""
        return read_truth(self._world)

    def step(self, action: str) -> StepResult:
        """Drive on for a second; ``distance_m`` counts from the end of the first one.

        Raises ValueError for an action that is none, and after the end.
        """
        if self._ended:
            raise ValueError("this drive is over")
        if action not in self._commands:
            raise ValueError(f"'{action}' is none of {', '.join(self._commands)}")
        world = self._world
        with speedups():
            _, reward, over, timed_out, _ = world.step(self._commands[action])
        x = float(world.vehicle.position[0])
        self._from_m = x if self._from_m is None else self._from_m
        crashed = bool(world.vehicle.crashed)
        out_of_time = timed_out or world.time >= DURATION_S
        ended = "crash" if crashed else "goal" if over else "time" if out_of_time else None
        self._ended = ended is not None
        return StepResult(
            reward=float(reward),
            speed_mps=float(world.vehicle.speed),
            distance_m=x - self._from_m,
            crashed=crashed,
            ended=ended,
        )

    def state(self, decimals: int | None = None) -> bytes:
        """Return every vehicle's position, heading and speed as raw 64-bit floats, rounded where it is asked for."""
        rows = [[*vehicle.position, vehicle.heading, vehicle.speed] for vehicle in self._world.road.vehicles]
        numbers = np.array(rows, dtype=np.float64)
        return (numbers if decimals is None else numbers.round(decimals) + 0.0).tobytes()

    def close(self) -> None:
        """Let go of the world."""
        self._world.close()


class _Unobserved:
    """Stands where highway-env computes an observation in every step."""

    def observe(self) -> None:
        """Return nothing."""
