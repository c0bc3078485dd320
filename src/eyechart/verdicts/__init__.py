"""A verdict is the claim that the evidence supports; every rule names the statistic that decided it.

Two sets of rules stand side by side: the paper's, as we read them, and the calibrated ones, which hold their
error rate and say ``undecided`` rather than accept a null. Both are declared in
docs/decisions/0006-two-sets-of-rules.md.
"""

from eyechart.verdicts.calibrated import calibrated_rules, lateral_rules
from eyechart.verdicts.early import FORECAST_ALPHA, GUARANTEE, PREFIX, VALIDITY, Stopped
from eyechart.verdicts.evidence import DECIDED, Evidence, Scored
from eyechart.verdicts.labels import (
    ALPHA,
    FLOOR,
    LABELS,
    LATERAL,
    MARGIN,
    NOT_JUDGED,
    PAPER_LABELS,
    UNPARSED_CUT,
    Label,
)
from eyechart.verdicts.paper import paper_rules
from eyechart.verdicts.ruling import Reason, Ruling
from eyechart.verdicts.verdict import Verdict, judge, judge_one, notes, shared_notes, words_of

__all__ = [
    "ALPHA",
    "DECIDED",
    "FLOOR",
    "FORECAST_ALPHA",
    "GUARANTEE",
    "LABELS",
    "LATERAL",
    "MARGIN",
    "NOT_JUDGED",
    "PAPER_LABELS",
    "PREFIX",
    "UNPARSED_CUT",
    "VALIDITY",
    "Evidence",
    "Label",
    "Reason",
    "Ruling",
    "Scored",
    "Stopped",
    "Verdict",
    "calibrated_rules",
    "judge",
    "judge_one",
    "lateral_rules",
    "notes",
    "paper_rules",
    "shared_notes",
    "words_of",
]
