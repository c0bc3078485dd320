import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from eyechart.stats import agreement

PARTNER = {"LEFT": "RIGHT", "RIGHT": "LEFT"}
labels = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=60)


@given(n=st.integers(1, 300), share=st.floats(0, 1))
@settings(max_examples=60)
def test_a_rate_carries_the_wilson_interval_of_scipy(n: int, share: float) -> None:
    """Reference: scipy.stats.binomtest(k, n).proportion_ci(method="wilson")."""
    k = round(share * n)
    ours = agreement.rate(k, n)
    expected = stats.binomtest(k, n).proportion_ci(confidence_level=0.95, method="wilson")
    assert ours.value == k / n
    assert ours.ci == pytest.approx((expected.low, expected.high), abs=1e-9)


def test_no_swap_of_fifty_bounds_the_swap_rate_below_eight_percent() -> None:
    """R: binom::binom.wilson(0, 50) gives 0 to 0.07134759; Qwen's mirror row of Table t:frontier."""
    low, high = agreement.rate(0, 50).ci
    assert low == 0.0
    assert high == pytest.approx(0.07134759, abs=1e-7)


def test_a_rate_of_nothing_cannot_say() -> None:
    """No observations give None, never 0."""
    result = agreement.rate(0, 0)
    assert (result.value, result.ci, result.n, result.note) == (None, None, 0, "no observations")


@pytest.mark.parametrize(("k", "n"), [(-1, 3), (4, 3), (0, -1)])
def test_a_count_outside_its_total_is_refused(k: int, n: int) -> None:
    """The error names both numbers."""
    with pytest.raises(ValueError, match=f"got k={k} of n={n}"):
        agreement.rate(k, n)


def test_the_floor_is_cleared_strictly() -> None:
    """IDI equal to 1.5 s is not above it."""
    assert not agreement.clears_floor(0.75, 0.5)
    assert agreement.clears_floor(math.nextafter(0.75, 1), 0.5)


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (["A", "B"], "3 labels against 2"),
        (["A", None, "B"], "of type object"),
        ([1, 2, 3], "encode both alike"),
        ([0.5, 1.0, 1.0], "of type float64"),
        ([["A", "B", "C"]], r"have shape \(1, 3\)"),
    ],
)
def test_labels_that_cannot_be_compared_are_refused(second: list, message: str) -> None:
    """A None must not agree with a None by accident, nor 1 with "1"."""
    with pytest.raises(ValueError, match=message):
        agreement.cohens_kappa(["A", "B", "C"], second)


def pairs_of(table: list[list[int]]) -> tuple[np.ndarray, np.ndarray]:
    """Return two label arrays whose joint counts are the table."""
    counts = np.array(table)
    i, j = np.indices(counts.shape)
    return np.repeat(i.ravel(), counts.ravel()), np.repeat(j.ravel(), counts.ravel())


def test_kappa_and_its_standard_error_are_those_of_vcd() -> None:
    """R: vcd::Kappa(SexualFun) prints Unweighted 0.1293, ASE 0.06860."""
    first, second = pairs_of([[7, 7, 2, 3], [2, 8, 3, 7], [1, 5, 4, 9], [2, 8, 9, 14]])
    result = agreement.cohens_kappa(first, second)
    assert result.value == pytest.approx(0.1293, abs=5e-5)
    assert result.detail["standard_error"] == pytest.approx(0.06860, abs=5e-6)
    assert result.ci == pytest.approx((0.1293 - 1.95996 * 0.0686, 0.1293 + 1.95996 * 0.0686), abs=1e-4)


def test_kappa_of_one_shared_constant_cannot_say() -> None:
    """0/0 is None, with the reason."""
    result = agreement.cohens_kappa(["STOP"] * 5, ["STOP"] * 5)
    assert result.value is None
    assert "same constant" in result.note


@pytest.mark.parametrize(
    ("first", "second", "value"),
    [([0, 1] * 20, [0, 1] * 20, 1.0), ([0] * 40, [1] * 40, 0.0), ([0] * 40, [0, 1] * 20, 0.0)],
    ids=["perfect agreement", "two different constants", "one constant"],
)
def test_kappa_without_a_standard_error_still_has_a_wide_interval(first: list, second: list, value: float) -> None:
    """An interval of no width would claim certainty from forty frames."""
    result = agreement.cohens_kappa(first, second)
    low, high = result.ci
    assert result.value == pytest.approx(value)
    assert low <= value <= high
    assert high - low > 0.05


