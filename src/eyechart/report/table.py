"""A table: rows with a caption, for a terminal, CSV, Markdown, LaTeX and HTML."""

import csv
import io
import math
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from markupsafe import Markup

from eyechart.stats.statistic import Statistic, UpperBound, percent

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult
    from rich.table import Table as RichTable

Kind = Literal["text", "word", "count", "number", "interval", "p", "estimate"]
"""A column's content: text that may wrap, a word, or numbers; an estimate has an interval."""

_UNKNOWN = frozenset({"", "—", "unknown", "not measured"})
"""Texts of a cell with an unknown value."""
_COMMAND = re.compile(r"'(eyechart [^'\n]+)'|(?<![\w-])(--[a-z][a-z-]*)|(?<=\bin )`([^`\n]+)`")
"""A command that is quoted in a sentence, an option, or the place that a sentence says something is in.

Backticks of others, as in a reply or a model's name, stay text.
"""

MARK = "!"
"""The mark of a verdict whose run failed a sanity check; the check is explained below the table."""
_NARROWEST = 16
"""The narrowest text column; a table that needs less is printed row by row."""
_COLUMN = 100
"""The most characters of a row in a LaTeX text column, at 5 points or more."""
_WORDS = {"text", "word"}
_FORMULA = re.compile(r"(?:^|[;\t])[\s\u200b\u200c\u200d\ufeff\ufffd\"']*[=+\-@＝＋－＠]")
"""What a spreadsheet takes for a formula, in a cell or in a part of one."""
_JOINERS = frozenset("\u200c\u200d")
"""Zero-width characters that some scripts need in words."""
_TONES = {"good": "green", "sees": "green", "partly": "yellow", "open": "dim", "bad": "red", "blind": "red"}


@dataclass(frozen=True, slots=True)
class Mark:
    """A word with a tone (good, bad, sees, partly, blind, open), and a sign for people.

    On a page it links to ``place``, an address relative to the page, such as ``#id``.
    """

    text: str
    tone: str = ""
    sign: str = ""
    place: str = ""


class OneSidedInterval(NamedTuple):
    """An interval whose lower end bounds nothing; people see its upper end alone."""

    low: float
    high: float


Cell = str | int | float | tuple[float, float] | Statistic | Mark | None
"""A word, a count, a number, an interval, an estimate or "cannot say"; any cell may be a word."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column.

    People read numbers times ``scale``, with ``digits`` and ``unit``; programs read raw numbers. A
    column that ``varies`` is hidden from people if all its cells are equal. Beside an estimate
    people read its interval, its n or nothing, as ``beside`` says; programs read both. People read
    no number below ``least``: that of a share is the noise of its estimate.
    """

    name: str = ""
    kind: Kind = "text"
    digits: int = 3
    scale: float = 1.0
    unit: str = ""
    signed: bool = False
    varies: bool = False
    beside: Literal["interval", "n", ""] = "interval"
    least: float = -math.inf

    def shown(self, cell: Cell) -> str:
        """Return a cell of the column as people read it."""
        if isinstance(cell, Mark):
            return f"{cell.text} {cell.sign}".rstrip()
        if isinstance(cell, Statistic):
            suffix = {"interval": cell.ci and self.shown(ends(cell)), "n": f"({cell.n})", "": ""}[self.beside]
            return f"{self.shown(cell.value)} {suffix or ''}".rstrip()
        if isinstance(cell, tuple):
            return self._interval(cell)
        if isinstance(cell, str):
            return cell
        if cell is None or self.kind == "p":
            return p_value(cell)
        return str(cell) if self.kind == "count" else self._digits(self.scale * cell) + self.unit

    def _interval(self, cell: tuple[float, float]) -> str:
        if isinstance(cell, OneSidedInterval):
            return f"at most {self._digits(self.scale * cell.high)}"
        return f"[{', '.join(self._digits(self.scale * end) for end in cell)}]"

    def _digits(self, value: float) -> str:
        return f"{max(value, self.least):{'+' if self.signed else ''}.{self.digits}f}"

    def head(self, *, stacked: bool) -> str:
        """Return the column's name for a terminal."""
        return re.sub("[ _]", "\n", self.name) if stacked else self.name

    @property
    def heads(self) -> list[str]:
        """Return the column's names in CSV, where an interval is two columns."""
        ends = [f"{self.name} low", f"{self.name} high"]
        if self.kind != "estimate":
            return ends if self.kind == "interval" else [self.name]
        return [self.name, *ends, *([f"{self.name} n"] if self.beside != "interval" else [])]

    def values(self, cell: Cell) -> list[str]:
        """Return a cell as programs read it."""
        if self.kind == "estimate":
            value, ci = (cell.value, cell.ci) if isinstance(cell, Statistic) else (cell, None)
            counted = [repr(cell.n) if isinstance(cell, Statistic) else ""] if self.beside != "interval" else []
            return [_raw(value), *(map(repr, ci) if ci else ("", "")), *counted]
        if self.kind == "interval":
            return [repr(end) for end in cell] if isinstance(cell, tuple) else ["", ""]
        return [_raw(cell)]


