"""Total-effect shares: how much of a controller's own variation goes with one of its channels.

Answers are arrays of shape (answers, frames, …), in units of scale; the answers to a frame are
exchangeable. One answer is enough for a deterministic controller. For one that draws its answers,
two or more let the noise cancel.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import factorial

import numpy as np
import numpy.typing as npt

from eyechart.stats.shares import Share
from eyechart.stats.statistic import TIE, Statistic, chunks, not_available

Floats = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]
Subset = frozenset[str]

LEVEL = 0.98
"""Each end of an interval is exceeded with a chance of .01."""

_SURE = 2.0
"""From this number of standard errors above 0, the interval is on the log scale alone."""
_MOST_EXPONENT = 50.0
_RESAMPLES = 999
"""Random reassignments of the calls before."""
_LEAST = 20
"""Calls needed for each number that describes the call before; fewer give no fit."""
ROUNDING = 1e-4
"""Variation below this share of its reference is rounding."""


_MOVES = 0.1
"""From this share on, the log itself moves a dimension."""


LAST_BITS = 1e-6
"""The last bits of a single-precision number, as a share of it."""


@dataclass(frozen=True)
class Pairs:
    """Half the squared distance of two answers, frame by frame, and their two episodes.

    ``values``, shape (n,), is in units of scale squared. ``owner``, shape (n,), is the number of
    the frame's episode. ``partner``, shape (n,), is that of the frame that lends its channel or
    answer.
    """

    values: Floats
    owner: Places
    partner: Places

    def __post_init__(self) -> None:
        if not len(self.values) == len(self.owner) == len(self.partner) or not np.isfinite(self.values).all():
            raise ValueError("give one finite value, one owner and one partner a frame")

    def table(self, episodes: int) -> tuple[Floats, Floats]:
        """Return sum and count of the values by owner and partner, each (episodes, episodes)."""
        place, size = self.owner * episodes + self.partner, episodes * episodes
        sums = np.bincount(place, self.values, size).reshape(episodes, episodes)
        counts = np.bincount(place, minlength=size).reshape(episodes, episodes).astype(np.float64)
        return np.asarray(sums, np.float64), counts


def squared_distance(first: npt.ArrayLike, second: npt.ArrayLike) -> Floats:
    """Return half the mean squared difference of two answers to each frame, net of noise.

    The result has shape (n,); both have shape (k, n, …). With one answer it is ``½ |r - s|²``. With
    more, it is the mean over a ≠ b of ``½ ⟨rₐ - sₐ, r_b - s_b⟩``. Its expectation has no noise in
    it, and it may be negative. ValueError if the shapes differ.
    """
    r, s = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if r.shape != s.shape or r.ndim < 3:
        raise ValueError(f"need two arrays of one shape (answers, frames, numbers…), got {r.shape} and {s.shape}")
    return np.asarray(half_products(r, s).reshape(r.shape[1], -1).mean(axis=1))


def half_products(r: Floats, s: Floats) -> Floats:
    """Return `squared_distance` before its mean over the numbers of an answer, shape (n, …)."""
    apart, k = r - s, len(r)
    if k == 1:
        return np.asarray(apart[0] ** 2 / 2)
    together = apart.sum(axis=0) ** 2 - (apart**2).sum(axis=0)
    return np.asarray(together / (2 * k * (k - 1)))


def total_effect(
    effect: Pairs, variation: Pairs, *, sampled: bool = False, signed: bool = False, level: float = LEVEL
) -> Statistic:
    """Return the share of a controller's variation that goes with a channel.

    It is mean(effect) / mean(variation). ``effect`` holds the half squared distances of answers
    with and without the channel exchanged. ``variation`` holds those between a frame and another
    episode's. Both number the episodes in the same way. The share is of an intervention: channels
    with the same information may each have none, or each all, and it may exceed 1.

    The standard error is a jackknife that leaves each episode out, both as owner and as partner.
    The interval is t with episodes - 1 degrees of freedom, on the scale of the logarithm. With
    ``sampled``, noise can make the share negative. The upper end is then never below the plain one,
    and the lower end of a share below 0 is that share. With ``signed``, the share may truly be
    negative, and both ends are the plain ones. ``n`` counts the frames. None below three episodes,
    and if the controller does not vary.

    Source: total-effect index (Homma and Saltelli 1996); delete-one-node jackknife for pairs
    (Fafchamps and Gubert 2007). Measured in docs/decisions/policies.md.
    """
    method = f"share of own variation, jackknife over owners and partners, {100 * level:g}% interval"
    episodes = _count(effect, variation)
    n, there = len(effect.values), len(np.unique(effect.owner))
    if there < 3:
        return not_available(f"{there} episodes have both answers, and three are needed", n, method)
    whole, without = _means(effect, episodes), _means(variation, episodes)
    if not without[0] > 0:
        return not_available("the answers do not vary from episode to episode", n, method)
    shares = whole[1] / without[1]
    left = shares[np.isfinite(shares)]
    if len(left) < there:
        return not_available("too few pairs of episodes: without one of them none is left", n, method)
    share = float(whole[0] / without[0])
    error = float(np.sqrt((len(left) - 1) / len(left) * ((left - left.mean()) ** 2).sum()))
    detail = {"standard_error": error, "effect": float(whole[0]), "variation": float(without[0])}
    wide = t_quantile(level, there - 1) * error
    ci = (share - wide, share + wide) if signed else _interval(share, wide, error, sampled=sampled)
    return Share(share, n, ci, method=method, detail=detail, level=level, episodes=there)


def responding(effects: Sequence[Pairs], variation: Pairs, least: float) -> tuple[int, int]:
    """Return the number of episodes in which a channel carries ``least`` or more, and of all.

    An episode responds if the mean of its frames' half squared distances is that share of the
    variation in any of ``effects``. (0, 0) if the controller does not vary.
    """
    whole = float(variation.values.mean()) if len(variation.values) else 0.0
    measured, found = set[int](), set[int]()
    for effect in effects if whole > 0 else ():
        for episode in np.unique(effect.owner).tolist():
            measured.add(episode)
            if effect.values[effect.owner == episode].mean() >= least * whole:
                found.add(episode)
    return len(found), len(measured)


def share_difference(first: tuple[Pairs, Pairs], second: tuple[Pairs, Pairs], *, level: float = LEVEL) -> Statistic:
    """Return how much larger the second controller's share is, on the same frames and partners.

    Each is the ``effect`` and the ``variation`` of `total_effect`. The jackknife leaves each
    episode out of both, so common variation cancels. Interval and p are t with episodes - 1 degrees
    of freedom. None if either share is.
    """
    method = f"difference of shares, jackknife over owners and partners, {100 * level:g}% interval"
    effect, n = first[0], len(second[0].values)
    episodes = _count(*first, *second)
    there = len(np.unique(effect.owner))
    if there < 3:
        return not_available(f"{there} episodes have both answers, and three are needed", n, method)
    parts = [[_means(one, episodes) for one in pair] for pair in (first, second)]
    if not all(variation[0] > 0 for _, variation in parts):
        return not_available("the answers do not vary from episode to episode", n, method)
    (less, lacking), (more, kept) = ((whole[0] / without[0], whole[1] / without[1]) for whole, without in parts)
    apart, left = float(more - less), np.asarray(kept - lacking)
    left = left[np.isfinite(left)]
    if len(left) < there:
        return not_available("too few pairs of episodes: without one of them none is left", n, method)
    error = float(np.sqrt((len(left) - 1) / len(left) * ((left - left.mean()) ** 2).sum()))
    wide = t_quantile(level, there - 1) * error
    p = _two_sided(apart / error, there - 1) if error > 0 else float(apart == 0)
    detail = {"episodes": there, "standard_error": error}
    return Statistic(apart, n, (apart - wide, apart + wide), p, method=method, detail=detail, level=level)


def share_beyond(effect: Pairs, other: Pairs, variation: Pairs, *, level: float = LEVEL) -> Statistic:
    """Return how much larger one share is: (mean(effect) - mean(other)) / mean(variation).

    The difference may truly be negative, and both shares are skewed. So no interval on the scale of
    its logarithm, nor a plain one, keeps its level. For each difference d, the logarithm of
    ``effect`` over (``other`` plus d) is tested against 0. The ends are the d at which it is t
    standard errors away. The jackknife leaves each episode out as owner and as partner, with
    episodes - 1 degrees of freedom.

    The interval always holds the value; it is None if the search finds no upper end. ``n`` counts
    the frames. None below three episodes, and if the controller does not vary.

    Source: interval of a difference by inversion (Fieller 1954). Measured in
    docs/decisions/policies.md.
    """
    method = f"difference of shares by inversion, jackknife over owners and partners, {100 * level:g}% interval"
    every = (effect, other, variation)
    episodes = _count(*every)
    n, there = len(effect.values), len(np.unique(effect.owner))
    if there < 3:
        return not_available(f"{there} episodes have both answers, and three are needed", n, method)
    (more, mores), (less, lesses), (whole, wholes) = (_means(one, episodes) for one in every)
    if not whole > 0:
        return not_available("the answers do not vary from episode to episode", n, method)
    good = np.isfinite(mores) & np.isfinite(lesses) & np.isfinite(wholes)
    if good.sum() < there:
        return not_available("too few pairs of episodes: without one of them none is left", n, method)
    first, second = more / whole, max(less / whole, 0.0)
    left = np.stack([mores[good] / wholes[good], np.maximum(lesses[good] / wholes[good], 0.0)])
    value, ends = float((more - less) / whole), _inverted(first, second, left, t_quantile(level, there - 1))
    if ends is None:
        return Share(value, n, method=method, note="its upper end is not bounded", level=level, episodes=there)
    ci = min(ends[0], value), max(ends[1], value)
    return Share(value, n, ci, method=method, level=level, episodes=there)


_DECADES, _STEPS = 4, 2000
"""The range of the search for a share's bounds, in decades, and its steps."""


