"""What is not loaded before it is used: what only calls and pages need, and the threads of arithmetic."""

import os
import subprocess
import sys

import pytest

from eyechart import cli
from eyechart.cli.app import app


def test_what_reads_a_run_loads_nothing_that_calls_or_draws() -> None:
    """It holds no lock, does not see whether a model sees, and opens no world."""
    never = "filelock eyechart.probe rich.console matplotlib jinja2 highway_env"
    code = f"""
import sys
import eyechart.cli.score, eyechart.studies.battery.study, eyechart.studies.hierarchy.study
print(*(name for name in {never.split()!r} if name in sys.modules))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize(
    ("argv", "given", "threads"),
    [
        (["verdict", "run"], None, "1"),
        (["score", "--json", "run"], None, "1"),
        (["score", "run"], "3", "3"),
        (["run", "battery", "--model", "verdict"], None, None),
        (["serve"], None, None),
        ([], None, None),
    ],
)
def test_a_command_that_only_reads_multiplies_in_one_thread(
    argv: list[str], given: str | None, threads: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A model that runs in this process has the threads that it would have elsewhere."""
    monkeypatch.setattr(sys, "argv", ["eyechart", *argv])
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    if given is not None:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", given)
    cli._keep_to_one_thread()
    assert os.environ.get("OPENBLAS_NUM_THREADS") == threads


def test_the_commands_that_only_read_are_known() -> None:
    """Every command reads, or asks, drives or writes otherwise: a new one is to be put on one side."""
    others = {"doctor", "probe", "demo", "merge", "serve", "ladder", "film", "look"}
    commands = {
        command.name or command.callback.__name__ for command in app.registered_commands if command.callback is not None
    }
    assert commands == cli._READING | others


@pytest.mark.parametrize(("command", "threads"), [("verdict", "1"), ("merge", "None")])
def test_the_threads_are_bounded_before_anything_multiplies(command: str, threads: str) -> None:
    """OpenBLAS reads the variable when numpy is imported."""
    code = f"""
import os, sys
from eyechart import cli
class Seen:
    def find_spec(self, name, *_):
        if name == "numpy":
            print(os.environ.get("OPENBLAS_NUM_THREADS"), file=sys.__stderr__, flush=True)
            os._exit(0)
sys.meta_path.insert(0, Seen())
sys.argv = ["eyechart", "{command}", "nothing", "--out", "nowhere"][: 3 if "{command}" == "verdict" else 5]
cli.main()
"""
    env = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=env)
    assert done.stderr.strip() == threads
