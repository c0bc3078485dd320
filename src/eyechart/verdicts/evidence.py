"""What a verdict rests on: one model's statistics, and facts on its run."""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from eyechart.frames import Provenance
from eyechart.integrity import Guard
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.early_verdicts import StoppingPoint

DECIDED = "decision"
"""Replies with a decision are counted under this word, others under their reason."""


@dataclass(frozen=True)
class Evidence:
    """One model's statistics by name, and facts on its run.

    ``holm`` maps a test to its p corrected over the run's models; ``replies`` counts, by condition,
    the replies with a decision and those without by their reason. ``directions`` counts the
    directions given to pictures and their reflections. ``gap`` says whether the bank records a gap
    that can be tested, ``absent`` are the conditions that the bank lacks, and ``bank`` is its
    folder. ``planned`` and ``answered`` count calls; ``scope`` is the sentence that limits what the
    run can show. ``part``: a shard, whose controls only the merged run asks. ``made`` says how the
    control pictures were made, and ``run`` is the run's folder.
    """

    model: str
    statistics: Mapping[str, Statistic]
    planned: int
    answered: int
    replies: Mapping[str, Mapping[str, int]]
    guards: tuple[Guard, ...] = ()
    holm: Mapping[str, float | None] = field(default_factory=dict)
    directions: Mapping[str, int] = field(default_factory=dict)
    gap: bool = False
    scenarios: int = 0
    max_tokens: int = 0
    scope: str = ""
    stopped: StoppingPoint | None = None
    absent: tuple[str, ...] = ()
    part: bool = False
    bank: str = "BANK"
    made: Provenance = "rendered"
    run: str = "RUN"

    @property
    def failed(self) -> tuple[Guard, ...]:
        """Return the guards that failed."""
        return tuple(guard for guard in self.guards if guard.holds is False)

    @property
    def is_unfinished(self) -> bool:
        """Return whether calls are still to be made; a run that stopped early is complete."""
        return self.stopped is None and (self.part or self.answered < self.planned)

    def reasons(self, conditions: Collection[str] | None = None) -> dict[str, int]:
        """Count the replies without a decision by reason, in all conditions or in some."""
        names = self.replies if conditions is None else conditions
        found = sum((Counter(self.replies.get(name, {})) for name in names), Counter[str]())
        return {reason: count for reason, count in sorted(found.items()) if reason != DECIDED}


class ScoredRun(Protocol):
    """A scored run whose models can be judged."""

    def evidence(self) -> Mapping[str, Evidence]:
        """Return the evidence on each model."""
