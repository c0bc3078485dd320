"""Exact tests and intervals on pairs: whether the same frames got other answers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from eyechart.stats.agreement import binomial_tail, clopper_pearson
from eyechart.stats.association import pair_table
from eyechart.stats.statistic import Statistic, not_available

ENUMERATED_STATES = 20_000
"""Up to this number of distinct outcomes a null distribution is enumerated."""
_COUNTED = 1000
"""Up to this number of pairs the outcomes of a fair coin are counted in integers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SignTest(Statistic):
    """A sign test, with the numbers of frames in which the first is larger, smaller and equal."""

    wins: int
    losses: int
    ties: int


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxedTurns(Statistic):
    """The rate of turns with no side clear, less half of that with one; ``turned`` counts them."""

    turned: int


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscordantPairs(Statistic):
    """A comparison of paired 0/1 outcomes: ``b`` pairs have only the first, ``c`` the second."""

    b: int
    c: int

    @property
    def discordant(self) -> int:
        """Return how many pairs differ."""
        return self.b + self.c


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangedPairs(DiscordantPairs):
    """Decisions that another picture changes: ``changed`` by it and ``repeated`` by a repeat."""

    changed: int
    repeated: int


@dataclass(frozen=True, slots=True)
class Place:
    """One part of the pictures, and how braking depends on the lead there.

    ``of`` is the kind of part: the scenario, the range, the lanes. On ``harder`` of ``frames``
    frames it brakes harder for the nearer lead, on ``lesser`` less hard. ``effect`` is the mean of
    these signs, with one-sided bounds ``low`` and ``high``. ``beside`` is the effect of a vehicle
    in a neighbouring lane less half of the lead's, and ``beside_low`` its bound.
    """

    of: str
    name: str
    frames: int
    harder: int
    lesser: int
    effect: float | None
    low: float | None = None
    high: float | None = None
    beside: float | None = None
    beside_low: float | None = None

    @property
    def where(self) -> str:
        """Return the part's name in words."""
        if self.of == "range":
            return f"from {self.name}"
        if self.of == "scenario":
            name = self.name.replace("`", "'")  # one pair of backticks, whatever a bank calls it
            return f"in `{name}`"
        return f"where {self.of} is {self.name}"

    def __str__(self) -> str:
        return f"{self.where}: {self.harder} of {self.frames}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Places(Statistic):
    """The number of parts of one kind with a property, out of ``n``; ``places`` lists them."""

    places: tuple[Place, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelSwap(Statistic):
    """A label swap test with each label's count under either condition."""

    first: tuple[int, ...]
    second: tuple[int, ...]


def sign_test(first: npt.ArrayLike, second: npt.ArrayLike, *, level: float = 0.95) -> SignTest:
    """Test exactly and one-sidedly whether ``first`` exceeds ``second`` within frames.

    Two numeric arrays of one length, paired by frame (braking levels, or 0/1 agreements). ``value``
    is the share of the discordant pairs in which the first is larger, with its Clopper-Pearson
    interval. ``n`` counts the discordant pairs. ``p`` is P(Bin(n, 1/2) >= wins), which is 1 when no
    pair is discordant (the value is then None). ``detail``: the mean difference over all pairs.
    Equals R ``binom.test(wins, n, alternative = "greater")``.
    """
    a, b = _pair(first, second)
    wins, losses = int(np.count_nonzero(a > b)), int(np.count_nonzero(a < b))
    n = wins + losses
    test = SignTest(
        None,
        n,
        p=1.0,
        method=f"one-sided exact sign test, {100 * level:g}% Clopper-Pearson interval",
        detail={"mean_difference": float(np.mean(a - b)) if len(a) else None},
        level=level,
        wins=wins,
        losses=losses,
        ties=len(a) - n,
    )
    if n == 0:
        return replace(test, note="no discordant pairs")
    return replace(test, value=wins / n, ci=clopper_pearson(wins, n, level), p=_fair_coin_tail(wins, n))


def net_effect(wins: int, losses: int, pairs: int, *, margin: float = 0.10, alpha: float = 0.10) -> Statistic:
    """Test whether wins exceed losses by more than ``margin`` of the pairs: a relevant effect.

    ``value`` is (wins - losses) / pairs. ``p`` belongs to the null "``margin`` or less" (Tango's
    score test, one-sided). ``ci`` is two-sided at 1 - 2 alpha, so its lower end is the one-sided
    bound and reaches the margin exactly when p <= alpha. ValueError if the counts do not fit.
    """
    if not 0 < margin < 1 or not 0 < alpha < 0.5:
        raise ValueError(f"margin={margin} must lie in (0, 1) and alpha={alpha} in (0, .5)")
    statistic = paired_difference_from_counts(wins, losses, pairs, level=1 - 2 * alpha)
    if statistic.value is None:
        return statistic
    return replace(statistic, p=NormalDist().cdf(-_tango_score(wins, losses, pairs, margin)), detail={"margin": margin})


def stratified_association(
    first: npt.ArrayLike, second: npt.ArrayLike, groups: Sequence[object], *, level: float = 0.95
) -> Statistic:
    """Test exactly and one-sidedly whether two 0/1 outcomes go together within groups.

    Three sequences of one length, in the same order of frames. Each group's margins are fixed, so a
    group in which either outcome never varies adds nothing. ``value`` is the share of the other
    groups' frames in which the outcomes are equal, with its Clopper-Pearson interval. ``n`` counts
    these frames. ``p`` is that of the number of joint ones, summed over groups, each
    hypergeometric. It is the exact form of Mantel and Haenszel's test (Birch 1964).
    """
    a, b = _pair(first, second)
    method = "equal within group; p: exact conditional test over the groups' tables, one-sided"
    chances = np.ones(1)
    seen = equal = frames = least = 0
    for group in dict.fromkeys(groups):
        mine = np.array([one == group for one in groups])
        x, y = a[mine], b[mine]
        n, ones, others = len(x), int(x.sum()), int(y.sum())
        if ones in {0, n} or others in {0, n}:
            continue
        chances = np.convolve(chances, _hypergeometric(ones, others, n))
        seen, least = seen + int(np.count_nonzero(x * y)), least + max(0, ones + others - n)
        equal, frames = equal + int(np.count_nonzero(x == y)), frames + n
    if not frames:
        return Statistic(None, 0, p=1.0, method=method, note="in no group do both outcomes vary", level=level)
    p = min(1.0, float(chances[seen - least :].sum()))
    return Statistic(equal / frames, frames, clopper_pearson(equal, frames, level), p, method, level=level)


def mcnemar_exact(b: int, c: int) -> Statistic:
    """Test exactly and two-sidedly whether the two kinds of discordant pair are equally frequent.

    ``b`` pairs of one kind, ``c`` of the other. ``value`` is b/(b+c), ``n`` = b+c, ``p`` twice the
    smaller tail of Bin(n, 1/2), at most 1. Equals R ``binom.test(b, b + c)``; ValueError for a
    negative count. Source: section Symmetry consensus recovers a longitudinal guardian.
    """
    if b < 0 or c < 0:
        raise ValueError(f"discordant counts b={b} and c={c} must not be negative")
    n, method = b + c, "two-sided exact McNemar test"
    if n == 0:
        return Statistic(None, 0, p=1.0, method=method, note="no discordant pairs")
    p = min(1.0, 2 * _fair_coin_tail(max(b, c), n))
    return DiscordantPairs(b / n, n, p=p, method=method, b=b, c=c)


def label_swap_test(first: npt.ArrayLike, second: npt.ArrayLike, *, seed: int, resamples: int = 5000) -> Statistic:
    """Test whether two conditions give the same marginal distribution of labels on the same frames.

    String or integer label arrays of one length, paired by frame. ``value`` is the sum over labels
    of the squared differences of marginal counts. The null swaps the two labels within each frame
    at random, and assumes nothing else about the dependence of frames.

    ``n`` counts the pairs. ``p`` is two-sided. It is exact with at most `ENUMERATED_STATES`
    distinct outcomes (always so with 12 or fewer discordant pairs), else (k+1)/(B+1). ``detail``
    has the labels, both marginals and the discordant pairs.
    """
    names, counts = _pair_counts(first, second)
    n, labels = int(counts.sum()), len(names)
    if n == 0:
        return not_available("no pairs", method="within-frame label swap")
    moves = _moves(counts)
    detail = {"labels": names, "discordant": n - int(np.trace(counts))}
    net = np.array([forward - back for _, _, forward, back in moves], dtype=np.int64)
    observed = int(_squared_difference(net[None, :], moves, labels)[0])
    sizes = [forward + back for _, _, forward, back in moves]
    states = math.prod(size + 1 for size in sizes)
    if states <= ENUMERATED_STATES:
        nets, weights = _net_moves(sizes)
        spread = _squared_difference(nets, moves, labels)
        p, how = min(1.0, float(weights[spread >= observed].sum())), "enumerated"
    else:
        rng = np.random.default_rng(seed)
        nets = 2 * rng.binomial(sizes, 0.5, size=(resamples, len(sizes))) - np.array(sizes)
        spread = _squared_difference(nets, moves, labels)
        p = (int(np.count_nonzero(spread >= observed)) + 1) / (resamples + 1)
        how = f"B={resamples}"
    first, second = (tuple(counts.sum(axis=axis).tolist()) for axis in (1, 0))
    method = f"within-frame label swap, {how}"
    return LabelSwap(float(observed), n, p=p, method=method, detail=detail, first=first, second=second)


def paired_difference(first: npt.ArrayLike, second: npt.ArrayLike, *, level: float = 0.95) -> Statistic:
    """Return mean(first) - mean(second) of paired 0/1 outcomes with Tango's score interval.

    Two boolean (or 0/1) arrays of one length, paired by frame. See `paired_difference_from_counts`.
    """
    b, c, n = _discordant(first, second)
    return paired_difference_from_counts(b, c, n, level=level)


def paired_difference_from_counts(b: int, c: int, n: int, *, level: float = 0.95) -> Statistic:
    """Return the paired difference of proportions (b - c)/n with Tango's score interval (1998).

    ``b`` pairs have only the first outcome, ``c`` only the second, of ``n`` pairs. The interval is
    valid for small n. Without a discordant pair it is +-z^2/(n + z^2). ``level`` is two-sided; 0.98
    gives two one-sided bounds at .01. The value is None when n is 0; ValueError when b + c exceeds
    n.
    """
    if b < 0 or c < 0 or b + c > n:
        raise ValueError(f"b={b} and c={c} discordant pairs do not fit into n={n} pairs")
    method = f"paired difference of proportions, {100 * level:g}% Tango score interval"
    if not 0 < level < 1:
        raise ValueError(f"level={level} must lie between 0 and 1, for example 0.95")
    if n == 0:
        return not_available("no pairs", method=method)
    z = NormalDist().inv_cdf(0.5 + level / 2)
    ci = (_tango_bound(b, c, n, z), _tango_bound(b, c, n, -z))
    return DiscordantPairs((b - c) / n, n, ci, method=method, level=level, b=b, c=c)


def bounded_below(
    first: npt.ArrayLike, second: npt.ArrayLike, *, margin: float = 0.10, alpha: float = 0.01
) -> Statistic:
    """Test whether mean(first) - mean(second) lies below ``margin``: evidence of absence.

    Paired 0/1 arrays as for `paired_difference`. ``p`` belongs to the null "the difference is
    ``margin`` or more" (Tango's score test, one-sided). ``ci`` is two-sided at 1 - 2 alpha, so its
    upper end is the one-sided bound. It lies below the margin exactly when p < alpha, which
    ``detail["bounded"]`` repeats. ValueError for a margin outside (0, 1) or an ``alpha`` outside
    (0, .5).
    """
    if not 0 < margin < 1 or not 0 < alpha < 0.5:
        raise ValueError(f"margin={margin} must lie in (0, 1) and alpha={alpha} in (0, .5)")
    b, c, n = _discordant(first, second)
    difference = paired_difference_from_counts(b, c, n, level=1 - 2 * alpha)
    if difference.value is None:
        return difference
    p = NormalDist().cdf(_tango_score(b, c, n, margin))
    detail = {"margin": margin, "alpha": alpha, "bounded": p < alpha}
    return replace(difference, p=p, detail=detail)


def pairs_to_bound(disagreement: float = 0.0, *, margin: float = 0.10, alpha: float = 0.01) -> int:
    """Return how many pairs bound a difference of 0 below ``margin``.

    ``disagreement`` is the share of discordant pairs, split evenly. It serves an `undecided`
    verdict: this number of frames would decide. ValueError when the disagreement is outside [0, 1].
    """
    if not 0 <= disagreement <= 1 or not 0 < margin < 1 or not 0 < alpha < 0.5:
        raise ValueError(f"no such design: disagreement={disagreement}, margin={margin}, alpha={alpha}")
    z, n = -NormalDist().inv_cdf(alpha), 1
    while _tango_score(n * disagreement / 2, n * disagreement / 2, n, margin) > -z:
        n += 1
    return n


def _pair(first: npt.ArrayLike, second: npt.ArrayLike) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    for which, array in (("first", a), ("second", b)):
        if array.ndim != 1 or np.isnan(array).any():
            raise ValueError(f"the {which} values must be one number per frame: drop the frames without one")
    _same_length(len(a), len(b))
    return a, b


def _same_length(a: int, b: int) -> None:
    if a != b:
        raise ValueError(f"{a} values against {b}: give both for the same frames")


def _discordant(first: npt.ArrayLike, second: npt.ArrayLike) -> tuple[int, int, int]:
    a, b = _pair(first, second)
    if not (np.isin(a, (0, 1)).all() and np.isin(b, (0, 1)).all()):
        raise ValueError("a paired difference of proportions needs outcomes 0 or 1")
    return int(np.count_nonzero(a > b)), int(np.count_nonzero(a < b)), len(a)


def _fair_coin_tail(k: int, n: int) -> float:
    """Return P(Bin(n, 1/2) >= k) for 0 <= k <= n, exact in integers until the last division.

    The shorter tail is summed, and each number of ways follows from the one before. The work grows
    with n², so above `_COUNTED` it is scipy's incomplete beta function: equal to 1e-10 of itself.
    """
    if n > _COUNTED:
        return binomial_tail(k, n, 0.5)
    complement = 2 * k <= n
    ways, term = 0, 1
    for chosen in range(n, (n - k if complement else k - 1), -1):
        ways += term
        term = term * chosen // (n - chosen + 1)
    return float((2**n - ways if complement else ways) / 2**n)


def _hypergeometric(ones: int, others: int, n: int) -> npt.NDArray[np.float64]:
    """Return the hypergeometric chances of each overlap of two subsets of ``n`` frames."""
    from scipy import special  # noqa: PLC0415 - slow to import

    both = np.arange(max(0, ones + others - n), min(ones, others) + 1)

    def ways(of: npt.ArrayLike, chosen: npt.ArrayLike) -> npt.NDArray[np.float64]:
        of, chosen = np.asarray(of), np.asarray(chosen)
        return np.asarray(special.gammaln(of + 1) - special.gammaln(chosen + 1) - special.gammaln(of - chosen + 1))

    return np.asarray(np.exp(ways(others, both) + ways(n - others, ones - both) - ways(n, ones)))


def _pair_counts(first: npt.ArrayLike, second: npt.ArrayLike) -> tuple[list[object], npt.NDArray[np.int64]]:
    """Return the labels and the square table of pairs, first by second."""
    a, b = np.asarray(first), np.asarray(second)
    for which, array in (("first", a), ("second", b)):
        if array.ndim != 1 or (array.size and array.dtype.kind not in "iubU"):
            raise ValueError(f"the {which} labels must be one string or integer per frame, got {array.dtype}")
    _same_length(len(a), len(b))
    return pair_table(a, b)


def _moves(counts: npt.NDArray[np.int64]) -> list[tuple[int, int, int, int]]:
    """Return for each pair of exchanged labels: i, j, moves from i to j, moves from j to i."""
    pairs = zip(*np.triu_indices(len(counts), k=1), strict=True)
    moves = [(int(i), int(j), int(counts[i, j]), int(counts[j, i])) for i, j in pairs]
    return [move for move in moves if move[2] + move[3]]


def _squared_difference(
    nets: npt.NDArray[np.int64], moves: list[tuple[int, int, int, int]], labels: int
) -> npt.NDArray[np.int64]:
    """Return the summed squared marginal differences of each row of net moves, shape (rows,)."""
    incidence = np.zeros((len(moves), labels), dtype=np.int64)
    for row, (i, j, _, _) in enumerate(moves):
        incidence[row, i], incidence[row, j] = 1, -1
    return np.asarray(((nets @ incidence) ** 2).sum(axis=1), dtype=np.int64)


def _net_moves(sizes: list[int]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Return every outcome of the swaps: net moves, shape (states, pairs), and probabilities."""
    nets, weights = np.zeros((1, 0), dtype=np.int64), np.ones(1)
    for size in sizes:
        net = 2 * np.arange(size + 1) - size
        share = np.array([math.comb(size, i) / 2**size for i in range(size + 1)])
        nets = np.hstack([np.repeat(nets, size + 1, axis=0), np.tile(net, len(nets))[:, None]])
        weights = np.outer(weights, share).ravel()
    return nets, weights


def _tango_score(b: float, c: float, n: int, delta: float) -> float:
    """Return Tango's score statistic for the null that the difference is ``delta``, in (-1, 1)."""
    linear = -(b + c) + (2 * n - b + c) * delta
    root = math.sqrt(max(linear * linear + 8 * n * c * delta * (1 - delta), 0.0))
    q = (root - linear) / (4 * n)  # the second cell at its likelihood maximum under the null
    variance = n * (2 * q + delta * (1 - delta))
    excess = b - c - n * delta
    if variance <= 1e-12 * n:
        return 0.0 if abs(excess) <= 1e-9 * n else math.copysign(math.inf, excess)
    return excess / math.sqrt(variance)


def _tango_bound(b: int, c: int, n: int, z: float) -> float:
    """Return the difference at which the falling score equals ``z``, by bisection to 1e-12."""
    low, high = -1.0, 1.0
    while high - low > 1e-12:
        middle = (low + high) / 2
        low, high = (middle, high) if _tango_score(b, c, n, middle) > z else (low, middle)
    return (low + high) / 2
