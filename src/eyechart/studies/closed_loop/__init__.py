"""Closed-loop drives scored: the ladder, the model as its own blind baseline, and the degeneracy audit.

Source: paper, Tables t:baselines and t:degeneracy.
"""

from eyechart.studies.closed_loop.agreement import Replay
from eyechart.studies.closed_loop.blind import Blind
from eyechart.studies.closed_loop.degeneracy import Degeneracy
from eyechart.studies.closed_loop.identical import Twins, same_drive
from eyechart.studies.closed_loop.ladder import Paired, Rung
from eyechart.studies.closed_loop.reading import Driver, Drives, is_episodes, read_drives
from eyechart.studies.closed_loop.repeated import Repeats
from eyechart.studies.closed_loop.scoring import ClosedLoopScore, score

__all__ = [
    "Blind",
    "ClosedLoopScore",
    "Degeneracy",
    "Driver",
    "Drives",
    "Paired",
    "Repeats",
    "Replay",
    "Rung",
    "Twins",
    "is_episodes",
    "read_drives",
    "same_drive",
    "score",
]
