"""Scores of closed-loop drives: the ladder, the model as its own blind baseline, the audit.

Source: paper, Tables t:baselines and t:degeneracy.
"""

from eyechart.studies.closed_loop.audit import Degeneracy, ReplayComparison, measured
from eyechart.studies.closed_loop.blind_baseline import CANNOT_SAY, DIFFERS, BlindBaseline, blind_baselines, bounds
from eyechart.studies.closed_loop.drives import Driver, Drives, read_drives
from eyechart.studies.closed_loop.ladder import (
    LEVEL,
    LadderRow,
    PairedDifference,
    SuccessCriteria,
    against,
    corrected,
    exact_rate,
    mean_of_drives,
    outcomes_of,
    paired,
)
from eyechart.studies.closed_loop.replay import verify
from eyechart.studies.closed_loop.study import NO_LEDGER, ClosedLoopScore, EpisodeStudy, score, served_of, unfinished_of

__all__ = [
    "CANNOT_SAY",
    "DIFFERS",
    "LEVEL",
    "NO_LEDGER",
    "BlindBaseline",
    "ClosedLoopScore",
    "Degeneracy",
    "Driver",
    "Drives",
    "EpisodeStudy",
    "LadderRow",
    "PairedDifference",
    "ReplayComparison",
    "SuccessCriteria",
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
