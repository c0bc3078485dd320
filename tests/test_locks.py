"""A file system without locks is named as one, and nobody who writes goes on without."""

import errno
import fcntl
import os
import resource
import sys
from pathlib import Path

import pytest

from eyechart.errors import BankError, LedgerError
from eyechart.frames.folder import own_folder
from eyechart.manifest import alone_in


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP])
def test_a_file_system_without_locks_gets_words(number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a folder that is mounted over a network: a run, and what is made whole, say what to do."""

    def flock(*_: object) -> None:
        raise OSError(number, "the system's own words")

    monkeypatch.setattr(fcntl, "flock", flock)
    says = r"\.lock cannot be locked: .*; its file system has no locks: choose a place on a disk of this machine"
    with pytest.raises(LedgerError, match=says), alone_in(tmp_path / "run"):
        pytest.fail("it is not held")
    with pytest.raises(BankError, match=says), own_folder(tmp_path / "bank", BankError):
        pytest.fail("it is not held")


def test_a_folder_that_cannot_be_locked_is_in_nobodys_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is gone, and the same command goes on once the fault has passed."""

    def full(*_: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    with monkeypatch.context() as fault:
        fault.setattr(os, "open", full)
        held = own_folder(tmp_path / "bank", BankError)
        with pytest.raises(BankError):
            held.__enter__()
    assert list(tmp_path.iterdir()) == []
    with own_folder(tmp_path / "bank", BankError) as work:
        assert work.is_dir()


def test_where_locks_are_not_there_at_all_a_file_stands_for_one(tmp_path: Path) -> None:
    """The system's call is missing: a run is held none the less, and a second one is refused."""
    program = (
        "import fcntl, errno, sys\n"
        "def flock(*_): raise OSError(errno.ENOSYS, 'no such call')\n"
        "fcntl.flock = flock\n"
        "from pathlib import Path\n"
        "from eyechart.errors import LedgerError\n"
        "from eyechart.manifest import alone_in\n"
        "with alone_in(Path(sys.argv[1])):\n"
        "    try:\n"
        "        with alone_in(Path(sys.argv[1])): pass\n"
        "    except LedgerError as error: print(error)\n"
        "with alone_in(Path(sys.argv[1])): print('held')\n"
    )
    import subprocess  # noqa: PLC0415 - as below

    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program, str(tmp_path / "run")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "another process is writing to" in done.stdout, done.stderr
    assert done.stdout.endswith("held\n")


def test_what_cannot_be_removed_for_want_of_descriptors_is_taken_by_the_next(tmp_path: Path) -> None:
    """The lock goes last: a folder without one is taken for somebody else's, and would stay in the way."""
    free = [os.open(tmp_path, os.O_RDONLY) for _ in range(2)]
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        with own_folder(tmp_path / "out", BankError) as work:
            (work / "made" / "deep").mkdir(parents=True)
            for one in free:
                os.close(one)
            resource.setrlimit(resource.RLIMIT_NOFILE, (max(free) + 1, limits[1]))
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    with own_folder(tmp_path / "out", BankError) as work:
        assert [path.name for path in work.iterdir()] == [".lock"]
    assert list(tmp_path.iterdir()) == []
