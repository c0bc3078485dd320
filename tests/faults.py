"""A server on loopback that fails in every way that endpoints fail, and counts what it was asked; also as a program.

It speaks the chat completions of OpenAI's API. A call is known by its seed, so modes must send one.
"""

import asyncio
import hashlib
import json
import logging
import socket
import struct
import sys
import threading
from collections import Counter
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from aiohttp import web

HANGS_S = 60.0
"""What hangs would answer after so long."""

Handler = Callable[[web.Request, dict[str, object], int], Awaitable[web.StreamResponse]]
"""(request, its JSON, which attempt at this call it is, counted from 1) to the response."""


def completion(text: str | None, finish: str = "stop", **more: object) -> dict[str, object]:
    """Return a chat completion, as OpenAI's API has it."""
    return {
        "id": "chatcmpl-1",
        "object": "chat.completion",
        "created": 1_700_000_000,
        "model": "fault-model-2026-01-01",
        "system_fingerprint": "fp_1",
        "choices": [{"index": 0, "message": {"role": "assistant", "content": text}, "finish_reason": finish}],
        "usage": {"prompt_tokens": 100, "completion_tokens": 2, "total_tokens": 102},
        **more,
    }


def answer(text: str | None = "SLOW", finish: str = "stop", **more: object) -> web.Response:
    """Return a whole response of status 200."""
    return web.json_response(completion(text, finish, **more))


def refuse(status: int, message: str, headers: dict[str, str] | None = None, **error: object) -> web.Response:
    """Return an error as OpenAI's API has it."""
    return web.json_response({"error": {"message": message, **error}}, status=status, headers=headers)


