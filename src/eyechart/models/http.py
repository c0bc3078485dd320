"""HTTP for the adapters: one bounded, timed request; each failure has a kind.

Nothing is retried, and no redirect is followed. HTTP_PROXY, HTTPS_PROXY and NO_PROXY name the
proxy; addresses of this machine never use one. `.netrc` and cookies are not used.
"""

import asyncio
import contextlib
import email.utils
import hashlib
import ipaddress
import json
import re
import ssl
import sys
import time
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any
from urllib.parse import unquote, urlencode, urlsplit
from urllib.request import getproxies, proxy_bypass

import aiohttp
import orjson
from aiohttp.client_proto import ResponseHandler
from aiohttp.connector import Connection

from eyechart import __version__
from eyechart.calls import MOST, ErrorKind, Reply
from eyechart.errors import SpecError, printable
from eyechart.keys import without_keys
from eyechart.models.faults import delay_s, kind_of_status, with_proof

MOST_BYTES = 8_000_000
"""A longer body is no reply to "choose an action"; the rest of it is not read."""

_CONNECT_S = 30.0
_PIECES = 4096
_MESSAGES = ("message", "error", "detail", "msg")
_DEEPEST = 20
_NAME = 200
_BOUNDS = {
    "text": None,
    "reasoning": None,
    "error_detail": None,
    "finish_reason": _NAME,
    "served": _NAME,
    "provider": _NAME,
    "system_fingerprint": _NAME,
}
"""A reply's texts from a server, with the length that each may have after secrets are removed."""
_texts = attrgetter(*_BOUNDS)


@dataclass(slots=True)
class Response:
    """A server's response, or a failure: then ``error`` is set and ``body`` may be incomplete.

    ``arrived`` holds (bytes so far, seconds since the start) for the first pieces of the body.
    """

    body: bytearray = field(default_factory=bytearray)
    status: int | None = None
    error: ErrorKind | None = None
    detail: str = ""
    seconds: float = 0.0
    first_byte_s: float | None = None
    retry_after_s: float | None = None
    scrub: Callable[[str], str] = field(default=str, repr=False)
    payload: bytes = field(default=b"", repr=False)
    content_type: str = ""
    arrived: list[tuple[int, float]] = field(default_factory=list, repr=False)
    came_over: ResponseHandler | None = field(default=None, repr=False)

    def reply(self, **said: Any) -> Reply:  # noqa: ANN401 - the fields of a Reply
        """Return a reply with these fields and this response's status, times, and request digest."""
        return Reply(
            **said,
            status=self.status,
            seconds=self.seconds,
            first_byte_s=self.first_byte_s,
            retry_after_s=self.retry_after_s,
            payload_bytes=len(self.payload),
            payload_sha256=hashlib.sha256(self.payload).hexdigest(),
        )

    def failure(self, error: ErrorKind | None = None, detail: str = "") -> Reply:
        """Return the reply of a failure: this response's own, or the given one of its body.

        Closes the connection: more of this response may follow on it, and would be read as the next
        call's reply. A call that uses the connection meanwhile fails and is repeated.
        """
        if self.came_over is not None and self.came_over.transport is not None:
            self.came_over.transport.close()
        words = self.scrub(detail or self.detail)  # before it is cut: half a key is not recognised
        return self.reply(error=error or self.error, error_detail=printable(words))


class _Connector(aiohttp.TCPConnector):
    """Connections that are not reused after unexpected data.

    A body longer than announced, or a reply without a request, would be read as the next reply.
    """

    async def connect(
        self,
        req: aiohttp.ClientRequest,
        traces: list[Any],
        timeout: aiohttp.ClientTimeout,  # noqa: ASYNC109 - aiohttp's own
    ) -> Connection:
        """Return a connection without unread data."""
        result = await super().connect(req, traces, timeout)
        while result.protocol is not None and result.protocol.should_close:
            result.close()
            result = await super().connect(req, traces, timeout)
        _USED.set(result.protocol)
        return result


_USED: ContextVar[ResponseHandler | None] = ContextVar("used", default=None)
"""The connection of the current task's request."""


