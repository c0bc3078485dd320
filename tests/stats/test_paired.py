import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, stats

from eyechart.stats import paired_tests
from eyechart.stats.agreement import clopper_pearson

label_pairs = st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2)), min_size=1, max_size=9)


def test_the_sign_test_is_the_binomial_test_on_discordant_pairs() -> None:
    """R: binom.test(9, 11, alternative = "greater") gives p = 0.03271; ties do not count."""
    first, second = [2] * 9 + [0] * 2 + [1] * 5, [1] * 9 + [1] * 2 + [1] * 5
    result = paired_tests.sign_test(first, second)
    assert (result.value, result.n, result.ties) == (9 / 11, 11, 5)
    assert result.p == pytest.approx(0.03271, abs=5e-6)
    reference = stats.binomtest(9, 11, alternative="greater")
    assert result.p == pytest.approx(reference.pvalue, rel=1e-12)
    expected = stats.binomtest(9, 11).proportion_ci(method="exact")
    assert result.ci == pytest.approx((expected.low, expected.high))


def test_the_sign_test_is_one_sided() -> None:
    """The same pairs the other way round are no evidence."""
    assert paired_tests.sign_test([0] * 8, [1] * 8).p == 1.0
    assert paired_tests.sign_test([1] * 8, [0] * 8).p == 1 / 256


def test_without_discordant_pairs_nothing_is_rejected() -> None:
    """The value is None and p is 1: a test was made and found nothing."""
    for result in (paired_tests.sign_test([1, 2], [1, 2]), paired_tests.mcnemar_exact(0, 0)):
        assert (result.value, result.n, result.p) == (None, 0, 1.0)


@given(b=st.integers(0, 60), c=st.integers(0, 60))
@settings(max_examples=60)
def test_mcnemar_is_scipys_two_sided_binomial_test(b: int, c: int) -> None:
    """Reference: scipy.stats.binomtest(b, b + c).pvalue."""
    expected = stats.binomtest(b, b + c).pvalue if b + c else 1.0
    assert paired_tests.mcnemar_exact(b, c).p == pytest.approx(expected, rel=1e-9)


@given(n=st.integers(0, 300), share=st.floats(0, 1))
@settings(max_examples=60)
def test_the_tail_of_the_fair_coin_is_the_sum_of_its_ways(n: int, share: float) -> None:
    """Either tail, against math.comb term by term, to the last bit."""
    k = round(share * n)
    assert paired_tests._fair_coin_tail(k, n) == sum(math.comb(n, i) for i in range(k, n + 1)) / 2**n


@pytest.mark.parametrize("n", [1000, 1001, 4000, 20_000])
def test_the_tail_of_many_coins_is_that_counted_in_integers(n: int) -> None:
    """On both sides of the middle and far out, to more digits than are printed."""
    above, ways, term = {n + 1: 0}, 0, 1
    for k in range(n, -1, -1):  # k heads in term ways
        ways += term
        above[k] = ways
        term = term * k // (n - k + 1)
    for times in (-60, -9, -3, -0.1, 0, 0.1, 1, 3, 9, 20):
        k = max(0, round(n / 2 + times * math.sqrt(n) / 2))
        assert paired_tests._fair_coin_tail(k, n) == pytest.approx(above[k] / 2**n, rel=1e-10, abs=1e-300)


def test_fifty_thousand_discordant_pairs_are_counted_exactly_at_once() -> None:
    """Two hundred wins more than losses: the normal approximation with continuity correction is near."""
    wins, n = 25_100, 50_000
    approximation = stats.norm.sf((wins - 0.5 - n / 2) / math.sqrt(n / 4))
    assert paired_tests._fair_coin_tail(wins, n) == pytest.approx(approximation, rel=1e-4)


def spread(first: np.ndarray, second: np.ndarray) -> int:
    """Return the sum of squared differences of the marginal counts."""
    return int(((np.bincount(first, minlength=3) - np.bincount(second, minlength=3)) ** 2).sum())


