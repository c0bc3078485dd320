"""The way round what stands between a vehicle and the offset that it should drive at: on the free side, the nearer one.

A linearised controller improves on a path and does not choose a side; this chooses it, anew at each plan and from the
present place alone, so that equal places give equal choices. Where both sides are equally near it chooses none.
"""

import numpy as np
import numpy.typing as npt

_LOOK_M = 12.0
_BERTH_M = 0.1
_REACH_M = 10.0
"""How far ahead is looked for what is in the way, and how far from its edge it is passed; and how
far a plan drives at most."""

_Disc = tuple[float, float, float]


class Detour:
    """Which offset to steer for, so as to pass what blocks the way to the target's offset on its free side."""

    def __init__(self, discs: npt.NDArray[np.float64], x: float, half_width: float) -> None:
        triples: list[_Disc] = discs.tolist()
        self._discs = [disc for disc in triples if -disc[2] < disc[0] - x < _LOOK_M + _REACH_M]
        self._half = half_width

    def aim(self, x: float, y: float, offset: float) -> float:
        """Return the offset to steer for at a place: the target's own where nothing is in the way, or no way free."""
        if not self._discs:
            return offset
        ahead = [disc for disc in self._discs if -disc[2] < disc[0] - x < _LOOK_M]
        if not ahead or all(abs(offset - cy) >= r and not _between(cy, r, y, offset) for _, cy, r in ahead):
            return offset
        first = min(ahead, key=lambda disc: disc[0] - disc[2])
        group = [disc for disc in ahead if abs(disc[0] - first[0]) < first[2] + disc[2]]
        edges = {cy + side * (r + _BERTH_M) for _, cy, r in group for side in (-1.0, 1.0)} | {offset}
        free = [edge for edge in edges if self._is_free(edge, group)]
        costs = sorted((abs(edge - y) + 0.5 * abs(edge - offset), edge) for edge in free)
        if not costs or (len(costs) > 1 and costs[0][0] == costs[1][0]):
            return offset
        return costs[0][1]

    def _is_free(self, edge: float, group: list[_Disc]) -> bool:
        return abs(edge) <= self._half and all(abs(edge - cy) >= r for _, cy, r in group)


def _between(cy: float, r: float, y: float, offset: float) -> bool:
    """Return whether a disc's edge lies between where the vehicle is and where it should be."""
    return min(y, offset) - r < cy < max(y, offset) + r