@dataclass(slots=True)
class Endpoint:
    """A server for POST requests, over one session that opens with an event loop's first request.

    ``secrets`` are values that must not appear in any text of a reply; ``headers`` hold them.
    ``query`` is appended to every address.
    """

    base_url: str
    timeout_s: float
    headers: Mapping[str, str] = field(default_factory=dict, repr=False)
    secrets: tuple[str, ...] = field(default=(), repr=False)
    query: Mapping[str, str] = field(default_factory=dict)
    _session: aiohttp.ClientSession | None = field(default=None, repr=False)
    _loop: asyncio.AbstractEventLoop | None = field(default=None, repr=False)
    _proxy: str | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Find the proxy; raises SpecError where its address is malformed."""
        self._proxy = proxy_for(self.base_url)
        named = urlsplit(self._proxy or "")
        parts = (named.password, named.netloc.rpartition("@")[0], unquote(named.password or ""))
        self.secrets += tuple(part for part in parts if part)

    async def post(self, path: str, payload: bytes) -> Response:
        """Send one request and read the whole body; every failure is a Response with its kind."""
        start, seen = time.perf_counter(), Response(scrub=self.scrub, payload=payload)
        _USED.set(None)
        try:
            address = f"{self.base_url}{path}?{urlencode(self.query)}" if self.query else self.base_url + path
            async with self._open().post(address, data=payload, allow_redirects=False) as came:
                seen.came_over = _USED.get()
                seen.status, seen.retry_after_s = came.status, _retry_after(came.headers)
                seen.content_type = came.content_type
                async for chunk in came.content.iter_any():
                    if seen.first_byte_s is None:
                        seen.first_byte_s = time.perf_counter() - start
                    seen.body += chunk
                    if len(seen.arrived) < _PIECES:
                        seen.arrived.append((len(seen.body), time.perf_counter() - start))
                    if len(seen.body) > MOST_BYTES:
                        came.close()  # the rest is not read, and the connection is not reused
                        break
                seen.error, detail = _judged(came, seen)
        except (TimeoutError, aiohttp.ClientError, OSError, ValueError) as failure:
            seen.error, detail = _failed(failure, seen, self.timeout_s)
            _let_go(failure)
        seen.detail, seen.seconds = self.scrub(detail), time.perf_counter() - start
        return seen

    async def close(self) -> None:
        """Close the session, if one is open in this event loop; the next request opens another."""
        session, self._session = self._session, None
        if session is not None and self._loop is asyncio.get_running_loop():
            await session.close()

    def scrub(self, text: str) -> str:
        """Return a text without the request's secrets, encoded ones included."""
        return without_keys(text, dict.fromkeys(self.secrets, "[key removed]"))

    def scrubbed(self, reply: Reply) -> Reply:
        """Return a reply without secrets, which a server may repeat; then cut its names."""
        changed = {}
        for (name, most), text in zip(_BOUNDS.items(), _texts(reply), strict=True):
            if text and (clean := self.scrub(text)[:most]) != text:
                changed[name] = clean
        return replace(reply, **changed) if changed else reply  # type: ignore[arg-type]

    def _open(self) -> aiohttp.ClientSession:
        loop = asyncio.get_running_loop()
        if self._session is None or self._loop is not loop:
            self._loop = loop
            self._session = aiohttp.ClientSession(
                connector=_Connector(limit=0),
                timeout=aiohttp.ClientTimeout(total=self.timeout_s, sock_connect=min(_CONNECT_S, self.timeout_s)),
                headers={
                    "Content-Type": "application/json",
                    "Accept-Encoding": "identity",
                    "User-Agent": f"eyechart/{__version__}",
                    **self.headers,
                },
                cookie_jar=aiohttp.DummyCookieJar(),
                auto_decompress=False,
                proxy=self._proxy,
            )
        return self._session


