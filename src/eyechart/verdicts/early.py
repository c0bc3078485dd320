"""A verdict that was settled early rests on the e-values that stopped its run, and on nothing computed after."""

from collections.abc import Mapping
from dataclasses import dataclass

from eyechart.stats.statistic import Statistic
from eyechart.verdicts.labels import ALPHA, LABELS, NOT_JUDGED
from eyechart.verdicts.ruling import Ruling

PREFIX = "early."
"""What the names of e-values begin with among the statistics of a model."""

FORECAST_ALPHA = 0.02
"""Chance that what the rest of the run would have shown is forecast wrongly."""

_SETTLED = [name for name, label in LABELS.items() if label.early]

GUARANTEE = (
    f"a false early verdict has a chance of at most {ALPHA * len(_SETTLED):.2f} a model, however often one looks "
    f"({ALPHA} for each of {', '.join(_SETTLED)}); that the whole run would have been not_scorable, {FORECAST_ALPHA}; "
    f"lateral, {ALPHA} for swaps, {ALPHA} for their denial, {FORECAST_ALPHA} that the whole run would have held turns "
    "enough"
)
VALIDITY = (
    "it needs frames in random order, which the seed gives, and answers that do not depend on the calls before; "
    "correlated frames of an episode do no harm"
)


@dataclass(frozen=True, slots=True)
class Stopped:
    """Where a model's verdict was settled before its run ended.

    ``label`` is the calibrated one, without its lateral axis, ``decided_by`` the first of the claims that it rests on
    and ``with_it`` the others; ``lateral`` is None where the ordinary lateral rules
    apply (turns cannot be tested, or all frames were asked for them). ``calls`` counts the calls up to the stop, of
    ``planned``; ``beyond`` those that were under way, or had overtaken a slower one, and count for nothing.
    """

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
    def saved(self) -> int:
        """Return the number of calls that were not made."""
        return self.planned - self.calls - self.beyond

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            "rule": self.label,
            "decided_by": self.decided_by,
            "with": list(self.with_it),
            "lateral": self.lateral,
            "lateral_by": self.lateral_by,
            "frames": self.frames,
            "calls": self.calls,
            "planned": self.planned,
            "saved": self.saved,
            "beyond": self.beyond,
        }

    def words(self) -> str:
        """Return what happened, in words."""
        return f"stopped early after {self.calls} of {self.planned} calls, by {self.label}"


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
