"""A verdict that was settled early rests on the e-values that stopped its run, and on nothing computed after."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from eyechart.records import Written
from eyechart.stats.evalues import EValue
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.calibrated import calibrated_rules
from eyechart.verdicts.labels import ALPHA, BOUND_ALPHA, LABELS, MARGIN, NET_ALPHA, NOT_JUDGED
from eyechart.verdicts.ruling import Reason, Ruling, decided

PREFIX = "early."
"""What the names of e-values begin with among the statistics of a model."""

FORECAST_ALPHA = 0.02
"""Chance that what the rest of the run would have shown is forecast wrongly."""

_SETTLED = [name for name, label in LABELS.items() if label.early and name != "depth"]

GUARANTEE = (
    f"a false early verdict has a chance of at most {ALPHA * len(_SETTLED):.2f} a model, however often one looks "
    f"({ALPHA} for each of {', '.join(_SETTLED)}); depth is judged by the rules of a whole run, on all frames, and "
    "only what they do not read is left out; that depth_associated is said of braking that goes with distance on "
    f"{MARGIN} of the frames or less, {NET_ALPHA}; that a reaction to one condition alone was missed, {BOUND_ALPHA}; "
    f"that the whole run would have been not_scorable, {FORECAST_ALPHA}; lateral, {ALPHA} for swaps, {ALPHA} for "
    f"their denial, {FORECAST_ALPHA} that the whole run would have held turns enough"
)
VALIDITY = (
    "it needs frames in random order, which the seed gives, and answers that do not depend on the calls before; "
    "correlated frames of an episode do no harm"
)


@dataclass(frozen=True, slots=True)
class Stopped(Written):
    """Where a model's verdict was settled before its run ended.

    ``label`` is the calibrated one, without its lateral axis, ``decided_by`` the first of the claims that it rests on
    and ``with_it`` the others; ``depth`` rests on the tests of a whole run. ``lateral`` is None where the ordinary
    lateral rules apply (turns cannot be tested, or all frames were asked for them). ``calls`` counts the calls up to
    the stop, of ``planned``; ``beyond`` those that were under way, or had overtaken a slower one, and count for
    nothing.
    """

    written = "rule=label decided_by with=with_it lateral lateral_by frames calls planned saved beyond"

    label: str
    decided_by: str
    lateral: str | None
    lateral_by: str
    frames: int
    calls: int
    planned: int
    beyond: int = 0
    interventional: bool = False
    with_it: tuple[str, ...] = ()

    @property
    def whole(self) -> bool:
        """Return whether everything that its label's tests read was asked of all frames, as in a whole run."""
        return self.label == "depth"

    @property
    def saved(self) -> int:
        """Return the number of calls that were not made."""
        return self.planned - self.calls - self.beyond

    def words(self) -> str:
        """Return what happened, in words."""
        return f"stopped early after {self.calls} of {self.planned} calls, by {self.label}"


def early_rules(found: Mapping[str, Statistic], stopped: Stopped, *, turns: bool) -> tuple[Ruling, str]:
    """Return the calibrated label of a run that stopped, and how the question of distance was put.

    ``depth`` is what the rules of a whole run say: everything that they read of it was asked.
    """
    if stopped.whole:
        ruling, evidence = calibrated_rules(found, turns=turns)
        says = Reason("{how}: {why}", {"how": stopped.words(), "why": ruling.reason})
        return replace(ruling, reason=says), evidence
    evidence = "interventional" if stopped.interventional else "none"
    ruling = _settled(found, stopped.label, stopped.decided_by, stopped.words())
    return replace(ruling, with_it=stopped.with_it), evidence


def early_lateral(found: Mapping[str, Statistic], stopped: Stopped) -> Ruling | None:
    """Return the lateral label of a run that stopped; None where the ordinary rules apply."""
    if stopped.lateral is None:
        return None
    return _settled(found, stopped.lateral, stopped.lateral_by, "stopped early")


def early_paper(stopped: Stopped) -> Ruling:
    """Return what stands for the paper's label of a run that stopped."""
    words = "{stopped}: the paper's tests need the whole run"
    return decided(NOT_JUDGED, stopped.decided_by, None, words, stopped=stopped.words())


def _settled(found: Mapping[str, Statistic], label: str, name: str, how: str) -> Ruling:
    e = found[name]
    assert isinstance(e, EValue)
    return decided(label, name, e, "{how}: {claim}", how=how, claim=e.says)
