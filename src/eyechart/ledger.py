"""The ledger is the durable, append-only record of calls: an SQLite file that any SQLite browser opens.

An attempt is a row in ``attempts``, written before it is sent, and a row in ``replies``, written when it is
over; an attempt without a reply was sent with its outcome unknown. Rows are never changed or removed.
"""

import datetime as dt
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, fields
from operator import attrgetter
from pathlib import Path
from types import TracebackType
from typing import Self

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
_APPEND_ONLY = "".join(
    f"CREATE TRIGGER IF NOT EXISTS {table}_{verb} BEFORE {verb} ON {table} "
    "BEGIN SELECT RAISE(ABORT, 'the ledger is append-only'); END;\n"
    for table in ("calls", "attempts", "replies")
    for verb in ("UPDATE", "DELETE")
)
_OBJECTS = "SELECT type, name, sql FROM sqlite_master"
_VERSION = 2
_KEY = ", ".join(field.name for field in fields(CallKey))
_KEY_IS = " AND ".join(f"{field.name} = ?" for field in fields(CallKey))
_REPLY = tuple(field.name for field in fields(Reply))
_REPLY_NAMES = ", ".join(_REPLY)
_key_values = attrgetter(*(field.name for field in fields(CallKey)))
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
    f"INSERT INTO replies (attempt, call, final, closed_at, {_REPLY_NAMES}) "
    f"VALUES ({', '.join('?' * (4 + len(_REPLY)))})"
)
_ADD_ATTEMPT = "INSERT INTO attempts (call, number, reason, request_sha256, sent_at) VALUES (?, ?, ?, ?, ?)"
_COPY_ATTEMPTS = f"""
INSERT INTO attempts (id, call, number, reason, request_sha256, sent_at)
SELECT a.id + ?, mine.id,
       a.number + coalesce((SELECT max(number) FROM main.attempts b WHERE b.call = mine.id), 0),
       a.reason, a.request_sha256, a.sent_at
FROM other.attempts a JOIN other.calls theirs ON theirs.id = a.call JOIN main.calls mine USING ({_KEY})
"""
_COPY_REPLIES = f"""
INSERT INTO replies (attempt, call, final, closed_at, {_REPLY_NAMES})
SELECT r.attempt + ?, mine.id, r.final, r.closed_at, {", ".join(f"r.{name}" for name in _REPLY)}
FROM other.replies r JOIN other.calls theirs ON theirs.id = r.call JOIN main.calls mine USING ({_KEY})
"""


@dataclass(frozen=True, slots=True)
class Attempt:
    """An attempt that was written and not yet closed: row ids of the attempt and of its call.

    ``reason`` says why it is made where it is not the first: the error of the attempt before it, or ``UNKNOWN``.
    """

    id: int
    call: int
    number: int
    reason: str | None


