import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eyechart.stats import association, resampling, statistic

p_values = st.lists(st.one_of(st.none(), st.floats(0, 1)), max_size=12)
tables = hnp.arrays(np.int64, st.tuples(st.integers(1, 4), st.integers(1, 4)), elements=st.integers(0, 8))


def test_a_permutation_p_is_never_zero() -> None:
    """(k+1)/(B+1): the paper's .0002 is 1/5001."""
    assert resampling.permutation_p(0, 5000) == 1 / 5001
    assert resampling.permutation_p(5000, 5000) == 1.0
    with pytest.raises(ValueError, match="got 6 of 5"):
        resampling.permutation_p(6, 5)


def test_holm_is_p_adjust() -> None:
    """R: p.adjust(c(0.01, 0.04, 0.03, 0.005), "holm") gives 0.03 0.06 0.06 0.02."""
    assert resampling.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


def test_a_test_that_was_not_made_does_not_count() -> None:
    """A None stays None and leaves the family smaller; a constant's p of 1 does not."""
    assert resampling.holm([None, 0.02, None]) == [None, 0.02, None]
    assert resampling.holm([1.0, 0.02]) == [1.0, 0.04]
    assert resampling.holm([None, None]) == [None, None]
    with pytest.raises(ValueError, match="p value number 1 is nan"):
        resampling.holm([0.1, math.nan])


@given(p=p_values)
def test_holm_keeps_the_order_and_never_lowers_a_p(p: list) -> None:
    """Adjusted values rise with the raw ones, lie between them and 1, and the smallest is m times the raw."""
    made = [(raw, adjusted) for raw, adjusted in zip(p, resampling.holm(p), strict=True) if raw is not None]
    assert all(raw <= adjusted <= 1 for raw, adjusted in made)
    assert all(a[1] <= b[1] for a, b in itertools.pairwise(sorted(made)))
    if made:
        assert min(one for one in resampling.holm(p) if one is not None) == min(1.0, len(made) * min(made)[0])


@given(table=tables.filter(lambda t: t.sum() > 0), seed=st.integers(0, 9))
@settings(max_examples=40)
def test_a_permutation_test_gives_a_p_in_range_and_ignores_labels(table: np.ndarray, seed: int) -> None:
    """P lies in [1/(B+1), 1], the value is that of the table, and a seed repeats."""
    kept = table[table.sum(axis=1) > 0][:, table.sum(axis=0) > 0]
    information = resampling.permute_mutual_information(table, seed=seed, resamples=99)
    assert information.value == pytest.approx(association.information_of_tables(table[None])[0], abs=1e-9)
    assert 1 / 100 <= information.p <= 1
    assert information.p == 1.0 or min(kept.shape) > 1
    assert information == resampling.permute_mutual_information(table, seed=seed, resamples=99)


def test_minicpm_s_two_rare_actions_have_the_exact_permutation_p() -> None:
    """P(both rare actions in one of the small bins) = 2*36*35/(144*143) = .1224; the paper has .125."""
    result = resampling.permute_mutual_information([[72, 36, 34], [0, 0, 2]], seed=4, resamples=20_000)
    assert result.p == pytest.approx(2 * 36 * 35 / (144 * 143), abs=4 * math.sqrt(0.11 / 20_000))


def test_permuting_within_strata_does_not_see_what_the_strata_explain() -> None:
    """Label and bin follow the stratum perfectly: pooled p is tiny, stratified p is 1."""
    strata = np.array([[[20, 0], [0, 0]], [[0, 0], [0, 20]]])
    assert resampling.permute_mutual_information(strata.sum(axis=0), seed=1).p == 1 / 5001
    assert resampling.permute_mutual_information(strata, seed=1).p == 1.0


def test_a_permutation_test_of_nothing_cannot_say() -> None:
    """An empty table has no information and no p; a table of fractions is refused."""
    empty = resampling.permute_mutual_information([[0, 0]], seed=1)
    assert (empty.value, empty.p) == (None, None)
    with pytest.raises(ValueError, match="integer counts"):
        resampling.permute_mutual_information([[0.5, 1.0]], seed=1)


def brute_force(sums: np.ndarray) -> tuple[float, float]:
    """Return the percentile interval over all ordered draws of episodes, one by one."""
    draws = itertools.product(range(len(sums)), repeat=len(sums))
    totals = np.array([sums[list(draw)].sum(axis=0) for draw in draws])
    return tuple(np.quantile(totals[:, 0] / totals[:, 1], [0.025, 0.975], method="inverted_cdf"))


@given(seed=st.integers(0, 999), episodes=st.integers(2, 5))
@settings(max_examples=25)
def test_the_enumerated_bootstrap_is_that_of_all_ordered_draws(seed: int, episodes: int) -> None:
    """The k^k draws of itertools.product against the multisets with their weights."""
    rng = np.random.default_rng(seed)
    frames = rng.integers(5, 15, episodes)
    sums = np.stack([rng.integers(0, frames + 1), frames], axis=1)
    result = resampling.cluster_bootstrap(sums, seed=0)
    assert result.value == sums[:, 0].sum() / sums[:, 1].sum()
    assert result.ci == pytest.approx(brute_force(sums), abs=1e-12)
    assert result.method.endswith(f"all {math.comb(2 * episodes - 1, episodes)} multisets")


