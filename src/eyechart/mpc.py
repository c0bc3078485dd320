"""A model-predictive controller for a kinematic bicycle: linearised, stateless, exactly mirrored.

Source: paper, section Hierarchical VLM--MPC Diagnostic; the method is that of Mayne et al. (2000).
The quadratic programme is solved by DAQP (Arnstrom, Bemporad and Axehill 2022).

Coordinates are the road's: x forward, y to the left, heading counter-clockwise. Reflecting the
world (y, heading, steering) changes signs only. A sum of terms that all change sign rounds the same
way. So the mirrored input gives the mirrored command to the bit, as long as the code uses the same
operations for left and right.

A linearised controller improves a path but does not choose a side. A detour chooses it at each plan
from the present place alone, so equal places give equal choices. If both sides are equally near, it
chooses none.
"""

import math
from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt
from daqp import solve

from eyechart.errors import StateError


@dataclass(frozen=True, slots=True)
class Bicycle:
    """A kinematic bicycle, and the bounds of its inputs: metres, seconds, radians.

    ``accel_mps2`` bounds the acceleration, ``brake_mps2`` the deceleration (positive),
    ``steer_rad`` the steering angle on either side, ``speed_mps`` the speed, which is never
    negative, ``aside_mps2`` the lateral acceleration.
    """

    wheelbase_m: float = 0.5
    accel_mps2: float = 2.0
    brake_mps2: float = 4.0
    steer_rad: float = 0.5
    speed_mps: float = 5.0
    aside_mps2: float = 4.0

    def most_steer(self, speed_mps: float) -> float:
        """Return the largest steering angle that wheels and grip allow, in radians."""
        fast = speed_mps * speed_mps
        if fast * math.tan(self.steer_rad) <= self.aside_mps2 * self.wheelbase_m:
            return self.steer_rad
        return math.atan(self.aside_mps2 * self.wheelbase_m / fast)


@dataclass(frozen=True, slots=True)
class DrivableWidth:
    """Half of the road's width that the vehicle's centre may use, in metres."""

    half_width_m: float = 4.0


@dataclass(frozen=True, slots=True)
class CostWeights:
    """Weights of the cost: squared deviations a stage, squared inputs, their changes, and slack."""

    speed: float = 1.0
    lateral: float = 1.0
    heading: float = 2.0
    accel: float = 0.05
    steer: float = 1.0
    accel_change: float = 0.05
    steer_change: float = 2.0
    slack: float = 200.0


@dataclass(frozen=True, slots=True)
class State:
    """The state of a bicycle: metres, radians, metres a second."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float


@dataclass(frozen=True, slots=True)
class Target:
    """An intent's target: a speed, and a lateral offset from the road's middle, left positive."""

    speed_mps: float
    offset_m: float


@dataclass(frozen=True, slots=True)
class MpcPlan:
    """The command for the next 0.2 s, and the predicted path.

    ``solved`` is False if the solver found no optimum. The command is then the hardest brake with
    straight wheels, ``flag`` is the solver's code, and ``path`` is that of braking. ``path`` has
    shape (8, 2), in metres.
    """

    accel_mps2: float
    steer_rad: float
    solved: bool
    flag: int
    path: npt.NDArray[np.float64]


_LOOK_M = 12.0
_BERTH_M = 0.1
_REACH_M = 10.0
"""The range of the search for obstacles, the clearance to their edges, and a plan's longest way."""

_Disc = tuple[float, float, float]


class Detour:
    """The offset to steer for, to pass an obstacle on its free side."""

    def __init__(self, discs: npt.NDArray[np.float64], x: float, half_width: float) -> None:
        triples: list[_Disc] = discs.tolist()
        self._discs = [disc for disc in triples if -disc[2] < disc[0] - x < _LOOK_M + _REACH_M]
        self._half = half_width

    def aim(self, x: float, y: float, offset: float) -> float:
        """Return the offset to steer for: the target's own without need or room for a detour."""
        if not self._discs:
            return offset
        ahead = [disc for disc in self._discs if -disc[2] < disc[0] - x < _LOOK_M]
        low, high = min(y, offset), max(y, offset)
        if not ahead or all(abs(offset - cy) >= r and not low - r < cy < high + r for _, cy, r in ahead):
            return offset
        first = min(ahead, key=lambda disc: disc[0] - disc[2])
        group = [disc for disc in ahead if abs(disc[0] - first[0]) < first[2] + disc[2]]
        edges = {cy + side * (r + _BERTH_M) for _, cy, r in group for side in (-1.0, 1.0)} | {offset}
        free = [edge for edge in edges if abs(edge) <= self._half and all(abs(edge - cy) >= r for _, cy, r in group)]
        costs = sorted((abs(edge - y) + 0.5 * abs(edge - offset), edge) for edge in free)
        if not costs or (len(costs) > 1 and costs[0][0] == costs[1][0]):
            return offset
        return costs[0][1]


