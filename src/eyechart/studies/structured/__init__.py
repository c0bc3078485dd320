"""The structured arm: models estimate the scene of a picture and its reflection; a policy acts.

Source: paper, sections Constructive renderer-calibrated controller, Structured output is not
geometric grounding.
"""

from eyechart.studies.structured import online
from eyechart.studies.structured.planning import ADMISSION, STRUCTURED, plan
from eyechart.studies.structured.scoring import EstimatorScore, StructuredScore, score
from eyechart.studies.structured.told import Told, read_told

__all__ = [
    "ADMISSION",
    "STRUCTURED",
    "EstimatorScore",
    "StructuredScore",
    "Told",
    "online",
    "plan",
    "read_told",
    "score",
]
