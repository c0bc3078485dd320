"""A host holds worlds in a process of its own; the coordinator asks it, and learns when it has died."""

import asyncio
import multiprocessing
import signal
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import Protocol

from eyechart.episodes.worlds import Setup, Worlds
from eyechart.errors import EyechartError

PATIENCE_S = 300.0
"""A world that takes longer for one step, or to begin, counts as dead."""

_ALIVE_EVERY_S = 1.0


class HostDiedError(EyechartError):
    """The process that held a world ended, or did not answer in time; with it went every world that it held."""


class Host(Protocol):
    """The door to a worker that holds worlds, wherever it is."""

    dead: bool

    async def ask(self, method: str, *given: object) -> object:
        """Call a method of the host's ``Worlds``; raises HostDiedError, and EyechartError for what it raised."""
        ...

    def close(self) -> None:
        """End the host and what it holds, whatever it is doing."""
        ...


class LocalHost:
    """A process of this machine, started afresh (``spawn``) and ended with this one."""

    def __init__(self, setup: Setup, *, patience_s: float = PATIENCE_S) -> None:
        self.dead = False
        self._patience_s = patience_s
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, setup), daemon=True)
        self._process.start()
        theirs.close()
        self._thread = ThreadPoolExecutor(1)

    async def ask(self, method: str, *given: object) -> object:
        """Ask, one question after another."""
        if self.dead:
            raise HostDiedError("its process had ended")
        kind, value = await asyncio.get_running_loop().run_in_executor(self._thread, self._exchange, method, given)
        if kind == "died":
            self.dead = True
            raise HostDiedError(str(value))
        if kind == "failed":
            raise EyechartError(str(value))
        return value

    def close(self) -> None:
        """Kill the process: what it holds can be made again."""
        self.dead = True
        self._process.kill()
        self._process.join()
        self._thread.shutdown(wait=True)
        self._ours.close()
        self._process.close()

    def _exchange(self, method: str, given: tuple[object, ...]) -> tuple[str, object]:
        try:
            self._ours.send((method, given))
            while self._ours.poll(self._patience_s):
                kind, value = self._ours.recv()
                if kind != "alive":
                    return kind, value
        except (EOFError, OSError):
            self._process.join(_ALIVE_EVERY_S)
            return "died", f"its process ended with exit code {self._process.exitcode}"
        self._process.kill()
        return "died", f"it did not answer for {self._patience_s:g} s"


def serve(connection: Connection, setup: Setup) -> None:
    """Answer questions until nobody asks any more; an interrupt is the coordinator's to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    worlds: Worlds | None = None
    try:
        while True:
            method, given = connection.recv()
            try:
                worlds = worlds or Worlds(setup)
                more = (_every(_ALIVE_EVERY_S, lambda: connection.send(("alive", None))),) if method == "drive" else ()
                answer = ("ok", getattr(worlds, method)(*given, *more))
            except Exception as error:  # noqa: BLE001 - the coordinator must hear of it, or it waits for ever
                answer = ("failed", f"{type(error).__name__}: {error}")
            connection.send(answer)
    except (EOFError, OSError):
        return  # the coordinator is gone


def _every(seconds: float, tell: Callable[[], None]) -> Callable[[], None]:
    """Return a function that tells at most once in so many seconds, however often it is called."""
    last = time.monotonic()

    def maybe() -> None:
        nonlocal last
        if time.monotonic() - last >= seconds:
            last = time.monotonic()
            tell()

    return maybe
