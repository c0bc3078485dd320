"""Upper bounds on how often a guardian misses, from episodes that nothing else has used.

The unit is the episode, so that frames of one episode may depend on one another in any way; between
episodes the bounds need independent draws from one source.
"""

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from eyechart.stats.statistic import Statistic, UpperBound, not_available

MOST_EPISODES = 10_000_000

STAKES = tuple(2.0**-place for place in range(13))
"""Shares of its wealth that a bet against a rate may stake; all is best if no event is seen."""


def share_bound(k: int, n: int, *, confidence: float = 0.95) -> Statistic:
    """Bound from above the probability of an event, seen in ``k`` of ``n`` independent episodes.

    ``ci`` is (0, bound): the exact one-sided bound of Clopper and Pearson (1934). The value is k/n,
    None without episodes. ValueError unless 0 <= k <= n and 0 < confidence < 1.
    """
    _check(k, n, confidence)
    method = f"one-sided exact upper bound at confidence {confidence:g} (Clopper–Pearson), over episodes"
    if n == 0:
        return not_available("no episodes", method=method)
    ci = (0.0, _clopper_pearson(k, n, confidence))
    return UpperBound(k / n, n, ci, method=method, detail={"k": k}, level=confidence)


def mean_bound(losses: npt.ArrayLike, *, confidence: float = 0.95) -> Statistic:
    """Bound from above the mean of ``losses``, one in [0, 1] for each independent episode.

    ``ci`` is (0, bound): the p value of Hoeffding and Bentkus that Learn-then-Test uses
    (Angelopoulos et al. 2021; Bates et al. 2021), inverted. Without any loss it is 1 - (1 -
    confidence)^(1/n), which no bound can beat. The value is the mean, None without episodes.
    ValueError for a loss outside [0, 1].
    """
    given = np.asarray(losses, dtype=np.float64)
    if given.ndim != 1 or not ((given >= 0) & (given <= 1)).all():
        raise ValueError("losses must be one share in [0, 1] for each episode")
    _check(0, len(given), confidence)
    method = f"one-sided upper bound at confidence {confidence:g} (Hoeffding–Bentkus), over episodes"
    if not len(given):
        return not_available("no episodes", method=method)
    mean, n = float(given.mean()), len(given)
    high = _lowest(lambda risk: hoeffding_bentkus_p(mean, n, risk) <= 1 - confidence, mean)
    return UpperBound(mean, n, (0.0, high), method=method, level=confidence)


def ratio_bound(events: npt.ArrayLike, frames: npt.ArrayLike, longest: int, *, confidence: float = 0.95) -> Statistic:
    """Bound from above the rate per frame, E[events] / E[frames], from independent episodes.

    ``events``, shape (episodes,), are of ``frames``, and no episode has more frames than
    ``longest``. ``ci`` is (0, bound): the wealth of bets against each rate, mixed over `STAKES`,
    inverted by Ville's inequality (Waudby-Smith and Ramdas 2024). Events may depend on an episode's
    frames in any way, for example if misses occur in the episodes with most hazards. ``n`` counts
    frames; the value is None without any. ValueError for impossible counts.
    """
    got, of = np.asarray(events, dtype=np.float64), np.asarray(frames, dtype=np.float64)
    if got.shape != of.shape or got.ndim != 1 or not ((got >= 0) & (got <= of) & (of <= longest)).all():
        raise ValueError("events must be at most the frames of each episode, and these at most the longest")
    _check(0, len(got), confidence)
    method = f"one-sided upper bound at confidence {confidence:g} (bets on episodes), over frames of whole episodes"
    n = int(of.sum())
    if n == 0:
        return not_available("no frames", method=method)
    value = float(got.sum()) / n
    # Half of the wealth is on the full stake.
    share = np.log([0.5, *[0.5 / (len(STAKES) - 1)] * (len(STAKES) - 1)])

    def is_beaten(rate: float) -> bool:
        gains = np.maximum((rate * of - got) / ((1 - rate) * longest), -1)
        with np.errstate(divide="ignore"):  # a full stake may be lost
            wealth = np.log1p(np.outer(STAKES, gains)).sum(axis=1)
        return float(np.logaddexp.reduce(wealth + share)) >= -math.log(1 - confidence)

    high = 1.0 if value == 1 else _lowest(lambda rate: rate < 1 and is_beaten(rate), value)
    detail = {"events": int(got.sum()), "episodes": int(np.count_nonzero(of)), "longest": longest}
    return UpperBound(value, n, (0.0, high), method=method, detail=detail, level=confidence, longest=longest)


