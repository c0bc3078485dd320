"""The association of two columns of labels: tables, Cramér's V and mutual information."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from eyechart.stats.statistic import Statistic, not_available, special_functions

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Contingency:
    """Joint counts of two labels: ``table[i, j]`` frames have ``rows[i]`` and ``columns[j]``."""

    table: npt.NDArray[np.int64]
    rows: tuple[str | int, ...]
    columns: tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Bins:
    """Bins of a number: one code per value, the upper inner edges, and each bin's number of values.

    Bin i holds values above ``edges[i-1]`` and up to ``edges[i]`` included. If ``no_lead_bin`` is
    true, the last bin holds the missing or infinite values.
    """

    codes: npt.NDArray[np.int64]
    edges: tuple[float, ...]
    sizes: tuple[int, ...]
    no_lead_bin: bool


def contingency(first: npt.ArrayLike, second: npt.ArrayLike) -> Contingency:
    """Return the contingency table of two label arrays, rows and columns in sorted order.

    One-dimensional string or integer arrays of one length, paired by position. ValueError on
    anything else: a missing label must be dropped or encoded before.
    """
    a, b = labels_of(first, "first"), labels_of(second, "second")
    if len(a) != len(b):
        raise ValueError(f"{len(a)} labels against {len(b)}: give both for the same frames")
    (rows, i), (columns, j) = numbered(a), numbered(b)
    flat = np.bincount(i * len(columns) + j, minlength=len(rows) * len(columns))
    table = flat.reshape(len(rows), len(columns)).astype(np.int64)
    return Contingency(table, tuple(rows.tolist()), tuple(columns.tolist()))


def numbered(labels: npt.NDArray[np.generic]) -> tuple[npt.NDArray[np.generic], npt.NDArray[np.int64]]:
    """Return the labels that occur, sorted, and of each the place; small whole numbers are not sorted."""
    if labels.dtype.kind != "i" or not len(labels) or labels.min() < 0 or labels.max() > len(labels):
        found, places = np.unique(labels, return_inverse=True)
        return found, places.astype(np.int64)
    occurs = np.bincount(labels) > 0
    return np.flatnonzero(occurs), (np.cumsum(occurs) - 1)[labels]


@dataclass(frozen=True, slots=True)
class Association(Statistic):
    """An association of answers with groups, and the number of groups."""

    groups: int = field(default=0, repr=False)


def chi2_test(table: npt.ArrayLike, *, correction: bool = True) -> Statistic:
    """Return the chi-squared statistic of independence and its p.

    ``table`` is a matrix of counts; empty rows and columns are dropped. Then it equals
    `scipy.stats.chi2_contingency` (``correction``: Yates', which acts on 2 x 2 tables only).
    A table of one row or one column has no dependence to show: value 0, p 1. No observations: value
    None. ``detail``: degrees of freedom, the shape used and the smallest expected count.
    """
    counts = _occupied(table)
    n, method = int(counts.sum()), "chi-squared test of independence" + (", Yates" if correction else "")
    if n == 0:
        return not_available("the table is empty", method=method)
    if min(counts.shape) == 1:
        detail: dict[str, object] = {"dof": 0, "shape": list(counts.shape), "smallest_expected": None}
        note = "one row or one column: nothing can depend on it"
        return Statistic(0.0, n, p=1.0, method=method, note=note, detail=detail)
    special = special_functions()

    expected = counts.sum(axis=1, keepdims=True) * counts.sum(axis=0) / n
    dof, apart = (counts.shape[0] - 1) * (counts.shape[1] - 1), np.abs(counts - expected)
    if correction and dof == 1:
        apart -= np.minimum(0.5, apart)
    value = float((apart**2 / expected).sum())
    detail = {"dof": dof, "shape": list(counts.shape), "smallest_expected": float(expected.min())}
    return Statistic(value, n, p=float(special.chdtrc(dof, value)), method=method, detail=detail)


def cramers_v(table: npt.ArrayLike, *, correction: bool = True) -> Statistic:
    """Return Cramér's V, sqrt(chi2 / (n (min(rows, columns) - 1))), with the p of `chi2_test`.

    ``table``, a matrix of counts, and ``correction`` as there; the paper's V carries Yates'
    correction. One row or one column: V = 0, p = 1. Source: section The Input-Ablation Battery.
    """
    chi2 = chi2_test(table, correction=correction)
    if chi2.value is None or chi2.detail is None:
        return not_available(chi2.note, method="Cramér's V")
    groups, answers = _occupied(table).shape
    shorter = min(groups, answers)
    v = math.sqrt(chi2.value / (chi2.n * (shorter - 1))) if shorter > 1 else 0.0
    detail = {"chi2": chi2.value, **chi2.detail}
    method = f"Cramér's V, {chi2.method}"
    return Association(v, chi2.n, p=chi2.p, method=method, note=chi2.note, detail=detail, groups=groups)


def entropy_bits(labels: npt.ArrayLike) -> Statistic:
    """Return the plug-in entropy of a label array in bits; None for an empty one.

    ``labels`` is a one-dimensional string or integer array. ``detail["labels"]`` is how many occur.
    """
    names, counts = np.unique(labels_of(labels, "given"), return_counts=True)
    n, method = int(counts.sum()), "plug-in entropy, bits"
    if n == 0:
        return not_available("no observations", method=method)
    shares = counts / n
    entropy = max(0.0, -float((shares * np.log2(shares)).sum()))
    return Statistic(entropy, n, method=method, detail={"labels": len(names)}, unit="bits")


def modal_share(labels: npt.ArrayLike) -> Statistic:
    """Return the share of the most frequent label; None for an empty array.

    ``labels`` as for `entropy_bits`. ``detail["mode"]`` is that label, the first in sorted order in
    a tie. It carries no interval: which label is the mode is itself chosen from the data.
    """
    names, counts = np.unique(labels_of(labels, "given"), return_counts=True)
    n, method = int(counts.sum()), "share of the most frequent label"
    if n == 0:
        return not_available("no observations", method=method)
    most = int(counts.argmax())
    return Statistic(int(counts[most]) / n, n, method=method, detail={"mode": names[most].item()})


def quantile_bins(
    values: Sequence[float | None] | npt.NDArray[np.float64], bins: int = 4, *, no_lead_bin: bool = False
) -> Bins:
    """Bin a gap by its quantiles, without duplicate edges, so that equal gaps share a bin.

    ``values`` are gaps in metres, one per frame; None, NaN and +inf mean no lead. Without a lead a
    frame counts as the farthest gap. With ``no_lead_bin`` such frames have the last bin, and the
    quantiles are of the others. Inner edges belong to the bin below, as in ``pandas.qcut(values,
    bins, duplicates="drop")``. ValueError on -inf or fewer than one bin.
    """
    gap = np.array([math.nan if value is None else value for value in values], dtype=np.float64)
    if bins < 1:
        raise ValueError(f"bins={bins}: ask for at least one")
    if np.isneginf(gap).any():
        raise ValueError(f"gap number {int(np.isneginf(gap).argmax())} is -inf: a gap is a distance in metres")
    none = ~np.isfinite(gap)
    farthest = gap[~none].max() if (~none).any() else 0.0
    gap[none] = farthest + 1.0  # any number beyond the farthest gives the same codes
    known = gap[~none] if no_lead_bin else gap
    inner = np.unique(np.quantile(known, np.linspace(0, 1, bins + 1)))[1:-1] if len(known) else np.zeros(0)
    codes = np.searchsorted(inner, gap, side="left").astype(np.int64)
    last = no_lead_bin and bool(none.any())
    if last:
        codes[none] = len(inner) + 1 if (~none).any() else 0
    sizes = np.bincount(codes) if len(codes) else np.zeros(0, dtype=np.int64)
    return Bins(codes, tuple(inner.tolist()), tuple(sizes.tolist()), last)


def cramers_v_of_tables(tables: Floats, *, correction: bool = True) -> Floats:
    """Return Cramér's V of each table, shape (m, rows, columns); NaN for an empty one.

    It equals `cramers_v`. Tables of 2 × 2 have Yates' ``correction``.
    """
    if correction and tables.shape[1:] == (2, 2):
        return _phi(tables)
    rows, columns, n = tables.sum(axis=2), tables.sum(axis=1), tables.sum(axis=(1, 2))
    expected = rows[:, :, None] * columns[:, None, :]
    share = np.divide(tables**2, expected, out=np.zeros_like(tables), where=expected > 0).sum(axis=(1, 2))
    shorter = np.minimum((rows > 0).sum(axis=1), (columns > 0).sum(axis=1)) - 1
    v = np.sqrt(np.maximum(share - 1, 0) / np.maximum(shorter, 1))
    return np.where((n > 0), np.where(shorter > 0, v, 0.0), np.nan)


def _phi(tables: Floats) -> Floats:
    """Return V of each table of 2 × 2, with Yates' correction."""
    rows, columns, n = tables.sum(axis=2), tables.sum(axis=1), tables.sum(axis=(1, 2))
    apart = np.abs(tables[:, 0, 0] * tables[:, 1, 1] - tables[:, 0, 1] * tables[:, 1, 0])
    margins = rows.prod(axis=1) * columns.prod(axis=1)
    v = np.maximum(apart - n / 2, 0) / np.sqrt(np.where(margins > 0, margins, 1.0))
    return np.where(n > 0, np.where(margins > 0, v, 0.0), np.nan)


def information_of_tables(tables: Floats) -> Floats:
    """Return the plug-in mutual information of tables (m, rows, columns) in bits; NaN if empty."""
    n = tables.sum(axis=(1, 2))
    inner = (
        _xlogx(tables).sum(axis=(1, 2))
        - _xlogx(tables.sum(axis=2)).sum(axis=1)
        - _xlogx(tables.sum(axis=1)).sum(axis=1)
    )
    return np.where(n > 0, np.maximum(0.0, inner / np.maximum(n, 1) + np.log2(np.maximum(n, 1))), np.nan)


def entropy_of_counts(counts: Floats) -> Floats:
    """Return the entropy of each row of counts, shape (m, labels), in bits; NaN if empty."""
    n = counts.sum(axis=1)
    return np.where(n > 0, np.log2(np.maximum(n, 1)) - _xlogx(counts).sum(axis=1) / np.maximum(n, 1), np.nan)


def _xlogx(counts: Floats) -> Floats:
    return np.asarray(counts * np.log2(np.maximum(counts, 1.0)))


def labels_of(values: npt.ArrayLike, which: str) -> npt.NDArray[np.generic]:
    """Return one label per frame; ValueError unless strings or integers of one dimension."""
    array = np.asarray(values)
    if array.ndim != 1:
        raise ValueError(f"the {which} labels have shape {array.shape}: give one label per frame")
    if array.size and array.dtype.kind not in "iubU":
        raise ValueError(
            f"the {which} labels are of type {array.dtype}: give strings or integers, "
            f"a missing one dropped or as a label of its own"
        )
    return array


def _occupied(table: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Return the table as integers without its empty rows and columns."""
    given = np.asarray(table)
    if given.ndim != 2 or given.dtype.kind not in "iuf" or (given < 0).any() or (given != given.round()).any():
        raise ValueError(f"a contingency table is a matrix of counts, got shape {given.shape}: {given!r}")
    counts = given.astype(np.int64)
    counts = counts[counts.sum(axis=1) > 0]
    return np.asarray(counts[:, counts.sum(axis=0) > 0], dtype=np.int64)


def pair_table(first: npt.NDArray[np.generic], second: npt.NDArray[np.generic]) -> tuple[list[object], Ints]:
    """Return the labels of two columns of one length, and the square table of their pairs."""
    names, codes = np.unique(np.concatenate([first, second]), return_inverse=True)
    flat = codes[: len(first)] * len(names) + codes[len(first) :]
    counts = np.bincount(flat, minlength=len(names) ** 2).reshape(len(names), len(names))
    return names.tolist(), counts.astype(np.int64)
