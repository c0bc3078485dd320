"""The rover under a model-predictive controller: a decision is an intent, and every 0.2 s the controller plans for it.

Source: paper, section Hierarchical VLM-MPC Diagnostic. The intent comes once a second and means a
target speed and a track, as it does for the plain rover; in between, the controller drives. What is
told to the controller of the obstacles, and whether the intent's speed counts, makes the three
arms.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from eyechart.frames import Scalar
from eyechart.mpc import STEP_S, Bicycle, Mpc, Plan, Road, State, Target
from eyechart.simulators import Sketch, StepResult
from eyechart.simulators.banks import versions_of
from eyechart.simulators.road import (
    ROAD_HALF_M,
    TRACKS_M,
    Layout,
    RoadDrive,
    eye_of,
    free_tracks,
    make_layout,
)
from eyechart.simulators.rover import Rover
from eyechart.simulators.rover.world import (
    INNER_S,
    INTENTS,
    MOST_ACCELERATION_MPS2,
    MOST_BRAKING_MPS2,
    MOST_STEERING,
    RADIUS_M,
    WHEELBASE_M,
    Intent,
    RoverState,
    RoverWorld,
    decide,
    start,
)

MARGIN_M = 0.25
"""How far the controller keeps the rover's disc from an obstacle and from the road's edge."""

CRUISE_MPS = INTENTS["STRAIGHT"].speed

CAR = Bicycle(
    wheelbase_m=WHEELBASE_M,
    accel_mps2=MOST_ACCELERATION_MPS2,
    brake_mps2=MOST_BRAKING_MPS2,
    steer_rad=MOST_STEERING,
    speed_mps=5.0,
    aside_mps2=4.0,
)
"""What the controller knows of the plant: its own limits, and a top speed just above the fastest
intent's."""

ROAD = Road(half_width_m=ROAD_HALF_M - RADIUS_M - MARGIN_M)


@dataclass(frozen=True, slots=True)
class Arm:
    """What the controller is told: the obstacles' centres or not, and of the intent all or the track alone."""

    told_obstacles: bool
    lateral_only: bool = False


class Law:
    """The controller as the plant's law: it plans every 0.2 s and holds the command in between.

    ``plans`` are what it planned, ``places`` where it was asked for a command, x and y.
    """

    def __init__(self, arm: Arm, layout: Layout, *, halts: bool) -> None:
        self._arm, self._halts = arm, halts
        self._mpc = Mpc(CAR, ROAD)
        self._discs = _discs(layout) if arm.told_obstacles else np.empty((0, 3))
        self._calls = 0
        self.plans: list[Plan] = []
        self.places: list[tuple[float, float]] = []

    def __call__(self, state: RoverState, intent: Intent, track: int) -> tuple[float, float]:
        """Return acceleration (m/s²) and steering angle (rad)."""
        if self._calls % round(STEP_S / INNER_S) == 0:
            now = State(state.x, state.y, state.yaw, state.speed)
            self.plans.append(self._mpc.plan(now, _target(self._arm, intent, track, halts=self._halts), self._discs))
        self._calls += 1
        self.places.append((state.x, state.y))
        return self.plans[-1].accel_mps2, self.plans[-1].steer_rad


