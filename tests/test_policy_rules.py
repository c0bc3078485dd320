"""Rules of policies as rows: they say of random evidences what older rules said, and every clause has three values."""

import json
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from random import Random

import pytest

from evidences import digests
from eyechart.stats.risk_bounds import share_bound
from eyechart.stats.shares import FollowedShare, LogDistance, Share
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.labels import USES
from eyechart.verdicts.policy_rules import INSTRUCTION, STATE, camera_axis
from eyechart.verdicts.policy_verdict import GUARDING, UNGUARDED, reaching
from eyechart.verdicts.rules import Axis, Clause, Reading
from eyechart.verdicts.share_predicates import ShareStatistics, as_read
from policy_evidences import RECORDED, SINGLES, Numbers, is_read_otherwise, label_then, said_of, verdict_of, words_of

OLD: dict[str, list[str]] = json.loads((Path(__file__).parent / "old_rulings_policies.json").read_text("utf-8"))
"""Digests of what the rules said of blocks of 1000 evidences when they were functions and no rows.

Of those that are read otherwise since nothing is said in them: see `CHANGED`.
"""
CHANGED: dict[str, dict[str, dict[str, int]]] = json.loads(
    (Path(__file__).parent / "changed_rulings_policies.json").read_text("utf-8")
)
"""What is said otherwise since, by axis: how many of the recorded evidences are read otherwise, and what labels became.

``first`` counts the labels of the first 1000, ``all`` those of all that are recorded.
"""

VERDICTS = Path(__file__).parents[1] / "src" / "eyechart" / "verdicts"
AXES = (
    camera_axis("cameras", "its cameras", (SINGLES, ())),
    *(camera_axis(single, f"the {single.partition(':')[2]} camera") for single in SINGLES),
    *(STATE, INSTRUCTION, UNGUARDED, GUARDING, reaching("cameras", "picture"), reaching("state", "state")),
)
CLAUSES = tuple(dict.fromkeys(clause for axis in AXES for clause in axis.clauses))


def made(name: str, one: Statistic, numbers: Numbers) -> Statistic:
    """Return a statistic of its kind with further numbers; how many episodes respond is its value."""
    return replace(as_read(name, one), **{key: number for key, number in numbers.items() if key != "k"})  # type: ignore[arg-type]


def said(axis: str, blocks: int) -> Iterator[str]:
    """Yield digests of what is said of random evidences of an axis."""
    return digests(lambda rng: said_of(rng, axis, made), RECORDED[axis], blocks)


@cache
def first_said(axis: str) -> tuple[list[str], int, Counter[str]]:
    """Return what is said of 1,000 evidences of an axis: its digest; how many are read otherwise, and their labels."""
    read, found = 0, Counter[str]()

    def say(rng: Random) -> str:
        nonlocal read
        statistics, verdict = verdict_of(rng, axis, made)
        if is_read_otherwise(statistics):
            read += 1
            found.update(f"{name}: {label_then(one.label)}" for name, one in verdict.axes.items())
        return words_of(statistics, verdict)

    return list(digests(say, RECORDED[axis], 1)), read, found


@pytest.mark.parametrize("axis", RECORDED)
def test_rows_say_what_the_rules_said_before(axis: str) -> None:
    """Label, deciding statistic and sentences of 1,000 random evidences an axis; of 60,000 by `make long-rulings`."""
    assert first_said(axis)[0] == OLD[axis][:1]


@pytest.mark.parametrize("axis", RECORDED)
def test_what_is_said_otherwise_since_is_an_absence_that_was_open(axis: str) -> None:
    """Of 1,000 evidences an axis: labels of which no rule that was changed has a say stay; the others are counted."""
    _, read, found = first_said(axis)
    then, now = Counter(CHANGED[axis]["then"]), Counter(CHANGED[axis]["now"])
    assert read == CHANGED[axis]["read otherwise"]["first"]
    assert found == now
    for label, more in (now - then).items():
        became = label.partition(": ")[2]
        assert USES[became].is_absence or became == "state_shortcut", f"{more} {label}"
    assert {label.partition(": ")[2] for label in then - now} <= {"undecided", "state_used"}


@pytest.mark.parametrize("clause", CLAUSES, ids=lambda one: f"{one.statistic}: {', '.join(map(str, one.readings))}")
def test_every_clause_holds_on_one_side_of_its_threshold(clause: Clause) -> None:
    """Of a statistic without that number each says what it takes it for; of one that there is not, none fails."""
    for reading in clause.readings:
        assert reading.of(_Silent(None, 0)) in {True, False, None}
        if isinstance(reading.threshold, float | int) and reading.holds not in {"there", "missing"}:
            at, above = (_number(reading, by) for by in (0.0, 1e-6))
            assert reading.of(at) is (reading.holds in {"<=", ">="})
            assert reading.of(above) is (reading.holds in {">", ">="})
            assert (~reading).of(at) is not reading.of(at)
    assert clause.holds(ShareStatistics({})) in {True, False, None}


class _Silent(FollowedShare):
    """A statistic of every kind, without any number."""

    offset = spread = None


class _Numbers:
    """A statistic of which every number is the same."""

    def __init__(self, number: float) -> None:
        self._number, self.ci = number, (number, number)

    def __getattr__(self, name: str) -> float:
        return self._number


def _number(reading: Reading, by: float) -> Statistic:
    return _Numbers(float(reading.threshold) + by)  # type: ignore[return-value]


@pytest.mark.parametrize("axis", AXES, ids=lambda axis: f"{axis.name} {axis.rules[0].label}")
def test_an_axis_says_something_of_whatever_there_is(axis: Axis) -> None:
    """Of nothing at all too: the last rule needs nothing."""
    assert axis.rules[-1].needs == axis.rules[-1].broken == ()
    assert all(rule.says for rule in axis.rules)
    nothing = ShareStatistics({"misfit": LogDistance(None, 0), "motions": Share(1.0, 9)}, has_state=True)
    assert axis.evaluate(nothing).label in {"undecided", "no_power", "holds"}


def test_a_statistic_of_another_kind_is_read_as_the_one_that_a_rule_reads() -> None:
    """With what both have; one of the kind, or of a narrower one, stays as it is."""
    bound, followed = share_bound(0, 44, confidence=0.99), FollowedShare(0.6, 72, heading=0.9)
    assert not isinstance(bound, Share)
    read = as_read("responds@cameras", bound)
    assert (read.value, read.n, read.ci, read.episodes) == (bound.value, bound.n, bound.ci, None)
    assert as_read("follow.named", followed) is as_read("T.blank", followed) is followed


@pytest.mark.parametrize("module", sorted(path.stem for path in VERDICTS.glob("*.py")))
def test_no_rule_reads_prose_or_cuts_a_sentence(module: str) -> None:
    """Neither method nor detail; a note and a reason are printed whole, and no part of them is looked for."""
    text = (VERDICTS / f"{module}.py").read_text("utf-8")
    assert "[:-1]" not in text
    assert not re.search(r"(because|reason|note)\)?(\[|\.(partition|split|removeprefix|removesuffix))", text)
    assert ".detail" not in text
    assert ".method" not in text
    assert " in noise.note" not in text
