"""The controller under intents: bounded, mirrored to the bit, and honest about what it could not solve."""

import math
from collections.abc import Iterator
from dataclasses import replace

import daqp
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eyechart.errors import StateError
from eyechart.mpc import STEP_S, Bicycle, Mpc, Plan, Road, State, Target
from eyechart.mpc.controller import Detour

CAR, ROAD = Bicycle(), Road()
STILL = State(0.0, 0.0, 0.0, 0.0)


def somewhere(seed: int, number: int) -> Iterator[tuple[State, Target, npt.NDArray[np.float64]]]:
    """Yield states, targets and obstacles (x, y, radius), also hopeless ones: within a disc, off the road, too fast."""
    rng = np.random.default_rng(seed)
    for _ in range(number):
        state = State(*map(float, (rng.uniform(0, 100), rng.uniform(-6, 6), rng.uniform(-2, 2), rng.uniform(0, 7))))
        count = int(rng.integers(0, 8))
        places = (rng.uniform(-3, 10, count) + state.x_m, rng.uniform(-4, 4, count), rng.uniform(0.8, 1.8, count))
        target = Target(float(rng.choice([0.0, 2.5, 4.5])), float(rng.choice([-2.0, 0.0, 2.0])))
        yield state, target, np.column_stack(places)


def mirrored(state: State) -> State:
    """Return a state as its reflection across the road's middle shows it."""
    return replace(state, y_m=-state.y_m, heading_rad=-state.heading_rad)


def drive(target: Target, discs: npt.ArrayLike = (), seconds: float = 30.0) -> list[State]:
    """Return the states of a drive from a standing start, a fifth of a second apart."""
    mpc, state, states = Mpc(CAR, ROAD), STILL, []
    for _ in range(round(seconds / STEP_S)):
        plan = mpc.plan(state, target, discs)
        state = State(
            state.x_m + STEP_S * state.speed_mps * math.cos(state.heading_rad),
            state.y_m + STEP_S * state.speed_mps * math.sin(state.heading_rad),
            state.heading_rad + STEP_S * state.speed_mps * math.tan(plan.steer_rad) / CAR.wheelbase_m,
            max(0.0, state.speed_mps + STEP_S * plan.accel_mps2),
        )
        states.append(state)
    return states


def test_it_reaches_the_speed_and_the_side_that_are_asked_for() -> None:
    """From a standing start, on a free road, within half a minute."""
    for target in (Target(4.5, 0.0), Target(4.0, 2.0), Target(2.5, -2.0)):
        last = drive(target)[-1]
        assert last.speed_mps == pytest.approx(target.speed_mps, abs=0.05)
        assert last.y_m == pytest.approx(target.offset_m, abs=0.05)


def test_it_goes_round_what_stands_in_the_way() -> None:
    """Also where the target's own offset lies within a disc; a disc's edge is a soft bound, so a little is allowed."""
    discs = np.array([[20.0, 0.3, 1.5], [32.0, -1.0, 1.6], [45.0, 1.8, 1.4]])
    states = drive(Target(4.5, 0.0), discs)
    assert states[-1].x_m > 100.0
    for state in states:
        assert (np.hypot(discs[:, 0] - state.x_m, discs[:, 1] - state.y_m) > discs[:, 2] - 0.1).all()


def test_it_stops_before_a_wall_and_does_not_drive_through() -> None:
    """A normal that turns round inside or behind a disc would let a soft constraint pull the vehicle through."""
    wall = [(30.0, y, 1.8) for y in (-3.2, 0.0, 3.2)]
    states = drive(Target(4.5, 0.0), wall, seconds=60.0)
    assert 26.0 < states[-1].x_m < 28.5
    assert states[-1].speed_mps < 0.05


def test_without_obstacles_it_drives_where_the_intent_says() -> None:
    """The one thing that keeps it off a disc is the disc's constraint."""
    states = drive(Target(4.5, 0.0))
    assert min(math.hypot(state.x_m - 20.0, state.y_m) for state in states) < 0.5


def test_the_mirrored_input_gives_the_mirrored_command_to_the_bit() -> None:
    """As does a repeat, whatever was planned in between."""
    mpc = Mpc(CAR, ROAD)
    for state, target, discs in somewhere(1, 500):
        plan = mpc.plan(state, target, discs)
        other = mpc.plan(mirrored(state), Target(target.speed_mps, -target.offset_m), discs * [1, -1, 1])
        again = mpc.plan(state, target, discs)
        assert (other.accel_mps2, other.steer_rad) == (plan.accel_mps2, -plan.steer_rad)
        assert (again.accel_mps2, again.steer_rad, again.flag) == (plan.accel_mps2, plan.steer_rad, plan.flag)
        assert np.array_equal(again.path, plan.path)
        assert np.array_equal(other.path, plan.path * [1, -1])


