"""Admission: the clauses that an estimator has to meet before its scenes may steer anything.

Source: paper, section Constructive renderer-calibrated controller. The full battery retains the same gate.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from eyechart.records import Written
from eyechart.stats.statistic import Statistic


@dataclass(frozen=True, slots=True)
class Clause:
    """One clause: the statistic that it reads, the least value that meets it, and what that is in words."""

    statistic: str
    least: float
    says: str


CLAUSES: dict[str, Clause] = {
    "parse": Clause("parse", 0.95, "share of replies that hold an estimate"),
    "close_accuracy": Clause("close_accuracy", 0.75, "share of frames whose 'close' is right"),
    "balanced_accuracy": Clause("balanced_accuracy", 0.75, "mean of sensitivity and specificity of 'close'"),
    "scene_equivariance": Clause(
        "scene_equivariance", 0.65, "share of pairs whose scenes are each other's mirror image"
    ),
    "action_equivariance": Clause(
        "action_equivariance", 0.75, "share of pairs whose actions are each other's mirror image"
    ),
    "actions": Clause("actions", 3, "different actions on the frames"),
    "directional": Clause("directional", 2, "decisions for LEFT or RIGHT on the frames"),
}


@dataclass(frozen=True, slots=True)
class Held(Written):
    """A clause held against a model: the statistic that was read, and whether it meets the clause.

    ``passes`` is None where the statistic cannot say, which admits nobody.
    """

    written = "clause=name clause.least statistic.value statistic.n statistic.ci outcome"

    name: str
    clause: Clause
    statistic: Statistic

    @property
    def passes(self) -> bool | None:
        """Return whether the value is at least what the clause asks for."""
        value = self.statistic.value
        return None if value is None else value >= self.clause.least

    @property
    def outcome(self) -> str:
        """Return the same in a word."""
        return {True: "pass", False: "fail", None: "cannot say"}[self.passes]

    @property
    def words(self) -> str:
        """Return what was found beside what is asked, with its n; or why nothing can be said."""
        one, least = self.statistic, self.clause.least
        if one.value is None:
            return one.note
        return f"{one.value:.{3 if least < 1 else 0}f}, at least {least:g} (n = {one.n})"


def hold(statistics: Mapping[str, Statistic]) -> tuple[Held, ...]:
    """Hold every clause against a model's statistics."""
    return tuple(Held(name, clause, statistics[clause.statistic]) for name, clause in CLAUSES.items())
