"""A server on loopback that speaks HTTP byte by byte, so that it can break it: every fault of the road by its name.

What stands here leaves nothing to a library: wrong lengths, half a compressed body, a reply too much.
"""

import asyncio
import contextlib
import gzip
import json
import random
import socket
import struct
import threading
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from faults import completion

CLOSE, RESET = "close", "reset"
Step = bytes | float | str
"""Bytes to send, seconds to wait, or how to end the connection; without an end it is kept for the next request."""
Road = Callable[[bytes], Sequence[Step]]
"""(the whole body that a sound road would bring) to what is done instead."""
_HTML = b"<html><head><title>Sorry</title></head><body><h1>We will be back</h1></body></html>"


def message(status: int, body: bytes, *headers: str, length: int | None = None) -> bytes:
    """Return a response of HTTP/1.1 whose ``Content-Length`` may be a lie."""
    words = [f"HTTP/1.1 {status} Said", *headers, f"Content-Length: {len(body) if length is None else length}"]
    return "\r\n".join(words).encode() + b"\r\n\r\n" + body


def _page(status: int, *headers: str) -> Road:
    return lambda _: [message(status, _HTML, "Content-Type: text/html", *headers)]


def _json(status: int, value: object, *headers: str) -> Road:
    return lambda _: [message(status, json.dumps(value).encode(), "Content-Type: application/json", *headers)]


def _chunked(*parts: bytes) -> bytes:
    return b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n" + b"".join(parts)


def _chunk(part: bytes) -> bytes:
    return f"{len(part):x}\r\n".encode() + part + b"\r\n"


