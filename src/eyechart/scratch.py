"""Temporary folders: removed at the end, or at the next start if their process was killed."""

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

_HELD = ".held"
"""The file that its process locks; a process id would mean nothing in another container."""
_MADE = "made"
_OURS = ".scratch"
"""An empty folder has no lock, so its name alone says that it is no user's."""
_YOUNG_S = 5.0
"""A younger folder may not be locked yet."""


@contextmanager
def scratch(what: str) -> Iterator[Path]:
    """Yield an empty folder for a copy of ``what`` during the block."""
    _clear(tempfile.gettempdir())
    with tempfile.TemporaryDirectory(prefix=f"eyechart-{what}-", suffix=_OURS) as folder, _held(Path(folder)):
        made = Path(folder) / _MADE
        made.mkdir()
        try:
            yield made
        finally:  # a kill from here on leaves a folder that has its lock, or an empty one
            shutil.rmtree(made, ignore_errors=True)


@contextmanager
def _held(folder: Path) -> Iterator[bool]:
    """Lock a folder, and yield whether it was free; never free where there are no such locks."""
    try:
        import fcntl  # noqa: PLC0415 - Windows has none
    except ImportError:
        yield False
        return
    with (folder / _HELD).open("ab") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            yield False
        else:
            yield True


@cache
def _clear(where: str) -> None:
    """Remove unlocked folders and empty ones, once per process, which may open thousands of ledgers."""
    for path in Path(where).glob(f"eyechart-*-????????{_OURS}"):
        with suppress(OSError):  # another user's, in use, or gone
            if path.stat().st_uid == os.getuid() and time.time() - path.stat().st_mtime > _YOUNG_S:
                path.rmdir()
    for path in Path(where).glob("eyechart-*/" + _HELD):
        with suppress(OSError):  # another user's, or gone
            old = time.time() - path.stat().st_mtime > _YOUNG_S
            if not path.parent.is_symlink() and path.parent.stat().st_uid == os.getuid() and old:
                with _held(path.parent) as free:
                    if free:
                        shutil.rmtree(path.parent / _MADE, ignore_errors=True)
                        shutil.rmtree(path.parent, ignore_errors=True)
