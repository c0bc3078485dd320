"""The page on Python: its examples run as they stand, in a folder of their own."""

import importlib
import importlib.util
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from eyechart.api import run_battery
from eyechart.cli.app import app
from eyechart.frames import FrameBank, open_bank
from eyechart.simulators.highway import Highway
from known import Demo

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")


def blocks(text: str) -> list[str]:
    """Return the Python of a page, block by block."""
    return re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


@pytest.fixture
def folder(demo: Demo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working folder; a bank that is built there holds half of the demo's frames, else the same."""

    def build(_self: Highway, out: Path, **options: object) -> FrameBank:
        assert (options["preset"], tuple(options["seeds"]), options["steps"]) == ("balanced", (0, 1, 2), 12)
        shutil.copytree(demo.half, out)
        return open_bank(out)

    monkeypatch.setattr(Highway, "build", build)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_page_runs_as_it_stands(demo: Demo, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Block by block, in one session."""
    session: dict[str, object] = {}
    *steps, suite = blocks(PAGE)
    for block in steps:
        exec(compile(block, "docs/python.md", "exec"), session)  # noqa: S102 - it is what is tested
    printed = capsys.readouterr().out
    assert "scripted:presence: presence_only, evidence interventional" in printed
    assert "presence_only because its decisions on real and blank pictures differ" in printed
    assert f"{3 * len(open_bank(demo.half))} calls, 0 of them made already" in printed
    assert (folder / "run" / "ledger.sqlite").exists()
    run_battery("bank", "scripted:depth", "run-of-the-controller", limit=72)
    exec(compile(suite, "docs/python.md", "exec"), {})  # noqa: S102


def test_every_name_of_the_table_exists() -> None:
    """A command and what it is from Python."""
    names = re.findall(r"`(eyechart(?:\.\w+)+)`", PAGE)
    assert len(names) >= 10
    for name in names:
        module, _, attribute = name.rpartition(".")
        assert hasattr(importlib.import_module(module), attribute) or importlib.util.find_spec(name), name


def test_every_command_has_its_row() -> None:
    """What a command does can be done from Python: docs/python.md says with what."""
    rows = "\n".join(line.split(" | ")[0] for line in PAGE.splitlines() if line.startswith("| `eyechart "))
    for name in commands(get_command(app), "eyechart"):
        if name != "eyechart demo" and not name.startswith("eyechart list "):
            assert f"`{name}`" in rows, f"give '{name}' a row in docs/python.md"


def commands(group: Any, name: str) -> Iterator[str]:  # noqa: ANN401 - click's own types are not exported
    """Yield the full name of every command."""
    for word, found in group.commands.items():
        yield from commands(found, f"{name} {word}") if hasattr(found, "commands") else (f"{name} {word}",)
