"""A call's rows in a ledger: how a Reply is written, its checksum, and how it is read."""

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
"""The reason of an attempt after one that was sent but lost its outcome when the run was killed."""
AGAIN = "again"
"""The reason of an attempt that repeats a finished call because it failed in transport."""
KEY = ", ".join(CallKey._fields)
KEY_OF_CALL = ", ".join(f"c.{name}" for name in CallKey._fields)
KEY_IS = " AND ".join(f"{name} = ?" for name in CallKey._fields)
OF_KEY = len(CallKey._fields)
REPLY = tuple(field.name for field in fields(Reply))
REPLY_OF = ", ".join(f"r.{name}" for name in REPLY)
"""The fields of a reply as columns of its row."""
_BOUNDED = {name: f"CASE WHEN r.{name} BETWEEN 0 AND {most!r} THEN r.{name} END" for name, most in MOST.items()}
REPORTED = ", ".join(_BOUNDED.get(name, f"r.{name}") for name in REPLY)
"""The same columns for reading; impossible numbers of an older ledger become None."""
_values = attrgetter(*REPLY)


class Attempt(NamedTuple):
    """An open attempt: its row ids, its call and its request.

    ``reason`` says why a repeated attempt is made: the error of the previous one, or ``UNKNOWN``.
    """

    id: int
    call: int
    number: int
    reason: str | None
    key: CallKey
    request_sha256: str
    sent_at: str


class SentAttempt(NamedTuple):
    """An attempt as read back: its call, number, reason and reply; None is "unknown".

    ``final`` says that the reply finished the call.
    """

    key: CallKey
    number: int
    reason: str | None
    reply: Reply | None
    request_sha256: str = ""
    final: bool = False
    sent_at: str = ""


def row_of(reply: Reply, *, final: bool) -> tuple[object, ...]:
    """Return a reply's row: whether it is final, the time, and its fields for SQLite."""
    values = zip(_PUT, _values(reply), strict=True)
    came = [one if one is None or (type(one) is str and one.isascii()) else put(one) for put, one in values]
    return (int(final), now(), *came)


def checksum(values: tuple[object, ...]) -> str:
    """Return the SHA-256 of a reply's row as a msgpack array.

    ``values`` are the call's key, the attempt's reason, request and time, and the row without row
    ids.
    """
    return hashlib.sha256(pack(values)).hexdigest()


def now() -> str:
    """Return the time in UTC, to the millisecond."""
    second, millisecond = divmod(time.time_ns() // 1_000_000, 1000)
    return f"{_moment(second)}.{millisecond:03d}+00:00"


@lru_cache(maxsize=2)
def _moment(second: int) -> str:
    return dt.datetime.fromtimestamp(second, dt.UTC).isoformat()[:19]


def _real(number: float) -> float | None:
    """Return a number as SQLite returns it: no signed zero, and None for NaN."""
    return None if number != number else float(number) + 0.0  # noqa: PLR0124 - only NaN differs from itself


_PUT: tuple[Callable[[Any], object], ...] = tuple(
    _real if field.type == float | None else int if field.type == int | None else encodable for field in fields(Reply)
)
"""The conversion of each Reply field to a value that SQLite stores and returns unchanged."""
pack = msgpack.Encoder(enc_hook=str).encode  # a subclass of str is stored as text
