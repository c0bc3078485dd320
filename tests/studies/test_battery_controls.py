"""The statistics that depth needs beside its first, on simulated controllers, and the rules at their boundaries."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import by_hand
import simulated
from eyechart.frames import Frame
from eyechart.seeds import key_seed
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.stats.paired import Curve, Part, Parts, SignTest
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.published import Resampling
from eyechart.studies.battery.scoring import statistics_of
from eyechart.verdicts import Ruling, calibrated_rules, earns_lateral, lateral_rules
from eyechart.verdicts.controls import failures
from eyechart.verdicts.labels import ANY_LOST

HOW = Resampling(resamples=999, seed=1, intervals=False)
WORLD = simulated.frames()
Look = Callable[[Frame], str]


def graded(distance: float) -> str:
    """Brake by a distance."""
    return "STOP" if distance < 12 else "SLOW" if distance < 35 else "STRAIGHT"


def road(look: Look) -> simulated.Rule:
    """Return the rule of a look, which answers STOP to no road."""
    return lambda condition, frame, _: "STOP" if simulated.blind(condition) else look(frame)


def ruled(rule: simulated.Rule, **how: bool) -> tuple[Ruling, str, dict[str, Statistic]]:
    """Return the ruling on a rule, its grade of evidence, and the statistics."""
    return ruled_on(simulated.answers(rule, WORLD, **how))


def ruled_on(answered: Answers) -> tuple[Ruling, str, dict[str, Statistic]]:
    """Return the ruling on answers, its grade of evidence, and the statistics."""
    found = statistics_of(answered, HOW)
    lateral = lateral_rules(found, answered.directions()).label
    return *calibrated_rules(found, turns=earns_lateral(found, lateral)), found


def by_lead(frame: Frame) -> str:
    """Brake by the distance of the lead."""
    return graded(simulated.gap(frame))


def test_a_reader_of_distance_passes_every_control_and_says_so() -> None:
    """Depth, controlled, with the effect, every step, sixteen comparisons of bins, every scenario, and the curve."""
    ruling, evidence, found = ruled(road(by_lead))
    assert (ruling.label, ruling.decided_by, evidence) == ("depth", "depth_interventional", "controlled")
    assert found["depth_net"].value == found["lane_net"].value == 1.0
    assert [found[name].p for name in ("dose_near_mid", "dose_mid", "dose_mid_far")] == [1.0, 1.0, 1.0]
    assert (found["ends_lost"].n, (found["ends_lost"].detail or {})["won"]) == (2 * 144, 4 * 144)
    bins, scenarios, curve = found["dose_bins"], found["scenario_reversed"], found["dose_curve"]
    assert isinstance(bins, Parts)
    assert isinstance(scenarios, Parts)
    assert isinstance(curve, Curve)
    assert len(bins.parts) == 16
    assert [part.name for part in scenarios.parts] == ["s0", "s1", "s2", "s3"]
    assert [(one.condition, one.frames) for one in curve.doses][::7] == [("lead_near", 144), ("lead_far", 144)]
    levels = [one.level for one in curve.doses]
    assert levels == sorted(levels, reverse=True)
    assert sum(one.frames for one in curve.doses if one.condition == "lead_mid_near") == 144
    assert (curve.doses[1].low, curve.doses[3].high) == pytest.approx((9.1, 20), abs=0.2)


@pytest.mark.parametrize(
    "statistic", ["lane_exchange", "lane_net", "depth_net", "both_lost", "dose_mid", "unparsed_controls"]
)
def test_every_condition_has_its_n_interval_and_p(statistic: str) -> None:
    """No number of a rule stands alone."""
    _, _, found = ruled(road(by_lead))
    one = found[statistic]
    assert one.n == 144 or isinstance(one, SignTest) or statistic == "unparsed_controls"
    assert one.method
    assert statistic == "dose_mid" or one.ci is not None
    assert statistic == "unparsed_controls" or one.p is not None


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
    """Brake by the lead, and on every fourth frame for a neighbour alone."""
    if sum(map(ord, frame.id)) % 4:
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
        (by_range, "dose_lost"),
        (by_nearest, "lane_exchange"),
        (by_hole, "dose_bins"),
        (by_zigzag, "dose_mid"),
        (by_scenario, "scenario_reversed"),
        (by_some, "near_far_lost"),
        (by_neighbour, "lane_lost"),
        (by_few, "depth_net"),
    ],
)
def test_a_rule_that_is_no_reading_of_distance_is_content(look: Look, decided_by: str) -> None:
    """Each of the vetoes takes one kind of rule, and is named."""
    ruling, evidence, found = ruled(road(look))
    assert found["depth_interventional"].p < 0.01
    assert (ruling.label, ruling.decided_by, evidence) == ("content", decided_by, "controlled")
    assert "it brakes harder where the lead is nearer, but" in ruling.because


def misread(share: float, noise: float) -> simulated.Rule:
    """Brake by distance, the wrong way round on a share of the pictures, behind a coin in some of the answers."""

    def rule(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        if rng.random() < noise:
            return str(rng.choice(DRIVING.actions))
        right = by_lead(frame)
        shown = condition if condition in {*simulated.COUNTERFACTUALS, *simulated.CONTROLS} - {"nudged"} else "real"
        chance = np.random.default_rng(key_seed("misread", frame.id, shown)).random()
        return {"STOP": "STRAIGHT", "STRAIGHT": "STOP"}.get(right, right) if chance < share else right

    return rule


def test_a_reader_that_misreads_a_quarter_of_the_pictures_behind_noise_is_content() -> None:
    """It is wrong on other pictures of each frame, so that no frame stands out; its noise covers each comparison."""
    ruling, _, found = ruled(misread(0.25, 0.3))
    assert (ruling.label, ruling.decided_by) == ("content", "ends_lost")
    assert found["both_lost"].value < 0.05
    assert found["near_far_lost"].value < 0.05
    assert "in more pairs than noise in each picture explains" in ruling.because


def by_frame(look: Callable[[str, float, str], str], noise: float) -> simulated.Rule:
    """Return a reader that answers by condition and by a chance of the frame, and tosses a coin between."""
    right = road(by_lead)

    def rule(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        told, chance = right(condition, frame, rng), np.random.default_rng(key_seed("own", frame.id)).random()
        if condition not in {"lead_near", "lane_own", "lead_far", "lane_beside"} and rng.random() < noise:
            return str(rng.choice(["STOP", "SLOW", "STRAIGHT"]))
        return look(condition, chance, told)

    return rule


def test_noise_between_pays_for_no_hole_at_the_nearest() -> None:
    """On the frames on which it goes on both near pictures are lost, and noise would lose one here and one there."""
    near = {"lead_near", "lane_own"}
    ruling, _, found = ruled(by_frame(lambda at, own, told: "STRAIGHT" if at in near and own < 0.25 else told, 0.3))
    assert ruling.label == "content"
    assert found["twice_lost"].value > 0.05
    assert found["twice_lost"].p < 0.005
    honest, _, plain = ruled(by_frame(lambda _, __, told: told, 0.3))
    assert honest.label == "depth"
    assert plain["twice_lost"].value < 0.05


def test_who_brakes_always_on_some_frames_and_reads_the_others_loses_no_end() -> None:
    """Where a slip alone has it go on for the picture between, it brakes for both far ones or for none.

    The more frames, the surer is the test that the two go together.
    """
    right = by_frame(lambda _, own, told: told if own < 0.35 else "SLOW", 0.0)

    def rule(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        if rng.random() < 0.1:
            return str(rng.choice(DRIVING.actions))
        told = right(condition, frame, rng)
        return "SLOW" if condition in {"lead_mid_near", "lead_mid_far"} else told

    ruling, _, found = ruled(rule)
    assert ruling.label == "depth", ruling.because
    assert found["twice_lost"].value < 0.05


def test_any_comparison_is_lost_for_sure_or_not_at_all() -> None:
    """Of few frames with some noise the share is anybody's guess: its lower bound is to be above 0 too."""
    found = by_hand.reader()
    unsure, sure = (Statistic(0.08, 36, ci, level=0.98) for ci in ((-0.02, 0.18), (0.01, 0.15)))
    assert not list(failures({**found, "any_lost": unsure}))
    assert [one.statistic for one in failures({**found, "any_lost": sure})] == ["any_lost"]


