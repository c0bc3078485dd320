"""How often two sets of answers agree, and how often they would by chance."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from eyechart.stats.association import labels_of, pair_table
from eyechart.stats.margins import random_tables
from eyechart.stats.statistic import Statistic, not_available, special_functions


def rate(k: int, n: int, *, level: float = 0.95) -> Statistic:
    """Return the share k/n with its Wilson score interval (1927, without continuity correction).

    ``k`` successes of ``n`` trials, both counts; ``level`` is the two-sided level of the interval.
    The value is None when ``n`` is 0. ValueError when k is outside 0..n or the level outside (0,
    1).
    """
    if not 0 <= k <= n:
        raise ValueError(f"a rate needs 0 <= k <= n, got k={k} of n={n}: check what is counted")
    method = f"share, {100 * level:g}% Wilson interval"
    if n == 0:
        return not_available("no observations", method=method)
    return Statistic(value=k / n, n=n, ci=_wilson(k, n, level), method=method, detail={"k": k}, level=level)


def clears_floor(idi_value: float, s: float) -> bool:
    """Return whether IDI > 1.5 s, strictly; ValueError unless both are rates between 0 and 1.

    It is a flag of the paper and no gate: no IDI can clear the floor once s > 2/3. Source: section
    The Input-Ablation Battery.
    """
    for name, share in (("IDI", idi_value), ("s", s)):
        if not 0 <= share <= 1:
            raise ValueError(f"{name}={share} is not a rate: give a share between 0 and 1")
    return idi_value > 1.5 * s


def cohens_kappa(first: npt.ArrayLike, second: npt.ArrayLike, *, level: float = 0.95) -> Statistic:
    """Return Cohen's kappa of two label sequences with its large-sample interval.

    ``first`` and ``second`` are one-dimensional arrays of strings or integers, of one length, in
    the same order of frames. A missing answer needs a label of its own (the paper keeps UNPARSED in
    agreement); None and NaN raise ValueError.

    The standard error is that of Fleiss, Cohen and Everitt (1969, eq. 13). If it is 0 (kappa of 1,
    a constant rater), the interval is Wilson's of the raw agreement, mapped through the marginals.
    An interval of no width would claim certainty. The value is None if both sequences are the same
    constant: chance agreement is then 1 and kappa is 0/0.
    """
    a, b = _label_pair(first, second)
    n = len(a)
    if n == 0:
        return not_available("no observations", method="Cohen's kappa")
    joint = pair_table(a, b)[1] / n
    observed = float(np.trace(joint))
    chance = float(joint.sum(axis=1) @ joint.sum(axis=0))
    if np.count_nonzero(joint) == 1 and observed > 0:
        return not_available("both sequences are the same constant: chance agreement is 1", n, "Cohen's kappa")
    kappa = (observed - chance) / (1 - chance)
    error = _kappa_error(joint, kappa, chance) / math.sqrt(n)
    detail = {"agreement": observed, "chance": chance, "standard_error": error}
    if error > 1e-9:
        half = _normal_quantile(level) * error
        ci, how = (max(-1.0, kappa - half), min(1.0, kappa + half)), "asymptotic interval"
    else:
        low, high = _wilson(round(observed * n), n, level)
        ci = ((low - chance) / (1 - chance), (high - chance) / (1 - chance))
        how = "Wilson interval of the agreement, marginals held fixed"
    return Statistic(kappa, n, ci, method=f"Cohen's kappa, {100 * level:g}% {how}", detail=detail, level=level)


def pooled_kappa(columns: npt.ArrayLike, *, margin: float = 0.10, alpha: float = 0.01) -> Statistic:
    """Test whether answers that should be equal agree beyond chance by less than ``margin``.

    ``columns``, shape (frames, m) with m of 2 or more, holds codes of answers; -1 is none. Its m
    pictures of a frame call for the same answer. ``value`` is (agreement - chance) /
    (1 - chance). Agreement is over all pairs of answers to one frame, chance over answers to
    different frames.

    ``p`` belongs to the null "kappa is ``margin`` or more". The upper end of ``ci``, two-sided at 1
    - 2 alpha, lies below the margin exactly when p < alpha. Both use Wilson's score with chance
    fixed, at the effective number of pairs. Pairs of one frame may resemble each other, so their
    number is divided by the design effect, at least 1 (Kish 1965).

    ``n`` counts the frames with a pair. The value is None below two of them, and if all answers are
    equal. ValueError for columns of another shape or kind, or an ``alpha`` outside (0, .5).
    """
    given = np.asarray(columns)
    if given.ndim != 2 or given.shape[1] < 2 or given.dtype.kind not in "iu" or not 0 < alpha < 0.5:
        got = f"{given.dtype} {given.shape} and {alpha=}"
        raise ValueError(f"give integer codes of shape (frames, m), m of 2 or more, and an alpha below .5; got {got}")
    method = f"pooled kappa, {100 * (1 - 2 * alpha):g}% Wilson interval of the agreement, chance held fixed"
    pairs, hits, expected = _pairs_within(given)
    total, frames = float(pairs.sum()), int(np.count_nonzero(pairs))
    if frames < 2:
        return not_available(f"{frames} frames have two answers to compare", frames, method)
    agree, chance = float(hits.sum()) / total, expected / total
    if chance >= 1:
        return not_available("all answers are the same: chance agreement is 1", frames, method)
    binomial = agree * (1 - agree) * total
    spread = float(((hits - agree * pairs) ** 2).sum())
    effect = max(1.0, spread / binomial) if binomial > 0 else 1.0
    low, high = _wilson(agree * total / effect, total / effect, 1 - 2 * alpha)
    null = chance + margin * (1 - chance)
    deviation = math.sqrt(null * (1 - null) * effect / total)
    p = NormalDist().cdf((agree - null) / deviation)
    detail = {"agreement": agree, "chance": chance, "pairs": int(total), "design_effect": effect, "margin": margin}
    value, low, high = ((share - chance) / (1 - chance) for share in (agree, low, high))
    return Statistic(value, frames, (low, high), p, method, detail=detail, level=1 - 2 * alpha)


def _pairs_within(columns: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], float]:
    """Return each frame's pairs and agreeing pairs, and the agreement expected between frames."""
    pairs, hits, expected = np.zeros(len(columns)), np.zeros(len(columns)), 0.0
    for i in range(columns.shape[1]):
        for j in range(i):
            both = (columns[:, i] >= 0) & (columns[:, j] >= 0)
            n = int(both.sum())
            if n < 2:
                continue
            same = both & (columns[:, i] == columns[:, j])
            size = int(columns.max()) + 1
            one, other = (np.bincount(columns[both, place], minlength=size) for place in (i, j))
            pairs, hits = pairs + both, hits + same
            expected += (float(one @ other) - int(same.sum())) / (n - 1)
    return pairs, hits, expected


