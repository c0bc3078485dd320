"""Shapley values: a fair division of an interaction's worth among its parts."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from math import factorial

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Subset = frozenset[str]


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
