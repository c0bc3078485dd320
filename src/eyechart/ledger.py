"""The ledger is the durable, append-only record of calls: an SQLite file that any SQLite browser opens.

An attempt is a row in ``attempts``, written before it is sent, and a row in ``replies``, written when it is
over; an attempt without a reply was sent with its outcome unknown. Rows are never changed or removed. Of several
final replies of a call the last one counts.
"""

import datetime as dt
import hashlib
import os
import shutil
import sqlite3
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import fields
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from msgspec import msgpack

from eyechart.calls import UNFINISHED, CallKey, Reply
from eyechart.errors import LedgerError

_SCHEMA = """
CREATE TABLE IF NOT EXISTS calls (
    id INTEGER PRIMARY KEY,
    study TEXT NOT NULL, model TEXT NOT NULL, prompt TEXT NOT NULL,
    frame TEXT NOT NULL, condition TEXT NOT NULL, repeat INTEGER NOT NULL,
    UNIQUE (study, model, prompt, frame, condition, repeat)
) STRICT;
CREATE TABLE IF NOT EXISTS attempts (
    id INTEGER PRIMARY KEY,
    call INTEGER NOT NULL REFERENCES calls (id),
    number INTEGER NOT NULL, reason TEXT, request_sha256 TEXT NOT NULL, sent_at TEXT NOT NULL,
    UNIQUE (call, number)
) STRICT;
CREATE TABLE IF NOT EXISTS replies (
    attempt INTEGER PRIMARY KEY REFERENCES attempts (id),
    call INTEGER NOT NULL REFERENCES calls (id),
    final INTEGER NOT NULL, closed_at TEXT NOT NULL,
    text TEXT NOT NULL, finish_reason TEXT, error TEXT, error_detail TEXT NOT NULL,
    prompt_tokens INTEGER, completion_tokens INTEGER, seconds REAL,
    reasoning TEXT NOT NULL, reasoning_tokens INTEGER, first_byte_s REAL, status INTEGER, retry_after_s REAL,
    served TEXT, provider TEXT, cost_usd REAL, energy_j REAL
) STRICT;
CREATE UNIQUE INDEX IF NOT EXISTS one_final_reply_a_call ON replies (call) WHERE final = 1;
CREATE INDEX IF NOT EXISTS replies_of_a_call ON replies (call);
"""
_MIGRATION = """
ALTER TABLE replies ADD COLUMN system_fingerprint TEXT;
ALTER TABLE replies ADD COLUMN payload_bytes INTEGER;
ALTER TABLE replies ADD COLUMN payload_sha256 TEXT;
ALTER TABLE replies ADD COLUMN row_sha256 TEXT;
DROP INDEX one_final_reply_a_call;
CREATE INDEX final_replies ON replies (call) WHERE final = 1;
PRAGMA user_version = 3;
"""
"""From format 2, which 0.1.0 writes, to 3; a new ledger takes the same way, so that both have one schema."""
_APPEND_ONLY = "".join(
    f"CREATE TRIGGER IF NOT EXISTS {table}_{verb} BEFORE {verb} ON {table} "
    "BEGIN SELECT RAISE(ABORT, 'the ledger is append-only'); END;\n"
    for table in ("calls", "attempts", "replies")
    for verb in ("UPDATE", "DELETE")
)
_SCHEMAS = {2: f"{_SCHEMA} {_APPEND_ONLY}", 3: f"{_SCHEMA} {_APPEND_ONLY} {_MIGRATION}"}
_OBJECTS = "SELECT type, name, sql FROM sqlite_master"
_VERSION = 3
SINCE_FORMAT_3 = ("system_fingerprint", "payload_bytes", "payload_sha256")
"""The fields of a Reply that an older ledger does not hold."""
_ADDED_BY_3 = ", ".join(f"NULL AS {name}" for name in (*SINCE_FORMAT_3, "row_sha256"))
_ADDED_BY_2 = (
    "'' AS reasoning, NULL AS reasoning_tokens, NULL AS first_byte_s, NULL AS status, NULL AS retry_after_s, "
    "NULL AS served, NULL AS provider, NULL AS cost_usd, NULL AS energy_j"
)
_OLDER: Mapping[int, str] = {
    2: f"CREATE TEMP VIEW replies AS SELECT *, {_ADDED_BY_3} FROM main.replies;",
    1: f"CREATE TEMP VIEW replies AS SELECT *, {_ADDED_BY_2}, {_ADDED_BY_3} FROM main.replies;"
    "CREATE TEMP VIEW attempts AS SELECT *, NULL AS reason FROM main.attempts;",
}
"""How an older format is read: by views that stand before its tables and hold None for what it does not know."""
_KEY = ", ".join(CallKey._fields)
_KEY_OF_CALL = ", ".join(f"c.{name}" for name in CallKey._fields)
_KEY_IS = " AND ".join(f"{name} = ?" for name in CallKey._fields)
_SPLIT = len(CallKey._fields)
_REPLY = tuple(field.name for field in fields(Reply))
_REPLY_OF = ", ".join(f"r.{name}" for name in _REPLY)
_reply_values = attrgetter(*_REPLY)
UNKNOWN = "unknown"
"""The reason of an attempt that repeats one whose outcome is unknown: it was sent, and the run was killed."""
_ADD_CALL = f"INSERT OR IGNORE INTO calls ({_KEY}) VALUES (?, ?, ?, ?, ?, ?)"
_LAST_ATTEMPT = (
    f"SELECT c.id, a.number, coalesce(r.error, '{UNKNOWN}'), "
    "EXISTS (SELECT 1 FROM replies f WHERE f.call = c.id AND f.final = 1) "
    "FROM calls c LEFT JOIN attempts a ON a.call = c.id LEFT JOIN replies r ON r.attempt = a.id "
    f"WHERE {_KEY_IS} ORDER BY a.number DESC LIMIT 1"
)
_ADD_REPLY = (
    f"INSERT INTO replies (attempt, call, final, closed_at, {', '.join(_REPLY)}, row_sha256) "
    f"VALUES ({', '.join('?' * (5 + len(_REPLY)))})"
)
_ADD_ATTEMPT = "INSERT INTO attempts (call, number, reason, request_sha256, sent_at) VALUES (?, ?, ?, ?, ?)"
_COPY_ATTEMPTS = f"""
INSERT INTO attempts (id, call, number, reason, request_sha256, sent_at)
SELECT ?, id, ? + coalesce((SELECT max(number) FROM attempts b WHERE b.call = calls.id AND b.id <= ?), 0), ?, ?, ?
FROM calls WHERE {_KEY_IS}
"""
_COPY_REPLIES = _ADD_REPLY.replace("VALUES (?, ?", "VALUES (?, (SELECT call FROM attempts WHERE id = ?)")
_EVERY_ATTEMPT = (
    f"SELECT a.id, a.number, a.reason, a.request_sha256, a.sent_at, {_KEY_OF_CALL} "
    "FROM attempts a JOIN calls c ON c.id = a.call ORDER BY a.id"
)
_EVERY_REPLY = f"SELECT r.attempt, r.final, r.closed_at, {_REPLY_OF}, r.row_sha256 FROM replies r ORDER BY r.attempt"
_CHECKED = (
    f"SELECT {_KEY_OF_CALL}, a.request_sha256, r.final, r.closed_at, {_REPLY_OF}, r.row_sha256 "
    "FROM replies r JOIN attempts a ON a.id = r.attempt JOIN calls c ON c.id = a.call"
)
_SNAPSHOTS = 20
"""Copies of a ledger that is written meanwhile, until one is whole; then it is read where it is, beside its writer."""