def _inverted(first: float, second: float, left: Floats, quantile: float) -> tuple[float, float] | None:
    """Return the ends of the difference of two shares; ``left`` (2, episodes) leaves each out.

    A share of 0 lies below the searched range. None if no upper end is found.
    """
    if first <= 0 or (left[0] <= 0).any():
        return 0.0 - second, max(0.0, float(left[0].max()) - second)
    steps = np.logspace(-_DECADES, _DECADES, 2 * _STEPS + 1)
    reached = first * steps[:, None]
    others = np.maximum(left[1] - second + reached, first * 10.0**-_DECADES)
    parts = np.log(left[0]) - np.log(others)
    freedom = parts.shape[1] - 1
    wide = quantile * np.sqrt(freedom / (freedom + 1) * ((parts - parts.mean(axis=1, keepdims=True)) ** 2).sum(axis=1))
    apart = -np.log(steps)
    below, above = np.flatnonzero(apart - wide > 0), np.flatnonzero(apart + wide < 0)
    if not len(above):
        return None
    lower = reached[below[-1], 0] if len(below) else 0.0
    return float(lower - second), float(reached[above[0], 0] - second)


def _count(*pairs: Pairs) -> int:
    """Return the number of episodes; a partner's may have no frame of its own."""
    return max(int(max(np.max(pair.owner, initial=-1), np.max(pair.partner, initial=-1))) for pair in pairs) + 1


