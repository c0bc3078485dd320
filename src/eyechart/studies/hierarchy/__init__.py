"""The two-rate hierarchy tests whether a competent controller rescues a blind planner.

Source: paper, sections Hierarchical VLM-MPC Diagnostic and MPC cannot repair an ungrounded intent
layer, Table mpc_intent_ablation.
"""

from eyechart.studies.hierarchy.planning import PARTS, SCRIPTED, Arms, Choice, Part, plan, read_choice, run
from eyechart.studies.hierarchy.scoring import Completion, HierarchyScore, Source, score

__all__ = [
    "PARTS",
    "SCRIPTED",
    "Arms",
    "Choice",
    "Completion",
    "HierarchyScore",
    "Part",
    "Source",
    "plan",
    "read_choice",
    "run",
    "score",
]
