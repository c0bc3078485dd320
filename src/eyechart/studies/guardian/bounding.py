"""How often a guardian misses at most, from episodes used neither for its choice nor for its score."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from eyechart.errors import GuardianError
from eyechart.stats.committee import CLEAR
from eyechart.stats.guarantees import conformal_threshold, episodes_needed, mean_bound, share_bound
from eyechart.stats.statistic import Statistic, cannot_say
from eyechart.studies.guardian.frozen import Frozen, shared_frames
from eyechart.studies.guardian.votes import VoteTable, answered

TARGET = 0.01
"""The rate for which the number of episodes that would be needed is said."""


@dataclass(frozen=True, slots=True)
class Bound:
    """Upper bounds on missed hazards, at ``confidence`` each.

    A miss is a hazardous frame that was called clear; what was handed on is none. Only episodes with a hazardous frame
    count. ``rate`` bounds the missed-hazard rate: the expected share of its hazardous frames that an episode has
    missed, every episode counting alike. ``any_miss`` bounds the probability that an episode has a miss at all.
    ``needed`` is how many episodes would bound it by 1 % without one more miss than were seen, and ``needed_at_best``
    without any. ``conformal`` maps a threshold to its conformal risk, which holds in expectation only.
    """

    rate: Statistic
    any_miss: Statistic
    episodes: int
    confidence: float
    needed: int
    needed_at_best: int
    conformal: tuple[float, ...]
    conformal_threshold: int | None
    risk: float
    scope: str

    def as_dict(self) -> dict[str, object]:
        """Return the bound as plain JSON values."""
        return {
            "missed_hazard_rate": self.rate.as_dict(),
            "any_miss_in_an_episode": self.any_miss.as_dict(),
            "episodes": self.episodes,
            "confidence": self.confidence,
            "episodes_needed_for_one_percent": self.needed,
            "episodes_needed_for_one_percent_without_a_miss": self.needed_at_best,
            "conformal_risk_in_expectation_only": {str(place): one for place, one in enumerate(self.conformal, 1)},
            "conformal_threshold": self.conformal_threshold,
            "conformal_risk_wanted": self.risk,
            "scope": self.scope,
        }


def bound(
    frozen: Frozen,
    table: VoteTable,
    *,
    used: Collection[str] = (),
    scored: VoteTable | None = None,
    confidence: float = 0.95,
    risk: float = 0.05,
) -> Bound:
    """Bound how often a guardian misses, from the episodes of a table.

    ``scored`` is the table of the score and ``used`` names its episodes where there is none; its frames and episodes
    and those that chose the guardian are refused with a GuardianError, for a bound on them would not hold, also where
    episodes or frames were renamed. So is a run that is not finished. ``risk`` is what conformal risk control
    is asked for.
    """
    for name, value in (("confidence", confidence), ("risk", risk)):
        if not 0 < value < 1:
            raise GuardianError(f"the {name} must lie between 0 and 1, for example 0.95; got {value}")
    frozen.may_score(table)
    if words := table.unfinished_words(frozen.committee):
        raise GuardianError(f"{words[0]} and could not be missed hazards: finish it before a bound is taken from it")
    seen = set(frozen.selection.episodes) if frozen.selection else set()
    spent = {*used, *(scored.episodes if scored is not None else ())}
    for what, names in (("chose this guardian", seen), ("is scored", spent)):
        if shared := sorted(names & set(table.episodes)):
            raise GuardianError(
                f"episode '{shared[0]}' {what}, so no bound can come from it: give episodes of their own"
            )
    if scored is not None:
        for frame, known, how in shared_frames(table, scored.frames, scored.pictures or ()):
            raise GuardianError(
                f"frame '{frame}' in {table.name} {how} '{known}', which is scored, so no bound can come from it: give "
                "frames of their own"
            )
    shares = np.stack([_shares(frozen, table, threshold) for threshold in range(1, frozen.voters + 1)])
    own = _shares(frozen, table, None)
    misses, n = int(np.count_nonzero(own)), len(own)
    threshold, risks = conformal_threshold(shares, risk) if n else (None, ())
    where = frozen.about.bank_name or (frozen.about.bank or "")[:8] or "that these votes are of"
    none = "no episode with a hazardous frame"
    return Bound(
        rate=mean_bound(own, confidence=confidence) if n else cannot_say(none),
        any_miss=share_bound(misses, n, confidence=confidence) if n else cannot_say(none),
        episodes=n,
        confidence=confidence,
        needed=episodes_needed(TARGET, misses, confidence=confidence),
        needed_at_best=episodes_needed(TARGET, confidence=confidence),
        conformal=risks,
        conformal_threshold=threshold,
        risk=risk,
        scope=f"valid only for episodes exchangeable with those of bank {where}, drawn independently of one another",
    )


def _shares(frozen: Frozen, table: VoteTable, threshold: int | None) -> npt.NDArray[np.float64]:
    """Return the share of missed hazards of each episode that has any, at the guardian's rule or two-way at another."""
    point = "two_way" if threshold else frozen.point
    answer = answered(table.of(frozen.committee), threshold or frozen.threshold, point)
    names, group = table.groups()
    hazards = np.bincount(group[table.hazard], minlength=len(names))
    missed = np.bincount(group[table.hazard & (answer == CLEAR)], minlength=len(names))
    have = hazards > 0
    return np.asarray(missed[have] / hazards[have], dtype=np.float64)
