"""Every threshold of both sets of rules, from both of its sides, on statistics written down by hand."""

import pytest

from by_hand import HIGH, JUST_BELOW, LOW, SILENT, Found, blind, coin, least, nothing_known, older, p, reader, share
from eyechart.stats.agreement import SwapRate
from eyechart.stats.association import Association
from eyechart.stats.paired_tests import DiscordantPairs
from eyechart.stats.statistic import Statistic
from eyechart.verdicts import LATERAL, calibrated_rules, lateral_rules, paper_rules
from eyechart.verdicts.battery_rules import earns_lateral, grade


def most(bound: float) -> Statistic:
    """Return a value whose interval ends here."""
    return Statistic(0.05, 144, (0.01, bound))


def with_p(value: float, of: float) -> Statistic:
    """Return a value with its p."""
    return Statistic(value, 144, p=of)


def label(found: Found, *, turns: bool = False) -> str:
    """Return the calibrated label."""
    return calibrated_rules(found, turns=turns)[0].label


def test_the_statistics_by_hand_earn_their_labels() -> None:
    """Without this, no boundary below would be one."""
    assert label(reader()) == "depth"
    assert label(reader(), turns=True) == "depth_lateral"
    assert label(older(), turns=True) == "depth_associated"
    assert label(blind()) == "image_invariant"
    assert label(nothing_known()) == "undecided"
    assert label(nothing_known() | {"unparsed_reference": SILENT}) == "undecided"


@pytest.mark.parametrize(
    ("change", "holds", "fails", "otherwise"),
    [
        ("depth_interventional", p(JUST_BELOW), p(0.01), "undecided"),
        ("depth_interventional", p(JUST_BELOW), p(0.05), "undecided"),
        ("depth_net", most(0.10), most(0.0999999), "content"),
        ("lane_net", most(0.10), most(0.0999999), "content"),
        ("unparsed_reference", share(0.05), share(0.0500001), "not_scorable"),
        ("unparsed_controls", least(0.05), least(0.0500001), "depth_associated"),
    ],
)
def test_depth_holds_up_to_each_threshold_and_no_further(
    change: str, holds: Statistic, fails: Statistic, otherwise: str
) -> None:
    """One condition is moved across its threshold; the others hold well. The rest: tests/test_depth_rules.py."""
    assert label(reader(**{change: holds})) == "depth"
    found, _ = calibrated_rules(reader(**{change: fails}), turns=True)
    assert found.label == otherwise
    if otherwise == "content":
        assert found.decided_by == change


def test_what_follows_the_file_is_not_associated_either() -> None:
    """At one percent; pictures along the range have a test of their own."""
    assert label(older(repeat_over_nudged=p(0.01))) == "depth_associated"
    assert label(older(repeat_over_nudged=p(JUST_BELOW))) == "undecided"
    assert label(reader(repeat_over_nudged=p(JUST_BELOW))) == "depth"


def test_the_first_condition_that_fails_is_named() -> None:
    """In the order of the rules."""
    order = {
        "depth_net": most(0.05),
        "sensitivity": Statistic(0.0, 144, (-0.1, 0.1)),
        "specificity": Statistic(0.3, 144, (0.2, 0.4)),
        "order": Statistic(0.3, 144, (0.2, 0.4)),
        "rise": p(LOW),
    }
    while order:
        first = next(iter(order))
        found, _ = calibrated_rules(reader(**order), turns=False)
        assert (found.label, found.decided_by) == ("content", first)
        order.pop(first)


def test_braking_that_was_only_watched_is_associated() -> None:
    """Without moved pictures the observational test decides, at the same level, and earns no authority."""
    watched = nothing_known() | {"depth_observational": p(JUST_BELOW)}
    assert label(watched, turns=True) == "depth_associated"
    assert label(watched | {"depth_observational": p(0.01)}) == "undecided"
    assert label(watched | {"depth_interventional": p(HIGH)}) == "undecided"
    assert label(watched | {"repeat_over_nudged": p(LOW)}) == "undecided"


def test_the_grade_of_evidence_is_what_was_moved() -> None:
    """Controls, the lead alone, nothing, or no test at all."""
    nothing = nothing_known()
    assert grade(nothing) == "none"
    assert grade(nothing | {"depth_observational": p(HIGH)}) == "observational"
    assert grade(nothing | {"depth_observational": p(LOW), "depth_interventional": p(HIGH)}) == "interventional"
    assert grade(reader()) == grade(older()) == "controlled"
    assert calibrated_rules(reader(), turns=False)[1] == "controlled"


