"""Pairs lost beyond noise, against binomial terms in whole numbers; rises along a scale, against ones by hand."""

import math
from fractions import Fraction

import numpy as np
import pytest

from eyechart.stats.agreement import clopper_pearson
from eyechart.stats.order import (
    Density,
    Floats,
    Order,
    Rise,
    compared_twice,
    density,
    greatest_rise,
    order_of,
    order_violation_p,
    wrong_way,
)
from eyechart.stats.statistic import Statistic


def _tail(lost: int, pairs: int, wavered: int, repeats: int) -> float:
    """Return the chance of at least ``lost`` of a binomial, by its definition."""
    share, n = Fraction(pairs, pairs + 2 * repeats), lost + wavered
    return float(sum(math.comb(n, k) * share**k * (1 - share) ** (n - k) for k in range(lost, n + 1)))


@pytest.mark.parametrize(
    "given", [(0, 144, 0, 144), (0, 7, 9, 30), (1, 144, 0, 144), (9, 144, 4, 144), (30, 140, 61, 139), (60, 72, 0, 36)]
)
def test_pairs_lost_are_as_rare_as_the_binomial_of_their_sum_says(given: tuple[int, int, int, int]) -> None:
    """One lost pair of 144 where no repeat of 144 wavers has p 1/3: noise loses half as many as repeats disagree."""
    assert order_violation_p(*given) == pytest.approx(_tail(*given), rel=1e-12)


def test_one_lost_pair_without_any_noise_has_p_one_third() -> None:
    """By hand: 144 / (144 + 2 x 144)."""
    assert order_violation_p(1, 144, 0, 144) == pytest.approx(1 / 3, abs=1e-15)


@pytest.mark.parametrize("given", [(0, 0, 1, 10), (1, 10, 0, 0)])
def test_without_pairs_or_repeats_there_is_nothing_to_compare(given: tuple[int, int, int, int]) -> None:
    """It is an error, not a p."""
    with pytest.raises(ValueError, match="no pairs, or no repeats"):
        order_violation_p(*given)


def _twice(nearer: list[list[float]], farther: list[list[float]]) -> list[list[float]]:
    return np.asarray(compared_twice(nearer, farther)).tolist()


def test_two_answers_to_either_picture_lose_win_or_contradict() -> None:
    """By hand: won, lost, alike, contradicted both ways, and won one way to pair the answers and alike the other."""
    nearer = [[1.0, 0.0, 0.5, 1.0, 1.0], [1.0, 0.0, 0.5, 0.0, 0.5]]
    farther = [[0.0, 0.5, 0.5, 0.5, 0.5], [0.0, 1.0, 0.5, 0.5, 0.0]]
    lost, won, contradicted = _twice(nearer, farther)
    assert lost == [0.0, 1.0, 0.0, 0.0, 0.0]
    assert won == [1.0, 0.0, 0.0, 0.0, 0.5]
    assert contradicted == [0.0, 0.0, 0.0, 1.0, 0.0]


def test_a_frame_without_one_of_its_four_answers_counts_nothing() -> None:
    """NaN is no answer, and no tie."""
    assert _twice([[1.0, math.nan], [1.0, 1.0]], [[math.nan, 0.0], [0.0, 0.0]]) == [[0.0, 0.0]] * 3


@pytest.mark.parametrize("wrong", [0.0, 0.05, 0.2, 0.45])
@pytest.mark.parametrize(("right", "left"), [(1.0, 0.0), (0.9, 0.1), (0.5, 0.2), (0.3, 0.0)])
def test_noise_does_not_move_the_share_the_wrong_way_round(wrong: float, right: float, left: float) -> None:
    """Pairs told apart the right way with one chance and the wrong way with another, exchanged in a share of them."""
    lost = wrong * right**2 + (1 - wrong) * left**2
    won = wrong * left**2 + (1 - wrong) * right**2
    assert wrong_way(lost, won, 2 * right * left) == pytest.approx(wrong)


def test_answers_that_repeat_have_the_share_that_is_lost() -> None:
    """At temperature 0 nothing is contradicted: 3 of 30."""
    assert wrong_way(3, 27, 0) == pytest.approx(0.1)
    assert math.isnan(wrong_way(1, 1, 2))


