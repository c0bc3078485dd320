"""A host holds worlds in a process of its own; the coordinator asks it, and learns when it has died."""

import asyncio
import os
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, Protocol

from eyechart.episodes.worlds import Setup
from eyechart.errors import EyechartError

PATIENCE_S = 300.0
"""A world that takes longer for one step, or to begin, counts as dead."""

_DYING_S = 5.0
_PROGRAM = "from eyechart.episodes.worker import main; main()"


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
    """A process of this machine, which ends with this one.

    It is a new interpreter, not a fork: it shares no locks, threads or open files, and runs none of the program that
    began the run.
    """

    def __init__(self, setup: Setup, *, patience_s: float = PATIENCE_S) -> None:
        self.dead = False
        self._patience_s, self._begun = patience_s, False
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(  # noqa: S603 - our own program
                [sys.executable, "-P", "-c", _PROGRAM, str(theirs.fileno())],
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
