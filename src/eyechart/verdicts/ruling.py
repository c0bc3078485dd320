"""A ruling is a label with the statistic that decided it."""

from dataclasses import dataclass

from eyechart.stats.statistic import Statistic


@dataclass(frozen=True, slots=True)
class Ruling:
    """A label with the name of the statistic that decided it, and the reason in words.

    ``statistic`` is that statistic, None where there was nothing to measure; ``because`` ends in its numbers.
    """

    label: str
    decided_by: str
    because: str
    statistic: Statistic | None = None

    @property
    def words(self) -> str:
        """Return the reason without its numbers."""
        return self.because.partition(f": {self.decided_by} = ")[0]


def decided(label: str, name: str, statistic: Statistic, words: str) -> Ruling:
    """Return the ruling that a statistic decided, its numbers behind the words."""
    interval = "" if statistic.ci is None else f" [{statistic.ci[0]:.3f}, {statistic.ci[1]:.3f}]"
    p = "" if statistic.p is None else f", p = {p_value(statistic.p)}"
    because = f"{words}: {name} = {number(statistic)}{interval}, n = {statistic.n}{p}"
    return Ruling(label, name, because, statistic)


def number(statistic: Statistic) -> str:
    """Return a statistic's value as text; "cannot say" is a dash."""
    return "—" if statistic.value is None else f"{statistic.value:.3f}"


def p_value(p: float) -> str:
    """Return a p as text, a small one in powers of ten."""
    return f"{p:.1e}" if p < 0.0001 else f"{p:.4f}"
