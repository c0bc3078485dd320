"""Shares and medians over frames, with intervals that allow for similar frames in an episode."""

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from eyechart.stats.agreement import rate
from eyechart.stats.jackknife import FEW, LEAST_EPISODES
from eyechart.stats.statistic import Statistic, not_available, special_functions

Floats = npt.NDArray[np.float64]
EpisodeCounts = tuple[npt.ArrayLike, npt.ArrayLike]
Ends = tuple[float, float]
BoundedValue = tuple[float, Ends]

_NODES = 32
_ANGLE = np.pi / 2 * (np.arange(_NODES) + 0.5) / _NODES
_CONCENTRATION: Floats = 1 / np.tan(_ANGLE) ** 2
_PRIOR: Floats = -np.log(np.cos(_ANGLE)) / 3
"""Logarithms of the prior's weights, up to a constant.

The correlation within an episode is sin² of these angles. The concentration a + b of the beta
distribution is 1/correlation - 1. With these weights the correlation's prior is Beta(1/2, 1/3).
"""

_FADES = 6.0
"""How fast degrees of freedom grow towards 0 and 1; measured, like the prior."""

_UNEVEN = 2.0
"""How much slower if long episodes dominate, by the share that Kish's number takes away."""

_EDGE = 1e-9
_SUMMED = 64
"""Up to this number of frames an episode logarithms are summed; beyond, log gamma is faster."""


def share_over_episodes(hits: npt.ArrayLike, frames: npt.ArrayLike, *, level: float = 0.95) -> Statistic:
    """Return the share of frames that are hits, with an interval that allows for episodes.

    ``hits`` and ``frames``, shape (episodes,), are counts by episode; ``n`` counts the frames. Hits
    are beta-binomial. The correlation within an episode is integrated out of the likelihood over a
    Beta(1/2, 1/3) prior. The interval holds the rates with a likelihood ratio within that of F(1,
    episodes - 1). Near 0 and 1, where rates can spread little, it uses more degrees of freedom.

    An episode has the weight of its frames, and episodes of unequal length count as Kish's
    effective number. If all episodes have the same share, the bound is exact: so many draws without
    one that differs. Episodes of one frame get Wilson's interval; below two episodes there is none.
    ValueError for impossible counts. Measured in docs/decisions/intervals.md.
    """
    k, n = np.asarray(hits, dtype=np.float64), np.asarray(frames, dtype=np.float64)
    if k.ndim != 1 or k.shape != n.shape or not ((k >= 0) & (k <= n)).all() or not 0 < level < 1:
        raise ValueError(f"need 0 <= hits <= frames for each episode and a level in (0, 1), got {k} of {n} at {level}")
    k, n = k[n > 0], n[n > 0]
    method = f"share of frames, {100 * level:g}% interval over episodes"
    if not len(n):
        return not_available("no frames", method=method)
    total, episodes = int(n.sum()), len(n)
    value = float(k.sum() / n.sum())
    detail = {"k": int(k.sum()), "episodes": episodes}
    if episodes < 2:
        return Statistic(value, total, method=method, note="one episode shows no spread", detail=detail, level=level)
    if n.max() == 1:
        alone = rate(detail["k"], total, level=level)
        return Statistic(value, total, alone.ci, method=alone.method, detail=detail, level=level)
    effective = float(n.sum() ** 2 / (n**2).sum())
    if np.ptp(k / n) < 1e-12:
        differ = 1 - (1 - level) ** (1 / effective)
        ci = (value * (1 - differ), value + (1 - value) * differ)
        method += ", exact: no episode differs"
    else:
        cut = _cut(value, effective, episodes, level)
        ci = _by_likelihood(tuple(k.tolist()), tuple(n.tolist()), effective, cut)
        ci = (min(ci[0], value), max(ci[1], value))
        method += " (beta-binomial likelihood, correlation integrated out)"
    return Statistic(value, total, ci, method=method, detail=detail, level=level)


def _cut(value: float, effective: float, episodes: int, level: float) -> float:
    """Return the largest likelihood ratio of a rate, by the effective number of episodes."""
    special = special_functions()

    fades = _FADES * max(0.0, 1 - _UNEVEN * (1 - effective / episodes))
    freedom = effective - 1 + fades * (1 / (4 * value * (1 - value)) - 1)
    return float(special.stdtrit(freedom, (1 + level) / 2) ** 2)