@given(pairs=label_pairs)
@settings(max_examples=60)
def test_the_label_swap_test_enumerates_what_brute_force_does(pairs: list) -> None:
    """All 2^n ways to swap the labels within frames, one by one."""
    first, second = np.array(pairs).T
    observed, hits = spread(first, second), 0
    for swaps in itertools.product([False, True], repeat=len(pairs)):
        a, b = np.where(swaps, second, first), np.where(swaps, first, second)
        hits += spread(a, b) >= observed
    result = paired_tests.label_swap_test(first, second, seed=0)
    assert result.value == observed
    assert result.p == pytest.approx(hits / 2 ** len(pairs))


def test_the_sampled_label_swap_agrees_with_the_enumerated_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """One data set both ways, and the same seed gives the same p."""
    rng = np.random.default_rng(5)
    first, second = rng.integers(0, 3, 30), rng.integers(0, 2, 30)
    exact = paired_tests.label_swap_test(first, second, seed=0)
    monkeypatch.setattr(paired_tests, "ENUMERATED_STATES", 0)
    sampled = paired_tests.label_swap_test(first, second, seed=0, resamples=20_000)
    assert exact.method.endswith("enumerated")
    assert sampled.method.endswith("B=20000")
    assert sampled.p == pytest.approx(exact.p, abs=4 * math.sqrt(0.25 / 20_000))
    assert sampled == paired_tests.label_swap_test(first, second, seed=0, resamples=20_000)


def test_two_constants_differ_and_one_does_not() -> None:
    """SLOW on every real frame and STOP on every blank one is presence; SLOW on both is nothing."""
    differs = paired_tests.label_swap_test(["SLOW"] * 144, ["STOP"] * 144, seed=0)
    assert (differs.value, differs.p) == (2 * 144**2, pytest.approx(2 * 0.5**144))
    same = paired_tests.label_swap_test(["SLOW"] * 144, ["SLOW"] * 144, seed=0)
    assert (same.value, same.p, same.detail["discordant"]) == (0.0, 1.0, 0)


def constrained_score(b: int, c: int, n: int, delta: float) -> float:
    """Return Tango's score with the nuisance cell found by numerical maximum likelihood."""

    def loss(q: float) -> float:
        cells = np.array([q + delta, q, 1 - 2 * q - delta])
        return -float(np.sum(np.array([b, c, n - b - c]) * np.log(np.maximum(cells, 1e-300))))

    low, high = max(0.0, -delta), (1 - delta) / 2
    q = optimize.minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": 1e-12}).x
    return (b - c - n * delta) / math.sqrt(n * (2 * q + delta - delta**2))


@pytest.mark.parametrize(("b", "c", "n"), [(12, 2, 50), (9, 1, 50), (3, 5, 20), (30, 29, 144)])
def test_the_paired_interval_ends_where_the_score_is_the_quantile(b: int, c: int, n: int) -> None:
    """Both ends are checked against a numerical maximisation of the constrained likelihood (Tango 1998)."""
    result = paired_tests.paired_difference_from_counts(b, c, n)
    scores = [constrained_score(b, c, n, end) for end in result.ci]
    assert result.value == (b - c) / n
    assert scores == pytest.approx([1.959964, -1.959964], abs=1e-4)


def test_the_paired_interval_covers_what_it_claims() -> None:
    """Exact coverage at n = 30 over a grid of cell probabilities is near .95, and never below .93."""
    n, coverages = 30, []
    counts = [(b, c) for b in range(n + 1) for c in range(n + 1 - b)]
    intervals = np.array([paired_tests.paired_difference_from_counts(b, c, n).ci for b, c in counts])
    for p, q in [(0.05, 0.05), (0.02, 0.1), (0.3, 0.1), (0.2, 0.2), (0.5, 0.05)]:
        chance = stats.multinomial.pmf([(b, c, n - b - c) for b, c in counts], n, [p, q, 1 - p - q])
        inside = (intervals[:, 0] <= p - q) & (p - q <= intervals[:, 1])
        coverages.append(float(chance[inside].sum()))
    assert min(coverages) > 0.93
    assert np.mean(coverages) == pytest.approx(0.955, abs=0.02)