def _means(pairs: Pairs, episodes: int) -> tuple[float, Floats]:
    """Return the mean of all values, and that without each episode (NaN if undefined)."""
    sums, counts = pairs.table(episodes)
    with np.errstate(invalid="ignore", divide="ignore"):
        parts = [one.sum() - one.sum(axis=0) - one.sum(axis=1) + np.diag(one) for one in (sums, counts)]
        left = np.where(parts[1] > 0, parts[0] / parts[1], np.nan)
    left[counts.sum(axis=1) == 0] = np.nan
    return float(sums.sum() / counts.sum()), left


def _interval(share: float, wide: float, error: float, *, sampled: bool) -> tuple[float, float]:
    if share <= 0:
        return min(0.0, share), max(0.0, share + wide)
    factor = float(np.exp(min(wide / share, _MOST_EXPONENT)))
    if not sampled:
        return share / factor, share * factor
    upper = share + wide
    return share / factor, max(upper, share * factor) if share > _SURE * error else upper


def t_quantile(level: float, freedom: int) -> float:
    """Return the reach of an interval of this level in standard errors (Student's t)."""
    from scipy import special  # noqa: PLC0415 - slow to import

    return float(special.stdtrit(freedom, (1 + level) / 2))


def _two_sided(t: float, freedom: int) -> float:
    from scipy import special  # noqa: PLC0415 - slow to import

    return float(2 * special.stdtr(freedom, -abs(t)))


