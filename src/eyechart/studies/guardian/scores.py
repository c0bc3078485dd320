"""Score a frozen guardian on other frames, at each operating point, and bound its misses.

Each measure has an interval over episodes. The bound on its misses comes from episodes that neither
its choice nor its score used.
"""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from eyechart.errors import GuardianError
from eyechart.records import to_json_fields
from eyechart.stats.agreement import binary_metrics, rate, selective_metrics
from eyechart.stats.committee_votes import ABSTAIN, CLEAR, HAZARD, MISSING, POINTS, CoveragePoint, risk_coverage
from eyechart.stats.episodes import mean_of_shares, share_over_episodes
from eyechart.stats.paired_tests import mcnemar_exact
from eyechart.stats.risk_bounds import conformal_threshold, episodes_needed, mean_bound, ratio_bound, share_bound
from eyechart.stats.sign_flip import sign_flip_test
from eyechart.stats.statistic import Statistic, not_available
from eyechart.studies.guardian.frozen import FrozenGuardian, shared_frames
from eyechart.studies.guardian.votes import VoteTable, answered, require_both

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
Metrics = Mapping[str, Statistic]
"""Coverage; and over answered frames ``acc``, balanced accuracy, sensitivity, specificity."""


def measure(table: VoteTable, said: Mapping[str, Ints]) -> dict[str, Metrics]:
    """Return the metrics of each set of answers to the frames of a table, shape (frames,) each.

    Shares have the interval of `share_over_episodes`, and balanced accuracy that of
    `mean_of_shares`.
    """
    rows: dict[str, Metrics] = {}
    for name, answer in said.items():
        shares = _counted(_by_episode(table, answer))
        spread = {metric: share_over_episodes(*share) for metric, share in shares.items()}
        spread["bal"] = mean_of_shares(shares["sens"], shares["spec"])
        rows[name] = {metric: _spread(one, spread[metric]) for metric, one in _metrics(table, answer).items()}
    return rows


def _spread(statistic: Statistic, over_episodes: Statistic) -> Statistic:
    """Return a statistic with its interval over episodes."""
    detail = {**(statistic.detail or {}), **(over_episodes.detail or {})}
    note = statistic.note or over_episodes.note
    return replace(statistic, ci=over_episodes.ci, method=over_episodes.method, note=note, detail=detail or None)


def _cells(truth: npt.NDArray[np.bool_], answer: Ints) -> dict[str, npt.NDArray[np.bool_]]:
    return {
        "tp": truth & (answer == HAZARD),
        "fn": truth & (answer == CLEAR),
        "tn": ~truth & (answer == CLEAR),
        "fp": ~truth & (answer == HAZARD),
    }


def _metrics(table: VoteTable, answer: Ints) -> dict[str, Statistic]:
    cells = {name: int(cell.sum()) for name, cell in _cells(table.hazard, answer).items()}
    frames = len(table.frames)
    if sum(cells.values()) < frames:
        return selective_metrics(**cells, n=frames)
    return {"coverage": rate(frames, frames), **binary_metrics(**cells)}


def _by_episode(table: VoteTable, answer: Ints) -> Floats:
    """Return each episode's counts of tp, fn, tn, fp and frames, shape (episodes, 5)."""
    names, group = table.groups()
    cells = [*_cells(table.hazard, answer).values(), np.ones(len(group), dtype=np.bool_)]
    columns = [np.bincount(group[cell], minlength=len(names)) for cell in cells]
    return np.asarray(columns, dtype=np.float64).T


def _counted(sums: Floats) -> dict[str, tuple[Floats, Floats]]:
    """Return for each share its hits and its frames, by episode."""
    tp, fn, tn, fp, frames = sums.T
    return {
        "coverage": (tp + fn + tn + fp, frames),
        "acc": (tp + tn, tp + fn + tn + fp),
        "sens": (tp, tp + fn),
        "spec": (tn, tn + fp),
    }


TARGET = 0.01
"""The rate for which `Bound` states the number of episodes needed."""