class Attempt(NamedTuple):
    """An attempt that was written and not yet closed: row ids of the attempt and of its call, and what was asked.

    ``reason`` says why it is made where it is not the first: the error of the attempt before it, or ``UNKNOWN``.
    """

    id: int
    call: int
    number: int
    reason: str | None
    key: CallKey
    request_sha256: str


class Sent(NamedTuple):
    """An attempt as it is read back: its call, its number, why it was made, and what came; None is "unknown".

    ``final`` says that what came finished the call.
    """

    key: CallKey
    number: int
    reason: str | None
    reply: Reply | None
    request_sha256: str = ""
    final: bool = False


class Ledger:
    """One run's ledger. Every write is committed before the method returns, so a killed process loses none.

    Writes inside ``together`` are committed at its end.

    Without ``create`` it is opened to be read only: a copy of the file as it stands, so that nothing is written beside
    it, whatever its format and whoever writes to it. With ``create`` a ledger of format 2 becomes one of format 3, with
    a copy of the old one beside it. Use as a context manager. Raises LedgerError where the file is missing (unless
    ``create``) or no ledger.
    """

    def __init__(self, path: Path, *, create: bool = False) -> None:
        if not create and not path.is_file():
            raise LedgerError(f"{path} does not exist: is {path.parent} a run? 'eyechart run battery' makes one")
        self.path = path
        try:
            with ExitStack() as opening:
                self._sql = _connect(path, "mode=rwc") if create else _read_copy(path, opening)
                opening.callback(lambda: self._sql.close())  # noqa: PLW0108 - it may be exchanged
                self._prepare(create=create)
                self._opened = opening.pop_all()
        except sqlite3.DatabaseError as error:
            raise LedgerError(f"{path} is no ledger: {error}") from error
        except OSError as error:
            raise LedgerError(f"{path} cannot be read: {error.strerror or error}") from error

    def _prepare(self, *, create: bool) -> None:
        (self._format,) = self._sql.execute("PRAGMA user_version").fetchone()
        (tables,) = self._sql.execute("SELECT count(*) FROM sqlite_master").fetchone()
        new = self._format == 0 and tables == 0  # also what a run leaves that was killed while it made its ledger
        if not new and not 1 <= self._format <= _VERSION:  # before the first write: it may be somebody else's database
            raise LedgerError(
                f"{self.path} is a ledger of format {self._format}; this eyechart reads formats 1 to {_VERSION}: "
                "use the eyechart that wrote it, or run anew with another --out"
            )
        if new and not create:
            self._sql.close()
            self._sql = sqlite3.connect(":memory:", isolation_level=None)
        if create:
            self._sql.execute("PRAGMA journal_mode = WAL")
            self._sql.execute("PRAGMA synchronous = NORMAL")
            self._sql.execute("PRAGMA foreign_keys = ON")
        if new:
            self._sql.executescript(f"BEGIN; {_SCHEMAS[_VERSION]} COMMIT;")
            self._format = _VERSION
        elif create and self._format < _VERSION:
            self._migrate()
        elif older := _OLDER.get(self._format):
            self._sql.executescript(older)

    def _migrate(self) -> None:
        """Bring the ledger to today's format in one transaction, once a copy of the old one stands beside it."""
        if self._format not in _SCHEMAS:
            raise LedgerError(
                f"{self.path} is a ledger of format {self._format}, which is read and not appended to any more: run "
                "anew with another --out"
            )
        self._require_schema()
        kept = self.path.with_name(f"{self.path.name}.format{self._format}.bak")
        partial = kept.with_name(f".{kept.name}")
        partial.unlink(missing_ok=True)
        self.copy_to(partial)
        with partial.open("rb+") as file:
            os.fsync(file.fileno())
        partial.replace(kept)
        self._sql.executescript(f"BEGIN IMMEDIATE; {_MIGRATION} COMMIT;")
        self._format = _VERSION

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._opened.close()

    @contextmanager
    def together(self) -> Iterator[None]:
        """Commit what is written inside as one: all of it, or none where one write fails."""
        self._sql.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._sql.execute("COMMIT")
        except BaseException:
            self._sql.execute("ROLLBACK")
            raise

    def begin(self, key: CallKey, request_sha256: str) -> Attempt:
        """Record that an attempt at a call is about to be sent.

        Raises LedgerError where the call is finished already: it must not be paid for twice.
        """
        sql = self._sql
        added = sql.execute(_ADD_CALL, key)
        number, reason = 1, None
        if added.rowcount:
            call = int(added.lastrowid or 0)
        else:
            call, before, reason, finished = sql.execute(_LAST_ATTEMPT, key).fetchone()
            if finished:
                raise LedgerError(f"the call {key} is finished already")
            number = (before or 0) + 1
            reason = reason if before else None
        added = sql.execute(_ADD_ATTEMPT, (call, number, reason, request_sha256, _now()))
        return Attempt(int(added.lastrowid or 0), call, number, reason, key, request_sha256)

    def close(self, attempt: Attempt, reply: Reply, *, silence: bool = False) -> None:
        """Record what came back. An error that may pass, or that somebody can mend, leaves the call unfinished.

        With ``silence`` such an error finishes it too: the model said nothing, and is not asked again.
        """
        final = int(silence or reply.error not in UNFINISHED)
        values = zip(_PUT, _reply_values(reply), strict=True)
        came = [one if one is None or (type(one) is str and one.isascii()) else put(one) for put, one in values]
        row = (final, _now(), *came)
        digest = _row_sha256((*attempt.key, attempt.request_sha256, *row))
        self._sql.execute(_ADD_REPLY, (attempt.id, attempt.call, *row, digest))

    def finished(self) -> set[CallKey]:
        """Return the keys of every finished call."""
        rows = self._sql.execute(f"SELECT {_KEY} FROM calls JOIN replies ON call = calls.id WHERE final = 1")
        return {CallKey(*row) for row in rows}

    def unknown(self) -> set[CallKey]:
        """Return the keys of unfinished calls with an attempt that was sent and whose outcome is unknown."""
        rows = self._sql.execute(
            f"SELECT {_KEY} FROM calls WHERE id IN "
            "(SELECT call FROM attempts WHERE id NOT IN (SELECT attempt FROM replies)) "
            "AND id NOT IN (SELECT call FROM replies WHERE final = 1)"
        )
        return {CallKey(*row) for row in rows}

    def models(self) -> list[str]:
        """Return the models that calls were begun of, by name."""
        return [name for (name,) in self._sql.execute("SELECT DISTINCT model FROM calls ORDER BY model")]

    def replies(self, model: str) -> Iterator[tuple[CallKey, Reply]]:
        """Yield each call of a model that has a reply: its last final one, or its last failure while it has none."""
        rows = self._sql.execute(
            f"SELECT {_KEY_OF_CALL}, {_REPLY_OF} FROM calls c JOIN replies r ON r.attempt = coalesce("
            "(SELECT max(attempt) FROM replies f WHERE f.call = c.id AND f.final = 1), "
            "(SELECT max(attempt) FROM replies f WHERE f.call = c.id)) WHERE model = ?",
            (model,),
        )
        for row in rows:
            yield CallKey(*row[:_SPLIT]), Reply(*row[_SPLIT:])

    def attempts(self, model: str) -> Iterator[Sent]:
        """Yield every attempt at a model's calls in the order of sending, with what came back."""
        rows = self._sql.execute(
            f"SELECT {_KEY_OF_CALL}, a.number, a.reason, a.request_sha256, r.final, {_REPLY_OF} "
            "FROM attempts a JOIN calls c ON c.id = a.call "
            "LEFT JOIN replies r ON r.attempt = a.id WHERE c.model = ? ORDER BY a.id",
            (model,),
        )
        for row in rows:
            number, reason, digest, came = row[_SPLIT : _SPLIT + 4]
            reply = None if came is None else Reply(*row[_SPLIT + 4 :])
            yield Sent(CallKey(*row[:_SPLIT]), number, reason, reply, digest, bool(came))

    def damaged(self) -> list[CallKey]:
        """Return the calls with a reply that is not what its checksum says; one without a checksum cannot say."""
        rows = self._sql.execute(f"{_CHECKED} WHERE r.row_sha256 IS NOT NULL ORDER BY r.attempt")
        return [CallKey(*row[:_SPLIT]) for row in rows if _row_sha256(row[:-1]) != row[-1]]

    def copy_to(self, path: Path) -> None:
        """Write a copy of the ledger as it stands, also while a run appends; the same rows give the same bytes."""
        self._sql.execute("VACUUM INTO ?", (str(path),))

    def require_plain(self) -> None:
        """Raise LedgerError where a file that came from elsewhere is damaged, or holds more than a ledger's tables."""
        self._require_schema()
        try:
            (said,) = self._sql.execute("PRAGMA integrity_check(1)").fetchone()
        except sqlite3.Error as error:
            raise LedgerError(f"{self.path} is damaged: {error}") from error
        if said != "ok":
            raise LedgerError(f"{self.path} is damaged: {said}")

    def _require_schema(self) -> None:
        with closing(sqlite3.connect(":memory:")) as own:
            own.executescript(_SCHEMAS.get(self._format, ""))
            expected = set(own.execute(_OBJECTS))
        try:
            found = set(self._sql.execute(_OBJECTS))
        except sqlite3.Error as error:
            raise LedgerError(f"{self.path} is damaged: {error}") from error
        if found != expected:
            strange = sorted(str(name) for _, name, _ in found ^ expected)
            raise LedgerError(f"{self.path} is no plain ledger: {', '.join(strange[:3])} of its schema differ")

    def absorb(self, other: "Ledger") -> int:
        """Copy every call of another ledger into this one, attempts and replies included; return how many are new.

        Raises LedgerError, and copies nothing, where a call was finished in both.
        """
        if twice := self.finished() & other.finished():
            raise LedgerError(f"{other.path}: {len(twice)} calls are finished in both ledgers, first {min(twice)}")
        with self.together():
            (base,) = self._sql.execute("SELECT coalesce(max(id), 0) FROM attempts").fetchone()
            new = self._sql.executemany(_ADD_CALL, other._sql.execute(f"SELECT {_KEY} FROM calls")).rowcount  # noqa: SLF001
            attempts, replies = map(other._sql.execute, (_EVERY_ATTEMPT, _EVERY_REPLY))  # noqa: SLF001
            self._sql.executemany(_COPY_ATTEMPTS, ((id_ + base, number, base, *row) for id_, number, *row in attempts))
            self._sql.executemany(_COPY_REPLIES, ((id_ + base, id_ + base, *row) for id_, *row in replies))
        return new


