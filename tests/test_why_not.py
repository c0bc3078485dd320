"""Every verdict says why it is no stronger one, and what was not excluded."""

import re
from dataclasses import replace

import numpy as np
import pytest

import by_hand
import drawn
import simulated
from eyechart.frames import Frame
from eyechart.gate import hold
from eyechart.spaces.space import Decision
from eyechart.stats.agreement import SwapRate
from eyechart.stats.paired_tests import BoxedTurns, DiscordantPairs, Places, pairs_to_bound
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.scores import statistics_of
from eyechart.verdicts import LABELS, Evidence, Verdict, judge_one
from eyechart.verdicts.battery_rules import frames_to_bound, turns_to_tell
from eyechart.verdicts.why_not import ANY, NOTHING

HOW = Resampling(resamples=999, seed=1, intervals=False)
WORLD = simulated.frames()


def graded(condition: str, frame: Frame, rng: np.random.Generator) -> str:
    """Brake by distance, STOP at no road."""
    del rng
    gap = simulated.gap(frame)
    return "STOP" if simulated.blind(condition) or gap < 12 else "SLOW" if gap < 35 else "STRAIGHT"


def evidence_on(answered: Answers, *, gap: bool = True) -> Evidence:
    """Return what there is to judge of simulated answers."""
    statistics = statistics_of(answered, HOW)
    holm = {name: statistics[name].p for name in ("cramers_v", "cramers_v.decision")}
    run = {"holm": holm, "directions": answered.directions(), "scenarios": 4, "gap": gap}
    return Evidence("simulated", statistics, answered.finished, answered.finished, answered.counts(), **run)


def verdict_on(rule: simulated.Rule, world: tuple[Frame, ...] = WORLD, **how: object) -> Verdict:
    """Return the verdict on a rule."""
    return judge_one(evidence_on(simulated.answers(rule, world, **how)))


def judged(found: by_hand.Found) -> Verdict:
    """Return the verdict on statistics that were written down by hand."""
    return judge_one(by_hand.evidence(found, replies=by_hand.ASKED))


def constant(condition: str, frame: Frame, rng: np.random.Generator) -> str:
    """Answer SLOW, whatever is shown."""
    del condition, frame, rng
    return "SLOW"


def presence(condition: str, frame: Frame, rng: np.random.Generator) -> str:
    """Answer SLOW to any road, STOP to anything else."""
    del frame, rng
    return "STOP" if simulated.blind(condition) else "SLOW"


def coin(condition: str, frame: Frame, rng: np.random.Generator) -> str:
    """Toss a coin of five sides."""
    del condition, frame
    return str(rng.choice(simulated.DRIVING.actions))


def mute(condition: str, frame: Frame, rng: np.random.Generator) -> str | None:
    """Hold no decision in four of ten replies."""
    return None if rng.uniform() < 0.4 else graded(condition, frame, rng)


def nearest(condition: str, frame: Frame, rng: np.random.Generator) -> str:
    """Brake for whoever is nearest."""
    gap = min(simulated.gap(frame), simulated.number(frame, "beside_m"))
    return graded(condition, replace(frame, truth={**frame.truth, "lead_gap_m": gap}), rng)


@pytest.mark.parametrize(
    ("rule", "label", "stronger", "decided_by"),
    [
        (graded, "depth", "depth_lateral", "mirror_swap_rate"),
        (nearest, "content", "depth", "specificity"),
        (coin, "self_inconsistent", "content", "content_shuffled"),
        (presence, "presence_only", "content", "content_shuffled"),
        (constant, "image_invariant", "presence_only", "presence"),
        (mute, "not_scorable", ANY, "unparsed_reference"),
    ],
)
def test_each_label_names_the_next_stronger_one_and_its_test(
    rule: simulated.Rule, label: str, stronger: str, decided_by: str
) -> None:
    """With its value, p and threshold, in text, card and JSON."""
    verdict = verdict_on(rule)
    why = verdict.why_not
    assert verdict.calibrated.label == label
    assert (why.label, why.decided_by) == (stronger, decided_by)
    assert why.label in {*LABELS, ANY}
    assert why.needs
    said = verdict.as_dict()["why_not"]
    assert (said["label"], said["needs"], said["settle"]) == (stronger, why.needs, why.settle)
    assert (said["value"], said["p"]) == (why.statistic.value, why.statistic.p)
    assert f"not {stronger}: {decided_by}" in verdict.text()
    assert f"what would settle it: {why.settle}" in verdict.text()
    assert "why not more" in verdict._repr_html_()


