"""Folders for what is copied to be read: gone at the end, and those of a process that was killed at the next start."""

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

_HELD = ".held"
"""What its process holds a lock of, which ends with it; its number would mean nothing beside another container's."""
_YOUNG_S = 5.0
"""A younger folder may not be held yet."""


@contextmanager
def scratch(what: str) -> Iterator[Path]:
    """Yield an empty folder for a copy of ``what``, while the block lasts."""
    _clear(tempfile.gettempdir())
    with tempfile.TemporaryDirectory(prefix=f"eyechart-{what}-") as folder, _held(Path(folder)):
        made = Path(folder) / "made"
        made.mkdir()
        yield made


@contextmanager
def _held(folder: Path) -> Iterator[bool]:
    """Hold a folder, and yield whether nobody else does; where there are no such locks it is never free."""
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
    """Remove what nobody holds; once a process, which may look into thousands of ledgers."""
    for one in Path(where).glob("eyechart-*/" + _HELD):
        with suppress(OSError):  # another's, or gone meanwhile
            old = time.time() - one.stat().st_mtime > _YOUNG_S
            if not one.parent.is_symlink() and one.parent.stat().st_uid == os.getuid() and old:
                with _held(one.parent) as free:
                    if free:
                        shutil.rmtree(one.parent, ignore_errors=True)
