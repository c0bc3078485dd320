"""Whether answers that should fall along a scale do: pairs lost beyond noise, and rises in some range of it."""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from eyechart.stats.agreement import rate
from eyechart.stats.statistic import Statistic, cannot_say

Floats = npt.NDArray[np.float64]

FEWEST = 6
"""No window of `falls_everywhere` is narrower."""
WIDEST = 1 / 4
"""Nor wider than this share of the answers."""
AT_ONCE = 64
"""So many orders of some hundred answers stay in a processor's cache."""

SWAPPED_ENDS = "share of pairs at opposite ends of braking the wrong way round, less what independent answers explain"


def lost_beyond_noise(lost: int, pairs: int, wavered: int, repeats: int) -> float:
    """Return the p of so many pairs lost, where noise alone loses at most half as many as repeats disagree.

    ``lost`` of ``pairs`` and ``wavered`` of ``repeats``. Two answers of one law disagree at least twice as often as the
    second is the greater of them. Given their sum the lost ones are binomial, as they are of rare events; of frequent
    ones, which vary less, p is too large. Raises ValueError where there are none.
    """
    from scipy import special  # noqa: PLC0415 - slow to import

    if not pairs or not repeats:
        msg = "no pairs, or no repeats"
        raise ValueError(msg)
    share = pairs / (pairs + 2 * repeats)
    return float(special.bdtrc(lost - 1, lost + wavered, share))


def swapped_ends(
    pairs: tuple[npt.ArrayLike, npt.ArrayLike],
    repeats: tuple[npt.ArrayLike, npt.ArrayLike],
    *,
    light: float,
    hard: float,
    often: int = 1,
    level: float = 0.95,
) -> Statistic:
    """Return the share of pairs whose first is at most ``light`` and whose second at least ``hard``, less noise.

    ``pairs`` holds the levels of what should be the harder and the less hard, ``repeats`` two answers to one picture.
    Where each picture has a chance of its own to be answered at an end, the same for all pictures at such a distance,
    the share of these pairs times that of the opposite ones is the product of what one picture's answers are at
    opposite ends by chance, half of that of repeats for either picture. So noise explains that share squared, divided
    by the opposite ones' share. ``ci`` is Wilson's of the share, moved by as much. Each answer stands in ``often`` of
    the pairs: ``n`` and ``ci`` are of as many as would hold each once. Raises ValueError where there are no pairs or no
    repeats.
    """
    (first, second), (one, again) = ([np.asarray(of, dtype=np.float64) for of in both] for both in (pairs, repeats))
    if not len(first) or not len(one):
        msg = "no pairs, or no repeats"
        raise ValueError(msg)
    lost, won = (int(np.count_nonzero((a <= light) & (b >= hard))) for a, b in ((first, second), (second, first)))
    apart = int(np.count_nonzero((np.minimum(one, again) <= light) & (np.maximum(one, again) >= hard)))
    half, n = apart / len(one) / 2, len(first)
    explained = min(half, half * half * n / max(won, 1))
    share = replace(rate(lost // often, n // often, level=level), value=lost / n).less(explained)
    detail = {"lost": lost, "won": won, "repeats_apart": apart}
    return replace(share, method=f"{SWAPPED_ENDS}: {share.method}", detail=detail)


def falls_everywhere(places: npt.ArrayLike, levels: npt.ArrayLike, *, seed: int, resamples: int = 999) -> Statistic:
    """Test whether levels rise anywhere along places at which they should fall or stay.

    Two arrays of one length. Two neighbouring windows of equally many answers are compared, at every place and at
    several widths; ``value`` is the greatest rise of the mean from one to the next, each in standard deviations of a
    mean of so many. ``p`` is of all orders of the levels alike, of which so many are drawn: where levels fall instead,
    rises are smaller. ``note`` says between which places the greatest rise is.
    """
    at, of = np.asarray(places, dtype=np.float64), np.asarray(levels, dtype=np.float64)
    n, method = len(at), "greatest rise between neighbouring windows along the scale; p: permutation"
    widths = sorted({int(one) for one in np.geomspace(FEWEST, max(FEWEST, n * WIDEST), 6)})
    if n < 2 * FEWEST:
        return cannot_say(f"{n} answers; {2 * FEWEST} are needed", n, method)
    if float(of.std()) == 0.0:
        return Statistic(0.0, n, p=1.0, method=method, note="all levels are alike")
    order = np.argsort(at, kind="stable")
    at, of = at[order], of[order] / of.std()
    seen = list(_rises(of[:, None], widths))
    place = max(range(len(widths)), key=lambda one: float(seen[one].max()))
    value, width, start = float(seen[place].max()), widths[place], int(seen[place].argmax())
    ends = (at[start], at[start + width - 1], at[start + width], at[start + 2 * width - 1])
    note = "most from {:.3g}-{:.3g} to {:.3g}-{:.3g}".format(*ends)
    if value <= 0:
        return Statistic(value, n, p=1.0, method=method, note="nowhere")
    as_high = 0
    for orders in np.array_split(_orders(n, seed, resamples), max(1, resamples // AT_ONCE), axis=1):
        greatest = np.max([one.max(axis=0) for one in _rises(of[orders], widths)], axis=0)
        as_high += int(np.count_nonzero(greatest >= value - 1e-12))
    return Statistic(value, n, p=(1 + as_high) / (resamples + 1), method=method, note=note)


@lru_cache(maxsize=2)
def _orders(n: int, seed: int, resamples: int) -> npt.NDArray[np.int64]:
    """Return random orders of n answers, one a column; the models of a run on one bank share them."""
    orders = np.random.default_rng(seed).permuted(np.tile(np.arange(n), (resamples, 1)), axis=1)
    return np.ascontiguousarray(orders.T)


def _rises(levels: Floats, widths: list[int]) -> Iterator[Floats]:
    """Yield of each column, for each width, the rise between the two windows that begin at each place."""
    sums = np.concatenate((np.zeros((1, levels.shape[1])), np.cumsum(levels, axis=0)))
    for width in widths:
        windows = sums[width:] - sums[:-width]
        yield (windows[width:] - windows[:-width]) / np.sqrt(2 * width)