def columns(kind: Kind, *names: str, digits: int = 3, **form: object) -> tuple[Column, ...]:
    """Return columns of one kind and form."""
    return tuple(replace(Column(name, kind, digits), **form) for name in names)  # type: ignore[arg-type]


STATISTIC = (
    Column("value", "number"),
    Column("interval", "interval"),
    Column("level", "word"),
    Column("n", "count"),
    Column("p", "p"),
)
"""The columns of a statistic; ``statistic_cells`` returns the cells."""


def statistic_cells(statistic: Statistic) -> tuple[Cell, ...]:
    """Return a statistic's value, interval with its level, n and p."""
    return statistic.value, ends(statistic), level(statistic), statistic.n, statistic.p


def ends(one: Statistic) -> tuple[float, float] | None:
    """Return a statistic's interval, as an `OneSidedInterval` if only its upper end bounds."""
    return OneSidedInterval(*one.ci) if isinstance(one, UpperBound) and one.ci is not None else one.ci


def level(one: Statistic) -> str:
    """Return the level of a statistic's interval; empty without an interval."""
    return "" if one.ci is None else percent(one.level)


def in_words(one: Statistic) -> str:
    """Return a statistic as text that may wrap: value, interval with its level, n and p."""
    interval = "" if one.ci is None else f" {STATISTIC[1].shown(ends(one))} ({level(one).replace(' ', '')})"
    return f"{number(one.value)}{interval}, n {one.n}{'' if one.p is None else f', p {p_value(one.p)}'}"