@given(pairs=labels)
def test_kappa_is_symmetric_and_unchanged_by_relabelling(pairs: list) -> None:
    """Neither the order of the raters nor the names of the labels matter."""
    first, second = np.array(pairs).T
    names = np.array([7, 3, 11, 5])
    here, swapped = agreement.cohens_kappa(first, second), agreement.cohens_kappa(second, first)
    renamed = agreement.cohens_kappa(names[first], names[second])
    if here.value is None:
        assert swapped.value is None
        assert renamed.value is None
    else:
        assert swapped.value == pytest.approx(here.value, abs=1e-12)
        assert renamed.value == pytest.approx(here.value, abs=1e-12)
        assert here.ci[0] - 1e-12 <= here.value <= here.ci[1] + 1e-12


def test_a_controller_that_swaps_is_told_from_its_marginals() -> None:
    """Twenty directions both ways, all exchanged: far above the chance of one half."""
    real = ["LEFT", "RIGHT"] * 10 + ["STOP"] * 30
    mirrored = ["RIGHT", "LEFT"] * 10 + ["RIGHT"] * 30
    result = agreement.swap_test(real, mirrored, PARTNER, seed=1)
    assert (result.value, result.n) == (1.0, 20)
    assert result.p == pytest.approx(1 / 5001)
    assert result.chance == pytest.approx(0.5)
    assert result.detail["binomial_p"] == pytest.approx(0.5**20)
    assert result.detail["directions"] == {"LEFT": 10, "RIGHT": 10}


def test_one_direction_only_swaps_by_its_marginals_alone() -> None:
    """LEFT on real and RIGHT on every mirrored frame is no evidence: p is 1 although the rate is 1."""
    result = agreement.swap_test(["LEFT"] * 12, ["RIGHT"] * 12, PARTNER, seed=1)
    assert (result.value, result.p, result.chance) == (1.0, 1.0, 1.0)


def test_an_unparsed_mirror_reply_counts_as_no_swap() -> None:
    """It stays in the denominator (facts, section 1)."""
    result = agreement.swap_test(["LEFT", "RIGHT"], ["RIGHT", "UNPARSED"], PARTNER, seed=1)
    assert (result.value, result.n) == (0.5, 2)


def test_the_swap_permutation_agrees_with_the_hypergeometric_law() -> None:
    """With one direction in four, swaps of LEFT follow scipy.stats.hypergeom(24, 6, 6)."""
    real = ["LEFT"] * 6 + ["RIGHT"] * 18
    mirrored = ["RIGHT"] * 4 + ["STOP"] * 2 + ["RIGHT"] * 2 + ["STOP"] * 16
    result = agreement.swap_test(real, mirrored, PARTNER, seed=3, resamples=20_000)
    assert result.p == pytest.approx(stats.hypergeom(24, 6, 6).sf(3), abs=0.004)


@given(pairs=st.lists(st.tuples(st.sampled_from("LR"), st.sampled_from("LRSU")), min_size=1, max_size=6))
@settings(max_examples=15)
def test_the_swap_permutation_is_that_of_all_re_pairings(pairs: list) -> None:
    """P and mean of the random tables against every order of the mirrored decisions, one by one."""
    real, mirrored = (np.array(column) for column in zip(*pairs, strict=True))
    wanted = np.where(real == "L", "R", "L")
    swaps = [np.count_nonzero(wanted == np.array(order)) for order in itertools.permutations(mirrored)]
    result = agreement.swap_test(real, mirrored, {"L": "R", "R": "L"}, seed=5, resamples=4000)
    share = np.mean(np.array(swaps) >= swaps[0])
    assert result.p == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / 4000) + 1 / 4000)
    assert result.detail["resample_mean"] == pytest.approx(
        np.mean(swaps), abs=4 * np.std(swaps) / math.sqrt(4000) + 1e-9
    )


def test_without_directions_the_swap_test_cannot_say() -> None:
    """No directional action, no power: None with the reason."""
    result = agreement.swap_test(["STOP"] * 4, ["LEFT"] * 4, PARTNER, seed=1)
    assert (result.value, result.p, result.note) == (None, None, "no directional decisions")


@given(n=st.integers(1, 80), k=st.integers(0, 80), chance=st.floats(0, 1))
@settings(max_examples=60)
def test_the_binomial_tail_is_scipys(n: int, k: int, chance: float) -> None:
    """Reference: scipy.stats.binomtest(k, n, chance, alternative="greater").pvalue."""
    k = min(k, n)
    expected = stats.binomtest(k, n, chance, alternative="greater").pvalue
    assert agreement.binomial_tail(k, n, chance) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(("chance", "n"), [(0.2, 7), (0.5, 69)])
def test_the_power_of_the_swap_rate_is_the_measured_one(chance: float, n: int) -> None:
    """A swap rate of .65 needs 7 directions against .2 and 69 against .5 (facts, section 3)."""
    assert agreement.trials_needed(0.65, chance) == n