@given(st.integers(0, 2**32))
def test_commands_stay_within_the_bounds_of_the_vehicle(seed: int) -> None:
    """In any state, feasible or not: and a plan says whether it was solved."""
    mpc = Mpc(CAR, ROAD)
    for state, target, discs in somewhere(seed, 3):
        plan = mpc.plan(state, target, discs)
        assert -CAR.brake_mps2 - 1e-6 <= plan.accel_mps2 <= CAR.accel_mps2 + 1e-6
        assert abs(plan.steer_rad) <= CAR.most_steer(state.speed_mps) + 1e-6
        assert plan.solved or plan.accel_mps2 == -CAR.brake_mps2


def test_a_solver_that_fails_brakes_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command is the hardest brake, and the solver's own code stands in the plan."""
    monkeypatch.setattr("eyechart.mpc.controller.solve", lambda *_, **__: (np.full(32, 0.1), 0.0, -1, {}))
    plan = Mpc(CAR, ROAD).plan(replace(STILL, speed_mps=2.0), Target(4.5, 0.0))
    assert (plan.solved, plan.flag, plan.accel_mps2, plan.steer_rad) == (False, -1, -CAR.brake_mps2, 0.0)
    assert plan.path[-1, 0] == pytest.approx(0.2 * (2.0 + 1.2 + 0.4))


def test_a_solver_that_returns_no_numbers_brakes_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its flag says that it solved the problem, which is not believed."""
    monkeypatch.setattr("eyechart.mpc.controller.solve", lambda *_, **__: (np.full(32, np.nan), 0.0, 1, {}))
    plan: Plan = Mpc(CAR, ROAD).plan(STILL, Target(4.5, 0.0))
    assert (plan.solved, plan.accel_mps2) == (False, -CAR.brake_mps2)


@pytest.mark.parametrize("number", range(4))
def test_a_state_that_is_no_number_is_refused_by_name(number: int) -> None:
    """Nothing is planned from it."""
    values = [0.0, 0.0, 0.0, 1.0]
    values[number] = math.nan
    name = ("x_m", "y_m", "heading_rad", "speed_mps")[number]
    with pytest.raises(StateError, match=f"^{name} is nan"):
        Mpc(CAR, ROAD).plan(State(*values), Target(4.5, 0.0))


def test_a_target_and_an_obstacle_that_are_no_numbers_are_refused_by_name() -> None:
    """The obstacle by its place in the list."""
    mpc = Mpc(CAR, ROAD)
    with pytest.raises(StateError, match=r"^target offset_m is inf"):
        mpc.plan(STILL, Target(4.5, math.inf))
    with pytest.raises(StateError, match=r"^obstacle 1 is \[2.0, nan, 1.0\]"):
        mpc.plan(STILL, Target(4.5, 0.0), [(1.0, 1.0, 1.0), (2.0, math.nan, 1.0)])


def test_two_discs_in_a_row_have_the_way_round_of_one() -> None:
    """Equal edges are one way, and no tie between two; a true tie has none, so that no side is preferred."""
    assert Detour(np.array([[6.0, 0.0, 1.0], [7.0, 0.0, 1.0]]), 0.0, 4.0).aim(0.0, 0.5, 0.0) == pytest.approx(1.1)
    assert Detour(np.array([[6.0, 0.0, 1.0]]), 0.0, 4.0).aim(0.0, 0.5, 0.0) == pytest.approx(1.1)
    assert Detour(np.array([[6.0, 0.0, 1.0]]), 0.0, 4.0).aim(0.0, 0.0, 0.0) == 0.0


def test_obstacles_of_another_shape_are_refused() -> None:
    """Three pairs are not two triples."""
    with pytest.raises(StateError, match=r"obstacles have shape \(3, 2\)"):
        Mpc(CAR, ROAD).plan(STILL, Target(4.5, 0.0), np.zeros((3, 2)))


@pytest.mark.parametrize("states", [1000, pytest.param(20_000, marks=pytest.mark.models)])
def test_no_state_leaves_a_failure_unsaid(monkeypatch: pytest.MonkeyPatch, states: int) -> None:
    """Every failure of the solver stands in its plan, and every command is one that the vehicle can follow.

    The states are feasible or not. The solver itself fails at none of them, so one answer in fifty is made a failure.
    """
    own: list[int] = []
    told: list[int] = []

    def now_and_then(*given: object, **options: object) -> tuple[object, ...]:
        found, cost, flag, info = daqp.solve(*given, **options)
        own.append(flag)
        told.append((-1, -3, -4)[len(own) % 3] if len(own) % 50 == 0 else flag)
        return found, cost, told[-1], info

    monkeypatch.setattr("eyechart.mpc.controller.solve", now_and_then)
    mpc = Mpc(CAR, ROAD)
    cases = list(somewhere(2, states))
    plans = [mpc.plan(*case) for case in cases]
    assert [plan.flag for plan in plans] == told
    assert [plan.solved for plan in plans] == [flag in (1, 2) for flag in told]
    assert set(own) <= {1, 2}
    for (state, _, _), plan in zip(cases, plans, strict=True):
        assert -CAR.brake_mps2 - 1e-6 <= plan.accel_mps2 <= CAR.accel_mps2 + 1e-6
        assert abs(plan.steer_rad) <= CAR.most_steer(state.speed_mps) + 1e-6
        assert plan.solved or (plan.accel_mps2, plan.steer_rad) == (-CAR.brake_mps2, 0.0)
