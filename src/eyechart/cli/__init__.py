"""The command line: one short function a command; nothing heavy is imported before its command runs."""

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
    is_full,
    is_too_long,
    printable,
    why,
)

_ASCII = str.maketrans(
    {
        "—": "-",
        "–": "-",
        "−": "-",
        "…": "~",
        "≥": ">=",
        "≤": "<=",
        "→": "->",
        "×": "x",
        "·": "*",
        "⁻": "-",
        "⁴": "4",
        "’": "'",
        "‘": "'",
        "“": '"',
        "”": '"',
    }
)
"""What stands for a sign on a terminal that cannot print it; any other such sign becomes a question mark."""

_READING = frozenset(
    {"audit", "bundle", "calibrate", "compare", "costs", "gate", "paper", "plan", "report", "score", "transfer"}
    | {"validate", "verdict"}
)
"""The commands that ask nobody, so that no arithmetic is done but eyechart's own."""
_MADE = 100_000
"""So many new objects let the collector of cycles look again: at 700, what modules and rows make has it look often."""

_CLOSED = (
    "eyechart: code that was called closed files that are not its own: mend it, and give the same command again; what "
    "it was asked may stand in no ledger"
)
_LEFT_S = 5.0
"""So long a thread may go on that called code left, once the command is done."""
_NO_MEMORY = "there is not enough memory: end other programs or raise this one's limit, and give the same command again"


def main() -> None:
    """Run the command line. Bad input prints one line and exits 2; a traceback comes only with ``--debug``.

    A Ctrl-C, also while modules are imported, prints one line and exits 130; SIGTERM and SIGHUP exit 143 and 129.
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
        gc.set_threshold(_MADE)
        _keep_to_one_thread()
        from eyechart.cli.app import app

        try:
            app(prog_name="eyechart")
        finally:
            sys.stdout.flush()
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
    """End the command by what is wrong, in one line."""
    said = str(error)
    if isinstance(error, OSError):
        if error.errno == errno.EBADF:
            _say_and_leave(2, _CLOSED)  # the loop of its calls would complain in many lines
        if is_full(error) or is_too_long(error):
            where, what = error.filename2 or error.filename, "the disk is full" if is_full(error) else why(error)
            said = f"{what}{f' ({where})' if where else ''}: make room and try again"
    _end(2, "eyechart: " + "\n".join(map(printable, as_typed(said).split("\n"))))


def _calls() -> frozenset[object]:
    """Return the calls of callables that are under way in this process, also where nobody waits for them any more."""
    called = sys.modules.get("eyechart.models.python_callable")
    return frozenset() if called is None else called.under_way()


def _waited_for() -> frozenset[threading.Thread]:
    """Return the threads that Python would wait for before the process ends."""
    return frozenset(one for one in threading.enumerate() if not one.daemon)


def _leave_threads(others: frozenset[threading.Thread], status: object) -> None:
    """End the process beside threads that still go on, but for ``others``, and say so."""
    if left := _waited_for() - others:
        first = min(one.name for one in left)
        what = f"{counted(len(left), 'thread')} that called code left behind ended with the command (first '{first}')"
        _say_and_leave(status, f"eyechart: {printable(what)}")


def _say_and_leave(status: object, line: str) -> NoReturn:
    with suppress(OSError):
        print(line, file=sys.stderr)  # noqa: T201
    _leave_calls(status)


def _leave_calls(status: object) -> NoReturn:
    """End the process at once, beside a call that was given up.

    The usual end takes the interpreter from below that thread, and libraries such as torch abort the process then.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # nobody reads on
            stream.flush()
    os._exit(status if isinstance(status, int) else int(status is not None))


def _keep_to_one_thread() -> None:
    """Have a command that only reads multiply in one thread: its arrays are small, and other threads would but wait.

    Sums do not depend on how many processors there are then. Whoever set the variable has it as they set it.
    """
    if _READING & set(sys.argv[1:2]):
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def _open_what_is_closed() -> None:
    """Let standard streams that a shell closed (``>&-``) lead nowhere, so that no file gets their number either.

    Raises OutputError where it is that of the output: a command that prints nothing would seem to have done its work.
    """
    silent = sys.stdout is None
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free, which is this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, "w" if number else "r", encoding="utf-8", closefd=False))  # noqa: SIM115
    if silent:
        raise OutputError("the standard output is closed: give it a place, which may be /dev/null")


def _print_what_can_be() -> None:
    """Have the standard streams print another sign where theirs cannot print one."""
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
    """Have a warning of missing calls printed as one line; it comes once a ledger, as Python has it of any warning."""
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
    """Print one line and end at once, whatever else still runs or interrupts."""
    import signal

    signal.signal(signal.SIGINT, lambda *_: os._exit(status))
    with suppress(OSError):  # of a terminal that is gone
        print(line, file=sys.stderr)  # noqa: T201
    _leave(status)


def _leave(status: int) -> None:
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or its last flush would complain
    sys.exit(status)