def _once(fault: Callable[[web.Request], Awaitable[web.StreamResponse]]) -> Handler:
    """Return a handler that fails at the first attempt and then answers."""

    async def handle(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        del asked
        return await fault(request) if attempt == 1 else answer()

    return handle


def _always(fault: Callable[[web.Request], Awaitable[web.StreamResponse]]) -> Handler:
    async def handle(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        del asked, attempt
        return await fault(request)

    return handle


async def _busy(request: web.Request) -> web.Response:
    del request
    return refuse(429, "slow down")


async def _busy_until(request: web.Request) -> web.Response:
    del request
    return refuse(429, "slow down", {"Retry-After": "1"})


async def _broken(request: web.Request) -> web.Response:
    del request
    return refuse(500, "something broke")


async def _hang(request: web.Request) -> web.Response:
    del request
    await asyncio.sleep(HANGS_S)
    return answer()


async def _drip(request: web.Request) -> web.StreamResponse:
    response = web.StreamResponse()
    await response.prepare(request)
    for character in json.dumps(completion("SLOW")):
        await response.write(character.encode())
        await asyncio.sleep(0.1)
    return response


async def _cut(request: web.Request) -> web.StreamResponse:
    response = web.StreamResponse(headers={"Content-Length": "4000"})
    await response.prepare(request)
    await response.write(json.dumps(completion("SLOW"))[:60].encode())
    _drop(request, reset=False)
    return response


async def _cut_chunk(request: web.Request) -> web.StreamResponse:
    response = web.StreamResponse()
    response.enable_chunked_encoding()
    await response.prepare(request)
    await response.write(json.dumps(completion("SLOW"))[:60].encode())
    _drop(request, reset=False)
    return response


async def _reset(request: web.Request) -> web.StreamResponse:
    _drop(request, reset=True)
    await asyncio.sleep(0.05)
    return web.Response()


async def _huge(request: web.Request) -> web.StreamResponse:
    response = web.StreamResponse()
    await response.prepare(request)
    for _ in range(50):
        await response.write(b" " * 1_000_000)
    return response


async def _text(request: web.Request) -> web.Response:
    del request
    return web.Response(text="<html>Welcome to our proxy</html>", content_type="text/html")


async def _shape(request: web.Request) -> web.Response:
    del request
    return web.json_response({"result": "SLOW"})


async def _truncated(request: web.Request) -> web.Response:
    del request
    return answer("The vehicle ahead is", "length")


async def _empty(request: web.Request) -> web.Response:
    del request
    return answer("")


async def _refusal(request: web.Request) -> web.Response:
    del request
    return answer("I'm sorry, I can't assist with that.")


async def _filtered(request: web.Request) -> web.Response:
    del request
    return answer(None, "content_filter")


async def _bad(request: web.Request) -> web.Response:
    del request
    return refuse(400, "this model takes no picture", type="invalid_request_error")


async def _moved(request: web.Request) -> web.Response:
    del request
    return web.Response(status=307, headers={"Location": "http://127.0.0.1:9/"})


async def _upstream(request: web.Request) -> web.Response:
    del request
    return web.json_response({"error": {"code": 502, "message": "the upstream is down"}})


async def _fine(request: web.Request) -> web.Response:
    del request
    return answer()


def _drop(request: web.Request, *, reset: bool) -> None:
    transport = request.transport
    assert transport is not None
    if reset:
        sock = transport.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        transport.abort()
    else:
        transport.close()


FAULTS: dict[str, Handler] = {
    "fine": _always(_fine),
    "429": _once(_busy),
    "429 with Retry-After": _once(_busy_until),
    "500 once": _once(_broken),
    "500 for ever": _always(_broken),
    "hang": _always(_hang),
    "slow drip": _always(_drip),
    "body cut": _once(_cut),
    "chunks cut": _once(_cut_chunk),
    "connection reset": _once(_reset),
    "50 MB reply": _always(_huge),
    "no JSON": _always(_text),
    "JSON of another shape": _always(_shape),
    "truncated": _always(_truncated),
    "empty": _always(_empty),
    "refusal": _always(_refusal),
    "filtered": _always(_filtered),
    "400": _always(_bad),
    "redirect": _always(_moved),
    "upstream fails inside a 200": _once(_upstream),
}
"""Every fault by its name, in words that the tests use."""


_SILENT = logging.getLogger("eyechart.stand-ins")
"""What a stand-in's server logs, such as a client that left, is not what a command printed."""
_SILENT.disabled = True


class Loopback:
    """An application served on 127.0.0.1 by a thread of its own while the ``with`` block lasts."""

    def __init__(self, app: web.Application, port: int = 0) -> None:
        """Serve the application at this port, or at a free one."""
        self.port = port
        self._loop = asyncio.new_event_loop()
        self._runner = web.AppRunner(app, shutdown_timeout=0.1, access_log=None, logger=_SILENT)
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)

    def __enter__(self) -> Self:
        self._loop.run_until_complete(self._start())
        self._thread.start()
        return self

    async def _start(self) -> None:
        await self._runner.setup()
        await web.TCPSite(self._runner, "127.0.0.1", self.port).start()
        self.port = self._runner.addresses[0][1]

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        asyncio.run_coroutine_threadsafe(self._runner.cleanup(), self._loop).result(10)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(10)
        self._loop.close()


@dataclass
class FaultServer:
    """The server in a thread of its own; ``faults`` are dealt to the calls in the order in which they first come.

    ``requests`` counts what was asked, ``dealt`` says which call (by seed) got which fault.
    """

    faults: Sequence[str | Handler] = ("fine",)
    pause_s: float = 0.0
    requests: int = 0
    dealt: dict[int, str | Handler] = field(default_factory=dict)
    attempts: Counter[int] = field(default_factory=Counter)
    asked: list[dict[str, object]] = field(default_factory=list)
    headers: list[dict[str, str]] = field(default_factory=list)
    most_at_once: int = 0
    port: int = 0
    _now: int = 0

    @property
    def base_url(self) -> str:
        """Return the address for ``--base-url``."""
        return f"http://127.0.0.1:{self.port}/v1"

    async def handle(self, request: web.Request) -> web.StreamResponse:
        """Count a request, and deal its call's fault."""
        self.requests += 1
        self._now += 1
        self.most_at_once = max(self.most_at_once, self._now)
        try:
            asked = json.loads(await request.read())
            self.asked.append(asked)
            self.headers.append(dict(request.headers))
            await asyncio.sleep(self.pause_s)
            seed = int(asked.get("seed", 0))
            fault = self.dealt.setdefault(seed, self.faults[len(self.dealt) % len(self.faults)])
            self.attempts[seed] += 1
            handler = FAULTS[fault] if isinstance(fault, str) else fault
            return await handler(request, asked, self.attempts[seed])
        finally:
            self._now -= 1

    def app(self) -> web.Application:
        """Return the application."""
        app = web.Application(client_max_size=20_000_000)
        app.router.add_post("/v1/chat/completions", self.handle)
        return app

    def __enter__(self) -> Self:
        self._served = Loopback(self.app(), self.port)
        self._served.__enter__()
        self.port = self._served.port
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._served.__exit__(kind, error, trace)


def seeded_action(asked: dict[str, object]) -> str:
    """Return an action that depends on the request alone."""
    actions = ("STOP", "SLOW", "STRAIGHT", "LEFT", "RIGHT")
    return actions[hashlib.sha256(json.dumps(asked["messages"]).encode()).digest()[0] % len(actions)]


async def _seeded(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
    del request, attempt
    return answer(seeded_action(asked))


def main(pause_s: float) -> None:
    """Serve until killed; print the port, and then the seed of every request on a line of its own."""

    async def told(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        print(asked["seed"], flush=True)  # noqa: T201
        return await _seeded(request, asked, attempt)

    server = FaultServer([told], pause_s=pause_s)
    with server:
        print(server.port, flush=True)  # noqa: T201
        threading.Event().wait()


if __name__ == "__main__":
    main(float(sys.argv[1]))


SPENT = "You exceeded your current quota, please check your plan and billing details."


def gemini(delay: object = "45.837906927s", quota: str = "PerMinute", *, delayed: bool = True) -> dict[str, object]:
    """Return the body of a 429 as Gemini writes it."""
    failure = {"violations": [{"quotaId": f"GenerateRequests{quota}PerProjectPerModel-FreeTier"}]}
    details: list[object] = [{"@type": "type.googleapis.com/google.rpc.QuotaFailure", **failure}]
    if delayed:
        details.append({"@type": "type.googleapis.com/google.rpc.RetryInfo", "retryDelay": delay})
    return {"error": {"code": 429, "message": SPENT, "status": "RESOURCE_EXHAUSTED", "details": details}}
