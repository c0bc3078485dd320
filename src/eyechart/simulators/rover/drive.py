"""A rover's drive: a layout, a decision a second, until the goal, a crash or the end of the time."""

from collections.abc import Mapping

from eyechart.frames import RGB, Scalar
from eyechart.simulators import Moved
from eyechart.simulators.banks import check_seed
from eyechart.simulators.rover.layout import make_layout
from eyechart.simulators.rover.picture import draw
from eyechart.simulators.rover.tracking import INTENTS
from eyechart.simulators.rover.truth import read_truth
from eyechart.simulators.rover.world import DECISION_S, World, decide, start

CRASH_REWARD = -10.0
_TOP_MPS = INTENTS["STRAIGHT"].speed


class RoverDrive:
    """One of the rover's worlds under way; ``mirrored`` exchanges left and right in all of it.

    The reward of a decision is the way made along the road over the way at full speed, and -10 for a crash. Raises
    SpecError for an unknown scenario or a seed out of range.
    """

    def __init__(self, scenario: str, seed: int, *, mirrored: bool = False) -> None:
        check_seed(seed)
        layout = make_layout(scenario, seed)
        self._world = start(layout.mirrored() if mirrored else layout)

    @property
    def world(self) -> World:
        """Return the world as it stands."""
        return self._world

    def picture(self) -> RGB:
        """Return what the forward camera shows, shape (240, 320, 3), uint8."""
        return draw(self._world)

    def truth(self) -> Mapping[str, Scalar]:
        """Return the columns of the banks."""
        return read_truth(self._world)

    def step(self, action: str) -> Moved:
        """Drive on for a second; raises ValueError for an action that is none, and after the end."""
        if self._world.ended is not None:
            raise ValueError("this drive is over")
        if action not in INTENTS:
            raise ValueError(f"'{action}' is none of {', '.join(INTENTS)}")
        before = self._world
        self._world = after = decide(before, action)
        made = (after.state.x - before.state.x) / (_TOP_MPS * DECISION_S)
        return Moved(
            reward=CRASH_REWARD if after.crashed else made,
            speed_mps=after.state.speed,
            distance_m=after.state.x,
            crashed=after.crashed,
            ended=after.ended,
        )

    def state(self) -> bytes:
        """Return the rover's state and the obstacles as raw 64-bit floats."""
        return self._world.as_bytes()

    def close(self) -> None:
        """Hold nothing, so let go of nothing."""
