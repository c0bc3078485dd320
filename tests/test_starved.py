"""A machine that lacks something, and files that are none: words, and nothing that passes is final."""

import asyncio
import errno
import os
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from banks import build_bank
from eyechart import cli
from eyechart.calls import UNFINISHED, Query, Reply
from eyechart.episodes.records import read_episodes
from eyechart.errors import BankError, EyechartError, LedgerError
from eyechart.event_loops import in_own_loop
from eyechart.frames import Stimulus, open_bank
from eyechart.ledger import Ledger
from eyechart.manifest import read_manifest
from eyechart.models import ask
from eyechart.models.python_callable import PythonCallable, _CallThread
from eyechart.modes import RequestMode
from eyechart.overview import read_index
from eyechart.studies import ReadOptions, study_of


@pytest.mark.parametrize(
    ("raised", "says"),
    [
        (MemoryError(), "there is not enough memory"),
        (sqlite3.OperationalError("disk I/O error"), "a database cannot be read or written: disk I/O error"),
        (sqlite3.OperationalError("database or disk is full"), "cannot be read or written: the disk is full"),
    ],
)
def test_a_lack_is_said_in_one_line(
    raised: Exception, says: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of memory, and what SQLite says wherever it is asked; a traceback comes only with --debug."""

    def lacking(**_: object) -> None:
        raise raised

    monkeypatch.setattr("eyechart.cli.app.named", lambda _: lacking)
    monkeypatch.setattr(sys, "argv", ["eyechart", "verdict", "run"])
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("eyechart: ")
    assert says in said
    assert said.count("\n") == 1
    monkeypatch.setattr(sys, "argv", ["eyechart", "verdict", "run", "--debug"])
    with pytest.raises(type(raised)):
        cli.main()


def test_an_output_that_is_cut_is_said_whatever_a_command_ends_with(tmp_path: Path) -> None:
    """`doctor` exits 2 where it cannot say; a full disk took the rest of its JSON without a word."""
    (tmp_path / "mute.py").write_text("def answer(prompt, image):\n    return 'SLOW'\n")
    words = [sys.executable, "-m", "eyechart", "doctor", "python:mute:answer", "--json"]
    there = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            words, cwd=tmp_path, env=there, stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=200
        )
    assert ended.returncode == 2
    assert "the disk is full" in ended.stderr


@pytest.mark.parametrize("number", [errno.EMFILE, errno.ENFILE])
def test_an_adapter_that_finds_no_descriptor_left_is_asked_again(number: int) -> None:
    """It says nothing about the model; a file that is not there is an error of the adapter."""

    class Model:
        def __init__(self, number: int) -> None:
            self.number = number

        async def answer(self, query: Query) -> Reply:
            del query
            raise OSError(self.number, os.strerror(self.number))

    found = [asyncio.run(ask(Model(one), Query("", "go", Stimulus({}), 1))).error for one in (number, errno.ENOENT)]  # type: ignore[arg-type]
    assert (found[0] in UNFINISHED, found[1]) == (True, "exception")


def test_a_call_whose_thread_cannot_begin_was_not_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same command makes it once there is room; another error of a thread is the callable's own."""

    def no_room(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    _CallThread.end_free()  # an earlier call's would be taken
    monkeypatch.setattr(threading.Thread, "start", no_room)
    model = PythonCallable(lambda _prompt, _image: "STOP", RequestMode("python:m:f"), "v", {})
    reply = asyncio.run(ask(model, Query("", "go", Stimulus({}), 1)))
    assert reply.error == "not_called"
    assert "can't start new thread" in reply.error_detail


def test_a_loop_that_cannot_be_made_leaves_no_coroutine_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    """CPython would warn of it in the middle of the words; here a warning is an error."""

    async def asked() -> None:
        pytest.fail("there is no loop")

    def few(*_: object) -> asyncio.AbstractEventLoop:
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(asyncio, "new_event_loop", few)
    monkeypatch.setattr(asyncio.events, "new_event_loop", few)
    with pytest.raises(OSError, match="Too many open files"):
        in_own_loop(asked())


def in_its_place(path: Path) -> None:
    """Put a pipe that nobody writes to in a file's place."""
    path.unlink(missing_ok=True)
    os.mkfifo(path)


@pytest.mark.parametrize("name", ["manifest.json", "metadata.jsonl"])
def test_a_pipe_in_a_bank_is_refused_in_words(name: str, tmp_path: Path) -> None:
    """Nobody waits for what never comes."""
    build_bank(tmp_path / "bank", episodes=1)
    in_its_place(tmp_path / "bank" / name)
    begun = time.monotonic()
    with pytest.raises(BankError, match="cannot be read: a pipe or a device is not a file"):
        open_bank(tmp_path / "bank")
    assert time.monotonic() - begun < 5


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("run.json", read_manifest),
        ("episodes.jsonl", lambda run: list(read_episodes(run))),
        ("ledger.sqlite", lambda run: Ledger(run / "ledger.sqlite")),
    ],
)
def test_a_pipe_in_a_run_is_refused_in_words(name: str, read: Callable[[Path], object], tmp_path: Path) -> None:
    """As one that somebody sent."""
    in_its_place(tmp_path / name)
    with pytest.raises((EyechartError, OSError)):
        read(tmp_path)


def test_a_run_that_cannot_be_read_is_not_taken_for_one_of_another_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is said, and an index of it and others says it in its place."""
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text("{}")
    usual = Path.read_text

    def broken(path: Path, *given: str, **named: str) -> str:
        if path.name == "run.json":
            raise OSError(5, "Input/output error", str(path))
        return usual(path, *given, **named)

    monkeypatch.setattr(Path, "read_text", broken)
    with pytest.raises(LedgerError, match=r"run\.json cannot be read: Input/output error"):
        study_of(tmp_path / "run")
    (entry,) = read_index(tmp_path, ReadOptions(), print)
    assert "cannot be read: Input/output error" in repr(entry)
