"""Names and replies that hold any word are safe in every form: terminal, JSON, CSV, Markdown, LaTeX, HTML, XML."""

import ast
import csv
import io
import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from typer.testing import CliRunner

import banks
import report_runs
import stand_ins
from eyechart.calls import Query, Reply
from eyechart.cli.app import app
from eyechart.cli.terminal import print_each, print_json, print_line
from eyechart.frames import BankWriter
from eyechart.report.table import Column, Mark, Table

WORDS = (
    "esc \x1b[2J\x1b]0;owned\x07",
    "csi \x9b31m del \x7f nul \x00",
    "=cmd|' /C calc'!A0",
    "+1+1",
    "-2+3",
    "@SUM(1,1)",
    "  \t=1+1",
    "a;=1+1",
    "\u200b=1",
    "＝1+1",
    "a|b|c",
    "\\end{table}\\input{/etc/passwd}",
    "$x$ %c #1 &n _s ^t ~u {v} \\w",
    "[0pt] *",
    "</script><script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "<!-- & &lt; -->",
    "[a](javascript:alert(1)) ![b](http://c) `d` **e** <f>",
    "one\ntwo\r\nthree\u2028four\u2029five\x85six",
    "\u202eright to left\u2066\u200f",
    "lone \ud800 half",
    "{{ 7 * 7 }} {% raw %}",
    "[bold red]markup[/] :boom:",
    "'quoted' \"twice\"",
    "漢字 😀 naïve",
)
"""What somebody may have put into a name, a picture's description or a reply."""
STEERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\u2028\u2029\ud800-\udfff]")
"""What no terminal and no file may get: control signs, marks of direction, separators of lines, halves of signs."""


def table(word: str) -> Table:
    """Return a table that holds a word wherever a table may hold one."""
    named = (Column(word), Column("n", "count"), Column(word, "word"), Column("value", "estimate"))
    return Table("hostile", word, named, ((word, 3, Mark(word, "bad", "!"), 0.5), ("plain", None, "—", None)), word)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run on a bank whose names mean harm, by models whose names and replies do."""
    folder = tmp_path_factory.mktemp("hostile")
    with BankWriter(folder / "bank", replace(banks.manifest(), simulator=WORDS[2], picture=WORDS[14])) as writer:
        for code, frame in enumerate(banks.frames_of(banks.SCENARIOS, 2, 3, "vertical", drawn=False)):
            place = {"light": WORDS[11], "dense": WORDS[2], "merge": WORDS[17]}[frame.scenario]
            writer.add(replace(frame, scenario=place), *banks.pictures_of(frame, code))

    def reply(query: Query) -> Reply:
        return Reply(WORDS[query.seed % len(WORDS)].replace("\ud800", ""), "stop", error=None)

    models = {f"{place} {word}": reply for place, word in enumerate(WORDS) if place in {2, 10, 11, 14, 17, 22}}
    models["steady"] = stand_ins.stop
    return report_runs.make_run(folder / "bank", folder / "run", models, conditions=["real", "real_repeat", "blank"])


@pytest.mark.parametrize("word", WORDS)
def test_a_table_prints_no_word_that_steers_a_terminal(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Wide, narrow and row by row; rich's own markup is text."""
    for width in (200, 60, 20):
        print_each([table(word), word], width, names=[word])
    print_line(word)
    shown = capsys.readouterr().out
    assert STEERS.search(shown) is None
    if word.startswith("[bold"):
        assert "[bold red]markup[/] :boom:" in shown


