"""The ledger: opened to append or to read."""

import os
import sqlite3
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from eyechart.calls import UNFINISHED, CallKey, DecisionReader, Reply
from eyechart.errors import LedgerError, MissingCallsWarning, counted, is_full, printable, why
from eyechart.ledger.columns import Attempts, UnsoundError, read_columns
from eyechart.ledger.counter import NOTHING, LedgerCount, WrittenCounts, counting, is_alone, read_counter, write_counter
from eyechart.ledger.rows import (
    AGAIN,
    KEY,
    KEY_IS,
    KEY_OF_CALL,
    OF_KEY,
    REPLY,
    REPLY_OF,
    REPORTED,
    UNKNOWN,
    Attempt,
    SentAttempt,
    checksum,
    now,
    row_of,
)
from eyechart.ledger.schema import (
    APPENDED,
    MIGRATION,
    OLDER,
    SCHEMAS,
    VERSION,
    damaged,
    format_of,
    is_bare,
    require_sound,
    require_whole,
)
from eyechart.ledger.snapshot import connect, open_copy

_ADD_CALL = f"INSERT OR IGNORE INTO calls ({KEY}) VALUES (?, ?, ?, ?, ?, ?)"
_LAST_ATTEMPT = (
    f"SELECT c.id, a.number, CASE WHEN r.final = 1 THEN '{AGAIN}' ELSE coalesce(r.error, '{UNKNOWN}') END, "
    "EXISTS (SELECT 1 FROM replies f WHERE f.call = c.id AND f.final = 1) "
    "FROM calls c LEFT JOIN attempts a ON a.call = c.id LEFT JOIN replies r ON r.attempt = a.id "
    f"WHERE {KEY_IS} ORDER BY a.number DESC LIMIT 1"
)
_ADD_REPLY = (
    f"INSERT INTO replies (attempt, call, final, closed_at, {', '.join(REPLY)}, row_sha256) "
    f"VALUES ({', '.join('?' * (5 + len(REPLY)))})"
)
_ADD_ATTEMPT = "INSERT INTO attempts (call, number, reason, request_sha256, sent_at) VALUES (?, ?, ?, ?, ?)"
_COPY_ATTEMPTS = f"""
INSERT INTO attempts (id, call, number, reason, request_sha256, sent_at)
SELECT ?, id, ? + coalesce((SELECT max(number) FROM attempts b WHERE b.call = calls.id AND b.id <= ?), 0), ?, ?, ?
FROM calls WHERE {KEY_IS}
"""
_COPY_REPLIES = _ADD_REPLY.replace("VALUES (?, ?", "VALUES (?, (SELECT call FROM attempts WHERE id = ?)")
_EVERY_ATTEMPT = (
    f"SELECT a.id, a.number, a.reason, a.request_sha256, a.sent_at, {KEY_OF_CALL} "
    "FROM attempts a JOIN calls c ON c.id = a.call ORDER BY a.id"
)
_EVERY_CHECKED = (
    f"SELECT r.attempt, r.row_sha256, {KEY_OF_CALL}, a.reason, a.request_sha256, a.sent_at, r.final, r.closed_at, "
    f"{REPLY_OF} FROM replies r JOIN attempts a ON a.id = r.attempt JOIN calls c ON c.id = a.call ORDER BY r.attempt"
)
_SAID = "r.text, r.finish_reason, r.error, r.error_detail"
"""The first fields of a reply: what it says, and how it ended."""
_BESIDE = "run.json"
"""A file that the run writes beside its ledger, before it."""
_ASKED = OF_KEY + 3
"""Number of columns in a checksum before those of the reply."""
_TAKEN: set[str] = set()
"""Digests of files that are sound or accepted as they are; they are not checked again."""
_INDEXED: set[str] = set()
"""Digests of files whose indexes were compared with their tables: `Ledger.columns` reads none."""
_REQUEST, _REPLY = WrittenCounts(1, 0), WrittenCounts(0, 1)