def permutation_p(first: npt.ArrayLike, second: npt.ArrayLike, *, seed: int, resamples: int = 1999) -> float | None:
    """Return the p of "exchanging the channel changes nothing at all"; None for one answer each.

    Both have shape (k, n, …). Under the hypothesis the 2 k answers to a frame are in any order, so
    they are dealt anew within each frame. The statistic is the sum over frames of the squared
    distance of the two means. The test is exact for any noise: (j + 1) / (B + 1).
    """
    r, s = (np.asarray(one, np.float64) for one in (first, second))
    k, n = r.shape[:2]
    if k < 2 or not n:
        return None
    pool = np.concatenate([r, s]).reshape(2 * k, n, -1)
    whole = pool.sum(axis=0)
    dealt = [list(chosen) for chosen in combinations(range(2 * k), k) if 0 in chosen]
    apart = np.stack([((2 * pool[chosen].sum(axis=0) - whole) ** 2).sum(axis=1) for chosen in dealt])
    observed = float(apart[0].sum()) * (1 - TIE)
    rng = np.random.default_rng(seed)
    drawn = 0
    for rows in chunks(resamples, n):
        turns = rng.integers(len(dealt), size=(rows.stop - rows.start, n))
        drawn += int(np.count_nonzero(apart[turns, np.arange(n)].sum(axis=1) >= observed))
    return (drawn + 1) / (resamples + 1)


def dispersion_change(
    first: npt.ArrayLike, second: npt.ArrayLike, variation: float, *, seed: int, resamples: int = 1999
) -> tuple[float, float] | None:
    """Return the change in the answers' scatter as a share of the variation, and its p.

    Both have shape (k, n, …), without and with the channel exchanged. ``variation`` is half the
    mean squared distance of the answers to two moments. The size is the mean over frames of the
    difference of two variances, over ``variation``. The mean difference when the 2 k answers to a
    frame are dealt anew is subtracted. p is that of the sum of the squared differences, (j + 1) /
    (B + 1).

    A controller may answer with the same mean and another spread, which no difference of means
    shows. None for one answer each, or without variation.
    """
    r, s = (np.asarray(one, np.float64) for one in (first, second))
    k, n = r.shape[:2]
    if k < 2 or not n or not variation > 0:
        return None
    pool = np.concatenate([r, s]).reshape(2 * k, n, -1)
    every = range(2 * k)
    dealt = [
        (list(pair), [other for other in every if other not in pair]) for pair in combinations(every, k) if 0 in pair
    ]
    apart = np.stack(
        [abs(pool[one].var(axis=0, ddof=1) - pool[other].var(axis=0, ddof=1)).mean(axis=1) for one, other in dealt]
    )
    observed = float((apart[0] ** 2).sum()) * (1 - TIE)
    rng, drawn = np.random.default_rng(seed), 0
    for rows in chunks(resamples, n):
        turns = rng.integers(len(dealt), size=(rows.stop - rows.start, n))
        drawn += int(np.count_nonzero((apart[turns, np.arange(n)] ** 2).sum(axis=1) >= observed))
    size = float(apart[0].mean() - apart.mean()) / variation
    return max(size, 0.0), (drawn + 1) / (resamples + 1)


