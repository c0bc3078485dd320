"""A few numbers far from all others are faults of a log; a move that is rare, or a heavy tail, is none."""

import numpy as np
import pytest

from eyechart.stats.outliers import outlying, recurs

RNG = np.random.default_rng(0)
USUAL = RNG.normal(size=(144, 2))


def spoilt(size: float, rows: int = 1) -> np.ndarray:
    """Return the usual numbers with some of the first column far away."""
    result = USUAL.copy()
    result[:rows, 0] = size
    return result


@pytest.mark.parametrize("size", [30.0, -30.0, 1e3, 1e12])
@pytest.mark.parametrize("rows", [1, 3])
def test_few_numbers_far_from_all_others_are_found(size: float, rows: int) -> None:
    """In their column alone, on either side."""
    found = outlying(spoilt(size, rows))
    assert found[:rows, 0].all()
    assert found.sum() == rows


def test_what_is_of_one_row_counts_as_one() -> None:
    """A chunk of eight steps holds each row of a log up to eight times."""
    every = np.repeat(spoilt(100.0), 8, axis=0)[: 8 * 30]
    assert not outlying(every).any()
    assert outlying(every, at_once=8).sum() == 8


@pytest.mark.parametrize(
    "numbers",
    [
        USUAL,
        spoilt(6.0),
        spoilt(1e3, rows=4),
        spoilt(1e3)[:19],
        np.where(np.arange(400) < 4, 1.0, 0.0)[:, None],  # a gripper that closes four times
        np.where(np.arange(400) < 20, 1.0, 1e-4 * RNG.normal(size=400))[:, None],  # an arm that mostly stands
        RNG.laplace(size=(2000, 1)),
        RNG.uniform(size=(50, 3)),
        np.zeros((50, 1)),
        np.full((50, 1), np.nan),
    ],
)
def test_nothing_else_is_a_fault(numbers: np.ndarray) -> None:
    """Near numbers, many of them, few rows in all, what is mostly one value, and usual tails."""
    assert not outlying(numbers).any()


def test_what_is_far_in_several_episodes_recurs() -> None:
    """In more than one, and more than a twentieth of them: a gripper that closes, and no wrong row."""
    episodes = np.repeat(np.arange(60), 10)
    far = np.zeros((600, 3), dtype=bool)
    far[[0, 1, 2], 0] = far[[0, 10, 20], 1] = far[[0, 10, 20, 30], 2] = True
    assert recurs(far, episodes).tolist() == [False, False, True]
    assert recurs(far[:200], episodes[:200]).tolist() == [False, True, True]
    closes = np.where(np.arange(400) % 50 == 7, 1.0, 1e-3 * RNG.normal(size=400))[:, None]
    found = outlying(closes)
    assert found.sum() == 8
    assert recurs(found, np.arange(400) // 20).all()
