"""What the scene around the vehicle is, as one label a step: its gap in bins and, for forward cameras, the side.

Source: paper, Table t:degeneracy ("scene geometry"); its bins are not given, these are the battery's quartiles.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eyechart.stats.association import quantile_bins
from eyechart.studies.closed_loop.reading import Drives

GAP, SIDE = "lead_gap_m", "nearest_side"
BINS = 4

GAP_ALONE = "gap in quartiles"
GAP_AND_SIDE = "gap in quartiles × side of the nearest obstacle"


@dataclass(frozen=True)
class Scene:
    """The label of each step's scene; ``geometry`` says of what, and is empty where the truth never tells a gap."""

    codes: NDArray[np.int64]
    geometry: str


def scene_of(drives: Drives) -> Scene:
    """Return the scene at each step of a driver, cut at the quartiles of its own gaps as in the battery.

    A missing gap counts as the farthest. Where the truth names the side of the nearest obstacle (forward cameras),
    each gap bin is told apart by side.
    """
    steps = drives.steps
    told = [_metres(step.truth.get(GAP)) for step in steps]
    if any(GAP not in step.truth for step in steps) or all(gap is None for gap in told):
        return Scene(np.zeros(len(steps), dtype=np.int64), "")
    bins = quantile_bins(told, BINS)
    if not all(SIDE in step.truth for step in steps):
        return Scene(bins.codes, GAP_ALONE)
    sides = np.array([str(step.truth[SIDE]) for step in steps], dtype=np.str_)
    _, side = np.unique(sides, return_inverse=True)
    _, codes = np.unique(bins.codes * (int(side.max()) + 1) + side, return_inverse=True)
    return Scene(codes.astype(np.int64), GAP_AND_SIDE)


def _metres(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
