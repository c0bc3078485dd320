"""The page about endpoints cannot rot: its commands parse, and its outputs are what the stand-ins give today."""

import json
import re
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from eyechart.cli.app import app
from pages import ROOT
from seeing import served

PAGE = ROOT / "docs" / "test-your-endpoint.md"
BLOCK = re.compile(r"<!-- stand-in( probe)?: (\{.*?\}) -->\n```text\n(.*?)```\n", re.DOTALL)
BLOCKS = [match.groups() for match in BLOCK.finditer(PAGE.read_text(encoding="utf-8"))]


def printed(kind: str | None, what: str, folder: Path) -> str:
    """Return what doctor or probe prints of a stand-in; seconds are masked."""
    with served(**json.loads(what)) as server:
        words = ["openai:m", "--base-url", server.base_url, "--seed", "1"]
        words += ["--out", str(folder / "mode.toml")] if kind else []
        said = CliRunner().invoke(app, ["probe" if kind else "doctor", *words]).stdout
    lines = [line.rstrip() for line in said.splitlines()]
    text = "\n".join(lines).strip("\n") + "\n"
    text = re.sub(r"\d+\.\d+ s\b", "… s", text)
    return re.sub(r"(seconds of a call, shortest +).*", r"\1…", text)


@pytest.mark.parametrize(("kind", "what", "shown"), BLOCKS, ids=[block[1] for block in BLOCKS])
def test_an_output_is_what_a_stand_in_gives(kind: str | None, what: str, shown: str, tmp_path: Path) -> None:
    """Word for word; where this fails, run: python docs/update_endpoint.py."""
    assert len(BLOCKS) == 4
    assert printed(kind, what, tmp_path) == shown


def test_its_commands_and_options_exist() -> None:
    """Every line of eyechart names a command and options that there are."""
    blocks = re.findall(r"^```sh\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines() if line.startswith("eyechart ")]
    assert len(lines) >= 8
    for line in lines:
        command, words = get_command(app), line.split()[1:]
        while hasattr(command, "commands"):
            command = command.commands[words.pop(0)]
        known = {option for parameter in command.params for option in parameter.opts}
        assert {word for word in words if word.startswith("--")} <= known
