import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eyechart.stats import association, episode_permutation, statistic

SCENARIOS, SEEDS, STEPS = 4, 3, 12
SIMULATIONS = 400


def bank(scenarios: int = SCENARIOS, seeds: int = SEEDS, steps: int = STEPS) -> tuple[np.ndarray, ...]:
    """Return stratum, episode and step of each frame of a balanced bank."""
    stratum, episode, step = np.indices((scenarios, seeds, steps)).reshape(3, -1)
    return stratum, episode, step


def bits(table: np.ndarray) -> float:
    """Return the mutual information of one table."""
    return float(association.information_of_tables(table[None])[0])


def autocorrelated(rng: np.random.Generator, scenarios: int = SCENARIOS, seeds: int = SEEDS) -> np.ndarray:
    """Return one AR(.9) series per episode, stationary, flat in the order of `bank`."""
    series = rng.normal(size=(scenarios, seeds, STEPS))
    for t in range(1, STEPS):
        series[:, :, t] = 0.9 * series[:, :, t - 1] + math.sqrt(1 - 0.81) * series[:, :, t]
    return series.ravel()


def nuisance_follower(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return levels that follow another drifting quantity, and gaps that they never see."""
    return (autocorrelated(rng) > 0).astype(int), autocorrelated(rng)


def time_follower(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return levels that follow the step alone, with 10 % noise, and gaps that close with the step."""
    step = bank()[2]
    level = np.where(rng.random(len(step)) < 0.1, rng.integers(0, 3, len(step)), step // 4)
    return level, -step + autocorrelated(rng)


def scene_recogniser(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return levels that follow the scenario, whose gaps differ, with 10 % noise."""
    stratum = bank()[0]
    level = np.where(rng.random(len(stratum)) < 0.1, rng.integers(0, 2, len(stratum)), stratum < 2)
    return level.astype(int), 1.0 * stratum + autocorrelated(rng)


@pytest.mark.parametrize("controller", [nuisance_follower, time_follower, scene_recogniser])
def test_the_exchange_test_keeps_its_error_rate(controller: Callable) -> None:
    """Under three nulls the p values are close to uniform: shares within 3.5 deviations of nominal."""
    rng = np.random.default_rng(11)
    p = np.array([episode_permutation.exchange_test(*controller(rng), *bank(), seed=0).p for _ in range(SIMULATIONS)])
    for alpha in (0.01, 0.05, 0.2, 0.5, 0.8):
        slack = 3.5 * math.sqrt(alpha * (1 - alpha) / SIMULATIONS)
        assert np.mean(p <= alpha) < alpha + slack
        assert np.mean(p <= alpha) > alpha - slack - 0.02


@pytest.mark.parametrize("controller", [nuisance_follower, time_follower, scene_recogniser])
def test_the_information_version_keeps_its_error_rate(controller: Callable) -> None:
    """Two-sided in nature, the same null: at most the nominal share rejects."""
    rng = np.random.default_rng(12)
    p = []
    for _ in range(SIMULATIONS // 2):
        level, gap = controller(rng)
        bins = association.quantile_bins(gap).codes
        p.append(episode_permutation.exchange_mi_test(level, bins, *bank(), seed=0).p)
    for alpha in (0.05, 0.5):
        slack = 3.5 * math.sqrt(alpha * (1 - alpha) / len(p))
        assert alpha - slack - 0.05 < np.mean(np.array(p) <= alpha) < alpha + slack


def test_permuting_frames_one_by_one_does_not() -> None:
    """The contrast: the i.i.d. test of the same nuisance follower rejects far above .05 (facts, section 3)."""
    rng = np.random.default_rng(13)
    p = [
        episode_permutation.iid_trend_test(*nuisance_follower(rng), bank()[0], seed=0, resamples=199).p
        for _ in range(100)
    ]
    assert np.mean(np.array(p) <= 0.05) > 0.15


def test_a_controller_that_brakes_near_is_found_and_its_opposite_is_not() -> None:
    """The deterministic one reaches the smallest p, 1/1296; inverted it gets p = 1 from the trend."""
    gap = autocorrelated(np.random.default_rng(2)) + bank()[1]
    level = (gap < np.median(gap)).astype(int)
    found = episode_permutation.exchange_test(level, gap, *bank(), seed=0)
    assert found.value == pytest.approx(float(level @ gap))
    assert (found.n, found.p) == (144, 1 / 1296)
    assert found.detail["smallest_p"] == 1 / 1296
    assert found.method.endswith("all 1296 arrangements")
    inverted = episode_permutation.exchange_test(1 - level, gap, *bank(), seed=0)
    assert inverted.p == 1.0
    bins = association.quantile_bins(gap).codes
    assert episode_permutation.exchange_mi_test(1 - level, bins, *bank(), seed=0).p == 1 / 1296


def brute_force(level: np.ndarray, gap: np.ndarray, sizes: tuple[int, int], measure: Callable) -> np.ndarray:
    """Return a measure of every exchange of the gap series of two strata, frame by frame."""
    levels, gaps, out = level.reshape(*sizes, -1), gap.reshape(*sizes, -1), []
    for orders in itertools.product(itertools.permutations(range(sizes[1])), repeat=sizes[0]):
        moved = np.stack([gaps[s, list(order)] for s, order in enumerate(orders)])
        out.append(measure(levels.ravel(), moved.ravel()))
    return np.array(out)


@given(seed=st.integers(0, 10_000), seeds=st.integers(2, 4))
@settings(max_examples=25)
def test_the_exact_exchange_is_brute_force(seed: int, seeds: int) -> None:
    """Both statistics against all arrangements built frame by frame, ties included; frame order is free."""
    rng = np.random.default_rng(seed)
    stratum, episode, step = bank(2, seeds, 5)
    level, gap = rng.integers(0, 3, (2, len(step)))
    trends = brute_force(level, gap, (2, seeds), lambda a, g: float(a @ g))
    shuffle = rng.permutation(len(step))
    args = [array[shuffle] for array in (level, gap, stratum, episode, step)]
    trend = episode_permutation.exchange_test(*args, seed=0, alpha=0.5)
    assert trend.p == pytest.approx(np.mean(trends <= trends[0] + 1e-9))
    assert trend.null_mean == pytest.approx(trends.mean())
    informations = brute_force(
        level,
        gap,
        (2, seeds),
        lambda a, g: bits(association.contingency(a, g).table),
    )
    information = episode_permutation.exchange_mi_test(*args, seed=0, alpha=0.5)
    assert information.value == pytest.approx(informations[0], abs=1e-12)
    assert information.p == pytest.approx(np.mean(informations >= informations[0] - 1e-9))


def test_the_sampled_exchange_agrees_with_the_exact_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """One data set both ways; the sampled p is (k+1)/(B+1) and repeats with its seed."""
    level, gap = nuisance_follower(np.random.default_rng(3))
    exact = episode_permutation.exchange_test(level, gap, *bank(), seed=0)
    monkeypatch.setattr(episode_permutation, "ENUMERATED_ARRANGEMENTS", 0)
    sampled = episode_permutation.exchange_test(level, gap, *bank(), seed=0, resamples=20_000)
    assert sampled.method.endswith("B=20000")
    assert sampled.p == pytest.approx(exact.p, abs=4 * math.sqrt(0.25 / 20_000))
    assert sampled.null_mean == pytest.approx(exact.null_mean, abs=0.5)
    assert sampled == episode_permutation.exchange_test(level, gap, *bank(), seed=0, resamples=20_000)


@given(seed=st.integers(0, 999), k=st.integers(1, 4), steps=st.integers(1, 7))
@settings(max_examples=30)
def test_pair_tables_are_counted_frame_by_frame(seed: int, k: int, steps: int) -> None:
    """Every action episode against every gap episode, one frame at a time; action 3 is no decision."""
    rng = np.random.default_rng(seed)
    actions, bins = rng.integers(0, 4, (k, steps)), rng.integers(0, 2, (k, steps))
    expected = np.zeros((k, k, 3, 2))
    for i, j, t in itertools.product(range(k), range(k), range(steps)):
        if actions[i, t] < 3:
            expected[i, j, actions[i, t], bins[j, t]] += 1
    assert np.array_equal(episode_permutation._pair_tables(actions, bins, (3, 2)).reshape(k, k, 3, 2), expected)


def test_an_episode_of_a_thousand_steps_does_not_overflow_its_counts() -> None:
    """The type of the counts grows with the number of steps."""
    actions, bins = np.zeros((2, 1000), dtype=np.int64), np.zeros((2, 1000), dtype=np.int64)
    assert episode_permutation._pair_tables(actions, bins, (1, 1)).ravel().tolist() == [1000] * 4


def test_the_size_of_a_chunk_changes_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    """One resample at a time, or all of them, from one seed: the sampled tests give the same p."""
    level, gap = nuisance_follower(np.random.default_rng(3))
    bins = association.quantile_bins(gap).codes
    monkeypatch.setattr(episode_permutation, "ENUMERATED_ARRANGEMENTS", 0)

    def results() -> list[tuple[float | None, float | None]]:
        found = [
            episode_permutation.exchange_test(level, gap, *bank(), seed=1, alpha=0.05, resamples=99),
            episode_permutation.exchange_mi_test(level, bins, *bank(), seed=1, alpha=0.05, resamples=99),
            episode_permutation.iid_trend_test(level, gap, bank()[0], seed=1, resamples=99),
        ]
        return [(one.value, one.p) for one in found]

    whole = results()
    monkeypatch.setattr(statistic, "CHUNK_BYTES", 1)
    assert results() == whole


def exact_time_follower(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return levels that are the step itself, gaps that close with it, and which answers arrived (90 %)."""
    step = bank()[2]
    return step // 2, -2 * step + 0.5 * autocorrelated(rng), rng.random(len(step)) >= 0.1


def test_missing_decisions_that_keep_their_place_keep_the_error_rate() -> None:
    """Marked -1, an exact follower of time is hardly ever rejected at .05, by the trend or by information."""
    rng, trend, information = np.random.default_rng(14), [], []
    for _ in range(100):
        level, gap, answered = exact_time_follower(rng)
        level = np.where(answered, level, -1)
        trend.append(episode_permutation.exchange_test(level, gap, *bank(), seed=0).p)
        bins = association.quantile_bins(gap).codes
        information.append(episode_permutation.exchange_mi_test(level, bins, *bank(), seed=0).p)
    slack = 3.5 * math.sqrt(0.05 * 0.95 / 100)
    assert np.mean(np.array(trend) <= 0.05) < 0.05 + slack
    assert np.mean(np.array(information) <= 0.05) < 0.05 + slack


def test_dropped_frames_shift_the_series_and_the_result_says_so() -> None:
    """The same controller with its missing frames dropped is rejected: hence the note."""
    level, gap, answered = exact_time_follower(np.random.default_rng(14))
    kept = [array[answered] for array in (level, gap, *bank())]
    result = episode_permutation.exchange_test(*kept, seed=0)
    assert result.p < 0.05
    assert result.detail["shifted_frames"] > 0
    assert "aligned with another step: mark missing decisions, drop none" in result.note


def test_a_missing_decision_counts_nowhere() -> None:
    """Marked by -1 or an empty string, it leaves n, T and the information to the others."""
    level, gap = nuisance_follower(np.random.default_rng(6))
    missing = np.arange(144) % 7 == 3
    marked = np.where(missing, -1, level)
    bins = association.quantile_bins(gap).codes
    trend = episode_permutation.exchange_test(marked, gap, *bank(), seed=0)
    assert trend.n == np.count_nonzero(~missing)
    assert trend.value == pytest.approx(float(level[~missing] @ gap[~missing]))
    table = association.contingency(level[~missing], bins[~missing]).table
    names = np.where(missing, "", np.array(["GO", "STOP"])[level])
    for action in (marked, names):
        information = episode_permutation.exchange_mi_test(action, bins, *bank(), seed=0)
        assert information.n == trend.n
        assert information.value == pytest.approx(bits(table))
    alone = episode_permutation.iid_trend_test(marked, gap, seed=0)
    assert alone == episode_permutation.iid_trend_test(level[~missing], gap[~missing], seed=0)
    nothing = episode_permutation.exchange_test(np.full(144, -1), gap, *bank(), seed=0)
    assert (nothing.value, nothing.n, nothing.note) == (None, 0, "no decisions")


def test_too_few_episodes_cannot_say_and_give_the_smallest_p() -> None:
    """Three episodes of one scenario can reach 1/6 at best."""
    level, gap = np.zeros(36, dtype=int), np.arange(36.0)
    result = episode_permutation.exchange_test(level, gap, *bank(1, 3), seed=0)
    assert (result.value, result.p) == (None, None)
    assert result.detail["smallest_p"] == pytest.approx(1 / 6)
    assert "a p of 0.167 at best, above 0.01" in result.note


def test_unequal_episodes_are_cut_to_the_shortest_and_the_cut_is_told() -> None:
    """Twelve, ten and twelve steps are aligned on ten: four frames go."""
    stratum, episode, step = bank()
    kept = ~((stratum == 1) & (episode == 1) & (step >= 10))
    level, gap = nuisance_follower(np.random.default_rng(4))
    result = episode_permutation.exchange_test(level[kept], gap[kept], stratum[kept], episode[kept], step[kept], seed=0)
    used = kept & ~((stratum == 1) & (step >= 10))
    assert result.n == used.sum() == 144 - 6
    assert result.detail["truncated_frames"] == 4
    assert result.value == pytest.approx(float(level[used] @ gap[used]))


def test_a_scenario_that_cannot_be_aligned_is_left_out_by_name() -> None:
    """One episode of five steps beside two of twelve, and a scenario of a single episode."""
    stratum, episode, step = bank()
    names = np.array(["merge", "light", "dense", "blocked"])[stratum]
    kept = ~((stratum == 1) & (episode == 1) & (step >= 5)) & ~((stratum == 3) & (episode > 0))
    level, gap = nuisance_follower(np.random.default_rng(4))
    arrays = [array[kept] for array in (level, gap, names, episode, step)]
    result = episode_permutation.exchange_test(*arrays, seed=0, alpha=0.05)
    assert result.n == 72
    assert result.detail["episodes"] == [3, 3]
    assert result.note == (
        "blocked has fewer than 2 episodes; light has episodes of 5 to 12 frames, which cannot be aligned"
    )
    assert episode_permutation.exchange_test(*arrays, seed=0, alpha=0.01).value is None
    for alpha in (0.0, 1.0):
        with pytest.raises(ValueError, match=r"must lie in \(0, 1\)"):
            episode_permutation.exchange_test(*arrays, seed=0, alpha=alpha)
    with pytest.raises(ValueError, match="resamples=0 be at least 1"):
        episode_permutation.exchange_test(*arrays, seed=0, alpha=0.05, resamples=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"level": [0, -2, 0, 0]}, "level must hold"),
        ({"level": [0.5, 1, 0, 0]}, "level must hold"),
        ({"gap_rank": [1, 2, math.nan, 4]}, "rank a missing lead as the farthest"),
        ({"step": [0, 1, 2, 2]}, "step 2 occurs twice in one episode"),
        ({"episode": [0, 0, 1]}, r"lengths \[4, 4, 4, 3, 4\]"),
        ({"stratum": [None] * 4}, "stratum must hold"),
    ],
)
def test_series_that_cannot_be_exchanged_are_refused(change: dict, message: str) -> None:
    """Each error names the array at fault."""
    given_arrays = {
        "level": [0, 1, 0, 1],
        "gap_rank": [1, 2, 3, 4],
        "stratum": ["a"] * 4,
        "episode": [0, 0, 1, 1],
        "step": [0, 1, 2, 3],
    }
    with pytest.raises(ValueError, match=message):
        episode_permutation.exchange_test(**{**given_arrays, **change}, seed=0)


