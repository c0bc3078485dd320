"""The schema of each ledger format; checks that a file has it, and holds what was written."""

import sqlite3
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, closing
from functools import cache
from pathlib import Path
from types import MappingProxyType

from eyechart.errors import LedgerError, printable
from eyechart.ledger.rows import KEY_OF_CALL, OF_KEY, REPLY, REPLY_OF, checksum
from eyechart.ledger.snapshot import open_copy

VERSION = 3
"""The format that is written."""
_TABLES = """
CREATE TABLE IF NOT EXISTS calls (
    id INTEGER PRIMARY KEY,
    study TEXT NOT NULL, model TEXT NOT NULL, prompt TEXT NOT NULL,
    frame TEXT NOT NULL, condition TEXT NOT NULL, repeat INTEGER NOT NULL,
    UNIQUE (study, model, prompt, frame, condition, repeat)
) STRICT;
CREATE TABLE IF NOT EXISTS attempts (
    id INTEGER PRIMARY KEY,
    call INTEGER NOT NULL REFERENCES calls (id),
    number INTEGER NOT NULL,{reason} request_sha256 TEXT NOT NULL, sent_at TEXT NOT NULL,
    UNIQUE (call, number)
) STRICT;
CREATE TABLE IF NOT EXISTS replies (
    attempt INTEGER PRIMARY KEY REFERENCES attempts (id),
    call INTEGER NOT NULL REFERENCES calls (id),
    final INTEGER NOT NULL, closed_at TEXT NOT NULL,
    text TEXT NOT NULL, finish_reason TEXT, error TEXT, error_detail TEXT NOT NULL,
    prompt_tokens INTEGER, completion_tokens INTEGER, seconds REAL{measured}
) STRICT;
CREATE UNIQUE INDEX IF NOT EXISTS one_final_reply_a_call ON replies (call) WHERE final = 1;
CREATE INDEX IF NOT EXISTS replies_of_a_call ON replies (call);
"""
_MEASURED = """,
    reasoning TEXT NOT NULL, reasoning_tokens INTEGER, first_byte_s REAL, status INTEGER, retry_after_s REAL,
    served TEXT, provider TEXT, cost_usd REAL, energy_j REAL"""
MIGRATION = """
ALTER TABLE replies ADD COLUMN system_fingerprint TEXT;
ALTER TABLE replies ADD COLUMN payload_bytes INTEGER;
ALTER TABLE replies ADD COLUMN payload_sha256 TEXT;
ALTER TABLE replies ADD COLUMN row_sha256 TEXT;
DROP INDEX one_final_reply_a_call;
CREATE INDEX final_replies ON replies (call) WHERE final = 1;
PRAGMA user_version = 3;
"""
"""Migration from format 2, which 0.1.0 writes, to 3; a new ledger uses it too, for one schema."""
_APPEND_ONLY = "".join(
    f"CREATE TRIGGER IF NOT EXISTS {table}_{verb} BEFORE {verb} ON {table} "
    "BEGIN SELECT RAISE(ABORT, 'the ledger is append-only'); END;\n"
    for table in ("calls", "attempts", "replies")
    for verb in ("UPDATE", "DELETE")
)
_FORMAT_2 = f"{_TABLES.format(reason=' reason TEXT,', measured=_MEASURED)} {_APPEND_ONLY}"
SCHEMAS: Mapping[int, str] = MappingProxyType(
    {
        1: f"{_TABLES.format(reason='', measured='')} {_APPEND_ONLY}",
        2: _FORMAT_2,
        3: f"{_FORMAT_2} {MIGRATION}",
    }
)
"""The statements that make an empty ledger of each format, without the format's number."""
APPENDED = (2, 3)
"""The formats that a run can append to; an older one is migrated first."""
SINCE_FORMAT_3 = ("system_fingerprint", "payload_bytes", "payload_sha256")
"""The Reply fields that an older ledger does not hold."""
_ADDED_BY_3 = ", ".join(f"NULL AS {name}" for name in (*SINCE_FORMAT_3, "row_sha256"))
_ADDED_BY_2 = (
    "'' AS reasoning, NULL AS reasoning_tokens, NULL AS first_byte_s, NULL AS status, NULL AS retry_after_s, "
    "NULL AS served, NULL AS provider, NULL AS cost_usd, NULL AS energy_j"
)
OLDER: Mapping[int, str] = MappingProxyType(
    {
        2: f"CREATE TEMP VIEW replies AS SELECT *, {_ADDED_BY_3} FROM main.replies;",
        1: f"CREATE TEMP VIEW replies AS SELECT *, {_ADDED_BY_2}, {_ADDED_BY_3} FROM main.replies;"
        "CREATE TEMP VIEW attempts AS SELECT *, NULL AS reason FROM main.attempts;",
    }
)
"""Views that shadow an older format's tables, with NULL for columns that it lacks."""
_OBJECTS = "SELECT type, name, tbl_name, sql FROM main.sqlite_master"
_SHOWN = 3


