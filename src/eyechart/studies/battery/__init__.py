"""The input-ablation battery: every frame under every condition; run() calls, score() reads.

`eyechart.studies.battery.elsewhere` imports answers that were made elsewhere. Source: paper,
section The Input-Ablation Battery.
"""

from eyechart.studies.battery.answers import read_answers, read_columns
from eyechart.studies.battery.planning import (
    Asking,
    Battery,
    Extent,
    begun,
    expected,
    merge,
    open_models,
    open_whole,
    plan,
    plan_of,
    resumed,
    run,
    sample_of,
    writing,
)
from eyechart.studies.battery.questions import Questions, questions_left, questions_of, write_questions
from eyechart.studies.battery.replication import differences
from eyechart.studies.battery.requests import require_requests
from eyechart.studies.battery.scoring import BatteryScore, CallsScore, ModelScore, score, taken, took, took_run
from eyechart.studies.battery.study import OfFrames

__all__ = [
    "Asking",
    "Battery",
    "BatteryScore",
    "CallsScore",
    "Extent",
    "ModelScore",
    "OfFrames",
    "Questions",
    "begun",
    "differences",
    "expected",
    "merge",
    "open_models",
    "open_whole",
    "plan",
    "plan_of",
    "questions_left",
    "questions_of",
    "read_answers",
    "read_columns",
    "require_requests",
    "resumed",
    "run",
    "sample_of",
    "score",
    "taken",
    "took",
    "took_run",
    "write_questions",
    "writing",
]
