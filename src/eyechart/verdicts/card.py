"""A card is what a notebook shows of a verdict: plain HTML with its style inside, and every word of it escaped."""

from collections.abc import Iterable
from html import escape

from eyechart.stats.statistic import Statistic
from eyechart.verdicts.ruling import number, p_value

_CARD = (
    "border:1px solid rgba(128,128,128,.4);border-radius:8px;padding:.9em 1.1em;margin:.6em 0;max-width:46em;"
    "text-align:left;overflow-wrap:anywhere"
)
_SOFT = "opacity:.75;font-size:.9em"
_CELL = "text-align:left;vertical-align:top;padding:.15em .9em .15em 0;background:none;white-space:normal"


def card(*, model: str, label: str, sentence: str, rows: Iterable[tuple[str, str]], small: Iterable[str]) -> str:
    """Return a verdict as HTML: whose it is, the label, the sentence, a row a fact, and the small print.

    The arguments are plain text; tags in them come out as text. The colours are the notebook's own.
    """
    facts = "".join(
        f'<tr style="background:none"><th scope="row" style="{_CELL};font-weight:600;white-space:nowrap">'
        f'{escape(name)}</th><td style="{_CELL}">{escape(text)}</td></tr>'
        for name, text in rows
    )
    print_small = "".join(f'<p style="{_SOFT};margin:.4em 0 0">{escape(line)}</p>' for line in small)
    return (
        f'<div style="{_CARD}"><p style="{_SOFT};margin:0">{escape(model)}</p>'
        f'<p style="font-size:1.5em;font-weight:650;line-height:1.3;margin:0">{escape(label)}</p>'
        f'<p style="margin:.3em 0 .6em">{escape(sentence)}</p>'
        f'<table style="border-collapse:collapse;border:0;margin:0"><tbody>{facts}</tbody></table>{print_small}</div>'
    )


def numbers(name: str, statistic: Statistic | None) -> str:
    """Return a statistic's name with its value, interval, n and p; what there is none of is a dash."""
    if statistic is None:
        return name
    interval = "—" if statistic.ci is None else f"[{statistic.ci[0]:.3f}, {statistic.ci[1]:.3f}]"
    p = "—" if statistic.p is None else p_value(statistic.p)
    return f"{name} = {number(statistic)}, interval {interval}, n = {statistic.n}, p = {p}"
