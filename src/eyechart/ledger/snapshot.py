"""A ledger is read from a copy, so that nothing is written beside it, whatever its format and whoever writes to it."""

import hashlib
import shutil
import sqlite3
from contextlib import ExitStack, suppress
from operator import methodcaller
from pathlib import Path

from eyechart.errors import plain_file
from eyechart.scratch import scratch

_COPIES = 20
"""Copies of a ledger that is written meanwhile, until one is whole; then it is read where it is, beside its writer."""


def open_copy(path: Path, opened: ExitStack) -> tuple[sqlite3.Connection, str | None]:
    """Open a copy of a ledger, taken with what its log holds that is not in it yet; return it with its digest.

    A copy is whole where the log was not begun anew meanwhile, as all that its writer moved into the file still stands
    in it; without a log, where the file did not change. Where no copy is, the ledger itself is opened, and there is no
    digest.
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
    """Open a database in the mode of its URI; each statement is a transaction of its own.

    Of a text that is no Unicode, which only damage makes, the bytes come as escapes.
    """
    sql = sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", isolation_level=None, uri=True)
    sql.text_factory = methodcaller("decode", "utf-8", "backslashreplace")  # of every text that is read
    sql.execute("PRAGMA trusted_schema = OFF")
    return sql


def _head(log: Path) -> bytes | None:
    """Return the head of a write-ahead log, which changes whenever it is begun anew; None where there is none."""
    try:
        with log.open("rb") as file:
            return file.read(32)
    except FileNotFoundError:
        return None


def _digest(path: Path) -> str:
    with plain_file(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