def test_where_a_condition_is_missing_it_is_named_and_no_frames_are() -> None:
    """Without controls, and without counterfactual pictures, what is missing are pictures."""
    verdict = verdict_on(graded, controls=())
    assert verdict.calibrated.label == "depth_associated"
    assert set(verdict.why_not.conditions) == set(simulated.RANGED)
    assert (verdict.why_not.frames, verdict.why_not.episodes) == (None, None)
    assert "before 0.2.0 this evidence was called depth" in verdict.text()
    observed = verdict_on(graded, counterfactuals=False)
    assert observed.calibrated.label == "depth_associated"
    assert {"lead_near", "exchange_own", "lead_near_nudged"} <= set(observed.why_not.conditions)
    for one in (verdict, observed):
        assert "frames" not in one.why_not.settle


def test_content_that_could_not_be_asked_of_distance_names_pictures_and_episodes() -> None:
    """One episode a scenario, and no counterfactual pictures: either would settle it."""
    world = simulated.frames(scenarios=2, episodes=1, steps=40)
    verdict = verdict_on(graded, world, counterfactuals=False)
    assert (verdict.calibrated.label, verdict.why_not.label) == ("content", "depth_associated")
    assert verdict.why_not.conditions == ("lead_near", "lead_far")
    assert verdict.why_not.episodes == 4 or verdict.why_not.episodes > 1


def test_a_bank_that_lacks_the_pictures_is_told_so_and_what_they_show() -> None:
    """Not that they were not asked: nothing that is asked of this bank would settle it."""
    given = evidence_on(simulated.answers(graded, WORLD, controls=simulated.OLDER))
    lacks = replace(given, absent=tuple(name for name in simulated.RANGED if name != "lead_near_nudged"))
    why = judge_one(lacks).why_not
    assert why.settle.startswith("pictures that the bank lacks: 'eyechart frames build --add-to BANK' draws them")
    assert "exchange_beside: the one beside the path there, the lead far" in why.settle
    assert "not asked" not in why.settle
    odd = judge_one(replace(lacks, bank="a; b")).why_not
    way = "pictures that the bank lacks: 'eyechart frames build --add-to 'a; b'' draws them of a simulator's world"
    assert odd.first == f"{way}, then resume the run"
    check = hold(Run(lacks), ["depth"])
    assert check.exit_code == 2
    assert "not tested beyond 7 m" in check.checks[0].because
    command = "eyechart frames build --add-to"
    assert f"'{command} BANK' draws them of a simulator's world, then resume the run" in check.checks[0].because
    for bank, word in (("/home/a/bank", "/home/a/bank"), ("/home/a/my bank", "'/home/a/my bank'")):
        known = hold(Run(replace(lacks, bank=bank)), ["depth"])
        assert f"'{command} {word}' draws" in known.checks[0].because
    observed = evidence_on(simulated.answers(graded, WORLD, counterfactuals=False))
    moved = judge_one(replace(observed, absent=("lead_near", "lead_far"))).why_not
    assert "lead_near: the lead near" in moved.settle


