"""What a verdict rests on: one model's statistics, and what its run was."""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from eyechart.integrity import Guard
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.early import Stopped

DECIDED = "decision"
"""What a reply with a decision is counted under; others are counted under the reason why they hold none."""


@dataclass(frozen=True)
class Evidence:
    """One model's statistics by name, with what else a verdict or a gate says of its run.

    ``holm`` maps a test to its p corrected over the run's models; ``replies`` counts, by condition, the replies with a
    decision and those without by their reason; ``directions`` how often each direction was given to pictures and their
    reflections. ``gap`` says whether the bank records a gap that can be tested, and ``scenarios`` counts its scenarios.
    ``planned`` and ``answered`` count calls; ``scope`` is the sentence that bounds what the run can show. ``absent``
    are the conditions that no frame of the bank can be shown under. ``part`` says that it is a shard of a run that
    asks controls: only the merged run, resumed, asks these. ``bank`` is the folder of the bank, as the run says.
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
    stopped: Stopped | None = None
    absent: tuple[str, ...] = ()
    part: bool = False
    bank: str = "BANK"

    @property
    def failed(self) -> tuple[Guard, ...]:
        """Return the guards that say that the run itself is not to be believed."""
        return tuple(guard for guard in self.guards if guard.holds is False)

    @property
    def unfinished(self) -> bool:
        """Return whether calls are still to be made, of a shard by the merged run; one that stopped is complete."""
        return self.stopped is None and (self.part or self.answered < self.planned)

    def reasons(self, conditions: Collection[str] | None = None) -> dict[str, int]:
        """Return how many replies hold no decision, by the reason, in all conditions or in some."""
        names = self.replies if conditions is None else conditions
        found = sum((Counter(self.replies.get(name, {})) for name in names), Counter[str]())
        return {reason: count for reason, count in sorted(found.items()) if reason != DECIDED}


class Scored(Protocol):
    """A scored run whose models can be judged, or held to requirements."""

    def evidence(self) -> Mapping[str, Evidence]:
        """Return what there is to judge of each model."""
