"""Admission: the clauses that an estimator has to meet before its scenes may steer.

Source: paper, section Constructive renderer-calibrated controller.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from eyechart.records import to_json_fields
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.rules import Axis, Clause, Rule, compared, there

_LEAST: Mapping[str, tuple[float, str]] = {
    "parse": (0.95, "share of replies that hold an estimate"),
    "close_accuracy": (0.75, "share of frames whose 'close' is right"),
    "balanced_accuracy": (0.75, "mean of sensitivity and specificity of 'close'"),
    "scene_equivariance": (0.65, "share of pairs whose scenes are each other's mirror image"),
    "action_equivariance": (0.75, "share of pairs whose actions are each other's mirror image"),
    "actions": (3, "different actions on the frames"),
    "directional": (2, "decisions for LEFT or RIGHT on the frames"),
}
"""The least value of each statistic that meets its clause, and what that is in words."""

CLAUSES: dict[str, Clause] = {
    name: compared(name, "value", ">=", least, needs=says) for name, (least, says) in _LEAST.items()
}

ADMITS = Axis(
    "admission",
    (
        Rule("not_admitted", says="it fails a clause", broken=tuple(CLAUSES.values())),
        Rule("admission_cannot_be_said", says="not measured", broken=tuple(there(name, "value") for name in CLAUSES)),
        Rule("admitted", "parse", says="it meets every clause"),
    ),
)
"""Whether scenes may steer: the first clause that fails decides, else the first not measured."""


@dataclass(frozen=True, slots=True)
class ClauseResult:
    """A clause and the statistic that it reads of a model.

    ``passes`` is None where the statistic has no value: then no model is admitted.
    """

    clause: Clause
    statistic: Statistic

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        found = {"clause": self.name, "least": self.least, **to_json_fields(self.statistic, "value n ci")}
        return {**found, "outcome": self.outcome}

    @property
    def name(self) -> str:
        """Return the name of the statistic."""
        return self.clause.statistic

    @property
    def least(self) -> float:
        """Return the least value that meets the clause."""
        return _LEAST[self.name][0]

    @property
    def passes(self) -> bool | None:
        """Return whether the value meets the clause."""
        return self.clause.holds({self.name: self.statistic})

    @property
    def outcome(self) -> str:
        """Return whether it passes, in a word."""
        return {True: "pass", False: "fail", None: "cannot say"}[self.passes]

    @property
    def words(self) -> str:
        """Return the value beside the least one, with n; or why there is none."""
        one, least = self.statistic, self.least
        if one.value is None:
            return one.note
        return f"{one.value:.{3 if least < 1 else 0}f}, at least {least:g} (n = {one.n})"


def hold(statistics: Mapping[str, Statistic]) -> tuple[ClauseResult, ...]:
    """Hold every clause against a model's statistics."""
    return tuple(ClauseResult(clause, statistics[name]) for name, clause in CLAUSES.items())
