"""Rules as rows: they say of random evidences what older rules said, and every clause has three values."""

import json
from functools import cache
from pathlib import Path
from random import Random

import pytest

import simulated
from evidences import RECORDED, digests, distance, lateral, paper, ruled
from eyechart.spaces.discrete import DRIVING
from eyechart.stats.association import Association
from eyechart.stats.evalues import EValue
from eyechart.stats.paired_tests import SignTest
from eyechart.stats.statistic import Statistic, not_available
from eyechart.studies.battery.early_stop import QuestionOrder, StoppingState, layout_of
from eyechart.verdicts import calibrated_rules, lateral_rules, paper_rules
from eyechart.verdicts.battery_rules import DISTANCE, LATERAL_AXIS
from eyechart.verdicts.early_verdicts import EARLY, EARLY_LATERAL
from eyechart.verdicts.paper import PAPER
from eyechart.verdicts.rules import Axis, Clause, Reading, Rule, compared, missing, p_below, p_from

OLD: dict[str, list[str]] = json.loads((Path(__file__).parent / "old_rulings.json").read_text("utf-8"))
"""Digests of what the rules said of blocks of 1000 evidences when they were functions and no rows."""

AXES = (DISTANCE, LATERAL_AXIS, PAPER, EARLY, EARLY_LATERAL)


def of_distance(rng: Random) -> str:
    """Return what the calibrated rules say of the next evidence."""
    found, turns = distance(rng), rng.random() < 0.5
    ruling, grade = calibrated_rules(found, turns=turns)
    because = ruling.because.replace("more than 0.05 of its replies to true pictures hold no decision", "above 0.05")
    return ruled(ruling.label, ruling.decided_by, because + grade)


def of_turns(rng: Random) -> str:
    """Return what the lateral rules say of the next evidence."""
    found, seen = lateral(rng)
    ruling = lateral_rules(found | {"turns_boxed": not_available("no moment without a clear side")}, seen)
    earned = ruling.label == "turns_clear" or (
        ruling.label == "swaps" and not isinstance(found["turns_clear"], SignTest)
    )
    return ruled(ruling.label, ruling.decided_by, ruling.because + str(earned))


def of_paper(rng: Random) -> str:
    """Return what the paper's rules say of the next evidence."""
    found, corrected, groups = paper(rng)
    whole = found["cramers_v"]
    found["cramers_v"] = Association(whole.value, whole.n, whole.ci, whole.p, groups=groups)
    ruling = paper_rules(found, {"cramers_v": corrected})
    return ruled(ruling.label, ruling.decided_by, ruling.because)


FRAMES = simulated.frames(scenarios=2, episodes=1, steps=6)
PLAIN = simulated.CONDITIONS[:6]
SHOWN = (
    PLAIN,
    simulated.CONDITIONS,
    (*PLAIN, *simulated.COUNTERFACTUALS),
    (*simulated.CONDITIONS, *simulated.COUNTERFACTUALS, *simulated.ALWAYS),
    (*simulated.CONDITIONS, *simulated.COUNTERFACTUALS, *simulated.RANGED, *simulated.ALWAYS),
    (*(name for name in simulated.CONDITIONS if name != "shuffled"), *simulated.COUNTERFACTUALS),
)
"""The conditions of runs that may stop early."""


@cache
def laid_out(shown: tuple[str, ...]) -> QuestionOrder:
    """Return the layout of a run under these conditions."""
    return layout_of(FRAMES, {frame.id: shown for frame in FRAMES}, DRIVING, 0)


def of_early(rng: Random) -> str:
    """Return what a run that stops early makes of the next claims, each of which is settled or not."""
    course = StoppingState(laid_out(rng.choice(SHOWN)))
    often = rng.choice((0.5, 0.9, 0.97, 1.0))
    for claim in course.claims.values():
        claim.is_settled = rng.random() < often
    for name in ("unscorable", "bound_blank", "presence", "near_far", "no_swaps", "swaps_rate"):
        if name in course.claims and rng.random() < 0.7:
            course.claims[name].is_settled = False
    if "bound_lead_absent" in course.claims:
        course.claims["bound_lead_absent"].is_settled = True  # its walk is behind it
    course.turns = {side: rng.choice((0, 0, 3, 8, 20)) for side in course.turns}
    course.passed, course.frames = 9, rng.choice((5, len(FRAMES)))
    course._judge()
    point = repr(course.stopped(40))
    point = point.replace("StoppingPoint(", "Stopped(").replace("other_claims=", "with_it=")  # as they were called then
    return f"{course.label}\t{course.lateral}\t{point}"