@lru_cache(maxsize=4096)
def _by_likelihood(hits_of: tuple[float, ...], frames: tuple[float, ...], effective: float, cut: float) -> Ends:
    """Return the lowest and the highest rate with a log likelihood within cut/2 of the largest.

    The cache serves counts that recur: of several conditions, and of a run scored again.
    """
    likelihood, points, coarse, top, most = _peak(hits_of, frames, effective)
    least = most - cut / 2
    below, above = points[(points < top) & (coarse < least)], points[(points > top) & (coarse < least)]
    inside = np.array([top, top])
    outside = np.array([below.max(initial=points[0]), above.min(initial=points[-1])])
    for _ in range(20):
        middle = (inside + outside) / 2
        within = likelihood(middle) >= least
        inside, outside = np.where(within, middle, inside), np.where(within, outside, middle)
    low, high = (float(rate) for rate in np.sin(outside) ** 2)
    return low, high


@lru_cache(maxsize=4096)
def _peak(
    hits_of: tuple[float, ...], frames: tuple[float, ...], effective: float
) -> tuple[Callable[[Floats], Floats], Floats, Floats, float, float]:
    """Return the log likelihood of rates, sin² of angles; some angles with theirs; and the largest with its place."""
    k, n = np.array(hits_of), np.array(frames)
    weight = n / n.sum() * effective
    beyond = -_rising(n, weight)(_CONCENTRATION) + _PRIOR
    hits, others = _rising(k, weight), _rising(n - k, weight)

    def likelihood(angle: Floats) -> Floats:
        one, other = (part**2 * _CONCENTRATION for part in (np.sin(angle)[:, None], np.cos(angle)[:, None]))
        together = hits(one) + others(other) + beyond
        return np.asarray(np.logaddexp.reduce(together, axis=1))

    points = np.linspace(_EDGE, np.pi / 2 - _EDGE, 33)
    coarse = likelihood(points)
    top, step = points[coarse.argmax()], points[1] - points[0]
    for _ in range(4):
        near = np.clip(top + step * np.linspace(-1, 1, 9), points[0], points[-1])
        found = likelihood(near)
        top, step = near[found.argmax()], step / 4
    return likelihood, points, coarse, float(top), float(found.max())


def _side_of_half(hits: npt.ArrayLike, frames: npt.ArrayLike, level: float) -> int:
    """Return on which side of one half the interval of a share over episodes lies; 0 where it holds it.

    It is found without the ends, which take most of the time.
    """
    k, n = np.asarray(hits, dtype=np.float64), np.asarray(frames, dtype=np.float64)
    value, effective = float(k.sum() / n.sum()), float(n.sum() ** 2 / (n**2).sum())
    if n.max() == 1 or np.ptp(k / n) < 1e-12:
        ends = share_over_episodes(k, n, level=level).ci
        assert ends is not None  # there are episodes enough
        return int(ends[0] > 0.5) - int(ends[1] < 0.5)
    likelihood, _, _, top, most = _peak(tuple(k.tolist()), tuple(n.tolist()), effective)
    half = np.pi / 4
    if float(likelihood(np.array([half]))[0]) >= most - _cut(value, effective, len(n), level) / 2:
        return 0
    side = int(top > half) - int(top < half)
    return side if side * (value - 0.5) > 0 else 0


def _rising(counts: Floats, weight: Floats) -> Callable[[Floats], Floats]:
    """Return a function of starts: the weighted sum over episodes of a log rising factorial.

    The factorial of an episode is start (start + 1) … (start + count - 1).
    """
    most = int(counts.max())
    if most <= _SUMMED:
        i = np.arange(most)
        reaching = (counts[:, None] > i).T @ weight
        return lambda start: np.asarray(np.log(start[..., None] + i) @ reaching)
    special = special_functions()

    each, place = np.unique(counts, return_inverse=True)
    weights = np.bincount(place, weights=weight)
    return lambda start: np.asarray(
        special.gammaln(start[..., None] + each) @ weights - special.gammaln(start) * weights.sum()
    )


