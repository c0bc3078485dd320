"""Stopping early: what settles, what does not, and that neither time nor chance of arrival has a say in it."""

import itertools
import random
from collections.abc import Mapping
from dataclasses import replace

import pytest

import simulated
from eyechart.frames import LEAD_GAP, Frame
from eyechart.spaces.discrete import DRIVING, Discrete
from eyechart.spaces.space import Decision
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.early_stop import QuestionOrder, StoppingState, WholeRun, layout_of, typical
from eyechart.studies.battery.evidence import FrameAnswers, claims, fewest_turns
from eyechart.verdicts import LABELS, LATERAL, StoppingPoint

Given = dict[tuple[str, str], Decision[str]]
FRAMES = simulated.frames()
FIRST = (*simulated.CONDITIONS, *simulated.COUNTERFACTUALS)
ALL = (*FIRST, *simulated.RANGED, *simulated.ALWAYS)


def layout(conditions: tuple[str, ...] = ALL, *, frames: tuple[Frame, ...] = FRAMES, seed: int = 0) -> QuestionOrder:
    """Return the layout of a run that asks every condition of every frame."""
    return layout_of(frames, {frame.id: conditions for frame in frames}, DRIVING, seed)


def given(answers: Answers) -> Given:
    """Return a simulated controller's answers as a run's finished calls."""
    return {
        (frame.id, name): one
        for name, column in answers.decisions.items()
        for frame, one in zip(answers.frames, column, strict=True)
        if one is not None
    }


def settle(rule: simulated.Rule, conditions: tuple[str, ...] = ALL, *, seed: int = 0) -> StoppingPoint | None:
    """Return where a simulated controller is settled."""
    course, counterfactuals = StoppingState(layout(conditions, seed=seed)), "lead_near" in conditions
    calls = given(simulated.answers(rule, FRAMES, counterfactuals=counterfactuals, seed=seed))
    course.advance(calls)
    return course.stopped(len(course.counted))


def depth(condition: str, frame: Frame, rng: object) -> str:
    """Brake by distance."""
    del rng
    gap = simulated.gap(frame)
    return "STOP" if simulated.blind(condition) or gap < 12 else "SLOW" if gap < 35 else "STRAIGHT"


def presence(condition: str, frame: Frame, rng: object) -> str:
    """Tell a road from what is none."""
    del frame, rng
    return "STOP" if simulated.blind(condition) else "SLOW"


def constant(condition: str, frame: Frame, rng: object) -> str:
    """Answer SLOW."""
    del condition, frame, rng
    return "SLOW"


def refusing(condition: str, frame: Frame, rng: object) -> str | None:
    """Answer SLOW, and nothing to a blank."""
    del frame, rng
    return None if condition == "blank" else "SLOW"


def cut(condition: str, frame: Frame, rng: object) -> str | None:
    """Lose every third answer."""
    del condition, frame
    return None if rng.random() < 1 / 3 else "SLOW"  # type: ignore[attr-defined]


EARLY = {name: label.early for name, label in LABELS.items() if label.early}
CLEAR = {
    "not_scorable": cut,
    "depth": depth,
    "depth_associated": depth,
    "presence_only": presence,
    "refusal_effect": refusing,
    "image_invariant": constant,
}


@pytest.mark.parametrize("label", EARLY)
def test_a_clear_controller_is_settled_with_half_of_its_calls_saved(label: str) -> None:
    """Every label that can be settled early is, by the claim that it rests on; of depth a third is saved."""
    stopped = settle(CLEAR[label], FIRST if label == "depth_associated" else ALL)
    assert stopped is not None
    assert (stopped.label, stopped.lateral) == (label, "no_power")
    assert stopped.decided_by == ("depth_interventional" if label == "depth" else f"early.{EARLY[label][0]}")
    assert stopped.calls <= stopped.planned * (2 / 3 if label == "depth" else 1 / 2)
    assert stopped.interventional


