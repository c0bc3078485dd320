"""Closed-loop drives scored: the ladder, the model as its own blind baseline, and the degeneracy audit.

Source: paper, Tables t:baselines and t:degeneracy.
"""

from eyechart.studies.closed_loop.agreement import Replay
from eyechart.studies.closed_loop.asked import as_recorded, sample_of, spent_on, took
from eyechart.studies.closed_loop.blind import DIFFERS, OUTCOMES, Blind, blind_baselines
from eyechart.studies.closed_loop.degeneracy import Degeneracy
from eyechart.studies.closed_loop.identical import Twins, same_drive
from eyechart.studies.closed_loop.ladder import (
    LEVEL,
    Outcomes,
    Paired,
    Rung,
    corrected,
    exact_rate,
    outcomes_of,
    paired,
)
from eyechart.studies.closed_loop.reading import Driver, Drives, is_episodes, read_drives
from eyechart.studies.closed_loop.repeated import Repeats
from eyechart.studies.closed_loop.replaying import verify
from eyechart.studies.closed_loop.scoring import ClosedLoopScore, score, unfinished_of

__all__ = [
    "DIFFERS",
    "LEVEL",
    "OUTCOMES",
    "Blind",
    "ClosedLoopScore",
    "Degeneracy",
    "Driver",
    "Drives",
    "Outcomes",
    "Paired",
    "Repeats",
    "Replay",
    "Rung",
    "Twins",
    "as_recorded",
    "blind_baselines",
    "corrected",
    "exact_rate",
    "is_episodes",
    "outcomes_of",
    "paired",
    "read_drives",
    "same_drive",
    "sample_of",
    "score",
    "spent_on",
    "took",
    "unfinished_of",
    "verify",
]
