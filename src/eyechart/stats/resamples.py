"""Results by chance alone: permutation p values and Holm's correction."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from eyechart.stats.margins import random_tables
from eyechart.stats.statistic import TIE, Statistic, not_available

Floats = npt.NDArray[np.float64]


def permutation_p(exceedances: int, resamples: int) -> float:
    """Return (k+1)/(B+1), the p of a test by random permutation (Phipson and Smyth 2010).

    ``exceedances`` k counts the B ``resamples`` at least as extreme as the data. The smallest value
    is 1/(B+1), never 0. ValueError unless 0 <= k <= B and B >= 1.
    """
    if not 0 <= exceedances <= resamples or resamples < 1:
        raise ValueError(f"need 0 <= exceedances <= resamples, got {exceedances} of {resamples}")
    return (exceedances + 1) / (resamples + 1)


def permute_mutual_information(tables: npt.ArrayLike, *, seed: int, resamples: int = 5000) -> Statistic:
    """Test mutual information by i.i.d. permutation of the labels (the paper's rule).

    ``tables`` is a matrix of counts, or a stack of shape (strata, rows, columns) over the same rows
    and columns. With a stack, labels are permuted within each stratum, and the information is that
    of the summed table. ``value`` is the plug-in information in bits, ``p`` one-sided (k+1)/(B+1).
    One row or one column: value 0, p 1; no observations: None. It treats frames as independent.
    Across autocorrelated episodes it rejects far too often, see
    `episode_permutation.exchange_mi_test`.
    """
    stack = _stack(tables)
    total = stack.sum(axis=0)
    n = int(total.sum())
    method = f"mutual information in bits, i.i.d. permutation, B={resamples}"
    if n == 0:
        return not_available("the table is empty", method=method)
    if min(np.count_nonzero(total.sum(axis=1)), np.count_nonzero(total.sum(axis=0))) < 2:
        note = "one row or one column: nothing can depend on it"
        return Statistic(0.0, n, p=1.0, method=method, note=note, unit="bits")
    xlogx = _xlogx(n)
    resampled = xlogx[_random_tables(stack, resamples, seed)].sum(axis=(1, 2))
    observed = float(xlogx[total].sum())
    rows, columns = xlogx[total.sum(axis=1)].sum(), xlogx[total.sum(axis=0)].sum()
    constant = float(xlogx[n] - rows - columns)
    extreme = int(np.count_nonzero(resampled >= observed - TIE * max(1.0, abs(observed))))
    p = permutation_p(extreme, resamples)
    detail = {"resample_mean": max(0.0, (float(resampled.mean()) + constant) / n)}
    return Statistic(max(0.0, (observed + constant) / n), n, p=p, method=method, detail=detail, unit="bits")


def permute_agreement(table: npt.ArrayLike, *, seed: int, resamples: int = 5000) -> Statistic:
    """Return the expected agreement of two series with one of them in random order.

    ``table``, shape (k, k), counts how often label i of one meets label j of the other. ``value``
    is the exact expectation over random orders, and ``ci`` holds 95 % of the ``resamples`` orders.
    ``p`` is one-sided, (k+1)/(B+1): for an order that agrees at least as often as the observed one,
    which is in ``detail``. None for an empty table. Source: paper, section Results (decision-level
    replay).
    """
    counts = np.asarray(table, dtype=np.int64)
    n, method = int(counts.sum()), f"the same decisions in random order, 95% of {resamples} orders"
    if n == 0:
        return not_available("no decisions to compare", method=method)
    drawn = np.trace(_random_tables(_stack(counts), resamples, seed), axis1=1, axis2=2)
    observed = int(np.trace(counts))
    low, high = (float(edge) / n for edge in np.quantile(drawn, [0.025, 0.975]))
    detail = {"labels": len(counts), "observed": observed / n}
    p = permutation_p(int(np.count_nonzero(drawn >= observed)), resamples)
    expected = float(counts.sum(axis=1) @ counts.sum(axis=0)) / n**2
    # If nearly all orders agree equally often, the mean may lie outside the quantiles.
    ci = min(low, expected), max(high, expected)
    return Statistic(expected, n, ci, p, method, detail=detail)


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Return Holm's adjusted p values in the given order (Holm 1979).

    A None (no test) stays None and does not count in the size of the family. A constant model that
    belongs to the family enters with p = 1. Equals R ``p.adjust(p, "holm")`` on the others.
    ValueError for a p outside [0, 1].
    """
    made = [(p, place) for place, p in enumerate(p_values) if p is not None]
    for p, place in made:
        if not 0 <= p <= 1:
            raise ValueError(f"p value number {place} is {p}: it must lie between 0 and 1")
    adjusted: list[float | None] = [None] * len(p_values)
    largest = 0.0
    for rank, (p, place) in enumerate(sorted(made)):
        largest = max(largest, min(1.0, (len(made) - rank) * p))
        adjusted[place] = largest
    return adjusted


def ratio_of_sums(sums: Floats) -> Floats:
    """Return the ratio of two sums, shape (resamples,), NaN if the second is 0.

    ``sums`` has shape (resamples, 2): with columns (disagreements, frames) it is a pooled rate.
    """
    out = np.full(len(sums), np.nan)
    np.divide(sums[:, 0], sums[:, 1], out=out, where=sums[:, 1] != 0)
    return out


def _stack(tables: npt.ArrayLike) -> npt.NDArray[np.int64]:
    given = np.asarray(tables)
    if given.ndim not in (2, 3) or given.dtype.kind not in "iu" or (given < 0).any():
        raise ValueError(
            f"give a matrix of integer counts or a stack of them, got {given.dtype} of shape {given.shape}"
        )
    return given.astype(np.int64).reshape(-1, *given.shape[-2:])


def _random_tables(stack: npt.NDArray[np.int64], resamples: int, seed: int) -> npt.NDArray[np.int64]:
    """Return tables with the same margins, summed over strata; (resamples, rows, columns)."""
    if resamples < 1:
        raise ValueError(f"resamples={resamples}: ask for at least one")
    rng = np.random.default_rng(seed)
    out = np.zeros((resamples, *stack.shape[1:]), dtype=np.int64)
    for table in stack:
        rows, columns = table.sum(axis=1), table.sum(axis=0)
        r, c = np.flatnonzero(rows), np.flatnonzero(columns)
        if min(len(r), len(c)) < 2:
            out += table
            continue
        out[:, r[:, None], c[None, :]] += random_tables(rows[r], columns[c], resamples, rng)
    return out


def _xlogx(n: int) -> Floats:
    """Return k log2 k for k = 0..n."""
    k = np.arange(n + 1, dtype=np.float64)
    return k * np.log2(np.maximum(k, 1.0))
