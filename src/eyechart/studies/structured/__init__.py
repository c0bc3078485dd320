"""The structured arm: models estimate the scene of a picture and of its reflection, and a fixed policy acts on it.

Source: paper, sections Constructive renderer-calibrated controller, Structured output is not geometric grounding.
"""

from eyechart.studies.structured import online
from eyechart.studies.structured.planning import ADMISSION, STRUCTURED, STUDIES, plan
from eyechart.studies.structured.scoring import (
    EstimatorScore,
    StructuredScore,
    require_scorable,
    score,
    score_run,
)
from eyechart.studies.structured.told import Told, read_told

__all__ = [
    "ADMISSION",
    "STRUCTURED",
    "STUDIES",
    "EstimatorScore",
    "StructuredScore",
    "Told",
    "online",
    "plan",
    "read_told",
    "require_scorable",
    "score",
    "score_run",
]
