"""One whole step of the controller, assembly and solve, against cvxpy with OSQP and CasADi with IPOPT.

The same 300 random states, targets and obstacles go to all three in one process, in turn. cvxpy gets the same quadratic
programme as a parametrised problem that is compiled once, CasADi the programme's nonlinear original (the bicycle not
linearised) with the same half-planes, built once. CPU time of the process; cvxpy's command has to agree with ours. Then
20 000 states go to ours alone, and none may fail without saying so.

    python benchmarks/bench_mpc.py [--states 300] [--json]

The states are split in ten parts, and of their ratios the greatest counts. What DAQP alone takes for the same programme
is reported. Writes ``results/bench_mpc.json``, and exits 1 when ours is less than 10x faster than the faster of the
others at the median. Needs cvxpy, osqp and casadi.
"""

# ruff: noqa: SLF001 - the others are given the linearisation that ours makes, so that all solve one programme
import argparse
import json
import math
import sys
import time
import warnings
from collections.abc import Callable, Iterator

import casadi
import cvxpy as cp
import numpy as np
import numpy.typing as npt
from daqp import solve

from eyechart.mpc import HORIZON, STEP_S, Bicycle, CostWeights, DrivableWidth, Mpc, State, Target, _nearest, _normals
from pairs import PAIRS, keep

BOUND = 10.0
NEAR = 4
CAR, ROAD, WEIGHTS = Bicycle(), DrivableWidth(), CostWeights()
Floats = npt.NDArray[np.float64]
Case = tuple[State, Target, Floats]


def somewhere(seed: int, number: int) -> Iterator[Case]:
    """Yield random states, feasible or not, with up to seven discs (x, y, radius) nearby."""
    rng = np.random.default_rng(seed)
    for _ in range(number):
        values = (rng.uniform(0, 100), rng.uniform(-4.5, 4.5), rng.uniform(-1, 1), rng.uniform(0, 5))
        state = State(*map(float, values))
        count = int(rng.integers(0, 8))
        places = (rng.uniform(-3, 10, count) + state.x_m, rng.uniform(-4, 4, count), rng.uniform(0.8, 1.8, count))
        target = Target(float(rng.choice([0.0, 2.5, 4.5])), float(rng.choice([-2.0, 0.0, 2.0])))
        yield state, target, np.column_stack(places)


class Cvxpy:
    """The same programme with the states as variables, as cvxpy's documentation would have it."""

    def __init__(self) -> None:
        self._own = Mpc(CAR, ROAD)
        h = HORIZON
        self._x, self._u = cp.Variable((h + 1, 4)), cp.Variable((h, 2))
        self._off, self._in = cp.Variable(h, nonneg=True), cp.Variable(h, nonneg=True)
        self._start, self._aims, self._speed = cp.Parameter(4), cp.Parameter(h), cp.Parameter()
        self._most, self._top, self._least = cp.Parameter(h), cp.Parameter(), cp.Parameter()
        self._a = [cp.Parameter((4, 4)) for _ in range(h)]
        self._b = [cp.Parameter((4, 2)) for _ in range(h)]
        self._c = [cp.Parameter(4) for _ in range(h)]
        self._n = [cp.Parameter((h, 2)) for _ in range(NEAR)]
        self._d = [cp.Parameter(h) for _ in range(NEAR)]
        self._problem = cp.Problem(cp.Minimize(self._cost()), self._constraints())

    def _cost(self) -> cp.Expression:
        w, x, u = WEIGHTS, self._x[1:], self._u
        track = w.speed * cp.sum_squares(x[:, 3] - self._speed) + w.lateral * cp.sum_squares(x[:, 1] - self._aims)
        track += w.heading * cp.sum_squares(x[:, 2])
        inputs = w.accel * cp.sum_squares(u[:, 0]) + w.steer * cp.sum_squares(u[:, 1])
        inputs += w.accel_change * cp.sum_squares(cp.diff(u[:, 0]))
        inputs += w.steer_change * cp.sum_squares(cp.diff(u[:, 1]))
        slack = sum(w.slack * (cp.sum(s) + 0.5 * cp.sum_squares(s)) for s in (self._off, self._in))
        return 0.5 * (track + inputs) + slack

    def _constraints(self) -> list[cp.Constraint]:
        x, u, half = self._x, self._u, ROAD.half_width_m
        constraints = [x[0] == self._start]
        constraints += [x[k + 1] == self._a[k] @ x[k] + self._b[k] @ u[k] + self._c[k] for k in range(HORIZON)]
        constraints += [u[:, 0] >= -CAR.brake_mps2, u[:, 0] <= CAR.accel_mps2, cp.abs(u[:, 1]) <= self._most]
        constraints += [x[1:, 1] <= half + self._off, x[1:, 1] >= -half - self._off]
        constraints += [x[1:, 3] <= self._top, x[1:, 3] >= self._least]
        for n, d in zip(self._n, self._d, strict=True):
            constraints.append(cp.sum(cp.multiply(n, x[1:, :2]), axis=1) + self._in >= d)
        return constraints

    def plan(self, state: State, target: Target, discs: Floats) -> tuple[float, float]:
        """Return acceleration and steering."""
        own = self._own
        nominal, inputs, aims = own._roll_out(state, target, discs)
        own._linearise(nominal, inputs)
        u = inputs.reshape(2, HORIZON).T
        self._start.value, self._aims.value, self._speed.value = nominal[0], aims, target.speed_mps
        self._most.value = own._upper[HORIZON : 2 * HORIZON].copy()
        self._top.value, self._least.value = max(CAR.speed_mps, state.speed_mps), min(0.0, state.speed_mps)
        for k in range(HORIZON):
            self._a[k].value, self._b[k].value = own._a[k], own._b[k]
            self._c[k].value = nominal[k + 1] - own._a[k] @ nominal[k] - own._b[k] @ u[k]
        near = _nearest(nominal[0], discs)
        normals = _normals(nominal, near)
        for number in range(NEAR):
            there = number < len(near)
            self._n[number].value = normals[number] if there else np.zeros((HORIZON, 2))
            least = normals[number] @ near[number, :2] + near[number, 2] if there else np.full(HORIZON, -1.0)
            self._d[number].value = least
        self._problem.solve(solver=cp.OSQP, warm_start=True, eps_abs=1e-5, eps_rel=1e-5, max_iter=20000)
        return float(self._u.value[0, 0]), float(self._u.value[0, 1])


