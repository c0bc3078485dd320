import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eyechart.stats import association, resamples

p_values = st.lists(st.one_of(st.none(), st.floats(0, 1)), max_size=12)
tables = hnp.arrays(np.int64, st.tuples(st.integers(1, 4), st.integers(1, 4)), elements=st.integers(0, 8))


def test_a_permutation_p_is_never_zero() -> None:
    """(k+1)/(B+1): the paper's .0002 is 1/5001."""
    assert resamples.permutation_p(0, 5000) == 1 / 5001
    assert resamples.permutation_p(5000, 5000) == 1.0
    with pytest.raises(ValueError, match="got 6 of 5"):
        resamples.permutation_p(6, 5)


def test_holm_is_p_adjust() -> None:
    """R: p.adjust(c(0.01, 0.04, 0.03, 0.005), "holm") gives 0.03 0.06 0.06 0.02."""
    assert resamples.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


def test_a_test_that_was_not_made_does_not_count() -> None:
    """A None stays None and leaves the family smaller; a constant's p of 1 does not."""
    assert resamples.holm([None, 0.02, None]) == [None, 0.02, None]
    assert resamples.holm([1.0, 0.02]) == [1.0, 0.04]
    assert resamples.holm([None, None]) == [None, None]
    with pytest.raises(ValueError, match="p value number 1 is nan"):
        resamples.holm([0.1, math.nan])


@given(p=p_values)
def test_holm_keeps_the_order_and_never_lowers_a_p(p: list) -> None:
    """Adjusted values rise with the raw ones, lie between them and 1, and the smallest is m times the raw."""
    made = [(raw, adjusted) for raw, adjusted in zip(p, resamples.holm(p), strict=True) if raw is not None]
    assert all(raw <= adjusted <= 1 for raw, adjusted in made)
    assert all(a[1] <= b[1] for a, b in itertools.pairwise(sorted(made)))
    if made:
        assert min(one for one in resamples.holm(p) if one is not None) == min(1.0, len(made) * min(made)[0])


@given(table=tables.filter(lambda t: t.sum() > 0), seed=st.integers(0, 9))
@settings(max_examples=40)
def test_a_permutation_test_gives_a_p_in_range_and_ignores_labels(table: np.ndarray, seed: int) -> None:
    """P lies in [1/(B+1), 1], the value is that of the table, and a seed repeats."""
    kept = table[table.sum(axis=1) > 0][:, table.sum(axis=0) > 0]
    information = resamples.permute_mutual_information(table, seed=seed, resamples=99)
    assert information.value == pytest.approx(association.information_of_tables(table[None])[0], abs=1e-9)
    assert 1 / 100 <= information.p <= 1
    assert information.p == 1.0 or min(kept.shape) > 1
    assert information == resamples.permute_mutual_information(table, seed=seed, resamples=99)


def test_minicpm_s_two_rare_actions_have_the_exact_permutation_p() -> None:
    """P(both rare actions in one of the small bins) = 2*36*35/(144*143) = .1224; the paper has .125."""
    result = resamples.permute_mutual_information([[72, 36, 34], [0, 0, 2]], seed=4, resamples=20_000)
    assert result.p == pytest.approx(2 * 36 * 35 / (144 * 143), abs=4 * math.sqrt(0.11 / 20_000))


def test_permuting_within_strata_does_not_see_what_the_strata_explain() -> None:
    """Label and bin follow the stratum perfectly: pooled p is tiny, stratified p is 1."""
    strata = np.array([[[20, 0], [0, 0]], [[0, 0], [0, 20]]])
    assert resamples.permute_mutual_information(strata.sum(axis=0), seed=1).p == 1 / 5001
    assert resamples.permute_mutual_information(strata, seed=1).p == 1.0


def test_a_permutation_test_of_nothing_cannot_say() -> None:
    """An empty table has no information and no p; a table of fractions is refused."""
    empty = resamples.permute_mutual_information([[0, 0]], seed=1)
    assert (empty.value, empty.p) == (None, None)
    with pytest.raises(ValueError, match="integer counts"):
        resamples.permute_mutual_information([[0.5, 1.0]], seed=1)


def test_agreement_in_random_order_is_that_of_all_orders() -> None:
    """Six decisions and six that are asked for: mean, p and bounds over all 720 orders, from 20 000 drawn ones."""
    mine, asked = [0, 0, 0, 1, 1, 2], [0, 0, 1, 1, 2, 2]
    every = np.array([sum(a == b for a, b in zip(order, asked, strict=True)) for order in itertools.permutations(mine)])
    table = np.zeros((3, 3), dtype=int)
    np.add.at(table, (mine, asked), 1)
    statistic = resamples.permute_agreement(table, seed=0, resamples=20_000)
    assert statistic.value == pytest.approx(every.mean() / 6)
    assert statistic.p == pytest.approx((every >= 4).mean(), abs=0.01)
    assert statistic.ci == tuple(np.quantile(every, [0.025, 0.975]) / 6)
    assert (statistic.n, statistic.detail) == (6, {"labels": 3, "observed": 4 / 6})
    assert "95% of 20000 orders" in statistic.method
    assert resamples.permute_agreement(np.zeros((2, 2)), seed=0).value is None
