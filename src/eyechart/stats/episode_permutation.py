"""Episode-safe tests: they exchange gap series of whole episodes, so time within one stays intact.

Frames of an episode resemble each other. If frames are permuted one by one, a controller that
follows anything that drifts through an episode seems to follow the gap. If whole episodes are
exchanged, aligned by step, a follower of the step number or of its own episode's nuisance keeps the
nominal error rate.

Keep the frames without a decision and mark them: dropping them shifts the series against each
other. Then a follower of the step number with 10 % missing answers passes for a follower of the
gap.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from eyechart.stats.association import information_of_tables
from eyechart.stats.statistic import TIE, Statistic, chunks, not_available

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Counts = npt.NDArray[np.unsignedinteger]
Pairs = Floats | Counts

ENUMERATED_ARRANGEMENTS = 20_000
"""Up to this number of exchanges of episodes the null distribution is enumerated."""


@dataclass(frozen=True, slots=True)
class _Strata:
    """Frame numbers (episodes, steps) of each exchangeable stratum, and the excluded strata."""

    strata: tuple[Ints, ...]
    excluded: tuple[str, ...]
    truncated: int
    shifted: int

    def count(self, decided: npt.NDArray[np.bool_]) -> int:
        """Return how many of the used frames have a decision."""
        return sum(int(np.count_nonzero(decided[rows])) for rows in self.strata)

    @property
    def sizes(self) -> tuple[int, ...]:
        return tuple(len(rows) for rows in self.strata)

    def detail(self) -> dict[str, object]:
        """Return the facts that a reader needs to judge the test."""
        counts = {"truncated_frames": self.truncated, "shifted_frames": self.shifted}
        return {"episodes": list(self.sizes), **counts, "excluded": list(self.excluded)}


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodePermutation(Statistic):
    """A test by exchanging episodes, with the smallest possible p; None if frames are permuted."""

    smallest_p: float | None = field(default=None, repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend(EpisodePermutation):
    """A trend with the mean and deviation of its null distribution."""

    null_mean: float
    null_sd: float


def exchange_test(
    level: npt.ArrayLike,
    gap_rank: npt.ArrayLike,
    stratum: npt.ArrayLike,
    episode: npt.ArrayLike,
    step: npt.ArrayLike,
    *,
    seed: int,
    alpha: float = 0.01,
    resamples: int = 5000,
) -> Statistic:
    """Test one-sidedly whether braking happens at near gaps, safe for episodes and time in them.

    Five arrays of one length, one entry per frame. ``level`` is the braking level of the decision,
    an integer of 0 or more; -1 is no decision, which counts nowhere but keeps its place.
    ``gap_rank`` is the gap or its rank (larger is farther, no NaN). ``stratum`` is the scenario.
    ``episode`` is a label within its stratum. ``step`` is a number, distinct within an episode.
    ValueError otherwise.

    ``value`` is T = sum(level * gap_rank) over the frames used; a small T means that braking
    happens nearer. Null: within each stratum the episodes' gap series are exchanged among the
    episodes' action series, aligned by step order. Episodes are cut to the shortest of their
    stratum. A stratum is left out if its shortest is below half of its longest, or with fewer than
    two episodes.

    ``p`` is exact with at most `ENUMERATED_ARRANGEMENTS` arrangements, else (k+1)/(B+1). If the
    smallest attainable p exceeds ``alpha``, value and p are None and ``detail`` gives that p. ``n``
    counts the decisions used. ``detail`` has the episodes per stratum, truncated frames, excluded
    strata, and T's mean and deviation under the null. Its ``shifted_frames`` are aligned with
    another step than their own; the note names them, since the test trusts alignment.

    Source: the rules of the battery, docs/decisions/battery.md.
    """
    levels, ranks = _levels(level), _numbers(gap_rank, "gap_rank")
    layout = _layout(stratum, episode, step, (len(levels), len(ranks)))
    method = "one-sided trend, whole episodes exchanged within scenario"
    n, braking = layout.count(levels >= 0), np.maximum(levels, 0).astype(float)
    if (refusal := _refusal(layout, n, alpha, resamples, method)) is not None:
        return refusal
    # products[i, j]: the actions of episode i against the gaps of episode j, summed over steps
    products = [(braking[rows] @ ranks[rows].T)[:, :, None] for rows in layout.strata]
    observed = float(_aligned(products)[0])
    trend = _null(products, seed, resamples)[:, 0]
    extreme = trend <= observed + TIE * max(1.0, abs(observed))
    return _result(observed, n, extreme, trend, layout, method)


def exchange_mi_test(
    action: npt.ArrayLike,
    gap_bin: npt.ArrayLike,
    stratum: npt.ArrayLike,
    episode: npt.ArrayLike,
    step: npt.ArrayLike,
    *,
    seed: int,
    alpha: float = 0.01,
    resamples: int = 5000,
) -> Statistic:
    """Test mutual information between action and gap bin with the null of `exchange_test`.

    ``action`` and ``gap_bin`` are string or integer labels per frame; the other arguments are as
    there. An action of "" or below 0 is no decision. ``value`` is the plug-in information in bits
    over the used decisions; ``p`` is one-sided for large values. The test finds dependence of any
    shape, also with the wrong sign.
    """
    actions, bins = _codes(action, "action"), _codes(gap_bin, "gap_bin")
    layout = _layout(stratum, episode, step, (len(actions), len(bins)))
    method = "mutual information in bits, whole episodes exchanged within scenario"
    decided = np.asarray(action) != "" if np.asarray(action).dtype.kind == "U" else np.asarray(action) >= 0
    n = layout.count(decided)
    if (refusal := _refusal(layout, n, alpha, resamples, method)) is not None:
        return refusal
    shape = (int(actions.max()) + 1, int(bins.max()) + 1)
    actions = np.where(decided, actions, shape[0])  # one row too many, cut off by _pair_tables
    counts = [_pair_tables(actions[rows], bins[rows], shape) for rows in layout.strata]
    observed = float(information_of_tables(_aligned(counts).reshape(1, *shape))[0])
    information = information_of_tables(_null(counts, seed, resamples).reshape(-1, *shape))
    return replace(_result(observed, n, information >= observed - TIE, information, layout, method), unit="bits")


def iid_trend_test(
    level: npt.ArrayLike,
    gap_rank: npt.ArrayLike,
    stratum: npt.ArrayLike | None = None,
    *,
    seed: int,
    resamples: int = 5000,
) -> Statistic:
    """Test the trend T of `exchange_test` by permuting frame by frame, within ``stratum`` if given.

    Use it only for frames that are declared independent; on autocorrelated episodes it rejects far
    too often. The arrays are those of `exchange_test`, one entry per frame; ValueError if their
    lengths differ. Frames without a decision (level -1) are left out. ``p`` is one-sided for small
    T, (k+1)/(B+1).
    """
    levels, ranks = _levels(level), _numbers(gap_rank, "gap_rank")
    if len(levels) != len(ranks):
        raise ValueError(f"{len(levels)} levels against {len(ranks)} gap ranks: give both for the same frames")
    groups = _codes(stratum, "stratum") if stratum is not None else np.zeros(len(levels), dtype=np.int64)
    if len(groups) != len(levels):
        raise ValueError(f"{len(groups)} strata for {len(levels)} frames: give one per frame")
    decided = levels >= 0
    levels, ranks, groups = levels[decided], ranks[decided], groups[decided]
    n, method = len(levels), f"one-sided trend, frames permuted, B={resamples}"
    if n < 2:
        return not_available("two decisions are needed to permute", n, method)
    observed, rng = float(levels @ ranks), np.random.default_rng(seed)
    trend = np.zeros(resamples)
    for group in range(int(groups.max()) + 1):
        inside = groups == group
        braking = levels[inside].astype(float)
        for rows in chunks(resamples, len(braking)):
            shuffled = rng.permuted(np.tile(ranks[inside], (rows.stop - rows.start, 1)), axis=1)
            trend[rows] += shuffled @ braking
    k = int(np.count_nonzero(trend <= observed + TIE * max(1.0, abs(observed))))
    null_mean, null_sd = float(trend.mean()), float(trend.std())
    p = (k + 1) / (resamples + 1)
    return Trend(observed, n, p=p, method=method, null_mean=null_mean, null_sd=null_sd)


def smallest_p(episodes: int | Sequence[int]) -> float:
    """Return the smallest p of an exchange of episodes: 1 / (the product of k! over strata).

    ``episodes`` counts the episodes of each stratum. Without any it is 1.
    """
    return 1 / _arrangements([episodes] if isinstance(episodes, int) else episodes)


def episodes_needed(strata: int, *, alpha: float = 0.01) -> int:
    """Return how many episodes each of ``strata`` needs for a `smallest_p` of at most ``alpha``.

    ValueError for no stratum or an ``alpha`` outside (0, 1).
    """
    if strata < 1 or not 0 < alpha < 1:
        raise ValueError(f"strata={strata} must be at least 1 and alpha={alpha} in (0, 1)")
    episodes = 2
    while smallest_p([episodes] * strata) > alpha:
        episodes += 1
    return episodes


def _levels(level: npt.ArrayLike) -> Ints:
    array = np.asarray(level)
    if array.ndim != 1 or array.dtype.kind not in "iub" or (array.size and array.astype(np.int64).min() < -1):
        raise ValueError("level must hold one braking level per frame, an integer of 0 or more, -1 for none")
    return array.astype(np.int64)


def _numbers(values: npt.ArrayLike, which: str) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or not np.isfinite(array).all():
        raise ValueError(f"{which} must hold one finite number per frame: rank a missing lead as the farthest")
    return array


def _codes(labels: npt.ArrayLike, which: str) -> Ints:
    array = np.asarray(labels)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iubU"):
        raise ValueError(f"{which} must hold one string or integer per frame, got {array.dtype}")
    return np.unique(array, return_inverse=True)[1].astype(np.int64)


def _arrangements(episodes: Sequence[int]) -> int:
    if any(count < 0 for count in episodes):
        raise ValueError(f"episodes={list(episodes)}: give the number of episodes in each stratum")
    return math.prod(math.factorial(count) for count in episodes)


def _layout(stratum: npt.ArrayLike, episode: npt.ArrayLike, step: npt.ArrayLike, lengths: tuple[int, int]) -> _Strata:
    """Return each exchangeable stratum's frame numbers in step order, cut to a common length."""
    codes, episodes, steps = _codes(stratum, "stratum"), _codes(episode, "episode"), _numbers(step, "step")
    if len({len(codes), len(episodes), len(steps), *lengths}) > 1:
        found = [*lengths, len(codes), len(episodes), len(steps)]
        raise ValueError(f"the five arrays have lengths {found}: give one entry of each per frame")
    kept, excluded, truncated, shifted = [], [], 0, 0
    for name in np.unique(np.asarray(stratum)):
        inside = np.flatnonzero(np.asarray(stratum) == name)
        series = _in_order(inside, episodes, steps)
        shortest, longest = min(map(len, series)), max(map(len, series))
        if len(series) < 2:
            excluded.append(f"{name} has fewer than 2 episodes")
        elif 2 * shortest < longest:
            excluded.append(f"{name} has episodes of {shortest} to {longest} frames, which cannot be aligned")
        else:
            kept.append(np.array([each[:shortest] for each in series]))
            truncated += sum(map(len, series)) - kept[-1].size
            shifted += int(np.count_nonzero(steps[kept[-1]] != np.median(steps[kept[-1]], axis=0)))
    return _Strata(tuple(kept), tuple(excluded), truncated, shifted)


