"""A ruling is a label with the reason and the statistic that decided it; its words."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape

from eyechart.stats.evalues import EValue
from eyechart.stats.paired_tests import Places
from eyechart.stats.statistic import Statistic


@dataclass(frozen=True, slots=True)
class Ruling:
    """A label with the name of the statistic that decided it, and the reason.

    ``statistic`` is that statistic, None if there was nothing to measure. ``other_claims`` names other
    e-values that settled the label. ``why_not``, ``may_be`` and ``bound`` are those of its rule.
    ``found`` is the reason alone, where ``reason`` also says how the run ended.
    """

    label: str
    decided_by: str
    reason: str
    statistic: Statistic | None = None
    other_claims: tuple[str, ...] = ()
    why_not: str = ""
    may_be: str = ""
    bound: Statistic | None = None
    found: str = ""

    @property
    def because(self) -> str:
        """Return the reason and the numbers that decided, in words."""
        one = self.statistic
        if isinstance(one, EValue):
            settled = f"{self.decided_by} = {one.value:.4g}, at least {one.threshold:g}, after {one.n} frames"
            so_are = f"; settled too: {', '.join(self.other_claims)}" if self.other_claims else ""
            return f"{self.reason}: settled by {settled}{so_are}"
        return self.reason if one is None else f"{self.reason}: {measured(self.decided_by, one)}"


def measured(name: str, one: Statistic | None) -> str:
    """Return a statistic by its name with its figures; its name alone where there is none."""
    return name if one is None else f"{name} = {figures(one)}"


def figures(one: Statistic) -> str:
    """Return the value, interval with its level, n and p of a statistic in words."""
    interval = "" if one.ci is None else f" [{one.ci[0]:.3f}, {one.ci[1]:.3f}] ({100 * one.level:g} %)"
    return f"{number(one)}{interval}, n = {one.n}{and_p(one)}"


def number(statistic: Statistic) -> str:
    """Return the value of a statistic as text, a count of places whole; a dash where it is None."""
    if isinstance(statistic, Places) and statistic.value is not None:
        return f"{statistic.value:.0f}"
    return "—" if statistic.value is None else f"{round(statistic.value, 3) + 0.0:.3f}"  # no negative zero


def and_p(statistic: Statistic) -> str:
    """Return the p of a statistic as it follows its value; empty where there is none."""
    return "" if statistic.p is None else f", p = {p_value(statistic.p)}"


def p_value(p: float) -> str:
    """Return a p as text, a small one in powers of ten."""
    return f"{p:.1e}" if p < 0.0001 else f"{p:.4f}"


_CARD = (
    "border:1px solid rgba(128,128,128,.4);border-radius:8px;padding:.9em 1.1em;margin:.6em 0;max-width:46em;"
    "text-align:left;overflow-wrap:anywhere"
)
_SOFT = "opacity:.75;font-size:.9em"
_LABEL = "opacity:.75;font-size:.6em;font-weight:400"
_CELL = "text-align:left;vertical-align:top;padding:.15em .9em .15em 0;background:none;white-space:normal"


def card(name: str, answer: str, label: str, says: str, rows: Mapping[str, str], small: Iterable[str]) -> str:
    """Return a card of HTML: the answer, a row for each fact, and small print, all escaped."""
    facts = "".join(
        f'<tr style="background:none"><th scope="row" style="{_CELL};font-weight:600;white-space:nowrap">'
        f'{escape(row)}</th><td style="{_CELL}">{escape(text)}</td></tr>'
        for row, text in rows.items()
    )
    fine = "".join(f'<p style="{_SOFT};margin:.4em 0 0">{escape(line)}</p>' for line in small)
    paragraph = f'<p style="margin:.3em 0 .6em">{escape(says)}</p>' if says else ""
    return (
        f'<div style="{_CARD}"><p style="{_SOFT};margin:0">{escape(name)}</p>'
        f'<p style="font-size:1.5em;font-weight:650;line-height:1.3;margin:0">{escape(answer)}'
        f' <span style="{_LABEL}">{escape(label)}</span></p>{paragraph}'
        f'<table style="border-collapse:collapse;border:0;margin:0;font-size:1em"><tbody>{facts}</tbody></table>'
        f"{fine}</div>"
    )
