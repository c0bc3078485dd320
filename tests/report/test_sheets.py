"""Tables for other programs: each format escapes by its own rules, and no number changes on the way."""

import csv
import io
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from eyechart.report.table import STATISTIC, Column, Table, coded, columns, statistic_cells, write_tables
from eyechart.stats.risk_bounds import share_bound
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.subjects import subjects
from eyechart.studies.battery.tables import (
    JudgedModel,
    frontier_table,
    judged_of,
    statistics_table,
    tables_of,
    verdict_table,
)
from report_runs import Reported, read_evidence

COLUMNS = (
    Column("name"),
    Column("value", "number"),
    Column("interval", "interval"),
    Column("n", "count"),
    Column("p", "p"),
)


def sheet(name: str) -> Table:
    """Return a sheet with one row."""
    return Table("s", "caption", COLUMNS, ((name, -0.123456789, (-0.5, 0.25), 7, 0.00001),))


@pytest.fixture(scope="module")
def everyone(hostile: Reported) -> list[JudgedModel]:
    """Return the two models of the hostile run."""
    return judged_of(subjects(read_evidence([hostile.run])))


@pytest.mark.parametrize("name", ["=1+1", "+cmd", "-x", "@SUM(A1)", "\t=1", "\r=1", "  =1"])
def test_a_name_cannot_become_a_formula(name: str) -> None:
    """A spreadsheet shows it as text."""
    row = list(csv.reader(io.StringIO(sheet(name).csv())))[1]
    assert row[0].startswith("'")
    assert row[1:] == ["-0.123456789", "-0.5", "0.25", "7", "1e-05"]


def test_csv_keeps_words_and_every_digit() -> None:
    """Quotes, commas and lines are the csv module's work; a negative number is a number."""
    row = list(csv.reader(io.StringIO(sheet('a "b", c').csv())))[1]
    assert row[0] == 'a "b", c'
    assert float(row[1]) == -0.123456789


def test_markdown_escapes_what_would_be_markup() -> None:
    """A bar ends no cell, and no name is a link, an emphasis or an element."""
    text = sheet("a|b_c*d`e[f](g)<h>&i\nj").markdown()
    line = text.splitlines()[-1]
    assert line == r"| a\|b\_c\*d\`e\[f\](g)&lt;h&gt;&amp;i j | -0.123 | \[-0.500, 0.250\] | 7 | &lt;10⁻⁴ |"


def test_latex_escapes_every_special_sign() -> None:
    """The ten of LaTeX, and signs that its fonts lack."""
    line = sheet("a_b%c&d#e$f{g}h~i^j\\k<l>").latex().splitlines()[8]
    assert line == (
        r"a\_b\%c\&d\#e\$f\{g\}h\textasciitilde{}i\textasciicircum{}j\textbackslash{}k\textless{}l\textgreater{}"
        r" & -0.123 & {[}-0.500, 0.250] & 7 & $<10^{-4}$ \\"
    )
    assert "{[}a] & " in sheet("[a]").latex()  # after a line's end LaTeX would take [a] for its argument
    assert "-{}-prices FILE --- no &" in sheet("--prices FILE — no").latex()  # no dash of an option
    assert "a-{}-{}-b &" in sheet("a---b").latex()  # nor of a name
    assert r"\toprule" in sheet("a").latex()
    assert r"\begin{tabular}{@{}lrrrr@{}}" in sheet("a").latex()


def test_a_table_of_the_paper_that_is_too_wide_for_a_column_of_text_spans_both() -> None:
    """Never wider than either, and no smaller than can be read."""
    for name, kind, width in (("a", "table", r"\columnwidth"), ("a" * 100, "table*", r"\textwidth")):
        lines = replace(sheet(name), label="t:it").latex().splitlines()
        assert (lines[1], lines[-1]) == (rf"\begin{{{kind}}}[t]", rf"\end{{{kind}}}")
        assert rf"\resizebox{{\ifdim\width>{width}{width}\else\width\fi}}{{!}}{{%" in lines


def test_cannot_say_is_a_dash_for_people_and_nothing_for_programs() -> None:
    """Never a zero."""
    empty = Table("s", "caption", COLUMNS, (("a", None, None, None, None),))
    assert list(csv.reader(io.StringIO(empty.csv())))[1] == ["a", "", "", "", "", ""]
    assert empty.markdown().splitlines()[-1] == "| a | — | — | — | — |"
    assert "a & --- & --- & --- & ---" in empty.latex()


def test_the_sheets_hold_the_run(everyone: list[JudgedModel]) -> None:
    """A row a model, a row a statistic, and the paper's table with a column a model."""
    verdicts = verdict_table(everyone).rows
    assert [row[:3] for row in verdicts] == [
        (label, verdict.answer, verdict.calibrated.label) for label, _, verdict in everyone
    ]
    statistics = statistics_table(everyone).rows
    assert len(statistics) == sum(len(model.statistics) for _, model, _ in everyone)
    for who_name, name, value, interval, level, n, p, *_ in statistics:
        found = next(model for label, model, _ in everyone if label == who_name).statistics[name]
        assert (value, interval, n, p) == (found.value, found.ci, found.n, found.p)
        assert (level == "") == (found.ci is None)
    levels = {row[1]: row[4] for row in statistics}
    assert (levels["unparsed_rate"], levels["unparsed_reference"]) == ("95 %", "98 %")
    frontier = frontier_table(everyone)
    assert frontier.names == ["metric", *(label for label, _, _ in everyone)]
    assert frontier.texts()[-1] == [
        "verdict (calibrated)",
        *(f"{verdict.calibrated.label}{' !' if verdict.failed else ''}" for _, _, verdict in everyone),
    ]


