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
from eyechart.mpc import STEP_S, Bicycle, Detour, DrivableWidth, Mpc, MpcPlan, State, Target

CAR, ROAD = Bicycle(), DrivableWidth()
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
    monkeypatch.setattr("eyechart.mpc.solve", lambda *_, **__: (np.full(32, 0.1), 0.0, -1, {}))
    plan = Mpc(CAR, ROAD).plan(replace(STILL, speed_mps=2.0), Target(4.5, 0.0))
    assert (plan.solved, plan.flag, plan.accel_mps2, plan.steer_rad) == (False, -1, -CAR.brake_mps2, 0.0)
    assert plan.path[-1, 0] == pytest.approx(0.2 * (2.0 + 1.2 + 0.4))


def test_a_solver_that_returns_no_numbers_brakes_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its flag says that it solved the problem, which is not believed."""
    monkeypatch.setattr("eyechart.mpc.solve", lambda *_, **__: (np.full(32, np.nan), 0.0, 1, {}))
    plan: MpcPlan = Mpc(CAR, ROAD).plan(STILL, Target(4.5, 0.0))
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

    monkeypatch.setattr("eyechart.mpc.solve", now_and_then)
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


def speeds(mpc: Mpc, state: State, target: Target) -> list[float]:
    """Return the speeds to which a plan's first command and its repeats lead, 40 steps long."""
    result = [state.speed_mps]
    for _ in range(40):
        result.append(result[-1] + STEP_S * mpc.plan(replace(state, speed_mps=result[-1]), target).accel_mps2)
    return result


def test_the_vehicles_speed_is_a_bound_whatever_the_intent_asks_for() -> None:
    """A target of 4.5 m/s ends at the 3 m/s that the vehicle can do; one below it is reached."""
    slow = Mpc(replace(CAR, speed_mps=3.0), ROAD)
    asked = speeds(slow, STILL, Target(4.5, 0.0))
    assert max(asked) <= 3.0 + 1e-6
    assert asked[-1] == pytest.approx(3.0, abs=1e-3)
    assert speeds(slow, STILL, Target(2.5, 0.0))[-1] == pytest.approx(2.5, abs=0.05)
    assert max(speeds(Mpc(CAR, ROAD), STILL, Target(9.0, 0.0))) == pytest.approx(CAR.speed_mps, abs=1e-3)


def test_a_vehicle_that_is_too_fast_is_not_asked_for_the_impossible() -> None:
    """Above its bound it may stay as fast as it is, and is not made faster; it comes down to what is asked for."""
    found = speeds(Mpc(replace(CAR, speed_mps=3.0), ROAD), replace(STILL, speed_mps=4.0), Target(9.0, 0.0))
    assert max(found) <= 4.0 + 1e-6
    assert Mpc(replace(CAR, speed_mps=3.0), ROAD).plan(replace(STILL, speed_mps=4.0), Target(2.0, 0.0)).solved


def test_it_never_plans_to_drive_backwards() -> None:
    """To stop from 0.3 m/s takes 1.5 m/s², not the 4 that the brakes could."""
    found = speeds(Mpc(CAR, ROAD), replace(STILL, speed_mps=0.3), Target(0.0, 0.0))
    assert min(found) >= -1e-6
    assert found[-1] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(("place", "aim"), [(0.54, -1.1), (0.56, 1.1), (-0.5, -1.1), (1.4, 1.1)])
def test_a_detour_costs_its_way_there_and_half_of_the_way_to_the_target(place: float, aim: float) -> None:
    """Edges at ±1.1 and a target at -2: |edge - place| + |edge - target| / 2 are equal from 0.55."""
    detour = Detour(np.array([[6.0, 0.0, 1.0]]), 0.0, 4.0)
    assert detour.aim(0.0, place, -2.0) == pytest.approx(aim)


@pytest.mark.parametrize(("x", "aim"), [(0.0, 1.1), (-12.0 + 6.0, 0.0), (-12.0 + 6.01, 1.1), (7.0, 0.0), (6.99, 1.1)])
def test_what_is_looked_at_begins_and_ends(x: float, aim: float) -> None:
    """A disc is in the way from 12 m before its middle until its radius behind it."""
    assert Detour(np.array([[6.0, 0.0, 1.0]]), x, 4.0).aim(x, 0.5, 0.0) == pytest.approx(aim)


