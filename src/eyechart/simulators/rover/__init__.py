"""A rover with a forward camera among obstacles: frame banks with ground truth, and drives."""

from eyechart.cameras import ROVER
from eyechart.simulators import Declaration
from eyechart.simulators.road import FAMILIES, Layout, RoadBanks, RoadDrive, Vehicle, make_layout
from eyechart.simulators.rover.world import INTENTS, RoverState, RoverWorld, decide, start
from eyechart.spaces.discrete import DRIVING


def _place(layout: Layout, pose: tuple[float, float, float], speed: float, track: int) -> RoverWorld:
    return RoverWorld(layout, RoverState(*pose, speed), track)


class Rover(RoadBanks):
    """A kinematic bicycle with a forward camera on a road of 100 m, in five obstacle families.

    It is the forward-camera rover of the paper (section Hierarchical VLM-MPC diagnostic), driven
    here by discrete intents at 1 Hz with a tracking law below.
    """

    declared = Declaration(
        name="rover",
        picture="view of a forward camera on a rover, drawn by column ray casting "
        f"({ROVER.width} × {ROVER.height} pixels); its own hood at the lower edge, obstacles as coloured cylinders",
        mirror_axis="horizontal",
        action_space=DRIVING,
        camera="rover",
        scenarios=FAMILIES,
        presets={
            "balanced": "Staged moments among five families of obstacles: every gap in every scenario, in no order, "
            "with LEFT and RIGHT demanded equally, no crash, and counterfactual pictures for every frame.",
        },
        has_goal=True,
    )
    vehicle = Vehicle("rover", _place, most_yaw=0.04, most_mps=INTENTS["STRAIGHT"].speed)

    def drive(self, scenario: str, seed: int, *, mirrored: bool = False) -> RoadDrive[RoverWorld]:
        """Open a world, or its mirror image; raises SpecError for an unknown scenario or seed."""
        world = start(make_layout(scenario, seed, mirrored=mirrored))
        return RoadDrive(world, decide, actions=INTENTS, top_mps=INTENTS["STRAIGHT"].speed)
