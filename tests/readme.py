"""The README's table of doors, and its commands as they stand."""

import re
from pathlib import Path

from typer.testing import CliRunner

from eyechart.cli.app import app

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
ANSWERS = ("Yes. ", "In part. ", "No. ", "Inconclusive. ")


def door(name: str) -> list[list[str]]:
    """Return the words of each whole command in the row of a door."""
    (row,) = [line for line in README.splitlines() if f"[{name}](" in line.partition(" | ")[0]]
    return [line.split() for line in re.findall(r"`eyechart ([^`]+)`", row)]


def run(words: list[str], *more: str) -> str:
    """Run a command, and return what it printed; it ends in an answer or a result, and not in an error."""
    done = CliRunner().invoke(app, [*words, *more])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.output
    assert done.exit_code in ({0, 1, 2} if words[0] == "look" else {0}), done.output
    return done.stdout
