"""A vehicle's drive: a layout, a decision a second, until the goal, a crash or the end of the time."""

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

    The reward of a decision is the way made along the road over the way at ``top_mps``, and -10 for
    a crash.
    """

    def __init__(self, world: W, decide: Callable[[W, str], W], *, actions: Collection[str], top_mps: float) -> None:
        self._world = world
        self._decide = decide
        self._actions = actions
        self._top_mps = top_mps

    @property
    def world(self) -> W:
        """Return the world as it stands."""
        return self._world

    def picture(self) -> RGB:
        """Return what the forward camera shows, shape (height, width, 3), uint8."""
        return draw(self._world)

    def truth(self) -> Mapping[str, Scalar]:
        """Return the columns of the banks."""
        return read_truth(self._world)

    def unseen_sides(self) -> frozenset[str]:
        """Return the sides, left and right, that are closed by nothing that the picture shows."""
        return unseen_sides(self._world)

    def step(self, action: str) -> StepResult:
        """Drive on for a second; raises ValueError for an action that is none, and after the end."""
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
        """Return the vehicle's state and the obstacles as raw 64-bit floats, rounded where it is asked for."""
        return self._world.as_bytes(decimals)

    def close(self) -> None:
        """Hold nothing, so let go of nothing."""
