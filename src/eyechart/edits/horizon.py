"""The horizon from boxes and distances alone: a box's foot stands at horizon + k / (d + c).

The line is fitted robustly over a bank, so no calibration is needed. Its residuals tell slopes,
wrong distances and wrong boxes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

LEAST_BOXES = 24
"""Fewer boxes do not fix a horizon."""

LEAST_SPAN = 3.0
"""The factor that their distances must span."""

MOST_SPREAD = 0.01
"""The most spread about the line, as a share of the picture's rows."""

_CUT = 1.5
"""Residuals beyond this many spreads count for less (Huber)."""

_ROUNDS = 12
_MOST_BEHIND_M = 5.0
_FOOT_PX, _DISTANCE = 0.5, 0.05
"""The errors that are expected: of a foot in pixels, and of a distance as a share of itself."""

_LEAST_BEHIND_M, _SURE = 0.3, 4.0
"""A camera behind the measured point is believed from this distance on, and so many standard errors.
Whole pixels alone look like 0.2 m."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Fit:
    """The line of a bank's boxes: foot = ``horizon`` + ``slope`` / (distance + ``behind_m``).

    ``horizon`` is the row, or its distance from the given rows. ``slope`` is focal length times
    camera height, in px·m. ``spread`` is the robust standard deviation of the feet, in pixels, and
    ``error`` the standard error of the horizon, both over ``boxes`` boxes.
    """

    horizon: float
    slope: float
    behind_m: float
    spread: float
    error: float
    boxes: int

    def foot(self, horizon: float, distance_m: float) -> float:
        """Return the row where a foot at this distance stands, under a horizon."""
        return horizon + self.slope / (distance_m + self.behind_m)


def fit_horizon(feet: Sequence[float], distances_m: Sequence[float], *, free: bool = True) -> Fit | None:
    """Return the line through feet (rows, or rows below given horizons) over distances in metres.

    Without ``free`` it goes through 0, as below given horizons. None stands for fewer than two
    boxes, or equal distances.
    """
    rows, away = np.asarray(feet, np.float64), np.asarray(distances_m, np.float64)
    if len(rows) < 2 or away.min() <= 0 or (free and np.ptp(1 / away) < 1e-9):
        return None
    plain = _line(rows, away, 0.0, free=free)
    if not free or not _spans(away):
        return plain
    start = (plain.horizon, plain.slope, 0.0)
    found = least_squares(
        lambda three: (rows - three[0] - three[1] / (away + three[2])) / _expected(rows - plain.horizon),
        start,
        bounds=([-np.inf, -np.inf, max(-_MOST_BEHIND_M, 0.2 - away.min())], [np.inf, np.inf, _MOST_BEHIND_M]),
        loss="soft_l1",
        x_scale=(1.0, max(abs(plain.slope), 1.0), 1.0),
    )
    behind_m, loss = float(found.x[2]), 2 * found.cost / max(len(rows) - 3, 1)
    error = float(np.sqrt(np.linalg.pinv(found.jac.T @ found.jac)[2, 2] * loss))
    sure = abs(behind_m) > max(_LEAST_BEHIND_M, _SURE * error)
    return _line(rows, away, behind_m, free=free) if sure else plain


def _expected(below: _Floats) -> _Floats:
    """Return the error that is expected of feet so far below the horizon, in pixels."""
    return _FOOT_PX + _DISTANCE * np.maximum(below, 0.0)


def _spans(distances_m: _Floats) -> bool:
    return len(distances_m) >= LEAST_BOXES and distances_m.max() >= LEAST_SPAN * distances_m.min()


def why_not_fixed(fit: Fit | None, distances_m: Sequence[float], rows: int) -> str:
    """Return why boxes do not fix a horizon for pictures of so many rows, empty if they do."""
    if fit is None or len(distances_m) < LEAST_BOXES:
        return f"{len(distances_m)} whole boxes with a distance, and {LEAST_BOXES} are needed"
    if max(distances_m) < LEAST_SPAN * min(distances_m):
        return f"the boxes' distances span a factor of {max(distances_m) / min(distances_m):.1f}, not {LEAST_SPAN:g}"
    if fit.spread > MOST_SPREAD * rows:
        return f"the feet of the boxes lie {fit.spread:.1f} px about their line, more than {MOST_SPREAD * rows:.1f}"
    if fit.slope <= 0:
        return "nearer boxes do not stand lower"
    return ""


def _line(rows: _Floats, away: _Floats, behind_m: float, *, free: bool) -> Fit:
    """Return the robust line for one distance of the camera behind the measured point."""
    inverse = 1 / (away + behind_m)
    design = np.column_stack([np.ones_like(inverse), inverse]) if free else inverse[:, None]
    expected, weight = np.ones(len(rows)), np.ones(len(rows))
    for _ in range(_ROUNDS):
        scale = weight / expected
        solution = np.linalg.lstsq(design * scale[:, None], rows * scale, rcond=None)[0]
        horizon = float(solution[0]) if free else 0.0
        expected = _expected(rows - horizon)
        residual = np.abs(rows - design @ solution) / expected
        times = 1.4826 * float(np.median(residual)) + 1e-6
        weight = np.sqrt(1 / np.maximum(1.0, residual / (_CUT * times)))
    scale = weight / expected
    covariance = np.linalg.pinv((design * scale[:, None]).T @ (design * scale[:, None])) * times**2
    spread = 1.4826 * float(np.median(np.abs(rows - design @ solution)))
    return Fit(horizon, float(solution[-1]), behind_m, spread, float(np.sqrt(covariance[0, 0])), len(rows))
