"""The counter beside a ledger: the number of rows written, so that a loss is noticed.

It has a file of its own, outside SQLite's. It is written after each commit and before a request
leaves. So it never exceeds what was committed, and is never below what was sent
(docs/decisions/ledger.md).
"""

import json
import os
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, NamedTuple

from eyechart.errors import LedgerError, counted, plain_file

SUFFIX = ".counter"
_LENGTH = 160
_LOOKS = 3
"""A line that is read during a write may be incomplete; it is then read again."""
_MOST = 2**53
_HEAD, _JOURNAL, _FORMAT = 100, 18, 60
"""In a database file: bytes of the head, and offsets of the journal's kind and of the format."""
_LOG = b"\2\2"
_COUNTED_SINCE = 3


class WrittenCounts(NamedTuple):
    """The numbers of requests and replies that were written."""

    requests: int
    replies: int

    def plus(self, more: "WrittenCounts") -> "WrittenCounts":
        """Return the sums."""
        return WrittenCounts(self.requests + more.requests, self.replies + more.replies)

    def without(self, held: "WrittenCounts") -> "WrittenCounts":
        """Return how many of these are missing from ``held``."""
        return WrittenCounts(*(max(0, mine - its) for mine, its in zip(self, held, strict=True)))

    @property
    def words(self) -> str:
        """Return the numbers in words."""
        parts = (counted(n, one) for n, one in zip(self, ("request", "reply"), strict=True) if n)
        return " and ".join(parts) or "nothing"


NOTHING = WrittenCounts(0, 0)


class LedgerCount(NamedTuple):
    """A counter's content: the rows a ledger should hold, and its accepted loss."""

    expected: WrittenCounts = NOTHING
    lost: WrittenCounts = NOTHING


def read_counter(ledger: Path) -> LedgerCount:
    """Return what a ledger's counter says; zeros if it has none, as an older one or a copy.

    Raises LedgerError if the counter is damaged.
    """
    path = _beside(ledger)
    for look in range(_LOOKS):
        try:
            with plain_file(path).open("rb") as file:
                line = file.read(_LENGTH + 1)
        except FileNotFoundError:
            return LedgerCount()
        if (result := _read(line)) is not None:
            return result
        time.sleep(0.01 * look)
    raise LedgerError(
        f"{path} is damaged: it does not say how many calls were written; restore it, or delete it and give up "
        "the check for missing calls"
    )


class Counter:
    """The counter of a ledger that is open to append."""

    def __init__(self, file: BinaryIO, lost: WrittenCounts) -> None:
        self._file, self._lost = file, lost

    def write(self, held: WrittenCounts) -> None:
        """Record how many rows the ledger holds, in one write; raises OSError if that fails."""
        self._file.seek(0)
        self._file.write(_line(LedgerCount(held, self._lost)))


@contextmanager
def counting(ledger: Path, held: WrittenCounts) -> Iterator[Counter]:
    """Yield a ledger's counter, set to the rows that the ledger holds; make it if it is missing."""
    lost = read_counter(ledger).lost
    if not _beside(ledger).exists():
        write_counter(ledger, LedgerCount(held))
    with _beside(ledger).open("r+b", buffering=0) as file:
        counter = Counter(file, lost)
        counter.write(held)
        yield counter


def write_counter(ledger: Path, count: LedgerCount) -> None:
    """Write a counter beside a ledger, atomically, also over an old one."""
    path = _beside(ledger)
    partial = path.with_name(f".{path.name}.new")
    with partial.open("wb") as file:
        file.write(_line(count))
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)


def _beside(ledger: Path) -> Path:
    return ledger.with_name(ledger.name + SUFFIX)


def is_alone(ledger: Path) -> bool:
    """Return whether a ledger lacks its counter: it is a copy of the file alone.

    eyechart's own copies, as in a bundle, have another kind of journal and need no counter.
    """
    if _beside(ledger).exists():
        return False
    try:
        with ledger.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return False
    return head[_JOURNAL : _JOURNAL + 2] == _LOG and int.from_bytes(head[_FORMAT : _FORMAT + 4]) >= _COUNTED_SINCE


def _line(count: LedgerCount) -> bytes:
    (requests, replies), lost = count
    said = f'{{"requests": {requests}, "replies": {replies}, "lost": [{lost[0]}, {lost[1]}], "crc32": '
    return f"{said}{zlib.crc32(said.encode())}}}".encode().ljust(_LENGTH - 1) + b"\n"


def _read(line: bytes) -> LedgerCount | None:
    try:
        said = json.loads(line[:_LENGTH])
        count = LedgerCount(WrittenCounts(said["requests"], said["replies"]), WrittenCounts(*said["lost"]))
    except (ValueError, LookupError, TypeError, RecursionError):
        return None
    plain = all(type(one) is int and 0 <= one < _MOST for one in (*count.expected, *count.lost))
    return count if plain and line == _line(count) else None