Floats = npt.NDArray[np.float64]

HORIZON = 8
STEP_S = 0.2
_NEAREST = 4
"""Half-planes a stage; farther obstacles are out of reach within the horizon."""

_AIM_M = 4.0
_GRAZE_M = 0.1
"""How far ahead the nominal driver aims, and how deep its path may cut into a disc."""

_UNBOUNDED = 1e30
"""DAQP's infinity."""

_SOLVED = (1, 2)
"""DAQP's flags for an optimum, and for one with soft constraints; all others are failures."""


class Mpc:
    """A controller over one bicycle and one road, with working memory but no state between plans.

    ``obstacles`` of a plan have shape (n, 3): x, y, and the radius that the vehicle's centre must
    keep off.
    """

    def __init__(self, bicycle: Bicycle, road: DrivableWidth, weights: CostWeights | None = None) -> None:
        self._bicycle = bicycle
        self._road = road
        self._weights = weights or CostWeights()
        inputs, slack = 2 * HORIZON, 2 * HORIZON
        self._n = n = inputs + slack
        rows = 3 * HORIZON + _NEAREST * HORIZON
        self._hessian, self._linear = np.zeros((n, n)), np.zeros(n)
        self._rows = np.zeros((rows, n))
        self._upper, self._lower = np.full(n + rows, _UNBOUNDED), np.full(n + rows, -_UNBOUNDED)
        self._sense = np.zeros(n + rows, dtype=np.int32)
        self._gains = np.zeros((HORIZON + 1, 4, inputs))
        self._a, self._b = np.zeros((HORIZON, 4, 4)), np.zeros((HORIZON, 4, 2))
        self._weighted = np.zeros((3 * HORIZON, inputs))
        self._fixed = _input_cost(self._weights)
        self._prepare()

    def _prepare(self) -> None:
        """Set what no state changes: bounds of inputs and slack, and the slack's rows."""
        car, h = self._bicycle, HORIZON
        inputs = 2 * h
        self._lower[:h], self._upper[:h] = -car.brake_mps2, car.accel_mps2
        self._lower[inputs : 2 * inputs] = 0.0
        self._linear[inputs:] = self._weights.slack
        diagonal = np.arange(inputs, 2 * inputs)
        self._hessian[diagonal, diagonal] = self._weights.slack
        stage = np.arange(h)
        self._rows[stage, inputs + stage] = -1.0
        self._rows[h + stage, inputs + stage] = 1.0
        for near in range(_NEAREST):
            self._rows[3 * h + near * h + stage, inputs + h + stage] = 1.0
        self._a[:] = np.eye(4)
        self._b[:, 3, 0] = STEP_S

    def plan(self, state: State, target: Target, obstacles: npt.ArrayLike = ()) -> MpcPlan:
        """Return the command for the next 0.2 s; equal input gives equal bits.

        Raises StateError that names the fault for a non-finite state, target or obstacle.
        """
        discs = _discs(obstacles)
        _require_finite(state, target)
        nominal, inputs, aims = self._roll_out(state, target, discs)
        self._linearise(nominal, inputs)
        self._cost(nominal, inputs, target.speed_mps, aims)
        self._constrain(nominal, inputs, discs)
        x, _, flag, _ = solve(
            self._hessian, self._linear, self._rows, self._upper, self._lower, self._sense, primal_tol=1e-8
        )
        if flag not in _SOLVED or not np.isfinite(x).all():
            return self._brake(state, int(flag))
        path = nominal[1:, :2] + self._gains[1:, :2] @ (x[: 2 * HORIZON] - inputs)
        return MpcPlan(float(x[0]), float(x[HORIZON]), solved=True, flag=int(flag), path=path)

    def _roll_out(self, state: State, target: Target, discs: Floats) -> tuple[Floats, Floats, Floats]:
        """Return states (9, 4), inputs (16,) and offsets (8,) of a driver with detours."""
        around = Detour(discs, state.x_m, self._road.half_width_m)
        car, h = self._bicycle, HORIZON
        states, inputs, aims = np.empty((h + 1, 4)), np.empty(2 * h), np.empty(h)
        x, y, heading, speed = state.x_m, state.y_m, state.heading_rad, state.speed_mps
        states[0] = x, y, heading, speed
        for k in range(h):
            accel = min(max((target.speed_mps - speed) / STEP_S, -car.brake_mps2), car.accel_mps2)
            most = self._upper[h + k] = car.most_steer(speed)
            self._lower[h + k] = -most
            aims[k] = around.aim(x, y, target.offset_m)
            turn = math.atan2(aims[k] - y, _AIM_M) - heading
            steer = min(max(math.atan2(turn * car.wheelbase_m, STEP_S * max(speed, 1.0) * 2), -most), most)
            inputs[k], inputs[h + k] = accel, steer
            x += STEP_S * speed * math.cos(heading)
            y += STEP_S * speed * math.sin(heading)
            heading += STEP_S * speed * math.tan(steer) / car.wheelbase_m
            speed += STEP_S * accel
            states[k + 1] = x, y, heading, speed
        return states, inputs, aims

    def _linearise(self, nominal: Floats, inputs: Floats) -> None:
        """Set the gains (9, 4, 16) of every stage's state with respect to the inputs."""
        heading, speed = nominal[:-1, 2], nominal[:-1, 3]
        cos, sin, steer = np.cos(heading), np.sin(heading), inputs[HORIZON:]
        a, b, base = self._a, self._b, self._bicycle.wheelbase_m
        np.multiply(sin, -STEP_S * speed, out=a[:, 0, 2])
        np.multiply(cos, STEP_S, out=a[:, 0, 3])
        np.multiply(cos, STEP_S * speed, out=a[:, 1, 2])
        np.multiply(sin, STEP_S, out=a[:, 1, 3])
        np.multiply(np.tan(steer), STEP_S / base, out=a[:, 2, 3])
        np.divide(STEP_S / base * speed, np.cos(steer) ** 2, out=b[:, 2, 1])
        gains, h = self._gains, HORIZON
        for k in range(h):
            np.matmul(a[k], gains[k], out=gains[k + 1])
            gains[k + 1, :, k] += b[k, :, 0]
            gains[k + 1, :, h + k] += b[k, :, 1]

    def _cost(self, nominal: Floats, inputs: Floats, speed: float, aims: Floats) -> None:
        w, h = self._weights, HORIZON
        gains, weighted = self._gains[1:], self._weighted
        away = np.empty(3 * h)
        wanted: tuple[tuple[int, float, float | Floats], ...] = (
            (3, w.speed, speed),
            (1, w.lateral, aims),
            (2, w.heading, 0.0),
        )
        for row, (column, weight, aim) in enumerate(wanted):
            part, root = slice(row * h, (row + 1) * h), math.sqrt(weight)
            np.multiply(gains[:, column], root, out=weighted[part])
            away[part] = root * (nominal[1:, column] - aim)
        away -= weighted @ inputs
        m = 2 * h
        np.matmul(weighted.T, weighted, out=self._hessian[:m, :m])
        self._hessian[:m, :m] += self._fixed
        np.matmul(weighted.T, away, out=self._linear[:m])

    def _constrain(self, nominal: Floats, inputs: Floats, discs: Floats) -> None:
        h, m, n = HORIZON, 2 * HORIZON, self._n
        gains, rows, upper, lower = self._gains[1:], self._rows, self._upper[n:], self._lower[n:]
        half = self._road.half_width_m
        offset = nominal[1:] - gains @ inputs
        rows[:h, :m] = rows[h : 2 * h, :m] = gains[:, 1]
        upper[:h] = half - offset[:, 1]
        lower[h : 2 * h] = -half - offset[:, 1]
        rows[2 * h : 3 * h, :m] = gains[:, 3]
        upper[2 * h : 3 * h] = max(self._bicycle.speed_mps, nominal[0, 3]) - offset[:, 3]
        lower[2 * h : 3 * h] = min(0.0, nominal[0, 3]) - offset[:, 3]
        near = _nearest(nominal[0], discs)
        keep, used = rows[3 * h :].reshape(_NEAREST, h, n), len(near)
        least = lower[3 * h :].reshape(_NEAREST, h)
        keep[used:, :, :m], least[used:] = 0.0, -_UNBOUNDED
        if used:
            normals = _normals(nominal, near)
            np.multiply(normals[:, :, :1], gains[:, 0], out=keep[:used, :, :m])
            keep[:used, :, :m] += normals[:, :, 1:] * gains[:, 1]
            edge = near[:, None, :2] - offset[:, :2]
            least[:used] = normals[:, :, 0] * edge[:, :, 0] + normals[:, :, 1] * edge[:, :, 1] + near[:, 2:]

    def _brake(self, state: State, flag: int) -> MpcPlan:
        speed, path = state.speed_mps, np.empty((HORIZON, 2))
        x, y = state.x_m, state.y_m
        for k in range(HORIZON):
            x += STEP_S * speed * math.cos(state.heading_rad)
            y += STEP_S * speed * math.sin(state.heading_rad)
            speed = max(0.0, speed - STEP_S * self._bicycle.brake_mps2)
            path[k] = x, y
        return MpcPlan(-self._bicycle.brake_mps2, 0.0, solved=False, flag=flag, path=path)


