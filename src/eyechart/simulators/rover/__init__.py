"""A rover with a forward camera on a road with obstacles: frame banks with ground truth, and drives."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from eyechart.cameras import ROVER
from eyechart.frames import FrameBank, MirrorAxis
from eyechart.simulators.banks import Asked, versions_of
from eyechart.simulators.road import FAMILIES, Layout, Vehicle, build_bank
from eyechart.simulators.rover.bicycle import State
from eyechart.simulators.rover.drive import RoverDrive
from eyechart.simulators.rover.tracking import INTENTS
from eyechart.simulators.rover.world import World
from eyechart.spaces.discrete import DRIVING, Discrete

PICTURE = (
    f"view of a forward camera on a rover, drawn by column ray casting ({ROVER.width} × {ROVER.height} pixels); its "
    "own hood at the lower edge, obstacles as coloured cylinders"
)


def _place(layout: Layout, pose: tuple[float, float, float], speed: float, track: int) -> World:
    return World(layout, State(*pose, speed), track)


STAGED = Vehicle("rover", _place, most_yaw=0.04, most_mps=INTENTS["STRAIGHT"].speed)
"""The rover as its banks are staged."""


class Rover:
    """A kinematic bicycle on a road of 100 m among five families of obstacles, seen by a camera of our own.

    The forward-camera rover of the paper (section Hierarchical VLM-MPC diagnostic), here driven by discrete intents at
    1 Hz with a tracking law below.
    """

    name = "rover"
    presets: Mapping[str, str] = {
        "balanced": "Staged moments among five families of obstacles: every gap in every scenario, in no order, with "
        "LEFT and RIGHT demanded alike, no crash, and counterfactual pictures for every frame.",
    }
    scenarios: Mapping[str, str] = FAMILIES
    picture = PICTURE
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

    def drive(self, scenario: str, seed: int, *, mirrored: bool = False) -> RoverDrive:
        """Open a world at its beginning, or its mirror image; raises SpecError for an unknown scenario or seed."""
        return RoverDrive(scenario, seed, mirrored=mirrored)

    def versions(self) -> dict[str, str]:
        """Return the version of numpy; the rest of this world is eyechart's own."""
        return versions_of(("numpy",))