def difference_over_episodes(first: EpisodeCounts, second: EpisodeCounts, *, level: float = 0.95) -> Statistic:
    """Return how much larger one share is than another one of the same episodes, with its interval.

    Each share is given as hits and frames by episode, as for `share_over_episodes`. The ends are
    combined as if the two were independent. Shares of the same frames rise together, so the
    interval is rather wide. If the second share is 0, the interval is the first one's. ``n`` counts
    the frames of the first. No interval below `LEAST_EPISODES` episodes. Source: Zou and Donner
    2008.
    """
    one, other = (share_over_episodes(*share, level=level) for share in (first, second))
    method = f"difference of shares, {100 * level:g}% interval over episodes (ends combined)"
    if one.value is None or other.value is None:
        return not_available("no frame has both answers", one.n, method)
    value = one.value - other.value
    if one.ci is None or other.ci is None or np.count_nonzero(first[1]) < LEAST_EPISODES:
        return Statistic(value, one.n, method=method, note=one.note or other.note or FEW, level=level)
    ci = one.ci if other.value == 0 else apart((one.value, one.ci), (other.value, other.ci))
    return Statistic(value, one.n, ci, method=method, level=level)


def mean_of_shares(first: EpisodeCounts, second: EpisodeCounts, *, level: float = 0.95) -> Statistic:
    """Return the mean of two shares, such as balanced accuracy, with a conservative interval.

    Each share is given as hits and frames by episode. The two may rise together, so the ends are
    the means of their ends. ``n`` counts the frames of both.
    """
    one, other = (share_over_episodes(*share, level=level) for share in (first, second))
    method = f"mean of two shares, {100 * level:g}% interval over episodes (means of their ends)"
    if one.value is None or other.value is None:
        return not_available("one of the two classes is empty", one.n + other.n, method)
    ci = None
    if one.ci is not None and other.ci is not None:
        ci = (one.ci[0] + other.ci[0]) / 2, (one.ci[1] + other.ci[1]) / 2
    note = "" if ci else one.note or other.note
    return Statistic((one.value + other.value) / 2, one.n + other.n, ci, method=method, note=note, level=level)


def median_over_episodes(values: npt.ArrayLike, episodes: npt.ArrayLike, *, level: float = 0.95) -> Statistic:
    """Return a median with its interval, from intervals of shares over episodes.

    ``values`` and ``episodes``, shape (n,), are numbers and episode names by frame. The interval
    holds the values at or below which half of the frames may lie. ``n`` counts the frames. No
    interval below `LEAST_EPISODES` episodes. Source: Woodruff 1952.
    """
    given = np.asarray(values, dtype=np.float64)
    method = f"median, {100 * level:g}% interval over episodes (shares inverted)"
    if not len(given):
        return not_available("no frames", method=method)
    _, codes = np.unique(episodes, return_inverse=True)
    value, frames = float(np.median(given)), np.bincount(codes)
    if len(frames) < LEAST_EPISODES:
        return Statistic(value, len(given), method=method, note=FEW, level=level)

    def side(below: npt.NDArray[np.bool_]) -> int:
        return _side_of_half(np.bincount(codes, weights=below), frames, level)

    known = np.unique(given)
    lowest = _first(len(known), lambda place: side(given <= known[place]) >= 0)
    beyond = _first(len(known), lambda place: side(given < known[place]) > 0)
    low, high = known[min(lowest, len(known) - 1)], known[max(beyond - 1, 0)]
    return Statistic(value, len(given), (min(float(low), value), max(float(high), value)), method=method, level=level)


def median_difference(first: Statistic, second: Statistic) -> Statistic:
    """Return how much larger one median is, ends combined as in `difference_over_episodes`."""
    method = f"{first.method}, ends combined"
    if first.value is None or second.value is None:
        return not_available("one of the two medians is of no frames", 0, method)
    value, n = first.value - second.value, first.n + second.n
    if first.ci is None or second.ci is None:
        return Statistic(value, n, method=method, note=first.note or second.note, level=first.level)
    ci = apart((first.value, first.ci), (second.value, second.ci))
    return Statistic(value, n, ci, method=method, level=first.level)


def apart(first: BoundedValue, second: BoundedValue) -> Ends:
    """Return the ends of a difference of two values with their ends, taken as independent."""
    (one, (low, high)), (other, (least, most)) = first, second
    value = one - other
    return value - math.hypot(one - low, most - other), value + math.hypot(high - one, other - least)


def _first(count: int, holds: Callable[[int], bool]) -> int:
    """Return the first of ``count`` places from which a condition holds, ``count`` if none."""
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle + 1, high)
    return low