class Ledger:
    """One run's ledger; a write is committed when its method returns.

    A killed process therefore loses no write. Writes inside ``together`` are committed at its end.
    Use it as a context manager.

    Without ``create`` it only reads a copy of the file, whatever the format and while another
    process writes. With ``create`` a ledger of format 2 is migrated to format 3, and a copy of the
    old one stays beside it. ``sound`` false opens one with damaged replies, which ``damaged`` then
    names; only damage to the database is an error. ``absent`` takes a missing file as an empty
    ledger, for a run without calls.

    ``missing`` counts the rows that were written but are not there, by the counter: the log was
    lost, or an older copy replaced the file. A reader gets a warning unless it is ``accepting`` the
    loss. Nothing is appended before the loss is accepted.

    Raises LedgerError if the file is missing (without ``create``), is empty, is no plain ledger, or
    is damaged; always before anything is appended.
    """

    _digest: str | None = None
    """That of the copy that is read; None for a file that is read in place."""

    def __init__(
        self, path: Path, *, create: bool = False, absent: bool = False, sound: bool = True, accepting: bool = False
    ) -> None:
        if not (create or absent or path.is_file()):
            why_none = f"is {path.parent} a run? 'eyechart run' makes one"
            if path.with_name(_BESIDE).is_file():
                why_none = "its run made no call yet, or it is lost; the command that began the run makes its calls"
            raise LedgerError(f"{path} does not exist: {why_none}")
        self.path = path
        self._pending = self._held = NOTHING
        self._alone = is_alone(path)
        try:
            with ExitStack() as opening:
                self._sql = self._append(opening) if create else self._read(opening, sound=sound)
                self._opened = opening.pop_all()
        except (sqlite3.Error, UnicodeError) as error:  # UnicodeError: from a message of SQLite
            if is_full(error):
                raise LedgerError(f"{path} cannot be opened: {why(error)}; make room and try again") from error
            raise LedgerError(f"{path} is no ledger: {printable(str(error))}") from error
        except OSError as error:
            raise LedgerError(f"{path} cannot be read: {why(error)}") from error
        try:
            self._warn(accepting=accepting)
        except MissingCallsWarning:  # where warnings are errors, close everything
            self._opened.close()
            raise

    def _warn(self, *, accepting: bool) -> None:
        """Warn if calls are missing, or if that is unknown."""
        if any(self.missing) and not accepting:
            warnings.warn(self._missing_words(), MissingCallsWarning, stacklevel=4)
        elif self._alone:
            warnings.warn(
                f"{self.path} is without its counter, so missing calls cannot be noticed: if you copied it, "
                f"copy {self.path.name}.counter and {self.path.name}-wal too",
                MissingCallsWarning,
                stacklevel=4,
            )

    def _read(self, opening: ExitStack, *, sound: bool) -> sqlite3.Connection:
        """Open a copy and check it; a digest that is known to be sound is not checked again."""
        if not self.path.is_file():
            sql = opening.enter_context(closing(sqlite3.connect(":memory:", isolation_level=None)))
            sql.executescript(SCHEMAS[VERSION])
            self.missing, self._digest, self._format = NOTHING, None, VERSION
            return sql
        counted = read_counter(self.path)  # before the copy, which then holds at least as much
        sql, self._digest = open_copy(self.path, opening)
        opening.callback(sql.close)
        self._format = format_of(sql, self.path)
        sql.executescript(OLDER.get(self._format, ""))
        self._check(sql, sound=sound)
        self.missing = counted.expected.without(_counted(sql))
        return sql

    def _check(self, sql: sqlite3.Connection, *, sound: bool) -> None:
        """Check the whole copy, or its tables as a database; what was checked before is not again."""
        known = self._digest in _TAKEN
        if not known and not sound:
            require_whole(sql, self.path, indexes=False)
        elif not known:
            require_sound(sql, self.path)
            self.take()
        elif sound and self._digest not in _INDEXED:
            require_whole(sql, self.path)
        if sound and self._digest is not None:
            _INDEXED.add(self._digest)

    def _append(self, opening: ExitStack) -> sqlite3.Connection:
        """Open the file itself, after a check of a copy; make it if it is missing."""
        if self.path.exists():
            with ExitStack() as looking:
                self._read(looking, sound=True)
        else:
            self.missing = read_counter(self.path).expected
        if any(self.missing):
            raise LedgerError(f"{self._missing_words()}, or continue without them with --accept-loss")
        if not self.path.exists():
            self._make()
        sql = connect(self.path, "mode=rw")
        opening.callback(sql.close)
        for pragma in ("journal_mode = WAL", "synchronous = NORMAL", "foreign_keys = ON"):
            sql.execute(f"PRAGMA {pragma}")
        if self._format < VERSION:
            self._migrate(sql)
        self._held = _counted(sql)
        self._counter = opening.enter_context(counting(self.path, self._held))
        return sql

    def _make(self) -> None:
        """Make an empty ledger atomically, with its schema."""
        partial = self.path.with_name(f".{self.path.name}.new")
        for one in (partial, partial.with_name(f"{partial.name}-wal")):  # left by a run killed here
            one.unlink(missing_ok=True)
        with closing(connect(partial, "mode=rwc")) as sql:
            sql.execute("PRAGMA journal_mode = WAL")
            sql.executescript(f"BEGIN; {SCHEMAS[VERSION]} COMMIT;")
        partial.replace(self.path)
        self._format = VERSION

    def _migrate(self, sql: sqlite3.Connection) -> None:
        """Migrate the ledger to today's format in one transaction, after a backup."""
        if self._format not in APPENDED:
            raise LedgerError(
                f"{self.path} is a ledger of format {self._format}, which can be read but not appended to: "
                "start a new run with another --out"
            )
        kept = self.path.with_name(f"{self.path.name}.format{self._format}.bak")
        partial = kept.with_name(f".{kept.name}")
        partial.unlink(missing_ok=True)
        sql.execute("VACUUM INTO ?", (str(partial),))
        with partial.open("rb+") as file:
            os.fsync(file.fileno())
        partial.replace(kept)
        sql.executescript(f"BEGIN IMMEDIATE; {MIGRATION} COMMIT;")
        self._format = VERSION

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._opened.close()

    @contextmanager
    def together(self) -> Iterator[None]:
        """Commit all writes of the block together, or none if one fails."""
        self._sql.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._sql.execute("COMMIT")
        except BaseException:
            if self._sql.in_transaction:  # SQLite rolls back itself, for example on a full disk
                self._sql.execute("ROLLBACK")
            with suppress(sqlite3.Error):  # an interrupt may come after the commit
                self._held, self._pending = _counted(self._sql), NOTHING
            raise
        self._count(NOTHING)

    def _count(self, rows: WrittenCounts) -> None:
        """Count written rows; the counter is updated once they are committed."""
        self._pending = self._pending.plus(rows)
        if not self._sql.in_transaction:
            self._held, self._pending = self._held.plus(self._pending), NOTHING
            self._counter.write(self._held)

    def held(self) -> WrittenCounts:
        """Return the numbers of requests and replies in the ledger."""
        return _counted(self._sql)

    def _missing_words(self) -> str:
        return (
            f"{self.missing.words} that were written to {self.path} are missing: its log {self.path.name}-wal "
            "was lost, or an older copy replaced the file; restore it"
        )

    def begin(self, key: CallKey, request_sha256: str, *, again: bool = False) -> Attempt:
        """Record that an attempt at a call is about to be sent.

        Raises LedgerError if the call is finished: it must not be paid for twice. With ``again`` it
        is allowed; the call's last final reply then counts, and earlier ones stay.
        """
        sql = self._sql
        added = sql.execute(_ADD_CALL, key)
        number, reason = 1, None
        if added.rowcount:
            call = int(added.lastrowid or 0)
        else:
            call, before, reason, finished = sql.execute(_LAST_ATTEMPT, key).fetchone()
            if finished and not again:
                raise LedgerError(f"the call {key} is finished already")
            number = (before or 0) + 1
            reason = reason if before else None
        sent_at = now()
        added = sql.execute(_ADD_ATTEMPT, (call, number, reason, request_sha256, sent_at))
        self._count(_REQUEST)
        return Attempt(int(added.lastrowid or 0), call, number, reason, key, request_sha256, sent_at)

    def close(self, attempt: Attempt, reply: Reply, *, silence: bool = False) -> None:
        """Record an attempt's reply.

        An error that may pass or can be fixed leaves the call unfinished. With ``silence`` such an
        error finishes the call: it counts as no answer, and is not retried.
        """
        row = row_of(reply, final=silence or reply.error not in UNFINISHED)
        digest = checksum((*attempt.key, attempt.reason, attempt.request_sha256, attempt.sent_at, *row))
        self._sql.execute(_ADD_REPLY, (attempt.id, attempt.call, *row, digest))
        self._count(_REPLY)

    def finished(self) -> set[CallKey]:
        """Return the keys of every finished call."""
        rows = self._sql.execute(f"SELECT {KEY} FROM calls JOIN replies ON call = calls.id WHERE final = 1")
        return {CallKey(*row) for row in rows}

    def unknown(self) -> set[CallKey]:
        """Return the keys of unfinished calls with an attempt of unknown outcome."""
        rows = self._sql.execute(
            f"SELECT {KEY} FROM calls WHERE id IN "
            "(SELECT call FROM attempts WHERE id NOT IN (SELECT attempt FROM replies)) "
            "AND id NOT IN (SELECT call FROM replies WHERE final = 1)"
        )
        return {CallKey(*row) for row in rows}

    def models(self) -> list[str]:
        """Return the models with calls, sorted by name."""
        return [name for (name,) in self._sql.execute("SELECT DISTINCT model FROM calls ORDER BY model")]

    def began(self) -> str:
        """Return when the first attempt was sent, in UTC; empty if there is none."""
        (first,) = self._sql.execute("SELECT min(sent_at) FROM attempts").fetchone()
        return first or ""

    def replies(self, model: str, *, whole: bool = True) -> Iterator[tuple[CallKey, Reply]]:
        """Yield each call of a model with its last final reply, or else its last failure.

        A reply that is not ``whole`` has its text, its end and its error alone; many are read faster.
        """
        rows = self._sql.execute(
            f"SELECT {KEY_OF_CALL}, {REPORTED if whole else _SAID} FROM calls c JOIN replies r ON r.attempt = coalesce("
            "(SELECT max(attempt) FROM replies f WHERE f.call = c.id AND f.final = 1), "
            "(SELECT max(attempt) FROM replies f WHERE f.call = c.id)) WHERE model = ?",
            (model,),
        )
        for row in rows:
            yield CallKey(*row[:OF_KEY]), Reply(*row[OF_KEY:])

    def attempts(self, model: str) -> Iterator[SentAttempt]:
        """Yield every attempt at a model's calls in the order of sending, with its reply."""
        rows = self._sql.execute(
            f"SELECT {KEY_OF_CALL}, a.number, a.reason, a.request_sha256, a.sent_at, r.final, {REPORTED} "
            "FROM attempts a JOIN calls c ON c.id = a.call "
            "LEFT JOIN replies r ON r.attempt = a.id WHERE c.model = ? ORDER BY a.id",
            (model,),
        )
        for row in rows:
            number, reason, digest, sent_at, came = row[OF_KEY : OF_KEY + 5]
            reply = None if came is None else Reply(*row[OF_KEY + 5 :])
            yield SentAttempt(CallKey(*row[:OF_KEY]), number, reason, reply, digest, bool(came), sent_at)

    def columns(self, read: DecisionReader | None = None, *, by_frame: bool = True) -> Attempts:
        """Return every attempt as columns, in one pass that also checks the rows if nothing has.

        ``read`` reads the decision of a reply, or none is read; ``by_frame`` says that it depends on
        the frame.
        Raises LedgerError where a row is damaged.
        """
        check, decode = self._digest not in _TAKEN, self._sql.text_factory
        self._sql.text_factory = str  # twice as fast, and fails at text that only damage makes
        try:
            with suppress(UnsoundError, sqlite3.OperationalError):
                found = read_columns(self._sql, read, by_frame=by_frame, check=check)
                self.take()
                return found
        finally:
            self._sql.text_factory = decode
        if check:
            require_sound(self._sql, self.path)
            self.take()
        return read_columns(self._sql, read, by_frame=by_frame, check=False)

    def take(self) -> None:
        """Accept this file's content, although damaged, for every later read."""
        if self._digest is not None:
            _TAKEN.add(self._digest)

    def damaged(self) -> list[str]:
        """Return in words the rows that differ from what was written, as checksums show."""
        require_whole(self._sql, self.path)
        return list(damaged(self._sql))

    def unchecked(self) -> int:
        """Return the number of replies without a checksum, which are older than format 3."""
        (count,) = self._sql.execute("SELECT count(*) FROM replies WHERE row_sha256 IS NULL").fetchone()
        return int(count)

    def copy_to(self, path: Path) -> None:
        """Write a copy of the ledger, even while a run appends; equal rows give equal bytes."""
        older = OLDER.get(self._format, "")
        for view in ("replies", "attempts") if older else ():  # SQLite would copy them as tables
            self._sql.execute(f"DROP VIEW IF EXISTS temp.{view}")
        self._sql.execute("VACUUM INTO ?", (str(path),))
        self._sql.executescript(older)

    def absorb(self, other: "Ledger") -> int:
        """Copy every call of another ledger into this one; return the number of new calls.

        Attempts and replies are included; a reply without a checksum gets one. Raises LedgerError,
        and copies nothing, if a call is finished in both.
        """
        if twice := self.finished() & other.finished():
            raise LedgerError(
                f"{other.path}: {counted(len(twice), 'call', 'are')} finished in both ledgers, first {min(twice)}"
            )
        with self.together():
            (base,) = self._sql.execute("SELECT coalesce(max(id), 0) FROM attempts").fetchone()
            new = self._sql.executemany(_ADD_CALL, other._sql.execute(f"SELECT {KEY} FROM calls")).rowcount  # noqa: SLF001
            attempts, replies = map(other._sql.execute, (_EVERY_ATTEMPT, _EVERY_CHECKED))  # noqa: SLF001
            self._sql.executemany(_COPY_ATTEMPTS, ((id_ + base, number, base, *row) for id_, number, *row in attempts))
            rows = ((id_ + base, *row[_ASKED:], digest or checksum(row)) for id_, digest, *row in replies)
            self._sql.executemany(_COPY_REPLIES, ((row[0], *row) for row in rows))
            self._count(_counted(other._sql))  # noqa: SLF001
        return new


