"""What score() computes from a model's answers, beside numbers worked out by hand."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import simulated
from banks import build_bank
from eyechart.calls import Reply
from eyechart.errors import BankError
from eyechart.frames import Frame
from eyechart.ledger import SentAttempt, columns_of
from eyechart.spaces.space import Decision
from eyechart.stats.statistic import Statistic
from eyechart.studies import battery
from eyechart.studies.battery.answers import Answers, answers_in
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.scores import statistics_of

HOW = Resampling(resamples=499, seed=0)
WORLD = simulated.frames()


def by_gap(condition: str, frame: Frame, rng: np.random.Generator) -> str | None:
    """Brake nearer than 30 m, refuse blanks half of the time."""
    if simulated.blind(condition):
        return None if rng.uniform() < 0.5 else "STOP"
    return "SLOW" if simulated.gap(frame) < 30 else "STRAIGHT"


@pytest.fixture(scope="module")
def scored() -> dict[str, Statistic]:
    """Return the statistics of a controller that brakes nearer than 30 m."""
    return statistics_of(simulated.answers(by_gap, WORLD), HOW)


def test_idi_is_the_disagreement_with_blank(scored: dict[str, Statistic]) -> None:
    """IDI and agree(blank) sum to one, over the same frames."""
    assert scored["idi"].value == pytest.approx(1 - scored["agree.blank"].value)
    assert scored["idi"].n == scored["agree.blank"].n == len(WORLD)


def test_idi_adj_is_the_idi_less_the_noise_floor() -> None:
    """The three rates are taken over the same frames."""

    def wavers(condition: str, frame: Frame, rng: np.random.Generator) -> str | None:
        answer = by_gap("real", frame, rng)
        return "STOP" if condition in {"blank", "real_repeat"} and rng.uniform() < 0.3 else answer

    statistics = statistics_of(simulated.answers(wavers, WORLD), HOW)
    assert statistics["noise_floor"].value > 0
    assert statistics["idi_adj"].value == pytest.approx(statistics["idi"].value - statistics["noise_floor"].value)


def test_an_unparsed_that_meets_an_unparsed_agrees() -> None:
    """As the denominators of Table t:frontier demand, at response level."""
    given = {"real": ["STOP", None, "LEFT", "SLOW"], "blank": ["STOP", None, "SLOW", "STOP"]}
    decisions = {
        name: tuple(Decision(one) if one else Decision(None, "unparsed") for one in column)
        for name, column in given.items()
    }
    statistics = statistics_of(Answers("m", WORLD[:4], simulated.DRIVING, None, decisions), HOW)
    assert statistics["agree.blank"].value == 0.5


def test_miller_madow_takes_the_first_order_bias_away() -> None:
    """MiniCPM's four bins: .0282 plug-in, .0132 corrected (paper_vectors.json, MiniCPM_MI_bits)."""
    rows = zip(WORLD, sorted([i % 4 for i in range(144)]), strict=True)
    frames = tuple(replace(frame, truth={"lead_gap_m": 10.0 + 10 * b + i / 100}) for i, (frame, b) in enumerate(rows))
    real = tuple(Decision("SLOW" if i < 142 else "STOP") for i in range(144))
    answers = Answers("m", frames, simulated.DRIVING, simulated.LEAD_GAP, {"real": real})
    found = statistics_of(answers, HOW)["mutual_information"]
    assert found.value == pytest.approx(0.0282, abs=5e-5)
    assert found.detail["miller_madow"] == pytest.approx(0.0132, abs=5e-5)


def test_unparsed_is_an_answer_at_response_level_only(scored: dict[str, Statistic]) -> None:
    """A refused blank counts in n at response level and is dropped at decision level."""
    given = simulated.answers(by_gap, WORLD).decisions["blank"]
    parsed = sum(one.action is not None for one in given if one)
    assert scored["agree.blank"].n == len(WORLD)
    assert scored["agree.blank.decision"].n == parsed < len(WORLD)


def test_the_unparsed_rate_is_over_all_calls(scored: dict[str, Statistic]) -> None:
    """The denominator is frames times the eight conditions, and the reasons are counted."""
    assert scored["unparsed_rate"].n == 8 * len(WORLD)
    assert sum(scored["unparsed_rate"].detail["reasons"].values()) == round(
        scored["unparsed_rate"].value * 8 * len(WORLD)
    )


def test_the_order_of_median_gaps_is_that_of_numpy(scored: dict[str, Statistic]) -> None:
    """Proceeding minus braking median gap, worked out by numpy."""
    gaps = np.array([simulated.gap(frame) for frame in WORLD])
    expected = np.median(gaps[gaps >= 30]) - np.median(gaps[gaps < 30])
    assert scored["gap_order"].value == pytest.approx(expected)
    low, high = scored["gap_order"].ci
    assert low < expected < high


def test_information_reaches_its_ceiling_where_the_bin_decides(scored: dict[str, Statistic]) -> None:
    """The information lies between 0 and its ceiling, with effective bin sizes that sum to n."""
    found = scored["mutual_information"]
    assert 0 < found.value <= found.detail["ceiling"] + 1e-12
    assert sum(found.detail["bin_sizes"]) == found.n == len(WORLD)


def test_every_number_has_its_n_and_is_finite(scored: dict[str, Statistic]) -> None:
    """No statistic is NaN or infinite, and none has a value without observations."""
    for name, statistic in scored.items():
        numbers = [statistic.value, statistic.p, *(statistic.ci or ())]
        assert all(number is None or math.isfinite(number) for number in numbers), name
        assert statistic.value is None or statistic.n > 0, name


