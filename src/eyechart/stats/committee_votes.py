"""A committee of models votes on hazards: its answers, the best committee, and that by fold.

Votes have the shape (models, frames, views) and are 1 for hazard, 0 for clear and -1 for a missing
vote. Source: section Symmetry-consensus longitudinal guardian.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]

Point = Literal["two_way", "abstain", "unanimous"]
POINTS: tuple[Point, ...] = ("two_way", "abstain", "unanimous")
"""The operating points, in their order in ties."""

HAZARD, CLEAR, ABSTAIN = 1, 0, -1
MISSING = -1

CHUNK = 4_000_000
"""Committee-frames counted at a time."""

_DEAREST = 1e30
"""The largest cost that is accepted; sums of larger ones may be infinite."""

CLOSE = 1e-12
"""Costs this close are equal, and the tie-break decides."""


@dataclass(frozen=True, slots=True)
class Costs:
    """The costs of a missed hazard, a false alarm, and an abstention.

    Without a cost of abstention only the two-way point is considered, and a frame without an answer
    counts as a false alarm. ``hazard_rate`` is the share of hazardous frames in deployment; None
    takes the frames' own share. ValueError for a negative cost, for no cost at all, and for a rate
    outside (0, 1).
    """

    miss: float
    false_alarm: float
    abstention: float | None = None
    hazard_rate: float | None = None

    def __post_init__(self) -> None:
        given = [cost for cost in (self.miss, self.false_alarm, self.abstention) if cost is not None]
        if not all(0 <= cost <= _DEAREST for cost in given) or not self.miss + self.false_alarm > 0:
            raise ValueError(f"costs must be 0 or more, up to {_DEAREST:g}, and not all 0; got {self}")
        if self.hazard_rate is not None and not 0 < self.hazard_rate < 1:
            raise ValueError(f"hazard_rate={self.hazard_rate} must lie between 0 and 1")


@dataclass(frozen=True, slots=True)
class CommitteeChoice:
    """A committee by its models' numbers, its threshold and operating point, and its worth.

    ``worth`` is the balanced accuracy, or with costs minus the expected cost of a frame.
    """

    committee: tuple[int, ...]
    threshold: int
    point: Point
    worth: float


@dataclass(frozen=True, slots=True)
class Tally:
    """How often each committee gave each number of votes.

    ``committees`` has shape (committees, size), in lexicographic order. ``counts`` has shape
    (committees, groups, 2, bins). Class 1 is hazard, and bin h + (voters + 1) m holds frames with h
    hazard votes and m missing ones. ``hazard_votes`` has shape (models, groups): each model's
    hazard votes by group.
    """

    committees: Ints
    counts: Ints
    voters: int
    hazard_votes: Ints


def answers(hazard: npt.ArrayLike, missing: npt.ArrayLike, *, voters: int, threshold: int, point: Point) -> Ints:
    """Return a committee's answer to these numbers of votes: HAZARD, CLEAR or ABSTAIN.

    Without missing votes, ``two_way`` answers hazard from ``threshold`` votes on, else clear.
    ``abstain`` answers so only if most votes agree with it, ``unanimous`` only if all votes are
    equal. As hazard votes grow, the answer only goes from clear over none to hazard.

    With missing votes, it answers hazard if no value of them can change that, else abstains. Only a
    full committee answers clear. ValueError for an impossible count or threshold.
    """
    h, m = np.asarray(hazard, dtype=np.int64), np.asarray(missing, dtype=np.int64)
    if not 1 <= threshold <= voters:
        raise ValueError(f"threshold={threshold} must lie between 1 and the {voters} votes of the committee")
    if (h < 0).any() or (m < 0).any() or (h + m > voters).any():
        raise ValueError(f"hazard and missing votes must be whole numbers whose sum is at most {voters}")
    full = _full(np.arange(voters + 1), voters, threshold, point)
    sure = np.ones(np.broadcast_shapes(h.shape, m.shape), dtype=np.bool_)
    for more in range(int(m.max(initial=0)) + 1):
        sure &= (more > m) | (full[np.minimum(h + more, voters)] == HAZARD)
    clear = (m == 0) & (full[h] == CLEAR)
    return np.where(sure, HAZARD, np.where(clear, CLEAR, ABSTAIN)).astype(np.int64)


def _full(h: Ints, voters: int, threshold: int, point: Point) -> Ints:
    """Return a full committee's answer to each number of hazard votes."""
    if point == "unanimous":
        return np.where(h == voters, HAZARD, np.where(h == 0, CLEAR, ABSTAIN)).astype(np.int64)
    two_way = np.where(h >= threshold, HAZARD, CLEAR)
    if point == "two_way":
        return two_way
    most = np.sign(2 * h - voters)
    agreed = ((two_way == HAZARD) & (most > 0)) | ((two_way == CLEAR) & (most < 0))
    return np.where(agreed, two_way, ABSTAIN).astype(np.int64)


