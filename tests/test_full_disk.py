"""A full disk is called a full disk, whoever writes, and nothing half-written stays in a file's place."""

import errno
import os
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from banks import build_bank
from eyechart import destination
from eyechart.bundle import write_bundle
from eyechart.destination import KINDS, whole
from eyechart.errors import EyechartError, LedgerError, OutputError, is_full, why
from eyechart.frames import own_folder
from eyechart.ledger import Ledger, snapshot
from eyechart.ledger import ledger as ledgers
from eyechart.ledger.counter import NOTHING
from eyechart.studies import battery

FULL = Path("/dev/full")
SAYS = "the disk is full"
MODEL = "scripted:depth"
pytestmark = pytest.mark.skipif(not FULL.exists(), reason="a system without a device that is always full")


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bank."""
    return build_bank(tmp_path_factory.mktemp("bank") / "bank").root


@pytest.fixture(scope="module")
def run(bank: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a finished run."""
    out = tmp_path_factory.mktemp("run") / "run"
    battery.run(battery.plan(bank, [MODEL], out))
    return out


def command(*given: object) -> str:
    """Return the one line of a command that fails as bad input does."""
    program = [sys.executable, "-c", "from eyechart.cli import main; main()", *map(str, given)]
    done = subprocess.run(program, capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr.splitlines()[-1]


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_that_finds_no_room_is_not_there(tmp_path: Path, kind: str) -> None:
    """Of every kind that is written whole; no part of it is left either."""
    out = tmp_path / "out"
    with pytest.raises(OutputError, match=f"out cannot be written: {SAYS}"), whole(out, kind) as partial:  # noqa: PT012
        partial.symlink_to(FULL)
        partial.write_bytes(b"much")
    assert not list(tmp_path.iterdir())


def test_a_run_folder_that_finds_no_room_says_so(bank: Path, tmp_path: Path) -> None:
    """The command's one line, of its first file already."""
    out = tmp_path / "out"
    out.mkdir()
    (out / ".run.json").symlink_to(FULL)
    assert SAYS in command("run", "battery", "--model", MODEL, "--frames", bank, "--out", out)


def test_a_bundle_that_finds_no_room_says_so(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is packed beside its place, and nothing stands there."""

    @contextmanager
    def full(out: Path, error: type[EyechartError]) -> Iterator[Path]:
        with own_folder(out, error) as work:
            (work / "made.zip").symlink_to(FULL)
            yield work

    monkeypatch.setattr(destination, "own_folder", full)
    with pytest.raises(OutputError, match=f"b.zip cannot be written: {SAYS}"):
        write_bundle(run, tmp_path / "b.zip", resamples=100)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("pages", [20, 24])
def test_a_ledger_that_finds_no_room_says_so_and_the_same_command_resumes(
    bank: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pages: int
) -> None:
    """SQLite's own error, from a bound on its pages; every finished call is kept, and none is missing."""
    out, connect = tmp_path / "run", ledgers.connect

    def bounded(path: Path, mode: str) -> sqlite3.Connection:
        sql = connect(path, mode)
        sql.execute(f"PRAGMA max_page_count = {pages}")
        return sql

    with monkeypatch.context() as full:
        full.setattr(ledgers, "connect", bounded)
        with pytest.raises(LedgerError, match=rf"ledger\.sqlite cannot be written: {SAYS}; the same command resumes"):
            battery.run(battery.plan(bank, [MODEL], out))
    with Ledger(out / "ledger.sqlite") as ledger:
        kept, missing = ledger.finished(), ledger.missing
    assert kept
    assert missing == NOTHING
    assert battery.run(battery.plan(bank, [MODEL], out)).stopped is None
    with Ledger(out / "ledger.sqlite") as ledger:
        assert kept < ledger.finished()


def test_a_ledger_that_cannot_be_copied_to_be_read_says_where(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk that is full is that of temporary files, not the run's."""

    def copy(source: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(source), None, str(target))

    monkeypatch.setattr(snapshot.shutil, "copyfile", copy)
    with pytest.raises(LedgerError, match=rf"cannot be read: {SAYS} \(.*eyechart-ledger-"):
        Ledger(run / "ledger.sqlite")


def test_a_quota_is_a_full_disk_and_another_fault_is_none() -> None:
    """What SQLite says of the file beside a ledger that it cannot make longer is one too."""
    beside = sqlite3.OperationalError("disk I/O error")
    beside.sqlite_errorname = "SQLITE_IOERR_SHMSIZE"
    assert is_full(OSError(errno.EDQUOT, "quota"))
    assert is_full(beside)
    assert why(beside) == SAYS
    assert not is_full(PermissionError(errno.EACCES, "denied"))
    assert why(PermissionError(errno.EACCES, "denied")) == "denied"


@pytest.mark.parametrize("most_kb", [1, 20, 60, 120])
def test_a_run_whose_files_may_grow_no_further_says_so_and_resumes(bank: Path, tmp_path: Path, most_kb: int) -> None:
    """Whichever file meets the bound first: nothing stands half-written, every finished call is kept."""
    resource = pytest.importorskip("resource")
    out, given = tmp_path / "run", ["run", "battery", "--model", MODEL, "--frames", str(bank), "--out"]

    def bounded() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most_kb * 1024,) * 2)

    program = [sys.executable, "-c", "from eyechart.cli import main; main()", *given, str(out)]
    done = subprocess.run(program, capture_output=True, text=True, check=False, preexec_fn=bounded)
    assert done.returncode == 2, done.stderr
    said = done.stderr.splitlines()[-1]
    assert "ulimit -f" in said or SAYS in said
    assert "Traceback" not in done.stderr
    assert "Errno" not in said
    kept = set()
    if (out / "ledger.sqlite").exists():
        with Ledger(out / "ledger.sqlite") as ledger:
            kept, missing = ledger.finished(), ledger.missing
        assert missing == NOTHING
    assert battery.run(battery.plan(bank, [MODEL], out)).stopped is None
    with Ledger(out / "ledger.sqlite") as ledger:
        assert kept < ledger.finished()
    left = {"run.json", "bank", "ledger.sqlite", "ledger.sqlite.counter", ".lock"}
    assert {path.name for path in out.iterdir()} - left <= {"ledger.sqlite-wal", "ledger.sqlite-shm"}


@pytest.mark.parametrize("command", ["report", "bundle"])
def test_what_may_not_be_as_long_as_it_must_is_not_there(run: Path, tmp_path: Path, command: str) -> None:
    """No part of a page or a bundle stands in its place or beside it."""
    resource = pytest.importorskip("resource")
    out = tmp_path / "out" / f"it.{'html' if command == 'report' else 'zip'}"
    out.parent.mkdir()

    def bounded() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (60 * 1024,) * 2)

    program = [sys.executable, "-c", "from eyechart.cli import main; main()", command, str(run), "--out", str(out)]
    done = subprocess.run(program, capture_output=True, text=True, check=False, preexec_fn=bounded)
    assert done.returncode == 2, done.stderr
    assert "ulimit -f" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert not list(out.parent.iterdir())
