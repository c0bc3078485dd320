"""Tables of counts drawn with both margins held fixed (Patefield 1981, AS 159)."""

import sys
from collections.abc import Callable
from functools import cache
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from pathlib import Path

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]
_Draw = Callable[[Ints, Ints, int, int, np.random.Generator], Ints]


def random_tables(rows: Ints, columns: Ints, resamples: int, rng: np.random.Generator) -> Ints:
    """Return tables with these margins, shape (resamples, rows, columns).

    ``rows`` and ``columns`` are positive counts with the same sum, at least two each. Equals
    ``scipy.stats.random_table(rows, columns, seed=rng).rvs(resamples, method="patefield")``.
    """
    draw = _alone()
    if draw is not None:
        return draw(rows, columns, int(rows.sum()), resamples, rng)
    from scipy import stats  # noqa: PLC0415 - slow to import

    return np.asarray(stats.random_table(rows, columns, seed=rng).rvs(resamples, method="patefield"), dtype=np.int64)


@cache
def _alone() -> _Draw | None:
    """Return scipy's compiled sampler without the rest of ``scipy.stats``.

    The rest takes half a second to import. None where scipy keeps it elsewhere, or is loaded.
    """
    import scipy  # noqa: PLC0415 - slow to import

    if "scipy.stats" in sys.modules:
        return None
    found = PathFinder.find_spec("rcont", [str(Path(scipy.__file__).parent / "stats" / "_rcont")])
    if found is None or found.loader is None:
        return None
    module = module_from_spec(found)
    found.loader.exec_module(module)
    draw: _Draw | None = vars(module).get("rvs_rcont2")
    return draw