def _in_order(rows: Ints, episodes: Ints, step: Floats) -> list[Ints]:
    """Return the rows of each episode, by step."""
    rows = rows[np.lexsort((step[rows], episodes[rows]))]
    new = np.diff(episodes[rows]) != 0
    twice = np.flatnonzero(~new & (np.diff(step[rows]) == 0))
    if len(twice):
        raise ValueError(
            f"step {step[rows[twice[0]]]:g} occurs twice in one episode (frames number {rows[twice[0]]} and "
            f"{rows[twice[0] + 1]}): number the steps of an episode apart"
        )
    return np.split(rows, np.flatnonzero(new) + 1)


def _refusal(layout: _Strata, n: int, alpha: float, resamples: int, method: str) -> Statistic | None:
    """Return why the test is impossible: even the most extreme arrangement cannot reach alpha."""
    if not 0 < alpha < 1 or resamples < 1:
        raise ValueError(f"alpha={alpha} must lie in (0, 1) and resamples={resamples} be at least 1")
    sampled = _arrangements(layout.sizes) > ENUMERATED_ARRANGEMENTS
    attainable = 1 / (resamples + 1) if sampled else smallest_p(layout.sizes)
    if attainable <= alpha:
        return None if n else not_available("no decisions", method=method)
    sizes = ", ".join(map(str, layout.sizes)) or "no"
    why = f"exchanging {sizes} episodes per scenario gives a p of {attainable:.3g} at best"
    note = "; ".join([f"{why}, above {alpha:g}", *layout.excluded])
    detail = {**layout.detail(), "smallest_p": attainable}
    return EpisodePermutation(None, n, method=method, note=note, detail=detail, smallest_p=attainable)