def test_small_holes_in_several_comparisons_add_up() -> None:
    """Each is of one frame in 22; together the order is wrong on more than may be."""
    wrong = {"lead_near": (0.0, "STRAIGHT"), "lead_far": (0.045, "STOP"), "lane_own": (0.09, "STRAIGHT")}

    def look(at: str, own: float, told: str) -> str:
        start, says = wrong.get(at, (2.0, ""))
        return says if start <= own < start + 0.045 else told

    _, _, found = ruled(by_frame(look, 0.0))
    assert found["any_lost"].value > ANY_LOST > found["near_far_lost"].value
    assert found["any_lost"].value == pytest.approx((found["any_lost"].detail or {})["k"] / found["any_lost"].n)


def test_the_noise_of_turning_is_none_of_braking() -> None:
    """Who goes on to the left or straight on by a coin brakes without noise: nothing of its losses is forgiven."""
    ways = ("STRAIGHT", "LEFT")
    steady = road(by_lead)

    def rule(condition: str, frame: Frame, rng: np.random.Generator) -> str:
        told = steady(condition, frame, rng)
        return str(rng.choice(ways)) if told == "STRAIGHT" else told

    _, _, found = ruled(rule)
    assert found["near_far_lost"].value == 0.0
    assert found["dose_lost"].value == 0.0


