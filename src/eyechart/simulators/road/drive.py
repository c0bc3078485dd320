"""A vehicle's drive: a layout, a decision a second, until the goal, a crash or the time limit."""

from collections.abc import Callable, Collection, Mapping
from typing import Generic, TypeVar

from eyechart.frames import RGB, Scalar
from eyechart.simulators import StepResult
from eyechart.simulators.road.truth import read_truth, unseen_sides
from eyechart.simulators.road.world import DECISION_S, AnyWorld, draw

CRASH_REWARD = -10.0

W = TypeVar("W", bound=AnyWorld)


class RoadDrive(Generic[W]):
    """A world under way.

    The reward of a decision is the distance along the road divided by the distance at ``top_mps``,
    and -10 for a crash.
    """

    def __init__(self, world: W, decide: Callable[[W, str], W], *, actions: Collection[str], top_mps: float) -> None:
        self._world = world
        self._decide = decide
        self._actions = actions
        self._top_mps = top_mps

    @property
    def world(self) -> W:
        """Return the present world."""
        return self._world

    def picture(self) -> RGB:
        """Return the forward camera's picture, shape (height, width, 3), uint8."""
        return draw(self._world)

    def truth(self) -> Mapping[str, Scalar]:
        """Return the truth with the columns of the banks."""
        return read_truth(self._world)

    def unseen_sides(self) -> frozenset[str]:
        """Return the sides, left or right, blocked only by obstacles outside the picture."""
        return unseen_sides(self._world)

    def step(self, action: str) -> StepResult:
        """Drive on for a second; raises ValueError for an unknown action, and after the end."""
        if self._world.ended is not None:
            raise ValueError("this drive is over")
        if action not in self._actions:
            raise ValueError(f"'{action}' is none of {', '.join(self._actions)}")
        before = self._world
        self._world = after = self._decide(before, action)
        made = (after.state.x - before.state.x) / (self._top_mps * DECISION_S)
        return StepResult(
            reward=CRASH_REWARD if after.crashed else made,
            speed_mps=after.state.speed,
            distance_m=after.state.x,
            crashed=after.crashed,
            ended=after.ended,
        )

    def state(self, decimals: int | None = None) -> bytes:
        """Return the vehicle's state and the obstacles as 64-bit floats, rounded on request."""
        return self._world.as_bytes(decimals)

    def close(self) -> None:
        """Do nothing: the drive holds no resources."""