@dataclass(frozen=True, slots=True, kw_only=True)
class SwapRate(Statistic):
    """A mirror swap rate with its chance rate by the marginals, None without directional decisions.

    ``tested`` names the test of its p.
    """

    chance: float | None = None
    tested: str = field(default="", repr=False)


def swap_test(
    real: npt.ArrayLike,
    mirrored: npt.ArrayLike,
    partner: Mapping[str, str],
    *,
    seed: int,
    resamples: int = 5000,
    level: float = 0.95,
) -> SwapRate:
    """Return the mirror swap rate, tested against its chance given the marginals.

    ``real`` and ``mirrored`` are string arrays of one length, by frame; a missing mirrored answer
    has a label of its own and is no swap. ``partner`` maps each directional label to its mirror
    label. Only frames whose real label is in it count.

    ``p`` is one-sided, (k+1)/(B+1), from random pairings of real directional decisions with their
    mirrored decisions. ``chance`` is the expected rate. ``detail`` has its exact one-sided
    ``binomial_p``, ``resample_mean`` and ``directions``, the number of each real one.
    """
    a, b = _label_pair(real, mirrored)
    directional = np.isin(a, list(partner))
    a, b = a[directional], b[directional]
    result = rate(int(np.count_nonzero(_partners(a, partner) == b)), len(a), level=level)
    directions = {name: int(np.count_nonzero(a == name)) for name in partner}
    if result.value is None:
        note = "no directional decisions"
        return SwapRate(None, 0, method=result.method, note=note, detail={"directions": directions}, level=level)
    wanted = _partners(a, partner)
    chance = sum(float(np.mean(wanted == name) * np.mean(b == name)) for name in set(partner.values()))
    swaps = int(np.count_nonzero(wanted == b))
    resampled = _repaired(wanted, b, seed=seed, resamples=resamples)
    p = (int(np.count_nonzero(resampled >= swaps)) + 1) / (resamples + 1)
    detail = {
        "k": swaps,
        "binomial_p": binomial_tail(swaps, len(a), chance),
        "resample_mean": float(resampled.mean()),
        "directions": directions,
    }
    tested = f"one-sided permutation of the pairing, B={resamples}"
    how = {"method": f"{result.method}; {tested}", "tested": tested}
    return SwapRate(result.value, result.n, result.ci, p, **how, detail=detail, level=level, chance=chance)


