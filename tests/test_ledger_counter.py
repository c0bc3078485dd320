"""A counter beside a ledger tells that calls which had been made are missing, and never that of calls that are not."""

import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner

from banks import build_bank
from eyechart.calls import CallKey, Reply
from eyechart.cli.app import app
from eyechart.errors import LedgerError, MissingCallsWarning
from eyechart.ledger import Ledger, accept_loss
from eyechart.ledger.counter import NOTHING, LedgerCount, WrittenCounts, read_counter
from eyechart.studies import battery

MODEL = "standin:steady"
DONE = Reply("GO", "stop")
WRITER = f"""
from eyechart.calls import CallKey, Reply
from eyechart.ledger import Ledger
DONE = Reply("GO", "stop")
def key(number):
    return CallKey("battery", {MODEL!r}, "baseline@0", f"f{{number}}", "real")
"""
"""What a process that is killed begins with."""


def key(number: int) -> CallKey:
    """Return the key of a call."""
    return CallKey("battery", MODEL, "baseline@0", f"f{number}", "real")


def fill(path: Path, *numbers: int) -> None:
    """Make calls, and close the ledger."""
    with Ledger(path, create=True) as ledger:
        for number in numbers:
            ledger.close(ledger.begin(key(number), "digest"), DONE)


@contextmanager
def killed(path: Path, says: str = "") -> Iterator[None]:
    """Hold a writer that has made calls 10 to 12, with a log, and kill it; ``says`` is run once they are made."""
    program = f"""
import sys
from pathlib import Path
{WRITER}with Ledger(Path({str(path)!r}), create=True) as ledger:
    for number in (10, 11, 12):
        ledger.close(ledger.begin(key(number), "digest"), DONE)
    ledger.begin(key(13), "digest")
    {says or "pass"}
    print("there", flush=True)
    sys.stdin.read()
"""
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as live:
        assert live.stdout is not None
        assert live.stdout.readline() == "there\n"
        live.send_signal(signal.SIGKILL)
        live.wait()
    yield


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return where a ledger of two finished calls lies."""
    path = tmp_path / "ledger.sqlite"
    fill(path, 0, 1)
    return path


def test_a_lost_log_is_missed_and_a_run_goes_on_only_once_that_is_accepted(path: Path) -> None:
    """Who reads is warned with the counts; nothing is appended; accepted, the same calls are made again."""
    with killed(path):
        Path(f"{path}-wal").unlink()
    Path(f"{path}-shm").unlink(missing_ok=True)
    said = (
        r"^4 requests and 3 replies that were written to .*ledger\.sqlite are missing: its log ledger\.sqlite-wal was"
    )
    with pytest.warns(MissingCallsWarning, match=said):
        ledger = Ledger(path)
    with ledger:
        assert ledger.missing == (4, 3)
        assert ledger.finished() == {key(0), key(1)}
    before = path.read_bytes()
    with pytest.raises(LedgerError, match=said.replace("^", "") + ".*--accept-loss$"):
        Ledger(path, create=True)
    assert path.read_bytes() == before
    assert accept_loss(path) == (4, 3)
    assert accept_loss(path) == NOTHING
    fill(path, 10)
    assert read_counter(path) == LedgerCount(WrittenCounts(3, 3), WrittenCounts(4, 3))


def test_an_older_copy_in_place_of_a_ledger_is_missed(path: Path, tmp_path: Path) -> None:
    """A backup that was put back holds fewer calls than were made."""
    shutil.copyfile(path, tmp_path / "older")
    fill(path, 2)
    shutil.copyfile(tmp_path / "older", path)
    with pytest.warns(MissingCallsWarning, match="1 request and 1 reply that were"), Ledger(path) as ledger:
        assert ledger.held() == (2, 2)


@pytest.mark.parametrize("what", ["gone", "empty", "no table"])
def test_a_ledger_that_lost_all_is_made_anew_once_that_is_accepted(path: Path, what: str) -> None:
    """What is left of it is kept under another name, its log too, which SQLite would take for the new one's."""
    path.unlink()
    if what != "gone":
        with closing(sqlite3.connect(path)) as sql:
            sql.execute("PRAGMA journal_mode = WAL" if what == "no table" else "PRAGMA user_version")
        path.touch()
    with pytest.raises(LedgerError, match="--accept-loss"):
        Ledger(path, create=True)
    Path(f"{path}-wal").write_bytes(b"of another")
    assert accept_loss(path) == (2, 2)
    assert Path(f"{path}-wal.lost.bak").exists()
    assert Path(f"{path}.lost.bak").exists() is (what != "gone")
    fill(path, 0)
    with Ledger(path) as ledger:
        assert ledger.missing == NOTHING
        assert ledger.finished() == {key(0)}


