"""Intervals over episodes by the jackknife: leave each episode out, then use Student's t."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from eyechart.stats.association import cramers_v_of_tables
from eyechart.stats.statistic import Statistic, not_available, special_functions

Floats = npt.NDArray[np.float64]

LEAST_EPISODES = 6
"""Below this only shares have an interval that covers, as benchmarks/long_coverage.py measures."""

_ALONE = "no interval: without one of the episodes nothing is left"

FEW = f"an interval needs {LEAST_EPISODES} episodes or more"

_UNSEEN = 0.5
"""Allowance for unseen episodes: this part of an episode with all answers equally frequent."""

ENDS = 0.90
"""The level of a two-sided interval whose ends are each one-sided bounds at .05."""

_SKEW = 0.35
"""Allowance for skew: ends move out by this share of their squared distance.

The square is divided by the distance from the value to the bound. The share is measured.
"""


def over_tables(
    tables: npt.ArrayLike, statistic: Callable[[Floats], Floats], most: float, *, level: float = 0.95
) -> Statistic:
    """Return a statistic of summed tables (information, V, entropy), with its interval.

    ``tables``, shape (episodes, rows, columns), counts each episode. ``statistic`` maps (m, rows,
    columns) to (m,) and lies between 0 and ``most``. Such a statistic is biased away from
    independence, and a resample even more, so the interval is centred at the jackknife's value,
    which is not.

    The width comes from the values without each episode, with episodes - 1 degrees of freedom. Half
    an episode of independent answers is added, so that equal episodes do not show certainty. The
    interval always holds the value. ``n`` counts episodes; no interval below `LEAST_EPISODES`.
    Source: Quenouille 1956, Tukey 1958.
    """
    counts = np.asarray(tables, dtype=np.float64)
    episodes, method = len(counts), f"{100 * level:g}% interval over episodes (jackknife, t)"
    whole = counts.sum(axis=0, keepdims=True)
    value = float(statistic(whole)[0]) if episodes else np.nan
    if np.isnan(value):
        return not_available("the statistic is undefined on these episodes", episodes, method)
    if episodes < LEAST_EPISODES:
        return Statistic(value, episodes, method=method, note=FEW, level=level)
    left = statistic(whole - counts)
    if np.isnan(left).any():
        return Statistic(value, episodes, method=method, note=_ALONE, level=level)
    unseen = whole.sum(axis=2, keepdims=True) * (_UNSEEN / episodes / whole.shape[2])
    moved = float(statistic(whole + unseen)[0]) - value
    wide = _t(level, episodes - 1) * float(np.hypot(_error(left), moved))
    middle = min(max(episodes * value - (episodes - 1) * float(left.mean()), 0.0), most)
    below, above = (min(wide, _SKEW * wide**2 / max(room, 1e-9)) for room in (most - value, value))
    ci = max(0.0, min(middle - wide - below, value)), min(max(middle + wide + above, value), max(most, value))
    return Statistic(value, episodes, ci, method=method, level=level)


def association_interval(tables: npt.ArrayLike, value: float, *, level: float = 0.95) -> Statistic:
    """Return Cramér's V of summed tables, ``value``, with the interval of its square.

    `over_tables` makes that interval, for the V without Yates' correction. The paper's V of 2 × 2
    tables has the correction. It belongs to the test and turns small values of V into 0. If the
    value lies below the interval, the interval is extended to it.
    """
    squared = over_tables(tables, lambda each: cramers_v_of_tables(each, correction=False) ** 2, 1.0, level=level)
    if squared.ci is None:
        return replace(squared, value=value)
    low, high = map(math.sqrt, squared.ci)
    return replace(squared, value=value, ci=(min(low, value), max(high, value)))


def over_counts(episodes: int, statistic: Callable[[Floats], Floats], *, level: float = 0.95) -> Statistic:
    """Return a statistic with an interval over episodes, by leaving each episode out.

    ``statistic`` maps counts of shape (m, episodes), how often each episode is taken, to (m,). It
    may be a mean, or a difference of two runs, and is NaN if undefined. ``n`` counts episodes.
    There is no interval below `LEAST_EPISODES`, nor if the episodes do not differ.
    """
    method = f"{100 * level:g}% interval over episodes (jackknife, t)"
    value = float(statistic(np.ones((1, episodes)))[0]) if episodes else np.nan
    if np.isnan(value):
        return not_available("the statistic is undefined on these episodes", episodes, method)
    if episodes < LEAST_EPISODES:
        return Statistic(value, episodes, method=method, note=FEW, level=level)
    left = statistic(1.0 - np.eye(episodes))
    if np.isnan(left).any():
        return Statistic(value, episodes, method=method, note=_ALONE, level=level)
    wide = _t(level, episodes - 1) * _error(left)
    if wide < 1e-12 * max(1.0, abs(value)):
        return Statistic(value, episodes, method=method, note="no interval: the episodes do not differ", level=level)
    return Statistic(value, episodes, (value - wide, value + wide), method=method, level=level)


def mean_over_episodes(sums: npt.ArrayLike, *, level: float = 0.95) -> Statistic:
    """Return the ratio of two sums over all episodes, with its interval; ``sums`` (episodes, 2)."""
    given = np.asarray(sums, dtype=np.float64).reshape(-1, 2)

    def ratio(counts: Floats) -> Floats:
        above, below = (counts @ given).T
        return np.asarray(np.divide(above, below, out=np.full(len(below), np.nan), where=below > 0))

    return over_counts(len(given), ratio, level=level)


def mean_of_frames(
    scores: npt.ArrayLike, episodes: npt.ArrayLike, *, level: float = ENDS, fewest: int = LEAST_EPISODES
) -> Statistic:
    """Return the mean of scores in [-1, 1], one a frame, with an interval that allows for episodes.

    ``scores``, shape (frames,), is NaN for a frame without one; ``episodes`` names each frame's.
    The interval is the jackknife's over episodes with scores, with Student's t. Its degrees of
    freedom are one less than these episodes.

    The interval also allows for unseen frames. If none of ``n`` frames shows something, a share
    1 - tail^(1/n) may show it, at the level of one end (Clopper and Pearson 1934). All of these may
    have the score -1 or 1. ``n`` counts the frames with a score. No interval below ``fewest``
    episodes, at least two.
    """
    given, names = np.asarray(scores, dtype=np.float64), np.asarray(episodes)
    have = ~np.isnan(given)
    n, method = (
        int(np.count_nonzero(have)),
        f"{100 * level:g}% interval over episodes (jackknife, t), held up by frames",
    )
    if not n:
        return not_available("no frame has these decisions", method=method)
    sums, frames = by_episode([given[have], np.ones(n)], names[have])
    value, count = float(sums.sum() / n), len(frames)
    if count < fewest:
        return Statistic(value, n, method=method, note=f"an interval needs {fewest} episodes or more", level=level)
    wide = _t(level, count - 1) * _error((sums.sum() - sums) / (n - frames))
    unseen = 1 - ((1 - level) / 2) ** (1 / n)
    ci = value - max(wide, unseen * (1 + value)), value + max(wide, unseen * (1 - value))
    return Statistic(value, n, (max(-1.0, ci[0]), min(1.0, ci[1])), method=method, level=level)


def excess_over_half(
    first: npt.ArrayLike, second: npt.ArrayLike, episodes: npt.ArrayLike, *, level: float = ENDS
) -> Statistic:
    """Return a rate less half of another, with the jackknife's interval over whole episodes.

    ``first`` and ``second``, shape (2, frames), count events and chances for them; ``episodes``
    names each frame's. ``n`` counts the chances of the first. No interval below `LEAST_EPISODES`
    episodes.
    """
    method = f"{100 * level:g}% interval over episodes (jackknife, t)"
    each = by_episode([*np.asarray(first, dtype=np.float64), *np.asarray(second, dtype=np.float64)], episodes)
    whole, count = each.sum(axis=1), each.shape[1]
    n = int(whole[1])
    if not whole[1] or not whole[3]:
        return not_available("one of the two could never happen", n, method)

    def apart(sums: Floats) -> Floats:
        return np.asarray(np.divide(*sums[:2]) - np.divide(*sums[2:]) / 2)

    value = float(apart(whole[:, None])[0])
    rest = whole[:, None] - each
    if count < LEAST_EPISODES or (rest[[1, 3]] <= 0).any():
        return Statistic(value, n, method=method, note=FEW if count < LEAST_EPISODES else _ALONE, level=level)
    wide = half_width(apart(rest), level)
    # The width if no episode differs.
    unseen = 1 - (1 - level) ** (1 / np.count_nonzero(np.asarray(first)[1]))
    wide = float(wide if wide > 0 else unseen)
    return Statistic(value, n, (value - wide, value + wide), method=method, level=level)


def by_episode(columns: npt.ArrayLike, episodes: npt.ArrayLike) -> Floats:
    """Return the sums of columns (columns, frames) by episode, shape (columns, episodes)."""
    names, codes = np.unique(np.asarray(episodes), return_inverse=True)
    return np.array([np.bincount(codes, one, len(names)) for one in np.asarray(columns, dtype=np.float64)])


def half_width(left: npt.ArrayLike, level: float) -> float:
    """Return the half width of Student's interval; ``left`` are the values without each episode."""
    values = np.asarray(left, dtype=np.float64)
    return _t(level, len(values) - 1) * _error(values)


def _error(left: Floats) -> float:
    return float(np.sqrt((len(left) - 1) / len(left) * ((left - left.mean()) ** 2).sum()))


def _t(level: float, freedom: int) -> float:
    special = special_functions()

    return float(special.stdtrit(freedom, (1 + level) / 2))