class Casadi:
    """The bicycle itself, not linearised, by direct multiple shooting, the usual way."""

    def __init__(self) -> None:
        self._own = Mpc(CAR, ROAD)
        h = HORIZON
        o = self._opti = casadi.Opti()
        self._x, self._u = o.variable(4, h + 1), o.variable(2, h)
        self._off, self._in = o.variable(h), o.variable(h)
        self._start, self._aims, self._speed = o.parameter(4), o.parameter(h), o.parameter()
        self._most, self._top = o.parameter(h), o.parameter()
        self._n, self._d = o.parameter(2 * NEAR, h), o.parameter(NEAR, h)
        o.minimize(self._cost())
        self._constrain()
        o.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})

    def _cost(self) -> casadi.MX:
        w, x, u = WEIGHTS, self._x[:, 1:], self._u
        track = w.speed * casadi.sumsqr(x[3, :] - self._speed) + w.lateral * casadi.sumsqr(x[1, :] - self._aims.T)
        track += w.heading * casadi.sumsqr(x[2, :])
        inputs = w.accel * casadi.sumsqr(u[0, :]) + w.steer * casadi.sumsqr(u[1, :])
        inputs += w.accel_change * casadi.sumsqr(u[0, 1:] - u[0, :-1])
        inputs += w.steer_change * casadi.sumsqr(u[1, 1:] - u[1, :-1])
        slack = sum(w.slack * (casadi.sum1(s) + 0.5 * casadi.sumsqr(s)) for s in (self._off, self._in))
        return 0.5 * (track + inputs) + slack

    def _constrain(self) -> None:
        o, x, u, half = self._opti, self._x, self._u, ROAD.half_width_m
        o.subject_to(x[:, 0] == self._start)
        for k in range(HORIZON):
            o.subject_to(x[0, k + 1] == x[0, k] + STEP_S * x[3, k] * casadi.cos(x[2, k]))
            o.subject_to(x[1, k + 1] == x[1, k] + STEP_S * x[3, k] * casadi.sin(x[2, k]))
            turn = STEP_S * x[3, k] * casadi.tan(u[1, k]) / CAR.wheelbase_m
            o.subject_to(x[2, k + 1] == x[2, k] + turn)
            o.subject_to(x[3, k + 1] == x[3, k] + STEP_S * u[0, k])
            o.subject_to(o.bounded(-CAR.brake_mps2, u[0, k], CAR.accel_mps2))
            o.subject_to(o.bounded(-self._most[k], u[1, k], self._most[k]))
            o.subject_to(x[1, k + 1] <= half + self._off[k])
            o.subject_to(x[1, k + 1] >= -half - self._off[k])
            o.subject_to(o.bounded(0.0, x[3, k + 1], self._top))
            for number in range(NEAR):
                reach = casadi.dot(self._n[2 * number : 2 * number + 2, k], x[:2, k + 1])
                o.subject_to(reach + self._in[k] >= self._d[number, k])
        o.subject_to(self._off >= 0)
        o.subject_to(self._in >= 0)

    def plan(self, state: State, target: Target, discs: Floats) -> tuple[float, float]:
        """Return acceleration and steering."""
        own, o = self._own, self._opti
        nominal, inputs, aims = own._roll_out(state, target, discs)
        o.set_value(self._start, nominal[0])
        o.set_value(self._aims, aims)
        o.set_value(self._speed, target.speed_mps)
        o.set_value(self._most, own._upper[HORIZON : 2 * HORIZON])
        o.set_value(self._top, max(CAR.speed_mps, state.speed_mps))
        normals, least = np.zeros((2 * NEAR, HORIZON)), np.full((NEAR, HORIZON), -1.0)
        near = _nearest(nominal[0], discs)
        for number, (disc, away) in enumerate(zip(near, _normals(nominal, near), strict=True)):
            normals[2 * number : 2 * number + 2], least[number] = away.T, away @ disc[:2] + disc[2]
        o.set_value(self._n, normals)
        o.set_value(self._d, least)
        o.set_initial(self._x, nominal.T)
        o.set_initial(self._u, inputs.reshape(2, HORIZON))
        found = o.solve()
        return float(found.value(self._u[0, 0])), float(found.value(self._u[1, 0]))