def binomial_tail(k: int, n: int, chance: float) -> float:
    """Return the exact one-sided p, P(X >= k), for X binomial (``n``, ``chance``).

    ValueError unless 0 <= k <= n and 0 <= chance <= 1.
    """
    if not 0 <= k <= n or not 0 <= chance <= 1:
        raise ValueError(f"a binomial tail needs 0 <= k <= n and a chance in [0, 1], got {k}, {n}, {chance}")
    if k == 0 or chance == 1:
        return 1.0
    if chance == 0:
        return 0.0
    special = special_functions()

    return float(special.bdtrc(k - 1, n, chance))


class _GrowingTail:
    """P(X >= ``successes``) of a binomial X, exact, while trials and successes are added one by one.

    Each step carries it on. To sum it anew for every number of trials takes a hundred times as long.
    """

    def __init__(self, rate: float) -> None:
        self._rate, self._trials, self._successes = rate, 0, 0
        self.at_least, self._one_less = 1.0, 0.0  # P(X >= successes), P(X = successes - 1)

    def add_trial(self) -> None:
        """Add a trial."""
        self._trials += 1
        self.at_least += self._rate * self._one_less
        self._one_less *= (1 - self._rate) * self._trials / (self._trials - self._successes + 1)

    def add_success(self) -> None:
        """Ask for one success more."""
        n, k, rate = self._trials, self._successes, self._rate
        first = k == 0 or rate == 1
        exactly = (1 - rate) ** (n - k) if first else self._one_less * (n - k + 1) / k * rate / (1 - rate)
        self._successes, self._one_less = k + 1, exactly
        self.at_least = self.at_least - exactly if k < n else 0.0


@lru_cache(maxsize=1024)
def trials_needed(true_rate: float, chance: float, *, alpha: float = 0.05, power: float = 0.80) -> int:
    """Return the fewest trials at which an exact one-sided binomial test has the wanted power.

    ``true_rate`` is for example a swap rate, and ``chance`` the rate under the null, below it. The
    power of an exact test is a saw-tooth: a few larger numbers of trials may fall short again.
    ValueError unless 0 <= chance < true_rate <= 1, or when 100 000 trials do not suffice.
    """
    if not 0 <= chance < true_rate <= 1 or not 0 < alpha < 1 or not 0 < power < 1:
        raise ValueError(f"no such design: {true_rate=} above {chance=}, {alpha=}, {power=}")
    tests, finds = (_GrowingTail(rate) for rate in (chance, true_rate))
    for n in range(1, 100_001):
        tests.add_trial()
        finds.add_trial()
        while tests.at_least > alpha:  # the fewest successes that reject never fall as trials are added
            tests.add_success()
            finds.add_success()
        if finds.at_least >= power:
            return n
    raise ValueError(f"100 000 trials do not separate {true_rate=} from {chance=}")


def detectable_share(n: int, chance: float = 0.5, *, alpha: float = 0.01, power: float = 0.80) -> float | None:
    """Return the smallest true rate that an exact one-sided test of ``n`` trials finds.

    It is found with ``power``, and the test rejects at p < ``alpha``, as the rules do. None if not
    even ``n`` successes reject. ValueError for a negative ``n`` or a share outside its range.
    """
    if n < 0 or not 0 <= chance < 1 or not 0 < alpha < 1 or not 0 < power < 1:
        raise ValueError(f"no such design: {n=}, {chance=}, {alpha=}, {power=}")
    critical = next((k for k in range(n + 1) if binomial_tail(k, n, chance) < alpha), None)
    if critical is None:
        return None
    low, high = chance, 1.0
    while high - low > 1e-9:
        middle = (low + high) / 2
        low, high = (low, middle) if binomial_tail(critical, n, middle) >= power else (middle, high)
    return high


def binary_metrics(*, tp: int, fn: int, tn: int, fp: int) -> dict[str, Statistic]:
    """Return accuracy, balanced accuracy, sensitivity and specificity of a confusion matrix.

    Keys ``acc``, ``bal``, ``sens``, ``spec``. Rates carry Wilson intervals; ``bal``, a mean of two
    rates, carries none. A rate over no frames is None, and ``bal`` with it. ValueError for a
    negative count. Source: Table t:positive-guardian.
    """
    for name, count in (("tp", tp), ("fn", fn), ("tn", tn), ("fp", fp)):
        if count < 0:
            raise ValueError(f"{name}={count} is no count: give the number of frames")
    n = tp + fn + tn + fp
    sens, spec = rate(tp, tp + fn), rate(tn, tn + fp)
    if sens.value is None or spec.value is None:
        bal = not_available("one of the two classes is empty", n, "balanced accuracy")
    else:
        bal = Statistic((sens.value + spec.value) / 2, n, method="mean of sensitivity and specificity")
    return {"acc": rate(tp + tn, n), "bal": bal, "sens": sens, "spec": spec}


