"""The command line: one short function for each command.

A command's heavy imports stand in its function, so that other commands start quickly.
"""

import errno
import gc
import os
import sqlite3
import sys
import threading
from contextlib import suppress
from functools import partial
from typing import NoReturn

from eyechart.cli.terminal import as_typed, end_as_interrupted, how_it_ends, was_told_to_end
from eyechart.errors import (
    EyechartError,
    MissingCallsWarning,
    OutputError,
    counted,
    fill_streams,
    is_full,
    is_too_long,
    printable,
    why,
)

_ASCII = str.maketrans("—–−…×·⁻⁴’‘“”", "---~x*-4''\"\"") | str.maketrans({"≥": ">=", "≤": "<=", "→": "->"})
"""Replacements for characters that a terminal cannot print; any other becomes a question mark."""

_READING = frozenset(
    {"audit", "bundle", "calibrate", "compare", "costs", "gate", "paper", "plan", "report", "score", "transfer"}
    | {"validate", "verdict"}
)
"""The commands that call no model: eyechart's own arithmetic is the only one."""
_MADE, _READ = 100_000, 1_000_000
"""New objects before the garbage collector runs; Python's 700 would run it too often.

The modules of a command alone are a hundred thousand; one that reads makes few circles after them."""

_CLOSED = (
    "eyechart: the called code closed files that are not its own: correct that code and give the same command "
    "again; its last calls may be missing from the ledger"
)
_LEFT_S = 5.0
"""Seconds that a thread of called code may go on after the command is done."""
_NO_MEMORY = (
    "there is not enough memory: end other programs or raise this one's limit, then give the same command again"
)


def main() -> None:
    """Run the command line.

    Bad input prints one line and exits 2; only ``--debug`` prints a traceback. Ctrl-C, also during
    imports, prints one line and exits 130. SIGTERM exits 143, SIGHUP 129.
    """
    before, others = _calls(), frozenset(threading.enumerate())
    try:
        _command()
    except SystemExit as ended:
        if _calls() - before:
            _leave_calls(ended.code)
        if _waited_for() - others:
            late = threading.Timer(_LEFT_S, partial(_leave_threads, others, ended.code))
            late.daemon = True
            late.start()
        raise


def _command() -> None:
    debug = "--debug" in sys.argv
    if debug:
        sys.argv.remove("--debug")
    try:
        end_as_interrupted()
        _open_what_is_closed()
        _print_what_can_be()
        _say_what_is_missing()
        reads = bool(_READING & set(sys.argv[1:2]))
        gc.set_threshold(_READ if reads else _MADE)
        _keep_to_one_thread()
        from eyechart.cli.app import named

        try:
            named(sys.argv[1:])(prog_name="eyechart")
        finally:
            sys.stdout.flush()
            if reads:
                gc.freeze()  # Python's end would look through all objects, for longer than a ledger is read
    except KeyboardInterrupt:
        _end(*how_it_ends())
    except BrokenPipeError:
        _leave(141)  # as a shell reports SIGPIPE
    except (EyechartError, OSError) as error:
        if was_told_to_end():
            _end(*how_it_ends())
        if debug:
            raise
        _end_by(error)
    except (MemoryError, sqlite3.Error) as error:
        if debug:
            raise
        said = f"a database cannot be read or written: {why(error)}" if isinstance(error, sqlite3.Error) else _NO_MEMORY
        _end(2, f"eyechart: {said}")


def _end_by(error: EyechartError | OSError) -> None:
    """End the command with one line that says what is wrong."""
    said = str(error)
    if isinstance(error, OSError):
        if error.errno == errno.EBADF:
            _say_and_leave(2, _CLOSED)  # the event loop would print many lines
        if is_full(error) or is_too_long(error):
            where, what = error.filename2 or error.filename, "the disk is full" if is_full(error) else why(error)
            said = f"{what}{f' ({where})' if where else ''}: make room and try again"
    _end(2, "eyechart: " + "\n".join(map(printable, as_typed(said).split("\n"))))


def _calls() -> frozenset[object]:
    """Return the calls of callables that still run here, those that were given up included."""
    called = sys.modules.get("eyechart.models.python_callable")
    return frozenset() if called is None else called.under_way()


def _waited_for() -> frozenset[threading.Thread]:
    """Return the threads that Python would wait for before the process ends."""
    return frozenset(one for one in threading.enumerate() if not one.daemon)


def _leave_threads(others: frozenset[threading.Thread], status: object) -> None:
    """End the process while threads other than ``others`` still run, and say so."""
    if left := _waited_for() - others:
        first = min(one.name for one in left)
        what = f"{counted(len(left), 'thread')} of the called code ended with the command (first '{first}')"
        _say_and_leave(status, f"eyechart: {printable(what)}")


def _say_and_leave(status: object, line: str) -> NoReturn:
    with suppress(OSError):
        print(line, file=sys.stderr)  # noqa: T201
    _leave_calls(status)


def _leave_calls(status: object) -> NoReturn:
    """End the process at once, although a call that was given up still runs.

    A normal exit would remove the interpreter from under its thread; torch, for one, aborts then.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # the reader may be gone
            stream.flush()
    os._exit(status if isinstance(status, int) else int(status is not None))


def _keep_to_one_thread() -> None:
    """Let a command that only reads multiply in one thread.

    Its arrays are small, so more threads do not help. Sums then do not depend on the number of
    processors. A value that the user set stays.
    """
    if _READING & set(sys.argv[1:2]):
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def _open_what_is_closed() -> None:
    """Lead standard streams that a shell closed (``>&-``) to the null device.

    No other file can get their numbers then. Raises OutputError where standard output is closed:
    the command would seem to succeed and print nothing.
    """
    fill_streams()
    silent = sys.stdout is None
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, "w" if number else "r", encoding="utf-8", closefd=False))  # noqa: SIM115
    if silent:
        raise OutputError("the standard output is closed: redirect it to a file or to /dev/null")


def _print_what_can_be() -> None:
    """Let the standard streams replace characters that they cannot encode."""
    import codecs
    import io

    def other(error: UnicodeError) -> tuple[str, int]:
        if not isinstance(error, UnicodeEncodeError):
            raise error
        signs = error.object[error.start : error.end].translate(_ASCII)
        return "".join(sign if sign.isascii() else "?" for sign in signs), error.end

    codecs.register_error("eyechart", other)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="eyechart")


def _say_what_is_missing() -> None:
    """Print a warning of missing calls as one line; Python prints each such warning once."""
    import warnings

    usual = warnings.formatwarning

    def shown(
        message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
    ) -> str:
        if issubclass(category, MissingCallsWarning):
            return f"eyechart: {printable(str(message))}\n"
        return usual(message, category, filename, lineno, line)

    warnings.formatwarning = shown


def _end(status: int, line: str) -> None:
    """Print one line and end at once, even if another interrupt comes."""
    import signal

    signal.signal(signal.SIGINT, lambda *_: os._exit(status))
    with suppress(OSError):  # the terminal may be gone
        print(line, file=sys.stderr)  # noqa: T201
    _leave(status)


def _leave(status: int) -> None:
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the last flush fails
    sys.exit(status)