def _aligned(pairs: Sequence[Pairs]) -> Floats:
    """Return the summed pair values of the observed arrangement, shape (m,)."""
    return np.asarray(sum(np.trace(each, dtype=np.float64) for each in pairs), dtype=np.float64)


def _null(pairs: Sequence[Pairs], seed: int, resamples: int) -> Floats:
    """Return the summed pair values of each arrangement, shape (arrangements, m).

    ``pairs`` holds per stratum an array (action episode, gap episode, m).
    """
    m = pairs[0].shape[2]
    if _arrangements([len(each) for each in pairs]) <= ENUMERATED_ARRANGEMENTS:
        null = np.zeros((1, m))
        for each in pairs:
            orders = np.array(list(itertools.permutations(range(len(each)))))
            null = (null[:, None, :] + _gather(each, orders)[None, :, :]).reshape(-1, m)
        return null
    rng = np.random.default_rng(seed)
    null = np.zeros((resamples, m))
    for each in pairs:
        for rows in chunks(resamples, len(each)):
            orders = rng.permuted(np.tile(np.arange(len(each)), (rows.stop - rows.start, 1)), axis=1)
            null[rows] += _gather(each, orders)
    return null


def _gather(pairs: Pairs, orders: Ints) -> Floats:
    """Return sum over i of pairs[i, order[i]] for each row of orders, shape (orders, m)."""
    out = np.zeros((len(orders), pairs.shape[2]))
    for i in range(len(pairs)):
        out += pairs[i, orders[:, i]]
    return out