_STATUSES = (
    300,
    301,
    302,
    303,
    307,
    308,
    400,
    405,
    406,
    408,
    409,
    410,
    411,
    412,
    413,
    414,
    415,
    417,
    418,
    421,
    422,
    423,
    424,
)
_STATUSES += (425, 426, 428, 429, 431, 449, 451, 499, 500, 502, 503, 504, 508, 520, 522, 524, 529)
TROUBLE: Mapping[str, tuple[int, object]] = {
    "a filter that is down": (
        400,
        {"error": {"message": "The content filter service is temporarily unavailable", "code": "content_filter_error"}},
    ),
    "a moderation that is busy": (403, {"error": {"message": "moderation endpoint overloaded, please retry"}}),
    "a safety system that is busy": (422, {"detail": "safety system is overloaded; try again later"}),
    "a filter that failed": (400, {"error": {"message": "Failed to call content filter"}}),
    "a queue": (400, {"error": {"message": "request queue exceeds its maximum size"}}),
    "what is pending": (400, {"error": "maximum number of pending requests reached"}),
    "sessions": (400, {"error": "Session limit reached"}),
    "a buffer": (413, {"error": "Request buffer limit reached, server is shedding load"}),
    "workers": (422, {"error": "worker limit reached"}),
    "at the same time": (422, {"error": "limit of 2 simultaneous requests"}),
    "pictures at once": (400, {"error": "too many images being processed at once"}),
    "pictures a minute": (422, {"error": {"message": "maximum 4 images per minute"}}),
    "messages": (400, {"error": "You have exceeded the maximum number of messages allowed"}),
    "throttled": (400, {"error": {"message": "Service limit: token bucket exhausted", "code": "throttled"}}),
    "throttled tokens": (400, {"message": "ThrottlingException: Too many tokens, please wait before trying again."}),
    "tokens": (400, {"error": {"message": "Token limit exceeded"}}),
    "files": (400, {"error": {"message": "Too many open files"}}),
    "loading, beside the model's name": (400, {"error": {"message": "Model is currently loading", "param": "model"}}),
    "a timeout beside a field": (400, {"error": {"message": "Timeout while processing", "param": "messages"}}),
    "a code beside a field": (400, {"error": {"code": 503, "message": "no", "param": "max_tokens"}}),
    "a name of gRPC beside a field": (400, {"error": {"status": "UNAVAILABLE", "message": "", "field": "prompt"}}),
    "a time to ask again beside a field": (400, {"error": {"message": "no", "param": "seed", "retry_after": 3}}),
    "memory of the GPU": (400, {"error": {"message": "CUDA error: images batch failed"}}),
    "a dead engine": (400, {"error": {"message": "Failed to process image: EngineDeadError"}}),
    "a dead worker": (400, {"error": {"message": "Error processing prompt: worker died"}}),
    "an internal error": (400, {"error": {"message": "internal error while processing image"}}),
    "no backend": (400, {"error": {"message": "no healthy backend for messages endpoint"}}),
    "shutting down": (400, {"error": {"message": "server shutting down; request arguments dropped"}}),
    "a road to a policy": (400, {"error": {"message": "content-policy engine rejected us: upstream connect error"}}),
    "retry or report": (400, {"error": {"message": "Unable to process input image. Please retry or report it"}}),
    "the name of a status": (413, {"error": "Payload Too Large"}),
    "a header": (400, {"message": "Request Header Or Cookie Too Large"}),
    "a field of the address": (422, {"detail": [{"loc": ["query", "api-version"], "msg": "Field required"}]}),
    "a path that is no place": (400, {"error": "Bad Request", "path": "/v1/chat/completions", "message": "no"}),
}
"""Passing trouble in JSON, of statuses that a wrong request has too."""
_SPARSE: Mapping[str, tuple[int, object]] = {
    "400 in JSON that names nothing": (400, {"error": {"message": "Bad Request", "code": 400}}),
    "400 of a body that came broken": (
        400,
        {"error": {"message": "We could not parse the JSON body of your request."}},
    ),
    "400 of an upstream": (400, {"error": "upstream connect error or disconnect/reset before headers"}),
    "409 in JSON": (409, {"message": "Conflict"}),
    "413 in JSON that names nothing": (413, {"message": "Payload rejected"}),
    "422 of a body that came broken": (422, {"detail": [{"type": "json_invalid", "loc": ["body", 56], "msg": "JSON"}]}),
    "422 of an empty body": (422, {"detail": [{"type": "missing", "loc": ["body"], "msg": "Field required"}]}),
}
ROADS: dict[str, Road] = {
    **{f"{status} with a page": _page(status, "Location: http://127.0.0.1:9/") for status in _STATUSES},
    **{name: _json(*said) for name, said in {**_SPARSE, **TROUBLE}.items()},
    "429 with Retry-After": _json(429, {"error": {"message": "slow down"}}, "Retry-After: 0.05"),
    "200 with a page": _page(200),
    "200 without a body": lambda _: [message(200, b"")],
    "204": lambda _: [b"HTTP/1.1 204 No Content\r\n\r\n"],
    "206 of a part": lambda body: [message(206, body[:40])],
    "a body cut and measured so": lambda body: [message(200, body[: len(body) // 2])],
    "a body cut": lambda body: [message(200, body[: len(body) // 2], length=len(body)), CLOSE],
    "a body cut by a reset": lambda body: [message(200, body[: len(body) // 2], length=len(body)), 0.01, RESET],
    "a length too long": lambda body: [message(200, body, length=len(body) + 7), CLOSE],
    "a length too short": lambda body: [message(200, body, length=len(body) - 7)],
    "a length too short, the rest late": lambda body: [message(200, body[:-7]), 0.02, body[-7:]],
    "two lengths": lambda body: [message(200, body, "Content-Length: 3")],
    "a length that is no number": lambda body: [message(200, body).replace(b"Content-Length: ", b"Content-Length: x")],
    "a reply too much": lambda _: [message(200, b"{}"), message(200, json.dumps(completion("LEFT")).encode())],
    "a reply too much, and late": lambda _: [
        message(200, b"{}"),
        0.01,
        message(200, json.dumps(completion("LEFT")).encode()),
    ],
    "rubbish after a reply": lambda _: [message(503, b"{}"), b"\x00\xffrubbish"],
    "half of a compressed body": lambda body: [message(200, gzip.compress(body)[:40], "Content-Encoding: gzip")],
    "a compressed body that nobody asked for": lambda body: [message(200, gzip.compress(body))],
    "bytes that are no UTF-8": lambda body: [
        message(200, body.replace(b'"SLOW"', b'"').replace(b"stop", b"st\xff\xfep"))
    ],
    "zero bytes": lambda body: [message(200, bytes(len(body)))],
    "chunks cut": lambda body: [_chunked(_chunk(body[:30])), CLOSE],
    "a chunk of a wrong size": lambda body: [_chunked(b"5\r\n" + body + b"\r\n0\r\n\r\n"), CLOSE],
    "a chunk of no size": lambda body: [_chunked(b"zz\r\n" + body + b"\r\n0\r\n\r\n"), CLOSE],
    "no HTTP": lambda _: [b"SSH-2.0-OpenSSH_9.6\r\n", CLOSE],
    "a body without a head": lambda body: [body, CLOSE],
    "a head that never ends": lambda _: [b"HTTP/1.1 200 OK\r\nX: " + b"y" * 200_000, CLOSE],
    "a head with a broken line": lambda body: [b"HTTP/1.1 200 OK\r\nno colon here\r\n\r\n" + body, CLOSE],
    "another protocol": lambda _: [
        b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: x\r\nConnection: upgrade\r\n\r\n",
        CLOSE,
    ],
    "closed without a word": lambda _: [CLOSE],
    "reset without a word": lambda _: [RESET],
    "nothing for long": lambda _: [60.0, CLOSE],
    "a drip": lambda body: [
        message(200, b"", length=len(body)),
        *(part for byte in body for part in (bytes([byte]), 0.2)),
    ],
    "9 MB": lambda _: [message(200, b" " * 9_000_000)],
    "no JSON": lambda _: [message(200, b"SLOW")],
    "JSON of another shape": _json(200, {"result": "SLOW"}),
    "JSON that is a list": _json(200, ["SLOW"]),
    "JSON that is null": _json(200, None),
    "no choices": _json(200, {"choices": []}),
    "an error inside a 200": _json(200, {"error": {"code": 502, "message": "the upstream is down"}}),
    "an error in words inside a 200": _json(200, {"error": "overloaded"}),
    "a 400 of an upstream inside a 200": _json(200, {"error": {"code": 400, "message": "Provider returned error"}}),
}
"""Every fault of the road. None of them says anything of the request, so each may pass."""


@dataclass
class BrokenRoad:
    """The server in a thread of its own: it breaks ``share`` of the requests, by kinds drawn at random.

    ``answers`` makes a reply's text of a request's JSON. ``requests`` counts what came whole, by the seed of its call;
    ``dealt`` the faults by name.
    """

    answers: Callable[[Mapping[str, object]], str] = lambda _: "SLOW"
    roads: Sequence[str] = tuple(ROADS)
    share: float = 1.0
    seed: int = 0
    port: int = 0
    requests: Counter[int] = field(default_factory=Counter)
    dealt: Counter[str] = field(default_factory=Counter)
    _open: set[asyncio.StreamWriter] = field(default_factory=set)

    @property
    def base_url(self) -> str:
        """Return the address for ``--base-url``."""
        return f"http://127.0.0.1:{self.port}/v1"

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open.add(writer)
        with contextlib.suppress(OSError, EOFError, asyncio.LimitOverrunError, asyncio.CancelledError):
            while True:
                head = await reader.readuntil(b"\r\n\r\n")
                (length,) = (
                    int(line[15:]) for line in head.split(b"\r\n") if line.lower().startswith(b"content-length:")
                )
                asked = json.loads(await reader.readexactly(length))
                self.requests[int(asked.get("seed", 0))] += 1
                for step in self._steps(asked):
                    await self._take(step, writer)
        self._open.discard(writer)
        writer.close()

    def _steps(self, asked: Mapping[str, object]) -> Sequence[Step]:
        body = json.dumps(completion(self.answers(asked))).encode()
        if self._chance.random() >= self.share:
            return [message(200, body, "Content-Type: application/json")]
        name = self._chance.choice(self.roads)
        self.dealt[name] += 1
        return ROADS[name](body)

    async def _take(self, step: Step, writer: asyncio.StreamWriter) -> None:
        if isinstance(step, float):
            await asyncio.sleep(step)
        elif isinstance(step, bytes):
            writer.write(step)
            await writer.drain()
        else:
            if step == RESET:
                sock = writer.get_extra_info("socket")
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                writer.transport.abort()
            raise ConnectionAbortedError

    def __enter__(self) -> Self:
        self._chance = random.Random(self.seed)  # noqa: S311 - which fault, no secret
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        starting = asyncio.start_server(self._serve, "127.0.0.1", self.port, limit=50_000_000)
        self._server = asyncio.run_coroutine_threadsafe(starting, self._loop).result(10)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result(10)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(10)
        self._loop.close()

    async def _end(self) -> None:
        self._server.close()
        for writer in self._open:
            writer.transport.abort()
        others = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)
        await asyncio.sleep(0)  # in which what was aborted is let go
