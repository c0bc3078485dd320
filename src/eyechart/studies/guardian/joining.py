"""Votes of several runs or tables become one table, where they are of the same frames and came about alike."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from eyechart.errors import VoteError
from eyechart.studies.guardian.votes import VoteTable


def join(tables: Sequence[VoteTable]) -> VoteTable:
    """Return the votes of all models of these tables on their frames, in the first one's order.

    Raises VoteError, naming what it is, where a table has other frames, another truth or part of a frame, votes of a
    model that another has too, or came about with another bank, prompt, view or reader.
    """
    first, *others = tables
    for other in others:
        _require_alike(first, other)
    aligned = [first, *(_in_order(other, first.frames) for other in others)]
    for one in aligned[1:]:
        for what in ("hazard", "episodes", "split"):
            mine, theirs = (np.array(getattr(table, what)) for table in (first, one))
            if mine.shape != theirs.shape or (mine != theirs).any():
                raise VoteError(f"{first.name} and {one.name} say of a frame another {what}")
    models = sorted((model, table) for table, one in enumerate(aligned) for model in one.models)
    for (model, table), (again, _) in pairwise(models):
        if model == again:
            raise VoteError(f"'{model}' votes in {aligned[table].name} and in another table: give each model once")
    about = first.about
    for one in aligned[1:]:
        about = replace(
            about,
            versions={**about.versions, **one.about.versions},
            served={**about.served, **one.about.served},
            modes={**about.modes, **one.about.modes},
        )
    return replace(
        first,
        name=" + ".join(one.name for one in aligned),
        models=tuple(model for model, _ in models),
        votes=np.concatenate([aligned[table].of([model]) for model, table in models]),
        about=about,
        contradicting=_contradicting(aligned, models),
        unfinished={model: left for one in aligned for model, left in one.unfinished.items()},
    )


def _contradicting(tables: Sequence[VoteTable], models: Sequence[tuple[str, int]]) -> npt.NDArray[np.bool_] | None:
    """Return which votes contradict themselves, of these models by the numbers of their tables; None of no run."""
    if all(one.contradicting is None for one in tables):
        return None
    known = [np.zeros(one.votes.shape, np.bool_) if one.contradicting is None else one.contradicting for one in tables]
    return np.stack([known[table][tables[table].models.index(model)] for model, table in models])


def _require_alike(first: VoteTable, other: VoteTable) -> None:
    for what in ("bank", "prompt", "view", "reader"):
        if getattr(first.about, what) != getattr(other.about, what):
            raise VoteError(f"the {what} of {other.name} is not that of {first.name}, so their votes make no committee")
    if apart := sorted(set(first.frames) ^ set(other.frames)):
        raise VoteError(
            f"{first.name} and {other.name} are not of the same frames: frame '{apart[0]}' is in one of them only"
        )


def _in_order(table: VoteTable, frames: Sequence[str]) -> VoteTable:
    place = {frame: number for number, frame in enumerate(table.frames)}
    order = [place[frame] for frame in frames]

    def sorted_as(values: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(values[number] for number in order)

    return replace(
        table,
        frames=sorted_as(table.frames),
        episodes=sorted_as(table.episodes),
        hazard=table.hazard[order],
        votes=table.votes[:, order],
        contradicting=None if table.contradicting is None else table.contradicting[:, order],
        split=None if table.split is None else sorted_as(table.split),
        pictures=None if table.pictures is None else sorted_as(table.pictures),
    )
