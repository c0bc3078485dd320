"""The programs that make and check the site, without building it: make docs does that."""

import importlib.util
import re
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import pytest
from markdown_it import MarkdownIt

from pages import ROOT
from test_layers import LAYERS

DOCS = ROOT / "docs"


def program(name: str) -> ModuleType:
    """Import a program that stands beside the pages."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_page_is_in_the_sites_tree() -> None:
    """A page that no list names is found by nobody."""
    listed = set(re.findall(r"^([\w\-/]+)$", (DOCS / "index.md").read_text(encoding="utf-8"), re.MULTILINE))
    there = {path.stem for path in DOCS.glob("*.md")} - {"index"}
    assert there - listed == set()
    assert {name for name in listed if "/" in name} == {"api/index", "decisions/README"}


def test_the_api_has_a_page_for_every_room_but_the_command_line(tmp_path: Path) -> None:
    """And every module is on it, once, or is spoken for by its package."""
    api_pages = program("api_pages")
    rooms = {name for layer in LAYERS for name in layer} - {"cli", "eyechart_organisms"}
    assert set(api_pages.rooms()) == rooms
    api_pages.write(tmp_path / "api")
    named: list[str] = []
    for room in rooms:
        named += re.findall(r"automodule:: (\S+)", (tmp_path / "api" / f"{room}.md").read_text(encoding="utf-8"))
    assert len(named) == len(set(named))
    for path in (ROOT / "src" / "eyechart").rglob("*.py"):
        parts = path.relative_to(ROOT / "src").with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        if name == "eyechart" or name.startswith("eyechart.cli"):
            continue
        assert any(name == one or name.startswith(f"{one}.") for one in named), name


@pytest.mark.parametrize(
    ("page", "wrong"),
    [
        ('<script src="https://cdn.example/x.js"></script>', "page.html loads https://cdn.example/x.js"),
        ('<link rel="stylesheet" href="//fonts.example/f.css">', "page.html loads //fonts.example/f.css"),
        ('<img src="gone.png">', "page.html loads gone.png, which is not there"),
        ('<a href="https://example.org">out</a><link rel="next" href="later.html"><img src="data:,">', None),
        ('<link rel="stylesheet" href="style.css?v=1">', None),
        ("<p>| <code>lead_near</code> | a picture |</p>", "page.html shows a table as text: |"),
        ("<p>a | b</p><table><tr><td>|</td></tr></table>", None),
    ],
)
def test_what_a_site_loads_from_elsewhere_is_told(tmp_path: Path, page: str, wrong: str | None) -> None:
    """Scripts, styles and pictures; a link to click is no load."""
    (tmp_path / "page.html").write_text(page)
    (tmp_path / "style.css").write_text("body { margin: 0 }")
    assert program("check_site").problems(tmp_path) == ([wrong] if wrong else [])


PAGES = [ROOT / "README.md", ROOT / "benchmarks" / "README.md", *sorted(DOCS.rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_row_of_a_table_is_one_as_rendered(page: Path) -> None:
    """No row stands as text below its table, and none has other cells than the head, which a reader would not see."""
    text = page.read_text(encoding="utf-8")
    tokens = MarkdownIt("commonmark").enable("table").parse(text)
    for before, token in pairwise(tokens):
        assert before.type != "paragraph_open" or not token.content.startswith("|"), token.content
    for token in tokens:
        if token.type == "table_open" and token.map is not None:
            rows = text.splitlines()[token.map[0] : token.map[1]]
            cells = {len(re.split(r"(?<!\\)\|", row.strip().removesuffix("|"))) for row in rows}
            assert len(cells) == 1, rows[0]