def shares_of_parts(
    first: Floats, second: Floats, one: Floats, other: Floats, columns: Sequence[Sequence[int]]
) -> Mapping[str, tuple[float | None, ...]]:
    """Return the share by ``dimension`` and by ``step`` of the horizon, None without variation.

    The answers have shape (k, frames, steps, dimensions): with the channel, with it exchanged, and
    of two frames. ``columns`` are those of each named dimension: a rotation has several.
    """
    effect, variation = half_products(first, second).mean(axis=0), half_products(one, other).mean(axis=0)
    least = TIE * max(1.0, float(variation.mean()))
    of_dimension = [np.array([one.mean(axis=0)[list(many)].sum() for many in columns]) for one in (effect, variation)]
    parts = {"dimension": of_dimension, "step": [one.mean(axis=1) for one in (effect, variation)]}
    result = {}
    for name, (went, whole) in parts.items():
        with np.errstate(invalid="ignore", divide="ignore"):
            shares = went / whole
        varies = whole > least
        result[name] = tuple(float(share) if good else None for share, good in zip(shares, varies, strict=True))
    return result


def noise_share(first: npt.ArrayLike, again: npt.ArrayLike, other: npt.ArrayLike) -> Statistic:
    """Return the share of a controller's variation that is there without any change.

    ``first`` and ``again``, shape (n, …), are two answers to the same frame, ``other`` an answer to
    another episode's. It is the mean squared distance of the first two over that of ``first`` and
    ``other``; None if those do not vary.
    """
    a, b, c = (np.asarray(one, np.float64) for one in (first, again, other))
    method = "squared distance of two answers to one frame, over that to another episode's"
    if not len(a):
        return not_available("no frame was answered twice", method=method)
    whole = float(((a - c) ** 2).mean())
    if not whole > 0:
        return Share(None, len(a), method=method, note="the answers do not vary from episode to episode", alike=True)
    return Share(float(((a - b) ** 2).mean()) / whole, len(a), method=method)


def misfit_share(answers: npt.ArrayLike, logged: npt.ArrayLike, episodes: Places, *, level: float = LEVEL) -> Statistic:
    """Return the mean squared error of answers over the log's variance: 0 fits, 1 is its mean.

    Both have shape (n, steps, dimensions), in units of scale; the mean is that of each step and
    dimension. The interval is a jackknife over episodes on the scale of the logarithm. None without
    logged actions that vary.
    """
    a, b = np.asarray(answers, np.float64), np.asarray(logged, np.float64)
    method = f"squared error over the variance of the logged actions, {100 * level:g}% interval over episodes"
    if not len(a):
        return not_available("no frame has an answer and a logged action", method=method)
    error = ((a - b) ** 2).reshape(len(a), -1).mean(axis=1)
    spread = ((b - b.mean(axis=0)) ** 2).reshape(len(b), -1).mean(axis=1)
    if not spread.mean() > 0:
        return not_available("the logged actions are all the same", len(a), method)
    _, numbered = np.unique(episodes, return_inverse=True)
    if numbered.max() < 2:
        return Statistic(float(error.mean() / spread.mean()), len(a), method=method, note="fewer than three episodes")
    return total_effect(*(Pairs(one, numbered, numbered) for one in (error, spread)), level=level)


def held_still(answers: npt.ArrayLike, logged: npt.ArrayLike) -> tuple[int, ...]:
    """Return the dimensions that never change in the answers, but do in the log.

    Both have shape (frames, steps, dimensions), in units of the log's spread; rounding is no
    movement.
    """
    own, theirs = (np.asarray(one, np.float64).reshape(-1, np.shape(one)[-1]).std(axis=0) for one in (answers, logged))
    return tuple(np.flatnonzero((own < ROUNDING) & (theirs > _MOVES)).tolist())


