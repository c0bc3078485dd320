"""Upper bounds on missed hazards: reference values, and that they hold as often as they say."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from eyechart.stats.risk_bounds import (
    conformal_threshold,
    episodes_needed,
    hoeffding_bentkus_p,
    mean_bound,
    ratio_bound,
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
    with pytest.raises(ValueError, match="must not fall"):
        conformal_threshold(np.array([[0.5], [0.2]]), 0.5)
    for loss in (-0.01, 1.01):
        with pytest.raises(ValueError, match=r"must lie in \[0, 1\]"):
            conformal_threshold(np.array([[loss]]), 0.5)


def tail(k: int, n: int, risk: Fraction) -> Fraction:
    """Return P(Bin(n, risk) <= k), in exact fractions."""
    return sum((math.comb(n, i) * risk**i * (1 - risk) ** (n - i) for i in range(k + 1)), Fraction())


@pytest.mark.parametrize(
    ("k", "n", "risk", "which"),
    [(3, 100, Fraction(1, 10), "bentkus"), (0, 60, Fraction(1, 20), "hoeffding"), (20, 60, Fraction(1, 2), "bentkus")],
)
def test_the_p_value_is_the_smaller_of_hoeffdings_and_bentkuss(k: int, n: int, risk: Fraction, which: str) -> None:
    """exp(-n kl(mean, risk)) and e P(Bin(n, risk) <= k) (Bates et al. 2021), in exact fractions."""
    mean = Fraction(k, n)
    power = (risk / mean) ** k if k else Fraction(1)
    hoeffding = float(power * ((1 - risk) / (1 - mean)) ** (n - k))
    bentkus = math.e * float(tail(k, n, risk))
    assert hoeffding_bentkus_p(k / n, n, float(risk)) == pytest.approx(min(hoeffding, bentkus), rel=1e-9)
    assert min((hoeffding, "hoeffding"), (bentkus, "bentkus"))[1] == which


def test_a_mean_between_two_counts_takes_the_larger_count() -> None:
    """Bentkus's tail is that of the count rounded up, and a risk at or below the mean is never rejected."""
    bentkus = math.e * float(tail(4, 100, Fraction(1, 10)))
    assert hoeffding_bentkus_p(0.0399, 100, 0.1) == pytest.approx(bentkus, rel=1e-9)
    assert (hoeffding_bentkus_p(0.2, 50, 0.2), hoeffding_bentkus_p(0.2, 50, 0.19)) == (1.0, 1.0)
    assert hoeffding_bentkus_p(0.2, 50, 1.0) == 0.0


@pytest.mark.parametrize(("k", "n"), [(3, 100), (12, 60)])
def test_the_mean_bound_is_where_bentkuss_p_value_is_one_in_twenty(k: int, n: int) -> None:
    """Just above it the p value, in exact fractions, is below .05, and just below it above."""
    high = upper(mean_bound(np.arange(n) < k))
    for risk, rejects in ((high + 1e-6, True), (high - 1e-6, False)):
        exact = Fraction(risk)
        mean = Fraction(k, n)
        hoeffding = (exact / mean) ** k * ((1 - exact) / (1 - mean)) ** (n - k)
        assert (min(float(hoeffding), math.e * float(tail(k, n, exact))) <= 0.05) is rejects


def test_the_share_bound_is_where_the_binomial_tail_is_one_in_twenty() -> None:
    """In exact fractions, without another library's inverse."""
    for k, n in ((0, 12), (2, 30), (7, 20)):
        assert float(tail(k, n, Fraction(upper(share_bound(k, n))))) == pytest.approx(0.05, rel=1e-9)


def test_the_conformal_risk_counts_one_loss_more() -> None:
    """(n mean + 1)/(n + 1): 19 episodes without a loss reach 1 in 20, and 18 do not (Angelopoulos et al. 2024)."""
    assert conformal_threshold(np.zeros((1, 19)), 0.05) == (1, (0.05,))
    assert conformal_threshold(np.zeros((1, 18)), 0.05)[0] is None
    losses = np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.0], [1.0, 0.5, 0.5]])
    assert conformal_threshold(losses, 0.375) == (2, (0.25, 0.375, 0.75))
    assert conformal_threshold(losses, 0.374)[0] == 1


@pytest.mark.parametrize(("n", "frames", "longest"), [(40, 6, 12), (40, 12, 12), (12, 3, 24), (300, 1, 1)])
def test_the_bound_per_frame_without_an_event_is_where_the_wealth_of_all_stakes_is_twenty(
    n: int, frames: int, longest: int
) -> None:
    """Equal episodes multiply a bet alike, so that its wealth is known by hand."""
    statistic = ratio_bound([0] * n, [frames] * n, longest)
    assert (statistic.value, statistic.n, statistic.detail) == (
        0,
        n * frames,
        {"events": 0, "episodes": n, "longest": longest},
    )
    rate = upper(statistic)
    gain = rate * frames / ((1 - rate) * longest)
    wealth = 0.5 * (1 + gain) ** n + sum(0.5 / 12 * (1 + gain / 2**place) ** n for place in range(1, 13))
    assert wealth == pytest.approx(20, rel=1e-4)


def test_the_bound_per_frame_holds_where_misses_come_in_the_episodes_with_most_hazards() -> None:
    """The bound of the mean share over episodes, each counting alike, does not hold for it there."""
    dice, rich = np.random.default_rng(5), 0.15
    truly = rich * 12 * 0.5 / (rich * 12 + (1 - rich) * 2)
    held, other = [], []
    for _ in range(200):
        hazards = np.where(dice.random(40) < rich, 12, dice.integers(1, 4, 40))
        missed = np.where((hazards == 12) & (dice.random(40) < 0.5), hazards, 0)
        held.append(upper(ratio_bound(missed, hazards, 12)) >= truly)
        other.append(upper(mean_bound(missed / hazards)) >= truly)
    assert np.mean(held) >= 0.95
    assert np.mean(other) < 0.5


def test_the_bound_per_frame_says_nothing_of_no_frame_and_one_of_nothing_but_events() -> None:
    """And counts that cannot be are refused."""
    assert ratio_bound([], [], 12).value is None
    assert ratio_bound([0, 0], [0, 0], 12).note == "no frames"
    assert ratio_bound([3, 3], [3, 3], 12).ci == (0, 1)
    for events, frames, longest in (([2], [1], 12), ([1], [13], 12), ([-1], [1], 12), ([1, 1], [1], 12)):
        with pytest.raises(ValueError, match="events must be at most the frames of each episode"):
            ratio_bound(events, frames, longest)
