"""A verdict as a notebook shows it: a card of HTML in which all that a model said is text."""

from collections.abc import Iterable, Mapping
from html import escape

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
    told = f'<p style="margin:.3em 0 .6em">{escape(says)}</p>' if says else ""
    return (
        f'<div style="{_CARD}"><p style="{_SOFT};margin:0">{escape(name)}</p>'
        f'<p style="font-size:1.5em;font-weight:650;line-height:1.3;margin:0">{escape(answer)}'
        f' <span style="{_LABEL}">{escape(label)}</span></p>{told}'
        f'<table style="border-collapse:collapse;border:0;margin:0;font-size:1em"><tbody>{facts}</tbody></table>'
        f"{fine}</div>"
    )
