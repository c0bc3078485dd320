"""A sheet is a table for other programs: CSV, Markdown, and LaTeX with booktabs, each escaped by its own rules."""

import csv
import io
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from eyechart.report.evidence import Subject
from eyechart.report.tables import frontier_rows, number, p_value
from eyechart.stats.statistic import Statistic, percent

Cell = str | int | float | tuple[float, float] | None
"""A word, a count, a number, an interval, or "cannot say"."""


@dataclass(frozen=True)
class Sheet:
    """A table. ``columns`` are (name, kind), the kind one of text, count, number, interval and p."""

    name: str
    caption: str
    columns: tuple[tuple[str, str], ...]
    rows: tuple[tuple[Cell, ...], ...]

    def csv(self) -> str:
        """Return CSV with full precision; an interval is two columns; a word cannot become a spreadsheet's formula."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        header: list[str] = []
        for name, kind in self.columns:
            header += [f"{name} low", f"{name} high"] if kind == "interval" else [name]
        writer.writerow(header)
        for row in self.rows:
            values: list[str] = []
            for cell, (_, kind) in zip(row, self.columns, strict=True):
                values += _csv_cells(cell, kind)
            writer.writerow(values)
        return out.getvalue()

    def markdown(self) -> str:
        """Return a Markdown table."""
        header = "| " + " | ".join(_markdown(name) for name, _ in self.columns) + " |"
        ruler = "|" + "|".join(" --- " if kind == "text" else " ---: " for _, kind in self.columns) + "|"
        lines = [
            "| " + " | ".join(_markdown(shown(c, k)) for c, (_, k) in zip(row, self.columns, strict=True)) + " |"
            for row in self.rows
        ]
        return "\n".join([f"{_markdown(self.caption)}", "", header, ruler, *lines, ""])

    def latex(self) -> str:
        """Return a LaTeX table that needs the package booktabs."""
        kinds = "".join("l" if kind == "text" else "r" for _, kind in self.columns)
        lines = [
            " & ".join(_latex(shown(c, k)) for c, (_, k) in zip(row, self.columns, strict=True)) + r" \\"
            for row in self.rows
        ]
        header = " & ".join(_latex(name) for name, _ in self.columns) + r" \\"
        top = [
            "% needs \\usepackage{booktabs}",
            r"\begin{table}",
            rf"\caption{{{_latex(self.caption)}}}",
            r"\centering",
        ]
        body = [rf"\begin{{tabular}}{{@{{}}{kinds}@{{}}}}", r"\toprule", header, r"\midrule", *lines, r"\bottomrule"]
        return "\n".join([*top, *body, r"\end{tabular}", r"\end{table}", ""])


def shown(cell: Cell, kind: str) -> str:
    """Return a cell as people read it."""
    if isinstance(cell, tuple):
        return f"[{cell[0]:.3f}, {cell[1]:.3f}]"
    if isinstance(cell, str):
        return cell
    if cell is None:
        return "—"
    return p_value(float(cell)) if kind == "p" else str(cell) if kind == "count" else number(float(cell))


def verdict_sheet(everyone: Sequence[Subject]) -> Sheet:
    """Return one row a model: labels, evidence, and the deciding statistic."""
    columns = (
        *((name, "text") for name in ("model", "verdict", "lateral", "evidence", "paper's verdict", "decided by")),
        ("value", "number"),
        ("interval", "interval"),
        ("level", "text"),
        ("n", "count"),
        ("p", "p"),
        ("unfinished", "text"),
        ("failed guards", "text"),
    )
    rows = []
    for who in everyone:
        ruling = who.verdict.calibrated
        one = who.model.statistics[ruling.decided_by]
        marks = "; ".join(guard.name for guard in who.verdict.failed)
        words = (who.label, ruling.label, who.verdict.lateral.label, who.verdict.evidence, who.verdict.paper.label)
        rows.append((*words, ruling.decided_by, one.value, one.ci, level(one), one.n, one.p, who.verdict.state, marks))
    return Sheet("verdicts", "Verdicts and the statistic that decided each", columns, tuple(rows))


def frontier_sheet(everyone: Sequence[Subject]) -> Sheet:
    """Return the paper's Table t:frontier: one column a model."""
    made = [frontier_rows(who.model) for who in everyone]
    rows: list[tuple[Cell, ...]] = [(name, *(one[name] for one in made)) for name in (made[0] if made else ())]
    if any(who.verdict.state for who in everyone):
        rows.append(("unfinished", *(who.verdict.state.removeprefix("unfinished: ") or None for who in everyone)))
    rows.append(("verdict (paper)", *(who.verdict.paper.label for who in everyone)))
    rows.append(("verdict (calibrated)", *(who.verdict.calibrated.label for who in everyone)))
    columns = (("metric", "text"), *((who.label, "text") for who in everyone))
    return Sheet("frontier", "The battery, as the paper prints it", columns, tuple(rows))


