"""The rules of the verdicts, on simulated controllers and at their boundaries."""

from dataclasses import replace

import numpy as np
import pytest

import simulated
from eyechart.frames import Frame
from eyechart.spaces.discrete import DRIVING
from eyechart.stats.paired_tests import DiscordantPairs
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.scores import statistics_of
from eyechart.verdicts import (
    ALPHA,
    LABELS,
    LATERAL,
    MARGIN,
    PAPER_LABELS,
    Evidence,
    Ruling,
    calibrated_rules,
    earns_lateral,
    lateral_rules,
    notes,
    paper_rules,
)

HOW = Resampling(resamples=999, seed=1)
WORLD = simulated.frames()


def rule_on(answered: Answers) -> tuple[Ruling, str, Ruling, Ruling]:
    """Return calibrated ruling, evidence, lateral ruling and the paper's ruling on simulated answers."""
    statistics = statistics_of(answered, HOW)
    lateral = lateral_rules(statistics, answered.directions())
    calibrated, evidence = calibrated_rules(statistics, turns=earns_lateral(statistics, lateral.label))
    holm = {name: statistics[name].p for name in ("cramers_v", "cramers_v.decision")}
    return calibrated, evidence, lateral, paper_rules(statistics, holm)


def depth(condition: str, frame: Frame, rng: np.random.Generator) -> str:
    """Brake by distance, STOP at no road."""
    del rng
    if simulated.blind(condition):
        return "STOP"
    return "STOP" if simulated.gap(frame) < 12 else "SLOW" if simulated.gap(frame) < 35 else "STRAIGHT"


def lateral_of(condition: str, frame: Frame, rng: np.random.Generator) -> str:
    """Brake by distance and turn to one side where the road is free, the other side in the reflection."""
    if depth(condition, frame, rng) != "STRAIGHT" or simulated.boxed(frame):
        return depth(condition, frame, rng)
    return "LEFT" if (frame.step % 2 == 0) != (condition == "mirrored") else "RIGHT"


def test_depth_is_found_by_intervention() -> None:
    """A graded controller is depth, by the counterfactual pair, and by the paper's rules."""
    calibrated, evidence, lateral, paper = rule_on(simulated.answers(depth, WORLD))
    assert (calibrated.label, evidence, lateral.label, paper.label) == ("depth", "controlled", "no_power", "depth")
    assert calibrated.decided_by == "order"


def test_braking_that_goes_with_distance_by_observation_is_associated() -> None:
    """Without counterfactual pictures the exchange of whole episodes decides, and it earns no authority."""
    calibrated, evidence, _, _ = rule_on(simulated.answers(depth, WORLD, counterfactuals=False))
    assert (calibrated.label, evidence) == ("depth_associated", "observational")
    assert calibrated.decided_by == "depth_observational"


def test_one_episode_a_scenario_cannot_say_whether_it_follows_the_gap() -> None:
    """With one episode nothing can be exchanged: the gap is not tested, and content remains."""
    world = simulated.frames(scenarios=2, episodes=1, steps=40)
    calibrated, evidence, _, _ = rule_on(simulated.answers(depth, world, counterfactuals=False))
    assert (calibrated.label, evidence) == ("content", "none")


def test_swaps_make_depth_lateral() -> None:
    """Exchanged directions are an axis of their own, and with depth they are depth_lateral."""
    calibrated, _, lateral, paper = rule_on(simulated.answers(lateral_of, WORLD))
    assert (calibrated.label, lateral.label, paper.label) == ("depth_lateral", "turns_clear", "depth_lateral")