def test_a_log_that_another_reader_folded_in_is_no_loss(path: Path) -> None:
    """Any SQLite browser that closes last moves what the log holds into the file, and removes it."""
    with killed(path), closing(sqlite3.connect(path)) as sql:
        sql.execute("SELECT count(*) FROM calls").fetchone()
    assert not Path(f"{path}-wal").exists()
    fill(path, 20)
    with Ledger(path) as ledger:
        assert (ledger.missing, ledger.held()) == (NOTHING, (7, 6))


def test_what_is_merged_or_copied_has_lost_nothing(path: Path, tmp_path: Path) -> None:
    """A ledger without a counter, as of an older eyechart, gets one when it is next appended to."""
    with Ledger(tmp_path / "merged", create=True) as merged:
        for one in (path, tmp_path / "other"):
            fill(one, 5 if one != path else 2)
            with Ledger(one) as ledger:
                merged.absorb(ledger)
                ledger.copy_to(tmp_path / f"{one.name}.copy")
    assert read_counter(tmp_path / "merged").expected == (4, 4)
    copy = tmp_path / "ledger.sqlite.copy"
    assert read_counter(copy) == LedgerCount()
    fill(copy, 9)
    assert read_counter(copy).expected == (4, 4)
    for one in (tmp_path / "merged", copy):
        with Ledger(one) as ledger:
            assert ledger.missing == NOTHING


def test_what_was_written_together_is_counted_once_it_is_committed(path: Path) -> None:
    """A batch that fails counts nothing, one that is committed all of it."""
    with Ledger(path, create=True) as ledger:
        with pytest.raises(LedgerError, match="finished already"), ledger.together():  # noqa: PT012 - a batch
            ledger.begin(key(2), "digest")
            ledger.begin(key(0), "digest")
        assert read_counter(path).expected == (2, 2)
        with ledger.together():
            for number in (3, 4):
                ledger.close(ledger.begin(key(number), "digest"), DONE)
            assert read_counter(path).expected == (2, 2)
        assert read_counter(path).expected == (4, 4)


def test_a_kill_at_any_moment_makes_no_loss(tmp_path: Path) -> None:
    """The counter is written after the commit: killed between both, it says less than there is, and is put right."""
    path, choose = tmp_path / "ledger.sqlite", random.Random(0)  # noqa: S311 - moments, no secret
    fill(path)
    program = f"""
import itertools, sys
from pathlib import Path
{WRITER}with Ledger(Path({str(path)!r}), create=True) as ledger:
    print("there", flush=True)
    for number in itertools.count(len(ledger.finished())):
        with ledger.together():
            attempts = [ledger.begin(key(2 * number + one), "digest") for one in (1_000_000, 1_000_001)]
        for attempt in attempts:
            ledger.close(attempt, DONE)
"""
    for _ in range(4):
        with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as live:
            assert live.stdout is not None
            live.stdout.readline()
            time.sleep(choose.uniform(0.01, 0.1))
            live.send_signal(signal.SIGKILL)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with Ledger(path) as ledger:
                held, said = ledger.held(), read_counter(path).expected
                assert ledger.missing == NOTHING
        assert all(0 <= mine - its <= 2 for mine, its in zip(held, said, strict=True))
    with Ledger(path, create=True):
        assert read_counter(path).expected == held
    assert held.replies > 0


@pytest.mark.parametrize("which", ["begin", "close"])
def test_killed_between_the_commit_and_the_counter_nothing_is_missed(path: Path, which: str) -> None:
    """The row is there, and the counter learns of it when the run goes on."""
    program = f"""
import os, signal
from pathlib import Path
{WRITER}with Ledger(Path({str(path)!r}), create=True) as ledger:
    attempt = None if {which == "begin"} else ledger.begin(key(2), "digest")
    ledger._counter.write = lambda _: os.kill(os.getpid(), signal.SIGKILL)
    ledger.begin(key(2), "digest") if attempt is None else ledger.close(attempt, DONE)
"""
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == -signal.SIGKILL
    held = WrittenCounts(3, 2 + (which == "close"))
    with Ledger(path) as ledger:
        assert (ledger.missing, ledger.held()) == (NOTHING, held)
    assert read_counter(path).expected != held
    fill(path)
    assert read_counter(path).expected == held