def _judged(came: aiohttp.ClientResponse, response: Response) -> tuple[ErrorKind | None, str]:
    if len(response.body) > MOST_BYTES:
        return "unreadable", f"the body has more than {MOST_BYTES} bytes"
    if 300 <= came.status < 400:
        where = came.headers.get("Location")
        led = (
            f"redirected to {where}, which is not followed; give that address"
            if where
            else "no answer, and no other address is given"
        )
        return "gateway", f"HTTP {came.status}: {led}"
    if came.status >= 400:
        said, message = _json_of(response.body), error_message(response.body, response.scrub)
        kind = kind_of_status(came.status, said)
        if response.retry_after_s is None:
            response.retry_after_s = delay_s(said)
        if response.retry_after_s is None and kind == "rate_limited":
            response.retry_after_s = _reset(came.headers)
        detail = f"HTTP {came.status}: {message or came.reason}"
        return kind, with_proof(detail, came.status, said) if kind == "bad_request" else detail
    return None, ""


def _failed(failure: Exception, response: Response, timeout_s: float) -> tuple[ErrorKind, str]:
    words = re.sub(r"://[^/\s@]*@", "://…@", f"{type(failure).__name__}: {failure}")
    if isinstance(failure, aiohttp.InvalidURL):
        return "connection", "the address of the server or of a proxy is malformed, and is not quoted"
    if isinstance(failure, aiohttp.ClientConnectorCertificateError | ssl.SSLCertVerificationError):
        return "connection", f"the server's certificate is not trusted: {words}"
    if isinstance(failure, TimeoutError):
        came = "no byte came" if response.first_byte_s is None else f"{len(response.body)} bytes came"
        return "timeout", f"no whole reply within {timeout_s:g} s; {came}"
    if response.status is not None:
        return "cut_short", f"the body ended after {len(response.body)} bytes: {words}"
    if isinstance(failure, aiohttp.ClientConnectionError | aiohttp.ClientProxyConnectionError | OSError):
        return "connection", words
    return "unreadable", f"no HTTP response: {words}"


def _let_go(failure: BaseException | None) -> None:
    """Take the frames from a failure and its causes: they hold it and the request in a circle.

    A server that is gone fails many calls a second, and the collector of circles comes late.
    """
    while failure is not None:
        failure.__traceback__ = None
        failure = failure.__cause__ or failure.__context__


def _json_of(body: bytes | bytearray) -> object:
    try:
        return read_json(body)
    except ValueError:
        return None


def error_message(body: bytes | bytearray, scrub: Callable[[str], str] = str) -> str:
    """Return a server's error message in one bounded line: from its JSON, else the body's text.

    ``scrub`` is applied before the text is cut.
    """
    try:
        said = words_of(read_json(body))
    except ValueError:
        said = body.decode("utf-8", "replace")
    return printable(scrub(said))


def read_json(body: bytes | bytearray) -> object:
    """Return a JSON body's value, also with lone surrogates; raises ValueError for no JSON."""
    try:
        return orjson.loads(body)
    except ValueError as error:
        try:
            return json.loads(body)
        except (ValueError, RecursionError):
            raise error from None


def unlike_json(came: Response) -> str:
    """Describe a body that is no JSON, by its first bytes and its content type."""
    start = bytes(came.body[:64]).lstrip().lower()
    if start.startswith(b"\x1f\x8b"):
        return "the body is no JSON but compressed (gzip), against the request; switch compression off at the server"
    if start.startswith((b"<!doctype", b"<html")) or came.content_type == "text/html":
        return "the body is no JSON but a page (HTML): another program may answer at this address"
    return "the body is no JSON"


def words_of(found: object, depth: int = 0) -> str:
    """Return the message in an error's value, at any depth; else the value itself as JSON."""
    if isinstance(found, Mapping) and depth < _DEEPEST:
        for name in _MESSAGES:
            if found.get(name):
                code = found.get("code") or found.get("type")
                said = words_of(found[name], depth + 1)
                return f"{said} ({code})" if isinstance(code, str) and code not in said else said
    if isinstance(found, str):
        return found
    try:
        return orjson.dumps(found).decode()
    except TypeError:
        return f"a {type(found).__name__} that is nested too deeply to show"


def count_of(value: object) -> int | None:
    """Return a server's count, or None where the value is no count."""
    return value if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**53 else None


