"""A callable that prints below Python, or changes the folder, changes nothing of what a command prints and writes."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from banks import build_bank
from eyechart.cli.terminal import as_typed, from_here

NOISY = """
import ctypes, os, subprocess, sys
os.write(1, b"NOISE-IMPORT\\n")

def below(prompt, image):
    os.write(1, b"NOISE-WRITE\\n")
    return "SLOW"

def printf(prompt, image):
    libc = ctypes.CDLL(None)
    libc.puts(b"NOISE-C")
    libc.fflush(None)
    return "SLOW"

def process(prompt, image):
    subprocess.run(["echo", "NOISE-PROCESS"], check=True)
    return "SLOW"

def text(prompt, image):
    print("NOISE-PRINT")
    return "SLOW"
"""
WANDERING = """
import os
{at_import}

def decide(prompt, image):
    os.chdir("/")
    return "SLOW"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a bank, a prompt and a callable of each kind."""
    build_bank(tmp_path / "bank")
    (tmp_path / "noisy.py").write_text(NOISY, encoding="utf-8")
    (tmp_path / "elsewhere").mkdir()
    away = f"os.chdir({str(tmp_path / 'elsewhere')!r})"
    (tmp_path / "stays.py").write_text(WANDERING.format(at_import=""), encoding="utf-8")
    (tmp_path / "leaves.py").write_text(WANDERING.format(at_import=away), encoding="utf-8")
    words = 'user = "Which of STOP, SLOW, STRAIGHT, LEFT, RIGHT?"\n'
    (tmp_path / "mine.toml").write_text(words, encoding="utf-8")
    return tmp_path


def eyechart(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a command in the folder."""
    there = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "COLUMNS": "300"}
    command = [sys.executable, "-m", "eyechart", *words]
    return subprocess.run(command, cwd=folder, env=there, timeout=200, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("how", ["below", "printf", "process", "text"])
def test_json_stays_json_whatever_a_callable_prints(folder: Path, how: str) -> None:
    """From Python, from C, and from another process; it is said on standard error."""
    ended = eyechart(folder, "doctor", f"python:noisy:{how}", "--json")
    assert json.loads(ended.stdout)
    assert {"NOISE" in ended.stdout, "NOISE" in ended.stderr} == {False, True}
    assert "NOISE-IMPORT" in ended.stderr


def test_a_callable_that_closes_the_streams_ends_no_run(folder: Path) -> None:
    """Its own prints are lost; what the command says is said, and it ends as it would have."""
    closing = "import os\n\ndef decide(prompt, image):\n    os.closerange(1, 3)\n    return 'SLOW'\n"
    (folder / "closing.py").write_text(closing, encoding="utf-8")
    asked = ("--model", "python:closing:decide", "--frames", "bank", "--out", "run", "--conditions", "real,blank")
    ended = eyechart(folder, "run", "battery", *asked)
    assert ended.returncode == 0, ended.stderr
    assert "done: 'eyechart verdict run' judges" in ended.stderr


LEAVING = """
import os, threading, time

def thread(prompt, image):
    threading.Thread(target=time.sleep, args=(3600,), name="left here", daemon=False).start()
    return "SLOW"

def brief(prompt, image):
    threading.Thread(target=time.sleep, args=(0.1,), daemon=False).start()
    return "SLOW"

def files(prompt, image):
    os.closerange(3, 4096)
    return "SLOW"
"""


@pytest.mark.parametrize(
    ("name", "code", "says"),
    [
        ("thread", 0, "threads of the called code ended with the command (first 'left here')"),
        ("brief", 0, "'eyechart verdict run' judges, 'eyechart score run' prints every statistic"),
        ("files", 2, "eyechart: the called code closed files that are not its own: correct that code"),
    ],
)
def test_what_a_callable_leaves_or_closes_ends_the_command_with_one_line(
    folder: Path, name: str, code: int, says: str
) -> None:
    """A thread that goes on for an hour keeps no command, and closed files are named, without the loop's complaints."""
    (folder / "leaving.py").write_text(LEAVING, encoding="utf-8")
    asked = ("--model", f"python:leaving:{name}", "--frames", "bank", "--out", "run", "--conditions", "real,blank")
    ended = eyechart(folder, "run", "battery", *asked)
    assert ended.returncode == code, ended.stderr
    assert says in ended.stderr.splitlines()[-1]
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize("way", ["closed", "full", "nobody reads"])
def test_a_stream_that_takes_nothing_is_met_as_before(folder: Path, way: str) -> None:
    """What is closed or full is said, and a reader who went away ends the command."""
    shell = {
        "closed": 'exec "$@" >&-',
        "full": 'exec "$@" >/dev/full',
        "nobody reads": 'set -o pipefail; "$@" | true',
    }[way]
    command = ["bash", "-c", shell, "x", sys.executable, "-m", "eyechart", "list", "conditions"]
    ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=100)
    assert ended.returncode in {"closed": {2}, "full": {2}, "nobody reads": {0, 141}}[way]
    assert "Traceback" not in ended.stderr
    assert ("the disk is full" in ended.stderr) == (way == "full")


@pytest.mark.parametrize("module", ["stays", "leaves"])
def test_a_callable_that_changes_the_folder_changes_no_path(folder: Path, module: str) -> None:
    """Its run is whole, where it was to be, and the commands that are named run as they are typed."""
    asked = ("run", "battery", "--model", f"python:{module}:decide", "--frames", "bank", "--out", "runs/one")
    ended = eyechart(folder, *asked, "--prompt", "mine.toml", "--limit", "3", "--conditions", "real,blank")
    assert ended.returncode == 0, ended.stderr
    assert "'eyechart verdict runs/one' judges" in ended.stderr
    assert str(folder) not in ended.stderr
    assert list((folder / "elsewhere").iterdir()) == []
    assert eyechart(folder, "costs", "runs/one", "--json").returncode == 0
    again = eyechart(folder, *asked, "--prompt", "mine.toml", "--limit", "3", "--conditions", "real,blank")
    assert "6 finished" in again.stderr, again.stderr


def test_an_error_names_a_path_as_it_was_typed(folder: Path) -> None:
    """Whatever it is made of inside."""
    ended = eyechart(folder, "run", "battery", "--model", "python:stays:decide", "--frames", "no/bank", "--out", "run")
    assert ended.returncode == 2
    assert "no/bank" in ended.stderr
    assert str(folder) not in ended.stderr


def test_paths_are_shown_as_they_were_typed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One whose name begins alike is another."""
    monkeypatch.setattr("eyechart.cli.terminal._typed", {})
    monkeypatch.chdir(tmp_path)
    place = from_here(Path("run"))
    assert place == tmp_path / "run"
    said = f"{place}, {place}/ledger, {place}2, {place}-b, {place}.zip and {place}."
    assert as_typed(said) == f"run, run/ledger, {place}2, {place}-b, {place}.zip and run."
    from_here(Path())
    assert as_typed(f"{tmp_path}/bank in {tmp_path}") == "bank in ."
    assert from_here(tmp_path / "x") == tmp_path / "x"