def test_following_the_gap_by_observation_never_stops_a_run() -> None:
    """Without counterfactual pictures a follower of distance is asked to the end, and so is one that follows half."""
    assert settle(depth, simulated.CONDITIONS) is None
    assert settle(presence, simulated.CONDITIONS) is not None


def test_a_depth_is_settled_by_the_true_pictures_at_their_gaps_too() -> None:
    """A model that follows moved leads alone, and is the wrong way round on true pictures, is asked to the end."""

    def moved_alone(condition: str, frame: Frame, rng: object) -> str:
        seen = depth(condition, frame, rng)
        true = condition in {"real", "real_repeat"}
        return {"STOP": "STRAIGHT", "STRAIGHT": "STOP"}.get(seen, seen) if true else seen

    for rule, without, gapped in ((depth, "depth", "depth"), (moved_alone, "depth", None)):
        calls = given(simulated.answers(rule, FRAMES))
        for whole, label in ((WholeRun(), without), (WholeRun(LEAD_GAP), gapped)):
            course = StoppingState(replace(layout(), whole=whole))
            course.advance(calls)
            stopped = course.stopped(len(course.counted))
            assert (stopped and stopped.label) == label, (rule, whole)


def test_turns_are_settled_too() -> None:
    """Turns to one side are ``one_sided``, turns that stay ``does_not_swap``; exchanged ones go on to the end."""

    def turning(condition: str, frame: Frame, rng: object) -> str:
        seen = depth(condition, frame, rng)
        if seen != "STRAIGHT":
            return seen
        side = "LEFT" if float(str(frame.truth["phase"])) < 0.5 else "RIGHT"
        return DRIVING.reflect(side) if condition == "mirrored" else side

    def left(condition: str, frame: Frame, rng: object) -> str:
        seen = depth(condition, frame, rng)
        return "LEFT" if seen == "STRAIGHT" else seen

    def staying(condition: str, frame: Frame, rng: object) -> str:
        return (
            DRIVING.reflect(turning(condition, frame, rng))
            if condition == "mirrored"
            else turning(condition, frame, rng)
        )

    found = [settle(rule) for rule in (turning, left, staying)]
    assert [one and (one.label, one.lateral) for one in found] == [
        ("depth", None),
        ("depth", "one_sided"),
        ("depth", "does_not_swap"),
    ]


def test_a_coin_is_asked_to_the_end() -> None:
    """It is not steady, so that no absence is claimed of it, and ``self_inconsistent`` needs the whole run."""

    def coin(condition: str, frame: Frame, rng: object) -> str:
        del frame
        if simulated.blind(condition):
            return "STOP"
        return str(rng.choice(DRIVING.actions))  # type: ignore[attr-defined]

    assert settle(coin) is None


@pytest.mark.parametrize("label", CLEAR)
def test_the_order_of_arrival_has_no_say(label: str) -> None:
    """Calls that come in any order, some of them beyond the stop, settle the same verdict with the same calls."""
    calls = given(simulated.answers(CLEAR[label], FRAMES))
    whole = StoppingState(layout())
    whole.advance(calls)
    arriving = list(calls)
    random.Random(3).shuffle(arriving)  # noqa: S311 - no secret
    course, so_far = StoppingState(layout()), {}
    for place, key in enumerate(arriving):
        so_far[key] = calls[key]
        if place % 7 == 0:
            course.advance(so_far)
    course.advance(so_far)
    assert course.counted == whole.counted
    assert course.statistics() == whole.statistics()
    assert course.stopped(len(course.counted)) == whole.stopped(len(whole.counted))
    late = course.stopped(len(calls))
    assert late is not None
    assert late.beyond == len(calls) - len(course.counted)


def layout_follower(condition: str, frame: Frame, rng: object) -> str:
    """Brake by whoever is nearer, in whichever lane."""
    del rng
    nearest = min(simulated.gap(frame), simulated.number(frame, "beside_m"))
    return "STOP" if simulated.blind(condition) or nearest < 20 else "STRAIGHT"


