"""A verdict is the claim that the evidence supports; every rule names the statistic that decided it.

Two sets of rules stand side by side: the paper's, as we read them, and the calibrated ones, which hold their
error rate and say ``undecided`` rather than accept a null. Both are declared in
docs/decisions/0006-two-sets-of-rules.md.
"""

from eyechart.verdicts.calibrated import CALIBRATED_LABELS, TRUST, calibrated_rules
from eyechart.verdicts.early import NOT_JUDGED
from eyechart.verdicts.judging import Verdict, judge, scope, shared_notes, words_of
from eyechart.verdicts.lateral import LATERAL_LABELS, lateral_rules
from eyechart.verdicts.paper import PAPER_LABELS, paper_rules
from eyechart.verdicts.ruling import Ruling

__all__ = [
    "CALIBRATED_LABELS",
    "LATERAL_LABELS",
    "NOT_JUDGED",
    "PAPER_LABELS",
    "TRUST",
    "Ruling",
    "Verdict",
    "calibrated_rules",
    "judge",
    "lateral_rules",
    "paper_rules",
    "scope",
    "shared_notes",
    "words_of",
]
