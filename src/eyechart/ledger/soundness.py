"""Check that a ledger holds what was written: checksums of replies, and links of rows."""

import sqlite3
from collections.abc import Iterator
from pathlib import Path

from eyechart.errors import LedgerError, printable
from eyechart.ledger.rows import KEY_OF_CALL, OF_KEY, REPLY, REPLY_OF, checksum
from eyechart.ledger.schema import SINCE_FORMAT_3

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


def require_whole(sql: sqlite3.Connection, path: Path) -> None:
    """Raise LedgerError if a file is damaged as a database."""
    try:
        (said,) = sql.execute("PRAGMA main.integrity_check(1)").fetchone()
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
