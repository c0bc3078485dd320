"""The statistics that depth needs beside its first, on simulated controllers, and the rules at their boundaries."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import simulated
from eyechart.frames import Frame
from eyechart.spaces.space import Decision
from eyechart.stats.paired_tests import SignTest
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.scores import statistics_of
from eyechart.verdicts import Ruling, calibrated_rules, earns_lateral, lateral_rules

HOW = Resampling(resamples=999, seed=1, intervals=False)
WORLD = simulated.frames()
Look = Callable[[Frame], str]


def graded(distance: float) -> str:
    """Brake by a distance."""
    return "STOP" if distance < 12 else "SLOW" if distance < 35 else "STRAIGHT"


def road(look: Look) -> simulated.Rule:
    """Return the rule of a look, which answers STOP to no road."""
    return lambda condition, frame, _: "STOP" if simulated.blind(condition) else look(frame)


def ruled(rule: simulated.Rule, **how: tuple[str, ...]) -> tuple[Ruling, str, dict[str, Statistic]]:
    """Return the ruling on a rule, its grade of evidence, and the statistics."""
    return ruled_on(simulated.answers(rule, WORLD, **how))


def ruled_on(answered: Answers) -> tuple[Ruling, str, dict[str, Statistic]]:
    """Return the ruling on answers, its grade of evidence, and the statistics."""
    statistics = statistics_of(answered, HOW)
    lateral = lateral_rules(statistics, answered.directions()).label
    return *calibrated_rules(statistics, turns=earns_lateral(statistics, lateral)), statistics


def by_lead(frame: Frame) -> str:
    """Brake by the distance of the lead."""
    return graded(simulated.gap(frame))


def test_a_reader_of_distance_passes_every_control_and_says_so() -> None:
    """Depth, controlled, with the effect, the order along the range, and the bound in its sentence."""
    ruling, evidence, found = ruled(road(by_lead))
    assert (ruling.label, ruling.decided_by, evidence) == ("depth", "order", "controlled")
    assert found["depth_net"].value == found["sensitivity"].value == 1.0
    assert found["order"].value == 0.0
    assert "of 100 comparisons the wrong way round (bound of 95 %)" in ruling.because


@pytest.mark.parametrize(
    "statistic", ["sensitivity", "specificity", "order", "rise", "file", "depth_net", "unparsed_controls"]
)
def test_every_condition_has_its_n_interval_and_p(statistic: str) -> None:
    """No number of a rule stands alone."""
    _, _, found = ruled(road(by_lead))
    one = found[statistic]
    assert one.n or isinstance(one, SignTest)
    assert one.method
    assert one.ci is not None or one.p is not None


def by_nearest(frame: Frame) -> str:
    """Brake by whoever is nearest, in whichever lane."""
    return graded(min(simulated.gap(frame), simulated.number(frame, "beside_m")))


def by_hole(frame: Frame) -> str:
    """Brake by distance, but go on in a part of the range."""
    return "STRAIGHT" if 15.5 < simulated.gap(frame) < 19.9 else by_lead(frame)


def by_zigzag(frame: Frame) -> str:
    """Brake right at the two distances that are compared, and the wrong way round between."""
    gap = simulated.gap(frame)
    return "STOP" if gap < 9 else "STRAIGHT" if gap < 20 else "SLOW" if gap < 50 else "STRAIGHT"


def by_scenario(frame: Frame) -> str:
    """Brake the wrong way round in one scenario of four."""
    right = by_lead(frame)
    return right if frame.scenario != "s1" else {"STOP": "STRAIGHT", "STRAIGHT": "STOP"}.get(right, right)


def by_some(frame: Frame) -> str:
    """Brake the wrong way round on every fifth frame."""
    right = by_lead(frame)
    return right if sum(map(ord, frame.id)) % 5 else {"STOP": "STRAIGHT", "STRAIGHT": "STOP"}.get(right, right)


def by_neighbour(frame: Frame) -> str:
    """Brake by the lead, and on two of three frames for a neighbour alone."""
    if sum(map(ord, frame.id)) % 3 == 0:
        return by_lead(frame)
    return "STOP" if simulated.number(frame, "beside_m") < 12 else "SLOW"


def by_few(frame: Frame) -> str:
    """Brake by distance on one frame of nine."""
    return by_lead(frame) if sum(map(ord, frame.id)) % 9 == 0 else "SLOW"


def by_range(frame: Frame) -> str:
    """Go on where the lead is put farthest, and slow for one that is farther still, as for all between."""
    gap = simulated.gap(frame)
    return "STOP" if gap < 12 else "STRAIGHT" if 50 < gap < 60 else "SLOW"


@pytest.mark.parametrize(
    ("look", "decided_by"),
    [
        (by_range, "rise"),
        (by_nearest, "specificity"),
        (by_hole, "rise"),
        (by_zigzag, "order"),
        (by_scenario, "place_reversed"),
        (by_some, "order"),
        (by_neighbour, "specificity"),
        (by_few, "sensitivity"),
    ],
)
def test_a_rule_that_is_no_reading_of_distance_is_content(look: Look, decided_by: str) -> None:
    """Each kind of rule is refuted by one statistic, which is named."""
    ruling, evidence, found = ruled(road(look))
    assert found["depth_interventional"].p < 0.01
    assert (ruling.label, ruling.decided_by, evidence) == ("content", decided_by, "controlled")
    assert "it brakes harder for the near lead than for the far one, but" in ruling.because


def older(look: Look, asked: tuple[str, ...] = (*simulated.OLDER, *simulated.ALWAYS)) -> tuple[Ruling, str]:
    """Return the ruling on a run of a bank of an older version."""
    return ruled(road(look), controls=asked)[:2]


@pytest.mark.parametrize("asked", [(), ("nudged",), simulated.OLDER[:2], (*simulated.OLDER, *simulated.ALWAYS)])
def test_without_pictures_along_the_range_braking_is_associated_at_most(asked: tuple[str, ...]) -> None:
    """Whichever of the older controls was asked, it has no authority and says beyond which distance nothing was."""
    ruling, evidence = older(by_lead, asked)
    assert (ruling.label, evidence) == ("depth_associated", "controlled" if len(asked) > 1 else "interventional")
    assert "it brakes harder for the near lead than for the far one; not tested beyond 7 m" in ruling.because


@pytest.mark.parametrize(
    ("look", "label", "decided_by"),
    [
        (by_nearest, "content", "lane_net"),
        (by_zigzag, "content", "rise"),
        (by_hole, "content", "rise"),
        (by_few, "depth_associated", "depth_interventional"),
    ],
)
def test_what_older_controls_refute_is_content(look: Look, label: str, decided_by: str) -> None:
    """Who brakes for any vehicle is bounded, and harder the farther is a rise; what is small may be more."""
    ruling, evidence = older(look)
    assert (ruling.label, ruling.decided_by, evidence) == (label, decided_by, "controlled")


def test_without_an_answer_to_the_drawn_pictures_braking_is_associated() -> None:
    """Whichever of them is missing, the label says what was not shown."""
    whole = simulated.answers(road(by_lead), WORLD)
    for missing in ("exchange_apart", "exchange_own", "exchange_beside", "lead_near_nudged"):
        part = {name: given for name, given in whole.decisions.items() if name != missing}
        ruling, _, _ = ruled_on(replace(whole, decisions=part))
        assert ruling.label == "depth_associated", missing


@pytest.mark.parametrize(("declined", "label"), [(13, "depth"), (14, "depth_associated")])
def test_whoever_declines_edited_pictures_is_not_let_through(declined: int, label: str) -> None:
    """What is surely more than 5 % of the replies to one of the compared pictures may hold no decision."""
    whole = simulated.answers(road(by_lead), WORLD)
    lost = (Decision(None, "refused"),) * declined
    decisions = {
        name: (*lost, *given[declined:]) if name == "exchange_beside" else given
        for name, given in whole.decisions.items()
    }
    ruling, _, found = ruled_on(replace(whole, decisions=decisions))
    assert found["unparsed_controls"].value == pytest.approx(declined / 144)
    assert found["unparsed_controls"].note == "most: exchange_beside"
    assert ruling.label == label


def follower_of_files(condition: str, frame: Frame, _: np.random.Generator) -> str:
    """Answer by the file: one of its own for every frame and condition, but the same for a repeat."""
    if simulated.blind(condition):
        return "STOP"
    return ("STOP", "SLOW", "STRAIGHT")[sum(map(ord, frame.id + condition.removesuffix("_repeat"))) * 7919 % 3]


def test_a_follower_of_files_is_told_from_sight() -> None:
    """A cache over a coin, and who knows the files, are no content; the verdict says why in words."""
    ruling, _, found = ruled(follower_of_files)
    assert found["content_shuffled"].p < 0.01
    assert (ruling.label, ruling.decided_by) == ("undecided", "repeat_over_nudged")
    assert "it follows the file, or a cache answered" in ruling.because
    assert "frames would" not in ruling.because


@pytest.mark.parametrize("only", ["noise", "text_only", "mirrored", "lead_near", "lead_far"])
def test_a_reactor_to_one_condition_is_never_invariant(only: str) -> None:
    """Nor does its verdict ask for more frames: the effect is shown, and no rule claims anything of it."""
    ruling, _, _ = ruled(lambda condition, _, __: "STOP" if condition == only else "SLOW")
    assert ruling.label in {"undecided", "content"}
    assert "frames would" not in ruling.because


def test_a_blind_turn_to_the_left_stays_invariant() -> None:
    """The mirrored picture is compared as it was answered, not turned back."""
    ruling, _, _ = ruled(lambda *_: "LEFT")
    assert ruling.label == "image_invariant"


def test_a_few_decisions_on_pictures_that_are_mostly_declined_change_nothing() -> None:
    """A blind model that declines noise on nine frames of ten keeps its decision on all that it decides."""
    ruling, _, _ = ruled(lambda c, f, _: None if c in {"blank", "noise"} and f.step % 10 else "SLOW")
    assert ruling.label == "refusal_effect"


def test_who_brakes_for_any_lead_notices_more_than_pictures() -> None:
    """Where every picture has a lead only one without it tells: content, decided by that."""
    ruling, _, _ = ruled(road(lambda frame: "STRAIGHT" if simulated.gap(frame) > 1e6 else "SLOW"))
    assert (ruling.label, ruling.decided_by) == ("content", "content_lead_absent")


LATER = ("lead_absent", "real_again")


def test_who_only_answers_otherwise_by_then_has_not_seen_that_the_lead_is_gone() -> None:
    """Against a true picture of its own stage the change is none; with none there, an older run cannot tell."""

    def waking(condition: str, frame: Frame, rng: object) -> str:
        del frame, rng
        return "STOP" if condition in LATER else "SLOW"

    ruling, _, found = ruled(waking, controls=LATER)
    assert ruling.label != "content"
    assert found["content_lead_absent"].p == 1.0
    assert "agreement with real_again, real over lead_absent" in found["content_lead_absent"].method
    older_one, _, _ = ruled(waking, controls=LATER[:1])
    assert (older_one.label, older_one.decided_by) == ("content", "content_lead_absent")


def test_who_reacts_to_the_absence_alone_is_content_by_then_too() -> None:
    """Also behind a coin in a fifth of the answers."""

    def absent(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        del frame
        if rng.random() < 0.2:
            return str(rng.choice(["STOP", "SLOW", "STRAIGHT"]))
        return "STOP" if condition == "lead_absent" else "SLOW"

    ruling, _, _ = ruled(absent, controls=LATER)
    assert (ruling.label, ruling.decided_by) == ("content", "content_lead_absent")


def turning(condition: str, frame: Frame, to_clear: bool = True, by_lane: bool = False) -> str:  # noqa: FBT001, FBT002
    """Brake by distance; on a free road turn to the clear side, the blocked one, or by the own lane."""
    if simulated.blind(condition):
        return "STOP"
    if by_lead(frame) != "STRAIGHT":
        return by_lead(frame)
    if simulated.boxed(frame):
        return "STRAIGHT"
    left = frame.truth["ego_lane"] == 1 if by_lane else frame.truth["left_clear"] is True
    return "LEFT" if (left == to_clear) != (condition == "mirrored") else "RIGHT"


def test_turns_to_the_clear_side_earn_their_own_label() -> None:
    """To the clear side it is turns_clear and depth_lateral; to the blocked one it is swaps and depth."""
    for to_clear, lateral, label in ((True, "turns_clear", "depth_lateral"), (False, "swaps", "depth")):
        answered = simulated.answers(lambda c, f, _, to=to_clear: turning(c, f, to), WORLD)
        statistics = statistics_of(answered, HOW)
        assert lateral_rules(statistics, answered.directions()).label == lateral
        assert ruled_on(answered)[0].label == label
        assert statistics["turns_clear"].value == float(to_clear)


def test_who_looks_at_its_own_lane_alone_does_not_turn_to_the_clear_side() -> None:
    """Where the outer lanes are clear on their inner side alone, the lane explains the turns."""
    world = tuple(
        replace(frame, truth={**frame.truth, "left_clear": lane == 1, "right_clear": lane == 0})
        for frame in WORLD
        for lane in (frame.truth["ego_lane"],)
    )
    answered = simulated.answers(lambda c, f, _: turning(c, f, by_lane=True), world)
    statistics = statistics_of(answered, HOW)
    assert statistics["turns_clear"].p < 0.01
    assert statistics["turns_clear_within"].p == 1.0
    assert lateral_rules(statistics, answered.directions()).label == "swaps"
    assert ruled_on(answered)[0].label == "depth"


def test_a_bank_that_does_not_know_the_sides_gives_no_authority_sideways() -> None:
    """Without the columns swaps is all that can be asked; with sides and no lanes nothing more can be shown."""
    for dropped in (("left_clear", "right_clear"), ("ego_lane", "lanes")):
        world = tuple(
            replace(frame, truth={name: one for name, one in frame.truth.items() if name not in dropped})
            for frame in WORLD
        )
        answered = simulated.answers(
            lambda c, f, _: turning(c, replace(f, truth={"left_clear": f.step % 2 == 0, "ego_lane": 0, **f.truth})),
            world,
        )
        statistics = statistics_of(answered, HOW)
        assert lateral_rules(statistics, answered.directions()).label == "swaps"
        assert ruled_on(answered)[0].label == "depth"
        assert statistics["turns_clear_within"].p is None


SOUND = statistics_of(simulated.answers(road(by_lead), WORLD), HOW)


@pytest.mark.parametrize(
    ("name", "holds", "fails"),
    [
        ("depth_interventional", Statistic(0.7, 50, p=0.00999), Statistic(0.7, 50, p=0.01)),
        ("depth_net", Statistic(0.2, 144, (0.0, 0.1), 0.1), Statistic(0.2, 144, (0.0, 0.0999), 0.101)),
        ("lane_net", Statistic(0.2, 144, (0.0, 0.1), 0.1), Statistic(0.2, 144, (0.0, 0.0999), 0.101)),
    ],
)
def test_what_any_run_is_asked_of_distance_has_its_threshold(name: str, holds: Statistic, fails: Statistic) -> None:
    """At its threshold each condition holds, or fails; each alone takes depth away."""
    assert calibrated_rules(SOUND, turns=False)[0].label == "depth"
    assert calibrated_rules({**SOUND, name: holds}, turns=False)[0].label == "depth"
    assert calibrated_rules({**SOUND, name: fails}, turns=False)[0].label == "content"


@pytest.mark.parametrize("name", ["mirrored", "lead_near", "lead_far", "lead_absent", "noise", "text_only"])
def test_every_bound_of_an_absence_has_its_level(name: str) -> None:
    """At .05 an absence is not bounded, below it is; noise and no picture are no matter to presence_only."""
    blind = statistics_of(simulated.answers(lambda *_: "SLOW", WORLD), HOW)
    presence = statistics_of(simulated.answers(lambda c, *_: "STOP" if simulated.blind(c) else "SLOW", WORLD), HOW)
    for p, invariant in ((0.0499, True), (0.05, False)):
        one = {f"bound_{name}": replace(blind[f"bound_{name}"], p=p)}
        label = calibrated_rules({**blind, **one}, turns=False)[0].label
        assert (label == "image_invariant") == invariant
        noticed = calibrated_rules({**presence, **one}, turns=False)[0].label
        assert (noticed == "presence_only") == (invariant or name in {"noise", "text_only"})


def test_a_few_pictures_that_get_another_answer_twice_are_no_absence() -> None:
    """Seven frames of 144 are bounded below the margin; once is noise, twice is sight of something."""
    few = {frame.id for frame in WORLD[::24]}

    def odd(condition: str, frame: Frame, _: np.random.Generator) -> str:
        return "STOP" if frame.id in few and condition in {"real", "real_repeat", "mirrored"} else "SLOW"

    ruling, _, found = ruled(odd)
    assert found["bound_content_shuffled"].p < 0.01
    assert (ruling.label, ruling.decided_by) == ("undecided", "repeats_together")
    once, _, _ = ruled(lambda c, f, r: "SLOW" if c == "real_repeat" else odd(c, f, r))
    assert once.decided_by != "repeats_together"


@pytest.mark.parametrize(("p", "holds"), [(0.01, True), (0.00999, False)])
def test_an_absence_is_none_where_repeats_go_together(p: float, holds: bool) -> None:  # noqa: FBT001
    """At .01 it is one, below it is none."""
    blind = statistics_of(simulated.answers(lambda *_: "SLOW", WORLD), HOW)
    ruling, _ = calibrated_rules({**blind, "repeats_together": Statistic(0.9, 144, p=p)}, turns=False)
    assert (ruling.label == "image_invariant") == holds


@pytest.mark.parametrize(
    ("name", "changed", "holds"),
    [
        ("bound_kappa", {"p": 0.00999}, True),
        ("bound_kappa", {"p": 0.01}, False),
        ("kappa_pooled", {"p": 0.00999}, True),
        ("kappa_pooled", {"p": 0.01}, False),
        ("kappa", {"value": 0.199, "ci": (0.0, 0.3)}, True),
        ("kappa", {"value": 0.2, "ci": (0.0, 0.3)}, False),
        ("kappa", {"value": 0.1, "ci": (0.001, 0.3)}, False),
        ("self_disagreement", {"ci": (0.2001, 0.9)}, True),
        ("self_disagreement", {"ci": (0.2, 0.9)}, False),
    ],
)
def test_a_coin_has_its_thresholds(name: str, changed: dict[str, object], holds: bool) -> None:  # noqa: FBT001
    """Each part of the rule alone takes self_inconsistent away."""
    coin = statistics_of(simulated.answers(lambda _, __, rng: str(rng.choice(["STOP", "SLOW", "LEFT"])), WORLD), HOW)
    assert calibrated_rules(coin, turns=False)[0].label == "self_inconsistent"
    ruling, _ = calibrated_rules({**coin, name: replace(coin[name], **changed)}, turns=False)
    assert (ruling.label == "self_inconsistent") == holds


@pytest.mark.parametrize("name", ["turns_clear", "turns_clear_within"])
@pytest.mark.parametrize(("p", "label"), [(0.00999, "turns_clear"), (0.01, "swaps")])
def test_turns_to_the_clear_side_have_their_thresholds(name: str, p: float, label: str) -> None:
    """Both tests are at .01."""
    answered = simulated.answers(lambda c, f, _: turning(c, f), WORLD)
    statistics = statistics_of(answered, HOW)
    ruling = lateral_rules({**statistics, name: replace(statistics[name], p=p)}, answered.directions())
    assert ruling.label == label
