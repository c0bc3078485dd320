"""Transfer: the correlation of an external score with a statistic of grounding, over models."""

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Protocol

from eyechart.errors import SpecError, did_you_mean, raising, read_at_most
from eyechart.records import JsonRecord
from eyechart.report.table import Column, Table, columns, number, p_value
from eyechart.stats.correlation import Correlation, pearson, spearman
from eyechart.stats.statistic import ModelStatistics, Statistic

MEASURE = "mutual_information.decision"
"""The default statistic for grounding: bits of information in the decisions about the gap.

Drives have it too, about the scene at each step (Table t:degeneracy).
"""

_FILE_BYTES = 10_000_000


@dataclass(frozen=True, slots=True)
class Cell:
    """One model on one ``bank`` or simulator: its external score, and its mean over ``runs``."""

    model: str
    bank: str
    score: float
    measured: float
    runs: int


@dataclass(frozen=True)
class Transfer(JsonRecord):
    """The cells, both correlations over them, and what was left out, with reasons."""

    measure: str
    cells: tuple[Cell, ...]
    pearson: Statistic
    spearman: Statistic
    left_out: tuple[str, ...]
    unfinished: tuple[str, ...] = ()

    def lines(self) -> Iterator[str]:
        """Yield the cells, what was left out, and both correlations, a line each."""
        for cell in self.cells:
            mean = f" (mean of {cell.runs} runs)" if cell.runs > 1 else ""
            yield f"{cell.model} on {cell.bank}: score {cell.score:g}, {self.measure} {cell.measured:.3f}{mean}"
        yield from (f"left out: {line}" for line in self.left_out)
        yield from (f"unfinished: {line}" for line in self.unfinished)
        for name, one in (("Pearson", self.pearson), ("Spearman", self.spearman)):
            interval = "—" if one.ci is None else f"[{one.ci[0]:.3f}, {one.ci[1]:.3f}]"
            how = ""
            if isinstance(one, Correlation):
                exact = "" if one.p_exact is None else f"; over all orders {p_value(one.p_exact)}"
                how = f" ({one.how}{exact})"
            why = f" ({one.note})" if one.note else ""
            yield f"{name} r = {number(one.value)}, 95 % interval {interval}, p {p_value(one.p)}{how}, n {one.n}{why}"


def read_scores(path: Path) -> dict[str, float]:
    """Read a CSV file with the columns ``model`` (a SPEC as in runs) and ``score`` (a number).

    Raises SpecError that names the file, the row and the fault.
    """
    raw = read_at_most(path, _FILE_BYTES, SpecError, "a table of scores")
    with raising(SpecError, f"{path} is no CSV file", of=(UnicodeDecodeError, csv.Error)):
        rows = csv.DictReader(io.StringIO(raw.decode("utf-8-sig"), newline=""))
        columns = rows.fieldnames or []
        if missing := [name for name in ("model", "score") if name not in columns]:
            raise SpecError(f"{path} has no column '{missing[0]}'; it has {', '.join(columns) or 'none'}")
        return _scores(path, rows)


def _scores(path: Path, rows: "csv.DictReader[str]") -> dict[str, float]:
    scores: dict[str, float] = {}
    for line, row in enumerate(rows, start=2):
        model, text = (row["model"] or "").strip(), (row["score"] or "").strip()
        try:
            score = float(text)
        except ValueError:
            raise SpecError(f"{path}, row {line}: the score of '{model}' is '{text}', not a number") from None
        if not math.isfinite(score):
            raise SpecError(f"{path}, row {line}: the score of '{model}' is '{text}', not a finite number")
        if model in scores:
            raise SpecError(f"{path}, row {line}: '{model}' has two scores; give each model one")
        scores[model] = score
    return scores


class Run(Protocol):
    """A scored run of any study."""

    def measured(self) -> Sequence[ModelStatistics]:
        """Return the statistics of each model in each place."""


def transfer(runs: Sequence[Run], scores: dict[str, float], *, measure: str = MEASURE) -> Transfer:
    """Correlate external scores with a statistic over every model of every run, of any study.

    A model on two banks, in two simulators, or under two prompts is two cells. Several runs of a
    model in one place are replicates: they are averaged to one cell, since they add no evidence
    about models. Models without a score, scores without a model and statistics without a value are
    listed as left out. Raises SpecError if no run has the statistic. Source: paper, section
    Transfer and deployment characteristics.
    """
    values: dict[tuple[str, str], list[float]] = {}
    left_out, every = [], [one for run in runs for one in run.measured()]
    known = list(dict.fromkeys(name for one in every for name in one.statistics))
    if every and measure not in known:
        raise SpecError(
            f"there is no statistic '{measure}';{did_you_mean(measure, known)} these runs have {', '.join(known)}"
        )
    for one in every:
        found, place = one.statistics.get(measure), f"{one.model} on {one.where}"
        if one.model not in scores:
            left_out.append(f"{place}: no external score")
        elif found is None:
            left_out.append(f"{place}: its run has no {measure}")
        elif found.value is None:
            left_out.append(f"{place}: {measure} cannot say ({found.note})")
        else:
            values.setdefault((one.model, one.where), []).append(found.value)
    models = {one.model for one in every}
    left_out += [f"{spec}: a score, but no run has it" for spec in scores if spec not in models]
    cells = [Cell(spec, where, scores[spec], fmean(each), len(each)) for (spec, where), each in values.items()]
    columns = [cell.score for cell in cells], [cell.measured for cell in cells]
    waiting = [f"{one.model} on {one.where}: {one.unfinished}" for one in every if one.unfinished]
    return Transfer(measure, tuple(cells), pearson(*columns), spearman(*columns), tuple(left_out), tuple(waiting))


def transfer_table(found: Transfer) -> Table:
    """Return both correlations with their interval, p and number of cells."""
    both = (("Pearson", found.pearson), ("Spearman", found.spearman))
    rows = tuple((name, one, one.p, len(found.cells), one.note or None) for name, one in both)
    named = (Column("correlation"), *columns("estimate", "r", beside=""), Column("p", "p"), Column("cells", "count"))
    caption = f"Transfer: external scores against {found.measure} over models"
    return Table("transfer", caption, (*named, Column("note")), rows, "; ".join(found.left_out))