def test_twelve_episodes_are_enumerated_and_the_draws_agree() -> None:
    """All 1 352 078 multisets against 50 000 draws: the ends differ by less than .01; no seed matters."""
    rng = np.random.default_rng(8)
    sums = np.stack([rng.integers(0, 13, 12), np.full(12, 12)], axis=1)
    exact = resampling.cluster_bootstrap(sums, seed=0)
    drawn = resampling.cluster_bootstrap(sums, seed=0, resamples=50_000, enumerate_up_to=0)
    assert exact.method.endswith("all 1352078 multisets")
    assert drawn.method.endswith("B=50000")
    assert drawn.ci == pytest.approx(exact.ci, abs=0.01)
    assert exact.ci[0] < exact.value < exact.ci[1]
    assert exact == resampling.cluster_bootstrap(sums, seed=1)


def test_the_size_of_a_chunk_changes_no_draw(monkeypatch: pytest.MonkeyPatch) -> None:
    """One resample at a time, or all of them, are the draws of one generator, counted."""
    draws = np.random.default_rng(6).integers(7, size=(50, 7))
    expected = np.array([np.bincount(draw, minlength=7) for draw in draws])
    for size in (1, 3 * 8 * 7, 2**24):
        monkeypatch.setattr(statistic, "CHUNK_BYTES", size)
        assert np.array_equal(np.vstack(list(resampling._drawn(np.random.default_rng(6), 50, 7))), expected)


def test_the_multiset_weights_sum_to_one_and_their_mean_is_the_value() -> None:
    """A mean over episodes has its own value as bootstrap mean, and a variance of (k-1)/k times s^2/k."""
    sums = np.random.default_rng(1).normal(size=(9, 1))
    chunks = list(resampling._halves(sums))
    totals = np.concatenate([added[:, 0] for added, _ in chunks]) / 9
    weights = np.exp(np.concatenate([log_p for _, log_p in chunks]))
    assert len(totals) == math.comb(17, 9)
    assert weights.sum() == pytest.approx(1.0)
    assert weights @ totals == pytest.approx(sums.mean())
    assert weights @ (totals - sums.mean()) ** 2 == pytest.approx(sums.var() / 9)


def test_one_episode_has_a_value_and_no_interval() -> None:
    """Nothing can be said about other episodes from one."""
    result = resampling.cluster_bootstrap([[3, 12]], seed=0)
    assert (result.value, result.ci, result.n) == (0.25, None, 1)
    assert result.note == "one episode cannot be resampled"
    assert resampling.cluster_bootstrap(np.zeros((0, 2)), seed=0).value is None


def test_resamples_without_a_value_are_counted_and_left_out() -> None:
    """A swap rate where only one of three episodes has directions is undefined in (2/3)^3 of the draws."""
    result = resampling.cluster_bootstrap([[1, 2], [0, 0], [0, 0]], seed=0)
    assert result.ci == (0.5, 0.5)
    assert result.detail["undefined"] == pytest.approx((2 / 3) ** 3)
    assert resampling.cluster_bootstrap([[0, 0], [0, 0]], seed=0).value is None


def test_any_vectorised_statistic_of_sums_can_be_bootstrapped() -> None:
    """IDI - s from (blank disagreements, repeat disagreements, frames)."""
    sums = np.array([[9, 2, 12], [8, 1, 12], [10, 3, 12], [7, 2, 12]])
    result = resampling.cluster_bootstrap(sums, lambda s: (s[:, 0] - s[:, 1]) / s[:, 2], seed=0)
    assert result.value == pytest.approx(26 / 48)
    assert 5 / 12 <= result.ci[0] < result.value < result.ci[1] <= 7 / 12


def test_sums_that_are_not_finite_are_refused() -> None:
    """The error says what the rows are."""
    with pytest.raises(ValueError, match="one row per episode"):
        resampling.cluster_bootstrap([[math.nan, 1.0]], seed=0)


def test_agreement_in_random_order_is_that_of_all_orders() -> None:
    """Six decisions and six that are asked for: mean, p and bounds over all 720 orders, from 20 000 drawn ones."""
    mine, asked = [0, 0, 0, 1, 1, 2], [0, 0, 1, 1, 2, 2]
    every = np.array([sum(a == b for a, b in zip(order, asked, strict=True)) for order in itertools.permutations(mine)])
    table = np.zeros((3, 3), dtype=int)
    np.add.at(table, (mine, asked), 1)
    found = resampling.permute_agreement(table, seed=0, resamples=20_000)
    assert found.value == pytest.approx(every.mean() / 6)
    assert found.p == pytest.approx((every >= 4).mean(), abs=0.01)
    assert found.ci == tuple(np.quantile(every, [0.025, 0.975]) / 6)
    assert (found.n, found.detail) == (6, {"labels": 3, "observed": 4 / 6})
    assert "95% of 20000 orders" in found.method
    assert resampling.permute_agreement(np.zeros((2, 2)), seed=0).value is None
