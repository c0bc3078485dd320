"""A worker holds worlds in a process of its own; the coordinator asks it, and learns when it has died.

Both ends stand here: what the coordinator asks, and the program that answers until nobody asks any
more.
"""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, Protocol

from eyechart.episodes.worlds import Setup, Worlds
from eyechart.errors import EyechartError
from eyechart.loops import asyncio
from eyechart.processes import end_with

PATIENCE_S = 300.0
"""A world that takes longer for one step, or to begin, counts as dead."""

_DYING_S = 5.0
ALIVE_EVERY_S = 1.0
_PROGRAM = "from eyechart.episodes.workers import main; main()"


class WorkerDiedError(EyechartError):
    """The process that held a world ended, or did not answer in time; with it went every world that it held."""


class Worker(Protocol):
    """The door to a worker that holds worlds, wherever it is."""

    dead: bool

    async def ask(self, method: str, *given: object) -> object:
        """Call a method of the worker's ``Worlds``; raises WorkerDiedError, and EyechartError for what it raised."""

    def close(self) -> None:
        """End the worker and what it holds, whatever it is doing."""


class LocalWorker:
    """A process of this machine, which ends with this one.

    It is a new interpreter, not a fork: it shares no locks, threads or open files, and runs none of
    the program that began the run.
    """

    def __init__(self, setup: Setup, *, patience_s: float = PATIENCE_S) -> None:
        self.dead = False
        self._patience_s, self._begun = patience_s, False
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(  # noqa: S603 - our own program
                [sys.executable, "-P", "-c", _PROGRAM, str(theirs.fileno()), str(os.getpid())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,  # what a library prints is no output of ours
                env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
                process_group=0,  # an interrupt from the terminal is the coordinator's to handle
            )
        self._connection: Connection[Any, Any] = Connection(ours.detach())
        self._thread = ThreadPoolExecutor(1)
        with suppress(OSError):  # the first question will tell
            self._connection.send(setup)

    async def ask(self, method: str, *given: object) -> object:
        """Ask, one question after another."""
        if self.dead:
            raise WorkerDiedError("its process had ended")
        kind, value = await asyncio.get_running_loop().run_in_executor(self._thread, self._exchange, method, given)
        if kind == "died":
            self.dead = True
            raise WorkerDiedError(str(value))
        if kind == "failed":
            raise EyechartError(str(value))
        return value

    def close(self) -> None:
        """Kill the process: what it holds can be made again."""
        self.dead = True
        self._process.kill()
        self._process.wait()
        self._thread.shutdown(wait=True)
        self._connection.close()

    def _exchange(self, method: str, given: tuple[object, ...]) -> tuple[str, object]:
        try:
            self._connection.send((method, given))
            # an interpreter that only starts, on a busy machine, is no world that hangs
            while self._connection.poll(self._patience_s if self._begun else max(PATIENCE_S, self._patience_s)):
                kind, value = self._connection.recv()
                self._begun = True
                if kind != "alive":
                    return kind, value
        except (EOFError, OSError):
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_DYING_S)
            return "died", f"its process ended with exit code {self._process.returncode}"
        self._process.kill()
        return "died", f"it did not answer for {self._patience_s:g} s"


def serve(connection: "Connection[Any, Any]") -> None:
    """Say "alive" and answer: first comes the setup, then a method's name with what it is given, again and again."""
    _send(connection, ("alive", None))
    setup = connection.recv()
    assert isinstance(setup, Setup)
    worlds: Worlds | None = None
    alive = _every(ALIVE_EVERY_S, lambda: _send(connection, ("alive", None)))
    while True:
        method, given = connection.recv()
        try:
            worlds = worlds or Worlds(setup)
            answer = "ok", getattr(worlds, method)(*given, *((alive,) if method == "drive" else ()))
        except _GoneError:
            raise
        except Exception as error:  # noqa: BLE001 - the coordinator must hear of it, or it waits for ever
            answer = "failed", f"{type(error).__name__}: {error}"
        _send(connection, answer)


class _GoneError(Exception):
    """Nobody is at the other end any more."""


def _send(connection: "Connection[Any, Any]", answer: tuple[str, object]) -> None:
    try:
        connection.send(answer)
    except OSError as error:
        raise _GoneError from error


def _every(seconds: float, tell: Callable[[], None]) -> Callable[[], None]:
    """Return a function that tells at most once in so many seconds, however often it is called."""
    last = time.monotonic()

    def maybe() -> None:
        nonlocal last
        if time.monotonic() - last >= seconds:
            last = time.monotonic()
            tell()

    return maybe


def main() -> None:
    """Serve the socket whose number is the first argument, while the coordinator lives, whose number is the second."""
    end_with(int(sys.argv[2]))
    try:
        serve(Connection(int(sys.argv[1])))
    except (EOFError, OSError, _GoneError):
        return