def _counted(sql: sqlite3.Connection) -> WrittenCounts:
    return WrittenCounts(
        *(sql.execute(f"SELECT count(*) FROM {name}").fetchone()[0] for name in ("attempts", "replies"))
    )


def accept_loss(path: Path) -> WrittenCounts:
    """Accept that written rows of a ledger are missing; return how many.

    A ledger that is absent or holds no table has lost all rows; its remains get another name, and a
    run makes a new one. No other process may write to it meanwhile. Raises LedgerError if it is
    damaged.
    """
    count, held, empty = read_counter(path), NOTHING, not path.exists() or is_bare(path)
    if not empty:
        with Ledger(path, accepting=True) as ledger:
            held = ledger.held()
    lost = count.expected.without(held)
    if empty:
        _set_aside(path)
    if any(lost):
        write_counter(path, LedgerCount(held, count.lost.plus(lost)))
    return lost


def _set_aside(path: Path) -> None:
    """Rename the remains of a ledger, and its log, which SQLite would take for a new ledger's."""
    for one in (path, path.with_name(f"{path.name}-wal")):
        if one.exists():
            kept = one.with_name(f"{one.name}.lost.bak")
            if kept.exists() and kept.stat().st_size:
                raise LedgerError(f"{kept} exists, but the remains of the ledger need this name: rename it")
            one.replace(kept)
    path.with_name(f"{path.name}-shm").unlink(missing_ok=True)