def hoeffding_bentkus_p(mean: float, n: int, risk: float) -> float:
    """Return a p value of the null "a mean of [0, 1] losses is ``risk`` or more", by n losses."""
    if risk <= mean:
        return 1.0
    if risk >= 1:
        return 0.0
    from scipy import special  # noqa: PLC0415 - slow to import

    apart = (0.0 if mean == 0 else mean * math.log(mean / risk)) + (1 - mean) * math.log((1 - mean) / (1 - risk))
    k = min(n, math.ceil(n * mean - 1e-9))
    return float(min(math.exp(-n * apart), math.e * special.bdtr(k, n, risk), 1.0))


def episodes_needed(rate: float, misses: int = 0, *, confidence: float = 0.95) -> int:
    """Return how many episodes, ``misses`` with a miss, bound the share with a miss by ``rate``.

    299 for 1 % without a miss at confidence .95. ValueError for a rate outside (0, 1), or one that
    ten million episodes do not reach.
    """
    if not 0 < rate < 1:
        raise ValueError(f"rate={rate} must lie between 0 and 1, for example 0.01")
    _check(misses, misses, confidence)
    low, high = misses, max(misses + 1, 2)
    while _clopper_pearson(misses, high, confidence) > rate:
        low, high = high, 2 * high
        if high > MOST_EPISODES:
            raise ValueError(f"more than {MOST_EPISODES} episodes would be needed for rate={rate}")
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if _clopper_pearson(misses, middle, confidence) <= rate else (middle, high)
    return high


def conformal_threshold(losses: npt.ArrayLike, risk: float) -> tuple[int | None, tuple[float, ...]]:
    """Return the highest threshold with a conformal risk of at most ``risk``, and each one's risk.

    ``losses``, shape (thresholds, episodes), are each episode's share of missed hazards at
    threshold 1, 2, …, and do not fall with the threshold. The conformal risk is (n mean + 1)/(n +
    1). Such a threshold keeps the expected loss of a next exchangeable episode at ``risk``. That
    holds in expectation over the episodes that chose it, not with a confidence (Angelopoulos et al.
    2024). None if not even the lowest threshold does.
    """
    given = np.asarray(losses, dtype=np.float64)
    if given.ndim != 2 or not ((given >= 0) & (given <= 1)).all() or (np.diff(given, axis=0) < -1e-12).any():
        raise ValueError("losses must lie in [0, 1], and must not fall as the threshold rises")
    n = given.shape[1]
    risks = tuple(float(one) for one in (given.sum(axis=1) + 1) / (n + 1))
    fit = [number for number, one in enumerate(risks, 1) if one <= risk + 1e-12]
    return (max(fit) if fit else None), risks


def _check(k: int, n: int, confidence: float) -> None:
    if not 0 <= k <= n or not 0 < confidence < 1:
        raise ValueError(f"need 0 <= k <= n and a confidence in (0, 1), got {k} of {n} at {confidence}")


def _clopper_pearson(k: int, n: int, confidence: float) -> float:
    if k == n:
        return 1.0
    if k == 0:
        return float(-math.expm1(math.log(1 - confidence) / n))
    from scipy import special  # noqa: PLC0415 - slow to import

    return float(special.betaincinv(k + 1, n - k, confidence))


def _lowest(holds: Callable[[float], bool], low: float) -> float:
    """Return the lowest number up to 1 from which a condition holds, to 1e-9 from above."""
    high = 1.0
    while high - low > 1e-9:
        middle = (low + high) / 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
