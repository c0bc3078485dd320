"""A verdict that was settled early rests on the e-values that stopped its run, and on nothing computed after."""

from collections.abc import Mapping

from eyechart.stats.statistic import Statistic
from eyechart.studies.battery import Stopped
from eyechart.verdicts.ruling import Ruling

NOT_JUDGED = "not_judged"
"""In place of a label of the paper's rules: their tests hold at a sample of fixed size only."""


def early_rules(found: Mapping[str, Statistic], stopped: Stopped, lateral: Ruling) -> tuple[Ruling, str]:
    """Return the calibrated label of a run that stopped, and how the question of distance was put."""
    label = "depth_lateral" if stopped.label == "depth" and lateral.label == "swaps" else stopped.label
    evidence = "interventional" if stopped.interventional else "none"
    because = _because(found, stopped.decided_by, stopped.words())
    if stopped.with_it:
        because += f"; so are {', '.join(stopped.with_it)}"
    return Ruling(label, stopped.decided_by, because), evidence


def early_lateral(found: Mapping[str, Statistic], stopped: Stopped) -> Ruling | None:
    """Return the lateral label of a run that stopped; None where the ordinary rules apply."""
    if stopped.lateral is None:
        return None
    return Ruling(stopped.lateral, stopped.lateral_by, _because(found, stopped.lateral_by, "stopped early"))


def early_paper(stopped: Stopped) -> Ruling:
    """Return what stands for the paper's label of a run that stopped."""
    return Ruling(NOT_JUDGED, stopped.decided_by, f"{stopped.words()}: the paper's tests need the whole run")


def _because(found: Mapping[str, Statistic], name: str, how: str) -> str:
    evidence = found[name]
    threshold = float(str((evidence.detail or {})["threshold"]))
    says = evidence.note.partition(": ")[2]
    e = f"{name} = {evidence.value:.4g}"
    return f"{how}: {says}: settled by {e}, at least {threshold:g}, after {evidence.n} frames"