@dataclass(frozen=True)
class Table:
    """Rows under columns.

    ``name`` is the stem of its files. ``title`` stands above and ``note`` below it. ``about`` is
    the common beginning of the titles of tables with one label; the caption is the rest. With a
    ``label`` its LaTeX looks like the paper's: small, and at most one text column wide.
    """

    name: str
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    label: str = ""
    about: str = ""

    @property
    def title(self) -> str:
        """Return the table's title: what it is about, and its caption."""
        return ": ".join(filter(None, (self.about, self.caption)))

    def labelled(self, label: str, caption: str = "") -> "Table":
        """Return the table under the paper's label, which names its files, recaptioned if given."""
        return replace(self, name=label.replace(":", "-"), caption=caption or self.caption, label=label)

    def counted(self, counts: Sequence[int | None], unit: str, each: str = "") -> "Table":
        """Return the table with the number of ``unit`` per row in its caption.

        ``counts`` are by row, None for a row without one. Different counts become a last column.
        ``each`` follows the unit, as "per model".
        """
        says = " ".join(filter(None, (of_each(counts), unit, each)))
        table = replace(self, caption=f"{self.caption}{'. ' if '. ' in self.caption else ', '}{says}")
        if len({count for count in counts if count is not None}) < 2:
            return table
        rows = tuple((*row, count) for row, count in zip(self.rows, counts, strict=True))
        return replace(table, columns=(*self.columns, Column(unit, "count")), rows=rows)

    def joined(self, other: "Table") -> "Table":
        """Return the table with another's columns, matched by the first column.

        Rows may be in one only. If both are about the same, the caption joins both captions.
        """
        mine, theirs = ({self.head(row): row[1:] for row in one.rows} for one in (self, other))
        none = [(None,) * (len(one.columns) - 1) for one in (self, other)]
        heads = {self.head(row): row[0] for row in (*other.rows, *self.rows)}
        order = dict.fromkeys((*mine, *theirs))
        rows = tuple((heads[name], *mine.get(name, none[0]), *theirs.get(name, none[1])) for name in order)
        note = " ".join(filter(None, (self.note, other.note)))
        alike = self.about == other.about != "" and self.caption != other.caption
        caption = f"{self.caption}; {other.caption}" if alike else self.caption
        return replace(self, caption=caption, columns=(*self.columns, *other.columns[1:]), rows=rows, note=note)

    @staticmethod
    def head(row: "tuple[Cell, ...]") -> str:
        """Return the text of a row's first cell."""
        return row[0].text if isinstance(row[0], Mark) else str(row[0])

    def split(self) -> "Iterator[Table]":
        """Yield a table for each value of the first column, with that value as its caption."""
        for head in dict.fromkeys(row[0] for row in self.rows):
            rows = tuple(row[1:] for row in self.rows if row[0] == head)
            yield replace(self, caption=self.columns[0].shown(head), columns=self.columns[1:], rows=rows)

    @property
    def names(self) -> list[str]:
        """Return the columns' names."""
        return [column.name for column in self.columns]

    def renamed(self, short: Callable[[str], str]) -> "Table":
        """Return the table with ``short`` applied to all its words."""

        def made(cell: Cell) -> Cell:
            if isinstance(cell, Mark):
                return replace(cell, text=short(cell.text))
            return short(cell) if isinstance(cell, str) else cell

        named = tuple(replace(column, name=short(column.name)) for column in self.columns)
        rows = tuple(tuple(map(made, row)) for row in self.rows)
        return replace(self, caption=short(self.caption), columns=named, rows=rows, note=short(self.note))

    def as_read(self) -> dict[str, Any]:
        """Return the table as people read it, in plain values from which `of_read` makes it again."""
        tones = [[cell.tone if isinstance(cell, Mark) else "" for cell in row] for row in self.rows]
        shown = [[column.shown(cell) for cell, column in zip(row, self.columns, strict=True)] for row in self.rows]
        heads = [[one.name, one.kind, one.varies] for one in self.columns]
        said = {"name": self.name, "caption": self.caption, "note": self.note, "about": self.about}
        return {**said, "columns": heads, "texts": shown, "tones": tones}

    @classmethod
    def of_read(cls, read: Mapping[str, Any]) -> "Table":
        """Return a table of texts for a terminal, from what `as_read` returned."""
        rows = tuple(
            tuple(Mark(text, tone) if tone else text for text, tone in zip(texts, tones, strict=True))
            for texts, tones in zip(read["texts"], read["tones"], strict=True)
        )
        heads = tuple(Column(name, kind, varies=varies) for name, kind, varies in read["columns"])
        return cls(read["name"], read["caption"], heads, rows, note=read["note"], about=read["about"])

    def texts(self) -> list[list[str]]:
        """Return every cell as people read it, without control characters."""
        return [[_plain(column.shown(c)) for c, column in zip(row, self.columns, strict=True)] for row in self.rows]

    def short(self) -> "Table":
        """Return the table without empty word columns, and ``varies`` columns that do not vary."""
        texts = list(zip(*self.texts(), strict=True)) or [()] * len(self.columns)
        kept = [
            place
            for place, (column, cells) in enumerate(zip(self.columns, texts, strict=True))
            if not (column.varies and len(set(cells)) < 2)
            and not (place and column.kind in _WORDS and not any(cell.strip("—") for cell in cells))
        ]
        rows = tuple(tuple(row[place] for place in kept) for row in self.rows)
        return replace(self, columns=tuple(self.columns[place] for place in kept), rows=rows)

    def known(self) -> "Table":
        """Return the table without columns that are unknown in every row; the first stays."""
        texts = list(zip(*self.texts(), strict=True)) or [()] * len(self.columns)
        kept = [place for place, cells in enumerate(texts) if not place or not _UNKNOWN.issuperset(cells)]
        rows = tuple(tuple(row[place] for place in kept) for row in self.rows)
        return replace(self, columns=tuple(self.columns[place] for place in kept), rows=rows)

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        """Print the table without cutting: whole, or with stacked intervals, or row by row."""
        from rich.text import Text  # noqa: PLC0415 - slow to import

        del console
        short = self.short()
        for stacked in (False, True):
            if short.width(stacked=stacked) <= options.max_width:
                yield short.rich(stacked=stacked)
                return
        yield Text(self.title, style="italic")
        for row in short.texts():
            yield Text(row[0], style="bold")
            for column, text in zip(short.columns[1:], row[1:], strict=True):
                if text:
                    yield Text(f"  {column.name}: {text}")
        yield Text(self.note)

    def rich(self, *, stacked: bool = False) -> "RichTable":
        """Return the table for a terminal; ``stacked`` puts intervals below and splits heads."""
        from rich.box import SIMPLE_HEAD  # noqa: PLC0415 - slow to import
        from rich.table import Table as RichTable  # noqa: PLC0415 - as above
        from rich.text import Text  # noqa: PLC0415 - as above

        made = RichTable(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0) if stacked else (0, 1))
        made.title, made.title_justify = (Text(self.title) if self.title else None), "left"
        made.caption, made.caption_justify = (Text(self.note) if self.note else None), "left"
        for column in self.columns:
            text, head = column.kind == "text", Text(column.head(stacked=stacked))
            side: Literal["left", "right"] = "left" if column.kind in _WORDS else "right"
            made.add_column(head, justify=side, overflow="fold", no_wrap=not text)
        for row, texts in zip(self.rows, self.texts(), strict=True):
            tones = [_TONES.get(cell.tone, "") if isinstance(cell, Mark) else "" for cell in row]
            stacks = [stacked and column.kind not in _WORDS for column in self.columns]
            cells = [_stack(text, stacked=stack) for text, stack in zip(texts, stacks, strict=True)]
            made.add_row(*map(Text, cells, tones))
        return made

    def width(self, *, stacked: bool) -> int:
        """Return the least width of the table in terminal columns."""
        width = 2
        for column, cells in zip(self.columns, zip(*self.texts(), strict=True) if self.rows else (), strict=False):
            texts = [
                column.head(stacked=stacked),
                *(_stack(text, stacked=stacked and column.kind not in _WORDS) for text in cells),
            ]
            widest = max(len(line) for text in texts for line in text.split("\n"))
            width += (2 if stacked else 3) + (min(_NARROWEST, widest) if column.kind == "text" else widest)
        return width

    def csv(self) -> str:
        """Return CSV with full precision; no word can become a spreadsheet's formula."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow([_raw(name) for column in self.columns for name in column.heads])
        for row in self.rows:
            writer.writerow([v for cell, column in zip(row, self.columns, strict=True) for v in column.values(cell)])
        return out.getvalue()

    def markdown(self) -> str:
        """Return a Markdown table."""
        ruler = "|" + "|".join(" --- " if column.kind in _WORDS else " ---: " for column in self.columns) + "|"
        lines = [f"| {' | '.join(map(_markdown, row))} |" for row in (self.names, *self.texts())]
        below = ["", _markdown(self.note)] if self.note else []
        return "\n".join([_markdown(self.title), "", lines[0], ruler, *lines[1:], *below, ""])

    def latex(self) -> str:
        """Return a LaTeX table, which needs the package booktabs; a wide one spans both columns."""
        set_as = self.short() if self.label else self
        kinds = "".join("l" if column.kind in _WORDS else "r" for column in set_as.columns)
        cells = (set_as.names, *set_as.texts())
        lines = [" & ".join(map(_latex, row)) + r" \\" for row in cells]
        wide = bool(self.label) and sum(max(map(len, column)) for column in zip(*cells, strict=True)) > _COLUMN
        kind, width = ("table*", r"\textwidth") if wide else ("table", r"\columnwidth")
        top = [
            f"% needs \\usepackage{{booktabs{',graphicx' if self.label else ''}}}",
            rf"\begin{{{kind}}}{'[t]' if self.label else ''}",
            rf"\caption{{{_latex('. '.join(filter(None, (self.title, self.note))))}}}",
            *([rf"\label{{{self.label}}}"] if self.label else []),
            r"\centering",
        ]
        body = [rf"\begin{{tabular}}{{@{{}}{kinds}@{{}}}}", r"\toprule", lines[0], r"\midrule", *lines[1:]]
        body += [r"\bottomrule", r"\end{tabular}"]
        if self.label:
            top += [r"\scriptsize", r"\setlength{\tabcolsep}{2pt}"]
            body = [rf"\resizebox{{\ifdim\width>{width}{width}\else\width\fi}}{{!}}{{%", *body[:-1], body[-1] + "}"]
        return "\n".join([*top, *body, rf"\end{{{kind}}}", ""])

    def html(self) -> str:
        """Return an HTML table with every value escaped."""
        short, lines = self.short(), []
        heads = "".join(f'<th scope="col" class="{one.kind}">{escape(_spoken(one.name))}</th>' for one in short.columns)
        for row, texts in zip(short.rows, short.texts(), strict=True):
            cells = [_html(*pair) for pair in zip(row[1:], texts[1:], short.columns[1:], strict=True)]
            lines.append(f'<tr><th scope="row"><bdi>{escape(texts[0])}</bdi></th>{"".join(cells)}</tr>')
        label, below = escape(self.title), f'<p class="note">{coded(self.note)}</p>\n' if self.note else ""
        return (
            f'<div class="scroll" tabindex="0" role="group" aria-label="{label}, table">\n'
            f'<table class="{self.name}"><caption>{label}</caption>\n<thead><tr>{heads}</tr></thead>\n'
            f"<tbody>{chr(10).join(lines)}\n</tbody></table></div>\n{below}"
        )

    __html__ = html
    """Templates print a table by its name."""


_JOINED = re.compile(r"(?<=[a-z]{2})_(?=[a-z]{2})")


def _spoken(name: str) -> str:
    """Return a column's name in words: ``modal_share`` has two; ``n_a`` is a symbol."""
    return _JOINED.sub(" ", name)


