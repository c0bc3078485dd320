"""The ledger is the durable, append-only record of calls: an SQLite file that any SQLite browser opens.

An attempt is a row in ``attempts``, written before it is sent, and a row in ``replies``, written when it is
over; an attempt without a reply was sent with its outcome unknown. Rows are never changed or removed. Of several
final replies of a call the last one counts. A counter beside the file tells when rows that were written are missing.
"""

from eyechart.ledger.ledger import Ledger
from eyechart.ledger.loss import accept_loss
from eyechart.ledger.rows import AGAIN, UNKNOWN, Attempt, Sent
from eyechart.ledger.schema import SINCE_FORMAT_3

__all__ = ["AGAIN", "SINCE_FORMAT_3", "UNKNOWN", "Attempt", "Ledger", "Sent", "accept_loss"]
