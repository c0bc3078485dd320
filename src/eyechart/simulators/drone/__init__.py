"""A quadrotor with a gimbal camera among pillars, in our physics or gym-pybullet-drones'."""

from dataclasses import replace

from eyechart.cameras import DRONE
from eyechart.simulators import Declaration
from eyechart.simulators.banks import versions_of
from eyechart.simulators.drone.aviary import PybulletDrive, require
from eyechart.simulators.drone.world import INTENTS, RAISED, DroneWorld, Flight, Velocity, decide, start
from eyechart.simulators.road import FAMILIES, Layout, RoadBanks, RoadDrive, Vehicle, make_layout
from eyechart.spaces.discrete import DRIVING


def _place(layout: Layout, pose: tuple[float, float, float], speed: float, track: int) -> DroneWorld:
    x, y, _ = pose
    return DroneWorld(layout.raised(RAISED), Flight(x, y, Velocity(speed)), track)


class Drone(RoadBanks):
    """A quadrotor with a forward camera on a road of 100 m, among five families of pillars.

    It needs no extra. Its limits are the Crazyflie's (``world.py`` names them with their source).
    The paper's quadrotor (section Experimental Setup) flies in gym-pybullet-drones, as
    ``drone-pybullet`` does.
    """

    declared = Declaration(
        name="drone",
        picture="view of a forward camera on a quadrotor, level on a gimbal, drawn by column ray casting "
        f"({DRONE.width} × {DRONE.height} pixels); its own frame at the lower edge, obstacles as coloured pillars",
        mirror_axis="horizontal",
        action_space=DRIVING,
        camera="drone",
        scenarios=FAMILIES,
        presets={
            "balanced": "Staged moments among five families of pillars: every gap in every scenario, in no order, "
            "with LEFT and RIGHT demanded equally, no crash, and counterfactual pictures for every frame.",
        },
        has_goal=True,
    )
    vehicle = Vehicle("drone", _place, most_yaw=0.0, most_mps=INTENTS["STRAIGHT"].speed)

    def drive(self, scenario: str, seed: int, *, mirrored: bool = False) -> RoadDrive[DroneWorld]:
        """Open a world, or its mirror image; raises SpecError for an unknown scenario or seed."""
        world = start(make_layout(scenario, seed, simulator="drone", mirrored=mirrored))
        return RoadDrive(world, decide, actions=INTENTS, top_mps=INTENTS["STRAIGHT"].speed)


class PybulletDrone:
    """gym-pybullet-drones' Crazyflie in the drone's scenarios, for drives only.

    Source: J. Panerati et al., "Learning to fly: a gym environment with PyBullet physics", IROS
    2021.
    """

    declared = replace(
        Drone.declared,
        name="drone-pybullet",
        picture="view of a forward camera on a quadrotor, level on a gimbal, drawn by PyBullet "
        f"({DRONE.width} × {DRONE.height} pixels); obstacles as coloured pillars",
        presets={},
        no_banks="those of the same scenarios come from 'drone'",
    )

    def drive(self, scenario: str, seed: int, *, mirrored: bool = False) -> PybulletDrive:
        """Open a world at its start, or its mirror image.

        Raises SpecError for an unknown scenario or seed, and if gym-pybullet-drones is not
        installed.
        """
        return PybulletDrive(scenario, seed, mirrored=mirrored)

    def versions(self) -> dict[str, str]:
        """Return the versions of the libraries; raises SpecError if they are not installed."""
        require()
        return versions_of(("gym-pybullet-drones", "pybullet", "gymnasium", "numpy"))