def stack_tables(tables: Mapping[str, Table]) -> Table:
    """Return tables with equal columns as one.

    A first cell that several tables have gets its table's name. The note has every sentence of
    their notes once. Raises ValueError if there is no table, or columns differ.
    """
    first, *others = tables.values()
    if any(one.columns != first.columns for one in others):
        raise ValueError(f"tables with different columns cannot be joined: {', '.join(tables)}")
    heads = {name: {Table.head(row) for row in table.rows} for name, table in tables.items()}
    counts = Counter(head for each in heads.values() for head in each)

    def named(name: str, cell: Cell) -> Cell:
        if counts[Table.head((cell,))] < 2:
            return cell
        return replace(cell, text=f"{name} · {cell.text}") if isinstance(cell, Mark) else f"{name} · {cell}"

    rows = tuple((named(name, row[0]), *row[1:]) for name, table in tables.items() for row in table.rows)
    notes = dict.fromkeys(part for table in tables.values() for part in table.note.rstrip(".").split(". ") if part)
    note = first.note if all(one.note == first.note for one in others) else ". ".join(notes)
    return replace(first, rows=rows, note=note)


def of_each(counts: Iterable[int | None]) -> str:
    """Return counts in words: one number, two, or the fewest to the most."""
    found = sorted({count for count in counts if count is not None})
    return f"{found[0]} to {found[-1]}" if len(found) > 2 else " or ".join(map(str, found)) or "0"


