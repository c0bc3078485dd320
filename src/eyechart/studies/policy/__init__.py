"""Any policy: run() calls it with each channel exchanged, score() reads the answers."""

from eyechart.studies.policy.planning import ANSWERS, STUDY, Extent, PolicyRun, plan, run
from eyechart.studies.policy.scoring import PolicyScore, score

__all__ = ["ANSWERS", "STUDY", "Extent", "PolicyRun", "PolicyScore", "plan", "run", "score"]