def test_noise_alone_swaps_no_ends() -> None:
    """A coin in half of the answers, the same share of misread pictures none."""
    ruling, _, found = ruled(misread(0.0, 0.5))
    assert ruling.label == "depth"
    assert found["ends_lost"].value < 0.045


def test_noise_is_that_of_the_nudged_picture_too() -> None:
    """Who answers an invisible change from the other end wavers in two of three pairs that are alike."""
    opposite = {"STOP": "STRAIGHT", "STRAIGHT": "STOP", "SLOW": "SLOW"}
    _, _, steady = ruled(road(by_lead))
    _, _, found = ruled(
        lambda condition, frame, rng: (
            opposite[one]
            if condition == "nudged" and (one := road(by_lead)(condition, frame, rng))
            else road(by_lead)(condition, frame, rng)
        )
    )
    assert (steady["ends_lost"].detail or {})["repeats_apart"] == 0
    assert (found["ends_lost"].detail or {})["repeats_apart"] > 0


def test_braking_without_two_ends_is_not_asked_for_them() -> None:
    """One level in nearly all answers has no ends to swap; a run without the exchange has none to compare."""
    _, _, found = ruled(road(by_few))
    assert found["ends_lost"].value is None
    assert "no two ends" in found["ends_lost"].note
    _, _, bare = ruled(road(by_lead), controls=False)
    assert bare["ends_lost"].value is None


def test_a_hole_inside_one_step_is_seen_by_its_bin() -> None:
    """Going on from 9.1 to 11.8 m loses a bin and no step."""
    ruling, _, found = ruled(road(lambda frame: "STRAIGHT" if 9.1 < simulated.gap(frame) < 11.8 else by_lead(frame)))
    bins = found["dose_bins"]
    assert (ruling.label, ruling.decided_by) == ("content", "dose_bins")
    assert isinstance(bins, Parts)
    assert bins.note.endswith(" m against 11.8-15.3 m")


def test_a_hole_that_only_other_frames_show_is_seen_by_the_next_bin() -> None:
    """It goes on from 25 to 38 m and slows down to 48 m: within a frame no nearer dose is braked for less."""

    def by_far_hole(frame: Frame) -> str:
        gap = simulated.gap(frame)
        return "STRAIGHT" if 25 <= gap < 38 or gap > 48 else graded(min(gap, 30.0))

    ruling, _, found = ruled(road(by_far_hole))
    bins = found["dose_bins"]
    assert (ruling.label, ruling.decided_by) == ("content", "dose_bins")
    assert isinstance(bins, Parts)
    within = [part for part in bins.parts if "nearer" in part.name or "farther" in part.name]
    assert [part.losses for part in within] == [0] * 12


