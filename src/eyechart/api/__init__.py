"""The main job in a few lines of Python: build a bank, run models or policies, read the report.

Each function does what one command does. For single steps use `eyechart.studies.battery`,
`eyechart.studies.policy`, `eyechart.verdicts` and the other modules that the docs name.
"""

from eyechart.api.battery import AskedModel, Report, build_bank, read_report, run_battery
from eyechart.api.looks import look
from eyechart.api.policy import AskedPolicy, PolicyReport, examine_policy, read_policies, run_policies
from eyechart.api.prompts import PromptsReport, compare_prompts

__all__ = [
    "AskedModel",
    "AskedPolicy",
    "PolicyReport",
    "PromptsReport",
    "Report",
    "build_bank",
    "compare_prompts",
    "examine_policy",
    "look",
    "read_policies",
    "read_report",
    "run_battery",
    "run_policies",
]