def format_of(sql: sqlite3.Connection, path: Path) -> int:
    """Return the format of an open ledger.

    Raises LedgerError if the file is empty, belongs to another program, or has an unknown format.
    It also compares the schema object by object with that of its format. A view or a virtual table
    instead of a table is an error, and so is an extra or missing trigger.
    """
    (said,) = sql.execute("PRAGMA user_version").fetchone()
    (program,) = sql.execute("PRAGMA application_id").fetchone()
    rows = sql.execute(_OBJECTS).fetchall()
    found = set(rows)
    if not found and (said, program) == (0, 0):
        size = path.stat().st_size
        raise LedgerError(
            f"{path} holds no table ({size} bytes): restore it from a copy, or continue the run without its "
            "rows with --accept-loss"
        )
    if program:
        raise LedgerError(f"{path} is no ledger: it says that it is a database of program {program}")
    if said not in SCHEMAS:
        raise LedgerError(
            f"{path} is a ledger of format {said}; this eyechart reads formats 1 to {VERSION}: use the eyechart "
            "that wrote it, or start a new run with another --out"
        )
    strange = sorted({str(name) for _, name, _, _ in found ^ _objects(said)} | _twice(name for _, name, _, _ in rows))
    if strange:
        named = printable(", ".join(strange[:_SHOWN]))
        more = f" and {len(strange) - _SHOWN} more" if len(strange) > _SHOWN else ""
        raise LedgerError(
            f"{path} is no plain ledger: {named}{more} of its schema differ from those of format {said}; "
            "restore it from a copy"
        )
    return int(said)


def is_bare(path: Path) -> bool:
    """Return whether a file and its log hold no table and belong to no other program."""
    with ExitStack() as opened:
        sql, _ = open_copy(path, opened)
        opened.callback(sql.close)
        try:
            said = [sql.execute(f"PRAGMA {name}").fetchone()[0] for name in ("user_version", "application_id")]
            return said == [0, 0] and not sql.execute(_OBJECTS).fetchall()
        except sqlite3.Error:
            return False


def _twice(names: Iterable[object]) -> set[str]:
    return {str(name) for name, times in Counter(names).items() if times > 1}


@cache
def _objects(version: int) -> frozenset[tuple[object, ...]]:
    with closing(sqlite3.connect(":memory:")) as own:
        own.executescript(SCHEMAS[version])
        return frozenset(own.execute(_OBJECTS))


_EVERY_ROW = (
    f"SELECT r.attempt, r.call IS a.call, r.row_sha256, {KEY_OF_CALL}, a.reason, a.request_sha256, a.sent_at, "
    f"r.final, r.closed_at, {REPLY_OF} FROM replies r "
    "LEFT JOIN attempts a ON a.id = r.attempt LEFT JOIN calls c ON c.id = a.call ORDER BY r.attempt"
)
_BEFORE = 3
"""Number of columns before those in the checksum."""
_OF_FORMAT_3 = [REPLY.index(name) - len(REPLY) for name in SINCE_FORMAT_3]
"""Positions in a row of the columns that no older format has."""
_WITHOUT_CALL = "SELECT id FROM attempts WHERE call NOT IN (SELECT id FROM calls)"
_MISCOUNTED = "SELECT min(id) FROM attempts GROUP BY call HAVING min(number) != 1 OR max(number) != count(*)"


def require_sound(sql: sqlite3.Connection, path: Path) -> None:
    """Raise LedgerError if a file is damaged as a database or in its rows."""
    require_whole(sql, path)
    found = list(damaged(sql))
    if found:
        more = f" and {len(found) - 1} more" if len(found) > 1 else ""
        raise LedgerError(f"{path} is damaged in {printable(found[0])}{more}; restore it from a copy")


def require_whole(sql: sqlite3.Connection, path: Path, *, indexes: bool = True) -> None:
    """Raise LedgerError if a file is damaged as a database; ``indexes`` are compared with their tables, or not."""
    try:
        (said,) = sql.execute(f"PRAGMA main.{'integrity' if indexes else 'quick'}_check(1)").fetchone()
    except sqlite3.Error as error:
        said = str(error)
    if said != "ok":
        raise LedgerError(f"{path} is damaged: {printable(said)}; restore it from a copy")


def damaged(sql: sqlite3.Connection) -> Iterator[str]:
    """Yield in words the rows that differ from what was written.

    A reply is compared with its checksum. A reply without one must be older than format 3: it comes
    before every reply with one, and has no column that only format 3 has. Every row must belong to
    a call, and the attempts at a call must count from 1.
    """
    since = False
    for row in sql.execute(_EVERY_ROW):
        attempt, its, digest = row[:_BEFORE]
        written = row[_BEFORE:]
        since = since or digest is not None
        sound = checksum(written) == digest if since else not any(written[at] is not None for at in _OF_FORMAT_3)
        if its and sound and written[0] is not None:
            continue
        study, model, _, frame, condition, _ = written[:OF_KEY]
        if study is None:
            yield f"the reply to attempt {attempt}, which belongs to no call"
        else:
            yield f"{model}'s reply about {frame} under {condition}"
    for (attempt,) in sql.execute(f"{_WITHOUT_CALL} UNION {_MISCOUNTED}"):
        yield f"attempt {attempt}, which breaks the count of its call"