def test_whoever_brakes_for_any_vehicle_is_told_so() -> None:
    """The note of the failed exchange says what it means."""
    ruling, _, _ = ruled(road(by_nearest))
    assert "it may brake for any vehicle, wherever it stands" in ruling.because


def test_without_controls_braking_is_associated() -> None:
    """A run that asked none, as before there were any, has no authority and says what was not tested."""
    ruling, evidence, _ = ruled(road(by_lead), controls=False)
    assert (ruling.label, evidence) == ("depth_associated", "interventional")
    assert "for the lead or for whoever is near was not tested" in ruling.because


def test_without_an_answer_to_one_control_braking_is_associated() -> None:
    """Whichever of them is missing, the label says what was not tested."""
    whole = simulated.answers(road(by_lead), WORLD)
    for missing, evidence, says in (
        ("lane_beside", "interventional", "whoever is near"),
        ("lead_mid_far", "controlled", "falls with distance all the way"),
        ("nudged", "controlled", "follows the file"),
    ):
        part = {name: given for name, given in whole.decisions.items() if name != missing}
        ruling, grade, _ = ruled_on(replace(whole, decisions=part))
        assert (ruling.label, grade) == ("depth_associated", evidence)
        assert says in ruling.because


@pytest.mark.parametrize(("declined", "label"), [(13, "depth"), (14, "depth_associated")])
def test_whoever_declines_edited_pictures_is_not_let_through(declined: int, label: str) -> None:
    """What is surely more than 5 % of the replies to one of the compared pictures may hold no decision."""
    whole = simulated.answers(road(by_lead), WORLD)
    lost = (Decision(None, "refused"),) * declined
    decisions = {
        name: (*lost, *given[declined:]) if name == "lane_beside" else given for name, given in whole.decisions.items()
    }
    ruling, _, found = ruled_on(replace(whole, decisions=decisions))
    assert found["unparsed_controls"].value == pytest.approx(declined / 144)
    assert found["unparsed_controls"].note == "most: lane_beside"
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


def turning(condition: str, frame: Frame, to_clear: bool = True, by_lane: bool = False) -> str:  # noqa: FBT001, FBT002
    """Brake by distance; on a free road turn to the clear side, the blocked one, or by the own lane."""
    if simulated.blind(condition):
        return "STOP"
    if by_lead(frame) != "STRAIGHT":
        return by_lead(frame)
    left = frame.truth["ego_lane"] == 1 if by_lane else frame.truth["left_clear"] is True
    return "LEFT" if (left == to_clear) != (condition == "mirrored") else "RIGHT"


def test_turns_to_the_clear_side_earn_their_own_label() -> None:
    """To the clear side it is turns_clear and depth_lateral; to the blocked one it is swaps and depth."""
    for to_clear, lateral, label in ((True, "turns_clear", "depth_lateral"), (False, "swaps", "depth")):
        answered = simulated.answers(lambda c, f, _, to=to_clear: turning(c, f, to), WORLD)
        found = statistics_of(answered, HOW)
        assert lateral_rules(found, answered.directions()).label == lateral
        assert ruled_on(answered)[0].label == label
        assert found["turns_clear"].value == float(to_clear)


def test_who_looks_at_its_own_lane_alone_does_not_turn_to_the_clear_side() -> None:
    """Where the outer lanes are clear on their inner side alone, the lane explains the turns."""
    world = tuple(
        replace(frame, truth={**frame.truth, "left_clear": lane == 1, "right_clear": lane == 0})
        for frame in WORLD
        for lane in (frame.truth["ego_lane"],)
    )
    answered = simulated.answers(lambda c, f, _: turning(c, f, by_lane=True), world)
    found = statistics_of(answered, HOW)
    assert found["turns_clear"].p < 0.01
    assert found["turns_clear_within"].p == 1.0
    assert lateral_rules(found, answered.directions()).label == "swaps"
    assert ruled_on(answered)[0].label == "depth"


