"""The numbers that depth rests on, each with the thresholds of the clauses that read it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from eyechart.stats.statistic import Statistic
from eyechart.verdicts.depth import NAMED, NO_FILE, REFUTING, SHOWN, is_drawn
from eyechart.verdicts.rules import Clause, NamedStatistics
from eyechart.verdicts.ruling import figures

Outcome = Literal["holds", "not shown", "fails", "not tested"]

SIGNS: Mapping[Outcome, str] = {"holds": "✓", "not shown": "?", "fails": "✗", "not tested": "–"}
"""The sign of each outcome, for a reader who cannot tell its colour."""

ASKS: Mapping[str, str] = {
    "sensitivity": "on which share of frames it brakes harder for the near lead than for the far one, net",
    "specificity": "what a vehicle beside does to its braking, less half of what the lead does at that distance",
    "specificity_near": "the same in the near third of the range",
    "specificity_middle": "the same in the middle third",
    "specificity_far": "the same in the far third",
    "order": "which share of pairs of distances comes out the wrong way round",
    "order_near_far": "the same, near with far",
    "order_near_drawn": "the same, near with a distance anywhere in the range",
    "order_drawn": "the same, two distances anywhere in the range",
    "order_drawn_far": "the same, a distance anywhere in the range with far",
    "rise": "how much harder it brakes the farther, where along the range it does so most (in standard errors)",
    "file": "whether it follows the file, and not the picture",
}
"""The twelve numbers, and what each asks."""

BESIDE: Mapping[str, str] = {
    "place_reversed": "how much less hard it brakes for the nearer lead, in the place where that is surest",
    "place_beside": "specificity, in the place where it is surest that a vehicle beside matters",
    "specificity_reversed": "how much less hard it brakes for a vehicle beside, less half of what the lead does",
    "picture_before": "what the lead of any of 8 pictures before does to its braking, less half of what the own does",
    "drawn_distances": "how many drawn distances a window a factor of 1.2 wide holds, on average and at fewest",
    "unparsed_controls": "replies to edited pictures that hold no decision",
}
"""What the rules read besides: by place, and how well distance was sampled."""

PHOTOGRAPHS: Mapping[str, str] = {
    "depth_observational": "of pictures that are not rendered: whether braking follows the gap on photographs as taken",
    "patched_excess": "of edited pictures: on which share of frames the edit alone changes a decision, less a repeat",
    "patched_bound": "the same, bounded",
}
"""What the rules read of banks whose control pictures are not rendered."""

FIRST = ("sensitivity", "specificity", "order", "rise", "file")
"""One number of each kind: a verdict prints each in a line."""


@dataclass(frozen=True, slots=True)
class DepthNumber:
    """One number that depth rests on; ``needs`` and ``refuted_by`` are its thresholds in words."""

    name: str
    asks: str
    needs: str
    refuted_by: str
    statistic: Statistic
    outcome: Outcome

    @property
    def threshold(self) -> str:
        """Return what it needs, or what refuted it."""
        return f"refuted: {self.refuted_by}" if self.outcome == "fails" else self.needs

    @property
    def words(self) -> str:
        """Return its value, interval, n, p and outcome in words."""
        one = self.statistic
        if one.value is None and one.p is None:
            return f"{self.outcome} ({one.note})"
        return f"{figures(one)}: {SIGNS[self.outcome]} {self.outcome} ({self.threshold})"


def numbers_of(found: NamedStatistics) -> tuple[DepthNumber, ...]:
    """Return the numbers of a run, none without pictures of the lead along its range."""
    if not is_drawn(found):
        return ()
    return tuple(
        DepthNumber(name, asks, needs_of(name), refuted_by(name), found[name], _outcome(found, name))
        for name, asks in {**ASKS, **BESIDE, **PHOTOGRAPHS}.items()
        if all(clause.applies(found) for clauses in _clauses_of(name) for clause in clauses)
    )


def _clauses_of(name: str) -> tuple[list[Clause], list[Clause]]:
    """Return the clauses that have to be shown of a statistic, and those whose failure refutes."""
    shown, refuting = (*SHOWN, NO_FILE, *NAMED), (*REFUTING, NO_FILE)
    return [one for one in shown if one.statistic == name], [one for one in refuting if one.statistic == name]


def needs_of(name: str) -> str:
    """Return what depth needs of a statistic; for a kind of pairs, what keeps it unnamed."""
    shown, refuting = _clauses_of(name)
    named = ", else named" if any(clause in NAMED for clause in shown) else ""
    return " and ".join(" or ".join(map(str, clause.readings)) for clause in shown or refuting) + named


def refuted_by(name: str) -> str:
    """Return what refutes depth; of the file, what leaves it undecided."""
    refuting = _clauses_of(name)[1]
    return "; or ".join(" and ".join(str(~reading) for reading in clause.readings) for clause in refuting)


def _outcome(found: NamedStatistics, name: str) -> Outcome:
    """Return what came of a statistic: refuted first, then not tested, then not shown."""
    shown, refuting = _clauses_of(name)
    if any(clause.outcome(found) is False for clause in refuting):
        return "fails"
    said = [clause.outcome(found) for clause in shown or refuting]
    if None in said:
        return "not tested"
    return "holds" if all(said) else "not shown"
