"""A verdict is the claim that the evidence supports, with the statistic that decided it.

Two sets of rules stand side by side: the paper's, as we read them, and the calibrated ones. Why:
docs/decisions/battery.md.
"""

from eyechart.verdicts.battery_rules import calibrated_rules, controls_wanted, earns_lateral, lateral_rules
from eyechart.verdicts.early_verdicts import FORECAST_ALPHA, GUARANTEE, PREFIX, VALIDITY, StoppingPoint
from eyechart.verdicts.evidence import DECIDED, Evidence, ScoredRun
from eyechart.verdicts.labels import (
    ABSENCES,
    ALPHA,
    BOUND_ALPHA,
    FLOOR,
    KAPPA_MARGIN,
    LABELS,
    LATERAL,
    MARGIN,
    NET_ALPHA,
    NOT_JUDGED,
    PAPER_LABELS,
    UNPARSED_CUT,
    Label,
)
from eyechart.verdicts.paper import paper_rules
from eyechart.verdicts.ruling import Ruling
from eyechart.verdicts.verdict import Verdict, judge, judge_one, notes, shared_notes, words_of

__all__ = [
    "ABSENCES",
    "ALPHA",
    "BOUND_ALPHA",
    "DECIDED",
    "FLOOR",
    "FORECAST_ALPHA",
    "GUARANTEE",
    "KAPPA_MARGIN",
    "LABELS",
    "LATERAL",
    "MARGIN",
    "NET_ALPHA",
    "NOT_JUDGED",
    "PAPER_LABELS",
    "PREFIX",
    "UNPARSED_CUT",
    "VALIDITY",
    "Evidence",
    "Label",
    "Ruling",
    "ScoredRun",
    "StoppingPoint",
    "Verdict",
    "calibrated_rules",
    "controls_wanted",
    "earns_lateral",
    "judge",
    "judge_one",
    "lateral_rules",
    "notes",
    "paper_rules",
    "shared_notes",
    "words_of",
]