ESTIMANDS = {
    "missed_hazard_rate": "share of an episode's hazardous frames called clear, each episode counting alike",
    "missed_hazard_rate_per_frame": "share of all hazardous frames called clear, each frame counting alike",
    "any_miss_in_an_episode": "share of episodes with hazardous frames in which any of them is called clear",
    "conformal": "expected share of a next episode's hazardous frames called clear, each episode counting alike",
}
"""The definition of each bound."""


@dataclass(frozen=True, slots=True)
class Bound:
    """Upper bounds on missed hazards, at ``confidence`` each; `ESTIMANDS` defines each.

    A miss is a hazardous frame with the answer "clear"; an abstention is none. Only episodes with a
    hazardous frame count. ``rate`` bounds the expected share of its hazardous frames that an
    episode misses, with equal weight for every episode. ``frame_rate`` bounds the share of all
    hazardous frames that are missed. It is larger if the misses are in the episodes with most
    hazards.

    ``any_miss`` bounds the probability that an episode has a miss at all. ``needed`` is the number
    of episodes that would bound it by 1 % without a further miss, ``needed_at_best`` that without
    any. ``conformal`` maps a threshold to its conformal risk, which holds in expectation only.
    """

    rate: Statistic
    frame_rate: Statistic
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
        bounds = (self.rate, self.frame_rate, self.any_miss)
        return {
            **{
                name: {**one.as_dict(), "estimand": ESTIMANDS[name]}
                for name, one in zip(ESTIMANDS, bounds, strict=False)
            },
            **to_json_fields(self, "episodes confidence conformal_threshold scope"),
            "episodes_needed_for_one_percent": self.needed,
            "episodes_needed_for_one_percent_without_a_miss": self.needed_at_best,
            "conformal_risk_in_expectation_only": {str(place): one for place, one in enumerate(self.conformal, 1)},
            "conformal_estimand": ESTIMANDS["conformal"],
            "conformal_risk_wanted": self.risk,
        }


def bound(
    frozen: FrozenGuardian,
    table: VoteTable,
    *,
    used: Collection[str] = (),
    scored: VoteTable | None = None,
    confidence: float = 0.95,
    risk: float = 0.05,
) -> Bound:
    """Bound how often a guardian misses, from the episodes of a table.

    ``scored`` is the table of the score; without one, ``used`` names its episodes. Raises
    GuardianError for frames and episodes of the score or of the choice, also renamed ones, because
    a bound from them is not valid; and for an unfinished run. ``risk`` is the target of conformal
    risk control.
    """
    for name, value in (("confidence", confidence), ("risk", risk)):
        if not 0 < value < 1:
            raise GuardianError(f"the {name} must lie between 0 and 1, for example 0.95; got {value}")
    frozen.may_score(table)
    if words := table.unfinished_words(frozen.committee):
        raise GuardianError(f"{words[0]} and cannot be missed hazards: finish the run before you take a bound from it")
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
    counted = [_misses(frozen, table, threshold) for threshold in range(1, frozen.voters + 1)]
    shares = np.stack([missed / hazards for missed, hazards in counted])
    missed, hazards = _misses(frozen, table, None)
    own = missed / hazards
    longest = max(Counter(table.episodes).values(), default=0)
    misses, n = int(np.count_nonzero(own)), len(own)
    threshold, risks = conformal_threshold(shares, risk) if n else (None, ())
    where = frozen.about.bank_name or (frozen.about.bank or "")[:8] or "that these votes are of"
    none = "no episode with a hazardous frame"
    return Bound(
        rate=mean_bound(own, confidence=confidence) if n else not_available(none),
        frame_rate=ratio_bound(missed, hazards, longest, confidence=confidence) if n else not_available(none),
        any_miss=share_bound(misses, n, confidence=confidence) if n else not_available(none),
        episodes=n,
        confidence=confidence,
        needed=episodes_needed(TARGET, misses, confidence=confidence),
        needed_at_best=episodes_needed(TARGET, confidence=confidence),
        conformal=risks,
        conformal_threshold=threshold,
        risk=risk,
        scope=f"valid only for episodes exchangeable with those of bank {where}, drawn independently of one another",
    )