def files_of(tables: Sequence[Table]) -> dict[str, bytes]:
    """Return tables as CSV, Markdown and LaTeX by file name; repeated names get a number."""
    files, names = {}, [table.name for table in tables]
    for place, one in enumerate(tables):
        stem = f"{one.name}_{again + 1}" if (again := names[:place].count(one.name)) else one.name
        for suffix, text in (("csv", one.csv()), ("md", one.markdown()), ("tex", one.latex())):
            files[f"{stem}.{suffix}"] = text.encode("utf-8", "backslashreplace")
    return files


def write_tables(tables: Sequence[Table], folder: Path) -> list[Path]:
    """Write tables in all forms; return the files. Raises OutputError as `write_files` does."""
    from eyechart.destination import write_files  # noqa: PLC0415 - a table on a terminal needs no files

    return write_files(files_of(tables), folder)


def of_lines(name: str, caption: str, lines: Iterable[str]) -> Table:
    """Return lines as a table; each line is split at its first colon."""
    rows = tuple((what, says) for what, _, says in (line.partition(": ") for line in lines))
    return Table(name, caption, (Column("what", "word"), Column("what there is, and what it takes")), rows)


def marked(name: str, marks: Iterable[str]) -> Iterator[str]:
    """Yield a line for each sanity check behind the mark of a name."""
    yield from (f"{MARK} {name}: {words}" for words in marks)