@pytest.mark.parametrize("kind", ["shuffled", "recoloured", "lead_absent"])
def test_content_is_shown_at_one_percent_over_its_three_tests(kind: str) -> None:
    """Holm over three, and the same against the invisible change where that was asked."""
    name, nudged = f"content_{kind}", f"content_nudged_{kind}"
    assert label(blind(**{name: p(JUST_BELOW / 3)})) == "content"
    assert label(blind(**{name: p(0.01 / 3)})) == "image_invariant"
    assert label(blind(**{name: p(LOW), nudged: p(JUST_BELOW)})) == "content"
    assert label(blind(**{name: p(LOW), nudged: p(0.01)})) == "image_invariant"


@pytest.mark.parametrize(
    ("change", "holds", "fails"),
    [
        ("self_disagreement", least(0.2000001), least(0.2)),
        ("kappa", Statistic(0.1999999, 144, (0.0, 0.3)), Statistic(0.2, 144, (0.0, 0.3))),
        ("kappa", Statistic(0.1, 144, (0.0, 0.3)), Statistic(0.1, 144, (1e-7, 0.3))),
        ("kappa", Statistic(0.0, 144, (-0.1, 0.1)), Statistic(0.0, 144)),
        ("kappa_pooled", p(JUST_BELOW), p(0.01)),
        ("bound_kappa", p(JUST_BELOW), p(0.01)),
        ("bound_kappa", p(LOW), SILENT),
    ],
)
def test_self_inconsistent_holds_up_to_each_threshold(change: str, holds: Statistic, fails: Statistic) -> None:
    """It disagrees with itself on more than a fifth, and agrees about as often as chance."""
    assert label(coin(**{change: holds})) == "self_inconsistent"
    assert label(coin(**{change: fails})) == "undecided"


def test_a_scene_cue_is_shown_at_one_percent() -> None:
    """After content, and before presence."""
    assert label(blind(scene_cue=p(JUST_BELOW))) == "scene_cue"
    assert label(blind(scene_cue=p(0.01))) == "image_invariant"
    assert label(blind(scene_cue=p(LOW), content_shuffled=p(LOW))) == "content"
    assert label(blind(scene_cue=p(LOW), presence=p(LOW))) == "scene_cue"


BOUNDS = {
    "bound_content_shuffled": 0.01,
    "bound_content_recoloured": 0.01,
    "bound_scene": 0.01,
    "bound_mirrored": 0.05,
    "bound_lead_near": 0.05,
    "bound_lead_far": 0.05,
    "bound_lead_absent": 0.05,
}
PICTURELESS = {"bound_noise": 0.05, "bound_text_only": 0.05}
CLAIMS = {
    "presence_only": ({"presence": p(LOW)}, BOUNDS),
    "refusal_effect": ({"presence_response": p(LOW)}, BOUNDS | PICTURELESS),
    "image_invariant": ({}, BOUNDS | PICTURELESS | {"bound_blank": 0.01}),
}


@pytest.mark.parametrize(("claim", "name"), [(claim, name) for claim, (_, bounds) in CLAIMS.items() for name in bounds])
def test_an_absence_needs_each_of_its_bounds_at_its_level(claim: str, name: str) -> None:
    """The effect is bounded just below the level, and at it no more; what is open is named."""
    shown, bounds = CLAIMS[claim]
    level = bounds[name]
    assert label(blind(**shown, **{name: p(level - 1e-7)})) == claim
    loose = DiscordantPairs(0.05, 144, (-0.02, 0.12), level, b=10, c=3)
    found, _ = calibrated_rules(blind(**shown, **{name: loose}), turns=False)
    assert (found.label, found.decided_by) == ("undecided", name)


@pytest.mark.parametrize("name", PICTURELESS)
def test_presence_asks_no_bound_of_pictures_that_are_none(name: str) -> None:
    """Noise and no picture change whether there is one, which it is said to notice."""
    assert label(blind(presence=p(LOW), **{name: p(HIGH)})) == "presence_only"