def selective_metrics(*, tp: int, fn: int, tn: int, fp: int, n: int) -> dict[str, Statistic]:
    """Return `binary_metrics` over the answered frames, and ``coverage``, their share of ``n``.

    The four counts exclude abstentions; ``n`` counts all frames. Source: Table t:positive-guardian.
    """
    return {"coverage": rate(tp + fn + tn + fp, n), **binary_metrics(tp=tp, fn=fn, tn=tn, fp=fp)}


def _label_pair(first: npt.ArrayLike, second: npt.ArrayLike) -> tuple[npt.NDArray[np.generic], npt.NDArray[np.generic]]:
    a, b = labels_of(first, "first"), labels_of(second, "second")
    if len(a) != len(b):
        raise ValueError(f"{len(a)} labels against {len(b)}: give both for the same frames")
    if a.size and (a.dtype.kind == "U") != (b.dtype.kind == "U"):
        raise ValueError(f"labels of type {a.dtype} against {b.dtype}: encode both alike")
    return a, b


def _partners(labels: npt.NDArray[np.generic], partner: Mapping[str, str]) -> npt.NDArray[np.str_]:
    return np.array([partner[str(label)] for label in labels], dtype=np.str_)


def _repaired(
    wanted: npt.NDArray[np.str_], given: npt.NDArray[np.generic], *, seed: int, resamples: int
) -> npt.NDArray[np.int64]:
    """Return how many labels match in each random re-pairing of two sequences, shape (resamples,).

    Only the table of the pairs matters, and re-pairing draws it with both margins held fixed.
    """
    names, codes = np.unique(np.concatenate([wanted, given]), return_inverse=True)
    rows, columns = (np.bincount(half, minlength=len(names)) for half in (codes[: len(wanted)], codes[len(wanted) :]))
    r, c = np.flatnonzero(rows), np.flatnonzero(columns)
    if min(len(r), len(c)) < 2:  # one row or column leaves nothing to draw
        return np.full(resamples, np.minimum(rows, columns).sum())
    tables = random_tables(rows[r], columns[c], resamples, np.random.default_rng(seed))
    return np.asarray(tables[:, r[:, None] == c[None, :]].sum(axis=1), dtype=np.int64)


def _kappa_error(joint: npt.NDArray[np.float64], kappa: float, chance: float) -> float:
    """Return sqrt(n) times the standard error of kappa (Fleiss, Cohen and Everitt 1969, eq. 13)."""
    rows, columns = joint.sum(axis=1), joint.sum(axis=0)
    same = np.diag(joint) @ (1 - (rows + columns) * (1 - kappa)) ** 2
    weights = (columns[:, None] + rows[None, :]) ** 2
    np.fill_diagonal(weights, 0.0)
    other = (1 - kappa) ** 2 * float((joint * weights).sum())
    variance = float(same) + other - (kappa - chance * (1 - kappa)) ** 2
    return math.sqrt(max(variance, 0.0)) / (1 - chance)


def _normal_quantile(level: float) -> float:
    if not 0 < level < 1:
        raise ValueError(f"level={level} must lie between 0 and 1, for example 0.95")
    return NormalDist().inv_cdf(0.5 + level / 2)


def _wilson(k: float, n: float, level: float) -> tuple[float, float]:
    z = _normal_quantile(level)
    centre = (k + z * z / 2) / (n + z * z)
    half = z / (n + z * z) * math.sqrt(k * (n - k) / n + z * z / 4)
    return (0.0 if k == 0 else centre - half, 1.0 if k == n else centre + half)


def clopper_pearson(k: float, n: int, level: float = 0.95) -> tuple[float, float]:
    """Return the exact two-sided interval of k/n (Clopper and Pearson 1934), as R ``binom.test``.

    A ``k`` between two counts has the interval between theirs.
    """
    if not 0 < level < 1:
        raise ValueError(f"level={level} must lie between 0 and 1, for example 0.95")
    special = special_functions()

    tail = (1 - level) / 2
    low = 0.0 if k <= 0 else float(special.betaincinv(k, n - k + 1, tail))
    high = 1.0 if k >= n else float(special.betaincinv(k + 1, n - k, 1 - tail))
    return low, high
