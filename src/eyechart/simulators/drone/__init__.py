"""A quadrotor with a gimbal camera among pillars on a road: our own, and gym-pybullet-drones' in the same scenario."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from eyechart.cameras import DRONE
from eyechart.frames import FrameBank, MirrorAxis
from eyechart.simulators.banks import Asked, versions_of
from eyechart.simulators.drone.aviary import require
from eyechart.simulators.drone.drive import DroneDrive, PybulletDrive
from eyechart.simulators.drone.flight import INTENTS, Velocity
from eyechart.simulators.drone.world import RAISED, Flight, World
from eyechart.simulators.road import FAMILIES, Layout, Vehicle, build_bank
from eyechart.spaces.discrete import DRIVING, Discrete


def _place(layout: Layout, pose: tuple[float, float, float], speed: float, track: int) -> World:
    x, y, _ = pose
    return World(layout.raised(RAISED), Flight(x, y, Velocity(speed)), track)


STAGED = Vehicle("drone", _place, most_yaw=0.0, most_mps=INTENTS["STRAIGHT"].speed)
"""The drone as its banks are staged."""


class Drone:
    """A quadrotor on a road of 100 m among five families of pillars, seen by a camera of our own; needs no extra.

    Its limits are the Crazyflie's (``flight.py`` names them with their source). The paper's quadrotor (section
    Experimental Setup) flies in gym-pybullet-drones, as ``drone-pybullet`` does.
    """

    name = "drone"
    presets: Mapping[str, str] = {
        "balanced": "Staged moments among five families of pillars: every gap in every scenario, in no order, with "
        "LEFT and RIGHT demanded alike, no crash, and counterfactual pictures for every frame.",
    }
    scenarios: Mapping[str, str] = FAMILIES
    picture = (
        f"view of a forward camera on a quadrotor, level on a gimbal, drawn by column ray casting ({DRONE.width} × "
        f"{DRONE.height} pixels); its own frame at the lower edge, obstacles as coloured pillars"
    )
    mirror_axis: MirrorAxis = "horizontal"
    action_space: Discrete = DRIVING

    def build(
        self,
        out: Path,
        *,
        preset: str = "balanced",
        seeds: Sequence[int] = (0, 1, 2),
        steps: int = 12,
        progress: Callable[[int, int], None] | None = None,
    ) -> FrameBank:
        """Write a bank of five scenarios × ``seeds`` × ``steps`` frames into ``out``.

        ``progress`` gets the number of frames written and their total. Raises SpecError for an unknown preset,
        seeds that are negative, doubled or missing, and too few steps; BankError where ``out`` is taken.
        """
        asked = Asked(self.name, preset, tuple(int(seed) for seed in seeds), steps)
        asked.check(self.presets)
        return build_bank(out, STAGED, asked, picture=self.picture, progress=progress)

    def drive(self, scenario: str, seed: int, *, mirrored: bool = False) -> DroneDrive:
        """Open a world at its beginning, or its mirror image; raises SpecError for an unknown scenario or seed."""
        return DroneDrive(scenario, seed, mirrored=mirrored)

    def versions(self) -> dict[str, str]:
        """Return the version of numpy; the rest of this world is eyechart's own."""
        return versions_of(("numpy",))


class PybulletDrone:
    """gym-pybullet-drones' Crazyflie in the drone's scenarios; it can be driven, and makes no banks.

    Source: J. Panerati et al., "Learning to fly: a gym environment with PyBullet physics", IROS 2021.
    """

    name = "drone-pybullet"
    no_banks = "those of the same scenarios come from 'drone'"
    scenarios: Mapping[str, str] = FAMILIES
    picture = (
        f"view of a forward camera on a quadrotor, level on a gimbal, drawn by PyBullet ({DRONE.width} × "
        f"{DRONE.height} pixels); obstacles as coloured pillars"
    )
    mirror_axis: MirrorAxis = "horizontal"
    action_space: Discrete = DRIVING

    def drive(self, scenario: str, seed: int, *, mirrored: bool = False) -> PybulletDrive:
        """Open a world at its beginning, or its mirror image.

        Raises SpecError for an unknown scenario or seed, and where gym-pybullet-drones is not installed.
        """
        return PybulletDrive(scenario, seed, mirrored=mirrored)

    def versions(self) -> dict[str, str]:
        """Return the versions of what makes this world; raises SpecError where it is not installed."""
        require()
        return versions_of(("gym-pybullet-drones", "pybullet", "gymnasium", "numpy"))
