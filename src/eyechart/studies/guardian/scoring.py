"""A frozen guardian is scored on frames that it never saw, at each of its operating points."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eyechart.records import plain
from eyechart.stats.committee import ABSTAIN, CLEAR, HAZARD, MISSING, POINTS, CoveragePoint, risk_coverage
from eyechart.stats.flips import sign_flip_test
from eyechart.stats.paired import mcnemar_exact
from eyechart.stats.resampling import ENUMERATED_MULTISETS
from eyechart.stats.statistic import Statistic
from eyechart.studies.guardian.bounding import Bound
from eyechart.studies.guardian.fitting import require_both
from eyechart.studies.guardian.frozen import Frozen
from eyechart.studies.guardian.measuring import Ints, Metrics, measure
from eyechart.studies.guardian.votes import VoteTable, answered

SINGLE = "single"


@dataclass(frozen=True)
class GuardianScore:
    """What a guardian is worth on frames that it never saw.

    ``rows`` maps each operating point, and ``single`` for the best single model of the calibration, to its coverage,
    accuracy, balanced accuracy, sensitivity and specificity over the frames that were answered, each with an interval
    over episodes. ``mcnemar`` compares the two-way point with the single model, frames taken as independent, and
    ``over_episodes`` does so by flipping the signs of whole episodes' differences in right answers; ``curve`` is the
    risk–coverage curve. ``answers`` holds the guardian's own answer to each frame, ``missed`` the hazardous frames that
    it called clear.
    """

    frozen: Frozen
    table: VoteTable
    rows: Mapping[str, Metrics]
    mcnemar: Statistic
    over_episodes: Statistic
    curve: tuple[CoveragePoint, ...]
    answers: Mapping[str, str]
    missed: tuple[str, ...]
    incomplete: int
    warnings: tuple[str, ...]
    bound: Bound | None = None

    def as_dict(self) -> dict[str, object]:
        """Return the score as plain JSON values."""
        chosen = self.frozen.selection
        return {
            "guardian": self.frozen.digest,
            "committee": list(self.frozen.committee),
            "threshold": self.frozen.threshold,
            "operating_point": self.frozen.point,
            "best_single_model": None if chosen is None else chosen.single,
            "bank": {"name": self.frozen.about.bank_name, "fingerprint": self.frozen.about.bank},
            "frames": len(self.table.frames),
            "episodes": len(set(self.table.episodes)),
            "rows": plain(self.rows),
            "mcnemar": self.mcnemar.as_dict(),
            "sign_flips_over_episodes": self.over_episodes.as_dict(),
            "risk_coverage": [
                {"margin": one.margin, "coverage": one.answered / one.frames, "risk": one.wrong / one.answered}
                for one in self.curve
            ],
            "answers": dict(self.answers),
            "missed": list(self.missed),
            "frames_with_missing_votes": self.incomplete,
            "bound": plain(self.bound),
            "warnings": list(self.warnings),
        }


WORDS = {HAZARD: "hazard", CLEAR: "clear", ABSTAIN: "abstain"}


def score(
    frozen: Frozen,
    table: VoteTable,
    *,
    seed: int = 0,
    resamples: int = 5000,
    enumerate_up_to: int = ENUMERATED_MULTISETS,
) -> GuardianScore:
    """Score a frozen guardian on every frame of a table.

    Raises GuardianError for a frame that chose it, and for votes of another bank, prompt, view or version of a model.
    Intervals are of resampled episodes, all of them enumerated up to 12 episodes and else ``resamples`` drawn from
    ``seed``.
    """
    frozen.may_score(table)
    assert frozen.selection is not None
    require_both(table)
    said = answer_of(frozen, table)
    alone = table.of([frozen.selection.single])[0, :, 0]
    said[SINGLE] = np.where(alone == MISSING, ABSTAIN, alone.astype(np.int64))
    two_way, single = ((said[name] == table.hazard) for name in ("two_way", SINGLE))
    names, group = table.groups()
    right = [np.bincount(group, weights=one, minlength=len(names)) for one in (two_way, single)]
    votes = table.of(frozen.committee)
    hazard_votes = (votes == HAZARD).sum(axis=(0, 2))
    own = said[frozen.point]
    return GuardianScore(
        frozen=frozen,
        table=table,
        rows=measure(table, said, seed=seed, resamples=resamples, enumerate_up_to=enumerate_up_to),
        mcnemar=mcnemar_exact(int((two_way & ~single).sum()), int((single & ~two_way).sum())),
        over_episodes=sign_flip_test(*right, seed=seed, resamples=resamples),
        curve=tuple(risk_coverage(hazard_votes, said["two_way"], table.hazard, voters=frozen.voters)),
        answers={frame: WORDS[int(one)] for frame, one in zip(table.frames, own, strict=True)},
        missed=tuple(
            frame for frame, one, truth in zip(table.frames, own, table.hazard, strict=True) if truth and one == CLEAR
        ),
        incomplete=int(np.count_nonzero((votes == MISSING).any(axis=(0, 2)))),
        warnings=_warnings(frozen, table),
    )


def answer_of(frozen: Frozen, table: VoteTable) -> dict[str, Ints]:
    """Return what the guardian answers to each frame at each operating point."""
    votes = table.of(frozen.committee)
    return {point: answered(votes, frozen.threshold, point) for point in POINTS}


def _warnings(frozen: Frozen, table: VoteTable) -> tuple[str, ...]:
    assert frozen.selection is not None
    found = table.unfinished_words(tuple({*frozen.committee, frozen.selection.single}))
    shared = sorted(set(frozen.selection.episodes) & set(table.episodes))
    if shared:
        found.append(
            f"{len(shared)} of {len(set(table.episodes))} scored episodes also gave frames that chose the guardian "
            f"({', '.join(shared[:3])}{', …' if len(shared) > 3 else ''}): neighbouring frames are alike, so the score "
            "flatters"
        )
    if len(set(table.episodes)) < 2:
        found.append("all frames are of one episode: no interval over episodes can be given")
    if lacking := frozen.about.unrecorded(frozen.committee):
        found.append(f"not recorded, so that a change of it would not be found: {', '.join(lacking)}")
    return tuple(found)
