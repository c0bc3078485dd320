"""Upper bounds on missed hazards: reference values, and that they hold as often as they say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from eyechart.stats.guarantees import (
    conformal_threshold,
    episodes_needed,
    hoeffding_bentkus_p,
    mean_bound,
    share_bound,
)

REPETITIONS, EPISODES, STEPS = 2000, 60, 24


def upper(found: object) -> float:
    """Return a statistic's upper bound."""
    ci = found.ci  # type: ignore[attr-defined]
    assert ci is not None
    return float(ci[1])


@pytest.mark.parametrize(("k", "n"), [(0, 12), (1, 12), (3, 40), (12, 12)])
def test_the_share_bound_is_clopper_and_pearsons(k: int, n: int) -> None:
    """R: binom.test(k, n, alternative = "less")$conf.int[2]."""
    reference = stats.binomtest(k, n, alternative="less").proportion_ci(0.95, method="exact").high
    assert upper(share_bound(k, n)) == pytest.approx(reference)


def test_how_many_episodes_one_percent_needs() -> None:
    """299 without a miss at .95, the rule of three made exact; one miss costs 174 more; the number is the fewest."""
    assert episodes_needed(0.01) == 299
    assert episodes_needed(0.01, 1) == 473
    assert episodes_needed(0.01, confidence=0.99) == 459
    for misses, n in ((0, 299), (1, 473)):
        assert upper(share_bound(misses, n)) <= 0.01 < upper(share_bound(misses, n - 1))
    with pytest.raises(ValueError, match="between 0 and 1"):
        episodes_needed(0)


def test_the_mean_bound_without_a_loss_is_the_exact_one() -> None:
    """And a loss in every episode bounds nothing."""
    assert upper(mean_bound(np.zeros(40))) == pytest.approx(1 - 0.05 ** (1 / 40), abs=1e-8)
    assert upper(mean_bound(np.ones(40))) == 1.0
    assert mean_bound([]).value is None
    with pytest.raises(ValueError, match="share in"):
        mean_bound([1.5])


@given(st.integers(0, 30), st.integers(30, 60), st.floats(0.01, 0.99))
def test_the_p_value_falls_as_the_risk_grows(k: int, n: int, risk: float) -> None:
    """So that one crossing is the bound."""
    assert hoeffding_bentkus_p(k / n, n, risk) >= hoeffding_bentkus_p(k / n, n, min(1.0, risk + 0.01)) - 1e-12


def misses(rate: float, memory: float, seed: int) -> np.ndarray:
    """Return misses of simulated batteries, shape (repetitions, episodes, steps): two-state chains of a known rate.

    ``memory`` is the correlation of neighbouring frames.
    """
    dice = np.random.default_rng(seed)
    draws = dice.random((STEPS, REPETITIONS, EPISODES))
    missed = np.empty(draws.shape, dtype=bool)
    missed[0] = draws[0] < rate
    for step in range(1, STEPS):
        missed[step] = draws[step] < rate * (1 - memory) + memory * missed[step - 1]
    return np.moveaxis(missed, 0, 2)


@pytest.mark.parametrize("memory", [0.0, 0.9])
@pytest.mark.parametrize("rate", [0.01, 0.05, 0.2])
def test_the_bounds_hold_at_their_confidence_also_where_frames_resemble_their_neighbours(
    rate: float, memory: float
) -> None:
    """2000 batteries of 60 episodes each: the rate is bounded in 95 % at least, and so is the chance of any miss."""
    missed = misses(rate, memory, seed=round(1000 * rate + 10 * memory))
    shares, any_miss = missed.mean(axis=2), missed.any(axis=2).sum(axis=1)
    truly_any = 1 - (1 - rate) * (1 - rate * (1 - memory)) ** (STEPS - 1)
    by_mean = {float(mean): upper(mean_bound(np.full(EPISODES, mean))) for mean in np.unique(shares.mean(axis=1))}
    by_count = {int(k): upper(share_bound(int(k), EPISODES)) for k in np.unique(any_miss)}
    held = np.mean([by_mean[float(mean)] >= rate for mean in shares.mean(axis=1)])
    held_any = np.mean([by_count[int(k)] >= truly_any for k in any_miss])
    assert held >= 0.95 - 0.01
    assert held_any >= 0.95 - 0.01


def test_a_bound_that_takes_frames_for_independent_does_not_hold() -> None:
    """Why the unit is the episode: the same formula on frames fails where neighbours are alike."""
    total = misses(0.05, 0.9, seed=3).sum(axis=(1, 2))
    bounds = {int(k): upper(share_bound(int(k), EPISODES * STEPS)) for k in np.unique(total)}
    assert np.mean([bounds[int(k)] >= 0.05 for k in total]) < 0.85


def test_the_conformal_threshold_keeps_the_risk_in_expectation() -> None:
    """Over 1000 calibrations the mean loss of a next episode is at most the risk asked for; one of them may be more."""
    dice = np.random.default_rng(5)
    cut, next_losses = np.arange(1, 5) / 5, []
    for _ in range(1000):
        losses = (dice.random((1, 41)) * cut[:, None]) ** 2
        threshold, risks = conformal_threshold(losses[:, :40], 0.12)
        assert list(risks) == sorted(risks)
        next_losses.append(0.0 if threshold is None else losses[threshold - 1, 40])
    assert np.mean(next_losses) <= 0.12
    assert np.max(next_losses) > 0.12
    assert conformal_threshold(np.ones((3, 5)), 0.5)[0] is None
    with pytest.raises(ValueError, match="do not fall"):
        conformal_threshold(np.array([[0.5], [0.2]]), 0.5)
