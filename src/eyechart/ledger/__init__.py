"""The ledger: the durable, append-only record of calls, in an SQLite file.

An attempt is a row in ``attempts``, written before it is sent. A row in ``replies`` is written when
it is over. An attempt without a reply was sent with an unknown outcome. Rows are never changed or
removed. If a call has several final replies, the last one counts. A counter beside the file shows
when written rows are missing.
"""

from eyechart.ledger.columns import COLUMNS, TEXTS_KEPT, Attempts, columns_of, hashed
from eyechart.ledger.ledger import Ledger, accept_loss
from eyechart.ledger.rows import AGAIN, UNKNOWN, Attempt, SentAttempt
from eyechart.ledger.schema import SINCE_FORMAT_3

__all__ = [
    "AGAIN",
    "COLUMNS",
    "SINCE_FORMAT_3",
    "TEXTS_KEPT",
    "UNKNOWN",
    "Attempt",
    "Attempts",
    "Ledger",
    "SentAttempt",
    "accept_loss",
    "columns_of",
    "hashed",
]
