"""Workers: processes that hold worlds, and their connection to the coordinator.

Both ends are here: the coordinator's calls, and the program that answers until the connection ends.
"""

import asyncio
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
from eyechart.modes import in_one_line
from eyechart.processes import end_with

PATIENCE_S = 300.0
"""A world that takes longer for one step, or to begin, counts as dead."""

_DYING_S = 5.0
ALIVE_EVERY_S = 1.0
_PROGRAM = "from eyechart.episodes.workers import main; main()"


class WorkerDiedError(EyechartError):
    """The process of a worker ended or did not answer in time; all its worlds are lost."""


class Worker(Protocol):
    """The interface of a worker that holds worlds, wherever it is."""

    dead: bool

    async def ask(self, method: str, *given: object) -> object:
        """Call a method of the worker's ``Worlds``.

        Raises WorkerDiedError, and EyechartError for the method's own errors.
        """

    def close(self) -> None:
        """End the worker and its worlds at once."""


class LocalWorker:
    """A process of this machine, which ends with this one.

    It is a new interpreter, not a fork. It shares no locks, threads or open files, and runs no part
    of the program that began the run.
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
                stdout=subprocess.DEVNULL,  # libraries must not print into our output
                env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
                process_group=0,  # an interrupt from the terminal is the coordinator's to handle
            )
        self._connection: Connection[Any, Any] = Connection(ours.detach())
        self._thread = ThreadPoolExecutor(1)
        with suppress(OSError):  # the first call will report it
            self._connection.send(setup)

    async def ask(self, method: str, *given: object) -> object:
        """Call a method of the worlds; calls run one after another."""
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
        """Kill the process; its worlds can be made again."""
        self.dead = True
        self._process.kill()
        self._process.wait()
        self._thread.shutdown(wait=True)
        self._connection.close()

    def _exchange(self, method: str, given: tuple[object, ...]) -> tuple[str, object]:
        try:
            self._connection.send((method, given))
            # On a busy machine a starting interpreter is slow, but no world hangs.
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
    """Serve a connection: receive the setup, then calls of the worlds' methods, and answer each."""
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
        except Exception as error:  # noqa: BLE001 - without an answer the coordinator waits for ever
            answer = "failed", in_one_line(error, 2000)
        _send(connection, answer)


class _GoneError(Exception):
    """The other end of the connection is closed."""


def _send(connection: "Connection[Any, Any]", answer: tuple[str, object]) -> None:
    try:
        connection.send(answer)
    except OSError as error:
        raise _GoneError from error


def _every(seconds: float, tell: Callable[[], None]) -> Callable[[], None]:
    """Return a function that calls ``tell`` at most once in ``seconds``."""
    last = time.monotonic()

    def maybe() -> None:
        nonlocal last
        if time.monotonic() - last >= seconds:
            last = time.monotonic()
            tell()

    return maybe


def main() -> None:
    """Serve the socket of the first argument while the coordinator of the second lives."""
    end_with(int(sys.argv[2]))
    try:
        serve(Connection(int(sys.argv[1])))
    except (EOFError, OSError, _GoneError):
        return