def test_a_bank_that_does_not_know_the_sides_gives_authority_by_exchange_and_claims_no_side() -> None:
    """Without the columns swaps is all that can be asked; with sides and no lanes nothing more can be shown."""
    for dropped, label in ((("left_clear", "right_clear"), "depth_lateral"), (("ego_lane", "lanes"), "depth")):
        world = tuple(
            replace(frame, truth={name: one for name, one in frame.truth.items() if name not in dropped})
            for frame in WORLD
        )
        answered = simulated.answers(
            lambda c, f, _: turning(c, replace(f, truth={"left_clear": f.step % 2 == 0, "ego_lane": 0, **f.truth})),
            world,
        )
        found = statistics_of(answered, HOW)
        assert lateral_rules(found, answered.directions()).label == "swaps"
        assert ruled_on(answered)[0].label == label
        assert found["turns_clear_within"].p is None


SOUND = statistics_of(simulated.answers(road(by_lead), WORLD), HOW)
PART = Part("here", 0, 9, 0, 0.02, 1.0)


def parts(p: float) -> Statistic:
    """Return a veto over parts with this p."""
    return Parts(0.0, 9, p=p, note="most reversed: here", parts=(PART,))


@pytest.mark.parametrize(
    ("name", "holds", "fails"),
    [
        ("depth_interventional", Statistic(0.7, 50, p=0.00999), Statistic(0.7, 50, p=0.01)),
        ("depth_net", Statistic(0.2, 144, (0.1, 0.3), 0.1), Statistic(0.2, 144, (0.0999, 0.3), 0.101)),
        ("lane_exchange", Statistic(0.7, 50, p=0.00999), Statistic(0.7, 50, p=0.01)),
        ("lane_net", Statistic(0.2, 144, (0.1, 0.3), 0.1), Statistic(0.2, 144, (0.0999, 0.3), 0.101)),
        ("dose_near_mid", Statistic(0.3, 50, p=0.005 / 3 + 1e-9), Statistic(0.3, 50, p=0.005 / 3 - 1e-9)),
        ("dose_mid", Statistic(0.3, 50, p=0.005 / 3 + 1e-9), Statistic(0.3, 50, p=0.005 / 3 - 1e-9)),
        ("dose_mid_far", Statistic(0.3, 50, p=0.005 / 3 + 1e-9), Statistic(0.3, 50, p=0.005 / 3 - 1e-9)),
        ("dose_bins", parts(0.005), parts(0.00499)),
        ("scenario_reversed", parts(0.05), parts(0.0499)),
        ("near_far_lost", Statistic(0.05, 144), Statistic(0.0501, 144)),
        ("lane_lost", Statistic(0.05, 144), Statistic(0.0501, 144)),
        ("both_lost", Statistic(0.05, 144), Statistic(0.0501, 144)),
        ("ends_lost", Statistic(0.045, 288), Statistic(0.0451, 288)),
        ("any_lost", Statistic(0.07, 144), Statistic(0.0701, 144)),
        ("repeat_over_nudged", Statistic(0.7, 50, p=0.01), Statistic(0.7, 50, p=0.00999)),
        ("unparsed_controls", Statistic(0.1, 144, (0.05, 0.2)), Statistic(0.1, 144, (0.0501, 0.2))),
    ],
)
def test_every_condition_of_depth_has_its_threshold(name: str, holds: Statistic, fails: Statistic) -> None:
    """At its threshold each condition holds, or fails, as decision 38 says it; each alone takes depth away."""
    assert calibrated_rules(SOUND, turns=False)[0].label == "depth"
    assert calibrated_rules({**SOUND, name: holds}, turns=False)[0].label == "depth"
    label = calibrated_rules({**SOUND, name: fails}, turns=False)[0].label
    wanted = {
        "unparsed_controls": "depth_associated",
        "depth_interventional": "content",
        "repeat_over_nudged": "content",
    }
    assert label == wanted.get(name, "content")
    assert label != "depth"


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
    found = statistics_of(answered, HOW)
    ruling = lateral_rules({**found, name: replace(found[name], p=p)}, answered.directions())
    assert ruling.label == label