def test_several_noises_never_lower_the_share() -> None:
    """Of half of the pairs a tenth the wrong way round without noise, of the other half with it: at least a tenth."""
    plain, noisy = (0.1, 0.9, 0.0), (0.1 * 0.49 + 0.9 * 0.09, 0.1 * 0.09 + 0.9 * 0.49, 0.42)
    assert 0.1 < wrong_way(*((one + other) / 2 for one, other in zip(plain, noisy, strict=True))) < 0.15


def _order(wrong: list[int], frames: int, episodes: int) -> Statistic:
    """Return the order of frames that repeat their answers, so many of each episode the wrong way round."""
    lost = np.concatenate([[1.0] * one + [0.0] * (frames - one) for one in wrong])
    return order_of([lost, 1 - lost, 0 * lost], np.repeat(np.arange(episodes), frames))


def test_the_bound_of_order_is_at_least_that_of_so_many_frames() -> None:
    """Episodes that do not differ leave Clopper and Pearson's of frames; episodes that do, Student's t, by hand."""
    alike = _order([1] * 6, 10, 6)
    assert alike.value == pytest.approx(0.1)
    assert alike.ci == pytest.approx(clopper_pearson(6, 60, 0.9))
    apart = _order([0, 0, 0, 0, 0, 6], 10, 6)
    left = [6 / 50] * 5 + [0.0]
    spread = math.sqrt(5 / 6 * sum((one - np.mean(left)) ** 2 for one in left))
    assert apart.ci is not None
    assert apart.ci[1] == pytest.approx(0.1 + 2.015048373 * spread)


def test_order_says_what_it_cannot_say() -> None:
    """No comparison, too few episodes, and answers that contradict each other as often as they agree."""
    assert order_of(np.zeros((3, 8)), np.arange(8)).value is None
    assert _order([0] * 5, 4, 5).ci is None
    noise = order_of([[1.0] * 8, [1.0] * 8, [2.0] * 8], np.arange(8))
    assert noise.value is None
    assert isinstance(noise, Order)
    assert noise.contradicted == 16


def _falling(at: Floats) -> Floats:
    return np.where(at < 12, 1.0, np.where(at < 30, 0.5, 0.0))


def _drawn(frames: int, seed: int = 0) -> Floats:
    return np.asarray(5 * 12 ** np.random.default_rng(seed).random((2, frames)))


def test_a_hole_a_factor_of_a_fifth_wide_is_a_rise_and_a_reader_has_none() -> None:
    """The place of the rise is that of the hole's farther end."""
    at = _drawn(72)
    assert (greatest_rise(at, _falling(at), seed=1).p or 0.0) > 0.2
    hole = greatest_rise(at, np.where((at > 13) & (at < 16.5), 0.0, _falling(at)), seed=1)
    assert isinstance(hole, Rise)
    assert hole.p is not None
    assert hole.p <= 0.005
    assert hole.nearer is not None
    assert hole.farther is not None
    assert 12.5 < hole.nearer[0] < hole.farther[0] < 18.5


def test_what_a_frame_has_of_its_own_is_no_rise() -> None:
    """Frames that brake or do not, whatever is shown: p is spread evenly where whole frames change places."""
    ps = []
    for seed in range(40):
        own = np.random.default_rng(seed).integers(0, 2, 30).astype(float)
        ps.append(greatest_rise(_drawn(30, seed), [own, own], seed=seed, resamples=99).p or 0.0)
    assert np.mean(np.array(ps) <= 0.1) <= 0.25


def test_a_rise_needs_answers_and_levels_that_differ() -> None:
    """Too few answers cannot say; equal levels have none; a level that is missing is left out."""
    at = _drawn(6)
    assert greatest_rise(at[:, :5], np.ones((2, 5)), seed=0).value is None
    assert greatest_rise(at, np.ones((2, 6)), seed=0).p == 1.0
    levels = _falling(at)
    levels[0, 0] = np.nan
    assert greatest_rise(at, levels, seed=0).n == 11


def test_density_counts_the_emptiest_window_too() -> None:
    """Places a factor of 1.1 apart: 2 or so in a window of 1.2, one inside of it; a gap of a factor of 2 holds none."""
    at = 1.1 ** np.arange(20)
    even = density(at, 1.2)
    assert isinstance(even, Density)
    assert even.value == pytest.approx(20 * math.log(1.2) / math.log(1.1**19))
    assert even.fewest == 1
    gap = density([*at, *(at * 20)], 1.2)
    assert isinstance(gap, Density)
    assert gap.fewest == 0
    assert density([1.0, 1.1], 1.2).value is None