@pytest.mark.parametrize("share", [0.03, 0.06, 0.12])
def test_no_fewer_frames_are_named_than_there_are(share: float) -> None:
    """Of who reacts now and then to one picture: 144 frames decided nothing, so that more are needed than these."""

    def rule(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        del frame
        return "STOP" if condition in {"noise", "shuffled"} and rng.uniform() < share else "SLOW"

    for seed in range(2):
        answered = simulated.answers(rule, WORLD, seed=seed)
        why = judge_one(evidence_on(answered)).why_not
        assert why.frames is None or why.frames > len(WORLD)
    statistic = Statistic(0.05, 144, (-0.02, 0.12), 0.9)
    assert frames_to_bound(statistic, 0.05) == (283, "if the rest are like these")
    assert frames_to_bound(replace(statistic, n=20), 0.05) == (25, "if there is none")
    assert frames_to_bound(replace(statistic, value=0.1, ci=(-0.01, 0.21)), 0.05) == (175, "if the rest are like these")
    assert frames_to_bound(replace(statistic, ci=(0.01, 0.09)), 0.05) is None
    assert frames_to_bound(replace(statistic, ci=(0.0, 0.09)), 0.05) is not None
    assert frames_to_bound(replace(statistic, ci=None), 0.05) is None
    assert frames_to_bound(replace(statistic, value=None), 0.05) is None
    differs = DiscordantPairs(0.0, 20, (-0.2, 0.2), 0.9, b=2, c=2)
    assert frames_to_bound(differs, 0.05) == (pairs_to_bound(0.2, margin=0.1, alpha=0.05), "if there is none")
    one_pair = DiscordantPairs(0.0, 1, (-1.0, 1.0), 0.9, b=1, c=0)
    assert frames_to_bound(one_pair, 0.05)[0] == pairs_to_bound(0.9, margin=0.1, alpha=0.05)
    assert frames_to_bound(replace(differs, b=10, c=10), 0.01)[0] == pairs_to_bound(0.9, margin=0.1, alpha=0.01)


@pytest.mark.parametrize(
    ("value", "ends", "n", "need"),
    [
        (0.02, (-0.06, 0.12), 144, 225),  # until the upper end is at the margin
        (0.08, (-0.04, 0.20), 144, 324),  # until the lower end is at 0, which is sooner
        (0.0, (-0.12, 0.12), 144, 208),
        (0.1, (-0.03, 0.23), 144, 244),
        (0.02, (-0.05, 0.09), 144, 145),
        (0.0, (-0.09, 0.09), 25, 26),
    ],
)
def test_as_many_frames_are_named_as_bring_an_end_to_the_margin_or_to_nothing(
    value: float, ends: tuple[float, float], n: int, need: int
) -> None:
    """An interval shrinks with the root of the frames; never fewer are named than there are, and one more."""
    assert frames_to_bound(Statistic(value, n, ends, 0.9), 0.05) == (need, "if the rest are like these")


@pytest.mark.parametrize(
    ("rate", "n", "need"), [(0.9, 111, 112), (0.9, 112, 113), (0.9, 400, 401), (0.55, 400, 1007), (0.51, 400, None)]
)
def test_more_turns_are_named_than_there_are(rate: float, n: int, need: int | None) -> None:
    """Of a rate of .65 112 turns tell; from there on those that tell the rate that there is, and one more at least."""
    assert turns_to_tell(SwapRate(rate, n, (0.0, 1.0), 0.5, chance=0.5)) == need


@pytest.mark.parametrize(
    ("tested", "need"),
    [
        (by_hand.signs(30, 16, 98, 0.03), 335),
        (by_hand.signs(40, 16, 88, 0.02), 157),  # 139 at .01, and there are 144: at half of it, for Holm
        (by_hand.signs(42, 14, 88, 0.02), 150),  # and at a quarter of it
        (by_hand.signs(30, 10, 0, 0.02), 44),  # 40 at .01, as many as there are
        (by_hand.signs(51, 49, 44, 0.5), None),
        (by_hand.signs(52, 48, 44, 0.4), 9064),
        (by_hand.signs(0, 30, 100, 1.0), None),
        (by_hand.p(0.02), None),
    ],
)
def test_a_test_of_signs_names_the_frames_that_its_share_would_take(tested: Statistic, need: int | None) -> None:
    """More than there are, at the level to which its rule corrects it; none near one half."""
    found = by_hand.blind(content_shuffled=by_hand.p(by_hand.LOW), depth_interventional=tested)
    why = judge_one(by_hand.evidence(found)).why_not
    assert (why.label, why.decided_by, why.frames) == ("depth", "depth_interventional", need)
    assert why.settle.startswith("nothing on frames like these" if need is None else f"about {need} frames, if")


def test_a_shard_that_leaves_its_controls_to_the_merged_run_is_never_finished() -> None:
    """All of its calls are answered, and it says what is still to be done."""
    given = evidence_on(simulated.answers(graded, WORLD, controls=()))
    whole, part = judge_one(given), judge_one(replace(given, part=True))
    assert whole.unfinished is None
    assert part.state.startswith("unfinished")
    assert "merge the shards, and resume the merged run" in part.notes[0]


@pytest.mark.parametrize(
    ("label", "asked"), [("depth_associated", True), ("content", True), ("depth_associated", False)]
)
def test_what_was_called_depth_before_is_said_so(label: str, *, asked: bool) -> None:
    """Of evidence by the moved lead, by who is nearest, and by the gaps that frames have; of no other label."""
    rule = nearest if label == "content" else graded
    controls = simulated.RANGED if label == "content" else ()
    verdict = verdict_on(rule, controls=controls, counterfactuals=asked)
    assert verdict.calibrated.label == label
    assert sum(note.startswith("before 0.2.0 this evidence was called depth") for note in verdict.notes) == 1
    for other in (graded, constant, presence):
        assert "before 0.2.0" not in verdict_on(other).text()


def test_frames_are_named_where_they_would_settle_it() -> None:
    """Ten frames of a constant controller: about 49, were there no effect; a shown effect needs none."""
    world = simulated.frames(scenarios=2, episodes=1, steps=5)
    verdict = verdict_on(constant, world)
    assert verdict.calibrated.label == "undecided"
    assert (verdict.why_not.label, verdict.why_not.frames) == ("image_invariant", 49)
    reacts = verdict_on(lambda condition, *_: "STOP" if condition == "noise" else "SLOW")
    assert (reacts.why_not.decided_by, reacts.why_not.frames) == ("bound_noise", None)
    assert "the effect is there" in reacts.why_not.settle


def test_too_few_frames_for_an_effect_that_is_seen_are_counted() -> None:
    """On twelve frames a follower of whoever is near now and then has a share above one half, and a number."""

    def weak(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        return graded(condition, frame, rng) if rng.uniform() < 0.5 else coin(condition, frame, rng)

    verdict = verdict_on(weak, simulated.frames(scenarios=2, episodes=1, steps=8))
    tested = verdict.why_not.statistic
    if verdict.why_not.frames is not None:
        assert verdict.why_not.frames > tested.n
    assert verdict.calibrated.label not in {"depth", "depth_lateral"}


def test_an_effect_of_a_hair_asks_for_no_million_of_frames() -> None:
    """One pair more won than lost, and many pairs: nothing on frames like these would settle it."""
    half = {frame.id for frame in WORLD[: len(WORLD) // 2 + 1]}

    def hair(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        del rng
        if condition in {"lead_near", "lead_far"}:
            return "STOP" if (condition == "lead_near") == (frame.id in half) else "SLOW"
        return "STOP" if condition == "shuffled" else "STRAIGHT"

    verdict = verdict_on(hair)
    assert (verdict.calibrated.label, verdict.why_not.decided_by) == ("content", "depth_interventional")
    assert (verdict.why_not.frames, "nothing" in verdict.why_not.settle) == (None, True)


def test_whoever_turns_to_the_blocked_side_is_told_so_on_the_card() -> None:
    """Its lateral label stays swaps; the sentence of trust, the notes and why_not speak of the side."""

    def wrong(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        action = graded(condition, frame, rng)
        left = (frame.truth["left_clear"] is True) == (condition == "mirrored")
        return action if action != "STRAIGHT" else "LEFT" if left else "RIGHT"

    verdict = verdict_on(wrong)
    assert (verdict.calibrated.label, verdict.lateral.label) == ("depth", "swaps")
    assert re.search(r"Beware: (\d+) of its \1 turns with one clear side go to the blocked side\.$", verdict.trust)
    assert (verdict.why_not.label, verdict.why_not.decided_by) == ("depth_lateral", "turns_against")
    assert any(note.startswith("it turns to the blocked side") for note in verdict.notes)
    assert "follow the side" not in verdict.text()


def _often_right(condition: str, frame: Frame, rng: np.random.Generator) -> str:
    """Turn to the clear side, and on three frames of ten to the other."""
    action = graded(condition, frame, rng)
    wrong = float(str(frame.truth["phase"])) < 0.3
    left = ((frame.truth["left_clear"] is True) != (condition == "mirrored")) != wrong
    return action if action != "STRAIGHT" else "LEFT" if left else "RIGHT"


def test_whoever_turns_to_the_blocked_side_now_and_then_is_told_so_on_the_card() -> None:
    """On three frames of ten: most turns go to the clear side, and the first sentences warn of the others."""
    world = simulated.frames(steps=48)
    verdict = verdict_on(_often_right, world)
    assert (verdict.lateral.label, verdict.lateral.decided_by) == ("swaps", "turns_against")
    wrong, turns = (int(number) for number in re.findall(r"\d+", verdict.trust.partition("Beware: ")[2]))
    assert 0.2 < wrong / turns < 0.4
    assert verdict.trust.endswith("turns with one clear side go to the blocked side.")
    assert (verdict.why_not.label, verdict.why_not.decided_by) == ("depth_lateral", "turns_against")


def test_turns_that_are_shown_wrong_are_not_mended_by_more_frames() -> None:
    """Somewhat more than half go to the clear side: more frames would show that, and the others remain."""
    given = evidence_on(simulated.answers(_often_right, WORLD))
    assert given.statistics["turns_clear"].value > 0.5
    assert given.statistics["turns_clear"].p > 0.01
    why = judge_one(given).why_not
    assert (why.label, why.decided_by, why.frames) == ("depth_lateral", "turns_against", None)
    assert why.settle == NOTHING


def test_whoever_knows_real_pictures_and_not_moved_leads_is_told_of_the_moved_leads() -> None:
    """Its braking goes with the gaps of true pictures; what keeps depth from it is no cache that was never seen."""

    def remembered(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        moved = {*simulated.COUNTERFACTUALS, *simulated.RANGED}
        return "SLOW" if condition in moved else graded(condition, frame, rng)

    given = evidence_on(simulated.answers(remembered, WORLD))
    assert given.statistics["depth_observational"].p < 0.01
    why = judge_one(given).why_not
    assert (why.label, why.decided_by, why.needs) == ("depth", "depth_interventional", "p below 0.01")
    assert "cache" not in why.settle


def test_a_gate_that_fails_for_a_bound_says_which() -> None:
    """Who follows the next vehicle alone changes with the picture, and never with the lead."""

    def beside(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        truth = {**frame.truth, "lead_gap_m": frame.truth["beside_m"]}
        return graded(condition, replace(frame, truth=truth), rng)

    held = hold(Run(evidence_on(simulated.answers(beside, WORLD))), ["depth"]).checks[0]
    assert held.holds is False
    assert "it brakes harder for the near lead in 0 of 144 pairs, at most 0.03" in held.because


def test_pictures_that_hold_no_decision_are_not_said_to_be_missing() -> None:
    """The bank shows the lead near and far, and was asked: neither more episodes nor other pictures would help."""

    def silent(condition: str, frame: Frame, rng: np.random.Generator) -> str | None:
        del condition, frame, rng

    text = verdict_on(silent).text()
    assert "decisions on real, lead_near, lead_far would test it" in text
    assert "counterfactual pictures" not in text


def test_turns_where_no_side_is_clear_are_counted_and_said() -> None:
    """They are in no test of the clear side, so that a reader of the verdict must be told of them."""
    world = tuple(
        replace(frame, truth={**frame.truth, "left_clear": False, "right_clear": False}) if number < 10 else frame
        for number, frame in enumerate(WORLD)
    )

    def turning(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        del rng
        if simulated.blind(condition):
            return "STOP"
        return "LEFT" if (frame.truth["left_clear"] is True) != (condition == "mirrored") else "RIGHT"

    given = evidence_on(simulated.answers(turning, world))
    boxed = given.statistics["turns_boxed"]
    assert isinstance(boxed, BoxedTurns)
    assert boxed.value == 0.5
    note = f"it turns where no side is clear: {boxed.n} of {boxed.n} answers"
    assert note in judge_one(given).notes
    assert "no side is clear" not in verdict_on(graded).text()


class Run:
    """A scored run of one model."""

    def __init__(self, evidence: Evidence) -> None:
        self._evidence = evidence

    def evidence(self) -> dict[str, Evidence]:
        """Return what there is to judge."""
        return {"simulated": self._evidence}


@pytest.mark.parametrize(
    ("steps", "controls", "holds", "says"),
    [
        (12, simulated.RANGED, True, "of 100 comparisons the wrong way round"),
        (3, simulated.RANGED, None, "a window a factor of 1.2 wide holds 5.3 drawn distances"),
        (12, (), None, "pictures that were not asked: lead_near_nudged"),
        (12, simulated.OLDER, None, "not tested beyond 7 m"),
    ],
)
def test_a_gate_is_met_by_enough_pictures_along_the_range_alone(
    steps: int, controls: tuple[str, ...], *, holds: bool | None, says: str
) -> None:
    """At 36 frames a hole would not be seen; without these pictures, or with older ones, the gate cannot say."""
    answered = simulated.answers(graded, simulated.frames(steps=steps), controls=controls)
    check = hold(Run(evidence_on(answered)), ["depth"]).checks[0]
    assert (check.holds, says in check.because) == (holds, True), check.because


def test_exchange_alone_does_not_meet_turns_to_the_clear_side() -> None:
    """The gate cannot say of swaps whether turns are clear; turns_clear meets both requirements."""

    def turning(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        action = graded(condition, frame, rng)
        left = (frame.truth["left_clear"] is True) != (condition == "mirrored")
        return action if action != "STRAIGHT" or simulated.boxed(frame) else "LEFT" if left else "RIGHT"

    whole = simulated.answers(turning, WORLD)
    bare = tuple(
        replace(frame, truth={name: kept for name, kept in frame.truth.items() if not name.endswith("_clear")})
        for frame in whole.frames
    )
    for answered, found in ((whole, [True, True, True]), (replace(whole, frames=bare), [True, None, None])):
        checks = hold(Run(evidence_on(answered)), ["swaps", "turns_clear", "depth_lateral"]).checks
        assert [check.holds for check in checks] == found


def test_whoever_follows_the_file_is_told_that_no_frames_settle_it() -> None:
    """No bound below a margin is asked of it, and no frames: each picture wants an answer of its own."""
    why = judged(by_hand.reader(file=Statistic(1.0, 144, p=0.0001))).why_not
    assert (why.label, why.decided_by, why.frames) == ("depth_associated", "file", None)
    assert why.needs == "p of 0.001 at least"
    assert why.settle == "an answer to each picture of its own: no cache, and no memory of files"


def test_so_many_frames_are_named_as_fill_the_windows_of_the_range() -> None:
    """48 frames show 96 drawn distances, which are no frames; as many as are named do."""
    why = verdict_on(graded, simulated.frames(scenarios=4, episodes=4, steps=3)).why_not
    assert (why.label, why.decided_by, why.statistic.n) == ("depth", "drawn_distances", 96)
    assert why.settle == f"about {why.frames} frames, if the rest are like these 48"
    assert 48 < why.frames < 96
    empty = replace(by_hand.reader()["drawn_distances"], fewest=0)
    none = judged(by_hand.reader(drawn_distances=empty)).why_not
    assert (none.frames, none.settle) == (None, "more than these 144 frames: a window holds none")


def test_where_a_hole_is_the_reason_partial_depth_is_named_at_best() -> None:
    """More frames may show the rest, and leave the place as it is; a place that is open besides is no reason."""
    open_place = Places(1.0, 144, note="in `light`", places=())
    changed = {"holes": Places(1.0, 144, places=(drawn.HOLE,)), "place_open": open_place}
    verdict = judged(by_hand.reader(**changed, order=Statistic(0.05, 144, (0.0, 0.4))))
    why = verdict.why_not
    assert (verdict.calibrated.label, why.label, why.decided_by) == ("depth_associated", "partial_depth", "order")
    assert why.settle.startswith("more frames, in more episodes")
    assert why.settle.endswith("that is partial_depth at best, for its braking hardly answers in `blocked`: 0 of 36")
    file = judged(by_hand.reader(**changed, file=by_hand.SILENT)).why_not
    assert (file.label, file.decided_by) == ("partial_depth", "file")


def test_places_that_were_not_tested_are_said_to_be() -> None:
    """All else holds, so that nothing else keeps it from depth."""
    verdict = judged(by_hand.reader(holes=by_hand.SILENT))
    assert verdict.calibrated.label == "depth_associated"
    assert (verdict.why_not.label, verdict.why_not.decided_by) == ("depth", "holes")
    assert verdict.why_not.needs == "an effect in every place"


def test_a_number_that_is_refuted_names_what_depth_needs_of_it() -> None:
    """Not what would just not refute it: of that the rule has two ways, of which one shows nothing."""
    why = judged(by_hand.reader(order=Statistic(0.3, 144, (0.2, 0.4)))).why_not
    assert (why.label, why.decided_by, why.needs) == ("depth", "order", "upper end < 0.15")
    kind = judged(by_hand.reader(order_near_far=Statistic(0.3, 144, (0.2, 0.4)))).why_not
    assert "else named" not in kind.needs
    assert " or " in kind.needs


def test_a_command_of_a_simulator_is_named_to_rendered_pictures_alone() -> None:
    """Nothing is drawn of photographs: each moment has to be taken again."""
    given = replace(evidence_on(simulated.answers(graded, WORLD, controls=())), absent=simulated.RANGED)
    assert "eyechart frames build" in judge_one(given).why_not.first
    for made in ("staged", "edited", ""):
        why = judge_one(replace(given, made=made)).why_not
        assert why.first.startswith("pictures that the bank lacks: of photographs, each moment again (lead_drawn: ")
        assert "eyechart" not in why.settle


def test_a_verdict_s_json_says_what_is_not_excluded() -> None:
    """The sentence that names it stands beside it."""
    found = by_hand.reader(order_near_far=Statistic(0.05, 144, (0.0, 0.26)))
    verdict = judged(found)
    assert verdict.as_dict()["open_to"] == ["that comparisons of near and far distances come out the wrong way round"]
    assert "What is named as not excluded stays open." in verdict.as_dict()["trust"]
    assert judged(by_hand.reader()).as_dict()["open_to"] == []


def test_a_reader_that_declines_edited_pictures_is_told_that_it_does() -> None:
    """It ends at depth_associated, and what would settle it are decisions, not frames."""
    whole = simulated.answers(graded, WORLD)
    lost = (Decision(None, "refused"),) * 50
    decisions = {
        name: (*lost, *decision[50:]) if name == "exchange_beside" else decision
        for name, decision in whole.decisions.items()
    }
    why = judge_one(evidence_on(replace(whole, decisions=decisions))).why_not
    assert (why.label, why.decided_by, why.frames) == ("depth", "unparsed_controls", None)
    assert "declines" in why.settle


def test_a_reader_that_declines_both_moved_pictures_is_told_to_decide_on_them() -> None:
    """They were asked; other pictures that were not would settle nothing."""
    whole = simulated.answers(graded, WORLD)
    none = (Decision(None, "refused"),) * len(WORLD)
    decisions = {name: decision for name, decision in whole.decisions.items() if name not in simulated.RANGED}
    moved = replace(whole, decisions=decisions | {"lead_near": none, "lead_far": none})
    why = judge_one(evidence_on(moved)).why_not
    assert (why.label, why.decided_by, why.conditions) == ("depth", "depth_interventional", ())
    assert why.settle.startswith("decisions on lead_near, lead_far")


def layout(condition: str, frame: Frame, rng: np.random.Generator) -> str:
    """Brake by whoever is nearest, in whichever lane, STOP at no road."""
    del rng
    gap = min(simulated.gap(frame), simulated.number(frame, "beside_m"))
    return "STOP" if simulated.blind(condition) or gap < 12 else "SLOW" if gap < 35 else "STRAIGHT"


def zigzag(condition: str, frame: Frame, rng: np.random.Generator) -> str:
    """Go on between the two distances that are compared, SLOW farther away, STOP at no road."""
    right, gap = graded(condition, frame, rng), simulated.gap(frame)
    return "STRAIGHT" if not simulated.blind(condition) and 9 < gap < 20 else right


def few(condition: str, frame: Frame, rng: np.random.Generator) -> str:
    """Brake by distance in two of twelve episodes."""
    return graded(condition, frame, rng) if frame.episode in {"s0-0", "s2-0"} else "SLOW"


def test_a_gate_fails_where_a_control_says_no_and_cannot_say_where_none_does() -> None:
    """A reversal, an effect of the exchange that is bounded, or a place in which nothing answers is an answer."""
    for rule, wanted in ((layout, False), (zigzag, False), (few, False), (graded, True)):
        answered = simulated.answers(rule, WORLD)
        assert hold(Run(evidence_on(answered)), ["depth"]).checks[0].holds is wanted