def test_sheets_are_written_in_three_formats(everyone: list[JudgedModel], tmp_path: Path) -> None:
    """Verdicts, frontier and statistics, the same bytes each time."""
    written = write_tables(tables_of(everyone), tmp_path / "a")
    assert {path.name for path in written} == {
        f"{name}.{suffix}" for name in ("verdicts", "frontier", "statistics") for suffix in ("csv", "md", "tex")
    }
    again = write_tables(tables_of(everyone), tmp_path / "b")
    assert [path.read_bytes() for path in written] == [path.read_bytes() for path in again]


def printed(table: Table, width: int) -> str:
    """Return what a terminal of so many columns shows."""
    out = io.StringIO()
    Console(file=out, width=width).print(table)
    return out.getvalue()


WIDE = Table(
    "wide",
    "caption",
    (Column("policy"), Column("run", varies=True), Column("note"), *columns("estimate", *"abcdef", digits=1)),
    (("oracle", "r", "", *(Statistic(1.0, 9, (-100.0, 100.0)),) * 6),),
)


@pytest.mark.parametrize(("width", "lines"), [(180, 1), (130, 2), (40, 7)])
def test_a_wide_table_is_stacked_or_printed_row_by_row_and_never_cut(width: int, lines: int) -> None:
    """An interval stands below its value, then a line a cell; columns that tell people nothing are left out."""
    text = printed(WIDE, width)
    assert text.count("[-100.0, 100.0]") == 6
    assert "…" not in text
    assert "run" not in text
    assert "note" not in text
    body = text[text.index("oracle") :].rstrip()
    assert body.count("\n") == lines - 1
    assert WIDE.csv().startswith("policy,run,note,a,a low,a high,")


def test_html_holds_no_markup_but_its_own() -> None:
    """Names, words and captions are text."""
    html = sheet("<script>alert(1)</script>").html()
    assert "<script" not in html
    assert "&lt;script&gt;" in html
    assert '<td class="interval">[-0.500, 0.250]</td>' in html


def test_tables_of_one_name_have_files_of_their_own(tmp_path: Path) -> None:
    """The second is numbered."""
    written = write_tables([sheet("a"), sheet("b")], tmp_path)
    assert [path.name for path in written if path.suffix == ".csv"] == ["s.csv", "s_2.csv"]


def test_a_column_of_which_nothing_is_known_is_left_out() -> None:
    """Not one of which one row knows, nor a 0, which is known."""
    named = (Column("who"), *columns("count", "calls", "tokens", "cost", "retries"), Column("energy", "number"))
    rows = (("a", 3, "—", "unknown", 0, "not measured"), ("b", 4, None, "unknown", 0, 2.0))
    assert Table("costs", "", named, rows).known().names == ["who", "calls", "retries", "energy"]


def test_a_bound_from_above_is_no_interval() -> None:
    """People read its upper end; programs still read both."""
    bound, two_sided = share_bound(0, 10, confidence=0.99), Statistic(0.5, 10, (0.2, 0.8))
    table = Table(
        "s",
        "",
        (Column("who"), *STATISTIC),
        tuple((str(n), *statistic_cells(one)) for n, one in enumerate((bound, two_sided))),
    )
    assert [row[2] for row in table.texts()] == ["at most 0.369", "[0.200, 0.800]"]
    assert [row[2:4] for row in csv.reader(io.StringIO(table.csv()))][1:] == [
        ["0.0", repr(bound.ci[1])],  # type: ignore[index]
        ["0.2", "0.8"],
    ]
    assert Column("", "estimate").shown(bound) == "0.000 at most 0.369"
    assert Column("", "estimate").shown(two_sided) == "0.500 [0.200, 0.800]"


def test_a_command_in_a_sentence_is_code_that_breaks_between_words() -> None:
    """Quotes go, options stand whole, and nothing else becomes markup."""
    told = coded("Hold <b> 'as it is', with 'eyechart gate RUN --require camera:x', or give --frames.")
    assert told == (
        "Hold &lt;b&gt; &#x27;as it is&#x27;, with "
        '<code class="command"><span>eyechart</span> <span>gate</span> <span>RUN</span> <span>--require</span> '
        '<span>camera:x</span></code>, or give <code class="command"><span>--frames</span></code>.'
    )
    assert coded("a--b, and it's 'eyechart'") == "a--b, and it&#x27;s &#x27;eyechart&#x27;"


def test_an_interval_of_an_estimate_may_stand_below_its_value() -> None:
    """It is a word of its own, which is not broken."""
    table = Table("t", "", (Column("who"), Column("x", "estimate")), (("a", Statistic(0.5, 10, (0.2, 0.8))),))
    assert '<td class="estimate">0.500 <span class="ends">[0.200, 0.800]</span></td>' in table.html()