@dataclass(frozen=True, slots=True)
class Sent:
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

    Without ``create`` it is opened to be read only, also from a medium that cannot be written. Use as a context
    manager. Raises LedgerError where the file is missing (unless ``create``) or no ledger.
    """

    def __init__(self, path: Path, *, create: bool = False) -> None:
        if not create and not path.is_file():
            raise LedgerError(f"{path} does not exist: is {path.parent} a run? 'eyechart run battery' makes one")
        self.path = path
        try:
            self._sql = _connect(path, "mode=rwc" if create else "mode=ro")
            try:
                self._prepare(create=create)
            except BaseException:
                self._sql.close()
                raise
        except sqlite3.DatabaseError as error:
            raise LedgerError(f"{path} is no ledger: {error}") from error

    def _prepare(self, *, create: bool) -> None:
        try:
            (version,) = self._sql.execute("PRAGMA user_version").fetchone()
        except sqlite3.OperationalError:
            if create or self.path.with_name(f"{self.path.name}-wal").exists():
                raise
            self._sql.close()  # a medium that cannot be written bears no WAL index, and needs none: nobody writes
            self._sql = _connect(self.path, "immutable=1")
            (version,) = self._sql.execute("PRAGMA user_version").fetchone()
        (tables,) = self._sql.execute("SELECT count(*) FROM sqlite_master").fetchone()
        new = version == 0 and tables == 0  # also what a run leaves that was killed while it made its ledger
        if not new and version != _VERSION:  # before the first write: it may be somebody else's database
            raise LedgerError(
                f"{self.path} is a ledger of format {version}; this eyechart reads format {_VERSION}: "
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
            self._sql.executescript(f"BEGIN; {_SCHEMA} {_APPEND_ONLY} PRAGMA user_version = {_VERSION}; COMMIT;")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._sql.close()

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
        added = sql.execute(_ADD_CALL, _key_values(key))
        number, reason = 1, None
        if added.rowcount:
            call = int(added.lastrowid or 0)
        else:
            call, before, reason, finished = sql.execute(_LAST_ATTEMPT, _key_values(key)).fetchone()
            if finished:
                raise LedgerError(f"the call {key} is finished already")
            number = (before or 0) + 1
            reason = reason if before else None
        added = sql.execute(_ADD_ATTEMPT, (call, number, reason, request_sha256, _now()))
        return Attempt(id=int(added.lastrowid or 0), call=call, number=number, reason=reason)

    def close(self, attempt: Attempt, reply: Reply, *, silence: bool = False) -> None:
        """Record what came back. An error that may pass, or that somebody can mend, leaves the call unfinished.

        With ``silence`` such an error finishes it too: the model said nothing, and is not asked again.
        """
        final = silence or reply.error not in UNFINISHED
        came = [_storable(value) if isinstance(value, str) else value for value in _reply_values(reply)]
        self._sql.execute(_ADD_REPLY, (attempt.id, attempt.call, int(final), _now(), *came))

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
        """Yield each call of a model that has a reply: its final one, or its last failure while it has none."""
        names = ", ".join(f"r.{name}" for name in _REPLY)
        rows = self._sql.execute(
            f"SELECT {_KEY}, {names} FROM calls JOIN replies r ON r.call = calls.id "
            "WHERE model = ? AND (final = 1 OR (attempt = (SELECT max(attempt) FROM replies l WHERE l.call = r.call) "
            "AND NOT EXISTS (SELECT 1 FROM replies f WHERE f.call = r.call AND f.final = 1)))",
            (model,),
        )
        split = len(fields(CallKey))
        for row in rows:
            yield CallKey(*row[:split]), Reply(*row[split:])

    def attempts(self, model: str) -> Iterator[Sent]:
        """Yield every attempt at a model's calls in the order of sending, with what came back."""
        names = ", ".join(f"r.{name}" for name in _REPLY)
        calls = ", ".join(f"c.{field.name}" for field in fields(CallKey))
        rows = self._sql.execute(
            f"SELECT {calls}, a.number, a.reason, a.request_sha256, r.final, {names} "
            "FROM attempts a JOIN calls c ON c.id = a.call "
            "LEFT JOIN replies r ON r.attempt = a.id WHERE c.model = ? ORDER BY a.id",
            (model,),
        )
        split = len(fields(CallKey))
        for row in rows:
            number, reason, digest, came = row[split : split + 4]
            reply = None if came is None else Reply(*row[split + 4 :])
            yield Sent(CallKey(*row[:split]), number, reason, reply, digest, bool(came))

    def copy_to(self, path: Path) -> None:
        """Write a copy of the ledger as it stands, also while a run appends; the same rows give the same bytes."""
        self._sql.execute("VACUUM INTO ?", (str(path),))

    def require_plain(self) -> None:
        """Raise LedgerError where a file that came from elsewhere is damaged, or holds more than a ledger's tables."""
        try:
            with closing(sqlite3.connect(":memory:")) as own:
                own.executescript(f"{_SCHEMA} {_APPEND_ONLY}")
                expected = set(own.execute(_OBJECTS))
            found = set(self._sql.execute(_OBJECTS))
            (said,) = self._sql.execute("PRAGMA integrity_check(1)").fetchone()
        except sqlite3.Error as error:
            raise LedgerError(f"{self.path} is damaged: {error}") from error
        if found != expected:
            strange = sorted(str(name) for _, name, _ in found ^ expected)
            raise LedgerError(f"{self.path} is no plain ledger: {', '.join(strange[:3])} of its schema differ")
        if said != "ok":
            raise LedgerError(f"{self.path} is damaged: {said}")

    def absorb(self, other: "Ledger") -> int:
        """Copy every call of another ledger into this one, attempts and replies included; return how many are new.

        Raises LedgerError, and copies nothing, where a call was finished in both.
        """
        if twice := self.finished() & other.finished():
            raise LedgerError(f"{other.path}: {len(twice)} calls are finished in both ledgers, first {min(twice)}")
        self._sql.execute("ATTACH ? AS other", (str(other.path),))
        self._sql.execute("BEGIN IMMEDIATE")
        try:
            (base,) = self._sql.execute("SELECT coalesce(max(id), 0) FROM attempts").fetchone()
            new = self._sql.execute(f"INSERT OR IGNORE INTO calls ({_KEY}) SELECT {_KEY} FROM other.calls").rowcount
            self._sql.execute(_COPY_ATTEMPTS, (base,))
            self._sql.execute(_COPY_REPLIES, (base,))
            self._sql.execute("COMMIT")
        except BaseException:
            self._sql.execute("ROLLBACK")
            raise
        finally:
            self._sql.execute("DETACH other")
        return new


def _storable(text: str) -> str:
    """Return the text with a lone surrogate, which is no Unicode and no file can hold, written as its escape."""
    return text.encode("utf-8", "backslashreplace").decode()


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    # Autocommit: each INSERT is its own durable transaction.
    return sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", isolation_level=None, uri=True)


def _now() -> str:
    return dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds")
