"""A rover's drive: a layout, a decision a second, until the goal, a crash or the end of the time."""

from eyechart.simulators.banks import check_seed
from eyechart.simulators.road import RoadDrive, make_layout
from eyechart.simulators.rover.tracking import INTENTS
from eyechart.simulators.rover.world import World, decide, start


class RoverDrive(RoadDrive[World]):
    """One of the rover's worlds under way; ``mirrored`` exchanges left and right in all of it.

    Raises SpecError for an unknown scenario or a seed out of range.
    """

    def __init__(self, scenario: str, seed: int, *, mirrored: bool = False) -> None:
        check_seed(seed)
        layout = make_layout(scenario, seed)
        world = start(layout.mirrored() if mirrored else layout)
        super().__init__(world, decide, actions=INTENTS, top_mps=INTENTS["STRAIGHT"].speed)
