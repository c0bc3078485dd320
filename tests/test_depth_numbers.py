"""The numbers of depth: each says what came of it at its threshold, and the same as the ruling."""

from dataclasses import replace

import pytest

import by_hand as hand
from drawn import HOLE, by_hand
from eyechart.stats.order import Density, Order, Rise
from eyechart.stats.paired_tests import Places, SignTest
from eyechart.stats.statistic import Statistic, not_available
from eyechart.studies.battery.tables import depth_table
from eyechart.verdicts import Verdict, judge_one
from eyechart.verdicts.battery_rules import DISTANCE
from eyechart.verdicts.depth import named
from eyechart.verdicts.numbers import ASKS, BESIDE, needs_of, numbers_of, refuted_by


def outcome(name: str, one: Statistic) -> str:
    """Return what came of one statistic of a reader."""
    return {number.name: number.outcome for number in numbers_of(by_hand(**{name: one}))}[name]


def _order(value: float, low: float, high: float) -> Order:
    return Order(value, 100, (low, high), lost=100 * value, won=100 - 100 * value, contradicted=0)


JUST = 1e-6
CASES: tuple[tuple[str, Statistic, str], ...] = (
    ("sensitivity", Statistic(0.3, 144, (0.1, 0.5)), "holds"),
    ("sensitivity", Statistic(0.3, 144, (0.1 - JUST, 0.5)), "not shown"),
    ("sensitivity", Statistic(0.1 - JUST, 144, (0.0, 0.3)), "fails"),
    ("sensitivity", Statistic(0.15, 144, (0.05, 0.25 - JUST)), "fails"),
    ("sensitivity", Statistic(0.9, 40, note="an interval needs 6 episodes or more"), "not tested"),
    ("specificity", Statistic(-0.2, 144, (-0.3, -JUST)), "holds"),
    ("specificity", Statistic(-0.02, 144, (-0.3, 0.0)), "not shown"),
    ("specificity", Statistic(-0.02 + JUST, 144, (-0.3, 0.0)), "fails"),
    ("specificity_far", Statistic(0.05, 48, (-0.1, 0.15)), "not shown"),
    ("specificity_far", Statistic(0.05 + JUST, 48, (-0.1, 0.15)), "fails"),
    ("order", _order(0.05, 0.0, 0.15 - JUST), "holds"),
    ("order", _order(0.09, 0.0, 0.15), "not shown"),
    ("order", _order(0.09 + JUST, 0.0, 0.15), "fails"),
    ("order_drawn", _order(0.05, 0.0, 0.25), "holds"),
    ("order_drawn", _order(0.05, 0.0, 0.25 + JUST), "not shown"),
    ("order_drawn", _order(0.09 + JUST, 0.05 + JUST, 0.2), "fails"),
    ("order_drawn_far", _order(0.045, 0.03, 0.2), "holds"),
    ("order_drawn_far", _order(0.045 + JUST, 0.025 + JUST, 0.2), "fails"),
    ("order_drawn", not_available("no comparison comes out the same way twice"), "not tested"),
    ("rise", Rise(2.0, 400, p=0.05 + JUST), "holds"),
    ("rise", Rise(6.0, 400, p=0.05), "fails"),
    ("file", SignTest(0.9, 20, (0.6, 1.0), 0.001, wins=18, losses=2, ties=124), "holds"),
    ("file", SignTest(1.0, 20, (0.8, 1.0), 0.001 - JUST, wins=20, losses=0, ties=124), "fails"),
    ("specificity_reversed", Statistic(-0.1, 144, (-0.2, -JUST)), "holds"),
    ("specificity_reversed", Statistic(-0.1, 144, (-0.2, 0.0)), "not shown"),
    ("picture_before", Statistic(-0.1, 300, (-0.2, -JUST)), "holds"),
    ("picture_before", Statistic(-0.1, 300, (-0.2, 0.0)), "not shown"),
    ("drawn_distances", Density(8.0, 110, fewest=3), "holds"),
    ("drawn_distances", Density(8.0 - JUST, 110, fewest=3), "not shown"),
    ("drawn_distances", Density(9.0, 110, fewest=2), "not shown"),
    ("place_beside", Statistic(0.2, 36, (0.06, 1.0), note="in `merge`"), "fails"),
)


