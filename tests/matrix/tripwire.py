"""Has the n-th opening, change, lock, statement or start of a process within eyechart fail."""

import builtins
import errno
import fcntl
import functools
import io
import json
import os
import socket
import sqlite3
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

WIRES: dict[str, tuple[int, ...]] = {
    "open": (errno.EMFILE, errno.EIO, errno.EACCES),
    "change": (errno.ENOSPC, errno.EIO),
    "lock": (errno.ENOLCK, errno.EOPNOTSUPP),
    "statement": (errno.EIO, errno.ENOSPC),
    "process": (errno.EAGAIN,),
    "accept": (errno.EMFILE,),
    "temporary": (errno.ENOSPC,),
}
"""What can fail, and how."""
_SQL = {errno.EIO: "disk I/O error", errno.ENOSPC: "database or disk is full"}


def place_of(code: CodeType, source: Path) -> str | None:
    """Return ``module:function`` of code that stands in a source tree, as the finder writes it."""
    file = code.co_filename
    if not file.startswith(f"{source}{os.sep}"):
        return None
    module = file[len(str(source)) + 1 :].removesuffix(".py").replace(os.sep, ".").removesuffix(".__init__")
    return f"{module}:{code.co_qualname.replace('.<locals>', '')}"


class Tripwire:
    """Counts what a command does of a kind, and has the n-th fail; 0 counts alone. To be set in the command's child."""

    def __init__(self, wire: str, nth: int, number: int, folder: Path, source: Path) -> None:
        self.wire, self.nth, self.number, self.folder, self.source = wire, nth, number, folder, source
        self.doors: list[str] = []

    def caller(self) -> str | None:
        """Return the innermost function of the source that is being called; None where a library acts by itself."""
        frame: FrameType | None = sys._getframe(2)
        while frame is not None:
            if place := place_of(frame.f_code, self.source):
                return place
            frame = frame.f_back
        return None

    def trip(self, path: object = "") -> bool:
        """Count one; return whether it is the one that fails."""
        if isinstance(path, str | os.PathLike) and (text := os.fspath(path)) and Path(text).is_absolute():
            if not str(text).startswith(str(self.folder)):
                return False
        elif not isinstance(path, str | os.PathLike):
            return False
        door = self.caller()
        if door is None or door.startswith("eyechart.cli:"):
            return False
        self.doors.append(door)
        return len(self.doors) == self.nth

    def wrap(self, holder: Any, name: str) -> None:  # noqa: ANN401 - a module or a class
        """Have a function of a holder pass the wire first."""
        usual: Callable[..., Any] = getattr(holder, name)
        takes_path = name in {"open", "replace", "rename", "link", "mkdir"}

        @functools.wraps(usual)
        def wired(*given: Any, **named: Any) -> Any:  # noqa: ANN401 - whatever it is
            if self.trip(given[0] if takes_path and given else ""):
                raise OSError(self.number, os.strerror(self.number), given[0] if takes_path else None)
            return usual(*given, **named)

        setattr(holder, name, wired)

    def __call__(self) -> Callable[[], None]:
        """Set the wire; return what writes down which doors passed it."""
        for holder, name in {
            "open": ((builtins, "open"), (io, "open"), (os, "open")),
            "change": ((os, "replace"), (os, "rename"), (os, "link"), (os, "mkdir"), (os, "fsync"), (os, "sendfile")),
            "lock": ((fcntl, "flock"),),
            "process": ((subprocess.Popen, "_execute_child"),),
            "accept": ((socket.socket, "accept"),),
            "temporary": ((tempfile, "mkdtemp"),),
        }.get(self.wire, ()):
            self.wrap(holder, name)
        if self.wire == "statement":
            self._wrap_sql()
        return lambda: (self.folder / "hits").write_text(json.dumps(self.doors)) and None

    def _wrap_sql(self) -> None:
        wire, usual = self, sqlite3.connect

        class Failing(sqlite3.Connection):
            def execute(self, *given: Any) -> sqlite3.Cursor:  # type: ignore[override]  # noqa: ANN401
                if wire.trip(""):
                    raise sqlite3.OperationalError(_SQL[wire.number])
                return super().execute(*given)

        def connect(*given: Any, **named: Any) -> sqlite3.Connection:  # noqa: ANN401 - SQLite's own
            return usual(*given, **{"factory": Failing, **named})

        sqlite3.connect = connect  # type: ignore[assignment]


class Trace:
    """Notes which functions of a source tree a command calls."""

    def __init__(self, folder: Path, source: Path) -> None:
        self.folder, self.source = folder, source
        self.seen: set[CodeType] = set()

    def __call__(self) -> Callable[[], None]:
        """Begin; return what writes them down."""

        def noticed(frame: FrameType, event: str, _: object) -> None:
            if event == "call":
                self.seen.add(frame.f_code)

        threading.setprofile(noticed)
        sys.setprofile(noticed)

        def end() -> None:
            sys.setprofile(None)
            places = {place for code in set(self.seen) if (place := place_of(code, self.source))}
            (self.folder / "hits").write_text(json.dumps(sorted(places)))

        return end
