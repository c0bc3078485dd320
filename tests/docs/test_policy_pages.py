"""The pages on policies by task: their commands exist, their functions run, and each label that they name is one."""

import re
from pathlib import Path

import pytest
from typer.main import get_command

from eyechart.cli.app import app
from eyechart.models import open_model
from eyechart.modes import RequestMode
from eyechart.verdicts.labels import GUARDS
from eyechart.verdicts.policy_verdict import AXES

DOCS = Path(__file__).parents[2] / "docs"
PAGES = {name: (DOCS / f"policy-{name}.md").read_text(encoding="utf-8") for name in ("lerobot", "channel")}


def blocks(page: str, kind: str) -> list[str]:
    """Return a page's blocks of a kind."""
    return re.findall(rf"^```{kind}\n(.*?)^```", PAGES[page], re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", PAGES)
def test_their_commands_and_options_exist(page: str) -> None:
    """Every line names a command and options that there are."""
    lines = [line for block in blocks(page, "sh") for line in block.splitlines() if line.startswith("eyechart")]
    assert len(lines) >= 2
    for line in lines:
        command, words = get_command(app), line.split()[1:]
        while hasattr(command, "commands"):
            command = command.commands[words.pop(0)]
        known = {option for parameter in command.params for option in parameter.opts}
        assert {word for word in words if word.startswith("--")} <= known


def test_the_checkpoints_are_policies_with_a_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As they stand, of the page's own function."""
    (tmp_path / "my_policy.py").write_text(blocks("lerobot", "python")[0])
    (tmp_path / "checkpoints.py").write_text(blocks("channel", "python")[0])
    monkeypatch.syspath_prepend(tmp_path)
    specs = [f"python:checkpoints:{name}" for name in ("early", "late")]
    steps = [open_model(spec, RequestMode(spec), answering="policy").facts["step"] for spec in specs]
    assert steps == ["10000", "100000"]


def test_they_name_labels_and_guards_that_there_are() -> None:
    """In the table of what to do; every guard is there."""
    known = {label for labels in AXES.values() for label in labels} | {*GUARDS}
    rows = "\n".join(line.split("|")[1] for line in PAGES["channel"].splitlines() if line.startswith("| "))
    named = set(re.findall(r"`(\w+)`", rows))
    assert named <= known
    assert set(GUARDS) <= named
