"""Pairs lost beyond noise, against binomial terms in whole numbers; rises along a scale, against ones by hand."""

import math
from fractions import Fraction

import pytest

from eyechart.stats.order import falls_everywhere, lost_beyond_noise


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
