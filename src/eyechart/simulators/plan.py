"""Plans of balanced episodes: the gap, the clear sides and the own lane of each moment.

The gap has no trend over the episode, and sides and lane are drawn without regard to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

MOST_TREND = 0.2
"""The largest Spearman correlation, in magnitude, of step and gap in an episode: the gap must not
tell the time."""

LEAST_STEPS = 4
"""Fewer moments cannot contain a near gap, LEFT, RIGHT and a far gap in an order without a
trend."""

_KINDS = {"near": 3, "left": 3, "right": 3, "far": 2, "slow": 1}
"""Number of moments of each kind in an episode of twelve."""

_BOXED_KINDS = {**_KINDS, "near": 2, "slow": 2}
"""The same with at least a sixth of moments in which neither side is clear."""

_MIDDLE = {"left": (True, False), "right": (False, True), "slow": (False, False)}
"""The clear sides, left and right, of each kind of middle gap; ``slow`` may also have both."""

_BEYOND_THE_EDGE = 0.5
_CLOSE_SHARE = 0.4
_LEAST_MOVE_M = 0.6


@dataclass(frozen=True, slots=True)
class Bands:
    """The bands of gaps of a balanced episode: the least gap and the width of each, in metres.

    ``near`` demands a stop, ``close`` and ``middle`` the one clear side, ``far`` none of these;
    ``beyond`` is outside the picture. Space between the bands and around the picture's edge keeps
    every gap clear of borderline pixels.
    """

    near: tuple[float, float]
    close: tuple[float, float]
    middle: tuple[float, float]
    far: tuple[float, float]
    beyond: tuple[float, float]


@dataclass(frozen=True, slots=True)
class MomentSpec:
    """A planned moment: its gap, whether left and right are clear, and the lane from the left."""

    gap_m: float
    sides: tuple[bool, bool]
    lane: int


@dataclass(frozen=True, slots=True)
class Lanes:
    """The number of lanes of a road, and the lanes, from the left, in which the ego may be."""

    count: int
    ego: tuple[int, ...]

    def fit(self, sides: tuple[bool, bool]) -> list[int]:
        """Return the own lanes that have a neighbouring lane on each side that must be clear."""
        left, right = sides
        return [lane for lane in self.ego if (lane > 0 or not left) and (lane < self.count - 1 or not right)]


def make_plan(
    lanes: Lanes, bands: Bands, steps: int, rng: np.random.Generator, *, boxed: bool = False
) -> list[MomentSpec]:
    """Return one planned moment a step, in an order in which the gap has no trend.

    With ``boxed``, at least a sixth of an episode of twelve has no clear side.
    """
    kinds = [kind for kind, count in share(steps, rng, boxed=boxed).items() for _ in range(count)]
    wishes = []
    for gap_m, sides in zip(_draw_gaps(kinds, bands, rng), _draw_sides(kinds, lanes, rng, boxed=boxed), strict=True):
        fits = lanes.fit(sides)
        wishes.append(MomentSpec(gap_m=gap_m, sides=sides, lane=fits[rng.integers(len(fits))]))
    gaps = np.array([wish.gap_m for wish in wishes])
    while True:
        order = rng.permutation(steps)
        if abs(trend(gaps[order])) <= MOST_TREND:
            return [wishes[place] for place in order]


def other_gap(gap_m: float | None, bounds: tuple[float, float], rng: np.random.Generator) -> float:
    """Return a gap within bounds that differs visibly from the present gap, if there is one."""
    while True:
        other_m = float(rng.uniform(*bounds))
        if gap_m is None or abs(other_m - gap_m) >= _LEAST_MOVE_M:
            return other_m


def share(steps: int, rng: np.random.Generator, *, boxed: bool = False) -> dict[str, int]:
    """Return how many of an episode's moments are of each kind, by largest remainders."""
    kinds = _BOXED_KINDS if boxed else _KINDS
    parts = sum(kinds.values())
    counts = {kind: steps * part // parts for kind, part in kinds.items()}
    tie_breaks = dict(zip(kinds, rng.permutation(len(kinds)).tolist(), strict=True))

    def turn(kind: str) -> tuple[int, bool, int]:
        return -(steps * kinds[kind] % parts), boxed and kind == "slow", tie_breaks[kind]

    by_remainder = sorted(kinds, key=turn)
    for kind in by_remainder[: steps - sum(counts.values())]:
        counts[kind] += 1
    return counts


def trend(gaps: npt.NDArray[np.float64]) -> float:
    """Return Spearman's correlation of gaps with their order; shape (steps,), no ties."""
    ranks = np.argsort(np.argsort(gaps))
    return float(np.corrcoef(ranks, np.arange(len(ranks)))[0, 1])


def _draw_gaps(kinds: Sequence[str], bands: Bands, rng: np.random.Generator) -> list[float]:
    """Return a gap for each moment, spread evenly within its kind, in metres."""
    drawn = []
    for number, kind in enumerate(kinds):
        first = kinds.index(kind)
        even = float((number - first + rng.uniform()) / kinds.count(kind))
        if kind == "near":
            least, width = bands.near
        elif kind == "far":
            least, width = bands.beyond if number > first and rng.uniform() < _BEYOND_THE_EDGE else bands.far
        elif even < _CLOSE_SHARE:
            least, width, even = *bands.close, even / _CLOSE_SHARE
        else:
            least, width, even = *bands.middle, (even - _CLOSE_SHARE) / (1.0 - _CLOSE_SHARE)
        drawn.append(least + width * even)
    return drawn


def _draw_sides(
    kinds: Sequence[str], lanes: Lanes, rng: np.random.Generator, *, boxed: bool
) -> list[tuple[bool, bool]]:
    """Return the clear sides of each moment; near and far gaps draw from the middle kinds."""
    drawn, counts = [], _BOXED_KINDS if boxed else _KINDS
    of_all = tuple(kind for kind in _MIDDLE for _ in range(counts[kind]))
    for kind in kinds:
        like = kind if kind in _MIDDLE else of_all[rng.integers(len(of_all))]
        sides = _MIDDLE[like]
        closed = boxed and kind == "slow"
        if like == "slow" and not closed and rng.uniform() < 1 / 2 and lanes.fit((True, True)):
            sides = (True, True)
        drawn.append(sides)
    return drawn
