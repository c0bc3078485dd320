"""Whether what stands in a ledger is what was written: checksums of its replies, and how its rows hang together."""

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
"""So many columns come before those of which the checksum is."""
_OF_FORMAT_3 = [REPLY.index(name) - len(REPLY) for name in SINCE_FORMAT_3]
"""Where a row has what no older format keeps."""
_WITHOUT_CALL = "SELECT id FROM attempts WHERE call NOT IN (SELECT id FROM calls)"
_MISCOUNTED = "SELECT min(id) FROM attempts GROUP BY call HAVING min(number) != 1 OR max(number) != count(*)"


def require_sound(sql: sqlite3.Connection, path: Path) -> None:
    """Raise LedgerError where a file is damaged: as a database, or in rows that are not what was written."""
    require_whole(sql, path)
    found = list(damaged(sql))
    if found:
        more = f" and {len(found) - 1} more" if len(found) > 1 else ""
        raise LedgerError(
            f"{path} is damaged: not what its checksum says is {printable(found[0])}{more}; restore it from a copy"
        )


def require_whole(sql: sqlite3.Connection, path: Path) -> None:
    """Raise LedgerError where a file is damaged as a database."""
    try:
        (said,) = sql.execute("PRAGMA main.integrity_check(1)").fetchone()
    except sqlite3.Error as error:
        said = str(error)
    if said != "ok":
        raise LedgerError(f"{path} is damaged: {printable(said)}; restore it from a copy")


def damaged(sql: sqlite3.Connection) -> Iterator[str]:
    """Yield in words which rows are not what was written.

    A reply is held against its checksum. One that has none is of a format before 3: it came before every reply that has
    one, and says nothing that only format 3 keeps. Of every row it is asked whether it belongs to a call, and whether
    the attempts at a call are counted from 1.
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
        yield f"attempt {attempt}, which is not the next of its call's"
