"""The input-ablation battery: every frame under every condition; run() calls, score() reads.

`eyechart.studies.battery.answer_import` imports answers that were made elsewhere. Source: paper,
section The Input-Ablation Battery.
"""

from eyechart.studies.battery.answers import read_answers, read_columns
from eyechart.studies.battery.plans import (
    Battery,
    BatterySelection,
    BatterySettings,
    begun,
    expected,
    merge,
    open_models,
    open_whole,
    plan,
    plan_of,
    resume_manifest,
    run,
    sample_of,
    with_fresh_controls,
    writing,
)
from eyechart.studies.battery.questions import Questions, questions_left, questions_of, write_questions
from eyechart.studies.battery.replication import differences
from eyechart.studies.battery.requests import require_requests
from eyechart.studies.battery.scores import BatteryScore, CallsScore, ModelScore, score, taken, took, took_run
from eyechart.studies.battery.study import FrameStudy

__all__ = [
    "Battery",
    "BatteryScore",
    "BatterySelection",
    "BatterySettings",
    "CallsScore",
    "FrameStudy",
    "ModelScore",
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
    "resume_manifest",
    "run",
    "sample_of",
    "score",
    "taken",
    "took",
    "took_run",
    "with_fresh_controls",
    "write_questions",
    "writing",
]
