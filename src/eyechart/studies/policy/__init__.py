"""Any policy: run() calls it with each channel exchanged, score() reads the answers."""

from eyechart.studies.policy.plans import ANSWERS, STUDY, PolicyRun, PolicySelection, plan, run
from eyechart.studies.policy.scores import PolicyScore, score

__all__ = ["ANSWERS", "STUDY", "PolicyRun", "PolicyScore", "PolicySelection", "plan", "run", "score"]
