"""Nested leave-one-episode-out: every episode is judged by a guardian that was chosen on all the others."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eyechart.errors import GuardianError
from eyechart.stats.committee import HAZARD, MISSING, Choice, Costs, answers, select_without_each, tally
from eyechart.stats.resampling import ENUMERATED_MULTISETS
from eyechart.studies.guardian.fitting import LARGEST, require_both, require_votes, require_whole
from eyechart.studies.guardian.measuring import Metrics, measure
from eyechart.studies.guardian.votes import VIEWS, VoteTable


@dataclass(frozen=True)
class Nested:
    """What nested leave-one-episode-out found: the choice of each fold, and the pooled answers of all folds.

    ``folds`` maps the episode that was left out to the models, threshold and operating point that the others chose.
    ``agreed`` counts the folds that chose what most of them did.
    """

    folds: Mapping[str, tuple[tuple[str, ...], int, str]]
    pooled: Metrics
    frames: int
    agreed: int

    def as_dict(self) -> dict[str, object]:
        """Return the result as plain JSON values."""
        return {
            "frames": self.frames,
            "folds": {
                episode: {"committee": list(committee), "threshold": threshold, "operating_point": point}
                for episode, (committee, threshold, point) in self.folds.items()
            },
            "folds_that_chose_alike": self.agreed,
            "pooled": {name: one.as_dict() for name, one in self.pooled.items()},
        }


def nested(
    table: VoteTable,
    *,
    size: int = 2,
    models: Sequence[str] = (),
    costs: Costs | None = None,
    seed: int = 0,
    enumerate_up_to: int = ENUMERATED_MULTISETS,
) -> Nested:
    """Choose a committee on all episodes but one, judge that one, and so for each; selection is inside every fold.

    Raises GuardianError below two episodes, where the others of some episode lack a class, for an unfinished run, and
    where nobody gave a vote.
    """
    names = tuple(sorted(set(models))) or table.models
    if not 1 <= size <= LARGEST or size > len(names):
        raise GuardianError(f"a committee has 1 to {LARGEST} models, of {len(names)} that voted; got {size}")
    require_both(table)
    require_whole(table, names)
    require_votes(table, names)
    episodes, group = table.groups()
    if len(episodes) < 2:
        raise GuardianError(f"{table.name}: all frames are of one episode; leaving one out needs two or more")
    votes = table.of(names)
    try:
        chosen = select_without_each(tally(votes, table.hazard, group, size=size), costs)
    except ValueError as error:
        raise GuardianError(
            f"{table.name}: without one of its episodes a class is empty, so nothing can be chosen"
        ) from error
    said = np.empty(len(table.frames), dtype=np.int64)
    for fold, choice in enumerate(chosen):
        held_out = group == fold
        said[held_out] = _answers(votes[:, held_out], choice)
    folds = {
        episode: (tuple(names[place] for place in choice.committee), choice.threshold, str(choice.point))
        for episode, choice in zip(episodes, chosen, strict=True)
    }
    pooled = measure(table, {"nested": said}, seed=seed, enumerate_up_to=enumerate_up_to)["nested"]
    agreed = Counter(folds.values()).most_common(1)[0][1]
    return Nested(folds, pooled, len(table.frames), agreed)


def _answers(
    votes: "np.ndarray[tuple[int, ...], np.dtype[np.int8]]", choice: Choice
) -> "np.ndarray[tuple[int, ...], np.dtype[np.int64]]":
    own = votes[list(choice.committee)]
    return answers(
        (own == HAZARD).sum(axis=(0, 2)),
        (own == MISSING).sum(axis=(0, 2)),
        voters=len(choice.committee) * len(VIEWS),
        threshold=choice.threshold,
        point=choice.point,
    )
