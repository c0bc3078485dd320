"""Drives of highway-env: those of a bank like the paper's, and the ladder that ranks policies.

The paper does not say how its bank was driven. Of the drivers that were tried, one that idles, and
drives on after a crash, comes nearest. With 3 seeds and 12 steps, 76 of 144 frames are nearer than
18 m, where the paper prints 81. At 5.0 m, which is contact and the median at which the paper prints
57 answers of STOP, there are 61. With 24 steps, 219 of 288 frames are near, 198 of them after a
crash. The paper's accuracies of a model on 272 of its frames imply about 220; the paper does not
print that sum. A moment is one picture with its truth and the pictures of the same world with one
thing changed.

The ladder's drives last 30 seconds, with a decision a second. The paper (Table t:baselines) prints
no settings. Of those tried, these come nearest to its rows. Distance counts from the end of the
first second. Dense traffic is tight enough that the slowest policy crashes once in a while.
"blocked" is a close start in traffic: behind a vehicle that stands still, SLOW crashes 7 times of 8
and could not head the table.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from eyechart.errors import SpecError, suggestion
from eyechart.frames import LEAD_GAP, RGB, Scalar
from eyechart.seeds import key_seed
from eyechart.simulators import StepResult
from eyechart.simulators.banks import Moment, Preset, check_seed
from eyechart.simulators.highway.counterfactuals import record
from eyechart.simulators.highway.speedups import speedups
from eyechart.simulators.highway.stock import Vehicle
from eyechart.simulators.highway.truth import read_truth
from eyechart.simulators.highway.world import SIMULATION_HZ, EnvironmentSetting, StockCamera, World, simulate

BLOCKER_AHEAD_M = 40.0
BLOCKED = "blocked"

DRIVES: Mapping[str, EnvironmentSetting] = {
    "light": EnvironmentSetting("highway-v0", {"lanes_count": 3, "vehicles_count": 15}),
    "dense": EnvironmentSetting("highway-v0", {"lanes_count": 3, "vehicles_count": 20, "vehicles_density": 1.2}),
    "merge": EnvironmentSetting("merge-v0", {}),
    BLOCKED: EnvironmentSetting("highway-v0", {"lanes_count": 3, "vehicles_count": 20, "ego_spacing": 1}),
}
"""The scenarios of preset ``paper``; in ``blocked`` a vehicle stands 40 m ahead in the own lane."""


def open_drive(scenario: str, seed: int) -> World:
    """Return the world at the start of a drive."""
    world = DRIVES[scenario].open(seed)
    if scenario == BLOCKED:
        ego = world.vehicle
        place = [ego.position[0] + BLOCKER_AHEAD_M, ego.position[1]]
        world.road.vehicles.append(Vehicle(world.road, place, heading=0.0, speed=0.0))
    return world


def drive(scenario: str, seed: int, steps: int) -> Iterator[Moment]:
    """Yield a moment a second, the first one before the drive begins."""
    rng = np.random.default_rng(key_seed("highway", "paper", scenario, seed))
    camera = None
    for world in drive_worlds(scenario, seed, steps):
        camera = camera or StockCamera(world)
        yield record(world, camera, rng)


def drive_worlds(scenario: str, seed: int, steps: int) -> Iterator[World]:
    """Yield the world once a second of driving; it is one object that drives on at each step.

    A second is highway-env's own step without the observation and the reward, which no bank needs.
    """
    with speedups():
        world = open_drive(scenario, seed)
    idle = world.action_type.actions_indexes["IDLE"]
    yield world
    for _ in range(steps - 1):
        with speedups():
            world.action_type.act(idle)
            for _ in range(SIMULATION_HZ):
                simulate(world)
        yield world


PAPER = Preset({name: one.as_dict() for name, one in DRIVES.items()}, drive, LEAD_GAP)


DURATION_S = 30

LADDER: Mapping[str, EnvironmentSetting] = {
    "light": EnvironmentSetting("highway-v0", {"lanes_count": 3, "vehicles_count": 15, "duration": DURATION_S}),
    "dense": EnvironmentSetting(
        "highway-v0", {"lanes_count": 3, "vehicles_count": 20, "vehicles_density": 1.1, "duration": DURATION_S}
    ),
    "merge": EnvironmentSetting("merge-v0", {}),
    "blocked": EnvironmentSetting(
        "highway-v0", {"lanes_count": 3, "vehicles_count": 20, "ego_spacing": 1, "duration": DURATION_S}
    ),
}


class LadderDrive:
    """One of the ladder's scenarios under way.

    Its states equal those of the stock environment bit for bit. highway-env's own ``step`` runs
    with eyechart's faster parts, and without the observation, which is not used. Source: paper,
    Table t:baselines.
    """

    def __init__(self, scenario: str, seed: int, commands: Mapping[str, str]) -> None:
        if scenario not in LADDER:
            known = f"{', '.join(LADDER)}{suggestion(scenario, LADDER)}"
            raise SpecError(f"simulator 'highway' has no scenario '{scenario}'; known: {known}")
        check_seed(seed)
        with speedups():
            self._world = LADDER[scenario].open(seed)
        numbers = self._world.action_type.actions_indexes
        self._commands = {action: numbers[command] for action, command in commands.items()}
        self._camera: StockCamera | None = None
        self._from_m: float | None = None
        self._ended = False

    def picture(self) -> RGB:
        """Return the stock picture, shape (150, 600, 3), uint8."""
        self._camera = self._camera or StockCamera(self._world)
        return self._camera.draw()

    def truth(self) -> Mapping[str, Scalar]:
        """Return the truth with the columns of the banks."""
        return read_truth(self._world)

    def step(self, action: str) -> StepResult:
        """Drive on for a second; ``distance_m`` counts from the end of the first one.

        Raises ValueError for an unknown action, and after the end.
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
        """Return all positions, headings and speeds as 64-bit floats, rounded on request."""
        rows = [[*vehicle.position, vehicle.heading, vehicle.speed] for vehicle in self._world.road.vehicles]
        numbers = np.array(rows, dtype=np.float64)
        return (numbers if decimals is None else numbers.round(decimals) + 0.0).tobytes()

    def close(self) -> None:
        """Close the world."""
        self._world.close()
