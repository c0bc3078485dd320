"""Order: whether answers fall along a scale as they should, by pairs and by rises in a range.

Each picture has two answers. What both show is no noise, and a contradiction between them is noise.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from eyechart.stats.agreement import clopper_pearson
from eyechart.stats.jackknife import ENDS, FEW, LEAST_EPISODES, by_episode, half_width
from eyechart.stats.statistic import Statistic, not_available

Floats = npt.NDArray[np.float64]

FEWEST = 6
"""The fewest answers in a window of `greatest_rise`."""
WIDEST = 1 / 4
"""The widest window, as a share of the answers."""
WIDTHS = 6
"""The number of window widths."""
SPREAD_OF = 4
"""A place's own variance is mixed with this many answers of the variance of all."""
ENOUGH = 20
"""After this many orders with as great a rise, p is known to be large, and drawing stops."""
AT_ONCE = 64
"""This many orders of some hundred answers fit a processor's cache."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Order(Statistic):
    """How often comparisons are the wrong way round, with the counts behind it.

    ``lost`` and ``won`` count the comparisons that both answers to a picture lose, or win.
    ``contradicted`` counts those that one loses and the other wins. A comparison counts once, as
    the mean of the two ways to pair the answers.
    """

    lost: float
    won: float
    contradicted: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Rise(Statistic):
    """The greatest rise along a scale: levels are lower in range ``nearer`` than in ``farther``.

    Both ranges are in the unit of the scale, and None without a rise.
    """

    nearer: tuple[float, float] | None = None
    farther: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Density(Statistic):
    """Drawn places in a window of a scale: ``value`` on average, ``fewest`` in the emptiest."""

    fewest: int


def compared_twice(nearer: npt.ArrayLike, farther: npt.ArrayLike) -> Floats:
    """Return each frame's comparison as lost twice, won twice, and contradicted.

    ``nearer`` and ``farther``, shape (2, frames), are two answers to the picture that calls for
    more and to the one that calls for less. A frame with a NaN counts nothing. The answers can be
    paired in two ways, and each counts one half. The result has shape (3, frames) and values 0, 1/2
    and 1. Two equal answers are neither lost nor won.
    """
    one, other = np.asarray(nearer, dtype=np.float64), np.asarray(farther, dtype=np.float64)
    found = np.zeros((3, one.shape[1]))
    for again in (other, other[::-1]):
        signs = np.sign(one - again)
        first, second = np.nan_to_num(signs) * ~np.isnan(signs).any(axis=0)
        found += (first + second == -2), (first + second == 2), first * second < 0
    whole = ~np.isnan(one + other).any(axis=0)
    return np.asarray(found * whole / 2)


def wrong_way(lost: float, won: float, contradicted: float) -> float:
    """Return the expected share h of comparisons the wrong way round; NaN if noise hides it.

    h = 1/2 - (won - lost) / (2 √((won + lost)² - contradicted²)). Let pictures be told apart the
    right way with chance p and the wrong way with q, exchanged in a share h of the comparisons.
    Then won + lost is p² + q², contradicted 2pq, and won - lost (1 - 2h)(p² - q²). So the formula
    gives h for any noise.

    If comparisons have different noise, the result lies above their share, so noise is no
    advantage. Answers that repeat contradict nothing: h is then lost / (lost + won).
    """
    rest = (won + lost) ** 2 - contradicted**2
    return math.nan if rest <= 0 else 0.5 - (won - lost) / (2 * math.sqrt(rest))


def order_of(compared: npt.ArrayLike, episodes: npt.ArrayLike, *, level: float = ENDS) -> Statistic:
    """Return the share of comparisons the wrong way round, with an interval over episodes.

    ``compared``, shape (3, frames), sums `compared_twice` over a frame's pairs of pictures;
    ``episodes`` names each frame's. The interval is the jackknife's, with Student's t of one degree
    less than there are episodes with a comparison. Neither end is nearer than that of a share of as
    many frames (Clopper and Pearson 1934), since comparisons of a frame are not independent. ``n``
    counts the frames with a comparison.
    """
    counts = np.asarray(compared, dtype=np.float64)
    decided = counts[:2].sum(axis=0) > 0
    n, method = (
        int(np.count_nonzero(decided)),
        f"1/2 - (won - lost) / (2 √((won + lost)² - contradicted²)); {100 * level:g}% interval",
    )
    if not n:
        return not_available("no comparison comes out the same way twice", method=method)
    some = counts.any(axis=0)
    each = by_episode(counts[:, some], np.asarray(episodes)[some])
    whole, count = each.sum(axis=1), each.shape[1]
    lost, won, contradicted = map(float, whole)
    value = wrong_way(lost, won, contradicted)
    found = Order(None, n, method=method, level=level, lost=lost, won=won, contradicted=contradicted)
    if math.isnan(value):
        return replace(found, note="its answers contradict each other as often as they agree")
    found = replace(found, value=min(max(value, 0.0), 1.0))
    left = np.array([wrong_way(*map(float, whole - one)) for one in each.T])
    if count < LEAST_EPISODES or np.isnan(left).any():
        return replace(
            found, note=FEW if count < LEAST_EPISODES else "no interval: without one of the episodes nothing is left"
        )
    wide, share = half_width(left, level), found.value or 0.0
    low, high = clopper_pearson(share * n, n, level)
    return replace(found, ci=(max(0.0, min(value - wide, low)), min(1.0, max(value + wide, high))))


def greatest_rise(places: npt.ArrayLike, levels: npt.ArrayLike, *, seed: int, resamples: int = 999) -> Statistic:
    """Test whether levels rise anywhere along a scale on which they should fall or stay.

    ``places`` and ``levels`` have shape (pictures, frames), NaN for no such answer. Neighbouring
    windows with equally many answers are compared at every place. They have six widths, from six
    answers to a quarter of all. ``value`` is the greatest rise of the mean, in standard errors of
    its own place. These use the pooled variance of the two windows, plus the weight of four answers
    with the variance of all.

    ``p`` comes from exchanging the levels of whole frames with the same pictures, so that a frame's
    own level is no rise. Orders are drawn until `ENOUGH` of them rise as much, or ``resamples``
    (Besag and Clifford 1991). ``n`` counts the answers.
    """
    at, of = np.asarray(places, dtype=np.float64), np.asarray(levels, dtype=np.float64)
    have = ~np.isnan(at + of)
    n, method = (
        int(have.sum()),
        "greatest rise between neighbouring windows, in its standard errors; p: permutation of frames",
    )
    if n < 2 * FEWEST:
        return not_available(f"{n} answers; {2 * FEWEST} are needed", n, method)
    order = np.argsort(at[have], kind="stable")
    along, spread = of[have][order], float(of[have].var())
    if spread == 0.0:
        return Rise(0.0, n, p=1.0, method=method, note="all levels are alike")
    widths = sorted({int(one) for one in np.geomspace(FEWEST, max(FEWEST, n * WIDEST), WIDTHS)})
    standardised_rises = list(_standardised_rises(along[:, None], widths, spread))
    best = max(range(len(widths)), key=lambda one: float(standardised_rises[one].max()))
    value, width, start = float(standardised_rises[best].max()), widths[best], int(standardised_rises[best].argmax())
    if value <= 0:
        return Rise(value, n, p=1.0, method=method, note="nowhere")
    as_high = drawn = 0
    for frames in _exchanges(have, seed, resamples):
        greatest = np.max(
            [
                standardised_rise.max(axis=0)
                for standardised_rise in _standardised_rises(of[:, frames][have][order], widths, spread)
            ],
            axis=0,
        )
        as_high, drawn = as_high + int(np.count_nonzero(greatest >= value - 1e-9)), drawn + len(greatest)
        if as_high >= ENOUGH:
            break
    at = at[have][order]
    nearer, farther = ((float(at[a]), float(at[a + width - 1])) for a in (start, start + width))
    return Rise(value, n, p=(1 + as_high) / (1 + drawn), method=method, nearer=nearer, farther=farther)


def _exchanges(have: npt.NDArray[np.bool_], seed: int, resamples: int) -> Iterator[npt.NDArray[np.int64]]:
    """Yield orders of frames, one a column; only frames that ``have`` the same pictures move."""
    patterns = np.unique(have, axis=1, return_inverse=True)[1].ravel()
    groups = [np.flatnonzero(patterns == one) for one in np.unique(patterns)]
    rng = np.random.default_rng(seed)
    for start in range(0, resamples, AT_ONCE):
        orders = np.empty((have.shape[1], min(AT_ONCE, resamples - start)), dtype=np.int64)
        for group in groups:
            orders[group] = rng.permuted(np.tile(group[:, None], (1, orders.shape[1])), axis=0)
        yield orders


def _standardised_rises(levels: Floats, widths: list[int], spread: float) -> Iterator[Floats]:
    """Yield for each width the rise at each place of each column, in standard errors."""
    zero = np.zeros((1, levels.shape[1]))
    sums = np.concatenate((zero, np.cumsum(levels, axis=0)))
    squares = np.concatenate((zero, np.cumsum(levels * levels, axis=0)))
    for width in widths:
        means = (sums[width:] - sums[:-width]) / width
        scatter = (squares[width:] - squares[:-width]) - width * means * means
        pooled = (scatter[width:] + scatter[:-width] + SPREAD_OF * spread) / (2 * width + SPREAD_OF)
        yield (means[width:] - means[:-width]) / np.sqrt(pooled * 2 / width)


def density(places: npt.ArrayLike, factor: float) -> Statistic:
    """Return how many places (numbers above 0) lie in a window with ends a factor apart.

    ``value`` is for places spread evenly in their logarithm from the least to the greatest.
    ``fewest`` is the number inside the emptiest window between them. ``n`` counts the places.
    """
    at, method = np.sort(np.asarray(places, dtype=np.float64)), f"drawn places in a window a factor of {factor:g} wide"
    at = at[~np.isnan(at)]
    if len(at) < 2 or at[-1] < at[0] * factor:
        return not_available("the drawn places lie in no range that holds a window", len(at), method)
    starts = at[at * factor <= at[-1]]
    inside = np.searchsorted(at, starts * factor, side="left") - np.searchsorted(at, starts, side="right")
    value = len(at) * math.log(factor) / math.log(at[-1] / at[0])
    return Density(value, len(at), method=method, fewest=int(inside.min()))


def order_violation_p(lost: int, pairs: int, wavered: int, repeats: int) -> float:
    """Return the p of this number of pairs lost, against noise as in the repeats.

    ``lost`` of ``pairs`` and ``wavered`` of ``repeats``. Noise alone loses at most half as many
    pairs as repeats disagree: two answers of one distribution disagree at least twice as often as
    the second is greater. Given their sum, the number lost is binomial for rare events. Frequent
    ones vary less, so p is then too large. Raises ValueError without pairs or without repeats.
    """
    from scipy import special  # noqa: PLC0415 - slow to import

    if not pairs or not repeats:
        msg = "no pairs, or no repeats"
        raise ValueError(msg)
    share = pairs / (pairs + 2 * repeats)
    return float(special.bdtrc(lost - 1, lost + wavered, share))
