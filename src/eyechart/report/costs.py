"""The table of what calls took: nothing that was not measured or reported stands in it as a number."""

from collections.abc import Mapping

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from eyechart.costs import ALL, Account

_COLUMNS = (
    "calls",
    "attempts",
    "retries",
    "no outcome",
    "errors",
    "no decision",
    "tokens in",
    "out",
    "reasoning",
    "cost",
    "median s",
    "p95 s",
    "first byte s",
    "energy",
)


def costs_table(accounts: Mapping[str, Mapping[str, Account]], *, every: bool) -> Table:
    """Return one row a model, and with ``every`` one a condition below it."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title=Text("what the calls took"), title_justify="left")
    table.add_column("model")
    for name in _COLUMNS:
        table.add_column(name, justify="right")
    for spec, found in accounts.items():
        for name, account in found.items():
            if every or name == ALL:
                table.add_row(Text(spec if name == ALL else f"  {name}"), *map(Text, _cells(account)))
    return table


def _cells(one: Account) -> tuple[str, ...]:
    return (
        str(one.calls),
        str(one.attempts),
        _reasons(one.retries),
        str(one.unknown),
        _reasons(one.errors),
        _reasons(one.missing),
        _count(one.prompt_tokens),
        _count(one.completion_tokens),
        _count(one.reasoning_tokens),
        _cost(one),
        _seconds(one.latency_median_s),
        _seconds(one.latency_p95_s),
        _seconds(one.first_byte_median_s),
        "not measured" if one.energy_j is None else f"{one.energy_j:.1f} J",
    )


def _reasons(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in counts.items()) or "0"


def _count(value: int | None) -> str:
    return "—" if value is None else f"{value:,}"


def _seconds(value: float | None) -> str:
    return "—" if value is None else f"{value:.3f}"


def _cost(one: Account) -> str:
    if one.cost_usd is None:
        return "unknown"
    unknown = one.cost_from.get("unknown", 0)
    how = "/".join(name for name in one.cost_from if name != "unknown")
    return f"${one.cost_usd:.4f} ({how}{f'; {unknown} unknown' if unknown else ''})"
