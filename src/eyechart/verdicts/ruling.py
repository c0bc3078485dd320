"""A ruling is a label with the statistic that decided it."""

from dataclasses import dataclass

from eyechart.stats.statistic import Statistic

SWAP_RATE = 0.5
"""From this mirror swap rate on directions count as exchanged."""


@dataclass(frozen=True, slots=True)
class Ruling:
    """A label with the name of the statistic that decided it, and the reason in words."""

    label: str
    decided_by: str
    because: str


def decided(label: str, name: str, statistic: Statistic, words: str) -> Ruling:
    """Return the ruling that a statistic decided, its numbers behind the words."""
    interval = "" if statistic.ci is None else f" [{statistic.ci[0]:.3f}, {statistic.ci[1]:.3f}]"
    p = "" if statistic.p is None else f", p = {_p(statistic.p)}"
    return Ruling(label, name, f"{words}: {name} = {number(statistic)}{interval}, n = {statistic.n}{p}")


def number(statistic: Statistic) -> str:
    """Return a statistic's value as text; "cannot say" is a dash."""
    return "—" if statistic.value is None else f"{statistic.value:.3f}"


def _p(p: float) -> str:
    return f"{p:.1e}" if p < 0.0001 else f"{p:.4f}"
