"""The first five minutes: every command of the page is run as it stands, in its order."""

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

import pages
from eyechart.cli.app import app
from known import Demo

PAGE = (pages.ROOT / "docs" / "first-verdict.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_its_commands_run_as_they_stand(demo: Demo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the demo's folder on; what it shows of a verdict is what is printed, and the gate holds."""
    lines = [line for step in pages.steps(PAGE) if step.kind == "commands" for line in step.text.splitlines()]
    assert lines[0] == "make demo"
    (tmp_path / "demo").symlink_to(demo.folder)
    monkeypatch.chdir(tmp_path)
    printed = {line: said(line) for line in lines[1:]}
    block = re.search(r"<!-- verdict -->\n```text\n(.*?)```", PAGE, re.DOTALL)
    assert block is not None
    assert block.group(1) in printed["eyechart verdict demo/run-0"]
    assert (tmp_path / "sheet.png").stat().st_size > (tmp_path / "near.png").stat().st_size / 10
    assert "scripted:depth_left: depth, evidence controlled" in printed["eyechart verdict run"]
    assert printed["eyechart gate run --require depth"].startswith("holds ")


def said(line: str) -> str:
    """Run a line of the page and return what it printed."""
    tool, *words = shlex.split(line)
    assert tool == "eyechart"
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    return result.stdout