def damage(run: Path) -> Iterator[str]:
    """Yield in words, for every ledger in a run's folder, which replies are not what their checksums say."""
    for path in sorted(run.rglob("ledger.sqlite")):
        with Ledger(path) as ledger:
            if found := ledger.damaged():
                first = f"{found[0].model}'s to {found[0].frame} under {found[0].condition}"
                yield (
                    f"{len(found)} replies in {path} are not what their checksums say, first {first}; restore the "
                    "ledger from a copy"
                )


def _storable(text: str) -> str:
    """Return the text with a lone surrogate, which is no Unicode and no file can hold, written as its escape."""
    return text.encode("utf-8", "backslashreplace").decode()


def _real(number: float) -> float | None:
    """Return a number as SQLite gives it back: no sign of zero, and None for what is none."""
    return None if number != number else float(number) + 0.0  # noqa: PLR0124 - only NaN differs from itself


_PUT: tuple[Callable[[Any], object], ...] = tuple(
    _real if one.type == float | None else int if one.type == int | None else _storable for one in fields(Reply)
)
"""What makes of each field of a Reply the value that SQLite keeps, and gives back as it is."""
_pack = msgpack.Encoder(enc_hook=str).encode  # a text of a kind of its own is kept as text


def _row_sha256(values: tuple[object, ...]) -> str:
    """Return the SHA-256 of a reply's row as a msgpack array: its call's key, its request, and all but its row ids."""
    return hashlib.sha256(_pack(values)).hexdigest()


