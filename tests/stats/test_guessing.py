from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from eyechart.stats.forced_choice import Block, bounds, right


def dealt_anew(choices: int, said: tuple[int | None, ...]) -> np.ndarray:
    """Return the chances of each number right by going through every deal."""
    deals = list(permutations(range(choices), len(said)))
    counts = np.bincount([sum(a == b for a, b in zip(deal, said, strict=True)) for deal in deals])
    return np.pad(counts, (0, len(said) + 1 - len(counts))) / len(deals)


SAID = st.lists(st.none() | st.integers(0, 4), min_size=1, max_size=5)


@given(SAID)
def test_chances_are_those_of_every_deal_gone_through(said: list[int | None]) -> None:
    """Whatever was said, the same thing several times included."""
    block = Block(5, range(len(said)), said)
    np.testing.assert_allclose(block.chances(), dealt_anew(5, tuple(said)), atol=1e-12)


def test_one_answer_to_everything_is_never_evidence() -> None:
    """It is right once at most, in any deal."""
    assert right([Block(4, (2, 0, 1, 3), (2, 2, 2, 2))]).p == 1.0
    found = right([Block(8, (2, 0, 1, 3), (2, 2, 2, 2)), Block(4, (1, 0), (None, None))])
    assert found.p == 0.5
    assert (found.right, found.expected) == (1, 0.5)


def test_all_right_has_the_chance_of_the_deal() -> None:
    """One of 8 · 7 · 6 times one of 4 · 3."""
    found = right([Block(8, (5, 0, 1), (5, 0, 1)), Block(4, (1, 0), (1, 0))])
    assert found.p == pytest.approx(1 / (8 * 7 * 6) / (4 * 3))
    assert (found.value, found.n) == (1.0, 5)


def test_whatever_a_guesser_says_its_p_is_small_no_more_often_than_it_says() -> None:
    """Over every deal: the share of p at or below a level is at most the level."""
    for said in product((0, 1, 2), repeat=3):
        found = [right([Block(4, deal, said)]).p for deal in permutations(range(4), 3)]
        for level in sorted(set(found)):
            assert np.mean([p <= level for p in found]) <= level + 1e-12


@pytest.mark.parametrize(("k", "n"), [(0, 14), (3, 14), (7, 14), (14, 14), (0, 1)])
def test_bounds_leave_five_percent_beyond_them(k: int, n: int) -> None:
    """By the definition of Clopper and Pearson."""
    low, high = bounds(k, n)
    if k:
        assert binom.sf(k - 1, n, low) == pytest.approx(0.05)
    if k < n:
        assert binom.cdf(k, n, high) == pytest.approx(0.05)
    assert low <= k / n <= high
    assert (low == 0.0, high == 1.0) == (k == 0, k == n)


def test_no_question_and_a_wrong_deal_are_told() -> None:
    """None is "cannot say"; an answer that is dealt twice is no deal."""
    assert right([]).value is None
    with pytest.raises(ValueError, match="holds each answer once"):
        Block(4, (1, 1), (0, 0))
    with pytest.raises(ValueError, match="numbers below 4"):
        Block(4, (1, 2), (0, 4))
