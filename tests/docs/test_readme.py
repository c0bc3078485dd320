"""The README cannot rot: what it shows is what the commands print."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from eyechart.cli.app import app
from eyechart.conditions import CONDITIONS
from eyechart.verdicts import LABELS
from known import Demo

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture
def update_readme() -> ModuleType:
    """Return docs/update_readme.py."""
    spec = importlib.util.spec_from_file_location("update_readme", ROOT / "docs" / "update_readme.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_first_page_shows_what_the_demo_prints(demo: Demo, update_readme: ModuleType) -> None:
    """The block in it is the demo's output, the date masked; docs/update_readme.py writes it."""
    assert update_readme.shown("demo") == update_readme.masked(demo.printed)


def test_the_first_command_of_the_readme_says_yes_in_an_empty_folder(tmp_path: Path, update_readme: ModuleType) -> None:
    """The block is the head of its screen, of 80 columns; its page is there, its gate holds; Python says so too."""
    screen = update_readme.output("look", tmp_path)
    assert update_readme.shown("look") == update_readme.head("look", screen)
    assert len(update_readme.shown("look").splitlines()) == 10
    assert screen.startswith("Yes. It may be tried, on frames like these, as a monitor of the lead")
    assert max(map(len, screen.splitlines())) <= 80
    assert (tmp_path / "looks/scripted-depth/report.html").stat().st_size > 100_000
    (gate,) = [words for words in _commands() if words[0] == "gate"]
    words = [word.replace("NAME", "scripted-depth").replace("looks", str(tmp_path / "looks"), 1) for word in gate]
    assert CliRunner().invoke(app, words[:2] + gate[2:4] + ["--junit", str(tmp_path / "looks.xml")]).exit_code == 0
    (script,) = re.findall(r"^```python\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
    assert len(script.splitlines()) == 6
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("Yes It may be tried, on frames like these, as a monitor of the lead")


def _commands() -> list[list[str]]:
    """Return the words of every command of eyechart in a block or in a cell of the README."""
    blocks = re.findall(r"^```sh\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
    lines = re.findall(r"^eyechart (.+)$", "\n".join(blocks), re.MULTILINE) + re.findall(r"`eyechart ([^`]+)`", README)
    return [line.split() for line in lines]


def test_every_command_of_the_readme_exists() -> None:
    """Every ``eyechart …`` of the README names a command and options that there are."""
    root, lines = get_command(app), _commands()
    assert len(lines) >= 10
    for line in lines:
        command, words = root, [*line]
        while hasattr(command, "commands"):
            assert words[0] in command.commands, line
            command = command.commands[words.pop(0)]
        known = {option for parameter in command.params for option in parameter.opts}
        for word in words:
            assert not word.startswith("--") or word in known, f"{word} in: {line}"


def test_the_readme_is_short_and_opens_six_doors() -> None:
    """At most 90 lines; a row of its table each, which links the page that says more."""
    assert len(README.splitlines()) <= 90
    table = README.partition("| what you have | what you type |")[2].partition("\n\n")[0]
    rows = table.splitlines()[2:]
    assert len(rows) == 6
    assert all("](docs/" in row and "`eyechart " in row for row in rows)


def test_how_it_is_installed_is_what_works_today(update_readme: ModuleType) -> None:
    """From a checkout where nobody published it: no page has a name of an index, an address or a badge before."""
    assert update_readme.installing(update_readme.Published("eyechart", "https://host/eyechart")).startswith(
        "```sh\npip install eyechart\n"
    )
    for page in update_readme.INSTALLED:
        assert update_readme.between("install", page) == update_readme.installing()
    if update_readme.PUBLISHED.name:
        return
    for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]:
        text = page.read_text(encoding="utf-8")
        assert re.search(r"pip install (-\S+ )*eyechart\b(?!\[)", text) is None, page.name
        assert "badge" not in text or page.name == "changelog.md", page.name
    assert "[project.urls]" not in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def test_the_readme_explains_every_verdict() -> None:
    """The table of answers has each calibrated label in the row of its answer, and in no other."""
    rows = dict(re.findall(r"^\| \*\*([\w ]+)\*\* \| (.+) \|$", README, re.MULTILINE))
    named = {label: answer for answer, row in rows.items() for label in re.findall(r"`(\w+)`: ", row)}
    assert named == {label: one.answer for label, one in LABELS.items()}


def test_every_condition_is_in_the_paper_table_or_a_counterfactual() -> None:
    """The eight conditions of Table t:conditions stand first and in its order."""
    assert list(CONDITIONS)[:8] == [
        "real",
        "real_repeat",
        "blank",
        "noise",
        "shuffled",
        "cross_scenario",
        "text_only",
        "mirrored",
    ]
