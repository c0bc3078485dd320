"""Read a ledger from a copy, so that no file is written beside it."""

import hashlib
import shutil
import sqlite3
from contextlib import ExitStack, suppress
from operator import methodcaller
from pathlib import Path

from eyechart.errors import plain_file
from eyechart.scratch import scratch

_COPIES = 20
"""Copies to try of a ledger under writing; after that it is read in place."""


def open_copy(path: Path, opened: ExitStack) -> tuple[sqlite3.Connection, str | None]:
    """Open a copy of a ledger and its log; return it with its digest.

    A copy is whole if the log was not restarted meanwhile: all that moved into the file is then
    still in the log. Without a log, the file must not have changed. If no copy is whole, the ledger
    itself is opened, and the digest is None.
    """
    copy = opened.enter_context(scratch("ledger")) / "ledger.sqlite"
    log, its_log = (one.with_name(f"{one.name}-wal") for one in (path, copy))
    for _ in range(_COPIES):
        head, file = _head(log), path.stat()
        shutil.copyfile(path, copy)
        with suppress(FileNotFoundError):
            if head is not None:
                shutil.copyfile(log, its_log)
            now = path.stat()
            if _head(log) == head and (head or (file.st_mtime_ns, file.st_size) == (now.st_mtime_ns, now.st_size)):
                digest = _digest(copy) if head is None else f"{_digest(copy)} {_digest(its_log)}"
                return connect(copy, "immutable=1" if head is None else "mode=ro"), digest
    return connect(path, "mode=ro"), None


def connect(path: Path, mode: str) -> sqlite3.Connection:
    """Open a database in a URI mode; each statement is a transaction of its own.

    Text that is not Unicode, which only damage makes, is read with escapes.
    """
    sql = sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", isolation_level=None, uri=True)
    sql.text_factory = methodcaller("decode", "utf-8", "backslashreplace")  # for every text
    sql.execute("PRAGMA trusted_schema = OFF")
    return sql


def _head(log: Path) -> bytes | None:
    """Return the head of a write-ahead log, which changes on a restart; None without a log."""
    try:
        with log.open("rb") as file:
            return file.read(32)
    except FileNotFoundError:
        return None


def _digest(path: Path) -> str:
    with plain_file(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
