"""Processes of ours that end with the one that began them, also where that one is killed."""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.context import SpawnContext, SpawnProcess

_PR_SET_PDEATHSIG = 1
_LOOK_EVERY_S = 1.0


@contextmanager
def open_pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of new interpreters, each of which ends when this process does, or is interrupted.

    They are spawned, not forked: a thread, as that of a progress bar, may hold a lock at the moment of a fork.
    """
    pool = ProcessPoolExecutor(processes, mp_context=_Deaf(), initializer=end_with, initargs=(os.getpid(),))
    try:
        yield pool
    except BaseException:
        for one in multiprocessing.active_children():  # what they are at may take minutes, and nobody wants it now
            one.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


class _DeafProcess(SpawnProcess):
    """An interpreter that a Ctrl-C of the terminal does not reach, from its first moment on: it is for its parent."""

    def start(self) -> None:
        """Begin it with SIGINT blocked, which it inherits; one that comes here meanwhile is heard afterwards."""
        if sys.platform == "win32":  # which has no masks of signals
            super().start()
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Deaf(SpawnContext):
    """Begins such processes."""

    Process = _DeafProcess


def end_with(parent: int) -> None:
    """Let this process end when its ``parent``, given by number, is no more, whatever it is doing then.

    The system is asked to see to it. Where it cannot, as on macOS, a thread looks every second.
    """
    if not _is_ended_by_the_system():
        threading.Thread(target=_end_after, args=(parent,), name="eyechart-parent", daemon=True).start()
    elif os.getppid() != parent:  # it went before the system was asked
        os._exit(1)


def _is_ended_by_the_system() -> bool:
    """Return whether the system now kills this process when its parent ends."""
    try:
        asked = ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        return int(asked) == 0
    except (AttributeError, OSError, TypeError):  # no such call here, or no library to look it up in
        return False


def _end_after(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOK_EVERY_S)
    os._exit(1)