def _input_cost(weights: CostWeights) -> Floats:
    """Return the part of the Hessian (16, 16) that no state changes: inputs and their changes."""
    h = HORIZON
    change = np.eye(h) - np.eye(h, k=-1)
    change[0, 0] = 0.0
    fixed = np.zeros((2 * h, 2 * h))
    fixed[:h, :h] = weights.accel * np.eye(h) + weights.accel_change * change.T @ change
    fixed[h:, h:] = weights.steer * np.eye(h) + weights.steer_change * change.T @ change
    return fixed


def _nearest(state: Floats, discs: Floats) -> Floats:
    """Return the discs with the nearest edges, at most four, in their given order."""
    if len(discs) <= _NEAREST:
        return discs
    away = np.hypot(discs[:, 0] - state[0], discs[:, 1] - state[1]) - discs[:, 2]
    return discs[np.sort(np.argsort(away, kind="stable")[:_NEAREST])]


def _normals(nominal: Floats, discs: Floats) -> Floats:
    """Return the outward normal of each disc's and each stage's half-plane, shape (discs, 8, 2).

    If the nominal path runs through a disc, the last normal before the disc holds to the end of the
    horizon. A normal inside or behind the disc would turn round, and the soft constraint would pull
    the vehicle through.
    """
    away = nominal[:, :2] - discs[:, None, :2]
    far = np.hypot(away[:, :, 0], away[:, :, 1])
    within = far[:, 1:] < discs[:, 2:] - _GRAZE_M
    normals: Floats = away / np.where(far > 0.0, far, 1.0)[:, :, None]
    for number in np.flatnonzero(within.any(axis=1)):
        last = int(within[number].argmax())
        normals[number, last + 1 :] = normals[number, last]
    return normals[:, 1:]


def _discs(obstacles: npt.ArrayLike) -> Floats:
    discs = np.asarray(obstacles, dtype=np.float64)
    if discs.size and (discs.ndim != 2 or discs.shape[1] != 3):
        raise StateError(f"obstacles have shape {discs.shape}: each is x, y and radius, so n of them have shape (n, 3)")
    discs = discs.reshape(-1, 3)
    bad = ~np.isfinite(discs).all(axis=1)
    if bad.any():
        number = int(bad.argmax())
        raise StateError(f"obstacle {number} is {discs[number].tolist()}: x, y and radius have to be finite, in metres")
    return discs


def _require_finite(state: State, target: Target) -> None:
    for name, value in {**asdict(state), **{f"target {name}": one for name, one in asdict(target).items()}}.items():
        if not math.isfinite(value):
            raise StateError(f"{name} is {value}: the controller needs a finite state")
