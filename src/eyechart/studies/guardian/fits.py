"""Choose a guardian on calibration frames and freeze it; or nested, leaving each episode out."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eyechart.errors import GuardianError, suggestion
from eyechart.records import to_json_fields
from eyechart.stats.committee_votes import MISSING, POINTS, Costs, Point, select, select_without_each, tally
from eyechart.studies.guardian.frozen import FrozenGuardian, Selection
from eyechart.studies.guardian.scores import Metrics, measure
from eyechart.studies.guardian.votes import VIEWS, VoteTable, answered, require_both

LARGEST = 4
"""Models of the largest committee."""


def fit(
    table: VoteTable,
    *,
    size: int = 2,
    models: Sequence[str] = (),
    point: Point | None = None,
    costs: Costs | None = None,
) -> FrozenGuardian:
    """Choose a committee of ``size`` models and a threshold on a table's frames, and freeze them.

    ``models`` limits the candidates. ``point`` is the operating point, two-way by default;
    ``costs`` with a price of abstention choose it too. `TIE_BREAKS` gives the order of ties. Raises
    GuardianError if a class is absent, models are too few, a run is unfinished, or no model voted.
    """
    names = _candidates(table, size, models)
    if point is not None and costs is not None and costs.abstention is not None:
        raise GuardianError("with a cost of abstention the costs choose the operating point: leave out --point")
    _require_ready(table, names)
    votes, whole = table.of(names), np.zeros(len(table.frames), dtype=np.int64)
    found = tally(votes, table.hazard, whole, size=size)
    best = select(found, costs)
    single = select(tally(votes[:, :, :1], table.hazard, whole, size=1))
    alone = names[single.committee[0]]
    committee = tuple(names[place] for place in best.committee)
    points = len(POINTS) if costs is not None and costs.abstention is not None else 1
    return FrozenGuardian(
        committee=committee,
        threshold=best.threshold,
        point=point or best.point,
        about=table.about.only({*committee, alone}),
        selection=Selection(
            frames=table.frames,
            episodes=tuple(sorted(set(table.episodes))),
            pictures=table.pictures or (),
            candidates=len(found.committees) * size * len(VIEWS) * points,
            worth=best.worth,
            single=alone,
            costs=costs,
        ),
    )


def read_point(name: str | None) -> Point | None:
    """Return the operating point of this name; raises GuardianError for an unknown one."""
    if name is not None and name not in POINTS:
        raise GuardianError(f"--point is one of {', '.join(POINTS)}, not '{name}'{suggestion(name, POINTS)}")
    return next((point for point in POINTS if point == name), None)


def _candidates(table: VoteTable, size: int, models: Sequence[str]) -> tuple[str, ...]:
    names = tuple(sorted(set(models))) or table.models
    if not 1 <= size <= LARGEST or size > len(names):
        raise GuardianError(f"a committee has 1 to {LARGEST} models, of {len(names)} that voted; got {size}")
    return names


def _require_ready(table: VoteTable, models: Sequence[str]) -> None:
    """Raise GuardianError unless a table has both classes, a finished run, and a vote."""
    require_both(table)
    if words := table.unfinished_words(models):
        raise GuardianError(f"{words[0]}; finish it, or name the finished models with --model")
    if (table.of(models) == MISSING).all():
        raise GuardianError(
            f"{table.name}: no vote by {', '.join(models)} on any of {len(table.frames)} frames, so nothing can be "
            "chosen; for votes from scene estimates, 'eyechart score' counts the reasons"
        )


@dataclass(frozen=True)
class NestedFit:
    """Nested leave-one-episode-out: the choice of each fold, and the pooled answers of all folds.

    ``folds`` maps the left-out episode to the models, threshold and operating point chosen without
    it. ``agreed`` counts the folds with the most frequent choice.
    """

    folds: Mapping[str, tuple[tuple[str, ...], int, str]]
    pooled: Metrics
    frames: int
    agreed: int

    def as_dict(self) -> dict[str, object]:
        """Return the result as plain JSON values."""
        chosen = ("committee", "threshold", "operating_point")
        folds = {episode: dict(zip(chosen, fold, strict=True)) for episode, fold in self.folds.items()}
        return to_json_fields(self, "frames pooled", folds=folds, folds_that_chose_alike=self.agreed)


def nested(
    table: VoteTable,
    *,
    size: int = 2,
    models: Sequence[str] = (),
    costs: Costs | None = None,
) -> NestedFit:
    """Choose a committee without each episode in turn, and judge that episode with it.

    The selection is repeated inside every fold. Raises GuardianError below two episodes, if a class
    is absent without some episode, for an unfinished run, and if no model voted.
    """
    names = _candidates(table, size, models)
    _require_ready(table, names)
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
        own = votes[list(choice.committee)][:, held_out]
        said[held_out] = answered(own, choice.threshold, choice.point)
    folds = {
        episode: (tuple(names[place] for place in choice.committee), choice.threshold, str(choice.point))
        for episode, choice in zip(episodes, chosen, strict=True)
    }
    pooled = measure(table, {"nested": said})["nested"]
    agreed = Counter(folds.values()).most_common(1)[0][1]
    return NestedFit(folds, pooled, len(table.frames), agreed)