@pytest.mark.parametrize("word", WORDS)
def test_json_on_a_terminal_is_printable_and_gives_the_word_back(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    """In escapes where a sign is not printable."""
    print_json({word: [word]})
    shown = capsys.readouterr().out
    assert STEERS.search(shown) is None
    assert json.loads(shown) == {word: [word]}


@pytest.mark.parametrize("word", WORDS)
def test_no_cell_of_csv_is_a_formula(word: str) -> None:
    """No field, head or part between semicolons begins with a formula's sign; a field is a field, a row a row."""
    text = table(word).csv()
    rows = list(csv.reader(io.StringIO(text)))
    assert STEERS.search(text) is None
    assert len(rows) == 3
    assert {len(row) for row in rows} == {6}
    for field in (field for row in rows for field in row if not re.fullmatch(r"[+-]?\d+(\.\d+)?", field)):
        safe = field.startswith("'") or not re.search(r"(?:^|;)[\s\u200b\ufeff\ufffd]*[=+\-@＝]", field)
        assert safe, field


@pytest.mark.parametrize("word", WORDS)
def test_markdown_stays_a_table_of_words(word: str) -> None:
    """A row has its cells, and nothing in them is a link, an element or emphasis."""
    text = table(word).markdown()
    rows = [line for line in text.split("\n") if line.startswith("|")]
    assert STEERS.search(text) is None
    assert len(rows) == 4
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {5}
    bare = re.sub(r"\\.", "", "\n".join([text.split("\n")[0], rows[0], rows[2]]))
    assert not set(bare) & set("<>*`[]")


_STRUCTURE = re.compile(
    r"^% needs .*$|\\(?:begin|end)\{(?:table|tabular)\}(?:\{@\{\}[lr]+@\{\}\})?"
    r"|\\(?:centering|toprule|midrule|bottomrule)$",
    re.MULTILINE,
)
_ESCAPED = re.compile(
    r"\\(?:text(?:backslash|asciitilde|asciicircum|less|greater|bar|quotedbl|periodcentered)\{\}|[{}&%$#_])"
)


@pytest.mark.parametrize("word", WORDS)
def test_latex_holds_no_command_of_others(word: str) -> None:
    """Once its own structure and escapes are taken away, no sign is left that means anything to TeX."""
    text = table(word).latex()
    assert STEERS.search(text) is None
    assert text.count("\\begin{table}") == text.count("\\end{table}") == 1
    inner = _ESCAPED.sub("", _STRUCTURE.sub("", text))
    assert inner.count("\\\\") == 3
    inner = inner.replace("\\\\", "").replace("\\caption{", "", 1)
    assert not set(inner) & set("\\%$#_^~")
    assert inner.count("{") + 1 == inner.count("}")  # the caption's own, and groups around a first sign
    assert inner.count("&") == 3 * 3
    assert not re.search(r"^\s*[\[*]", inner, re.MULTILINE)


class _Elements(HTMLParser):
    """Notes every element, its attributes, and the words."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: set[str] = set()
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes |= {name for name, _ in attrs}

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    def handle_comment(self, data: str) -> None:
        self.tags.append(f"comment {data}")


@pytest.mark.parametrize("word", WORDS)
def test_html_holds_no_element_of_others(word: str) -> None:
    """Tags and attributes are the table's own, whatever a word is; it is shown as text."""
    found, plain = _Elements(), _Elements()
    found.feed(table(word).html())
    plain.feed(table("plain").html())
    assert found.tags == plain.tags
    assert found.attributes == plain.attributes


@pytest.mark.parametrize(
    "words",
    ["verdict", "score", "score --all", "costs", "costs --all", "costs --unread", "gate", "frames check", "plan"],
)
@pytest.mark.parametrize("json_too", [False, True])
def test_no_command_on_a_hostile_run_steers_a_terminal(run: Path, words: str, *, json_too: bool) -> None:
    """Whatever its models, its bank and its replies are called; JSON gives the names back as they are."""
    first, *more = words.split()
    place = run.parent / "bank" if first in {"frames", "plan"} else run
    line = ["frames", "check", str(place)] if first == "frames" else [first, str(place), *more]
    result = CliRunner().invoke(app, [*line, *(["--json"] if json_too else [])])
    assert result.exit_code in {0, 1, 2}
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert STEERS.search(result.output) is None
    if json_too:
        assert json.loads(result.stdout)


def test_what_is_written_of_a_hostile_run_is_read_by_its_programs(run: Path, tmp_path: Path) -> None:
    """CSV parts into equal rows without a formula, XML parses, a report has no element but its own."""
    result = CliRunner().invoke(
        app, ["report", str(run), "--out", str(tmp_path / "report.html"), "--tables", str(tmp_path / "tables")]
    )
    assert result.exit_code == 0, result.output
    for file in (tmp_path / "tables").glob("*.csv"):
        rows = list(csv.reader(io.StringIO(file.read_text(encoding="utf-8"))))
        assert len({len(row) for row in rows}) == 1, file
        assert not [
            field for row in rows for field in row if re.match(r"\s*(?:[=@＝]|[+-](?!\d+(\.\d+)?(e-?\d+)?$))", field)
        ]
    for file in tmp_path.glob("tables/*"):
        assert STEERS.search(file.read_text(encoding="utf-8")) is None, file
    assert CliRunner().invoke(app, ["gate", str(run), "--junit", str(tmp_path / "gate.xml")]).exit_code in {1, 2}
    assert ET.fromstring((tmp_path / "gate.xml").read_bytes()).tag == "testsuites"  # noqa: S314 - made above
    page = _Elements()
    page.feed((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert not {name for name in page.attributes if name.startswith("on")}
    assert "f" not in page.tags  # of "<f>", the only element in the words that no page has


def test_only_one_module_prints() -> None:
    """What a command says goes through the terminal, which makes it harmless; nothing else writes out."""
    folder = Path(__file__).parents[2] / "src" / "eyechart"
    wrong = []
    for file in sorted(folder.rglob("*.py")):
        if file.relative_to(folder).as_posix() in {"cli/terminal.py", "cli/__init__.py"}:
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            called = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
            if called in {"print", "typer.echo", "click.echo", "sys.stdout.write", "sys.stderr.write"}:
                wrong.append(f"{file.relative_to(folder)}:{node.lineno}")
    assert wrong == []
