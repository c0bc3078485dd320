"""Tables of batteries and prompt studies: verdicts, Table t:frontier of the paper, every statistic, and the costs."""

from collections.abc import Iterable, Mapping, Sequence

from eyechart.compare import Replication
from eyechart.costs import ALL, Account
from eyechart.report.evidence import Subject
from eyechart.report.table import (
    STATISTIC,
    Cell,
    Column,
    Mark,
    Table,
    columns,
    number,
    p_value,
    statistic_cells,
)
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery import BatteryScore, ModelScore
from eyechart.studies.battery.replication import Difference
from eyechart.studies.prompts import CellScore
from eyechart.verdicts import LABELS, Stopped, Verdict

MARK = "!"
"""Stands behind a verdict of a run that failed a guard; the guard is printed in words below."""

Judged = tuple[str, ModelScore, Verdict]
"""A model's label, its score and its verdict."""


def judged_of(everyone: Sequence[Subject]) -> list[Judged]:
    """Return the models of a report's evidence."""
    return [(who.label, who.model, who.verdict) for who in everyone]


def judged(score: BatteryScore, verdicts: Mapping[str, Verdict]) -> list[Judged]:
    """Return the models of one run."""
    return [(spec, score.models[spec], verdict) for spec, verdict in verdicts.items()]


def tables_of(everyone: Sequence[Judged]) -> tuple[Table, ...]:
    """Return every table of models that were judged."""
    return verdict_table(everyone), frontier_table(everyone), statistics_table(everyone)


def glance_table(everyone: Sequence[Judged]) -> Table:
    """Return one row a model: both verdicts, the lateral label, and the statistic that decided."""
    state = any(verdict.state for _, _, verdict in everyone)
    named = columns("word", "verdict", "lateral", "paper's rules", "decided by")
    rows: list[tuple[Cell, ...]] = []
    for label, model, verdict in everyone:
        name = verdict.calibrated.decided_by
        one = model.statistics[name]
        by = f"{name}{_short(one)}" if verdict.stopped is None else _short_e(name, one, verdict.stopped)
        words = (_label(verdict), verdict.lateral.label, verdict.paper.label, by)
        rows.append((label, *words, *([verdict.state] if state else [])))
    unfinished = [Column("unfinished")] if state else []
    return Table("glance", "", (Column("model"), *named, *unfinished), tuple(rows))


def _label(verdict: Verdict) -> Mark:
    label = verdict.calibrated.label
    return Mark(label, LABELS[label].family, MARK if verdict.failed else "")


def _short(one: Statistic) -> str:
    """Return what matters most of a statistic in few characters: its p, else its value."""
    return f", p {p_value(one.p)}" if one.p is not None else f" {number(one.value, 2)}"


def _short_e(name: str, one: Statistic, stopped: Stopped) -> str:
    """Return an e-value in few characters, and how many of the calls had been made when its run stopped."""
    return f"{name.partition('.')[2]}, e {number(one.value, 0)} ({stopped.calls}/{stopped.planned})"


def verdict_table(everyone: Sequence[Judged]) -> Table:
    """Return one row a model: labels, evidence, and the deciding statistic."""
    named = columns("text", "model", "verdict", "lateral", "evidence", "paper's verdict", "decided by")
    rows = []
    for label, model, verdict in everyone:
        ruling = verdict.calibrated
        words = (label, ruling.label, verdict.lateral.label, verdict.evidence, verdict.paper.label, ruling.decided_by)
        marks = "; ".join(guard.name for guard in verdict.failed)
        rows.append((*words, *statistic_cells(model.statistics[ruling.decided_by]), verdict.state, marks))
    made = (*named, *STATISTIC, *columns("text", "unfinished", "failed guards"))
    return Table("verdicts", "Verdicts and the statistic that decided each", made, tuple(rows))


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


def frontier_table(everyone: Sequence[Judged]) -> Table:
    """Return the paper's Table t:frontier: one column a model, with both verdicts below."""
    made = [frontier_rows(model) for _, model, _ in everyone]
    rows: list[tuple[Cell, ...]] = [(name, *(one[name] for one in made)) for name in (made[0] if made else ())]
    ended = [model.stopped for _, model, _ in everyone]
    if any(ended):
        told = (None if one is None else f"{one.calls} of {one.planned} calls" for one in ended)
        rows.append(("stopped early", *told))
    verdicts = [verdict for _, _, verdict in everyone]
    if any(one.state for one in verdicts):
        rows.append(("unfinished", *(one.progress or None for one in verdicts)))
    rows.append(("verdict (paper)", *(Mark(one.paper.label, "", MARK if one.failed else "") for one in verdicts)))
    rows.append(("verdict (calibrated)", *map(_label, verdicts)))
    named = (Column("metric", "word"), *columns("word", *(label for label, _, _ in everyone)))
    return Table("frontier", "The battery, as the paper prints it", named, tuple(rows))