def end_of(value: object) -> str | None:
    """Return a server's finish reason; a value that is no text becomes JSON: no normal end."""
    if isinstance(value, str) or value is None:
        return value or None
    return words_of(value) or "nothing that can be read"


def number_of(value: object) -> float | None:
    """Return a server's number of at least 0, or None where the value is none."""
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= sys.float_info.max:
        return float(value)
    return None


def is_loopback(base_url: str) -> bool:
    """Return whether an address is this machine's own."""
    host = urlsplit(base_url).hostname or ""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost" or host.endswith(".localhost")


def proxy_for(base_url: str) -> str | None:
    """Return the environment's proxy for an address; None for this machine's own addresses.

    Raises SpecError for a malformed address, without the address: it may hold a password.
    """
    parts = urlsplit(base_url)
    if is_loopback(base_url) or proxy_bypass(parts.hostname or ""):
        return None
    proxy = getproxies().get(parts.scheme)
    if proxy and not _is_proxy(proxy):
        raise SpecError(
            f"the proxy that {parts.scheme.upper()}_PROXY names has a malformed address, which is not quoted: write "
            "http://HOST:PORT, or http://USER:PASSWORD@HOST:PORT with special characters percent-encoded"
        )
    return proxy or None


def _is_proxy(address: str) -> bool:
    """Return whether an address may be that of an HTTP proxy."""
    try:
        named = urlsplit(address)
        right = named.scheme in {"http", "https"} and named.port != 0 and address.isprintable()
    except ValueError:
        return False
    host = re.fullmatch(r"[\w.:%-]+", named.hostname or "")
    return bool(right and host and named.path in {"", "/"} and not named.query and not named.fragment)


def _retry_after(headers: Mapping[str, str]) -> float | None:
    """Return the seconds to wait before a retry: ``Retry-After`` of RFC 9110, or milliseconds."""
    precise = headers.get("retry-after-ms")
    if precise is not None and (parts := number_of(_seconds(precise))) is not None:
        return min(parts / 1000, MOST["retry_after_s"])
    said = headers.get("Retry-After", "").strip()
    if not said:
        return None
    wait = None
    with contextlib.suppress(ValueError, TypeError, OverflowError, IndexError, OSError):
        if (wait := _seconds(said)) is None:
            wait = max(0.0, email.utils.parsedate_to_datetime(said).timestamp() - time.time())
    wait = number_of(wait)
    return None if wait is None else min(wait, MOST["retry_after_s"])  # more counts as unreported


_RESET = "x-ratelimit-reset"
_LONGEST_RESET_S = 60.0
"""A limit with a later reset may let a call through before it, so the usual pauses apply."""
_SPAN = re.compile(r"(?:(\d+)h)?(?:(\d+)m)?(?:(\d+(?:\.\d+)?)s)?(?:(\d+(?:\.\d+)?)ms)?")


def _reset(headers: Mapping[str, str]) -> float | None:
    """Return the seconds until the exhausted limits, or else the first, reset; None beyond 60."""
    waits, spent = [], []
    for name, value in headers.items():
        if name.lower().startswith(_RESET) and (wait := _until(value.strip())) is not None:
            waits.append(wait)
            left = headers.get(name.lower().replace("-reset", "-remaining"), "").strip()
            spent += [wait] if left == "0" else []
    wait = max(spent, default=min(waits, default=None))
    return wait if wait is not None and wait <= _LONGEST_RESET_S else None


def _until(said: str) -> float | None:
    """Return the seconds of a span (``6m0s``, ``500ms``, ``1.5``) or until a Unix time (s, ms)."""
    if (number := _seconds(said)) is not None:
        now = time.time()
        seconds = number if number < now / 2 else number - now if number < 100 * now else number / 1000 - now
        return number_of(seconds)
    span = _SPAN.fullmatch(said)
    if not said or span is None:
        return None
    hours, minutes, seconds, parts = (float(part or 0) for part in span.groups())
    return 3600 * hours + 60 * minutes + seconds + parts / 1000


def _seconds(said: str) -> float | None:
    with contextlib.suppress(ValueError):
        return float(said)
    return None
