"""Intervals over episodes: each episode is left out once, and Student's t says how far these values reach."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from eyechart.stats.association import cramers_v_of_tables
from eyechart.stats.statistic import Statistic, cannot_say

Floats = npt.NDArray[np.float64]

LEAST_EPISODES = 6
"""Of fewer episodes no interval but a share's is printed: none was measured to cover (benchmarks/long_coverage.py)."""

_ALONE = "no interval: without one of the episodes nothing is left"

FEW = f"an interval needs {LEAST_EPISODES} episodes or more"

_UNSEEN = 0.5
"""So much of an episode in which every answer is as frequent, whatever was shown, stands for what was not seen."""

ENDS = 0.90
"""The level of an interval of which each end is a bound of its own, at .05."""

_SKEW = 0.35
"""Ends are moved out by this share of the square of their distance, over what lies between the value and the bound. Measured, as the other is."""


def over_tables(
    tables: npt.ArrayLike, statistic: Callable[[Floats], Floats], most: float, *, level: float = 0.95
) -> Statistic:
    """Return a statistic of summed tables, such as information, V or entropy, with an interval over episodes.

    ``tables``, shape (episodes, rows, columns), counts each episode; ``statistic`` maps (m, rows,
    columns) to (m,) and lies between 0 and ``most``. Such a statistic is biased away from
    independence, and a resample more so: the interval stands around the jackknife's value, which is
    not. Its width is that of the values without each episode, with episodes - 1 degrees of freedom,
    and of what half an episode of answers that depend on nothing would change, so that episodes
    which do not differ show no certainty. It always holds the value. ``n`` counts episodes; no
    interval below `LEAST_EPISODES`. Source: Quenouille 1956, Tukey 1958.
    """
    counts = np.asarray(tables, dtype=np.float64)
    episodes, method = len(counts), f"{100 * level:g}% interval over episodes (jackknife, t)"
    whole = counts.sum(axis=0, keepdims=True)
    value = float(statistic(whole)[0]) if episodes else np.nan
    if np.isnan(value):
        return cannot_say("the statistic is undefined on these episodes", episodes, method)
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
    """Return Cramér's V of summed tables, ``value``, with its interval: that of its square, as `over_tables` makes it.

    Yates' correction, which the paper's V of 2 × 2 tables carries, is a matter of the test: it
    makes a V of 0 of many that are none. The interval is of the V without it, drawn out to the
    value where that lies below.
    """
    squared = over_tables(tables, lambda each: cramers_v_of_tables(each, correction=False) ** 2, 1.0, level=level)
    if squared.ci is None:
        return replace(squared, value=value)
    low, high = map(math.sqrt, squared.ci)
    return replace(squared, value=value, ci=(min(low, value), max(high, value)))


def over_counts(episodes: int, statistic: Callable[[Floats], Floats], *, level: float = 0.95) -> Statistic:
    """Return a statistic with an interval over episodes, where these are what may be left out.

    ``statistic`` maps counts of shape (m, episodes), how often each episode is taken, to (m,), NaN
    where it is undefined: a mean, or a difference of two runs. ``n`` counts episodes; no interval
    below `LEAST_EPISODES`, nor where the episodes do not differ.
    """
    method = f"{100 * level:g}% interval over episodes (jackknife, t)"
    value = float(statistic(np.ones((1, episodes)))[0]) if episodes else np.nan
    if np.isnan(value):
        return cannot_say("the statistic is undefined on these episodes", episodes, method)
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
    """Return the first sum over the second, of all episodes, with its interval; ``sums`` has shape (episodes, 2)."""
    given = np.asarray(sums, dtype=np.float64).reshape(-1, 2)

    def ratio(counts: Floats) -> Floats:
        above, below = (counts @ given).T
        return np.asarray(np.divide(above, below, out=np.full(len(below), np.nan), where=below > 0))

    return over_counts(len(given), ratio, level=level)