def rounding_tolerance(answers: npt.ArrayLike) -> Floats:
    """Return the largest difference of answers that is rounding, shape (dimensions,).

    ``answers``, shape (frames, steps, dimensions), are those to different moments. Parallel sums
    have other last bits each time, which no share can see. For a dimension that hardly varies, it
    is the last bits of its size in single precision.
    """
    found = np.asarray(answers, np.float64)
    rows = found.reshape(-1, found.shape[-1])
    return np.asarray(np.maximum(ROUNDING * rows.std(axis=0), LAST_BITS * np.sqrt((rows**2).mean(axis=0))))


def distance_from_log(answers: Floats, logged: Floats) -> tuple[tuple[float, int], tuple[float, int]]:
    """Return the largest offset and the largest ratio of spreads to the log, with their dimensions.

    Both have shape (n, steps, dimensions), in units of scale. The offset is a distance of means in
    units of the logged spread. It counts dimensions in which most answers lie at least half a
    spread outside the logged range. The ratio is of two spreads, above 1 either way, or of two
    ranges if that is nearer to 1. A gripper that closes rarely, or always, has another mean and
    spread in the same unit.

    A dimension that never moves in the log has its unit as spread, and no ratio. One that the
    controller never moves has none either.
    """
    a, b = (one.reshape(-1, one.shape[-1]) for one in (answers, logged))
    spread, own = b.std(axis=0), a.std(axis=0)
    moved = spread > TIE
    outside = ((a < b.min(axis=0) - spread / 2) | (a > b.max(axis=0) + spread / 2)).mean(axis=0)
    offset = np.abs(a.mean(axis=0) - b.mean(axis=0)) / np.where(moved, spread, 1.0)
    both = moved & (own > ROUNDING * spread) & (_ranges(a)[0] > 0)  # far from 0 equal numbers have a spread
    ratios = [
        np.where(both, first, 1.0) / np.where(both, second, 1.0) for first, second in ((own, spread), _ranges(a, b))
    ]
    ratio = np.minimum(*(np.maximum(one, 1 / one) for one in ratios))
    far = np.where(outside > 0.5, offset, 0.0)
    first, second = ((float(one.max()), int(one.argmax())) for one in (far, ratio))
    return first, second


def _ranges(*many: Floats) -> list[Floats]:
    return [np.asarray(np.ptp(one, axis=0)) for one in many]


def subsets(names: Sequence[str]) -> tuple[Subset, ...]:
    """Return all subsets of some parts, the smaller ones first, 2 to the power of their number."""
    return tuple(frozenset(some) for size in range(len(names) + 1) for some in combinations(names, size))


def shapley_values(worth: Mapping[Subset, npt.ArrayLike]) -> dict[str, Floats]:
    """Return the Shapley value of each part from the worth of every subset, exactly.

    ``worth`` has an array of one shape for each subset, also the empty one, and the values have
    that shape. They add up to the worth of all parts less that of none. A worth that two parts have
    only together is halved between them, and so on. ValueError if a subset is missing. Source:
    Shapley 1953; of shares of variance, Owen 2014 (SIAM/ASA J. Uncertainty Quantification 2,
    245-251).
    """
    names = sorted(frozenset().union(*worth))
    if missing := set(subsets(names)) - set(worth):
        raise ValueError(f"the worth of {sorted(map(sorted, missing))} is missing")
    arrays = {some: np.asarray(value, np.float64) for some, value in worth.items()}
    result = {}
    for name in names:
        rest = [one for one in names if one != name]
        parts = [_weight(len(some), len(names)) * (arrays[some | {name}] - arrays[some]) for some in subsets(rest)]
        result[name] = np.asarray(sum(parts), np.float64)
    return result


def _weight(size: int, names: int) -> float:
    """Return the share of orders in which a part comes right after a subset of a size."""
    return factorial(size) * factorial(names - size - 1) / factorial(names)


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
    drawn = sum(float(((kept[rng.permutation(n)].T @ e) ** 2).sum()) >= observed for _ in range(_RESAMPLES))
    left = n - kept.shape[1]
    value = 1 - (1 - observed / whole) * n / left
    return Statistic(value, n, p=(drawn + 1) / (_RESAMPLES + 1), method=method)