@pytest.mark.parametrize("text", [b"", b"{}", b"[]", b"[" * 10**5, b'{"requests": 1e400}', b"\xff", None])
def test_a_damaged_counter_is_named(path: Path, text: bytes | None) -> None:
    """Also one whose number was changed: it has a checksum of its own."""
    counter = path.with_name("ledger.sqlite.counter")
    counter.write_bytes(counter.read_bytes().replace(b"2", b"1", 1) if text is None else text)
    for create in (False, True):
        with pytest.raises(LedgerError, match=r"ledger\.sqlite\.counter is damaged: it does not say how many"):
            Ledger(path, create=create)


@pytest.mark.slow
def test_commands_say_how_many_calls_are_missing(tmp_path: Path) -> None:
    """`score` and `costs` say so on one line beside their numbers; `run` refuses, and goes on with --accept-loss."""
    bank, out = build_bank(tmp_path / "bank").root, tmp_path / "run"
    asked = ["run", "battery", "--model", "scripted:depth", "--frames", str(bank), "--out", str(out)]
    battery.run(battery.plan(bank, ["scripted:depth"], out, conditions=["real"]))
    older = tmp_path / "older"
    shutil.copyfile(out / "ledger.sqlite", older)
    battery.run(battery.plan(bank, ["scripted:depth"], out))
    made = read_counter(out / "ledger.sqlite").expected
    shutil.copyfile(older, out / "ledger.sqlite")
    for command in ("score", "costs"):
        done = subprocess.run(
            [sys.executable, "-c", "from eyechart.cli import main; main()", command, str(out)],
            capture_output=True, text=True, check=False, env={**os.environ, "COLUMNS": "400"},
        )  # fmt: skip
        lines = [line for line in done.stderr.splitlines() if "missing" in line]
        assert len(lines) == 1, done.stderr
        assert lines[0].startswith("eyechart: ")
        assert "requests and " in lines[0]
        assert done.returncode == 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MissingCallsWarning)
        refused = CliRunner().invoke(app, asked)
        assert isinstance(refused.exception, LedgerError)
        assert "--accept-loss" in str(refused.exception)
        again = CliRunner().invoke(app, [*asked, "--accept-loss"])
    assert again.exit_code == 0, again.output
    assert "are lost: the run continues without them" in again.output
    with Ledger(out / "ledger.sqlite") as ledger:
        assert (ledger.held(), ledger.missing) == (made, NOTHING)


@pytest.mark.parametrize("study", ["policy", "import"])
def test_every_run_goes_on_without_what_was_lost(tmp_path: Path, study: str) -> None:
    """Where the command says so: of policies, and of answers that were made elsewhere."""
    out = tmp_path / "run"
    if study == "policy":
        bank = tmp_path / "bank"
        CliRunner().invoke(app, ["frames", "build", "tabletop", "--seeds", "0", "--steps", "4", "--out", str(bank)])
        asked = ["run", "policy", "--policy", "trained:sees", "--frames", str(bank), "--out", str(out)]
    else:
        bank = build_bank(tmp_path / "bank").root
        export = tmp_path / "export"
        CliRunner().invoke(app, ["frames", "export", str(bank), "--out", str(export), "--conditions", "real"])
        rows = [json.loads(line) for line in (export / "asked.jsonl").read_text(encoding="utf-8").splitlines()]
        answers = tmp_path / "answers.jsonl"
        answers.write_text("".join(json.dumps({**row, "text": "SLOW"}) + "\n" for row in rows), encoding="utf-8")
        asked = ["run", "import", str(answers), "--frames", str(bank), "--out", str(out), "--conditions", "real"]
    assert CliRunner().invoke(app, asked).exit_code == 0
    (out / "ledger.sqlite").unlink()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MissingCallsWarning)
        refused = CliRunner().invoke(app, asked)
        assert isinstance(refused.exception, LedgerError)
        again = CliRunner().invoke(app, [*asked, "--accept-loss"])
    assert again.exit_code == 0, again.output
    assert "are lost: the run continues without them" in again.output
