"""What a ledger keeps of a call, as rows: how a Reply is written down, its checksum, and how it is read back."""

import datetime as dt
import hashlib
import time
from collections.abc import Callable
from dataclasses import fields
from functools import lru_cache
from operator import attrgetter
from typing import Any, NamedTuple

from msgspec import msgpack

from eyechart.calls import MOST, CallKey, Reply
from eyechart.errors import encodable

UNKNOWN = "unknown"
"""The reason of an attempt that repeats one whose outcome is unknown: it was sent, and the run was killed."""
AGAIN = "again"
"""The reason of an attempt that asks a finished call once more, because it had ended in a failure of the road."""
KEY = ", ".join(CallKey._fields)
KEY_OF_CALL = ", ".join(f"c.{name}" for name in CallKey._fields)
KEY_IS = " AND ".join(f"{name} = ?" for name in CallKey._fields)
OF_KEY = len(CallKey._fields)
REPLY = tuple(field.name for field in fields(Reply))
REPLY_OF = ", ".join(f"r.{name}" for name in REPLY)
"""The fields of a reply as they stand in its row."""
_BOUNDED = {name: f"CASE WHEN r.{name} BETWEEN 0 AND {most!r} THEN r.{name} END" for name, most in MOST.items()}
REPORTED = ", ".join(_BOUNDED.get(name, f"r.{name}") for name in REPLY)
"""The same as they are read: a number that nobody can have measured, which an older ledger may hold, is none."""
_values = attrgetter(*REPLY)


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
    sent_at: str


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
    sent_at: str = ""


def row_of(reply: Reply, *, final: bool) -> tuple[object, ...]:
    """Return what is kept of a reply: whether it is final, the time, and its fields as SQLite gives them back."""
    values = zip(_PUT, _values(reply), strict=True)
    came = [one if one is None or (type(one) is str and one.isascii()) else put(one) for put, one in values]
    return (int(final), now(), *came)


def checksum(values: tuple[object, ...]) -> str:
    """Return the SHA-256 of a reply's row as a msgpack array.

    ``values`` are its call's key, why and what and when was asked, and all of the row but row ids.
    """
    return hashlib.sha256(_pack(values)).hexdigest()


def now() -> str:
    """Return the time in UTC, to the millisecond."""
    second, millisecond = divmod(time.time_ns() // 1_000_000, 1000)
    return f"{_moment(second)}.{millisecond:03d}+00:00"


@lru_cache(maxsize=2)
def _moment(second: int) -> str:
    return dt.datetime.fromtimestamp(second, dt.UTC).isoformat()[:19]


def _real(number: float) -> float | None:
    """Return a number as SQLite gives it back: no sign of zero, and None for what is none."""
    return None if number != number else float(number) + 0.0  # noqa: PLR0124 - only NaN differs from itself


_PUT: tuple[Callable[[Any], object], ...] = tuple(
    _real if one.type == float | None else int if one.type == int | None else encodable for one in fields(Reply)
)
"""What makes of each field of a Reply the value that SQLite keeps, and gives back as it is."""
_pack = msgpack.Encoder(enc_hook=str).encode  # a text of a kind of its own is kept as text
