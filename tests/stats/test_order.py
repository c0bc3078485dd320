"""Pairs lost beyond noise, against binomial terms in whole numbers; rises along a scale, against ones by hand."""

import math
from fractions import Fraction

import numpy as np
import pytest

from eyechart.stats.order import Floats, falls_everywhere, lost_beyond_noise, swapped_ends


def _tail(lost: int, pairs: int, wavered: int, repeats: int) -> float:
    """Return the chance of at least ``lost`` of a binomial, by its definition."""
    share, n = Fraction(pairs, pairs + 2 * repeats), lost + wavered
    return float(sum(math.comb(n, k) * share**k * (1 - share) ** (n - k) for k in range(lost, n + 1)))


@pytest.mark.parametrize(
    "given", [(0, 144, 0, 144), (0, 7, 9, 30), (1, 144, 0, 144), (9, 144, 4, 144), (30, 140, 61, 139), (60, 72, 0, 36)]
)
def test_pairs_lost_are_as_rare_as_the_binomial_of_their_sum_says(given: tuple[int, int, int, int]) -> None:
    """One lost pair of 144 where no repeat of 144 wavers has p 1/3: noise loses half as many as repeats disagree."""
    assert lost_beyond_noise(*given) == pytest.approx(_tail(*given), rel=1e-12)


def test_one_lost_pair_without_any_noise_has_p_one_third() -> None:
    """By hand: 144 / (144 + 2 x 144)."""
    assert lost_beyond_noise(1, 144, 0, 144) == pytest.approx(1 / 3, abs=1e-15)


@pytest.mark.parametrize("given", [(0, 0, 1, 10), (1, 10, 0, 0)])
def test_without_pairs_or_repeats_there_is_nothing_to_compare(given: tuple[int, int, int, int]) -> None:
    """It is an error, not a p."""
    with pytest.raises(ValueError, match="no pairs, or no repeats"):
        lost_beyond_noise(*given)


ENDS = {"light": 0.0, "hard": 1.0}


def test_pairs_at_opposite_ends_are_less_what_independent_answers_explain() -> None:
    """By hand: 2 of 20 lost and 10 won; 4 of 10 repeats are apart, so half of that is .2, and .2² x 2 = .08."""
    nearer = [0.0] * 2 + [1.0] * 10 + [0.5] * 8
    farther = [1.0] * 2 + [0.0] * 10 + [0.5] * 8
    repeats = [1.0] * 3 + [0.0] + [0.5] * 6, [0.0] * 3 + [1.0] + [0.5] * 6
    found = swapped_ends((nearer, farther), repeats, **ENDS)
    assert found.value == pytest.approx(2 / 20 - 0.2 * 0.2 / (10 / 20))
    assert found.n == 20
    assert found.detail == {"lost": 2, "won": 10, "repeats_apart": 4}
    assert found.ci is not None
    assert found.ci[0] < found.value < found.ci[1]


def test_noise_explains_no_more_than_half_of_the_repeats_that_are_apart() -> None:
    """One pair won of twenty would make f² / w greater than f: two answers of one law lose half of f at most."""
    found = swapped_ends(([0.0] + [0.5] * 18 + [1.0], [1.0] + [0.5] * 18 + [0.0]), ([1.0, 0.5], [0.0, 0.5]), **ENDS)
    assert found.value == pytest.approx(1 / 20 - 1 / 4)
    none = swapped_ends(([0.0] * 4, [1.0] * 4), ([1.0, 0.5], [0.0, 0.5]), **ENDS)
    assert none.value == pytest.approx(1 - 1 / 4)


def test_one_level_of_braking_is_no_swap_of_ends() -> None:
    """From none to a little, or from a little to hard, is not from end to end."""
    found = swapped_ends(([0.0, 0.5], [0.5, 1.0]), ([0.5], [0.5]), **ENDS)
    assert found.value == 0.0


@pytest.mark.parametrize("given", [(([], []), ([1.0], [1.0])), (([1.0], [0.0]), ([], []))])
def test_without_pairs_or_repeats_no_end_is_swapped(given: tuple[tuple[list[float], list[float]], ...]) -> None:
    """It is an error, not a share."""
    with pytest.raises(ValueError, match="no pairs, or no repeats"):
        swapped_ends(given[0], given[1], **ENDS)


def test_a_rise_is_told_with_its_size_and_its_place() -> None:
    """Six at 0 and six at 1 rise by two standard deviations of a level."""
    found = falls_everywhere(range(12), [0.0] * 6 + [1.0] * 6, seed=1)
    assert found.value == pytest.approx(2 * 6 / math.sqrt(12))
    assert found.note == "most from 0-5 to 6-11"
    assert found.p is not None
    assert found.p < 0.01


def test_a_fall_has_no_rise_and_eleven_answers_say_nothing() -> None:
    """A fall has p 1, as levels that are all alike; two windows of six answers are the fewest."""
    assert falls_everywhere(range(12), [1.0] * 6 + [0.0] * 6, seed=1).p == 1.0
    assert falls_everywhere(range(12), [1.0] * 12, seed=1).note == "all levels are alike"
    steps = falls_everywhere(range(24), [1.0] * 12 + [0.0] * 12, seed=1)
    assert (steps.value, steps.p, steps.note) == (0.0, 1.0, "nowhere")
    assert falls_everywhere(range(11), [1.0] * 11, seed=1).value is None


@pytest.mark.parametrize("n", [30, 60])
def test_p_of_a_rise_is_the_share_of_orders_with_as_great_a_one(n: int) -> None:
    """Of 200 orders, each looked at by itself, window by window; of these p is far from 0 and from 1."""
    rng = np.random.default_rng(n)
    levels = rng.choice([0.0, 0.5, 1.0], n)
    found = falls_everywhere(range(n), levels, seed=3, resamples=200)
    drawn = np.random.default_rng(3).permuted(np.tile(levels, (200, 1)), axis=1)
    as_great = sum(_greatest_rise(one) >= _greatest_rise(levels) - 1e-12 for one in drawn)
    assert found.p == pytest.approx((1 + as_great) / 201)
    assert 0.05 < found.p < 0.95


def _greatest_rise(levels: Floats) -> float:
    widths = {int(one) for one in np.geomspace(6, max(6, len(levels) / 4), 6)}
    return max(
        float(levels[at + wide : at + 2 * wide].mean() - levels[at : at + wide].mean()) * math.sqrt(wide / 2)
        for wide in widths
        for at in range(len(levels) - 2 * wide + 1)
    )


def test_an_answer_that_stands_in_two_pairs_counts_once_in_the_interval() -> None:
    """The share stays, and its interval is that of half as many pairs."""
    nearer, farther = [0.0] * 4 + [1.0] * 12, [1.0] * 4 + [0.0] * 12
    once = swapped_ends((nearer, farther), ([1.0], [1.0]), **ENDS)
    twice = swapped_ends((nearer * 2, farther * 2), ([1.0], [1.0]), **ENDS, often=2)
    assert (once.value, once.n, once.ci) == (twice.value, twice.n, twice.ci)