def zigzag(condition: str, frame: Frame, rng: object) -> str:
    """Brake near, go on a little farther, and brake again: the wrong way round where it drives."""
    del rng
    gap = simulated.gap(frame)
    return "STOP" if simulated.blind(condition) or gap < 9.5 or 20 < gap < 48 else "STRAIGHT"


def cached(condition: str, frame: Frame, rng: object) -> str:
    """Brake by distance, and toss a coin for a file that it does not know."""
    seen = depth(condition, frame, rng)
    return str(rng.choice(("STOP", "STRAIGHT"))) if "_nudged" in condition else seen  # type: ignore[attr-defined]


def band(condition: str, frame: Frame, rng: object) -> str:
    """Grade, but go on from 25 to 38 m: no frame shows that within itself."""
    del rng
    gap = simulated.gap(frame)
    if simulated.blind(condition) or gap < 12:
        return "STOP"
    return "STRAIGHT" if 25 <= gap < 38 or gap > 48 else "SLOW"


def exchanged(condition: str, frame: Frame, rng: object) -> str:
    """Brake by distance, but for the neighbour rather than the lead on 35 % of the frames."""
    del rng
    wrong = float(str(frame.truth["phase"])) < 0.35 and condition.startswith("exchange_")
    near = simulated.blind(condition) or simulated.gap(frame) < 20
    return "STOP" if near is not wrong else "STRAIGHT"


def any_lead(condition: str, frame: Frame, rng: object) -> str:
    """Stop wherever there is a lead, however far."""
    del frame, rng
    return "STRAIGHT" if condition == "lead_absent" else "STOP"


def test_an_absence_is_not_settled_before_a_picture_without_the_lead() -> None:
    """Who answers by whether there is any lead gives one answer where every frame has one."""
    course = StoppingState(layout())
    course.advance(given(simulated.answers(any_lead, FRAMES)))
    assert course.label == "image_invariant"
    assert course.is_exhausted
    assert settle(any_lead, FIRST) is not None, "without that picture nothing tells it"


@pytest.mark.parametrize("rule", [layout_follower, zigzag, cached, band, exchanged])
def test_distance_is_not_settled_before_its_controls(rule: simulated.Rule) -> None:
    """Who brakes for whoever is near, the wrong way round, or by the file, has near over far and no early verdict."""
    course = StoppingState(layout())
    course.advance(given(simulated.answers(rule, FRAMES)))
    assert course.claims["near_far"].is_settled
    assert course.label == "depth"
    assert course.is_exhausted
    assert course.stopped(len(course.counted)) is None
    assert course.wanted(course.layout.order[-1]) == FIRST


def test_the_walk_over_the_controls_of_depth_asks_all_frames() -> None:
    """What the rules of depth read is asked of all frames, and nothing else beyond the first few."""
    course = StoppingState(layout())
    calls = given(simulated.answers(depth, FRAMES))
    course.advance({key: call for key, call in calls.items() if key[1] in FIRST})
    first = course.layout.order[0]
    along = {"real", "real_repeat", "lead_near", "lead_far", *simulated.RANGED}
    assert (course.place, set(course.wanted(first))) == (1, along)
    course.advance(calls)
    seen = {name: {frame for frame, condition in course.counted if condition == name} for name in ALL}
    assert all(len(seen[name]) == len(FRAMES) for name in along)
    assert all(len(seen[name]) < 30 for name in ("blank", "noise", "shuffled", "recoloured"))
    assert course.is_settled
    assert course.wanted(course.layout.order[-1]) == ()


def test_a_missing_call_holds_everything_back() -> None:
    """Frames count in their order: behind one that is not complete nothing counts, whatever else has come."""
    calls = given(simulated.answers(depth, FRAMES))
    asked = layout()
    del calls[asked.order[4], "shuffled"]
    course = StoppingState(asked)
    course.advance(calls)
    assert (course.frames, course.stopped(len(calls))) == (4, None)


