"""Tables for the terminal: verdicts, statistics, and Table t:frontier of the paper."""

from collections.abc import Mapping, Sequence

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from eyechart.compare import Replication
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery import BatteryScore, ModelScore
from eyechart.studies.prompts import CellScore
from eyechart.verdicts import LABELS, Stopped, Verdict

MARK = " !"
"""Stands behind a verdict of a run that failed a guard; the guard is printed in words below."""


def number(value: float | None, digits: int = 3) -> str:
    """Return a number as text; "cannot say" is a dash."""
    return "—" if value is None else f"{value:.{digits}f}"


def p_value(p: float | None) -> str:
    """Return a p as the paper prints it: four digits, or ``<10⁻⁴``."""
    if p is None:
        return "—"
    return "<10⁻⁴" if p < 0.0001 else f"{p:.4f}" if p < 0.01 else f"{p:.3f}"


def verdict_table(score: BatteryScore, verdicts: Mapping[str, Verdict]) -> Table:
    """Return one row a model: both verdicts, the lateral label, and the statistic that decided."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for name in ("model", "verdict", "lateral", "paper's rules", "decided by"):
        table.add_column(name, no_wrap=True)
    for spec, verdict in verdicts.items():
        label, name = verdict.calibrated.label, verdict.calibrated.decided_by
        deciding = score.models[spec].statistics[name]
        table.add_row(
            Text(spec),
            Text(
                "\n".join(filter(None, (f"{label}{MARK if verdict.failed else ''}", verdict.state))),
                style=LABELS[label].colour,
            ),
            verdict.lateral.label,
            verdict.paper.label,
            f"{name}{_short(deciding)}" if verdict.stopped is None else _short_e(name, deciding, verdict.stopped),
        )
    return table


def _short(one: Statistic) -> str:
    """Return what matters most of a statistic in few characters: its p, else its value."""
    return f", p {p_value(one.p)}" if one.p is not None else f" {number(one.value, 2)}"


def _short_e(name: str, one: Statistic, stopped: Stopped) -> str:
    """Return an e-value in few characters, and how many of the calls had been made when its run stopped."""
    return f"{name.partition('.')[2]}, e {number(one.value, 0)} ({stopped.calls}/{stopped.planned})"


def frontier_rows(score: ModelScore) -> dict[str, str]:
    """Return one column of Table t:frontier: the paper's rows, as it prints them."""
    found = score.statistics
    swap, clears = found["mirror_swap_rate"], found["clears_floor"].value
    return {
        "unparsed rate": number(found["unparsed_rate"].value),
        "noise floor s": number(found["noise_floor"].value),
        "agree(blank)": number(found["agree.blank"].value),
        "agree(noise)": number(found["agree.noise"].value),
        "agree(text_only)": number(found["agree.text_only"].value),
        "agree(shuffled)": number(found["agree.shuffled"].value),
        "agree(cross_scenario)": number(found["agree.cross_scenario"].value),
        "Cramér's V": number(found["cramers_v"].value),
        "V (real, blank)": number(found["cramers_v_real_blank"].value),
        "IDI_adj": number(found["idi_adj"].value),
        "clears noise floor": "—" if clears is None else "yes" if clears else "no",
        "n_dir": str(swap.n),
        "mirror swap rate": number(swap.value),
        "I(A;g) (bits)": number(found["mutual_information.decision"].value),
        "p (permutation)": p_value(found["mutual_information.decision"].p),
        "p (action vs. obstacle)": p_value(found["obstacle.decision"].p),
    }