def test_zero_discordance_bounds_an_absence_from_forty_nine_frames_on() -> None:
    """The upper bound is z^2/(n + z^2), z = 2.326: below the margin .10 from n = 49."""
    enough, short = (paired_tests.bounded_below([0] * n, [0] * n) for n in (49, 48))
    assert enough.ci[1] == pytest.approx(2.3263479**2 / (49 + 2.3263479**2), abs=1e-7)
    assert enough.detail["bounded"]
    assert not short.detail["bounded"]
    assert paired_tests.pairs_to_bound() == 49


@given(b=st.integers(0, 12), c=st.integers(0, 12), rest=st.integers(1, 200))
@settings(max_examples=80)
def test_the_bound_and_its_p_never_contradict_each_other(b: int, c: int, rest: int) -> None:
    """The claim p < alpha holds exactly when the upper end of the interval lies below the margin."""
    first, second = [1] * b + [0] * (c + rest), [0] * b + [1] * c + [0] * rest
    result = paired_tests.bounded_below(first, second)
    assert result.detail["bounded"] == (result.ci[1] < 0.10)
    assert result.ci[0] - 1e-9 <= result.value <= result.ci[1] + 1e-9
    mirrored = paired_tests.paired_difference(second, first, level=0.98)
    assert mirrored.ci == pytest.approx((-result.ci[1], -result.ci[0]), abs=1e-9)


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [([0, 1], [1], "2 values against 1"), ([0, 2], [1, 1], "outcomes 0 or 1"), ([math.nan], [1], "drop the")],
)
def test_pairs_that_are_none_are_refused(first: list, second: list, message: str) -> None:
    """The error says what a pair must be."""
    with pytest.raises(ValueError, match=message):
        paired_tests.paired_difference(first, second)


def test_a_sampled_label_swap_is_never_impossible() -> None:
    """With random swaps the data count as one of them: a complete change of answers gives 1/(B+1), not 0."""
    first = np.array(["a", "b", "c", "d", "e"] * 40)
    second = np.array(["z"] * 200)
    statistic = paired_tests.label_swap_test(first, second, seed=0, resamples=200)
    assert "B=200" in statistic.method
    assert statistic.p == pytest.approx(1 / 201)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 60), st.integers(0, 60), st.integers(1, 80))
def test_a_net_effect_reaches_the_margin_exactly_where_its_p_says_so(wins: int, losses: int, more: int) -> None:
    """The lower end of the 80 % interval and the one-sided test at .10 are the same rule."""
    statistic = paired_tests.net_effect(wins, losses, wins + losses + more)
    assert statistic.value == pytest.approx((wins - losses) / (wins + losses + more))
    assert statistic.level == 0.8
    if abs(statistic.ci[0] - 0.1) > 1e-9:
        assert (statistic.ci[0] > 0.1) == (statistic.p < 0.1)


def test_the_bound_of_a_net_effect_is_tangos() -> None:
    """13 of 100 pairs won and none lost are too few for the margin, and 14 are enough."""
    assert [paired_tests.net_effect(wins, 0, 100).ci[0] >= 0.1 for wins in (13, 14)] == [False, True]
    assert paired_tests.net_effect(0, 0, 0).value is None
    with pytest.raises(ValueError, match="margin"):
        paired_tests.net_effect(1, 0, 2, margin=0)


