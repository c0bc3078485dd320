"""Drives are what the published bank was made of: the driver idles, and drives on after a crash.

With 3 seeds and 12 steps this yields 76 of 144 frames nearer than 18 m (published: 81) and 61 at 5.0 m, which
is contact (published: 57); with 24 steps 219 of 288 (published: about 220), 198 of them after a crash.
"""

from collections.abc import Iterator, Mapping

import numpy as np
from highway_env.vehicle.kinematics import Vehicle

from eyechart.frames import LEAD_GAP
from eyechart.seeds import key_seed
from eyechart.simulators.banks import Moment, Preset
from eyechart.simulators.highway.moment import record
from eyechart.simulators.highway.speedups import speedups
from eyechart.simulators.highway.world import SIMULATION_HZ, Camera, Setting, World, simulate

BLOCKER_AHEAD_M = 40.0
BLOCKED = "blocked"

DRIVES: Mapping[str, Setting] = {
    "light": Setting("highway-v0", {"lanes_count": 3, "vehicles_count": 15}),
    "dense": Setting("highway-v0", {"lanes_count": 3, "vehicles_count": 20, "vehicles_density": 1.2}),
    "merge": Setting("merge-v0", {}),
    BLOCKED: Setting("highway-v0", {"lanes_count": 3, "vehicles_count": 20, "ego_spacing": 1}),
}
"""The scenarios of preset ``paper``; in ``blocked`` a vehicle stands 40 m ahead in the own lane."""


def open_drive(scenario: str, seed: int) -> World:
    """Return the world in which a drive begins."""
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
        camera = camera or Camera(world)
        yield record(world, camera, rng)


def drive_worlds(scenario: str, seed: int, steps: int) -> Iterator[World]:
    """Yield the world once a second of driving; it is one world, which drives on when the next is asked for.

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