class MpcDrive(RoadDrive[RoverWorld]):
    """A rover's world in which the controller drives and decisions are intents.

    ``plans`` are the last decision's, and ``driven`` its way: x and y in metres, every 0.05 s and
    at its end.
    """

    def __init__(self, scenario: str, seed: int, arm: Arm, *, mirrored: bool = False) -> None:
        world = start(make_layout(scenario, seed, mirrored=mirrored))
        super().__init__(world, self._plan, actions=INTENTS, top_mps=CRUISE_MPS)
        self._arm = arm
        self._before, self._last, self._halts = world, "", False
        self.driven: tuple[tuple[float, float], ...] = ()
        self.plans: tuple[Plan, ...] = ()

    def truth(self) -> Mapping[str, Scalar]:
        """Return the rover's columns, and how far each track is free, ``free_left_m`` to ``free_right_m``."""
        left, middle, right = reversed(free_tracks(self.world))
        return {**super().truth(), "free_left_m": left, "free_middle_m": middle, "free_right_m": right}

    def step(self, action: str) -> StepResult:
        """Drive on for a second.

        ``facts`` of the move say how many plans the solver failed at, its last code, and where
        across the road the move ended, in m and rad.
        """
        self._before, self._last, self._halts = self.world, action, False
        return self._told(super().step(action))

    def halt(self) -> StepResult:
        """Drive on for a second, and stop, in every arm; a STOP that was decided leaves the lateral arm its cruise."""
        self._before, self._last, self._halts = self.world, "STOP", True
        return self._told(super().step("STOP"))

    def _told(self, moved: StepResult) -> StepResult:
        failed = sum(not plan.solved for plan in self.plans)
        told = {"plans": len(self.plans), "solver_failures": failed, "solver_flag": self.plans[-1].flag}
        return replace(moved, facts={**told, "y_m": self.world.state.y, "yaw": self.world.state.yaw})

    def sketch(self) -> Sketch:
        """Return the first plan of the last decision, its target and the way that was driven under it.

        Over the picture before the decision, which the first plan was made at. Raises ValueError
        before the first.
        """
        if not self.plans:
            raise ValueError("nothing was planned yet: the drive has not taken a step")
        view, eye, track = self._before.view, eye_of(self._before), self.world.track
        target = _target(self._arm, INTENTS[self._last], track, halts=self._halts)
        along = eye.x + np.arange(0.0, view.view_ahead_m + 0.5, 0.5)
        lines = (self.plans[0].path, np.column_stack([along, np.full_like(along, target.offset_m)]), self.driven)
        plan, aim, driven = (view.project(eye, line) for line in lines)
        name = ("right", "middle", "left")[track]
        return Sketch(plan, aim, driven, f"{target.speed_mps:g} m/s on the {name} track")

    def _plan(self, world: RoverWorld, action: str) -> RoverWorld:
        law = Law(self._arm, world.layout, halts=self._halts)
        after = decide(world, action, law)
        self.plans = tuple(law.plans)
        self.driven = (*law.places, (after.state.x, after.state.y))
        return after


class RoverMpc:
    """The rover under the controller, which is told where the obstacles are: the paper's primary ablation."""

    declared = replace(
        Rover.declared,
        name="rover-mpc",
        presets={},
        no_banks="its pictures are those of 'rover', whose banks serve for both",
        halts_with="STOP",
    )
    arm = Arm(told_obstacles=True)

    def drive(self, scenario: str, seed: int, *, mirrored: bool = False) -> MpcDrive:
        """Open a world at its beginning, or its mirror image; raises SpecError for an unknown scenario or seed."""
        return MpcDrive(scenario, seed, self.arm, mirrored=mirrored)

    def versions(self) -> dict[str, str]:
        """Return the versions of numpy and of the solver."""
        return versions_of(("numpy", "daqp"))


class RoverMpcUnaware(RoverMpc):
    """The rover under the controller, which knows nothing of the obstacles: only the intent can keep it off them."""

    declared = replace(RoverMpc.declared, name="rover-mpc-unaware")
    arm = Arm(told_obstacles=False)


class RoverMpcLateral(RoverMpc):
    """As ``rover-mpc-unaware``, and of the intent only the track counts: the speed is that of the cruise."""

    declared = replace(RoverMpc.declared, name="rover-mpc-lateral")
    arm = Arm(told_obstacles=False, lateral_only=True)


def _target(arm: Arm, intent: Intent, track: int, *, halts: bool) -> Target:
    """Return what an intent asks of the controller, as far as it counts in an arm; who halts counts in every arm."""
    return Target(CRUISE_MPS if arm.lateral_only and not halts else intent.speed, TRACKS_M[track])


def _discs(layout: Layout) -> npt.NDArray[np.float64]:
    """Return what the rover's middle must keep off, shape (n, 3): x, y, radius."""
    keep = RADIUS_M + MARGIN_M
    return np.array([(one.x, one.y, one.radius + keep) for one in layout.obstacles]).reshape(-1, 3)
