"""Scores of closed-loop drives: the ladder, the model as its own blind baseline, the audit.

Source: paper, Tables t:baselines and t:degeneracy.
"""

from eyechart.studies.closed_loop.audit import Degeneracy, Replay, measured
from eyechart.studies.closed_loop.blind import CANNOT_SAY, DIFFERS, Blind, blind_baselines, bounds
from eyechart.studies.closed_loop.ladder import (
    LEVEL,
    Outcomes,
    Paired,
    Rung,
    against,
    corrected,
    exact_rate,
    mean_of_drives,
    outcomes_of,
    paired,
)
from eyechart.studies.closed_loop.reading import Driver, Drives, read_drives
from eyechart.studies.closed_loop.replaying import verify
from eyechart.studies.closed_loop.study import NO_LEDGER, ClosedLoopScore, OfEpisodes, score, served_of, unfinished_of

__all__ = [
    "CANNOT_SAY",
    "DIFFERS",
    "LEVEL",
    "NO_LEDGER",
    "Blind",
    "ClosedLoopScore",
    "Degeneracy",
    "Driver",
    "Drives",
    "OfEpisodes",
    "Outcomes",
    "Paired",
    "Replay",
    "Rung",
    "against",
    "blind_baselines",
    "bounds",
    "corrected",
    "exact_rate",
    "mean_of_drives",
    "measured",
    "outcomes_of",
    "paired",
    "read_drives",
    "score",
    "served_of",
    "unfinished_of",
    "verify",
]
