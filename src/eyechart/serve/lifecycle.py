"""The life of a server: it listens, warms up its models, serves, and ends.

It ends on SIGINT or SIGTERM at any time: current requests are answered, new ones get 503. A second
signal ends the process at once.
"""

import asyncio
import errno
import os
import signal
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress

from aiohttp import web

from eyechart.errors import GuardianError
from eyechart.guardian import Guardian
from eyechart.serve.host_names import HostNames
from eyechart.serve.server import Server, ServerLimits, application

_TELLING_S = 5.0
_LINGERING_S = 1.0
"""The time to read the rest of a refused body, in seconds: its sender then sees the refusal."""
_ENDING_S = 0.5
"""Requests without an answer at their deadline end within twice this time, in seconds."""


async def serve(
    guardian: Guardian,
    *,
    host: str = "127.0.0.1",
    port: int = 8600,
    limits: ServerLimits | None = None,
    warm_up_s: float = 0.0,
    tell: Callable[[str], None] = lambda _: None,
    started: Callable[[str], None] = lambda _: None,
    until: Callable[[], Awaitable[object]] | None = None,
) -> None:
    """Serve a guardian until SIGINT or SIGTERM, or until ``until`` returns.

    Current requests are answered before the end. Each model first gets a blank picture, for at most
    ``warm_up_s``, since a first answer may take long. ``tell`` gets messages on that; a model that
    fails ends nothing. ``started`` then gets the address; port 0 takes a free port. Pictures are
    answered from the beginning. Raises GuardianError where the address is in use or malformed.
    """

    async def live() -> None:
        if warm_up_s > 0:
            await _warm_up(guardian, warm_up_s, tell)
        started(url)
        await (until() if until else asyncio.Event().wait())

    over = asyncio.Event()
    with _signalled(over) if until is None else nullcontext():
        app, server = application(guardian, limits)
        runner = _runner(app, server)
        await runner.setup()
        keeper = asyncio.create_task(server.tend(lambda: list(runner.server.connections) if runner.server else []))
        listening: asyncio.Server | None = None
        try:
            listening, url = await _listen(runner, server, host, port)
            await _first(live(), over.wait())
            await _drain(server, tell)
        finally:
            if listening is not None:
                listening.close()
            keeper.cancel()
            with suppress(asyncio.CancelledError):
                await keeper
            await runner.cleanup()


@contextmanager
def _signalled(over: asyncio.Event) -> Iterator[None]:
    """Set an event at the first signal to end; the second one has its default effect."""
    loop, ends = asyncio.get_running_loop(), (signal.SIGINT, signal.SIGTERM)

    def heard(one: signal.Signals) -> None:
        if over.is_set():
            signal.signal(one, signal.SIG_DFL)
            os.kill(os.getpid(), one)
        over.set()

    for end in ends:
        loop.add_signal_handler(end, heard, end)
    try:
        yield
    finally:
        for end in ends:
            loop.remove_signal_handler(end)


def _runner(app: web.Application, server: Server) -> web.AppRunner:
    return web.AppRunner(
        app,
        shutdown_timeout=_ENDING_S,
        lingering_time=_LINGERING_S,
        auto_decompress=False,
        **server.connections.head(),
    )


async def _listen(runner: web.AppRunner, server: Server, host: str, port: int) -> tuple[asyncio.Server, str]:
    """Listen; return the listening server and its address, and set the server's names."""
    handlers = runner.server
    assert handlers is not None
    connection = server.connections.accepting(handlers, lambda: server.metrics.requests.labels("503").inc())
    loop = asyncio.get_running_loop()
    try:
        listening = await loop.create_server(connection, host, port, start_serving=False)
    except OSError as error:
        other = "--port" if error.errno in {errno.EADDRINUSE, errno.EACCES} else "--host"
        raise GuardianError(f"cannot listen on {host}:{port}: {error.strerror}; give another {other}") from error
    except UnicodeError as error:
        raise GuardianError(f"{host[:80]!r} is no address to listen on; give another --host") from error
    bound = [socket.getsockname() for socket in listening.sockets]
    server.names = HostNames.of(server.limits.hosts, [address for address, *_ in bound])
    await listening.start_serving()
    name, number = bound[0][:2]
    return listening, f"http://{f'[{name}]' if ':' in name else name}:{number}"


async def _first(*works: Awaitable[object]) -> None:
    """Wait for the first of several tasks and cancel the others; raises its exception."""
    tasks = [asyncio.ensure_future(one) for one in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for one in done:
            one.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _drain(server: Server, tell: Callable[[str], None]) -> None:
    """Refuse new requests, and wait for the answers to current ones, at most to their deadline."""
    server.ending = True
    if server.under_way:
        tell(f"ending: {server.under_way} requests are answered first")
    with suppress(TimeoutError):
        async with asyncio.timeout(server.guardian.deadline_s + 1):
            await server.quiet.wait()


async def _warm_up(guardian: Guardian, limit_s: float, tell: Callable[[str], None]) -> None:
    """Call each model once, and report every few seconds that it still runs."""
    tell(f"calling each of {len(guardian.models)} models once, for at most {limit_s:g} s")
    task, start = asyncio.create_task(guardian.warm_up(limit_s)), time.perf_counter()
    try:
        while not (await asyncio.wait([task], timeout=_TELLING_S))[0]:
            tell(f"still waiting for a first reply after {time.perf_counter() - start:.0f} s")
        for spec, why in (await task).items():
            tell(f"warning: '{spec}' does not answer: {why}; without its votes nothing is called clear")
    finally:
        task.cancel()
