"""The test of flipped signs: exact where it is small, honest where it samples, and silent without pairs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from eyechart.stats.sign_flip import follow, sign_flip_test


def test_a_few_pairs_are_enumerated() -> None:
    """Five differences of one sign: two of the 32 patterns are as extreme, whatever their sizes."""
    statistic = sign_flip_test([3, 5, 8, 2, 9], [1, 1, 1, 1, 1], seed=0)
    assert statistic.value == pytest.approx(4.4)
    assert (statistic.p, statistic.n) == (2 / 32, 5)
    assert statistic.detail is not None
    assert (statistic.detail["larger"], statistic.detail["smaller"], statistic.detail["smallest_p"]) == (5, 0, 2 / 32)


def test_exact_p_is_scipys() -> None:
    """scipy.stats.permutation_test with permutation_type 'samples' enumerates the same exchanges."""
    rng = np.random.default_rng(3)
    a, b = rng.normal(0.6, 1, 9), rng.normal(0, 1, 9)
    theirs = stats.permutation_test(
        (a, b), lambda x, y: abs(np.mean(x - y)), permutation_type="samples", alternative="greater", n_resamples=np.inf
    )
    assert sign_flip_test(a, b, seed=0).p == pytest.approx(theirs.pvalue)


def test_many_pairs_are_sampled_near_the_t_test() -> None:
    """With 60 normal pairs both tests agree closely; the smallest p is 1/(B+1)."""
    rng = np.random.default_rng(5)
    a, b = rng.normal(0.3, 1, 60), rng.normal(0, 1, 60)
    statistic = sign_flip_test(a, b, seed=1, resamples=20_000)
    assert statistic.p == pytest.approx(stats.ttest_rel(a, b).pvalue, abs=0.01)
    assert sign_flip_test(a + 50, b, seed=1, resamples=999).p == 1 / 1000
    assert sign_flip_test(a, b, seed=1).p == sign_flip_test(a, b, seed=1).p


def test_equal_pairs_do_not_differ_and_no_pairs_cannot_say() -> None:
    """Differences of 0 carry no sign; nothing to compare is no 0."""
    assert sign_flip_test([1, 2, 3], [1, 2, 3], seed=0).p == 1.0
    assert sign_flip_test([4, 2, 3], [1, 2, 3], seed=0).p == 1.0
    assert sign_flip_test([], [], seed=0).value is None
    with pytest.raises(ValueError, match="3 values against 2"):
        sign_flip_test([1, 2, 3], [1, 2], seed=0)
    with pytest.raises(ValueError, match="finite"):
        sign_flip_test([np.nan], [1], seed=0)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=9))
def test_exchanging_the_two_turns_the_difference_and_keeps_the_p(pairs: list[tuple[float, float]]) -> None:
    """The test is two-sided."""
    a, b = zip(*pairs, strict=True)
    one, other = sign_flip_test(a, b, seed=0), sign_flip_test(b, a, seed=0)
    assert one.value == pytest.approx(-(other.value or 0.0))
    assert one.p == pytest.approx(other.p)


def test_it_keeps_its_level() -> None:
    """Of 400 comparisons of two equal drivers with skewed scores in 16 worlds about 1 in 20 is significant at .05."""
    rng = np.random.default_rng(11)
    ps = [
        sign_flip_test(rng.exponential(1, 16), rng.exponential(1, 16), seed=turn, resamples=400).p
        for turn in range(400)
    ]
    assert 0.02 <= np.mean([p is not None and p <= 0.05 for p in ps]) <= 0.09


def test_following_is_a_share_with_a_one_sided_p_by_episode() -> None:
    """By hand: eight episodes that all follow halfway have a share of .5 and a p of 1 in 256."""
    episodes = np.repeat(np.arange(8), 3)
    found = follow(np.full(24, 2.0), np.full(24, 4.0), episodes, seed=0)
    assert (found.value, found.p, found.n) == (0.5, 1 / 256, 24)
    assert found.ci == pytest.approx((0.5, 0.5))
    assert follow(np.full(24, -2.0), np.full(24, 4.0), episodes, seed=0).p == 1.0


def test_following_below_seven_episodes_cannot_reach_one_in_a_hundred() -> None:
    """Six have 64 patterns, seven have 128."""
    for many, least in ((6, 1 / 64), (7, 1 / 128)):
        assert follow(np.ones(many), np.ones(many), np.arange(many), seed=0).p == least


def test_the_interval_of_following_is_a_jackknife_over_episodes() -> None:
    """Written out in a loop, with scipy's t; an exchange of all signs is scipy's permutation test."""
    rng = np.random.default_rng(2)
    episodes, full = np.repeat(np.arange(10), 4), rng.uniform(2, 4, 40)
    gains = 0.6 * full + rng.normal(size=40)
    found = follow(gains, full, episodes, seed=0)
    left = [gains[episodes != index].sum() / full[episodes != index].sum() for index in range(10)]
    error = np.sqrt(9 / 10 * np.sum((left - np.mean(left)) ** 2))
    wide = stats.t.ppf(0.99, 9) * error
    assert found.ci == pytest.approx((found.value - wide, found.value + wide))
    means = np.array([gains[episodes == index].mean() for index in range(10)])
    theirs = stats.permutation_test(
        (means, np.zeros(10)),
        lambda x, y: np.mean(x - y),
        permutation_type="samples",
        alternative="greater",
        n_resamples=np.inf,
    )
    assert found.p == pytest.approx(theirs.pvalue)


def test_nothing_that_was_moved_cannot_be_followed() -> None:
    """No frames, or a move that nobody would follow."""
    assert follow([], [], [], seed=0).value is None
    assert follow([1, 2], [0, 0], [0, 1], seed=0).value is None
    with pytest.raises(ValueError, match="2 gains, 1 full"):
        follow([1, 2], [1], [0, 1], seed=0)


def test_so_many_episodes_are_enumerated_and_one_more_is_drawn() -> None:
    """Up to 14 episodes p is exact, 2 to the power of minus their number; of more, 9999 patterns are drawn."""
    exact = follow(np.ones(14), np.full(14, 2.0), np.arange(14), seed=0)
    assert (exact.episodes, exact.smallest_p) == (14, 2**-14)
    assert exact.p == 2**-14
    drawn = follow(np.ones(15), np.full(15, 2.0), np.arange(15), seed=0)
    assert (drawn.episodes, drawn.smallest_p) == (15, 1 / 10_000)
    assert drawn.p is not None
    assert 1 / 10_000 <= drawn.p <= 8 / 10_000
    pairs = sign_flip_test(np.ones(14), np.zeros(14), seed=0)
    assert (pairs.p, pairs.method.endswith("all 16384 patterns")) == (2**-13, True)
    assert sign_flip_test(np.ones(15), np.zeros(15), seed=0).method.endswith("B=5000")


def test_drawn_patterns_agree_with_all_of_them() -> None:
    """Of 16 episodes, all 65 536 patterns enumerated here by hand."""
    gains = np.random.default_rng(2).normal(0.4, 1, 16)
    signs = 1 - 2 * ((np.arange(2**16)[:, None] >> np.arange(16)) & 1)
    everything = float(np.mean(signs @ gains >= gains.sum() - 1e-9))
    found = follow(gains, np.ones(16), np.arange(16), seed=3)
    assert found.p == pytest.approx(everything, abs=0.02)
    assert 0.01 < everything < 0.5


def test_the_interval_leaves_each_episode_out() -> None:
    """Three episodes, by hand: shares without each, their jackknife error, and Student's quantile at .99."""
    gains, full = np.array([1.0, 2.0, 4.0]), np.array([2.0, 3.0, 5.0])
    left = np.array([6 / 8, 5 / 7, 3 / 5])
    error = np.sqrt(2 / 3 * ((left - left.mean()) ** 2).sum())
    half = stats.t.ppf(0.99, 2) * error
    found = follow(gains, full, ["a", "b", "c"], seed=0)
    assert found.value == pytest.approx(0.7)
    assert found.ci == pytest.approx((0.7 - half, 0.7 + half))


def test_patterns_that_are_drawn_in_parts_are_all_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where plus and minus are alike every pattern is as extreme, and where all are plus hardly any of 2 to the 40."""
    monkeypatch.setattr("eyechart.stats.statistic.CHUNK_BYTES", 8 * 16 * 7)
    alike = np.tile([1.0, -1.0], 8)
    assert sign_flip_test(alike, np.zeros(16), seed=0, resamples=19).p == 1.0
    assert follow(np.zeros(16), np.ones(16), np.arange(16), seed=0).p == 1.0
    assert follow(np.ones(40), np.ones(40), np.arange(40), seed=0).p == 1 / 10_000
    assert sign_flip_test(np.ones(40), np.zeros(40), seed=0, resamples=19).p == 1 / 20


def test_outcomes_that_are_yes_or_no_are_numbers() -> None:
    """Collided or not, in each of five worlds."""
    statistic = sign_flip_test([True, True, True, False, True], [False] * 5, seed=0)
    assert (statistic.value, statistic.p) == (0.8, 2 / 16)
