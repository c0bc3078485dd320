"""A stage on which a command of eyechart runs: a forked child with a folder, limits and hooks of its own.

All of eyechart is imported once, and every command is a fork of that: a start costs milliseconds and not seconds.
"""

import importlib
import os
import pkgutil
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

ADDRESSES = 3 << 30
"""Bytes of addresses that a command may take, more than an ordinary one needs."""
GRACE_S = 10.0
_HEAVY = ("torch", "transformers", "ray", "datasets")
_LATE = (
    "pyarrow.parquet",
    "av",
    "PIL.PngImagePlugin",
    "PIL.WebPImagePlugin",
    "scipy.stats",
    "typer._adapters",
    "rich.progress",
)
"""What commands import when they need it: a fork would do so anew."""


Hook = Callable[[], Callable[[], None] | None]
"""What is called in a command's child before it, and returns what is called after it."""


@dataclass(frozen=True)
class Limits:
    """What a command may take: seconds of clock and of processor, addresses, a file's bytes, descriptors."""

    clock_s: float = 60.0
    cpu_s: int = 40
    addresses: int | None = None
    file_bytes: int | None = None
    descriptors: int | None = None


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code (None: it did not), what it printed, its peak in kB, and what it left."""

    code: int | None
    out: str
    err: str
    peak_kb: int
    cpu_s: float
    processes: tuple[str, ...] = ()
    temporary: tuple[str, ...] = ()


def load() -> None:
    """Import all of eyechart, but what needs a library that is not there or takes long; and the parsers it uses."""
    import eyechart  # noqa: PLC0415 - of the tree that is tried

    for package in pkgutil.walk_packages(eyechart.__path__, "eyechart."):
        if not any(name in package.name for name in ("huggingface", "ray", "drone", "__main__", "eyechart.inspect")):
            with suppress(ImportError):
                importlib.import_module(package.name)
    for name in _LATE:
        with suppress(ImportError):
            importlib.import_module(name)


def limit(limits: Limits) -> None:
    """Hold this process to limits."""
    for what, most in (
        (resource.RLIMIT_CPU, limits.cpu_s),
        (resource.RLIMIT_AS, limits.addresses),
        (resource.RLIMIT_FSIZE, limits.file_bytes),
        (resource.RLIMIT_NOFILE, limits.descriptors),
    ):
        if most is not None:
            resource.setrlimit(what, (most, most))
    if limits.file_bytes is not None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)


def in_session(session: int) -> list[str]:
    """Return the processes of a session that run, each as its number and its name."""
    result = []
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            name, _, rest = (path / "stat").read_text().partition("(")[2].rpartition(")")
            state, _, _, its = rest.split()[:4]
            if int(its) == session and state != "Z":
                result.append(f"{path.name} {name}")
    return result


def begin(
    words: Sequence[str],
    folder: Path,
    *,
    limits: Limits = Limits(),
    environment: Mapping[str, str] | None = None,
    hook: Hook | None = None,
) -> int:
    """Fork a command into a session and a folder of its own; ``hook`` is called in it first. Returns its number."""
    (folder / "tmp").mkdir(exist_ok=True)
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child:
        return child
    code = 70
    try:
        code = _perform(words, folder, limits, environment or {}, hook)
    finally:
        with suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _perform(
    words: Sequence[str],
    folder: Path,
    limits: Limits,
    environment: Mapping[str, str],
    hook: Hook | None,
) -> int:
    """Be the command, in the child; return its exit code. What escapes it is printed as a traceback, with code 70."""
    os.setsid()
    os.chdir(folder)
    for number, name in ((0, os.devnull), (1, "stdout"), (2, "stderr")):
        place = name if number == 0 else str(folder / name)
        os.dup2(os.open(place, os.O_RDWR | os.O_CREAT | os.O_TRUNC), number)
    streams = (open(number, mode, 1, closefd=False) for number, mode in enumerate("rww"))  # noqa: SIM115 - they stay
    sys.stdin, sys.stdout, sys.stderr = streams
    os.closerange(3, 64)
    os.environ.update({"TMPDIR": str(folder / "tmp"), "HOME": str(folder / "tmp"), "COLUMNS": "200", **environment})
    sys.path.insert(0, str(folder))
    sys.argv = ["eyechart", *words]
    limit(limits)
    from eyechart.cli import main  # noqa: PLC0415 - of the tree that is tried

    after = None
    try:
        after = hook() if hook is not None else None
        main()
    except SystemExit as left:
        return left.code if isinstance(left.code, int) else int(left.code is not None)
    except BaseException:  # noqa: BLE001 - what escapes a command is what is looked for
        traceback.print_exc()
        return 70
    finally:
        if after is not None:
            after()
    return 0


def finish(child: int, folder: Path, *, limits: Limits = Limits(), grace_s: float = GRACE_S) -> Ended:
    """Wait for a command, end it where it takes too long, and return what it printed and left."""
    end, status, used = time.monotonic() + limits.clock_s, None, None
    while used is None and time.monotonic() < end:
        number, status, found = os.wait4(child, os.WNOHANG)
        used = found if number else None
        if used is None:
            time.sleep(0.01)
    code = None if used is None else os.waitstatus_to_exitcode(status or 0)
    if used is None:
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        _, _, used = os.wait4(child, 0)
        grace_s = 0.5
    left = in_session(child)
    until = time.monotonic() + grace_s
    while left and time.monotonic() < until:
        time.sleep(0.05)
        left = in_session(child)
    for one in left:
        with suppress(ProcessLookupError):
            os.kill(int(one.split()[0]), signal.SIGKILL)
    out, err = ((folder / name).read_text(encoding="utf-8", errors="replace") for name in ("stdout", "stderr"))
    return Ended(code, out, err, used.ru_maxrss, used.ru_utime + used.ru_stime, tuple(left), temporary(folder))


def temporary(folder: Path) -> tuple[str, ...]:
    """Return what of eyechart's is left in a command's temporary folder."""
    return tuple(sorted(path.name for path in (folder / "tmp").iterdir() if path.name.startswith("eyechart")))


def perform(
    words: Sequence[str],
    folder: Path,
    *,
    limits: Limits = Limits(),
    environment: Mapping[str, str] | None = None,
    hook: Hook | None = None,
) -> Ended:
    """Run a command to its end."""
    return finish(begin(words, folder, limits=limits, environment=environment, hook=hook), folder, limits=limits)
