"""How a server ends: on a signal at any time, with what is under way answered, and at once on a second one."""

import asyncio
import json
import signal
import socket
import sys
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path

import aiohttp
import pytest
from aiohttp import web

from eyechart.studies.guardian import write_frozen
from test_serve import BENCH, FAR, PNG

SERVE = ("-c", "from eyechart.cli import main; main()", "serve")
TERM, INT = signal.SIGTERM, signal.SIGINT


class Members:
    """A model server that holds its replies until it may go on, and knows how many it was asked for."""

    def __init__(self) -> None:
        self.asked, self.go_on = 0, asyncio.Event()

    async def answer(self, request: web.Request) -> web.Response:
        """Say that the road is clear."""
        self.asked += 1
        await request.read()
        await self.go_on.wait()
        return await BENCH.answer(request)

    async def were_asked(self, times: int) -> None:
        """Wait until so many replies are asked for."""
        async with asyncio.timeout(30):
            while self.asked < times:  # noqa: ASYNC110 - a counter
                await asyncio.sleep(0.01)


class Process:
    """``eyechart serve`` as a process of its own."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.process, self.told = process, ""
        self.reading = asyncio.create_task(self._read())

    async def _read(self) -> None:
        assert self.process.stderr is not None
        while line := await self.process.stderr.readline():
            self.told += line.decode()

    async def has_told(self, words: str) -> None:
        """Wait until it printed these words."""
        async with asyncio.timeout(30):
            while words not in self.told:  # noqa: ASYNC110 - what it prints
                await asyncio.sleep(0.01)

    async def ended(self) -> int:
        """Return its exit code; whatever it was, it printed no traceback."""
        async with asyncio.timeout(30):
            code = await self.process.wait()
            await self.reading
        assert "Traceback" not in self.told, self.told
        assert "Error" not in self.told, self.told
        return code


@pytest.fixture
def port() -> int:
    """Return a port that nobody listens on."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


Ask = Callable[[Members, Process, aiohttp.ClientSession, str], Awaitable[None]]


def running(ask: Ask, folder: Path, *words: str, port: int) -> None:
    """Run a server whose two members hold their replies."""

    async def run() -> None:
        members = Members()
        app = web.Application(client_max_size=10_000_000)
        app.router.add_post("/v1/chat/completions", members.answer)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=0.1)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        path = folder / "guardian.json"
        write_frozen(path, BENCH.frozen([f"http://127.0.0.1:{runner.addresses[0][1]}/v1"] * 2))
        process = await asyncio.create_subprocess_exec(
            sys.executable, *SERVE, str(path), "--port", str(port), *words, stderr=asyncio.subprocess.PIPE
        )
        one = Process(process)
        try:
            async with aiohttp.ClientSession(timeout=aiohttp.ClientTimeout(total=30)) as session:
                await ask(members, one, session, f"http://127.0.0.1:{port}")
        finally:
            if process.returncode is None:
                process.kill()
            await process.wait()
            await runner.cleanup()

    asyncio.run(run())


async def assess(session: aiohttp.ClientSession, url: str) -> tuple[int, dict[str, object]]:
    """Ask about a free road."""
    async with session.post(f"{url}/assess", data=FAR, headers=PNG) as came:
        return came.status, await came.json()


async def refused(session: aiohttp.ClientSession, url: str) -> tuple[int, object, str]:
    """Ask a server that ends, on a connection of its own."""
    async with session.get(f"{url}/health", headers={"Connection": "close"}) as came:
        return came.status, (await came.json())["error"], came.headers["Connection"]


@pytest.mark.parametrize(("moment", "one"), [("warm-up", TERM), ("serving", INT)])
def test_what_is_under_way_is_answered_and_what_comes_is_refused(
    moment: str, one: signal.Signals, tmp_path: Path, port: int
) -> None:
    """While its models are first asked, and later: the answer comes whole, others get 503, and the exit code is 0."""

    async def ask(members: Members, process: Process, session: aiohttp.ClientSession, url: str) -> None:
        await process.has_told("calling each of 2 models once" if moment == "warm-up" else f" at {url}")
        warm = 2 * (moment == "warm-up")
        await members.were_asked(warm)
        answer = asyncio.create_task(assess(session, url))
        await members.were_asked(warm + 4)
        process.process.send_signal(one)
        await process.has_told("ending: 1 requests are answered first")
        assert await refused(session, url) == (503, "the server is ending", "close")
        assert not answer.done()
        members.go_on.set()
        status, said = await answer
        assert (status, said["answer"]) == (200, "clear")
        assert await process.ended() == 0
        assert process.told.rstrip().endswith("stopped")

    warm_up = () if moment == "warm-up" else ("--no-warm-up",)
    running(ask, tmp_path, "--deadline", "20", *warm_up, port=port)


def test_a_second_signal_ends_at_once(tmp_path: Path, port: int) -> None:
    """By the signal, as any program ends that heeds none; nobody waits for the deadline."""

    async def ask(members: Members, process: Process, session: aiohttp.ClientSession, url: str) -> None:
        await process.has_told(f" at {url}")
        answer = asyncio.create_task(assess(session, url))
        await members.were_asked(4)
        process.process.send_signal(TERM)
        await process.has_told("ending: ")
        process.process.send_signal(TERM)
        assert await process.ended() == -TERM
        with pytest.raises(aiohttp.ClientError):
            await answer

    running(ask, tmp_path, "--deadline", "600", "--no-warm-up", port=port)


def test_a_server_that_nobody_asks_ends_at_once_also_while_it_asks_its_models(tmp_path: Path, port: int) -> None:
    """A model that never answers holds nothing up."""

    async def ask(members: Members, process: Process, session: aiohttp.ClientSession, url: str) -> None:
        del session, url
        await members.were_asked(2)
        process.process.send_signal(TERM)
        assert await process.ended() == 0
        assert "ending" not in process.told
        assert json.dumps(process.told).count("calling each") == 1

    running(ask, tmp_path, "--deadline", "600", port=port)


def test_a_reader_that_never_reads_holds_a_server_no_longer_than_its_deadline(tmp_path: Path, port: int) -> None:
    """Its answers fill the buffers, and their writing never ends."""

    async def ask(members: Members, process: Process, session: aiohttp.ClientSession, url: str) -> None:
        del members, session
        await process.has_told(f" at {url}")
        with socket.socket() as one:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
            one.connect(("127.0.0.1", port))
            one.setblocking(False)
            with suppress(BlockingIOError):
                while one.send(b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n" * 100):
                    pass
            await asyncio.sleep(1)
            process.process.send_signal(TERM)
            begun = asyncio.get_running_loop().time()
            assert await process.ended() == 0
            assert asyncio.get_running_loop().time() - begun < 4 + 1 + 4

    running(ask, tmp_path, "--deadline", "4", "--no-warm-up", port=port)