def _read_copy(path: Path, opened: ExitStack) -> sqlite3.Connection:
    """Open a copy of a ledger, taken with what its log holds that is not in it yet, so that nothing is written here.

    A copy is whole where the log was not begun anew meanwhile, as all that its writer moved into the file still stands
    in it; without a log, where the file did not change.
    """
    copy = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="eyechart-ledger-"))) / "ledger.sqlite"
    log = path.with_name(f"{path.name}-wal")
    for _ in range(_SNAPSHOTS):
        head, file = _head(log), path.stat()
        shutil.copyfile(path, copy)
        with suppress(FileNotFoundError):
            if head is not None:
                shutil.copyfile(log, copy.with_name(f"{copy.name}-wal"))
            now = path.stat()
            if _head(log) == head and (head or (file.st_mtime_ns, file.st_size) == (now.st_mtime_ns, now.st_size)):
                return _connect(copy, "immutable=1" if head is None else "mode=ro")
    return _connect(path, "mode=ro")


def _head(log: Path) -> bytes | None:
    """Return the head of a write-ahead log, which changes whenever it is begun anew; None where there is none."""
    try:
        with log.open("rb") as file:
            return file.read(32)
    except FileNotFoundError:
        return None


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    # Autocommit: each INSERT is its own durable transaction.
    return sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", isolation_level=None, uri=True)


def _now() -> str:
    second, millisecond = divmod(time.time_ns() // 1_000_000, 1000)
    return f"{_moment(second)}.{millisecond:03d}+00:00"


@lru_cache(maxsize=2)
def _moment(second: int) -> str:
    return dt.datetime.fromtimestamp(second, dt.UTC).isoformat()[:19]