def tally(votes: npt.NDArray[np.int8], hazard: Bools, group: Ints, *, size: int) -> Tally:
    """Count the votes of every committee of ``size`` models, group by group.

    ``votes`` has shape (models, frames, views), ``hazard`` and ``group`` (frames,); groups are
    numbered from 0. ValueError where fewer models than ``size`` vote.
    """
    models, frames, views = votes.shape
    if not 1 <= size <= models:
        raise ValueError(f"a committee of {size} cannot be chosen from {models} models")
    voters, groups = size * views, int(group.max(initial=0)) + 1
    said = (votes == HAZARD).sum(axis=2, dtype=np.int64)
    missing = (votes == MISSING).sum(axis=2, dtype=np.int64)
    most = int(np.sort(missing.max(axis=1, initial=0))[-size:].sum())
    bins = (voters + 1) * (most + 1)
    code = said + (voters + 1) * missing
    place = (group * 2 + hazard) * bins
    chosen = np.array(list(combinations(range(models), size)), dtype=np.int64)
    cells = groups * 2 * bins
    counts = np.empty((len(chosen), groups, 2, bins), dtype=np.int64)
    step = max(1, CHUNK // max(frames, 1))
    for start in range(0, len(chosen), step):
        part = chosen[start : start + step]
        where = place + np.arange(len(part))[:, None] * cells
        for column in part.T:
            where += code[column]
        found = np.bincount(where.ravel(), minlength=len(part) * cells)
        counts[start : start + step] = found.reshape(len(part), groups, 2, bins)
    spoken = np.stack([np.bincount(group, weights=one, minlength=groups) for one in said])
    return Tally(chosen, counts, voters, spoken.astype(np.int64))


def select(found: Tally, costs: Costs | None = None) -> CommitteeChoice:
    """Return the best committee, threshold and operating point on all groups of a tally.

    Best is the highest balanced accuracy of the two-way point, with a frame without an answer as
    wrong; or with costs the lowest expected cost. Among equals, committees in which every model
    votes hazard on some frame come first, since another model adds nothing. Then the first
    committee in lexicographic order, the lowest threshold, and the first of ``POINTS`` decide.
    ValueError if a class has no frame.
    """
    return _choices(found, found.counts.sum(axis=1)[:, None], found.hazard_votes.sum(axis=1)[:, None], costs)[0]


def select_without_each(found: Tally, costs: Costs | None = None) -> tuple[CommitteeChoice, ...]:
    """Return `select`'s choice without each group. ValueError if the others lack a class."""
    spoken = found.hazard_votes
    others = spoken.sum(axis=1)[:, None] - spoken
    return _choices(found, found.counts.sum(axis=1)[:, None] - found.counts, others, costs)


def _choices(found: Tally, counts: Ints, spoken: Ints, costs: Costs | None) -> tuple[CommitteeChoice, ...]:
    """Return the best choice for each set of counts, which have shape (committees, sets, 2, bins).

    ``spoken``, shape (models, sets), counts each model's hazard votes.
    """
    sizes = counts[0].sum(axis=-1)
    if not (sizes > 0).all():
        raise ValueError("the frames to choose on need at least one hazardous and one clear frame")
    options = [
        (threshold, point)
        for threshold in range(1, found.voters + 1)
        for point in (POINTS if costs is not None and costs.abstention is not None else POINTS[:1])
    ]
    table = _answer_table(found, counts.shape[-1], options)
    worth = _balanced(counts, table, sizes) if costs is None else -_expected(counts, table, sizes, costs)
    flat = np.moveaxis(worth, 1, 0).reshape(worth.shape[1], -1)
    best = flat.max(axis=1)
    slack = 0 if costs is None else CLOSE * np.maximum(1.0, np.abs(best))
    able = np.repeat((spoken > 0)[found.committees].all(axis=1).T, len(options), axis=1)
    firsts = np.argmax((flat >= (best - slack)[:, None]) * (1 + able), axis=1)
    chosen = []
    for fold, first in enumerate(firsts):
        committee, option = divmod(int(first), len(options))
        scale = 1.0 if costs is not None else float(2 * sizes[fold, 0] * sizes[fold, 1])
        members = tuple(found.committees[committee].tolist())
        chosen.append(CommitteeChoice(members, *options[option], worth=float(flat[fold, first]) / scale))
    return tuple(chosen)


def _answer_table(found: Tally, bins: int, options: list[tuple[int, Point]]) -> Ints:
    """Return each option's answer in each bin, shape (bins, options)."""
    m, h = np.divmod(np.arange(bins), found.voters + 1)
    possible = h + m <= found.voters
    h, m = np.where(possible, h, 0), np.where(possible, m, 0)
    columns = [answers(h, m, voters=found.voters, threshold=threshold, point=point) for threshold, point in options]
    return np.stack(columns, axis=1)


def _balanced(counts: Ints, table: Ints, sizes: Ints) -> Ints:
    """Return balanced accuracies (committees, sets, options), times twice both class sizes.

    With these factors they are integers, so ties are exact.
    """
    hits = counts[:, :, 1] @ (table == HAZARD).astype(np.int64)
    passes = counts[:, :, 0] @ (table == CLEAR).astype(np.int64)
    both = hits * sizes[None, :, 0, None] + passes * sizes[None, :, 1, None]
    return np.asarray(both, dtype=np.int64)


def _expected(counts: Ints, table: Ints, sizes: Ints, costs: Costs) -> Floats:
    """Return the expected cost of a frame, shape (committees, sets, options)."""
    unanswered = costs.false_alarm if costs.abstention is None else costs.abstention
    of_hazard = np.where(table == CLEAR, costs.miss, np.where(table == ABSTAIN, unanswered, 0.0))
    of_clear = np.where(table == HAZARD, costs.false_alarm, np.where(table == ABSTAIN, unanswered, 0.0))
    share = sizes[:, 1] / sizes.sum(axis=1) if costs.hazard_rate is None else np.full(len(sizes), costs.hazard_rate)
    missed = (counts[:, :, 1] @ of_hazard) / sizes[None, :, 1, None]
    alarmed = (counts[:, :, 0] @ of_clear) / sizes[None, :, 0, None]
    return np.asarray(share[None, :, None] * missed + (1 - share)[None, :, None] * alarmed, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class CoveragePoint:
    """One point of a risk–coverage curve: frames, those answered, and those answered wrong."""

    margin: int
    answered: int
    wrong: int
    frames: int


def risk_coverage(hazard_votes: Ints, answer: Ints, truth: Bools, *, voters: int) -> Iterator[CoveragePoint]:
    """Yield the risk–coverage curve of answers, from the surest frames to all answered ones.

    A committee's certainty about a frame is its margin, the difference of votes between the two
    sides.
    """
    margin = np.abs(2 * hazard_votes - voters)
    said = answer != ABSTAIN
    for least in sorted({int(one) for one in margin[said]}, reverse=True):
        kept = said & (margin >= least)
        wrong = int(np.count_nonzero((answer == HAZARD)[kept] != truth[kept]))
        yield CoveragePoint(least, int(kept.sum()), wrong, len(truth))