def timed(plan: Callable[[State, Target, Floats], tuple[float, float]], case: Case) -> tuple[float, float, float]:
    """Return CPU milliseconds, acceleration and steering; NaN where the solver gave up."""
    start = time.process_time_ns()
    try:
        accel, steer = plan(*case)
    except (RuntimeError, cp.error.SolverError, TypeError):
        accel = steer = math.nan
    return (time.process_time_ns() - start) / 1e6, accel, steer


def solver_ms(own: Mpc, case: Case) -> float:
    """Return the CPU milliseconds of DAQP alone for the programme of a case, which the step has assembled."""
    own.plan(*case)
    given = (own._hessian, own._linear, own._rows, own._upper, own._lower, own._sense.copy())
    start = time.process_time_ns()
    solve(*given, primal_tol=1e-8)
    return (time.process_time_ns() - start) / 1e6


def main() -> int:
    """Print the table, or JSON; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--states", type=int, default=300)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    warnings.filterwarnings("ignore", "Solution may be inaccurate")  # cvxpy's; commands_agree says what came of it
    own = Mpc(CAR, ROAD)

    def ours(state: State, target: Target, discs: Floats) -> tuple[float, float]:
        plan = own.plan(state, target, discs)
        return plan.accel_mps2, plan.steer_rad

    ways = {"eyechart (DAQP)": ours, "cvxpy (OSQP)": Cvxpy().plan, "CasADi (IPOPT)": Casadi().plan}
    rows: dict[str, list[tuple[float, float, float]]] = {name: [] for name in ways}
    alone: list[float] = []
    for number, case in enumerate(somewhere(0, asked.states + 5)):
        for name, plan in ways.items():
            row = timed(plan, case)
            if number >= 5:  # the first solves compile
                rows[name].append(row)
        alone.append(solver_ms(own, case))
    found = {name: np.array(row) for name, row in rows.items()}
    first, second = found["eyechart (DAQP)"], found["cvxpy (OSQP)"]
    apart = np.abs(first[:, 1:] - second[:, 1:]).max(axis=1)
    result: dict[str, object] = {
        name: {
            "median_ms": float(np.median(table[:, 0])),
            "p99_ms": float(np.percentile(table[:, 0], 99)),
            "failed": int(np.isnan(table[:, 1]).sum()),
        }
        for name, table in found.items()
    }
    parts = zip(*(np.array_split(table[:, 0], PAIRS) for table in found.values()), strict=True)
    medians = [[float(np.median(part)) for part in each] for each in parts]
    result["ratios"] = [min(others) / mine for mine, *others in medians]
    result["ratio"] = ratio = max(min(others) / mine for mine, *others in medians)
    result["DAQP alone, median_ms"] = float(np.median(alone[5:]))
    result["step_over_daqp"] = float(np.median(first[:, 0]) / np.median(alone[5:]))
    result["commands_agree"] = float((apart < 0.02).mean())
    plans = [own.plan(*case) for case in somewhere(1, 20_000)]
    unsaid = sum(plan.solved and not math.isfinite(plan.accel_mps2 + plan.steer_rad) for plan in plans)
    result["of_20000"] = {"braked_and_said_so": sum(not plan.solved for plan in plans), "unsaid": unsaid}
    keep("bench_mpc", result)
    if asked.json:
        print(json.dumps(result, indent=2))
    else:
        for name, value in result.items():
            print(f"{name}: {value}")
    return 0 if ratio >= BOUND and not unsaid else 1


if __name__ == "__main__":
    sys.exit(main())
