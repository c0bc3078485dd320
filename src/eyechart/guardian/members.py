"""Known faults of a guardian's members: missing votes, and failed clauses and guards of a run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from eyechart.records import JsonRecord
from eyechart.studies import structured, study_of
from eyechart.studies.guardian import VIEWS, VoteTable
from eyechart.studies.structured.study import StructuredStudy


@dataclass(frozen=True, slots=True)
class Member(JsonRecord):
    """The record of a committee's member in its run.

    ``missing`` of its ``votes`` on the frames in question are missing; ``reasons`` count why.
    ``contradicting`` counts replies whose gap and ``close`` disagree. ``clauses`` of admission are
    unmet and ``guards`` failed, over all frames of its run.
    """

    model: str
    votes: int
    missing: int
    contradicting: int
    reasons: Mapping[str, int]
    clauses: tuple[str, ...]
    guards: tuple[str, ...]

    @property
    def is_doubtful(self) -> bool:
        """Return whether the member has any known fault."""
        return bool(self.missing or self.clauses or self.guards)

    @property
    def words(self) -> str:
        """Return its faults on one line."""
        why = ", ".join(f"{n} {reason}" for reason, n in self.reasons.items())
        lost = f"{self.missing} of {self.votes} votes are missing" if self.missing else ""
        missing = lost or f"none of {self.votes} votes is missing"
        said = [f"{self.model}: {missing}{f' ({why})' if why else ''}"]
        if self.clauses:
            said.append(f"clauses of admission not met: {', '.join(self.clauses)}")
        if self.guards:
            said.append(f"guards failed: {', '.join(self.guards)}")
        return "; ".join(said)


def members_of(
    committee: Sequence[str], table: VoteTable, runs: Sequence[Path], *, reread: bool = False
) -> tuple[Member, ...]:
    """Return the records of a committee's models that voted in these runs, on a table's frames."""
    scores: dict[str, structured.StructuredScore] = {}
    for run in runs:
        if isinstance(study_of(run), StructuredStudy):
            found = structured.score(run, reread=reread)
            scores.update(dict.fromkeys(found.models, found))
    reasons = {model: table.reasons(model) for model in committee if model in scores}
    return tuple(
        Member(
            model=model,
            votes=len(VIEWS) * len(table.frames),
            missing=table.missing(model),
            contradicting=reasons[model].get("contradicts_itself", 0),
            reasons=reasons[model],
            clauses=tuple(clause.name for clause in scores[model].models[model].clauses if not clause.passes),
            guards=tuple(one.name for one in scores[model].guards[model] if one.holds is False),
        )
        for model in committee
        if model in scores
    )
