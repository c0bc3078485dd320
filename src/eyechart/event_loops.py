"""Event loops for calls: each run has its own, in another thread if one is running here."""

import asyncio
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from typing import Any, TypeVar

from eyechart.errors import SpecError

T = TypeVar("T")
Progress = Callable[[int, int], None]


def has_running_loop() -> bool:
    """Return whether an event loop is running in this thread."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


def require_no_loop() -> None:
    """Raise SpecError if an event loop is running in this thread, which allows no other."""
    if has_running_loop():
        raise SpecError(
            "an event loop is running already, as in a notebook, and this needs its own: call it in a thread "
            "(await asyncio.to_thread(...)), or use eyechart.api.run_battery or eyechart.studies.policy.run"
        )


def in_own_loop(run: "Coroutine[Any, Any, T]") -> T:
    """Return a coroutine's result from its own event loop, in a thread if one is running here."""
    if not has_running_loop():
        return to_its_end(run)
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(to_its_end, run).result()


def to_its_end(run: "Coroutine[Any, Any, T]") -> T:
    """Return a coroutine's result from its own event loop; the coroutine is always closed."""
    with closing(run):
        return asyncio.run(run)


def make_calls(run: Callable[..., T], progress: Progress | None) -> T:
    """Run a study with ``progress``, in a thread if a loop runs here; an interrupt ends both."""
    if not has_running_loop():
        return run(progress=progress)
    calls = _ThreadCalls(progress)
    with ThreadPoolExecutor(1) as thread:
        making = thread.submit(run, progress=calls.move)
        try:
            return making.result()
        except KeyboardInterrupt:
            calls.stop()
            raise


class _ThreadCalls:
    """The calls of another thread, which an interrupt of this one can end."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress = progress
        self._stopped = threading.Event()
        self._main: tuple[asyncio.AbstractEventLoop, asyncio.Task[object]] | None = None

    def move(self, done: int, total: int) -> None:
        """Pass the progress on; the first call comes from the main task and records it."""
        task = asyncio.current_task()
        if self._main is None and task is not None:
            self._main = (task.get_loop(), task)
        if self._stopped.is_set():
            raise KeyboardInterrupt
        if self._progress is not None:
            self._progress(done, total)

    def stop(self) -> None:
        """Cancel the calls under way; the ledger has them as sent with an unknown outcome."""
        self._stopped.set()
        if self._main is not None:
            loop, task = self._main
            with suppress(RuntimeError):  # the loop may have ended
                loop.call_soon_threadsafe(task.cancel)