def frontier_table(score: BatteryScore, verdicts: Mapping[str, Verdict]) -> Table:
    """Return Table t:frontier over the run's models, with both verdicts below."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("metric")
    columns = {spec: frontier_rows(one) for spec, one in score.models.items()}
    for spec in columns:
        table.add_column(Text(spec), justify="right")
    for row in next(iter(columns.values()), {}):
        table.add_row(row, *(column[row] for column in columns.values()))
    marks = {spec: MARK if verdicts[spec].failed else "" for spec in columns}
    if any(one.stopped for one in score.models.values()):
        ended = (one.stopped for one in score.models.values())
        table.add_row(
            "stopped early", *("—" if one is None else f"{one.calls} of {one.planned} calls" for one in ended)
        )
    if any(verdicts[spec].state for spec in columns):
        table.add_row("unfinished", *(verdicts[spec].state.removeprefix("unfinished: ") or "—" for spec in columns))
    table.add_row("verdict (paper)", *(verdicts[spec].paper.label + marks[spec] for spec in columns))
    table.add_row("verdict (calibrated)", *(verdicts[spec].calibrated.label + marks[spec] for spec in columns))
    return table


def statistics_table(score: ModelScore) -> Table:
    """Return every statistic of one model with its interval, n and p."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title=Text(score.model), title_justify="left")
    for name, justify in (("statistic", "left"), ("value", "right"), ("95 % interval", "right"), ("n", "right")):
        table.add_column(name, justify="left" if justify == "left" else "right")
    table.add_column("p", justify="right")
    table.add_column("p (Holm)", justify="right")
    table.add_column("note", overflow="fold")
    for name, one in score.statistics.items():
        table.add_row(
            name, number(one.value), _interval(one), str(one.n), p_value(one.p), _holm(score, name), Text(one.note)
        )
    return table


MAIN = (
    "across_runs",
    "answer_shift",
    "unparsed_rate",
    "noise_floor",
    "idi",
    "idi_adj",
    "cramers_v",
    "mutual_information.decision",
    "obstacle.decision",
    "mirror_swap_rate",
    "modal_share",
)
"""What a comparison prints unless all statistics are asked for: the paper's replication paragraph, and its like."""


def replication_table(one: Replication, *, every: bool = False) -> Table:
    """Return one row a statistic: both runs' values, the difference with its interval, n and p."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title=Text(one.model), title_justify="left")
    table.add_column("statistic")
    for name in ("first", "second", "difference", "95 % interval", "n", "p", "p (Holm)"):
        table.add_column(name, justify="right")
    table.add_column("note", overflow="fold")
    for name, found in one.differences.items():
        if every or name in MAIN or name in one.changed:
            sides = [number(_side(found, side)) for side in ("first", "second")]
            signed = found.value is not None and name not in {"across_runs", "answer_shift"}
            value = f"{found.value:+.3f}" if signed else number(found.value)
            p = p_value(found.p), p_value(one.holm[name])
            note = {"across_runs": "share answered alike", "answer_shift": "distance"}.get(name, found.note)
            table.add_row(name, *sides, value, _interval(found), str(found.n), *p, Text(note))
    return table


def prompts_table(model: str, cells: Sequence[CellScore]) -> Table:
    """Return one model's part of Table t:prompts: diversity, and beside it what the answers hold of the scene."""
    caption = (
        "n_a: distinct outputs, UNPARSED among them. Diversity is not scene dependence, which V (real against blank), "
        "I(A;g) in bits and its p, corrected by Holm over these cells, look at. — cannot say"
    )
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title=Text(model), title_justify="left", caption=caption)
    table.add_column("cell", no_wrap=True)
    for name in ("modal share", "n_a", "IDI", "unparsed", "V", "I(A;g)", "p", "calls"):
        table.add_column(name, justify="right", no_wrap=True)
    for cell in cells:
        found = cell.statistics
        modal, idi = (f"{number(found[name].value, 2)} {_interval(found[name], 2)}" for name in ("modal_share", "idi"))
        table.add_row(
            Text(f"{cell.name}{MARK if cell.marks else ''}"),
            modal,
            number(found["distinct_outputs"].value, 0),
            idi,
            number(found["unparsed_rate"].value),
            number(found["cramers_v_real_blank"].value),
            number(found["mutual_information"].value),
            p_value(cell.holm["mutual_information"]),
            f"{cell.answered}/{cell.planned}",
        )
    return table


def _side(found: Statistic, side: str) -> float | None:
    value = (found.detail or {}).get(side)
    return value if isinstance(value, float) else None


def _interval(one: Statistic, digits: int = 3) -> str:
    return "—" if one.ci is None else f"[{one.ci[0]:.{digits}f}, {one.ci[1]:.{digits}f}]"


def _holm(score: ModelScore, name: str) -> str:
    return p_value(score.holm[name]) if name in score.holm else ""