def statistics_table(everyone: Sequence[Judged]) -> Table:
    """Return every statistic of every model; Holm p is corrected over the models of a run."""
    rows = tuple(
        (label, name, *statistic_cells(one), model.holm.get(name), one.method, one.note, one.unit)
        for label, model, _ in everyone
        for name, one in model.statistics.items()
    )
    named = (Column("model"), Column("statistic", "word"), *STATISTIC, Column("Holm p", "p"))
    caption = "Every statistic with its interval, n and p"
    return Table("statistics", caption, (*named, *columns("text", "method", "note", "unit")), rows)


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
    rows: list[tuple[Cell, ...]] = []
    for name, found in one.differences.items():
        if every or name in MAIN or name in one.changed:
            sides = (found.first, found.second) if isinstance(found, Difference) else (None, None)
            signed = found.value is not None and name not in {"across_runs", "answer_shift"}
            value = f"{found.value:+.3f}" if signed else found.value
            note = {"across_runs": "share answered alike", "answer_shift": "distance"}.get(name, found.note)
            rows.append((name, *sides, value, *statistic_cells(found)[1:], one.holm[name], note))
    named = (Column("statistic", "word"), *columns("number", "first", "second", "difference"), *STATISTIC[1:])
    return Table("replication", one.model, (*named, Column("p (Holm)", "p"), Column("note")), tuple(rows))


def prompts_table(cells: Iterable[CellScore]) -> Table:
    """Return Table t:prompts: diversity, and beside it what the answers hold of the scene."""
    note = (
        "n_a: distinct outputs, UNPARSED among them. Diversity is not scene dependence, which V (real against blank), "
        "I(A;g) in bits and its p, corrected by Holm over these cells, look at. — cannot say"
    )
    rows = []
    for cell in cells:
        found = cell.statistics
        who = (cell.model, Mark(cell.name, "", MARK if cell.marks else ""))
        numbers = [found[name].value for name in ("unparsed_rate", "cramers_v_real_blank", "mutual_information")]
        diversity = (found["modal_share"], found["distinct_outputs"].value, found["idi"])
        p, calls = cell.holm["mutual_information"], f"{cell.answered}/{cell.planned}"
        rows.append((*who, *diversity, *numbers, p, calls))
    named = (
        Column("model"),
        Column("cell", "word"),
        Column("modal share", "estimate", 2),
        Column("n_a", "number", 0),
        Column("IDI", "estimate", 2),
        *columns("number", "unparsed", "V", "I(A;g)"),
        Column("p", "p"),
        Column("calls", "count"),
    )
    return Table("prompts", "Table t:prompts", named, tuple(rows), note)


def costs_table(accounts: Mapping[str, Mapping[str, Account]], *, every: bool) -> Table:
    """Return one row a model, and with ``every`` one a condition: what calls took; nothing stands in as a number."""
    rows = tuple(
        (spec, *([name] if every else []), *_took(account))
        for spec, found in accounts.items()
        for name, account in found.items()
        if every or name == ALL
    )
    named = (
        Column("model"),
        *([Column("condition", "word")] if every else []),
        *columns("count", "calls", "attempts", "retries", "no outcome", "errors", "no decision"),
        *columns("count", "tokens in", "out", "reasoning", "cost"),
        *columns("number", "median s", "p95 s", "first byte s"),
        Column("energy", "number", 1, unit=" J"),
    )
    return Table("costs", "what the calls took", named, rows)


def _took(one: Account) -> tuple[Cell, ...]:
    return (
        one.calls,
        one.attempts,
        _reasons(one.retries),
        one.unknown,
        _reasons(one.errors),
        _reasons(one.missing),
        *("—" if many is None else f"{many:,}" for many in (one.prompt_tokens, one.completion_tokens)),
        "—" if one.reasoning_tokens is None else f"{one.reasoning_tokens:,}",
        _cost(one),
        one.latency_median_s,
        one.latency_p95_s,
        one.first_byte_median_s,
        "not measured" if one.energy_j is None else one.energy_j,
    )


def _reasons(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in counts.items()) or "0"


def _cost(one: Account) -> str:
    if one.cost_usd is None:
        return "unknown"
    unknown = one.cost_from.get("unknown", 0)
    how = "/".join(name for name in one.cost_from if name != "unknown")
    return f"${one.cost_usd:.4f} ({how}{f'; {unknown} unknown' if unknown else ''})"
