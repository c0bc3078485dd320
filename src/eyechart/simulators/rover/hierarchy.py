"""The rover under a model-predictive controller, which plans for each intent every 0.2 s.

Source: paper, section Hierarchical VLM-MPC Diagnostic. The intent comes once a second and sets a
target speed and a track, as for the plain rover. In between, the controller drives. The three arms
differ in two points: whether the controller knows the obstacles, and whether the intent's speed
counts.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from eyechart.frames import Scalar
from eyechart.mpc import STEP_S, Bicycle, DrivableWidth, Mpc, MpcPlan, State, Target
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
    RoverIntent,
    RoverState,
    RoverWorld,
    decide,
    start,
)

MARGIN_M = 0.25
"""The distance that the controller keeps from obstacles and from the road's edge."""

CRUISE_MPS = INTENTS["STRAIGHT"].speed

CAR = Bicycle(
    wheelbase_m=WHEELBASE_M,
    accel_mps2=MOST_ACCELERATION_MPS2,
    brake_mps2=MOST_BRAKING_MPS2,
    steer_rad=MOST_STEERING,
    speed_mps=5.0,
    aside_mps2=4.0,
)
"""The controller's model of the plant: its limits, and a top speed just above the fastest
intent's."""

ROAD = DrivableWidth(half_width_m=ROAD_HALF_M - RADIUS_M - MARGIN_M)


@dataclass(frozen=True, slots=True)
class Arm:
    """The controller's input: with or without the obstacles, and the whole intent or its track."""

    told_obstacles: bool
    lateral_only: bool = False


class Law:
    """The controller as the plant's law: it plans every 0.2 s and holds the command in between.

    ``plans`` are its plans, and ``places`` the places, x and y, of each command.
    """

    def __init__(self, arm: Arm, layout: Layout, *, halts: bool) -> None:
        self._arm, self._halts = arm, halts
        self._mpc = Mpc(CAR, ROAD)
        self._discs = _discs(layout) if arm.told_obstacles else np.empty((0, 3))
        self._calls = 0
        self.plans: list[MpcPlan] = []
        self.places: list[tuple[float, float]] = []

    def __call__(self, state: RoverState, intent: RoverIntent, track: int) -> tuple[float, float]:
        """Return acceleration (m/s²) and steering angle (rad)."""
        if self._calls % round(STEP_S / INNER_S) == 0:
            now = State(state.x, state.y, state.yaw, state.speed)
            self.plans.append(self._mpc.plan(now, _target(self._arm, intent, track, halts=self._halts), self._discs))
        self._calls += 1
        self.places.append((state.x, state.y))
        return self.plans[-1].accel_mps2, self.plans[-1].steer_rad


class MpcDrive(RoadDrive[RoverWorld]):
    """A rover's world in which the controller drives and decisions are intents.

    ``plans`` are the last decision's. ``driven`` is its path: x and y in metres, every 0.05 s and
    at its end.
    """

    def __init__(self, scenario: str, seed: int, arm: Arm, *, mirrored: bool = False) -> None:
        world = start(make_layout(scenario, seed, mirrored=mirrored))
        super().__init__(world, self._plan, actions=INTENTS, top_mps=CRUISE_MPS)
        self._arm = arm
        self._before, self._last, self._halts = world, "", False
        self.driven: tuple[tuple[float, float], ...] = ()
        self.plans: tuple[MpcPlan, ...] = ()

    def truth(self) -> Mapping[str, Scalar]:
        """Return the rover's columns, and how far each track is free, ``free_left_m`` and so on."""
        left, middle, right = reversed(free_tracks(self.world))
        return {**super().truth(), "free_left_m": left, "free_middle_m": middle, "free_right_m": right}

    def step(self, action: str) -> StepResult:
        """Drive on for a second.

        ``facts`` hold the number of plans at which the solver failed, its last code, and the final
        position across the road and yaw, in m and rad.
        """
        self._before, self._last, self._halts = self.world, action, False
        return self._with_facts(super().step(action))

    def halt(self) -> StepResult:
        """Stop for a second in every arm; a decided STOP keeps the lateral arm's cruise speed."""
        self._before, self._last, self._halts = self.world, "STOP", True
        return self._with_facts(super().step("STOP"))

    def _with_facts(self, moved: StepResult) -> StepResult:
        failed = sum(not plan.solved for plan in self.plans)
        facts = {"plans": len(self.plans), "solver_failures": failed, "solver_flag": self.plans[-1].flag}
        return replace(moved, facts={**facts, "y_m": self.world.state.y, "yaw": self.world.state.yaw})

    def sketch(self) -> Sketch:
        """Return the last decision's first plan, its target and the path that was driven.

        The lines lie over the picture before the decision, at which the first plan was made. Raises
        ValueError before the first decision.
        """
        if not self.plans:
            raise ValueError("there is no plan yet: the drive has not taken a step")
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
    """The rover under a controller that knows the obstacles: the paper's primary ablation."""

    declared = replace(
        Rover.declared,
        name="rover-mpc",
        presets={},
        no_banks="its pictures are those of 'rover', whose banks serve for both",
        halts_with="STOP",
    )
    arm = Arm(told_obstacles=True)

    def drive(self, scenario: str, seed: int, *, mirrored: bool = False) -> MpcDrive:
        """Open a world, or its mirror image; raises SpecError for an unknown scenario or seed."""
        return MpcDrive(scenario, seed, self.arm, mirrored=mirrored)

    def versions(self) -> dict[str, str]:
        """Return the versions of numpy and of the solver."""
        return versions_of(("numpy", "daqp"))


class RoverMpcUnaware(RoverMpc):
    """The rover under a controller without the obstacles: only the intent can avoid them."""

    declared = replace(RoverMpc.declared, name="rover-mpc-unaware")
    arm = Arm(told_obstacles=False)


class RoverMpcLateral(RoverMpc):
    """As ``rover-mpc-unaware``, but only the intent's track counts; the speed is the cruise's."""

    declared = replace(RoverMpc.declared, name="rover-mpc-lateral")
    arm = Arm(told_obstacles=False, lateral_only=True)


def _target(arm: Arm, intent: RoverIntent, track: int, *, halts: bool) -> Target:
    """Return the controller's target for an intent in an arm; a halt counts in every arm."""
    return Target(CRUISE_MPS if arm.lateral_only and not halts else intent.speed, TRACKS_M[track])


def _discs(layout: Layout) -> npt.NDArray[np.float64]:
    """Return the discs that the rover's middle must avoid, shape (n, 3): x, y, radius."""
    keep = RADIUS_M + MARGIN_M
    return np.array([(obstacle.x, obstacle.y, obstacle.radius + keep) for obstacle in layout.obstacles]).reshape(-1, 3)