SAID = {"distance": of_distance, "lateral": of_turns, "paper": of_paper, "early": of_early}


@pytest.mark.parametrize("axis", SAID)
def test_rows_say_what_the_rules_said_before(axis: str) -> None:
    """Label, deciding statistic and sentence of 3,000 random evidences an axis; of 60,000 by `make long-rulings`.

    What differs in one of a thousand evidences is missed here with probability .05, and there never.
    """
    assert list(digests(SAID[axis], RECORDED[axis], 3)) == OLD[axis][:3]


@pytest.mark.parametrize("axis", AXES, ids=lambda axis: axis.name)
def test_every_clause_is_three_valued(axis: Axis) -> None:
    """It holds on one side of each threshold and not on the other; of a statistic without numbers it is as declared."""
    for clause in axis.clauses:
        silent = Silent(clause)
        asks = {reading.holds for reading in clause.readings}
        if asks <= {"there", "missing"}:
            assert clause.outcome(silent) is (asks == {"missing"})
        elif not any(reading.otherwise is False for reading in clause.readings):
            assert clause.outcome(silent) is None
            assert clause.holds(silent) is clause.untested
        for reading in clause.readings:
            if isinstance(reading.threshold, float) and reading.holds not in {"there", "missing"}:
                at, beside = (side(reading, by) for by in (0.0, 1e-6))
                assert reading.of(at) is (reading.holds in {"<=", ">="})
                assert reading.of(beside) is (reading.holds in {">", ">="})


class Silent(dict[str, Statistic]):
    """Statistics of which none says anything."""

    def __init__(self, clause: Clause) -> None:
        names = {clause.statistic, *clause.family}
        super().__init__({name: Statistic(None, 0) for name in names})
        if clause.when:
            self.setdefault(clause.when, Statistic(1.0, 1))


def side(reading: Reading, by: float) -> Statistic:
    """Return a statistic whose number is above a threshold by as much."""
    assert isinstance(reading.threshold, float)
    number = reading.threshold + by
    if reading.reads == "settled":
        return EValue(number, 9, p=number, threshold=100.0, alpha=0.01, settled=number >= 1, says="it is so")
    return Statistic(number, 9, (number, number), number)


@pytest.mark.parametrize("axis", AXES, ids=lambda axis: axis.name)
def test_every_rule_names_what_decides_it_and_says_why(axis: Axis) -> None:
    """By its own name or by the clause that is broken; the last rule needs nothing, or has a clause for every gap."""
    for rule in axis.rules:
        assert rule.says
        assert bool(rule.decided_by) != bool(rule.broken)
    assert axis.rules[-1].needs == ()


def test_the_first_rule_that_holds_gives_the_label() -> None:
    """And among what is broken the first decides, or the one with the greatest p where that is asked."""
    found = {"a": Statistic(0.5, 9, p=0.3), "b": Statistic(0.5, 9, p=0.6), "c": Statistic(0.5, 9, p=0.001)}
    both = (p_below("a", 0.01, but="a fails"), p_below("b", 0.01, but="b fails"))
    first = Axis("x", (Rule("not", "", (p_from("c", 0.01),), "no"), Rule("yes", broken=both, says="{but}")))
    assert first.evaluate(found).label == "yes"
    assert first.evaluate(found).decided_by == "a"
    assert first.evaluate(found).because.startswith("a fails: a = 0.500")
    worst = Axis("x", (Rule("yes", broken=both, says="{but}", worst=True),))
    assert worst.evaluate(found).decided_by == "b"
    quiet = Axis("x", (Rule("yes", "c", (compared("c", "value", ">", 0.1),), "c is {value:c}", quiet=True),))
    assert quiet.evaluate(found).because == "c is 0.500"


def test_a_number_that_a_statistic_does_not_have_is_no_condition() -> None:
    """A rule that reads a field by a wrong name is a mistake of ours, and no third value."""
    with pytest.raises(AttributeError):
        compared("a", "no_such_number", ">", 1.0).outcome({"a": Statistic(1.0, 3)})
    assert missing("a", "high").outcome({"a": Statistic(1.0, 3)}) is True
