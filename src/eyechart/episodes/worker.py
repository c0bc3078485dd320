"""The program of a worker process: it holds worlds and answers questions about them until nobody asks any more."""

import sys
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from eyechart.episodes.worlds import Setup, Worlds

ALIVE_EVERY_S = 1.0


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
    """Serve the socket whose number is the only argument; the coordinator's end is an end like any other."""
    try:
        serve(Connection(int(sys.argv[1])))
    except (EOFError, OSError, _GoneError):
        return
