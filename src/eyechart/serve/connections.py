"""The connections of a server: their largest number, and their longest time without a request."""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from aiohttp import web

QUIET = logging.getLogger("eyechart.serve")
QUIET.setLevel(logging.CRITICAL + 1)  # a malformed request gets 400, and needs no traceback
_LINE_BYTES = 8190
"""The most bytes of a head's first line, and of each header."""
_FULL = b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: application/json\r\nRetry-After: 1\r\nConnection: close\r\n"


@dataclass
class Connections:
    """At most ``most`` connections, closed after ``idle_s`` idle; at most ``headers`` headers."""

    most: int
    idle_s: float
    headers: int = 64
    _busy: Counter[object] = field(default_factory=Counter)
    _last: dict[object, float] = field(default_factory=dict)

    def head(self) -> dict[str, Any]:
        """Return the options of a runner: the bounds of a head, and no logs."""
        lines: dict[str, Any] = {"max_line_size": _LINE_BYTES, "max_field_size": _LINE_BYTES}
        return {**lines, "max_headers": self.headers, "logger": QUIET, "access_log": None}

    @contextmanager
    def answering(self, request: web.Request) -> Iterator[None]:
        """Count a request; its connection is not idle meanwhile."""
        self._busy[request.protocol] += 1
        try:
            yield
        finally:
            self._busy[request.protocol] -= 1
            self._last[request.protocol] = time.monotonic()

    def accepting(self, handlers: web.Server, refused: Callable[[], None]) -> Callable[[], asyncio.BaseProtocol]:
        """Return the factory of connections; one too many gets 503, and ``refused`` is called."""

        def begin() -> asyncio.BaseProtocol:
            if len(handlers.connections) < self.most:
                return handlers()
            refused()
            return _RefusedConnection()

        return begin

    def reap(self, there: list[web.RequestHandler]) -> None:
        """Close connections that have been without a request for too long."""
        now = time.monotonic()
        self._last = {one: self._last.get(one, now) for one in there}
        self._busy = Counter({one: self._busy[one] for one in there if self._busy[one]})
        for one in there:
            if not self._busy[one] and now - self._last[one] > self.idle_s:
                one.force_close()


class _RefusedConnection(asyncio.Protocol):
    """One connection too many: it gets 503, and is closed before anything is read."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Write the answer."""
        assert isinstance(transport, asyncio.WriteTransport)
        body = b'{"error":"too many connections"}'
        transport.write(_FULL + b"Content-Length: %d\r\n\r\n" % len(body) + body)
        transport.close()
