"""The two-rate hierarchy tests whether a competent controller rescues a blind planner.

Source: paper, sections Hierarchical VLM-MPC Diagnostic and MPC cannot repair an ungrounded intent
layer, Table mpc_intent_ablation.
"""

from eyechart.studies.hierarchy.plans import PARTS, SCRIPTED, Arms, HierarchySelection, Part, plan, read_choice, run
from eyechart.studies.hierarchy.scores import Completion, HierarchyScore, IntentSource, score

__all__ = [
    "PARTS",
    "SCRIPTED",
    "Arms",
    "Completion",
    "HierarchyScore",
    "HierarchySelection",
    "IntentSource",
    "Part",
    "plan",
    "read_choice",
    "run",
    "score",
]
