"""Child processes that end with their parent, even if that is killed."""

import ctypes
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.context import SpawnContext, SpawnProcess

_PR_SET_PDEATHSIG = 1
_LOOK_EVERY_S = 1.0


@contextmanager
def open_pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of new interpreters that end when this process ends or is interrupted.

    They are spawned, not forked: a thread, such as a progress bar's, may hold a lock during a fork.
    """
    pool = ProcessPoolExecutor(processes, mp_context=_DeafContext(), initializer=end_with, initargs=(os.getpid(),))
    try:
        yield pool
    except BaseException:
        for active_child in multiprocessing.active_children():  # their work may take minutes
            active_child.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def begin_program(words: Sequence[str], environment: Mapping[str, str]) -> subprocess.Popen[bytes]:
    """Start a program with pipes for its input, output and errors.

    The terminal's Ctrl-C does not reach it. It must end with its input: the system closes that when
    this process ends, however it ends. Raises OSError where it cannot be started.
    """
    pipe = subprocess.PIPE
    return subprocess.Popen(  # noqa: S603 - its caller names the program
        words, stdin=pipe, stdout=pipe, stderr=pipe, env=environment, process_group=0
    )


class _DeafProcess(SpawnProcess):
    """An interpreter that the terminal's Ctrl-C does not reach: only its parent handles it."""

    def start(self) -> None:
        """Start it with SIGINT blocked, which it inherits; a SIGINT to this process comes later."""
        if sys.platform == "win32":  # Windows has no signal masks
            super().start()
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _DeafContext(SpawnContext):
    """The context that starts such processes."""

    Process = _DeafProcess


def end_with(parent: int) -> None:
    """End this process when its ``parent`` (a process id) is gone, whatever it is doing.

    The system does that. Where it cannot, as on macOS, a thread checks every second.
    """
    if not _is_ended_by_the_system():
        threading.Thread(target=_end_after, args=(parent,), name="eyechart-parent", daemon=True).start()
    elif os.getppid() != parent:  # the parent ended before this request
        os._exit(1)


def _is_ended_by_the_system() -> bool:
    """Return whether the system now kills this process when its parent ends."""
    try:
        result = ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        return int(result) == 0
    except (AttributeError, OSError, TypeError):  # no such call or library here
        return False


def _end_after(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOK_EVERY_S)
    os._exit(1)
