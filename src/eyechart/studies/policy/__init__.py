"""Any policy: run() asks it about every frame with each of its channels exchanged, score() reads what came back."""

from eyechart.studies.policy.planning import ANSWERS, STUDY, Extent, PolicyRun, plan, run
from eyechart.studies.policy.scoring import PolicyScore, score

__all__ = ["ANSWERS", "STUDY", "Extent", "PolicyRun", "PolicyScore", "plan", "run", "score"]