def mean_of_frames(
    scores: npt.ArrayLike, episodes: npt.ArrayLike, *, level: float = ENDS, fewest: int = LEAST_EPISODES
) -> Statistic:
    """Return the mean of scores in [-1, 1], one a frame, with an interval over whole episodes that frames hold up.

    ``scores``, shape (frames,), is NaN where a frame has none; ``episodes`` names each frame's. The
    interval is the jackknife's over the episodes that have scores, with Student's t of one degree
    less than these. No end is nearer than what a share of frames that was never seen may hide: of
    ``n`` frames none shows what, at the level of one end, 1 - tail^(1/n) of all may show (Clopper
    and Pearson 1934), and they may all lie at -1 or 1. ``n`` counts the frames with a score. No
    interval of fewer episodes than ``fewest``, which is two at least.
    """
    given, names = np.asarray(scores, dtype=np.float64), np.asarray(episodes)
    have = ~np.isnan(given)
    n, method = (
        int(np.count_nonzero(have)),
        f"{100 * level:g}% interval over episodes (jackknife, t), held up by frames",
    )
    if not n:
        return cannot_say("no frame has these decisions", method=method)
    sums, frames = by_episode([given[have], np.ones(n)], names[have])
    value, count = float(sums.sum() / n), len(frames)
    if count < fewest:
        return Statistic(value, n, method=method, note=f"an interval needs {fewest} episodes or more", level=level)
    wide = _t(level, count - 1) * _error((sums.sum() - sums) / (n - frames))
    unseen = 1 - ((1 - level) / 2) ** (1 / n)
    ci = value - max(wide, unseen * (1 + value)), value + max(wide, unseen * (1 - value))
    return Statistic(value, n, (max(-1.0, ci[0]), min(1.0, ci[1])), method=method, level=level)


def half_exceeded(
    first: npt.ArrayLike, second: npt.ArrayLike, episodes: npt.ArrayLike, *, level: float = ENDS
) -> Statistic:
    """Return a rate less half of another, with the jackknife's interval over whole episodes.

    ``first`` and ``second``, shape (2, frames), count what happened and how often it could;
    ``episodes`` names each frame's. ``n`` counts how often the first could. No interval of fewer
    episodes than `LEAST_EPISODES`.
    """
    method = f"{100 * level:g}% interval over episodes (jackknife, t)"
    each = by_episode([*np.asarray(first, dtype=np.float64), *np.asarray(second, dtype=np.float64)], episodes)
    whole, count = each.sum(axis=1), each.shape[1]
    n = int(whole[1])
    if not whole[1] or not whole[3]:
        return cannot_say("one of the two could never happen", n, method)

    def apart(sums: Floats) -> Floats:
        return np.asarray(np.divide(*sums[:2]) - np.divide(*sums[2:]) / 2)

    value = float(apart(whole[:, None])[0])
    rest = whole[:, None] - each
    if count < LEAST_EPISODES or (rest[[1, 3]] <= 0).any():
        return Statistic(value, n, method=method, note=FEW if count < LEAST_EPISODES else _ALONE, level=level)
    wide = half_width(apart(rest), level)
    unseen = 1 - (1 - level) ** (1 / np.count_nonzero(np.asarray(first)[1]))  # where no episode differs
    wide = float(wide if wide > 0 else unseen)
    return Statistic(value, n, (value - wide, value + wide), method=method, level=level)


def by_episode(columns: npt.ArrayLike, episodes: npt.ArrayLike) -> Floats:
    """Return the sums of columns, shape (columns, frames), over each episode's frames: shape (columns, episodes)."""
    names, codes = np.unique(np.asarray(episodes), return_inverse=True)
    return np.array([np.bincount(codes, one, len(names)) for one in np.asarray(columns, dtype=np.float64)])


def half_width(left: npt.ArrayLike, level: float) -> float:
    """Return how far Student's t reaches about a value of which ``left``, shape (episodes,), are those without one."""
    values = np.asarray(left, dtype=np.float64)
    return _t(level, len(values) - 1) * _error(values)


def _error(left: Floats) -> float:
    return float(np.sqrt((len(left) - 1) / len(left) * ((left - left.mean()) ** 2).sum()))


def _t(level: float, freedom: int) -> float:
    from scipy import special  # noqa: PLC0415 - slow to import

    return float(special.stdtrit(freedom, (1 + level) / 2))