def _misses(frozen: FrozenGuardian, table: VoteTable, threshold: int | None) -> tuple[Ints, Ints]:
    """Return missed hazards and hazards of each episode with any, by the guardian's rule.

    With another threshold, by the two-way rule at that one.
    """
    point = "two_way" if threshold else frozen.point
    answer = answered(table.of(frozen.committee), threshold or frozen.threshold, point)
    names, group = table.groups()
    hazards = np.bincount(group[table.hazard], minlength=len(names))
    missed = np.bincount(group[table.hazard & (answer == CLEAR)], minlength=len(names))
    have = hazards > 0
    return missed[have], hazards[have]


SINGLE = "single"


@dataclass(frozen=True)
class GuardianScore:
    """A guardian's score on frames that did not choose it.

    ``rows`` maps each operating point, and ``single`` for the calibration's best single model, to
    its measures with intervals over episodes. These are coverage, and over answered frames
    accuracy, balanced accuracy, sensitivity and specificity. ``mcnemar`` compares the two-way point
    with the single model, with frames as independent. ``over_episodes`` does so by flipping the
    signs of whole episodes' differences. ``curve`` is the risk–coverage curve.

    ``answers`` holds the guardian's answer to each frame. ``missed`` are hazardous frames that it
    called clear.
    """

    frozen: FrozenGuardian
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
        frozen = self.frozen
        return {
            **to_json_fields(frozen, "committee threshold", guardian=frozen.digest, operating_point=frozen.point),
            "best_single_model": frozen.selection and frozen.selection.single,
            "bank": {"name": frozen.about.bank_name, "fingerprint": frozen.about.bank},
            "frames": len(self.table.frames),
            "episodes": len(set(self.table.episodes)),
            "risk_coverage": [
                {"margin": one.margin, "coverage": one.answered / one.frames, "risk": one.wrong / one.answered}
                for one in self.curve
            ],
            **to_json_fields(
                self, "rows mcnemar answers missed bound warnings", frames_with_missing_votes=self.incomplete
            ),
            "sign_flips_over_episodes": self.over_episodes.as_dict(),
        }


LAX = (
    "eyechart {version} chose this guardian and accepted replies that are no votes today. These contradict "
    "themselves, or have other words around their estimate; choose a guardian again with 'eyechart guardian fit'"
)
WORDS = {HAZARD: "hazard", CLEAR: "clear", ABSTAIN: "abstain"}


def score(
    frozen: FrozenGuardian,
    table: VoteTable,
    *,
    seed: int = 0,
    resamples: int = 5000,
) -> GuardianScore:
    """Score a frozen guardian on every frame of a table.

    Raises GuardianError for a frame that chose it, and for votes of another bank, prompt, view or
    version of a model. Intervals are over episodes. ``resamples`` sign patterns are drawn from
    ``seed`` if there are too many to enumerate.
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
        rows=measure(table, said),
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


def answer_of(frozen: FrozenGuardian, table: VoteTable) -> dict[str, Ints]:
    """Return the guardian's answer to each frame at each operating point."""
    votes = table.of(frozen.committee)
    return {point: answered(votes, frozen.threshold, point) for point in POINTS}


def _warnings(frozen: FrozenGuardian, table: VoteTable) -> tuple[str, ...]:
    assert frozen.selection is not None
    found = table.unfinished_words(tuple({*frozen.committee, frozen.selection.single}))
    found += table.mute_words(frozen.committee)
    shared = sorted(set(frozen.selection.episodes) & set(table.episodes))
    if shared:
        found.append(
            f"{len(shared)} of {len(set(table.episodes))} scored episodes also gave frames that chose the guardian "
            f"({', '.join(shared[:3])}{', …' if len(shared) > 3 else ''}): neighbouring frames resemble each "
            "other, so the score is too good"
        )
    if len(set(table.episodes)) < 2:
        found.append("all frames are of one episode, so there is no interval over episodes")
    if frozen.about.is_lax:
        found.append(LAX.format(version=frozen.made_by))
    if lacking := frozen.about.unrecorded(frozen.committee):
        found.append(f"not recorded, so a change of it cannot be noticed: {', '.join(lacking)}")
    return tuple(found)
