"""The input-ablation battery: run() asks about every frame under every condition, score() reads what came back.

Source: paper, section The Input-Ablation Battery.
"""

from eyechart.studies.battery.answers import read_answers
from eyechart.studies.battery.planning import (
    Battery,
    expected,
    keep_probes,
    merge,
    open_models,
    open_whole,
    plan,
    plan_of,
    resumed,
    run,
    sample_of,
    with_earlier,
    within,
)
from eyechart.studies.battery.replication import differences
from eyechart.studies.battery.scoring import BatteryScore, ModelScore, score, took, took_run
from eyechart.studies.battery.study import NO_DRIVES, OfFrames

__all__ = [
    "NO_DRIVES",
    "Battery",
    "BatteryScore",
    "ModelScore",
    "OfFrames",
    "differences",
    "expected",
    "keep_probes",
    "merge",
    "open_models",
    "open_whole",
    "plan",
    "plan_of",
    "read_answers",
    "resumed",
    "run",
    "sample_of",
    "score",
    "took",
    "took_run",
    "with_earlier",
    "within",
]