def number(value: float | None, digits: int = 3) -> str:
    """Return a number as text; None is a dash."""
    return "—" if value is None else f"{round(value, digits) + 0.0:.{digits}f}"  # no negative zero


def p_value(p: float | None) -> str:
    """Return a p-value as the paper prints it: four digits, or ``<10⁻⁴``."""
    if p is None:
        return "—"
    return "<10⁻⁴" if p < 0.0001 else f"{p:.4f}" if p < 0.01 else f"{p:.3f}"


def estimate(one: Statistic, digits: int = 3) -> str:
    """Return a statistic's value and interval as text."""
    return Column("", "estimate", digits).shown(one)


def _stack(text: str, *, stacked: bool) -> str:
    """Return an estimate with its interval below, and a list with one item per line."""
    return re.sub(r" (?=[\[(])|(?<=,) (?![-+.0-9]+\])", "\n", text) if stacked else text


def _raw(cell: Cell) -> str:
    cell = cell.text if isinstance(cell, Mark) else cell
    if cell is None or cell == "—":
        return ""
    if not isinstance(cell, str):
        return repr(cell)
    return no_formula(_plain(cell))


def no_formula(text: str) -> str:
    """Return a cell with a leading apostrophe if a spreadsheet would take it for a formula."""
    return "'" + text if _FORMULA.search(text) and not re.fullmatch(r"[+-]?\d+(\.\d+)?", text) else text


def _plain(text: str) -> str:
    """Return text without control characters and direction marks."""
    return text if text.isprintable() else "".join(map(_plain_sign, text))


def _plain_sign(sign: str) -> str:
    if unicodedata.category(sign) in {"Cc", "Zl", "Zp"}:
        return " "
    return "\ufffd" if unicodedata.category(sign) in {"Cs", "Cf"} and sign not in _JOINERS else sign


def coded(text: str) -> Markup:
    """Return a sentence as HTML; places and commands are code, and these break only between words."""
    made, end = "", 0
    for found in _COMMAND.finditer(text):
        made += escape(text[end : found.start()])
        if found[3]:
            made += f"<code>{escape(found[3])}</code>"
        else:
            words = "".join(f"<span>{escape(word)}</span> " for word in (found[1] or found[2]).split()).rstrip()
            made += f'<code class="command">{words}</code>'
        end = found.end()
    return Markup(made + escape(text[end:]))  # noqa: S704 - every word was escaped just now


def _html(cell: Cell, text: str, column: Column) -> str:
    inside = escape(text)
    if column.kind == "estimate":
        inside = re.sub(r" (\[.*\]|\(\d+\)|at most .*)$", r' <span class="ends">\1</span>', inside)
    if isinstance(cell, Mark) and cell.tone:
        inside = f'<span class="flag {escape(cell.tone)}">{inside}</span>'
    if isinstance(cell, Mark) and cell.place:
        inside = f'<a href="{escape(cell.place)}">{inside}</a>'
    return f'<td class="{column.kind}">{inside}</td>'


def _markdown(text: str) -> str:
    escaped = re.sub(r"([\\`*_{}\[\]<>|~$#])", r"\\\1", _plain(text).replace("&", "&amp;"))
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
    "·": r"\textperiodcentered{}",
    **{sign: f"\\{sign}" for sign in "&%$#_"},
}
_HYPHENS = re.compile("-(?=-)")


def _latex(text: str) -> str:
    if text == "<10⁻⁴":
        return "$<10^{-4}$"
    escaped = "".join(_LATEX.get(sign, sign) for sign in _plain(text))
    escaped = _HYPHENS.sub("-{}", escaped).replace("—", "---")  # LaTeX would merge hyphens in a row
    return (
        f"{{{escaped[0]}}}{escaped[1:]}" if escaped[:1] in {"[", "*"} else escaped
    )  # or LaTeX takes it for an option of the line above
