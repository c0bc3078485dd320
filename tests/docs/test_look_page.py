"""The page about looks cannot rot: its commands parse, its Python runs, and its workflow is executed step by step."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.main import get_command

from banks import build_bank
from eyechart.cli.app import app
from pages import ROOT
from seeing import served

PAGE = (ROOT / "docs" / "look.md").read_text(encoding="utf-8")
BIN = Path(sys.executable).parent
MODEL = "openai:gpt-5.4-mini"


def blocks(kind: str) -> list[str]:
    """Return the blocks of one language."""
    return re.findall(rf"^```{kind}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def test_its_commands_and_options_exist() -> None:
    """Every line of eyechart names options that there are."""
    known = {option for parameter in get_command(app).commands["look"].params for option in parameter.opts}
    lines = blocks("sh")[0].splitlines()
    assert len(lines) >= 7
    for line in lines:
        assert line.startswith("eyechart look ")
        assert {word for word in line.split() if word.startswith("--")} <= known, line


def test_its_python_runs(tmp_path: Path) -> None:
    """The example of a script, and that of a test, which fails of who does not look and says why."""
    script, *suite = blocks("python")
    build_bank(tmp_path / "bank", episodes=4, steps=2)
    (tmp_path / "script.py").write_text(script)
    for text in suite:
        name, _, rest = text.removeprefix("# ").partition("\n")
        (tmp_path / name).write_text(rest)
    said = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert said.stdout.startswith(("Inconclusive. ", "No. "))
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "--basetemp", tmp_path / "inner"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "scripted:presence looks: " in done.stdout


def test_its_workflow_is_executed_and_an_unchanged_prompt_costs_no_call(tmp_path: Path) -> None:
    """Each block in its order, the cache being the folder; a stand-in is the model, and a small bank is ours."""
    (steps,) = blocks("yaml")
    runs = re.findall(r"^      - run: (.*)$", steps, re.MULTILINE)
    install, *commands = runs
    assert install.startswith("pip install ")
    assert len(commands) == 3
    assert re.findall(r"path: (\w+), key", steps) == ["looks", "looks"]
    bank = build_bank(tmp_path / "bank", episodes=4, steps=2)
    (tmp_path / "prompt.toml").write_text('name = "own"\nsystem = ""\nuser = "Answer with one of {actions}."\n')
    page = tmp_path / "summary.md"
    env = {**os.environ, "GITHUB_STEP_SUMMARY": str(page), "PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}"}
    with served() as server:
        own = f"{MODEL} --base-url {server.base_url} --frames {bank.root}"
        codes, asked = [], []
        for _ in range(2):
            for command in commands:
                done = subprocess.run(
                    ["bash", "-c", command.replace(MODEL, own)], cwd=tmp_path, env=env, capture_output=True, check=False
                )
                codes.append(done.returncode)
            asked.append(server.requests)
    assert asked[0] == asked[1] > 50
    assert codes[:3] == codes[3:]
    assert codes[2] == 0
    assert set(codes) <= {0, 1, 2}
    assert "<testsuites" in (tmp_path / "looks.xml").read_text()
    assert page.read_text().startswith("| looks? | model | because |\n| --- | --- | --- |\n| **")


@pytest.mark.parametrize("name", ["bank", "mode.toml", "run", "report.html", "summary.md"])
def test_it_names_what_lies_in_the_folder(name: str) -> None:
    """As the test of the workflow finds it."""
    assert f"`{name}`" in PAGE
