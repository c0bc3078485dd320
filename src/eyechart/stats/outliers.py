"""A few numbers of a log that lie far from all others: faults of it, or moves that are rare.

Source: docs/decisions/policies.md.
"""

import numpy as np
import numpy.typing as npt

FAR = 5.0
"""Multiple of the distance from the median within which 95 of 100 numbers lie."""
FEW = 0.025
"""The largest share of exceptions; a fast move in a log that mostly stands has more."""
WIDER = 1.5
"""The column's spread over that of its other numbers, from which numbers are far."""
LEAST = 20
"""With fewer numbers none counts as far."""
ONE_IN = 20
"""Numbers far in two episodes or more, and in more than one of so many, recur: a rare move."""


def outlying(numbers: npt.ArrayLike, *, at_once: int = 1) -> npt.NDArray[np.bool_]:
    """Return which numbers lie far from all others of their column, as an array of shape (n, d).

    They lie beyond `FAR` times the distance from the median that 95 of 100 keep. They are at most
    `FEW` of all, or ``at_once`` if one row of a log is that many. With them, the column's spread is
    more than `WIDER` times that of the others. A column with 95 of 100 numbers equal has none. NaN
    is none.

    They may be faults, or rare moves, such as a gripper that closes once: `recurs` tells these
    apart.
    """
    given = np.asarray(numbers, np.float64)
    result = np.zeros(given.shape, dtype=bool)
    for column in range(given.shape[1]):
        one = given[:, column]
        known = one[np.isfinite(one)]
        if len(known) < LEAST:
            continue
        away = np.abs(one - np.median(known))
        usual = float(np.quantile(away[np.isfinite(one)], 0.95))
        with np.errstate(invalid="ignore"):
            far = away > FAR * usual
        others = known[~far[np.isfinite(one)]]
        if usual > 0 and 0 < far.sum() <= max(at_once, FEW * len(known)) and known.std() > WIDER * others.std():
            result[:, column] = far
    return result


def recurs(far: npt.ArrayLike, episodes: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Return the columns whose far numbers lie in several episodes, shape (d,).

    ``far`` has shape (n, d), ``episodes`` (n,).
    """
    where, which = np.asarray(far, dtype=bool), np.asarray(episodes)
    most = max(1, len(np.unique(which)) // ONE_IN)
    return np.array([len(np.unique(which[one])) > most for one in where.T], dtype=bool)
