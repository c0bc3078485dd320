"""The README cannot rot: what it shows is what the commands print."""

import importlib.util
import re
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


def test_the_readme_shows_what_the_demo_prints(demo: Demo, update_readme: ModuleType) -> None:
    """The block in the README is the demo's output, the date masked; docs/update_readme.py writes it."""
    assert update_readme.shown() == update_readme.masked(demo.printed)


def test_the_first_command_of_the_readme_says_yes_in_an_empty_folder(tmp_path: Path, update_readme: ModuleType) -> None:
    """The block is the screen of the look, of 80 columns; its page is there, and its gate holds."""
    screen = update_readme.output("look", tmp_path)
    assert update_readme.shown("look") == screen
    assert screen.startswith("Yes. It may be tried as a longitudinal hazard monitor")
    assert max(map(len, screen.splitlines())) <= 80
    assert (tmp_path / "looks/scripted-depth/report.html").stat().st_size > 100_000
    run = tmp_path / "looks/scripted-depth/run"
    assert CliRunner().invoke(app, ["gate", str(run), "--require", "looks"]).exit_code == 0


def test_every_command_of_the_readme_exists() -> None:
    """Every ``eyechart …`` line of the README names a command and options that there are."""
    root = get_command(app)
    blocks = re.findall(r"^```sh\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
    lines = re.findall(r"^eyechart (.+)$", "\n".join(blocks), re.MULTILINE)
    assert len(lines) >= 5
    for line in lines:
        command, words = root, line.split()
        while hasattr(command, "commands"):
            assert words[0] in command.commands, line
            command = command.commands[words.pop(0)]
        known = {option for parameter in command.params for option in parameter.opts}
        for word in words:
            assert not word.startswith("--") or word in known, f"{word} in: {line}"


def test_the_readme_explains_every_verdict() -> None:
    """The table of verdicts has a row for each calibrated label."""
    assert [label for label in LABELS if f"| `{label}` |" not in README] == []


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