def test_once_distance_is_settled_only_its_checks_are_asked() -> None:
    """Then real, its repeat and its reflection are wanted, and after the stop nothing; here without controls."""
    asked = layout(FIRST)
    course = StoppingState(asked)
    calls = given(simulated.answers(depth, FRAMES))
    first = asked.order[0]
    assert course.wanted(first) == FIRST
    for frame in asked.order:
        if course.label is not None:
            break
        course.advance({key: call for key, call in calls.items() if key[0] == frame})
    assert course.label == "depth_associated"
    assert course.frames < 12
    assert course.wanted(asked.order[-1]) == ("real", "real_repeat", "mirrored")
    course.advance(calls)
    assert course.is_settled
    assert course.wanted(asked.order[-1]) == ()


def test_with_older_controls_braking_by_distance_is_settled_as_associated() -> None:
    """They could earn no more, so that none of them is asked."""
    older = (*FIRST, *simulated.OLDER, *simulated.ALWAYS)
    stopped = settle(depth, older)
    assert stopped is not None
    assert stopped.label == "depth_associated"


@pytest.mark.parametrize("label", EARLY)
def test_what_is_settled_stays_whatever_is_answered_later(label: str) -> None:
    """Calls that were under way come back after the stop, and say the opposite: nothing of it changes."""
    asked = layout(FIRST if label == "depth_associated" else ALL)
    calls = given(simulated.answers(CLEAR[label], FRAMES))
    course = StoppingState(asked)
    course.advance(calls)
    settled, statistics = course.stopped(len(course.counted)), course.statistics()
    assert settled is not None
    late = {key: Decision("LEFT") if key[1] == "real" else Decision(None, "refused") for key in calls}
    course.advance(late | {key: calls[key] for key in course.counted})
    assert course.stopped(len(course.counted)) == settled
    assert course.statistics() == statistics


def test_errors_settle_nothing() -> None:
    """A model whose every call fails is not called unscorable early: its frames are evidence for nothing."""
    asked = layout()
    course = StoppingState(asked)
    course.advance({(frame, name): Decision(None, "error") for frame in asked.order for name in ALL})
    assert course.is_exhausted
    assert course.stopped(len(course.counted)) is None
    assert not course.claims["unscorable"].is_settled


def test_losing_answers_late_turns_a_verdict_into_not_scorable() -> None:
    """A controller settled on distance that then loses its answers is not scorable, as the whole run would say."""
    asked = layout()
    calls = given(simulated.answers(depth, FRAMES))
    for frame in asked.order[12:60]:
        calls[frame, "real"] = calls[frame, "real_repeat"] = Decision(None, "refused")
    course = StoppingState(asked)
    course.advance(calls)
    stopped = course.stopped(len(course.counted))
    assert stopped is not None
    assert stopped.label == "not_scorable"


def test_where_turns_stay_open_all_frames_are_asked_for_them() -> None:
    """Half of the turns exchanged settles neither side: the lateral axis then follows the ordinary rules."""
    place = {frame.id: number for number, frame in enumerate(FRAMES)}

    def half(condition: str, frame: Frame, rng: object) -> str:
        seen = depth(condition, frame, rng)
        swaps = condition == "mirrored" and place[frame.id] % 2
        return "RIGHT" if seen == "STRAIGHT" and swaps else "LEFT" if seen == "STRAIGHT" else seen

    stopped = settle(half)
    assert stopped is not None
    assert (stopped.label, stopped.lateral, stopped.lateral_by) == ("depth", None, "mirror_swap_rate")
    assert stopped.frames == len(FRAMES)


