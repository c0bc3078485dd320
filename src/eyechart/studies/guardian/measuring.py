"""Answers are measured against the truth, each number with its interval over episodes."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from eyechart.stats.agreement import binary_metrics, rate, selective_metrics
from eyechart.stats.committee import CLEAR, HAZARD
from eyechart.stats.resampling import ENUMERATED_MULTISETS, cluster_bootstraps, ratio_of_sums
from eyechart.stats.statistic import Statistic
from eyechart.studies.guardian.votes import VoteTable

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
Metrics = Mapping[str, Statistic]

METRICS = ("coverage", "acc", "bal", "sens", "spec")
"""Coverage, accuracy, balanced accuracy, sensitivity and specificity, these over the frames that were answered."""

NO_SPREAD = "the episodes do not differ"


def measure(
    table: VoteTable,
    said: Mapping[str, Ints],
    *,
    seed: int = 0,
    resamples: int = 5000,
    enumerate_up_to: int = ENUMERATED_MULTISETS,
) -> dict[str, Metrics]:
    """Return the `METRICS` of each set of answers to the frames of a table, shape (frames,) each.

    Intervals are of resampled episodes: all multisets where these number at most ``enumerate_up_to`` (12 episodes have
    1 352 078), else ``resamples`` drawn from ``seed``; each statistic's ``method`` says which. Where no resample
    differs, a share keeps its Wilson interval over frames, and balanced accuracy has none.
    """
    sums = {name: _by_episode(table, answer) for name, answer in said.items()}
    statistics: dict[str, Callable[[Floats], Floats]] = {}
    for place, name in enumerate(sums):
        for metric in METRICS:
            statistics[f"{name} {metric}"] = _of_sums(metric, 5 * place)
    side_by_side = np.concatenate(list(sums.values()), axis=1)
    spread = cluster_bootstraps(
        side_by_side, statistics, seed=seed, resamples=resamples, enumerate_up_to=enumerate_up_to
    )
    rows: dict[str, Metrics] = {}
    for name, answer in said.items():
        rows[name] = {
            metric: _spread(one, spread[f"{name} {metric}"]) for metric, one in _metrics(table, answer).items()
        }
    return rows


def _spread(one: Statistic, over_episodes: Statistic) -> Statistic:
    """Return a statistic with its interval over episodes, where these differ."""
    detail = {**(one.detail or {}), **(over_episodes.detail or {})}
    if over_episodes.ci is not None and over_episodes.ci[0] == over_episodes.ci[1]:
        note = NO_SPREAD if one.ci is None else f"{NO_SPREAD}: Wilson interval over frames"
        return replace(one, note=note, detail=detail)
    return replace(one, ci=over_episodes.ci, method=over_episodes.method, detail=detail or None)


def _cells(truth: npt.NDArray[np.bool_], answer: Ints) -> dict[str, npt.NDArray[np.bool_]]:
    return {
        "tp": truth & (answer == HAZARD),
        "fn": truth & (answer == CLEAR),
        "tn": ~truth & (answer == CLEAR),
        "fp": ~truth & (answer == HAZARD),
    }


def _metrics(table: VoteTable, answer: Ints) -> dict[str, Statistic]:
    cells = {name: int(one.sum()) for name, one in _cells(table.hazard, answer).items()}
    frames = len(table.frames)
    if sum(cells.values()) < frames:
        return selective_metrics(**cells, n=frames)
    return {"coverage": rate(frames, frames), **binary_metrics(**cells)}


def _by_episode(table: VoteTable, answer: Ints) -> Floats:
    """Return what each episode adds to tp, fn, tn, fp and to the number of frames; shape (episodes, 5)."""
    names, group = table.groups()
    cells = [*_cells(table.hazard, answer).values(), np.ones(len(group), dtype=np.bool_)]
    columns = [np.bincount(group[cell], minlength=len(names)) for cell in cells]
    return np.asarray(columns, dtype=np.float64).T


def _of_sums(metric: str, at: int) -> Callable[[Floats], Floats]:
    """Return a metric as a function of summed episodes, whose cells begin in column ``at``."""

    def share(part: Floats, whole: Floats) -> Floats:
        return ratio_of_sums(np.column_stack([part, whole]))

    def statistic(sums: Floats) -> Floats:
        tp, fn, tn, fp, frames = (sums[:, at + place] for place in range(5))
        if metric == "coverage":
            return share(tp + fn + tn + fp, frames)
        if metric == "acc":
            return share(tp + tn, tp + fn + tn + fp)
        if metric == "sens":
            return share(tp, tp + fn)
        if metric == "spec":
            return share(tn, tn + fp)
        return (share(tp, tp + fn) + share(tn, tn + fp)) / 2

    return statistic