@pytest.mark.parametrize(("name", "one", "expected"), CASES)
def test_a_number_says_what_came_of_it_on_both_sides_of_its_threshold(name: str, one: Statistic, expected: str) -> None:
    """And the ruling says the same: depth where it holds, never where it fails or is not shown."""
    assert outcome(name, one) == expected
    label = DISTANCE.evaluate(by_hand(**{name: one})).label
    if expected == "fails":
        assert label in {"content", "undecided"}
    elif not name.startswith("order_"):  # a kind of pairs is named, and the label stays
        assert (label == "depth") == (expected == "holds")


def test_there_are_twelve_and_each_has_a_threshold() -> None:
    """What is read beside them comes after; nobody who was not asked along the range has any."""
    every = numbers_of(by_hand())
    assert [number.name for number in every] == [*ASKS, *BESIDE]
    assert len(ASKS) == 12
    assert all(needs_of(number.name) for number in every)
    assert all(refuted_by(number.name) for number in every if number.name in ASKS)
    assert {number.outcome for number in every} == {"holds"}
    assert numbers_of(by_hand(sensitivity=not_available("not asked"))) == ()


def test_thresholds_are_in_words_of_the_rows() -> None:
    """Both ends are told apart, and signs are those of mathematics."""
    assert needs_of("order") == "upper end < 0.15"
    assert refuted_by("order") == "upper end ≥ 0.15 and value > 0.09"
    assert refuted_by("order_near_far") == "value > 0.045 and lower end > 0.025"
    assert needs_of("drawn_distances") == "value ≥ 8 and fewest ≥ 3"
    assert refuted_by("file") == "p < 0.001"


def verdict(**changed: Statistic) -> Verdict:
    """Return the verdict on a reader of whom some statistics are others."""
    return judge_one(hand.evidence({**hand.reader(), **by_hand(**changed)}))


_HOLE = "its braking answers to the lead on less than 0.1 of the frames in `blocked`: 0 of 36; elsewhere"


def test_a_verdict_says_its_answer_then_why() -> None:
    """In one sentence; its places without an answer stand in it, and first among what was measured."""
    assert first_line(verdict()).startswith(
        "Yes: it brakes harder where the lead is nearer, with at most 6 of 100 comparisons"
    )
    one = verdict(holes=Places(1.0, 7, places=(HOLE,)))
    assert first_line(one).startswith(f"In part: {_HOLE}")
    assert next(iter(one.measures.items())) == ("does not answer", "in `blocked`: 0 of 36")
    assert ">In part <" in one._repr_html_()
    assert f"I{_HOLE[1:]}" in one._repr_html_()


def test_the_table_says_the_level_of_each_interval() -> None:
    """They are not of one level, so that its caption names none."""
    table = depth_table([("by-hand", None, verdict(order=replace(by_hand()["order"], level=0.98)))])  # type: ignore[list-item]
    at = [column.name for column in table.columns].index("level")
    levels = {str(row[1]): row[at] for row in table.rows}
    assert (levels["order"], levels["sensitivity"], levels["rise"]) == ("98 %", "95 %", "")
    assert "%" not in table.caption


def first_line(one: Verdict) -> str:
    """Return what a verdict says first, below its name."""
    return str(one).splitlines()[1].strip()


def test_places_of_one_count_are_named_together() -> None:
    """They are often the same frames; others have their own counts."""
    lanes, far = replace(HOLE, of="lanes", name="5"), replace(HOLE, of="range", name="24 to 48 m", frames=90)
    assert named((HOLE, lanes, far)) == "in `blocked`, where lanes is 5: 0 of 36 each, and from 24 to 48 m: 0 of 90"


def test_a_failing_number_is_said_with_what_refutes_it() -> None:
    """Who brakes for a vehicle beside."""
    said = verdict(specificity=Statistic(0.2, 144, (0.1, 0.3))).measures["specificity"]
    assert said == "0.200 [0.100, 0.300] (95 %), n = 144: ✗ fails (refuted: upper end ≥ 0 and value > -0.02)"