def test_presence_and_refusal_are_shown_at_one_percent() -> None:
    """In decisions it is presence, in outputs alone a refusal effect."""
    assert label(blind(presence=p(JUST_BELOW))) == "presence_only"
    assert label(blind(presence=p(0.01))) == "image_invariant"
    assert label(blind(presence_response=p(JUST_BELOW))) == "refusal_effect"
    assert label(blind(presence_response=p(0.01))) == "image_invariant"
    assert label(blind(presence=p(LOW), presence_response=p(LOW))) == "presence_only"


def test_pictures_that_get_another_answer_twice_undo_every_absence() -> None:
    """At one percent."""
    assert label(blind(repeats_together=p(0.01))) == "image_invariant"
    found, _ = calibrated_rules(blind(repeats_together=p(JUST_BELOW)), turns=False)
    assert (found.label, found.decided_by) == ("undecided", "repeats_together")


def test_an_effect_that_is_shown_asks_for_no_more_frames() -> None:
    """From an interval above 0 on; below, the frames that would bound it are named."""
    shown, open_one = (DiscordantPairs(0.05, 144, (low, 0.12), HIGH, b=10, c=3) for low in (1e-7, 0.0))
    assert "frames would" not in calibrated_rules(blind(bound_noise=shown), turns=False)[0].because
    assert "frames would" in calibrated_rules(blind(bound_noise=open_one), turns=False)[0].because


SWAPS = SwapRate(0.9, 40, (0.7, 0.98), 0.001, chance=0.5)
BOTH = {"LEFT": 40, "RIGHT": 40}


def lateral(swap: Statistic = SWAPS, seen: dict[str, int] | None = None, **changes: Statistic) -> str:
    """Return the lateral label."""
    found = nothing_known() | {"mirror_swap_rate": swap} | changes
    return lateral_rules(found, BOTH if seen is None else seen).label


def rate(value: float = 0.9, low: float = 0.7, high: float = 0.98, p_of: float = 0.001) -> SwapRate:
    """Return a swap rate against a chance of one half."""
    return SwapRate(value, 40, (low, high), p_of, chance=0.5)


def test_one_direction_is_told_from_eight_turns_on() -> None:
    """Seven of one direction may be chance; eight of a fair choice are below .008, and one of the other is none."""
    few = rate(0.0, 0.0, 0.6, 1.0)
    assert lateral(few, {"LEFT": 8, "RIGHT": 0}) == "one_sided"
    assert lateral(few, {"LEFT": 7, "RIGHT": 0}) == "no_power"
    assert lateral(few, {"LEFT": 2, "RIGHT": 0}) == "no_power"
    assert lateral(few, {"LEFT": 8, "RIGHT": 1}) == "no_power"
    assert lateral(few, {"LEFT": 0, "RIGHT": 0}) == "no_power"


@pytest.mark.parametrize(
    ("holds", "fails", "otherwise"),
    [
        (rate(0.5, 0.5000001), rate(0.4999999, 0.5000001), "no_power"),
        (rate(low=0.5000001), rate(low=0.5), "no_power"),
        (rate(p_of=JUST_BELOW), rate(p_of=0.01), "no_power"),
    ],
)
def test_swaps_holds_up_to_each_threshold(holds: SwapRate, fails: SwapRate, otherwise: str) -> None:
    """Half of the turns, more than chance, at one percent; and both directions are given."""
    assert lateral(holds) == "swaps"
    assert lateral(fails) == otherwise
    assert lateral(holds, {"LEFT": 3, "RIGHT": 0}) == "no_power"


def test_no_exchange_is_told_from_an_upper_end_below_one_half() -> None:
    """At one half it is open; without turns there is nothing to tell, and without reflections no test."""
    assert lateral(rate(0.3, 0.1, 0.4999999, 1.0)) == "does_not_swap"
    assert lateral(rate(0.3, 0.1, 0.5, 1.0)) == "no_power"
    assert lateral(SwapRate(None, 0)) == "no_power"
    assert lateral(SILENT) == "not_tested"