def test_no_direction_or_no_mirror_leaves_only_the_label_to_settle() -> None:
    """Then the lateral axis is not tested, as without stopping, and costs no call."""
    space = Discrete("go", ("GO", "HALT"), (), ("HALT",), ("GO",))
    asked = replace(layout(), space=space)

    def answer(frame: Frame, name: str) -> str:
        shown = name.removesuffix("_nudged")
        metres = {
            "lead_near": 0.0,
            "lead_drawn": frame.truth["lead_drawn_m"],
            "exchange_own": frame.truth["exchange_m"],
        }
        return "HALT" if float(str(metres.get(shown, 99))) < 40 else "GO"

    calls = {(frame.id, name): Decision(answer(frame, name)) for frame in FRAMES for name in ALL}
    course = StoppingState(asked)
    course.advance(calls)
    stopped = course.stopped(len(course.counted))
    assert stopped is not None
    assert (stopped.label, stopped.lateral) == ("depth", None)
    assert set(LATERAL["swaps"].early) & set(course.claims) == set()


def test_a_bank_too_small_to_settle_anything_is_asked_to_its_end() -> None:
    """Ten frames bound nothing: every call is made, and the ordinary rules judge."""
    asked = layout(frames=FRAMES[:10])
    course = StoppingState(asked)
    course.advance({(frame, name): Decision("SLOW") for frame in asked.order for name in ALL})
    assert course.is_exhausted
    assert len(course.counted) == asked.planned
    assert course.stopped(len(course.counted)) is None


def test_another_seed_is_another_order() -> None:
    """The order is of the seed and the frames' ids, and of nothing else."""
    assert layout().order == layout(frames=tuple(reversed(FRAMES))).order
    assert layout().order != layout(seed=1).order
    assert sorted(layout().order) == sorted(frame.id for frame in FRAMES)


def test_without_shuffled_pictures_no_absence_is_settled() -> None:
    """The bound on the content of a picture is needed, as without stopping."""
    names = tuple(name for name in ALL if name != "shuffled")
    course = StoppingState(layout(names))
    course.advance({key: one for key, one in given(simulated.answers(constant, FRAMES)).items() if key[1] in names})
    assert course.stopped(len(course.counted)) is None


def test_the_typical_number_of_calls_is_what_a_clear_controller_takes() -> None:
    """Each label with its calls, none of a label that the run cannot settle."""
    found = typical(layout())
    constant_, depth_ = settle(constant), settle(depth)
    assert constant_ is not None
    assert depth_ is not None
    assert found["image_invariant"] == constant_.calls
    assert found["depth"] == depth_.calls
    assert found["depth"] > typical(layout(FIRST))["depth_associated"]
    assert set(typical(layout(simulated.CONDITIONS))).isdisjoint({"depth", "depth_associated"})
    assert typical(layout(FIRST, frames=FRAMES[:12])).keys() <= {"not_scorable", "depth_associated"}


def test_fewest_turns_are_those_that_a_permutation_can_tell() -> None:
    """Nine of two directions (126 pairings), six of four (180)."""
    assert [fewest_turns(labels) for labels in (2, 4)] == [9, 6]


def row(space: Discrete = DRIVING, **answers: str) -> FrameAnswers:
    """Return a frame's answers; an empty one holds no decision."""
    return FrameAnswers(
        {name: Decision(answer) if answer else Decision(None, "refused") for name, answer in answers.items()}, space
    )


SAME = {"real": "SLOW", "real_repeat": "SLOW", "blank": "SLOW", "shuffled": "SLOW"}