def test_an_association_in_one_group_is_fishers_and_over_groups_their_sum() -> None:
    """One group gives Fisher's p; several are enumerated over every table with their margins."""
    rng = np.random.default_rng(3)
    first, second, groups = rng.integers(0, 2, 30), rng.integers(0, 2, 30), rng.integers(0, 3, 30)
    table = [[int(((first == a) & (second == b)).sum()) for b in (1, 0)] for a in (1, 0)]
    alone = paired_tests.stratified_association(first, second, ["all"] * 30)
    assert alone.p == pytest.approx(stats.fisher_exact(table, alternative="greater").pvalue)
    chances = {0: 1.0}
    for group in range(3):
        x, y = first[groups == group], second[groups == group]
        hyper = stats.hypergeom(len(x), int(x.sum()), int(y.sum()))
        sums: dict[int, float] = {}
        for total, chance in chances.items():
            for k in range(int(y.sum()) + 1):
                sums[total + k] = sums.get(total + k, 0.0) + chance * hyper.pmf(k)
        chances = sums
    statistic = paired_tests.stratified_association(first, second, groups.tolist())
    assert statistic.p == pytest.approx(sum(one for total, one in chances.items() if total >= (first * second).sum()))


def test_a_group_in_which_one_side_never_varies_says_nothing() -> None:
    """Who looks at its own lane alone turns one way in each lane: nothing is associated within it."""
    left, clear = [1, 1, 1, 0, 0, 0], [1, 1, 0, 0, 0, 1]
    statistic = paired_tests.stratified_association(left, clear, ["l"] * 3 + ["r"] * 3)
    assert (statistic.value, statistic.n, statistic.p) == (None, 0, 1.0)
    assert paired_tests.stratified_association(left, left, ["both"] * 6).p == pytest.approx(1 / 20)


@pytest.mark.parametrize(("k", "n", "level"), [(0, 12, 0.95), (3, 12, 0.95), (12, 12, 0.98), (37, 144, 0.98)])
def test_clopper_and_pearsons_ends_are_where_a_tail_is_half_of_the_rest(k: int, n: int, level: float) -> None:
    """At the lower end k or more, at the upper end k or fewer, have the chance (1 - level)/2: in exact fractions."""

    def chance(counts: range, rate: Fraction) -> float:
        return float(sum(math.comb(n, i) * rate**i * (1 - rate) ** (n - i) for i in counts))

    low, high = (Fraction(end) for end in clopper_pearson(k, n, level))
    half = (1 - level) / 2
    assert (low == 0) if k == 0 else chance(range(k, n + 1), low) == pytest.approx(half, rel=1e-9)
    assert (high == 1) if k == n else chance(range(k + 1), high) == pytest.approx(half, rel=1e-9)


def test_the_claim_of_an_absence_errs_about_once_in_a_hundred_where_the_effect_is_at_the_margin() -> None:
    """The exact size of Tango's bound at 60 pairs and an effect of .10, over every table of discordant pairs."""
    n, sizes = 60, []
    for fewer in (0.0, 0.02, 0.05, 0.1, 0.2):
        size = 0.0
        for b in range(n + 1):
            for c in range(n + 1 - b):
                score = paired_tests._tango_score(b, c, n, 0.10)
                if stats.norm.cdf(score) < 0.01:
                    size += float(stats.multinomial.pmf([b, c, n - b - c], n, [fewer + 0.1, fewer, 0.9 - 2 * fewer]))
        sizes.append(size)
    assert max(sizes) < 0.0125
    assert max(sizes) > 0.004


@pytest.mark.parametrize(
    ("b", "c", "n", "delta"), [(12, 2, 50, 0.1), (3, 5, 20, -0.2), (0, 0, 49, 0.1), (7, 7, 30, 0.05)]
)
def test_tangos_score_solves_its_quadratic(b: int, c: int, n: int, delta: float) -> None:
    """2n q² + ((2n - b + c) d - b - c) q - c d (1 - d) = 0 for the second cell under the null (Tango 1998)."""
    cells = np.roots([2 * n, (2 * n - b + c) * delta - (b + c), -c * delta * (1 - delta)])
    q = max(cells.real)
    expected = (b - c - n * delta) / math.sqrt(n * (2 * q + delta * (1 - delta)))
    assert paired_tests._tango_score(b, c, n, delta) == pytest.approx(expected)
