from itertools import permutations

import numpy as np
import pytest
from scipy import stats

from eyechart.stats import correlation


def test_pearson_is_scipys() -> None:
    """Reference: scipy.stats.pearsonr(x, y), value, p and confidence_interval()."""
    x, y = np.random.default_rng(2).normal(size=(2, 25))
    expected = stats.pearsonr(x, y)
    interval = expected.confidence_interval()
    for result in (correlation.pearson(x, y), correlation.pearson_p(float(expected.statistic), 25)):
        assert result.value == pytest.approx(expected.statistic)
        assert result.p == pytest.approx(expected.pvalue, rel=1e-9)
        assert result.ci == pytest.approx((interval.low, interval.high))


def test_a_perfect_correlation_has_no_interval_and_two_pairs_no_test() -> None:
    """The degenerate ends of the t test."""
    assert (correlation.pearson_p(1.0, 8).p, correlation.pearson_p(1.0, 8).ci) == (0.0, None)
    assert correlation.pearson_p(0.3, 2).p is None
    assert correlation.spearman([1, 2, 3, 4], [2, 4, 6, 8]).ci is None


def test_spearman_is_scipys_where_it_is_approximate() -> None:
    """Reference: scipy.stats.spearmanr(x, y), with ties."""
    x, y = np.random.default_rng(3).integers(0, 12, size=(2, 40))
    expected, result = stats.spearmanr(x, y), correlation.spearman(x, y)
    assert (result.value, result.p, result.n) == (pytest.approx(expected.statistic), pytest.approx(expected.pvalue), 40)


def test_spearman_of_few_pairs_is_exact() -> None:
    """Reference: R 4.4 cor.test(c(1,2,3,4,5,6), c(2,1,4,3,6,5), method = "spearman"): rho 0.8285714, p 0.05833."""
    result = correlation.spearman([1, 2, 3, 4, 5, 6], [2, 1, 4, 3, 6, 5])
    assert result.value == pytest.approx(0.8285714, abs=1e-7)
    assert result.p == pytest.approx(0.05833333, abs=1e-7)


def test_the_exact_p_counts_every_order_of_tied_ranks() -> None:
    """Against a plain loop over all orders, with ties in both columns."""
    x, y = [1, 1, 2, 3, 5], [2, 4, 4, 3, 9]
    one, other = stats.rankdata(x), stats.rankdata(y)
    observed = abs(np.corrcoef(one, other)[0, 1])
    reached = [abs(np.corrcoef(order, other)[0, 1]) >= observed - 1e-12 for order in permutations(one)]
    assert correlation.spearman(x, y).p == pytest.approx(np.mean(reached))


@pytest.mark.parametrize("measure", [correlation.pearson, correlation.spearman])
def test_what_carries_no_correlation_says_so(measure: type) -> None:
    """Too few pairs and a constant column give None with the reason, never 0."""
    few, constant = measure([1, 2, 3], [1, 2, 4]), measure([1, 2, 3, 4], [5, 5, 5, 5])
    assert (few.value, few.p, few.n) == (None, None, 3)
    assert "3 pairs are too few" in few.note
    assert (constant.value, constant.note) == (None, "one of the two columns is constant")
    with pytest.raises(ValueError, match="two columns of finite numbers"):
        measure([1, 2, 3, float("nan")], [1, 2, 3, 4])