EVIDENCE: Mapping[str, tuple[dict[str, str], dict[str, str]]] = {
    "near_far": ({"lead_near": "STOP", "lead_far": "SLOW"}, {"lead_near": "SLOW", "lead_far": "STOP"}),
    "bound_near_far": ({"lead_near": "SLOW", "lead_far": "SLOW"}, {"lead_near": "STOP", "lead_far": "SLOW"}),
    "net_near_far": ({"lead_near": "STOP", "lead_far": "SLOW"}, {"lead_near": "SLOW", "lead_far": "SLOW"}),
    "bound_lead_absent": ({**SAME, "lead_absent": "SLOW"}, {**SAME, "lead_absent": "STRAIGHT"}),
    "bound_mirrored": ({**SAME, "mirrored": ""}, {**SAME, "mirrored": "STOP"}),
    "bound_lead_near": ({**SAME, "lead_near": "SLOW"}, {**SAME, "lead_near": "STOP"}),
    "bound_lead_far": ({**SAME, "lead_far": "SLOW"}, {**SAME, "lead_far": "STRAIGHT"}),
    "bound_noise": ({**SAME, "noise": ""}, {**SAME, "noise": "STOP"}),
    "bound_text_only": ({**SAME, "text_only": "SLOW"}, {**SAME, "text_only": "STOP"}),
    "bound_shuffled": (SAME, {**SAME, "shuffled": "STOP"}),
    "bound_blank": (SAME, {**SAME, "blank": "STOP"}),
    "bound_blank_response": (SAME, {**SAME, "blank": ""}),
    "bound_blank_kept": ({**SAME, "blank": ""}, {**SAME, "blank": "STOP"}),
    "steady": (SAME, {**SAME, "real_repeat": "STOP"}),
    "scorable": (SAME, {**SAME, "real": ""}),
    "unscorable": ({**SAME, "real": ""}, SAME),
    "few_turns": ({**SAME, "mirrored": "SLOW"}, {"real": "LEFT", "mirrored": "RIGHT"}),
    "swaps_rate": ({"real": "LEFT", "mirrored": "RIGHT"}, {"real": "LEFT", "mirrored": "LEFT"}),
    "no_swaps": ({"real": "LEFT", "mirrored": ""}, {"real": "LEFT", "mirrored": "RIGHT"}),
}


@pytest.mark.parametrize("name", EVIDENCE)
def test_a_frame_speaks_for_its_claim_or_against_it(name: str) -> None:
    """The e-value rises with the one frame and falls with the other."""
    for answers, rises in zip(EVIDENCE[name], (True, False), strict=True):
        claim = claims(144, DRIVING, ALL, mirrored=True)[name]
        claim.add(row(**answers))
        assert (claim.process.log_e > 0) == rises
        assert (claim.process.log_e < 0) != rises


@pytest.mark.parametrize("name", ["presence", "presence_response"])
def test_a_refusal_differs_in_outputs_and_not_in_decisions(name: str) -> None:
    """At decision level a refused blank is no pair; at response level it is one, in the same order each time."""
    claim = claims(144, DRIVING, ALL, mirrored=True)[name]
    for _ in range(12):
        claim.add(row(**{**SAME, "blank": ""}))
    assert claim.is_settled == (name == "presence_response")


def test_an_e_value_is_a_statistic_that_says_what_it_tested() -> None:
    """With its threshold, its frames and the anytime-valid p."""
    claim = claims(144, DRIVING, ALL, mirrored=True)["near_far"]
    for _ in range(8):
        claim.add(row(lead_near="STOP", lead_far="SLOW"))
    value = claim.statistic()
    assert claim.is_settled
    assert value.n == 8
    assert value.value == pytest.approx(144.6, abs=0.1)
    assert value.p == pytest.approx(1 / value.value)
    assert value.note == "settled after 8 frames: it brakes harder with the lead near than with the lead far"
    assert value.as_dict()["detail"] == {"threshold": 100.0, "alpha": 0.01, "settled": True}
    claim.add(row(lead_near="SLOW", lead_far="STOP"))
    assert claim.statistic() == value


def test_every_claim_that_a_rule_names_can_be_made() -> None:
    """No rule waits for a claim that nobody tests."""
    made = set(claims(144, DRIVING, ALL, mirrored=True))
    named = set(itertools.chain(*EARLY.values(), *(one.early for one in LATERAL.values()))) | {"scorable"}
    assert named == made
