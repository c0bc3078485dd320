"""A guardian is chosen on calibration frames alone, and frozen."""

from collections.abc import Sequence

import numpy as np

from eyechart.errors import GuardianError
from eyechart.stats.committee import MISSING, POINTS, Costs, Point, select, tally
from eyechart.studies.guardian.frozen import Frozen, Selection
from eyechart.studies.guardian.votes import VIEWS, VoteTable

LARGEST = 4
"""Models of the largest committee."""


def fit(
    table: VoteTable,
    *,
    size: int = 2,
    models: Sequence[str] = (),
    point: Point | None = None,
    costs: Costs | None = None,
) -> Frozen:
    """Choose a committee of ``size`` of the models, and a threshold, on every frame of a table, and freeze them.

    ``models`` leaves the choice to these only. ``point`` is the operating point to stand at, two-way where none is
    given; with ``costs`` that price abstention the point is chosen too. Ties are broken as `TIE_BREAKS` says. Raises
    GuardianError where the frames do not hold both classes, there are too few models, their run is not finished, or
    none of them gave a vote.
    """
    names = tuple(sorted(set(models))) or table.models
    if not 1 <= size <= LARGEST or size > len(names):
        raise GuardianError(f"a committee has 1 to {LARGEST} models, of {len(names)} that voted; got {size}")
    if point is not None and costs is not None and costs.abstention is not None:
        raise GuardianError("with a cost of abstention the operating point is chosen by the costs: leave out --point")
    require_both(table)
    require_whole(table, names)
    require_votes(table, names)
    votes, whole = table.of(names), np.zeros(len(table.frames), dtype=np.int64)
    found = tally(votes, table.hazard, whole, size=size)
    best = select(found, costs)
    single = select(tally(votes[:, :, :1], table.hazard, whole, size=1))
    alone = names[single.committee[0]]
    committee = tuple(names[place] for place in best.committee)
    points = len(POINTS) if costs is not None and costs.abstention is not None else 1
    return Frozen(
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


def require_whole(table: VoteTable, models: Sequence[str]) -> None:
    """Raise GuardianError where the run of a table has still to ask for votes of these models."""
    if words := table.unfinished_words(models):
        raise GuardianError(f"{words[0]}; finish it, or name the models that are with --model")


def require_votes(table: VoteTable, models: Sequence[str]) -> None:
    """Raise GuardianError where none of these models gave a vote on any frame, so that every choice is as good."""
    if (table.of(models) == MISSING).all():
        raise GuardianError(
            f"{table.name}: no vote by {', '.join(models)} on any of {len(table.frames)} frames, so there is nothing "
            "to choose by; where votes are scene estimates, 'eyechart score' counts why replies hold none"
        )


def require_both(table: VoteTable) -> None:
    """Raise GuardianError unless a table holds hazardous and clear frames."""
    hazards = int(table.hazard.sum())
    if not 0 < hazards < len(table.frames):
        raise GuardianError(
            f"{table.name}: {hazards} of {len(table.frames)} frames are hazardous; hazardous and clear ones are needed"
        )