def test_directions_that_ignore_the_reflection_do_not_swap() -> None:
    """The same directions on the reflected picture bound the swap rate below one half."""

    def stubborn(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        return lateral_of("real" if condition == "mirrored" else condition, frame, rng)

    _, _, lateral, _ = rule_on(simulated.answers(stubborn, WORLD))
    assert lateral.label == "does_not_swap"


def test_a_single_direction_is_one_sided() -> None:
    """LEFT as the word for a free road, as the paper's Qwen uses it, is one_sided."""

    def left(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        return depth(condition, frame, rng).replace("STRAIGHT", "LEFT")

    calibrated, _, lateral, _ = rule_on(simulated.answers(left, WORLD))
    assert (calibrated.label, lateral.label) == ("depth", "one_sided")


def test_three_directional_decisions_have_no_power() -> None:
    """A few directional decisions decide nothing, and the number needed is named."""

    def rare(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        return lateral_of(condition, frame, rng) if frame.id in {"s0-0-0", "s1-0-0", "s2-0-1"} else "SLOW"

    _, _, lateral, _ = rule_on(simulated.answers(rare, simulated.frames(seed=3)))
    assert lateral.label == "no_power"
    assert any(character.isdigit() for character in lateral.because)


def test_a_follower_of_time_is_not_depth_without_counterfactuals() -> None:
    """A controller that knows only the step number is never depth, also where gaps close in time."""
    closing = tuple(replace(f, truth={"lead_gap_m": 60.0 - 4 * f.step + 0.1 * len(f.scenario)}) for f in WORLD)

    def clock(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        del rng
        return "STOP" if frame.step > 6 and not simulated.blind(condition) else "STRAIGHT"

    calibrated, evidence, _, paper = rule_on(simulated.answers(clock, closing, counterfactuals=False))
    assert evidence == "observational"
    assert calibrated.label not in {"depth", "depth_lateral"}
    assert paper.label == "depth", "the paper's rules are expected to err here"


def test_a_coin_is_self_inconsistent_whatever_it_does_on_blanks() -> None:
    """A coin toss is self-inconsistent, with the same answer or another on blanks."""

    def coin(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        del frame
        return "STOP" if simulated.blind(condition) else DRIVING.actions[int(rng.integers(5))]

    calibrated, _, _, _ = rule_on(simulated.answers(coin, WORLD))
    assert calibrated.label == "self_inconsistent"


def test_a_near_constant_controller_is_not_self_inconsistent() -> None:
    """142 of one answer and 2 of another, repeated exactly, have a small kappa and are no coin toss."""

    def near_constant(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        del rng
        if simulated.blind(condition):
            return "STOP"
        odd = {("s0-0-0", "real"), ("s1-0-0", "real_repeat")}
        return "STRAIGHT" if (frame.id, condition) in odd else "SLOW"

    calibrated, _, _, _ = rule_on(simulated.answers(near_constant, WORLD))
    assert calibrated.label == "presence_only"


@pytest.mark.parametrize(
    ("drops", "label"),
    [((), "image_invariant"), (("blank",), "refusal_effect"), (("real", "real_repeat"), "not_scorable")],
)
def test_refusals_are_told_from_blindness(drops: tuple[str, ...], label: str) -> None:
    """A constant controller is image-invariant, a refuser of blanks a refusal effect, a silent one not scorable."""

    def constant(condition: str, frame: Frame, rng: np.random.Generator) -> str | None:
        del frame
        return None if condition in drops and rng.uniform() < 0.4 else "SLOW"

    calibrated, _, _, _ = rule_on(simulated.answers(constant, WORLD))
    assert calibrated.label == label


def test_ten_frames_decide_nothing() -> None:
    """On ten frames a constant controller is undecided, not blind, and the frames needed are named."""
    world = simulated.frames(scenarios=2, episodes=1, steps=5)
    calibrated, _, _, _ = rule_on(simulated.answers(lambda *_: "SLOW", world))
    assert calibrated.label == "undecided"
    assert "about 49 frames" in calibrated.because, calibrated.because


def test_a_few_refused_blanks_do_not_show_that_the_picture_is_not_used() -> None:
    """On ten frames one that brakes by distance and refuses blanks is no refusal effect: nothing is bounded."""

    def declines(condition: str, frame: Frame, rng: np.random.Generator) -> str | None:
        return None if simulated.blind(condition) else depth(condition, frame, rng)

    world = simulated.frames(scenarios=2, episodes=1, steps=5)
    calibrated, _, _, _ = rule_on(simulated.answers(declines, world, counterfactuals=False))
    assert calibrated.label == "undecided"


def test_a_coin_is_told_from_a_controller_that_follows_the_gap_now_and_then() -> None:
    """Without a gap a coin is self-inconsistent, and one that looks in 4 of 10 answers is hardly ever called so."""

    def coin(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        del condition, frame
        return str(rng.choice(DRIVING.actions))

    def noisy(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        return coin(condition, frame, rng) if rng.uniform() < 0.6 else depth(condition, frame, rng)

    found: dict[simulated.Rule, list[str]] = {coin: [], noisy: []}
    for rule, labels in found.items():
        for seed in range(12):
            answered = simulated.answers(rule, WORLD, counterfactuals=False, seed=seed)
            labels.append(rule_on(replace(answered, gap=None))[0].label)
    assert found[coin].count("self_inconsistent") >= 9
    assert found[noisy].count("self_inconsistent") <= 1


def test_one_scenario_leaves_another_untested_and_says_so() -> None:
    """A verdict on a single scenario notes that no picture of another one was shown."""
    whole = simulated.answers(depth, WORLD)
    part = replace(
        whole, decisions={name: decision for name, decision in whole.decisions.items() if name != "cross_scenario"}
    )
    said = []
    for answered in (whole, part):
        statistics = statistics_of(answered, Resampling(resamples=99, intervals=False))
        said.append(notes(Evidence("simulated", statistics, 0, 0, answered.counts())))
    note = "whether a picture of another scenario changes its answer was not tested"
    assert [note in one for one in said] == [False, True]


def test_paint_that_changes_the_answer_is_content() -> None:
    """A controller that reads only its own paint is content where the paint was changed, never image-invariant."""

    def paint(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        del frame, rng
        return "STOP" if condition == "recoloured" else "STRAIGHT"

    calibrated, _, _, _ = rule_on(simulated.answers(paint, WORLD))
    assert (calibrated.label, calibrated.decided_by) == ("content", "content_recoloured")


def test_a_run_without_answers_is_not_scorable() -> None:
    """No answers at all give a verdict without a claim, and no exception."""
    empty = Answers("simulated", WORLD, DRIVING, simulated.LEAD_GAP, {})
    calibrated, evidence, lateral, paper = rule_on(empty)
    assert (calibrated.label, evidence, lateral.label) == ("undecided", "none", "not_tested")
    assert "no call with the real picture" in calibrated.because
    assert paper.label == "not_scorable"


def test_a_battery_of_one_condition_claims_nothing() -> None:
    """An association over one condition is no evidence of invariance, under either set of rules."""
    whole = simulated.answers(lambda *_: "SLOW", WORLD)
    calibrated, _, _, paper = rule_on(replace(whole, decisions={"real": whole.decisions["real"]}))
    assert calibrated.label == "undecided"
    assert "real_repeat and shuffled" in calibrated.because
    assert (paper.label, paper.because) == (
        "not_scorable",
        "fewer than two conditions were asked: there is nothing to compare",
    )


def parity(condition: str, frame: Frame, rng: np.random.Generator) -> str | None:
    """Answer by a hash of the frame, and refuse non-pictures."""
    del rng
    return None if simulated.blind(condition) else ("SLOW", "STRAIGHT")[sum(map(ord, frame.id)) % 2]


@pytest.mark.parametrize("asked", [("real", "real_repeat", "blank"), simulated.CONDITIONS])
def test_a_refusal_effect_needs_bounds_on_content(asked: tuple[str, ...]) -> None:
    """A refuser of blanks whose answers follow the picture is never said not to use its camera."""
    answered = simulated.answers(parity, WORLD, counterfactuals=False)
    kept = {name: given for name, given in answered.decisions.items() if name in asked}
    calibrated, _, _, _ = rule_on(replace(answered, decisions=kept))
    assert calibrated.label == ("undecided" if len(asked) == 3 else "content")


def held(**changes: Statistic) -> dict[str, Statistic]:
    """Return the statistics of a presence-only controller with some of them replaced."""

    def presence(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        del frame, rng
        return "STOP" if simulated.blind(condition) else "SLOW"

    return {**statistics_of(simulated.answers(presence, WORLD), HOW), **changes}


def test_presence_needs_every_bound_on_content() -> None:
    """One effect of content that is not bounded leaves the verdict open, and is named."""
    assert calibrated_rules(held(), turns=False)[0].label == "presence_only"
    for name in ("bound_content_shuffled", "bound_content_recoloured", "bound_scene"):
        loose = DiscordantPairs(0.05, 144, (-0.02, 0.12), 0.03, b=10, c=3)
        ruling = calibrated_rules(held(**{name: loose}), turns=False)[0]
        assert (ruling.label, ruling.decided_by) == ("undecided", name)


def test_content_is_corrected_over_its_tests_and_holds_against_the_nudge() -> None:
    """A p of .004 in one of three tests is .012 after Holm, and no claim; .003 is one, unless the nudge undoes it."""
    weak, strong = Statistic(0.7, 50, p=0.004), Statistic(0.7, 50, p=0.003)
    assert calibrated_rules(held(content_shuffled=weak), turns=False)[0].label == "presence_only"
    assert calibrated_rules(held(content_shuffled=strong), turns=False)[0].label == "presence_only", (
        "not against nudged"
    )
    sees = held(content_shuffled=strong, content_nudged_shuffled=strong)
    assert calibrated_rules(sees, turns=False)[0].label == "content"


def test_rules_test_at_one_percent_and_bound_at_ten() -> None:
    """Alpha is .01, the margin .10, and the intervals of the calibrated tests are at 98 %."""
    assert (ALPHA, MARGIN) == (0.01, 0.10)
    found = held()
    z = 2.3263
    assert found["self_disagreement"].ci == pytest.approx((0, z**2 / (144 + z**2)), abs=1e-4)
    assert found["unparsed_reference"].ci == pytest.approx((0, z**2 / (288 + z**2)), abs=1e-4)
    assert found["bound_content_shuffled"].ci == pytest.approx((-(z**2) / (144 + z**2), z**2 / (144 + z**2)), abs=1e-4)
    assert found["bound_content_shuffled"].detail["margin"] == MARGIN
    almost = Statistic(0.7, 50, p=0.012)
    assert calibrated_rules(held(scene_cue=almost), turns=False)[0].label == "presence_only"


@pytest.mark.parametrize("missing", simulated.CONDITIONS[1:])
def test_a_missing_condition_never_breaks_the_rules(missing: str) -> None:
    """Each condition may be left out; the rules then say less and never fail."""
    whole = simulated.answers(depth, WORLD)
    part = replace(whole, decisions={name: given for name, given in whole.decisions.items() if name != missing})
    calibrated, _, _, paper = rule_on(part)
    assert calibrated.label in LABELS
    assert paper.label in PAPER_LABELS


def test_a_bank_without_gaps_says_that_the_gap_was_not_tested() -> None:
    """Without a gap and without counterfactuals there is no depth, and the evidence is none."""
    answered = replace(simulated.answers(depth, WORLD, counterfactuals=False), gap=None)
    calibrated, evidence, _, _ = rule_on(answered)
    assert (calibrated.label, evidence) == ("content", "none")


def test_every_label_has_a_sentence_and_the_paper_gives_no_other() -> None:
    """No label is without its sentence, and every label of the paper's rules is one of the calibrated ones."""
    assert all(label.says.endswith(".") for label in (*LABELS.values(), *LATERAL.values()))
    assert set(PAPER_LABELS) <= set(LABELS)


def test_a_model_that_never_refuses_has_no_refusal_effect() -> None:
    """Other models of the run cannot turn a weak dependence into a refusal effect through their correction."""
    statistics = statistics_of(simulated.answers(depth, WORLD), HOW)
    for name in ("cramers_v", "cramers_v.decision"):
        statistics[name] = replace(statistics[name], p=0.004)
    assert paper_rules(statistics, {"cramers_v": 0.04, "cramers_v.decision": 0.06}).label == "depth"


def test_the_floor_flag_is_strict() -> None:
    """IDI of exactly 1.5 s does not clear the floor."""
    statistics = statistics_of(simulated.answers(depth, WORLD), HOW)
    statistics["clears_floor"] = Statistic(0.0, 144)
    holm = {name: statistics[name].p for name in ("cramers_v", "cramers_v.decision")}
    assert paper_rules(statistics, holm).label == "self_inconsistent"
