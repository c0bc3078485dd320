"""Memory: whether two answers to one moment differ by chance, or with the call before each."""

import numpy as np
import numpy.typing as npt

from eyechart.stats.statistic import Statistic, not_available

RESAMPLES = 999
_LEAST = 20
"""Calls needed for each number that describes the call before; fewer give no fit."""


def memory_share(apart: npt.ArrayLike, before: npt.ArrayLike, *, seed: int) -> Statistic:
    """Return the share of the differences between answers that goes with the call before.

    ``apart``, shape (n, d), is each answer's deviation from its moment's mean. ``before``, shape
    (n, f), describes the call before. The value is the adjusted share of variance of a linear fit.

    Calls are in random order, so without memory any call may precede any other. p is from random
    reassignments of the calls before, (j + 1) / (B + 1). None if there are too few calls, or if
    nothing differs.
    """
    e, f = (np.asarray(one, np.float64) for one in (apart, before))
    method = "adjusted share of a linear fit on the call before; the calls before are dealt out anew"
    f = f[:, f.std(axis=0) > 1e-9] if len(f) else f
    n = len(e)
    if not f.size or n < _LEAST * (f.shape[1] + 1):
        return not_available("too few calls with a known one before", n, method)
    whole = float((e**2).sum())
    if not whole > 0:
        return not_available("the answers to one moment are all the same", n, method)
    base = np.linalg.svd(np.column_stack([np.ones(n), f]), full_matrices=False)
    kept = base[0][:, base[1] > 1e-9 * base[1][0]]
    observed = float(((kept.T @ e) ** 2).sum())
    rng = np.random.default_rng(seed)
    drawn = sum(float(((kept[rng.permutation(n)].T @ e) ** 2).sum()) >= observed for _ in range(RESAMPLES))
    left = n - kept.shape[1]
    value = 1 - (1 - observed / whole) * n / left
    return Statistic(value, n, p=(drawn + 1) / (RESAMPLES + 1), method=method)
