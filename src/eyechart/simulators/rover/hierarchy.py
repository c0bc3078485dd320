"""The rover under a model-predictive controller: a decision is an intent, and every 0.2 s the controller plans for it.

Source: paper, section Hierarchical VLM-MPC Diagnostic. The intent comes once a second and means a target speed and a
track, as it does for the plain rover; in between, the controller drives. What is told to the controller of the
obstacles, and whether the intent's speed counts, makes the three arms.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from eyechart.frames import Scalar
from eyechart.mpc import STEP_S, Bicycle, Mpc, Plan, Road, State, Target
from eyechart.simulators import Moved
from eyechart.simulators.banks import check_seed, versions_of
from eyechart.simulators.road import ROAD_HALF_M, TRACKS_M, Layout, RoadDrive, free_tracks, make_layout
from eyechart.simulators.rover import Rover, bicycle
from eyechart.simulators.rover.tracking import INNER_S, INTENTS, Intent
from eyechart.simulators.rover.world import World, decide, start

MARGIN_M = 0.25
"""How far the controller keeps the rover's disc from an obstacle and from the road's edge."""

CRUISE_MPS = INTENTS["STRAIGHT"].speed

CAR = Bicycle(
    wheelbase_m=bicycle.WHEELBASE_M,
    accel_mps2=bicycle.MOST_ACCELERATION_MPS2,
    brake_mps2=bicycle.MOST_BRAKING_MPS2,
    steer_rad=bicycle.MOST_STEERING,
    speed_mps=5.0,
    aside_mps2=4.0,
)
"""What the controller knows of the plant: its own limits, and a top speed just above the fastest intent's."""

ROAD = Road(half_width_m=ROAD_HALF_M - bicycle.RADIUS_M - MARGIN_M)


@dataclass(frozen=True, slots=True)
class Arm:
    """What the controller is told: the obstacles' centres or not, and of the intent all or the track alone."""

    told_obstacles: bool
    lateral_only: bool = False


class Law:
    """The controller as the plant's law: it plans every 0.2 s, holds the command in between, and keeps its failures."""

    def __init__(self, arm: Arm, layout: Layout) -> None:
        self._arm, self._mpc = arm, Mpc(CAR, ROAD)
        self._discs = _discs(layout) if arm.told_obstacles else np.empty((0, 3))
        self._calls = 0
        self.plans: list[Plan] = []

    def __call__(self, state: bicycle.State, intent: Intent, track: int) -> tuple[float, float]:
        """Return acceleration (m/s²) and steering angle (rad)."""
        if self._calls % round(STEP_S / INNER_S) == 0:
            now = State(state.x, state.y, state.yaw, state.speed)
            speed = CRUISE_MPS if self._arm.lateral_only else intent.speed
            self.plans.append(self._mpc.plan(now, Target(speed, TRACKS_M[track]), self._discs))
        self._calls += 1
        return self.plans[-1].accel_mps2, self.plans[-1].steer_rad


class MpcDrive(RoadDrive[World]):
    """A rover's world in which the controller drives and decisions are intents; ``plans`` are the last decision's."""

    def __init__(self, scenario: str, seed: int, arm: Arm, *, mirrored: bool = False) -> None:
        check_seed(seed)
        layout = make_layout(scenario, seed)
        world = start(layout.mirrored() if mirrored else layout)
        super().__init__(world, self._plan, actions=INTENTS, top_mps=CRUISE_MPS)
        self._arm = arm
        self.plans: tuple[Plan, ...] = ()

    def truth(self) -> Mapping[str, Scalar]:
        """Return the rover's columns, and how far each track is free, ``free_left_m`` to ``free_right_m``."""
        left, middle, right = reversed(free_tracks(self.world))
        return {**super().truth(), "free_left_m": left, "free_middle_m": middle, "free_right_m": right}

    def step(self, action: str) -> Moved:
        """Drive on for a second; ``facts`` of the move say how many plans the solver failed at, and its last code."""
        moved = super().step(action)
        failed = sum(not plan.solved for plan in self.plans)
        told = {"plans": len(self.plans), "solver_failures": failed, "solver_flag": self.plans[-1].flag}
        return replace(moved, facts=told)

    def _plan(self, world: World, action: str) -> World:
        law = Law(self._arm, world.layout)
        after = decide(world, action, law)
        self.plans = tuple(law.plans)
        return after


class RoverMpc:
    """The rover under the controller, which is told where the obstacles are: the paper's primary ablation."""

    name = "rover-mpc"
    no_banks = "its pictures are those of 'rover', whose banks serve for both"
    scenarios = Rover.scenarios
    picture = Rover.picture
    mirror_axis = Rover.mirror_axis
    action_space = Rover.action_space
    fail_safe = "STOP"
    arm = Arm(told_obstacles=True)

    def drive(self, scenario: str, seed: int, *, mirrored: bool = False) -> MpcDrive:
        """Open a world at its beginning, or its mirror image; raises SpecError for an unknown scenario or seed."""
        return MpcDrive(scenario, seed, self.arm, mirrored=mirrored)

    def versions(self) -> dict[str, str]:
        """Return the versions of numpy and of the solver."""
        return versions_of(("numpy", "daqp"))


class RoverMpcUnaware(RoverMpc):
    """The rover under the controller, which knows nothing of the obstacles: only the intent can keep it off them."""

    name = "rover-mpc-unaware"
    arm = Arm(told_obstacles=False)


class RoverMpcLateral(RoverMpc):
    """As ``rover-mpc-unaware``, and of the intent only the track counts: the speed is that of the cruise."""

    name = "rover-mpc-lateral"
    arm = Arm(told_obstacles=False, lateral_only=True)


def _discs(layout: Layout) -> npt.NDArray[np.float64]:
    """Return what the rover's middle must keep off, shape (n, 3): x, y, radius."""
    keep = bicycle.RADIUS_M + MARGIN_M
    return np.array([(one.x, one.y, one.radius + keep) for one in layout.obstacles]).reshape(-1, 3)
