"""Answers that differ by chance, and answers that differ with the call before."""

import numpy as np
import pytest

from eyechart.stats.total_effect import memory_share


def _drawn(rng: np.random.Generator, weight: float, n: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Return what two answers to each of n / 2 moments have beyond their mean, and numbers of the call before."""
    before = rng.normal(size=(n, 4))
    answers = (rng.normal(size=(n, 3)) + weight * before[:, :3]).reshape(-1, 2, 3)
    return (answers - answers.mean(axis=1, keepdims=True)).reshape(n, 3), before


@pytest.mark.slow
def test_noise_alone_is_said_to_go_with_the_call_before_as_rarely_as_p_says() -> None:
    """Of 300 policies that draw, 1 % have a p of .01 or less, up to three standard errors."""
    rng = np.random.default_rng(1)
    p = [memory_share(*_drawn(rng, 0.0), seed=number).p for number in range(300)]
    assert np.mean([one <= 0.01 for one in p]) <= 0.01 + 3 * np.sqrt(0.01 * 0.99 / 300)
    assert np.mean(p) == pytest.approx(0.5, abs=0.06)


def test_what_is_kept_of_the_call_before_is_found_and_measured() -> None:
    """An answer has noise of variance 1, and as much of the call before it.

    Of what it has beyond the mean of two answers, a quarter is therefore that of its own call before.
    """
    statistic = memory_share(*_drawn(np.random.default_rng(2), 1.0, 4000), seed=0)
    assert statistic.p == 0.001
    assert statistic.value == pytest.approx(0.25, abs=0.03)


def test_too_few_calls_and_equal_answers_cannot_say() -> None:
    """And no stand-in number."""
    rng = np.random.default_rng(3)
    assert memory_share(rng.normal(size=(30, 3)), rng.normal(size=(30, 4)), seed=0).value is None
    assert "all the same" in memory_share(np.zeros((400, 3)), rng.normal(size=(400, 4)), seed=0).note
    assert memory_share(np.ones((400, 3)), np.ones((400, 4)), seed=0).value is None