def test_turns_are_clear_where_both_tests_reject_at_one_percent() -> None:
    """Towards the only clear side, and within each lane; exchange alone earns no lateral authority."""
    good = {"turns_clear": p(JUST_BELOW), "turns_clear_within": p(JUST_BELOW)}
    assert lateral(**good) == "turns_clear"
    for name in good:
        assert lateral(**good | {name: p(0.01)}) == "swaps"
        assert lateral(**good | {name: SILENT}) == "swaps"
    assert lateral(rate(p_of=0.5), **good) == "no_power"
    assert lateral(**good, turns_against=with_p(0.1, LOW)) == "turns_clear"
    assert lateral(**good, turns_against=with_p(0.1000001, LOW)) == "swaps"
    assert lateral(**good, turns_against=with_p(0.5, 0.05)) == "turns_clear"
    assert lateral(**good, turns_against=with_p(0.5, 0.0499999)) == "swaps"
    few = nothing_known() | {"turns_boxed": Statistic(-0.2, 60, (-0.3, -1e-6))}
    assert [name for name in LATERAL if earns_lateral(few, name)] == ["turns_clear"]


@pytest.mark.parametrize(
    ("boxed", "label", "earned"),
    [
        (Statistic(-0.1, 60, (-0.2, -1e-6)), "turns_clear", True),
        (Statistic(-0.1, 60, (-0.2, 0.0)), "turns_clear", False),
        (Statistic(0.1, 60, (0.0, 0.2)), "turns_clear", False),
        (Statistic(0.1, 60, (1e-6, 0.2)), "swaps", False),
        (SILENT, "turns_clear", False),
    ],
)
def test_who_turns_where_no_side_is_clear_earns_nothing_sideways(boxed: Statistic, label: str, earned: bool) -> None:  # noqa: FBT001
    """Bounded below half of the rate with one clear side it earns; surely above it, its turns are not clear."""
    good = {"turns_clear": p(JUST_BELOW), "turns_clear_within": p(JUST_BELOW), "turns_boxed": boxed}
    assert lateral(**good) == label
    assert earns_lateral(nothing_known() | good, label) is earned


def paper(corrected: float | None = LOW, **changes: Statistic) -> str:
    """Return the paper's label of a graded reader whose turns do not swap, some of its statistics replaced."""
    found = {
        "unparsed_rate": share(0.0),
        "cramers_v": Association(0.5, 288, p=LOW, groups=2),
        "cramers_v.decision": p(LOW),
        "clears_floor": share(1.0),
        "idi": share(0.5),
        "noise_floor": share(0.0),
        "obstacle.decision": p(LOW),
        "mutual_information.decision": p(LOW),
        "gap_order": Statistic(10.0, 144),
        "mirror_swap_rate": share(0.1),
    }
    return paper_rules(
        found | {name.replace("__", "."): change for name, change in changes.items()}, {"cramers_v": corrected}
    ).label


@pytest.mark.parametrize(
    ("change", "holds", "fails", "otherwise"),
    [
        ("unparsed_rate", share(0.20), share(0.2000001), "not_scorable"),
        ("unparsed_rate", share(0.0), SILENT, "not_scorable"),
        ("cramers_v__decision", p(0.0499999), p(0.05), "refusal_effect"),
        ("cramers_v__decision", p(LOW), SILENT, "refusal_effect"),
        ("clears_floor", share(1.0), share(0.0), "self_inconsistent"),
        ("clears_floor", share(1.0), SILENT, "self_inconsistent"),
        ("obstacle__decision", p(0.0499999), p(0.05), "presence_only"),
        ("obstacle__decision", p(LOW), SILENT, "presence_only"),
        ("mutual_information__decision", p(0.0499999), p(0.05), "presence_only"),
        ("mutual_information__decision", p(LOW), SILENT, "presence_only"),
        ("gap_order", Statistic(1e-7, 144), Statistic(0.0, 144), "presence_only"),
        ("gap_order", Statistic(1e-7, 144), SILENT, "presence_only"),
        ("mirror_swap_rate", share(0.4999999), share(0.5), "depth_lateral"),
    ],
)
def test_the_papers_rules_hold_up_to_each_threshold(
    change: str, holds: Statistic, fails: Statistic, otherwise: str
) -> None:
    """One statistic is moved across its threshold; the others hold well."""
    assert paper(**{change: holds}) == "depth"
    assert paper(**{change: fails}) == otherwise


def test_the_papers_association_is_tested_at_five_percent_after_correction() -> None:
    """Over at least two conditions; without a corrected p nothing depends on the picture."""
    assert [paper(corrected) for corrected in (0.0499999, 0.05, None)] == [
        "depth",
        "image_invariant",
        "image_invariant",
    ]
    assert paper(cramers_v=Statistic(0.5, 288, p=LOW, detail={"rows": ["real"]})) == "not_scorable"
    assert paper(mirror_swap_rate=SILENT) == "depth"
