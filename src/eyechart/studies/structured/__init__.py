"""The structured arm: models estimate the scene of a picture and its reflection; a policy acts.

Source: paper, sections Constructive renderer-calibrated controller, Structured output is not
geometric grounding.
"""

from eyechart.studies.structured import online
from eyechart.studies.structured.plans import ADMISSION, STRUCTURED, plan
from eyechart.studies.structured.scene_answers import SceneAnswers, read_scene_answers
from eyechart.studies.structured.scores import EstimatorScore, StructuredScore, score

__all__ = [
    "ADMISSION",
    "STRUCTURED",
    "EstimatorScore",
    "SceneAnswers",
    "StructuredScore",
    "online",
    "plan",
    "read_scene_answers",
    "score",
]
