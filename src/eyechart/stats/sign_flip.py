"""Sign-flip tests: whether drivers differ in the same worlds, and answers follow an object."""

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from eyechart.stats.shares import FollowedShare
from eyechart.stats.statistic import TIE, Statistic, chunks, not_available

Floats = npt.NDArray[np.float64]

ENUMERATED_FLIPS = 14
"""Up to this number of nonzero differences all sign patterns are enumerated."""

FOLLOW_LEVEL = 0.98
"""Each end of `follow`'s interval is exceeded with a chance of .01."""


def sign_flip_test(first: npt.ArrayLike, second: npt.ArrayLike, *, seed: int, resamples: int = 5000) -> Statistic:
    """Test two-sidedly whether paired numbers differ: mean(first) - mean(second).

    Two numeric arrays of one length, paired by world. If both of a pair have the same distribution,
    they may be exchanged, which flips the sign of their difference (Fisher 1935). ``p`` is exact
    over all sign patterns of the nonzero differences if these are at most `ENUMERATED_FLIPS`, else
    (k+1)/(B+1). ``n`` counts the pairs. ``detail`` has the numbers of larger, smaller and equal
    first values, both means, and the smallest p that the pairs allow.

    Without a pair the value is None; if all pairs are equal it is 0 and p is 1. There is no
    interval: bootstrap the pairs. ValueError for other arrays.
    """
    a, b = _numbers(first, "first"), _numbers(second, "second")
    if len(a) != len(b):
        raise ValueError(f"{len(a)} values against {len(b)}: give both for the same worlds")
    method = "two-sided test by flipping the signs of paired differences"
    if not len(a):
        return not_available("no pairs", method=method)
    differences = a - b
    moved = differences[differences != 0]
    exact = len(moved) <= ENUMERATED_FLIPS
    smallest = min(1.0, 2.0 ** (1 - len(moved))) if exact else 1 / (resamples + 1)
    detail = {
        "larger": int((differences > 0).sum()),
        "smaller": int((differences < 0).sum()),
        "equal": len(a) - len(moved),
        "first_mean": float(a.mean()),
        "second_mean": float(b.mean()),
        "smallest_p": smallest,
    }
    value = float(differences.mean())
    if not len(moved):
        return Statistic(0.0, len(a), p=1.0, method=method, note="all pairs are equal", detail=detail)
    observed = abs(float(moved.sum())) * (1 - TIE)
    p, how = _share(moved, lambda sums: np.abs(sums) >= observed, seed, resamples)
    return Statistic(value, len(a), p=p, method=f"{method}, {how}", detail=detail)


def follow(gains: npt.ArrayLike, full: npt.ArrayLike, episodes: npt.ArrayLike, *, seed: int) -> Statistic:
    """Return how far answers follow a moved object, over full following, with a one-sided test.

    Three arrays of one entry a frame: ``gains``, how far the answer goes along the object's way;
    ``full``, how far it would go if it followed fully; ``episodes``, labels. The value is
    sum(gains) / sum(full). Its interval is a t interval of the ratio over episodes, by leaving each
    out.

    ``p`` tests a mean gain over episodes above 0, by flipping the signs of whole episodes. It is
    exact up to `ENUMERATED_FLIPS` of them, and cannot be below .01 with fewer than seven. The value
    is None without a frame, and if ``full`` sums to nothing. ``n`` counts the frames; ValueError if
    the lengths differ.
    """
    along, most = _numbers(gains, "gains"), _numbers(full, "full")
    labels = np.asarray(episodes)
    if not len(along) == len(most) == len(labels):
        raise ValueError(f"{len(along)} gains, {len(most)} full ones and {len(labels)} episodes: give one a frame")
    method = "share of what follows fully, one-sided test by flipping the signs of episodes"
    if not len(along) or abs(most.sum()) <= TIE:
        return not_available("nothing was moved that could be followed", len(along), method)
    _, which = np.unique(labels, return_inverse=True)
    sums, fulls, counts = (np.bincount(which, one) for one in (along, most, np.ones_like(along)))
    means, share, many = sums / counts, float(along.sum() / most.sum()), len(sums)
    observed = float(means.sum()) - TIE * float(np.abs(means).sum())
    p, _ = _share(means, lambda sums: sums >= observed, seed, resamples=9999)
    smallest = 2.0**-many if many <= ENUMERATED_FLIPS else 1 / 10_000
    found = FollowedShare(share, len(along), p=p, method=method, episodes=many, smallest_p=smallest)
    if many < 2:
        return replace(found, note="one episode shows no spread")
    from scipy import special  # noqa: PLC0415 - slow to import

    left = (sums.sum() - sums) / (fulls.sum() - fulls)
    error = float(np.sqrt((many - 1) / many * ((left - left.mean()) ** 2).sum()))
    wide = float(special.stdtrit(many - 1, (1 + FOLLOW_LEVEL) / 2)) * error
    return replace(found, ci=(share - wide, share + wide), level=FOLLOW_LEVEL)


def _share(
    values: Floats, reaches: Callable[[Floats], npt.NDArray[np.bool_]], seed: int, resamples: int
) -> tuple[float, str]:
    """Return the p, from the sign patterns whose sum ``reaches`` it, and the patterns in words."""
    if len(values) <= ENUMERATED_FLIPS:
        signs = np.array(list(itertools.product((-1.0, 1.0), repeat=len(values))))
        return float(np.mean(reaches(signs @ values))), f"all {len(signs)} patterns"
    rng, k = np.random.default_rng(seed), 0
    for rows in chunks(resamples, len(values)):
        signs = rng.integers(2, size=(rows.stop - rows.start, len(values))) * 2.0 - 1.0
        k += int(np.count_nonzero(reaches(signs @ values)))
    return (k + 1) / (resamples + 1), f"B={resamples}"


def _numbers(values: npt.ArrayLike, which: str) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or not np.isfinite(array).all():
        raise ValueError(f"the {which} values must be one finite number per world: leave out the worlds without one")
    return array