def _pair_tables(actions: Ints, bins: Ints, shape: tuple[int, int]) -> Counts:
    """Return counts of (action, bin), flat, for each action episode against each gap episode.

    An action of ``shape[0]`` is no decision and does not count. A count is at most the number of
    steps, so the smallest sufficient type is used. A thousand episodes against a thousand then take
    some ten megabytes.
    """
    k, steps = actions.shape
    out = np.empty((k, k, shape[0], shape[1]), dtype=np.min_scalar_type(steps))
    for action, bin_ in itertools.product(range(shape[0]), range(shape[1])):
        out[:, :, action, bin_] = (actions == action).astype(np.float32) @ (bins == bin_).astype(np.float32).T
    return out.reshape(k, k, -1)


def _result(
    observed: float, n: int, extreme: npt.NDArray[np.bool_], null: Floats, layout: _Strata, method: str
) -> Statistic:
    """Return the statistic with p = k/N over all arrangements, or (k+1)/(B+1) over random ones."""
    k, resamples = int(np.count_nonzero(extreme)), len(null)
    if _arrangements(layout.sizes) <= ENUMERATED_ARRANGEMENTS:
        p, smallest, how = k / resamples, 1 / resamples, f"all {resamples} arrangements"
    else:
        p, smallest, how = (k + 1) / (resamples + 1), 1 / (resamples + 1), f"B={resamples}"
    detail = {**layout.detail(), "smallest_p": smallest}
    notes = list(layout.excluded)
    if layout.shifted:
        notes.append(f"{layout.shifted} frames are aligned with another step: mark missing decisions, drop none")
    note = "; ".join(notes)
    null_mean, null_sd = float(null.mean()), float(null.std())
    trend = Trend(observed, n, p=p, method=f"{method}, {how}", null_mean=null_mean, null_sd=null_sd)
    return replace(trend, note=note, detail=detail, smallest_p=smallest)