def test_a_way_round_that_leaves_the_road_is_none() -> None:
    """Off the road's half width an edge is no way, and where both are off, the target's own offset stays."""
    disc = np.array([[6.0, 2.5, 1.0]])
    assert Detour(disc, 0.0, 4.0).aim(0.0, 3.0, 2.5) == pytest.approx(3.6)
    assert Detour(disc, 0.0, 3.6).aim(0.0, 3.0, 2.5) == pytest.approx(3.6)
    assert Detour(disc, 0.0, 3.5).aim(0.0, 3.0, 2.5) == pytest.approx(1.4)
    assert Detour(np.array([[6.0, 0.0, 5.0]]), 0.0, 4.0).aim(0.0, 1.0, 0.0) == 0.0


def test_discs_that_overlap_along_the_road_are_passed_together() -> None:
    """Two side by side leave the outer edges; one that begins behind the first's end is passed later."""
    beside = np.array([[6.0, 1.0, 1.0], [6.5, -0.5, 1.0]])
    assert Detour(beside, 0.0, 4.0).aim(0.0, 0.3, 0.0) == pytest.approx(-1.6)
    assert Detour(np.array([[6.0, 1.0, 1.0], [8.1, -0.5, 1.0]]), 0.0, 4.0).aim(0.0, 0.3, 0.2) == pytest.approx(-0.1)


@pytest.mark.parametrize(("speed", "most"), [(0.0, 0.5), (1.9, 0.5), (2.0, math.atan(0.5)), (5.0, math.atan(0.08))])
def test_the_wheels_turn_as_far_as_the_speed_allows(speed: float, most: float) -> None:
    """Half a radian, or from 1.91 m/s on what keeps the lateral acceleration at 4 m/s²."""
    assert CAR.most_steer(speed) == pytest.approx(most)


def gently(number: int) -> Iterator[tuple[State, Target, npt.NDArray[np.float64]]]:
    """Yield states on the road with 0, 1, 2 … obstacles ahead of them."""
    rng = np.random.default_rng(17)
    for count in range(number):
        place = [10.0 * count, *(rng.uniform(-1, 1, 2) * (3.0, 0.6)), rng.uniform(0.5, 5.0)]
        state = State(*np.round(place, 2).tolist())
        discs = np.round(np.column_stack([rng.uniform(low, high, count) for low, high in AHEAD]), 1)
        target = Target(float(rng.integers(0, 6)), float(rng.integers(-2, 3)))
        yield state, target, discs + np.array([state.x_m, 0.0, 0.0])


AHEAD = ((2.0, 12.0), (-4.0, 4.0), (0.8, 1.6))
COMMANDS = (
    (2.0000000, -0.2172638, 5.2348168, -0.8357799),
    (1.4148630, 0.3265743, 4.5538244, -1.0832920),
    (-4.0000000, -0.0129111, 4.4231012, -1.4206686),
    (2.0000000, -0.2761253, 5.5998375, -0.9579354),
    (-4.0000000, -0.0173826, 1.3907416, 1.1645828),
    (1.7932882, -0.1082467, 7.5951627, -0.1980358),
    (-2.3378338, 0.1201556, 5.1149675, -0.7769184),
    (-3.7802517, -0.0380505, 5.3655963, -0.0079904),
    (-3.5415194, 0.1583511, 0.8296962, -0.2599392),
)
"""Acceleration, steering, and how far and where to the side its plan ends."""


def test_the_commands_are_those_that_they_were() -> None:
    """Drives that were recorded are driven again by them, so that a change of any is to be meant."""
    plans = [(case, Mpc(CAR, ROAD).plan(*case)) for case in gently(9)]
    found = [(one.accel_mps2, one.steer_rad, one.path[-1, 0] - case[0].x_m, one.path[-1, 1]) for case, one in plans]
    assert np.array(found) == pytest.approx(np.array(COMMANDS), abs=1e-6)


def test_no_intent_makes_it_drive_backwards() -> None:
    """A speed below 0 is asked for in vain."""
    found = speeds(Mpc(CAR, ROAD), replace(STILL, speed_mps=1.0), Target(-2.0, 0.0))
    assert min(found) >= -1e-6
    assert found[-1] == pytest.approx(0.0, abs=1e-3)