def test_no_interval_claims_certainty() -> None:
    """Where all episodes are alike a share has the exact bound of so many draws, and no interval is without width."""
    statistics = statistics_of(simulated.answers(lambda *_: "SLOW", WORLD), HOW)
    assert statistics["noise_floor"].value == 0
    assert statistics["noise_floor"].ci == pytest.approx((0, 1 - 0.05 ** (1 / 12)))
    assert statistics["idi_adj"].ci == statistics["idi"].ci, "a noise floor of 0 takes nothing away"
    assert [
        name
        for name, statistic in statistics.items()
        if statistic.ci is not None and statistic.ci[0] == statistic.ci[1]
    ] == []


def test_scoring_twice_gives_the_same_numbers() -> None:
    """Every seed is derived from the run's and the test's name, so a second scoring repeats the first."""
    answered = simulated.answers(by_gap, WORLD)
    assert statistics_of(answered, HOW) == statistics_of(answered, HOW)


def test_another_seed_moves_resampled_p_only_a_little() -> None:
    """Seeds reach the permutation tests: another seed gives another p of the same size."""
    noisy = simulated.answers(lambda c, f, r: by_gap(c, f, r) if r.uniform() < 0.15 else "SLOW", WORLD)
    p = {seed: statistics_of(noisy, Resampling(499, seed))["mutual_information"].p for seed in range(6)}
    assert len(set(p.values())) > 1
    assert max(p.values()) - min(p.values()) < 0.15


def test_no_lead_counts_as_the_farthest_gap() -> None:
    """A frame without a lead is far for the obstacle test and has no infinite median."""
    world = tuple(replace(f, truth={"lead_gap_m": None}) if f.step == 0 else f for f in WORLD)
    answered = replace(simulated.answers(by_gap, WORLD), frames=world)
    statistics = statistics_of(answered, HOW)
    assert statistics["obstacle"].n == len(WORLD)
    assert math.isfinite(statistics["gap_order"].value)


def test_a_gap_that_is_no_number_names_its_frame() -> None:
    """A word in the gap column is refused with the frame's name."""
    world = (replace(WORLD[0], truth={"lead_gap_m": "far"}), *WORLD[1:])
    with pytest.raises(BankError, match="frame 's0-0-0': the gap 'lead_gap_m' is 'far'"):
        statistics_of(replace(simulated.answers(by_gap, WORLD), frames=world), HOW)


def test_declared_independence_permutes_frames() -> None:
    """With one episode a scenario the trend is tested only where the user declares independence."""
    world = simulated.frames(scenarios=2, episodes=1, steps=40)
    answered = simulated.answers(by_gap, world, counterfactuals=False)
    assert statistics_of(answered, HOW)["depth_observational"].p is None
    assert statistics_of(answered, HOW, independent=True)["depth_observational"].p < 0.01


def test_a_time_follower_with_holes_keeps_its_error_rate() -> None:
    """Missing decisions keep their place in the episode, so alignment by step survives them."""
    closing = tuple(replace(f, truth={"lead_gap_m": 60.0 - 4 * f.step}) for f in WORLD)

    def clock(condition: str, frame: Frame, rng: np.random.Generator) -> str | None:
        del condition
        return None if rng.uniform() < 0.04 else "STOP" if frame.step > 6 else "STRAIGHT"

    rejected = 0
    for seed in range(20):
        answered = simulated.answers(clock, closing, counterfactuals=False, seed=seed)
        p = statistics_of(answered, Resampling(99, seed))["depth_observational"].p
        rejected += p is not None and p < 0.01
    assert rejected <= 2


def test_a_missing_reply_is_absent_and_not_unparsed() -> None:
    """A call without a reply leaves its frame out; it is no answer of the model."""
    whole = simulated.answers(by_gap, WORLD)
    holes: tuple[Decision[str] | None, ...] = (None, *whole.decisions["blank"][1:])
    part: Answers = replace(whole, decisions={**whole.decisions, "blank": holes})
    assert statistics_of(part, HOW)["agree.blank"].n == len(WORLD) - 1


def test_a_gap_at_the_threshold_is_far() -> None:
    """The obstacle test is strict: exactly 18 m is not near."""
    world = tuple(replace(f, truth={"lead_gap_m": 18.0 if f.step % 2 else 17.999}) for f in WORLD)
    found = statistics_of(replace(simulated.answers(by_gap, WORLD), frames=world), HOW)["obstacle"]
    near = found.detail["columns"].index("near")
    assert sum(row[near] for row in found.detail["table"]) == len(WORLD) / 2


def test_a_frame_that_was_not_asked_has_no_turn(tmp_path: Path) -> None:
    """The others have the turns in which their calls were sent, whatever their order in the bank."""
    bank = build_bank(tmp_path / "bank")
    plan = battery.plan(bank.root, ["scripted:constant"], tmp_path / "run").plan
    keys = [key for key in plan.keys() if key.condition == "real"][:-1][::-1]  # noqa: SIM118 - a plan is no mapping
    sent = [SentAttempt(key, 1, None, Reply("SLOW", "stop"), f"{at:064x}", final=True) for at, key in enumerate(keys)]
    turns = dict(
        zip(
            (frame.id for frame in plan.frames),
            answers_in(columns_of(sent, plan.read), plan, "scripted:constant").sent["real"].tolist(),
            strict=True,
        )
    )
    assert turns == dict.fromkeys(turns, -1) | {key.frame: at for at, key in enumerate(keys)}
    assert list(turns.values()).count(-1) == 1
