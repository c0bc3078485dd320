"""Exact bounds of a paired difference of proportions, whatever share of pairs differs."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

EXACT_UP_TO = 200
"""The most pairs whose outcomes are enumerated."""

_SHARES = 60
"""So many shares of differing pairs are tried; the least favourable one counts."""
_STEPS = 20
_FEW = 12
"""With so few differing pairs the normal approximation orders outcomes badly."""

Floats = NDArray[np.float64]


def exact_bounds(b: int, c: int, n: int, *, alpha: float = 0.01) -> tuple[float, float] | None:
    """Return exact one-sided bounds at ``alpha`` of the paired difference (b - c)/n.

    ``b`` pairs have only the first outcome, ``c`` only the second, of ``n`` pairs. Without a
    discordant pair the upper bound is 1 - alpha^(1/n). None without pairs, and with more than
    `EXACT_UP_TO`. Raises ValueError if the counts do not fit. Source: Chan and Zhang (1999), with
    outcomes ordered by their estimated p (Lloyd 2008).
    """
    if b < 0 or c < 0 or b + c > n:
        raise ValueError(f"b={b} and c={c} discordant pairs do not fit into n={n} pairs")
    return (-_upper(c, b, n, alpha), _upper(b, c, n, alpha)) if 0 < n <= EXACT_UP_TO else None


def is_bounded(b: int, c: int, n: int, margin: float, *, alpha: float = 0.01) -> bool:
    """Return whether the upper one of these bounds is at most ``margin``, without finding the bound.

    Raises ValueError without pairs, and with more than `EXACT_UP_TO`.
    """
    if not 0 < n <= EXACT_UP_TO:
        raise ValueError(f"outcomes are enumerated for 1 to {EXACT_UP_TO} pairs, not {n}")
    return _p(b, c, n, margin, alpha) <= alpha


@lru_cache(maxsize=256)
def _upper(b: int, c: int, n: int, alpha: float) -> float:
    """Return the greatest difference that the counts do not reject, by bisection."""
    low, high = (b - c) / n, 1.0
    for _ in range(_STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if _p(b, c, n, middle, alpha) > alpha else (low, middle)
    return high


def _p(b: int, c: int, n: int, delta: float, alpha: float) -> float:
    """Return the exact p of the null that the difference is ``delta`` or more."""
    ones, others, _ = _outcomes(n)
    order = _order(n, delta, alpha)
    here = order[(ones == b) & (others == c)][0]
    kept = order <= here + 1e-12
    seconds = (1 - abs(delta)) / 2 * np.linspace(0, 1, _SHARES) ** 2 + max(0.0, -delta)
    return float(max(_chances(n, delta, float(second), kept).sum() for second in seconds))


@lru_cache(maxsize=64)
def _order(n: int, delta: float, alpha: float) -> Floats:
    """Return each outcome's estimated p: normal, and by enumeration where few pairs differ.

    Outcomes without the first kind come before all others where they are rare enough together.
    """
    from scipy.special import ndtr  # noqa: PLC0415 - slow to import

    ones, others, _ = _outcomes(n)
    scores, second = _scores(ones, others, n, delta)
    found = np.asarray(ndtr(scores))
    for place in np.flatnonzero((ones + others <= _FEW) & (scores < -1)):
        found[place] = _chances(n, delta, float(second[place]), scores <= scores[place] + 1e-9).sum()
    return np.where(ones == 0, found - 1, found) if (1 - delta) ** n <= alpha else found


def _chances(n: int, delta: float, second: float, kept: NDArray[np.bool_]) -> Floats:
    """Return the chances of the kept outcomes if the first kind exceeds the ``second`` by delta."""
    ones, others, ways = (each[kept] for each in _outcomes(n))
    logs = ways.copy()
    for count, share in ((ones, delta + second), (others, second), (n - ones - others, 1 - delta - 2 * second)):
        if share > 0:
            logs += count * np.log(share)
        else:
            logs[count > 0] = -np.inf
    return np.asarray(np.exp(logs))


@lru_cache(maxsize=4)
def _outcomes(n: int) -> tuple[Floats, Floats, Floats]:
    """Return every pair of counts that fits into ``n``, and the log of its number of ways."""
    from scipy.special import gammaln  # noqa: PLC0415 - slow to import

    ones, others = (each.astype(float) for each in np.nonzero(np.tri(n + 1, dtype=bool)[::-1]))
    ways = gammaln(n + 1) - gammaln(ones + 1) - gammaln(others + 1) - gammaln(n - ones - others + 1)
    return ones, others, ways


def _scores(b: Floats, c: Floats, n: int, delta: float) -> tuple[Floats, Floats]:
    """Return Tango's score of each outcome, and the likeliest share of the second kind."""
    linear = -(b + c) + (2 * n - b + c) * delta
    root = np.sqrt(np.maximum(linear**2 + 8 * n * c * delta * (1 - delta), 0.0))
    second = (root - linear) / (4 * n)
    variance = n * (2 * second + delta * (1 - delta))
    excess = b - c - n * delta
    with np.errstate(divide="ignore", invalid="ignore"):
        found = excess / np.sqrt(variance)
    flat = variance <= 1e-12 * n
    least, most = max(0.0, -delta), (1 - delta) / 2
    return np.where(flat, np.where(np.abs(excess) <= 1e-9 * n, 0.0, np.copysign(np.inf, excess)), found), np.clip(
        second, least, most
    )