STATISTIC_COLUMNS = (
    ("statistic", "text"),
    ("value", "number"),
    ("interval", "interval"),
    ("level", "text"),
    ("n", "count"),
    ("p", "p"),
    ("Holm p", "p"),
    ("method", "text"),
    ("note", "text"),
)


def statistic_rows(who: Subject) -> list[tuple[Cell, ...]]:
    """Return every statistic of a model in the order of ``STATISTIC_COLUMNS``; Holm p is corrected over the models."""
    holm = who.model.holm
    return [
        (name, one.value, one.ci, level(one), one.n, one.p, holm.get(name), one.method, one.note)
        for name, one in who.model.statistics.items()
    ]


def level(one: Statistic) -> str:
    """Return the level of a statistic's interval; empty where there is none."""
    return "" if one.ci is None else percent(one.level)


def statistics_sheet(everyone: Sequence[Subject]) -> Sheet:
    """Return every statistic of every model."""
    columns = (("model", "text"), *STATISTIC_COLUMNS)
    rows = tuple((who.label, *row) for who in everyone for row in statistic_rows(who))
    return Sheet("statistics", "Every statistic with its interval, n and p", columns, rows)


def sheet_files(everyone: Sequence[Subject]) -> dict[str, bytes]:
    """Return verdicts, the frontier table and the statistics as CSV, Markdown and LaTeX, by their files' names."""
    return files_of((verdict_sheet(everyone), frontier_sheet(everyone), statistics_sheet(everyone)))


def files_of(sheets: Sequence[Sheet]) -> dict[str, bytes]:
    """Return sheets as CSV, Markdown and LaTeX, by their files' names."""
    made = {}
    for sheet in sheets:
        for suffix, text in (("csv", sheet.csv()), ("md", sheet.markdown()), ("tex", sheet.latex())):
            made[f"{sheet.name}.{suffix}"] = text.encode("utf-8", "backslashreplace")
    return made


def write_sheets(everyone: Sequence[Subject], folder: Path) -> list[Path]:
    """Write the tables as CSV, Markdown and LaTeX; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    made = {folder / name: content for name, content in sheet_files(everyone).items()}
    for path, content in made.items():
        path.write_bytes(content)
    return list(made)


def _csv_cells(cell: Cell, kind: str) -> list[str]:
    if kind == "interval":
        return ["", ""] if not isinstance(cell, tuple) else [repr(cell[0]), repr(cell[1])]
    if cell is None or cell == "—":
        return [""]
    if not isinstance(cell, str):
        return [repr(cell)]
    text = _one_line(cell)
    return ["'" + text if text.lstrip()[:1] in set("=+-@") and not _is_number(text) else text]


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[+-]?\d+(\.\d+)?", text) is not None


def _one_line(text: str) -> str:
    """Return text without control signs, which no cell may hold."""
    return "".join(" " if unicodedata.category(sign) == "Cc" else sign for sign in text)


def _markdown(text: str) -> str:
    escaped = re.sub(r"([\\`*_{}\[\]<>|~$#])", r"\\\1", _one_line(text).replace("&", "&amp;"))
    return escaped.replace("\\<", "&lt;").replace("\\>", "&gt;")


_LATEX = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "—": "---",
    "·": r"\textperiodcentered{}",
    **{sign: f"\\{sign}" for sign in "&%$#_"},
}


def _latex(text: str) -> str:
    if text == "<10⁻⁴":
        return "$<10^{-4}$"
    escaped = "".join(_LATEX.get(sign, sign) for sign in _one_line(text))
    return f"{{{escaped[0]}}}{escaped[1:]}" if escaped[:1] in {"[", "*"} else escaped  # or the line above takes it
