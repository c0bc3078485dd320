"""Correlation of two columns: Pearson's r and Spearman's rank correlation, with interval and p."""

import math
from dataclasses import dataclass, field
from itertools import permutations
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from eyechart.stats.statistic import TIE, Statistic, not_available

EXACT_UP_TO = 9
"""Up to this number of pairs Spearman's p is exact, over all orders (362 880 of nine)."""

FEWEST = 4
"""Fewer pairs carry no interval: Fisher's z has a standard error of 1 / sqrt(n - 3)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Correlation(Statistic):
    """A correlation with ``how`` its p was computed, and its exact p if that differs."""

    how: str = field(repr=False)
    p_exact: float | None = None


def pearson_p(r: float, n: int, *, level: float = 0.95) -> Statistic:
    """Return a Pearson correlation ``r`` of ``n`` pairs with its two-sided t-test p.

    The interval is Fisher's z; None below four pairs or at r = +-1. Equals
    ``scipy.stats.pearsonr``. p is None below three pairs. ValueError when r is outside [-1, 1].
    """
    if not -1 <= r <= 1:
        raise ValueError(f"r={r} is no correlation: give a number between -1 and 1")
    method = f"Pearson correlation, two-sided t test, {100 * level:g}% Fisher interval"
    if n < 3:
        return Statistic(r, n, method=method, note="three pairs are needed for a test")
    if abs(r) == 1:
        return Statistic(r, n, p=0.0, method=method)
    from scipy import special  # noqa: PLC0415 - slow to import

    t = abs(r) * math.sqrt((n - 2) / (1 - r * r))
    p = 2 * float(special.stdtr(n - 2, -t))
    if n < 4:
        return Statistic(r, n, p=p, method=method)
    return Statistic(r, n, _fisher(r, 1 / math.sqrt(n - 3), level), p, method, level=level)


def pearson(x: npt.ArrayLike, y: npt.ArrayLike, *, level: float = 0.95) -> Statistic:
    """Return Pearson's r of two columns, with Fisher's interval and the two-sided p of the t test.

    ``n`` counts pairs. Equals ``scipy.stats.pearsonr`` and R ``cor.test``. With at most nine pairs
    it also has ``p_exact``, over all orders of one column, which assumes no normality. The value is
    None below four pairs and for a constant column. Source: paper, section Transfer and deployment
    characteristics, with the p of the t test.
    """
    one, other = _columns(x, y)
    if why := _undefined(one, other):
        return not_available(why, len(one), "Pearson correlation")
    statistic = pearson_p(float(np.clip(np.corrcoef(one, other)[0, 1], -1, 1)), len(one), level=level)
    exact = _exact_p(one, other) if len(one) <= EXACT_UP_TO else None
    return Correlation(
        statistic.value,
        statistic.n,
        statistic.ci,
        statistic.p,
        statistic.method,
        level=statistic.level,
        how="t test",
        p_exact=exact,
    )


def spearman(x: npt.ArrayLike, y: npt.ArrayLike, *, level: float = 0.95) -> Statistic:
    """Return Spearman's rank correlation, the interval of Bonett and Wright (2000), two-sided p.

    With at most nine pairs p is exact, over all orders of one column; beyond, it is the t
    approximation. Ties have mean ranks. The value is None below four pairs and for a constant
    column.
    """
    one, other = _columns(x, y)
    exact = len(one) <= EXACT_UP_TO
    over = f"exact over {math.factorial(len(one))} orders" if exact else "t approximation"
    method = f"Spearman's rank correlation, two-sided p ({over}), {100 * level:g}% interval of Bonett and Wright"
    if why := _undefined(one, other):
        return not_available(why, len(one), method)
    from scipy.stats import rankdata, spearmanr  # noqa: PLC0415 - slow to import

    rho, p = (float(number) for number in spearmanr(one, other))
    if exact:
        p = _exact_p(rankdata(one), rankdata(other))
    error = math.sqrt((1 + rho**2 / 2) / (len(one) - 3))
    how = "exact, over all orders" if exact else "t approximation"
    return Correlation(rho, len(one), _fisher(rho, error, level), p, method, level=level, how=how)


def _columns(x: npt.ArrayLike, y: npt.ArrayLike) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    one, other = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if one.ndim != 1 or one.shape != other.shape or not (np.isfinite(one).all() and np.isfinite(other).all()):
        raise ValueError(f"two columns of finite numbers of one length are needed, got {one.shape} and {other.shape}")
    return one, other


def _undefined(one: npt.NDArray[np.float64], other: npt.NDArray[np.float64]) -> str | None:
    if len(one) < FEWEST:
        return f"{len(one)} pairs are too few for a correlation; {FEWEST} are the least"
    if np.ptp(one) == 0 or np.ptp(other) == 0:
        return "one of the two columns is constant"
    return None


def _fisher(r: float, error: float, level: float) -> tuple[float, float] | None:
    if abs(r) >= 1:
        return None
    half = NormalDist().inv_cdf(0.5 + level / 2) * error
    return (math.tanh(math.atanh(r) - half), math.tanh(math.atanh(r) + half))


def _exact_p(one: npt.NDArray[np.float64], other: npt.NDArray[np.float64]) -> float:
    """Return the share of all orders with a correlation at least as far from 0 as observed."""
    centred, against = one - one.mean(), other - other.mean()
    orders = np.array(list(permutations(range(len(one)))), dtype=np.int8)
    sums = np.abs(centred[orders] @ against)
    observed = abs(centred @ against)
    return float((sums >= observed - TIE * max(1.0, observed)).mean())