def test_an_empty_class_leaves_its_rate_and_the_balanced_accuracy_unsaid() -> None:
    """Without negatives there is no specificity."""
    metrics = agreement.binary_metrics(tp=3, fn=1, tn=0, fp=0)
    assert (metrics["acc"].value, metrics["sens"].value) == (0.75, 0.75)
    assert metrics["spec"].value is None
    assert metrics["bal"].value is None


def test_a_coin_agrees_with_itself_as_with_others() -> None:
    """Of 144 frames answered four times by a five-sided coin kappa is bounded below .10 in nearly every draw."""
    bounded = 0
    for seed in range(50):
        tosses = np.random.default_rng(seed).integers(0, 5, size=(144, 4))
        statistic = agreement.pooled_kappa(tosses)
        assert statistic.value is not None
        assert statistic.p is not None
        assert statistic.ci is not None
        assert (statistic.p < 0.01) == (statistic.ci[1] < 0.10)
        bounded += statistic.p < 0.01
    assert bounded >= 48


def test_a_kappa_at_the_margin_is_hardly_ever_bounded() -> None:
    """Where each answer is kept with probability √.1 and else tossed, kappa is .10, and the bound holds its level."""
    false = 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        own = np.repeat(rng.integers(0, 5, size=(60, 1)), 3, axis=1)
        kept = rng.uniform(size=(60, 3)) < 0.10**0.5
        false += (agreement.pooled_kappa(np.where(kept, own, rng.integers(0, 5, size=(60, 3)))).p or 0.0) < 0.01
    assert false <= 9  # P(Bin(300, .01) > 9) is .001


def test_pooled_kappa_of_equal_columns_is_one() -> None:
    """Three equal columns of two answers agree always, whatever chance; one answer alone cannot say."""
    codes = np.repeat(np.array([[0], [1]] * 10), 3, axis=1)
    statistic = agreement.pooled_kappa(codes)
    assert statistic.value == pytest.approx(1.0)
    assert statistic.detail is not None
    assert statistic.detail["chance"] == pytest.approx(9 / 19)
    assert agreement.pooled_kappa(np.zeros((20, 3), dtype=int)).value is None
    assert statistic.n == 20
    assert statistic.p == pytest.approx(1.0, abs=1e-3)


def test_missing_answers_leave_their_pairs_out() -> None:
    """A column without answers changes nothing, and fewer than two frames cannot say."""
    codes = np.random.default_rng(0).integers(0, 3, size=(30, 2))
    wider = np.column_stack([codes, np.full(30, -1)])
    assert agreement.pooled_kappa(wider) == agreement.pooled_kappa(codes)
    assert agreement.pooled_kappa(np.array([[0, 1]])).value is None
    with pytest.raises(ValueError, match="integer codes of shape"):
        agreement.pooled_kappa(np.zeros((4, 2)))


def test_pooled_kappa_says_at_which_level_its_interval_is() -> None:
    """98 % at a one-sided alpha of .01; half or more is no level of one side."""
    codes = np.random.default_rng(0).integers(0, 3, size=(30, 2))
    assert agreement.pooled_kappa(codes).level == pytest.approx(0.98)
    assert agreement.pooled_kappa(codes, alpha=0.05).level == pytest.approx(0.90)
    for alpha in (0.0, 0.5):
        with pytest.raises(ValueError, match="an alpha below"):
            agreement.pooled_kappa(codes, alpha=alpha)


@pytest.mark.parametrize("n", [7, 15, 50, 144])
def test_the_smallest_share_is_found_with_its_power_and_no_smaller_one_is(n: int) -> None:
    """At the share the exact test has power .8; a little below it has less."""
    share = agreement.detectable_share(n)
    assert share is not None
    critical = next(k for k in range(n + 1) if agreement.binomial_tail(k, n, 0.5) < 0.01)
    assert agreement.binomial_tail(critical, n, share) == pytest.approx(0.8, abs=1e-6)
    assert agreement.binomial_tail(critical, n, share - 0.01) < 0.8


def test_six_trials_find_nothing_at_alpha_01() -> None:
    """Six wins of six have p = .0156: no share can be found, and seven can; each number of a design has its range."""
    assert agreement.detectable_share(6) is None
    assert agreement.detectable_share(0) is None
    assert agreement.detectable_share(7) == pytest.approx(0.8 ** (1 / 7))
    assert agreement.detectable_share(1, 0.0) == pytest.approx(0.8, abs=1e-6)
    for n, chance, alpha, power in ((-1, 0.5, 0.01, 0.8), (7, 1.0, 0.01, 0.8), (7, -0.1, 0.01, 0.8)):
        with pytest.raises(ValueError, match="no such design"):
            agreement.detectable_share(n, chance, alpha=alpha, power=power)
    for alpha, power in ((0.0, 0.8), (1.0, 0.8), (0.01, 0.0), (0.01, 1.0)):
        with pytest.raises(ValueError, match="no such design"):
            agreement.detectable_share(7, alpha=alpha, power=power)
