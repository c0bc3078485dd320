"""The rules of depth: each clause on both sides of its threshold, what is not tested, and what is said."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import by_hand as hand
from drawn import HOLE, answered, by_hand, found_of, grades
from eyechart.conditions import ABSENT, AGAIN, RANGED
from eyechart.errors import SpecError
from eyechart.gate import hold
from eyechart.stats.order import Density, Order, Rise
from eyechart.stats.paired_tests import Places, SignTest
from eyechart.stats.statistic import Statistic, not_available
from eyechart.studies.battery.depth import NAMES
from eyechart.verdicts import LABELS, Evidence, Verdict, controls_wanted, judge_one
from eyechart.verdicts.battery_rules import DISTANCE
from eyechart.verdicts.depth import (
    DOSE,
    EXCHANGE,
    KINDS,
    NUDGED,
    REFUTING,
    SHOWN,
    THIRDS,
    is_refuted,
    open_kinds,
)
from eyechart.verdicts.rules import Clause
from eyechart.verdicts.ruling import Ruling
from eyechart.verdicts.why_not import why_not


def ruled(**changed: Statistic) -> Ruling:
    """Return the ruling of a reader with some statistics changed."""
    return DISTANCE.evaluate(by_hand(**changed))


def _order(value: float, low: float, high: float) -> Order:
    return Order(value, 100, (low, high), lost=100 * value, won=100 - 100 * value, contradicted=0)


def test_a_reader_is_told_its_bound() -> None:
    """The sentence has the upper end, rounded away from the claim."""
    ruling = ruled(order=_order(0.02, 0.0, 0.0801))
    assert ruling.label == "depth"
    expected = "it brakes harder where the lead is nearer, with at most 9 of 100 comparisons the wrong way round"
    assert str(ruling.reason) == f"{expected} (bound of 95 %)"
    assert "at most 8 of" in str(ruled(order=_order(0.02, 0.0, 0.08)).reason)


BELOW, AT, OVER = -1e-6, 0.0, 1e-6
OPEN = ("depth_associated", "depth_interventional")
CASES: dict[str, tuple[dict[str, Statistic], str, str]] = {
    "near over far within the margin": ({"depth_net": Statistic(0.05, 144, (0.01, 0.1))}, "depth", "order"),
    "near over far bounded below it": (
        {"depth_net": Statistic(0.05, 144, (0.01, 0.1 + BELOW))},
        "content",
        "depth_net",
    ),
    "an exchange within the margin": ({"lane_net": Statistic(0.05, 144, (0.01, 0.1))}, "depth", "order"),
    "an exchange bounded below it": ({"lane_net": Statistic(0.05, 144, (0.01, 0.1 + BELOW))}, "content", "lane_net"),
    "sensitivity at the margin": ({"sensitivity": Statistic(0.3, 144, (0.1, 0.5))}, "depth", "order"),
    "sensitivity is not shown": (
        {"sensitivity": Statistic(0.3, 144, (0.1 + BELOW, 0.5))},
        *OPEN,
    ),
    "sensitivity not shown, its bound just high enough": (
        {"sensitivity": Statistic(0.15, 144, (0.05, 0.25))},
        *OPEN,
    ),
    "sensitivity bounded below a quarter": (
        {"sensitivity": Statistic(0.15, 144, (0.05, 0.25 + BELOW))},
        "content",
        "sensitivity",
    ),
    "a small sensitivity": ({"sensitivity": Statistic(0.1 + BELOW, 144, (0.0, 0.3))}, "content", "sensitivity"),
    "specificity bounded below none": ({"specificity": Statistic(-0.1, 144, (-0.2, BELOW))}, "depth", "order"),
    "specificity is not shown": (
        {"specificity": Statistic(-0.02, 144, (-0.1, 0.0))},
        *OPEN,
    ),
    "a neighbour does as much as half": (
        {"specificity": Statistic(-0.02 + OVER, 144, (-0.1, 0.0))},
        "content",
        "specificity",
    ),
    "a third within its margin": ({"specificity_far": Statistic(0.06, 48, (0.0, 0.15 + BELOW))}, "depth", "order"),
    "a third that is not shown": (
        {"specificity_far": Statistic(0.05, 48, (-0.1, 0.15))},
        *OPEN,
    ),
    "a third in which a neighbour does as much": (
        {"specificity_far": Statistic(0.05 + OVER, 48, (-0.1, 0.15))},
        "content",
        "specificity_far",
    ),
    "order bounded": ({"order": _order(0.12, 0.05, 0.15 + BELOW)}, "depth", "order"),
    "order is not shown": ({"order": _order(0.09, 0.05, 0.15)}, *OPEN),
    "order is refuted": ({"order": _order(0.09 + OVER, 0.05, 0.15)}, "content", "order"),
    "a kind of pairs on the edge": ({"order_drawn": _order(0.09, 0.06, 0.2)}, "depth", "order"),
    "a kind of pairs not surely": ({"order_drawn": _order(0.2, 0.05, 0.3)}, "depth", "order"),
    "a kind of pairs surely": ({"order_drawn": _order(0.09 + OVER, 0.05 + OVER, 0.2)}, "content", "order_drawn"),
    "pairs with far on the edge": ({"order_drawn_far": _order(0.045, 0.03, 0.1)}, "depth", "order"),
    "pairs with far not surely": ({"order_near_far": _order(0.1, 0.025, 0.2)}, "depth", "order"),
    "pairs with far surely": (
        {"order_drawn_far": _order(0.045 + OVER, 0.025 + OVER, 0.1)},
        "content",
        "order_drawn_far",
    ),
    "a rise that is rare enough": ({"rise": Rise(4.0, 400, p=0.05)}, "content", "rise"),
    "a rise that is not": ({"rise": Rise(4.0, 400, p=0.05 + OVER)}, "depth", "order"),
    "it follows the file": (
        {"file": SignTest(1.0, 12, (0.8, 1.0), 0.001 + BELOW, wins=12, losses=0, ties=0)},
        "undecided",
        "file",
    ),
    "it may follow the file": (
        {"file": SignTest(1.0, 12, (0.8, 1.0), 0.001, wins=12, losses=0, ties=0)},
        "depth",
        "order",
    ),
    "unparsed within the cut": ({"unparsed_controls": Statistic(0.1, 144, (0.05, 0.2))}, "depth", "order"),
    "unparsed beyond it": (
        {"unparsed_controls": Statistic(0.1, 144, (0.05 + OVER, 0.2))},
        *OPEN,
    ),
    "a vehicle beside hardly keeps it from braking": (
        {"specificity_reversed": Statistic(-0.1, 144, (-0.2, BELOW))},
        "depth",
        "order",
    ),
    "a vehicle beside may keep it from braking": (
        {"specificity_reversed": Statistic(-0.1, 144, (-0.2, 0.0))},
        *OPEN,
    ),
    "the picture before does less than half": (
        {"picture_before": Statistic(-0.1, 300, (-0.2, BELOW))},
        "depth",
        "order",
    ),
    "the picture before may do half": ({"picture_before": Statistic(-0.1, 300, (-0.2, 0.0))}, *OPEN),
    "the order of the calls is not known": ({"picture_before": Statistic(None, 0)}, "depth", "order"),
    "as dense as it takes": ({"drawn_distances": Density(8.0, 110, fewest=3)}, "depth", "order"),
    "less dense": (
        {"drawn_distances": Density(8.0 + BELOW, 110, fewest=3)},
        *OPEN,
    ),
    "dense, but for a gap": (
        {"drawn_distances": Density(20.0, 288, fewest=2)},
        *OPEN,
    ),
    "a place the wrong way round": (
        {"place_reversed": Statistic(0.09 + OVER, 36, (0.05 + OVER, 0.3), note="in `light`")},
        "content",
        "place_reversed",
    ),
    "a place that may be": ({"place_reversed": Statistic(0.09 + OVER, 36, (0.05, 0.3))}, "depth", "order"),
    "a neighbour in a place": (
        {"place_beside": Statistic(0.09 + OVER, 36, (0.05 + OVER, 1.0), note="in `light`")},
        "content",
        "place_beside",
    ),
    "a hole": ({"holes": Places(1.0, 7, places=(HOLE,))}, "partial_depth", "holes"),
    "turns": ({"lateral_earned": Statistic(1.0, 1)}, "depth_lateral", "order"),
}


@pytest.mark.parametrize("case", CASES)
def test_each_clause_decides_at_its_threshold(case: str) -> None:
    """On this side of it one label, on the other side another; the statistic that decides is named."""
    changed, label, decided_by = CASES[case]
    ruling = ruled(**changed)
    assert (ruling.label, ruling.decided_by) == (label, decided_by)


@pytest.mark.parametrize("clause", [*SHOWN, *REFUTING], ids=lambda clause: f"{clause.statistic} {clause.readings[0]}")
def test_what_cannot_be_said_is_neither_shown_nor_refuted(clause: Clause) -> None:
    """A clause has no outcome where its numbers are missing; nothing is called content for want of an answer."""
    silent = {
        clause.statistic: Density(None, 0, fewest=None) if "drawn" in clause.statistic else not_available("nothing")
    }  # type: ignore[arg-type]
    if clause.when:
        silent.setdefault(clause.when, Statistic(1.0, 1))
    assert clause.outcome(silent) is None
    assert ruled(**silent).label in {"depth", "depth_associated"}


NEEDED = ("sensitivity", "specificity", "order", "rise", "file", "drawn_distances")


@pytest.mark.parametrize("name", NEEDED)
def test_depth_is_not_given_for_want_of_an_answer(name: str) -> None:
    """Without one of the five kinds, or distances, it is associated at most."""
    assert ruled(**{name: not_available("nothing")}).label == "depth_associated"


@pytest.mark.parametrize("name", [*(f"specificity_{one}" for one in THIRDS), *(f"order_{kind}" for kind in KINDS)])
def test_a_part_that_no_frame_shows_is_named(name: str) -> None:
    """It is depth, and what is not excluded keeps a gate from being met."""
    found = by_hand(**{name: not_available("nothing")})
    assert DISTANCE.evaluate(found).label == "depth"
    assert len(list(open_kinds(found))) == 1


def test_a_kind_of_pairs_is_named_above_a_quarter() -> None:
    """At .25 it is not."""
    assert not list(open_kinds(by_hand(order_near_far=_order(0.05, 0.0, 0.25))))
    assert list(open_kinds(by_hand(order_near_far=_order(0.05, 0.0, 0.25 + OVER))))


def test_a_place_that_is_neither_shown_nor_a_hole_keeps_depth_back() -> None:
    """None of 18 frames of it brakes, which bounds nothing below the margin; a part of the range is only named."""
    place = replace(HOLE, frames=18, high=0.153, low=-0.153)
    open_ = Places(1.0, 7, note=f"{place.where} (0 of 18)", places=(place,))
    ruling = ruled(place_open=open_)
    assert ruling.label == "depth_associated"
    assert "that it does so in `blocked` (0 of 18) is not shown" in str(ruling.reason)
    far = Places(0.0, 7, places=(replace(place, of="range", name="24 to 49 m"),))
    assert ruled(place_open=far).label == "depth"


def test_a_hole_is_said_first_with_its_counts() -> None:
    """And what holds elsewhere after it."""
    reason = str(ruled(holes=Places(1.0, 7, places=(HOLE,))).reason)
    assert reason == (
        "its braking answers to the lead on less than 0.1 of the frames in `blocked`: 0 of 36; elsewhere it brakes "
        "harder where the lead is nearer, with at most 6 of 100 comparisons the wrong way round (bound of 95 %)"
    )


def test_without_pictures_along_the_range_it_says_how_far_was_tested() -> None:
    """A run of an older bank."""
    silent = {
        name: not_available("") for name in by_hand() if name.startswith(("sens", "spec", "order", "rise", "file"))
    }
    ruling = ruled(**silent, drawn_distances=not_available("beyond 9 m"))
    assert ruling.label == "depth_associated"
    assert "not tested beyond 9 m" in str(ruling.reason)


@pytest.mark.parametrize("known", [True, False])
def test_a_depth_whose_order_of_calls_is_not_known_says_so(*, known: bool) -> None:
    """It neither passes in silence nor is denied; a number that was tested says nothing."""
    one = Statistic(-0.1, 300, (-0.2, -0.05)) if known else not_available("the order is not known")
    verdict = Run(picture_before=one).verdict
    assert verdict.calibrated.label == "depth"
    said = "whether earlier pictures move its braking was not tested, and depth does not say: the order is not known"
    assert (said in verdict.notes) is not known


def test_a_memory_is_settled_by_answers_without_one() -> None:
    """More frames would not settle it."""
    verdict = Run(picture_before=Statistic(0.1, 300, (0.05, 0.2))).verdict
    assert verdict.calibrated.label == "depth_associated"
    assert "that earlier pictures move its braking less than half as much is not shown" in verdict.calibrated.because
    assert verdict.why_not is not None
    assert verdict.why_not.settle == "an answer to each picture of its own: no memory of earlier calls"


def test_what_is_refuted_is_no_matter_of_more_frames() -> None:
    """Only a clause that is refuted refutes."""
    assert is_refuted(by_hand(rise=Rise(4.0, 400, p=0.01)))
    assert not is_refuted(by_hand(sensitivity=Statistic(0.2, 20, (0.0, 0.4))))


def test_a_plain_reader_earns_depth_and_one_behind_a_coin_does_too() -> None:
    """The same statistics, of answers that repeat and of answers that do not."""
    for coin in (0.0, 0.2):
        assert DISTANCE.evaluate(found_of(answered(grades, coin=coin))).label == "depth"


def test_a_coin_does_not_turn_content_into_depth() -> None:
    """Who is the wrong way round on a fifth of the frames stays so behind a coin in 20 and 40 % of the answers."""

    def reversed_on_a_fifth(lead: np.ndarray, beside: np.ndarray, own: np.ndarray) -> np.ndarray:
        right = grades(lead, beside, own)
        return np.where(own < 0.2, 1 - right, right)

    for coin in (0.0, 0.2, 0.4):
        for seed in range(3):
            statistics = found_of(answered(reversed_on_a_fifth, coin=coin, seed=seed))
            assert DISTANCE.evaluate(statistics).label != "depth", coin


def test_who_brakes_for_any_lane_does_not_earn_depth() -> None:
    """A neighbour does as much as the lead, or does from 12 m on."""

    def any_lane(lead: np.ndarray, beside: np.ndarray, own: np.ndarray) -> np.ndarray:
        return grades(np.minimum(lead, beside), beside, own)

    def cone(lead: np.ndarray, beside: np.ndarray, own: np.ndarray) -> np.ndarray:
        return grades(np.where(beside > 12, np.minimum(lead, beside), lead), beside, own)

    for look in (any_lane, cone):
        assert DISTANCE.evaluate(found_of(answered(look))).label == "content"


def test_a_scenario_without_braking_is_named_and_the_rest_holds() -> None:
    """Blind in one scenario of four: the place by name, with counts."""
    moved = answered(grades)
    blind = moved.strata["scenario"] == "blocked"
    moved = replace(moved, levels={name: np.where(blind, 0.0, level) for name, level in moved.levels.items()})
    ruling = DISTANCE.evaluate(found_of(moved))
    assert ruling.label == "partial_depth"
    assert str(ruling.reason).startswith(
        "its braking answers to the lead on less than 0.1 of the frames in `blocked`: 0 of 36;"
    )


def test_the_far_end_of_the_range_without_braking_is_named() -> None:
    """Who brakes below 15 m alone."""

    def near_alone(lead: np.ndarray, beside: np.ndarray, own: np.ndarray) -> np.ndarray:
        del beside, own
        return np.where(lead < 15, 1.0, 0.0)

    ruling = DISTANCE.evaluate(found_of(answered(near_alone)))
    assert ruling.label == "partial_depth"
    assert "of the frames from 23." in str(ruling.reason)


@pytest.mark.parametrize("free", [15.0, 20.0])
def test_a_reader_that_takes_the_far_road_for_free_earns_depth(free: float) -> None:
    """Beyond it nothing answers, but now and then; where the middle of the range does not either, both are holes."""
    rng = np.random.default_rng(7)

    def late(lead: np.ndarray, beside: np.ndarray, own: np.ndarray, limit: float = free) -> np.ndarray:
        del beside, own
        slow = rng.random(lead.shape) < 0.1
        return np.where(slow, 0.5, np.where(lead * np.exp(rng.normal(0, 0.1, lead.shape)) < limit, 1.0, 0.0))

    def with_a_gap(lead: np.ndarray, beside: np.ndarray, own: np.ndarray) -> np.ndarray:
        return np.where((lead > 11.5) & (lead < 23.5), 0.0, np.maximum(late(lead, beside, own), lead < 49))

    for frames in (144, 288):
        assert DISTANCE.evaluate(found_of(answered(late, frames=frames))).label == "depth"
    early = partial(late, limit=9.5)
    moved = answered(early)
    assert DISTANCE.evaluate(found_of(moved)).label == "partial_depth"
    assert [hole.of for hole in moved.holes()] == ["range", "range"]
    assert any(hole.of == "range" for hole in answered(with_a_gap).holes())


def test_a_place_the_wrong_way_round_is_no_hole() -> None:
    """Braking for the farther lead in one scenario is content, and the place is named."""
    moved = answered(grades)
    wrong = moved.strata["scenario"] == "blocked"
    moved = replace(moved, levels={name: np.where(wrong, 1 - level, level) for name, level in moved.levels.items()})
    statistics = found_of(moved)
    assert DISTANCE.evaluate(statistics).label == "content"
    assert "in `blocked`" in statistics["place_reversed"].note


def test_few_frames_earn_no_depth() -> None:
    """A bank of 36 frames leaves holes a factor of 1.2 wide; one of 72 does not."""
    few, more = (DISTANCE.evaluate(found_of(answered(grades, frames=frames))) for frames in (36, 72))
    assert few.label == "depth_associated"
    assert "to see a hole takes 8" in str(few.reason)
    assert more.label == "depth"


class Run:
    """A scored run of one model with statistics by hand."""

    def __init__(self, **changed: Statistic) -> None:
        self._evidence = hand.evidence({**hand.reader(), **by_hand(**changed)})

    def evidence(self) -> dict[str, Evidence]:
        """Return what there is to judge."""
        return {"by hand": self._evidence}

    @property
    def verdict(self) -> Verdict:
        """Return its verdict."""
        return judge_one(self._evidence)


FEW_OUTSIDE = {"sensitivity": Statistic(1.0, 36, note="too few")}
A_HOLE = {"holes": Places(1.0, 7, places=(HOLE,))}
A_RISE = Rise(4.0, 400, p=0.01, nearer=(13.0, 16.0), farther=(16.5, 19.0))
OPEN_KIND = {"order_near_far": _order(0.05, 0.0, 0.3)}


@pytest.mark.parametrize(
    ("changed", "require", "exit_code", "says"),
    [
        ({}, "depth", 0, "at most 6 of 100"),
        ({}, "looks", 0, "depth"),
        ({}, "content", 1, "depth"),
        (A_HOLE, "depth", 1, "of the frames in `blocked`: 0 of 36"),
        (A_HOLE, "looks", 0, "of the frames in `blocked`: 0 of 36"),
        (A_HOLE, "partial_depth", 0, "blocked"),
        (
            OPEN_KIND,
            "depth",
            2,
            "not excluded: that comparisons of near and far distances come out the wrong way round",
        ),
        (OPEN_KIND, "looks", 0, "depth"),
        (
            {"rise": Rise(4.0, 400, p=0.01, nearer=(13.0, 16.0), farther=(16.5, 19.0))},
            "depth",
            1,
            "13-16 m to 16.5-19 m",
        ),
        ({"sensitivity": Statistic(0.2, 20, (0.0, 0.4))}, "depth", 2, "more frames"),
        ({"sensitivity": Statistic(0.2, 20, (0.0, 0.4))}, "looks", 0, "depth_associated"),
        (A_HOLE | FEW_OUTSIDE, "depth", 1, f"than for the far one, but hardly {HOLE.where}: {HOLE.harder} of"),
        (A_HOLE | FEW_OUTSIDE, "depth", 1, "; that it does so on enough frames to matter is not shown (too few)"),
    ],
)
def test_a_gate_reads_the_label_and_what_is_not_excluded(
    changed: dict[str, Statistic], require: str, exit_code: int, says: str
) -> None:
    """A hole fails depth by its name, and is printed where looking is enough; what is open cannot be said."""
    gate = hold(Run(**changed), [require])
    assert gate.exit_code == exit_code
    assert says in gate.checks[0].because


@pytest.mark.parametrize(
    ("order", "exit_code"),
    [
        (_order(0.02, 0.0, 0.05 + BELOW), 0),
        (_order(0.02, 0.0, 0.05), 2),
        (_order(0.08, 0.05, 0.12), 2),
        (_order(0.08, 0.05 + OVER, 0.12), 1),
        (not_available("nothing was asked"), 2),
    ],
)
def test_a_gate_may_ask_for_a_stricter_bound_of_order(order: Statistic, exit_code: int) -> None:
    """It holds below what is required, fails above it, and cannot say between."""
    assert hold(Run(order=order), ["looks"], order=0.05).exit_code == exit_code


def test_a_gate_says_which_comparisons_its_bound_counts() -> None:
    """A bound that is not met does not read as if it were, a hole is left out by name, and what was not asked is so."""
    wide, hole, old = (
        hold(Run(**one), ["looks"], order=0.05).checks[1].because
        for one in (
            {"order": _order(0.02, 0.0, 0.09)},
            A_HOLE,
            dict.fromkeys(NAMES, not_available("no comparison comes out the same way twice")),
        )
    )
    assert wide == "comparisons in the wrong order 0.020 [0.000, 0.090], has to be below 0.05"
    assert hole.endswith("; not counted is where its braking hardly answers: in `blocked`: 0 of 36")
    assert old == (
        "the share of comparisons in the wrong order is not bounded: the pictures along the range were not asked"
    )


@pytest.mark.parametrize("order", [0.0, -0.1, 1.5])
def test_a_bound_of_order_is_a_share(order: float) -> None:
    """Anything else is refused."""
    with pytest.raises(SpecError, match="--order takes a share above 0"):
        hold(Run(), ["depth"], order=order)


def test_a_verdict_says_its_answer_and_its_holes() -> None:
    """Both are in its JSON; what is not excluded is in what it may be trusted with."""
    whole, part, weak = Run().verdict, Run(**A_HOLE).verdict, Run(**OPEN_KIND).verdict
    assert (whole.answer, part.answer) == ("Yes", "In part")
    said = part.as_dict()
    assert said["answer"] == "In part"
    assert [(one["of"], one["name"], one["harder"], one["frames"]) for one in said["holes"]] == [
        ("scenario", "blocked", 0, 36)
    ]
    assert whole.as_dict()["holes"] == []
    assert "What is named as not excluded stays open." in weak.trust
    assert "stays open" not in part.trust
    assert Run(**A_HOLE, **OPEN_KIND).verdict.trust.endswith("What is named as not excluded stays open.")
    assert part.why_not is not None
    assert part.why_not.label == "depth"


@pytest.mark.parametrize("case", CASES)
def test_every_verdict_of_depth_says_why_it_is_no_stronger_one(case: str) -> None:
    """The statistic that keeps it from the next is one of those that it has."""
    verdict = Run(**CASES[case][0]).verdict
    if verdict.calibrated.label != "depth_lateral":
        assert verdict.why_not is not None
        assert verdict.why_not.settle


def test_the_answer_of_every_label_is_declared() -> None:
    """Yes, in part, no; what is not decided is inconclusive."""
    answers = {
        answer: {name for name, label in LABELS.items() if label.answer == answer}
        for answer in ("Yes", "In part", "No")
    }
    assert answers["Yes"] == {"depth", "depth_lateral"}
    assert answers["In part"] == {"partial_depth", "depth_associated", "content"}
    assert answers["No"] == {"scene_cue", "presence_only", "refusal_effect", "image_invariant", "self_inconsistent"}


SUPPLIED = (*RANGED, *EXCHANGE, *DOSE, NUDGED, ABSENT, AGAIN)


def test_the_seven_pictures_are_asked_in_one_stage_after_the_first() -> None:
    """Of whom brakes harder for the near lead, and of nobody else; where a bank lacks one, the older controls are."""
    found = {**hand.reader(), **dict.fromkeys(NAMES, not_available("not asked"))}
    assert controls_wanted(found, supplied=SUPPLIED, conditions_run=()) == RANGED
    assert controls_wanted(found, supplied=SUPPLIED[1:], conditions_run=()) != RANGED
    assert controls_wanted({**found, **by_hand()}, supplied=SUPPLIED, conditions_run=RANGED) == ()
    blind = {**hand.blind(), **dict.fromkeys(NAMES, not_available("not asked"))}
    assert controls_wanted(blind, supplied=SUPPLIED, conditions_run=()) == (ABSENT, AGAIN)


def test_a_file_that_was_not_tested_keeps_from_depth_and_is_named() -> None:
    """All else holds: the label, its sentence and why it is no more say so."""
    found = by_hand(file=not_available("no nudged picture was answered"))
    ruling = DISTANCE.evaluate(found)
    assert ruling.label == "depth_associated"
    assert "whether it follows the file was not tested" in str(ruling.reason)
    kept = why_not(Evidence("m", found, 9, 9, {}), ruling, ruling)
    assert kept is not None
    assert kept.decided_by == "file"