def test_the_iid_trend_has_the_p_of_all_permutations() -> None:
    """Six frames, 720 orders, by brute force; within strata only the orders inside them."""
    level, gap = np.array([2, 0, 1, 0, 2, 1]), np.array([1.0, 5.0, 2.0, 6.0, 3.0, 4.0])
    orders = [level @ gap[list(order)] for order in itertools.permutations(range(6))]
    expected = np.mean(np.array(orders) <= level @ gap)
    found = episode_permutation.iid_trend_test(level, gap, seed=0, resamples=20_000)
    assert found.p == pytest.approx(expected, abs=4 * math.sqrt(0.01 / 20_000))
    assert found.method == "one-sided trend, frames permuted, B=20000"
    within = episode_permutation.iid_trend_test(level, gap, ["a", "a", "b", "b", "c", "c"], seed=0, resamples=20_000)
    assert within.p == pytest.approx(1 / 8, abs=4 * math.sqrt(0.11 / 20_000))


def test_episodes_needed_reach_alpha() -> None:
    """With k episodes the smallest p is 1/k!; four scenarios of three seeds reach 1/1296."""
    assert episode_permutation.smallest_p(4) == 1 / 24
    assert episode_permutation.smallest_p([3, 3, 3, 3]) == 1 / 1296
    assert episode_permutation.smallest_p([]) == 1.0
    assert episode_permutation.episodes_needed(1) == 5
    assert episode_permutation.episodes_needed(4) == 3
    assert episode_permutation.smallest_p([400]) == 0.0
    with pytest.raises(ValueError, match="number of episodes"):
        episode_permutation.smallest_p([-1])


def test_a_sampled_p_is_never_zero() -> None:
    """With random arrangements the data count as one of them: perfect separation gives 1/(B+1), not 0."""
    episodes, steps = 12, 6
    rank = np.random.default_rng(0).permuted(np.tile(np.arange(episodes * steps, dtype=float), (1, 1)), axis=1)[0]
    level = (rank < np.median(rank)).astype(np.int64) * 2
    episode, step = np.repeat(np.arange(episodes), steps), np.tile(np.arange(steps), episodes)
    stratum = np.zeros(episodes * steps, dtype=np.int64)
    sampled = episode_permutation.exchange_test(level, rank, stratum, episode, step, seed=0, resamples=200)
    assert "B=200" in sampled.method
    assert sampled.p == pytest.approx(1 / 201)
    assert episode_permutation.exchange_mi_test(
        level, level, stratum, episode, step, seed=0, resamples=200
    ).p == pytest.approx(1 / 201)
    assert episode_permutation.iid_trend_test(level, rank, stratum, seed=0, resamples=200).p == pytest.approx(1 / 201)
