"""The console of the commands: printing, progress bars, interrupts and JSON."""

import json
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from eyechart.report.table import Table


_kept: list[TextIO] = []
"""The kept standard output of the command."""


@contextmanager
def output_kept() -> Iterator[None]:
    """Keep standard output for this module; lead all other output to standard error.

    A user's callable may print from any thread. A library in C or another process writes to
    descriptor 1 directly. With this, JSON stays valid. Code that closes descriptor 1 or 2 does not
    close this module's.
    """
    with _own_descriptor() as stream, _own_errors():
        _kept.append(stream)
        try:
            with redirect_stdout(sys.stderr):
                yield
        finally:
            _kept.pop()


@contextmanager
def _own_descriptor() -> Iterator[TextIO]:
    """Yield standard output on a new descriptor, while descriptor 1 leads to standard error.

    Streams that are not those of the process, as in a test, stay as they are.
    """
    usual = sys.stdout
    if (_number_of(usual), _number_of(sys.stderr)) != (1, 2):
        yield usual
        return
    usual.flush()
    number = os.dup(1)
    lines = 1 if usual.isatty() else -1
    own = os.fdopen(number, "w", encoding=usual.encoding, errors=usual.errors, buffering=lines)
    os.dup2(2, 1)
    try:
        try:
            yield own
        finally:
            own.flush()  # an error in writing must surface, however the command ends
    except BrokenPipeError:
        raise BrokenPipeError from None  # click would act on its errno
    finally:
        os.dup2(number, 1)
        with suppress(OSError):  # the reader may be gone; that was reported
            own.close()


@contextmanager
def _own_errors() -> Iterator[None]:
    """Keep standard error on a descriptor of its own, if it is that of the process."""
    usual = sys.stderr
    if _number_of(usual) != 2:
        yield
        return
    usual.flush()
    number = os.dup(2)
    own = os.fdopen(number, "w", encoding=usual.encoding, errors=usual.errors, buffering=1)
    sys.stderr = own
    try:
        yield
    finally:
        sys.stderr = usual
        with suppress(OSError, ValueError):  # called code may have closed it
            own.flush()
            os.dup2(number, 2)
            own.close()


def _number_of(stream: TextIO) -> int | None:
    try:
        return stream.fileno()
    except (OSError, ValueError, AttributeError):  # a stream in memory, or a closed one
        return None


_typed: dict[str, str] = {}
"""Paths as the user typed them, by their absolute path."""


def from_here(path: Path) -> Path:
    """Return a path as absolute, before a callable can change the folder.

    Printed text shows it as the user typed it.
    """
    place = path.absolute()
    if not path.is_absolute() and place.name:  # the root has no name and is in every path
        _typed[str(place)] = str(path)
    return place


def as_typed(text: str) -> str:
    """Return a text with paths as typed, so that the user can copy its commands."""
    for place in sorted(_typed, key=len, reverse=True):
        if place in text:
            typed = _typed[place]
            text = text.replace(f"{place}{os.sep}", "" if typed == "." else f"{typed}{os.sep}")
            text = re.sub(rf"{re.escape(place)}(?![\w-]|\.\w)", typed.replace("\\", r"\\"), text)
    return text


def _output() -> TextIO:
    """Return standard output: the kept one, if there is one."""
    return _kept[-1] if _kept else sys.stdout


def print_json(values: object) -> None:
    """Print plain values as JSON: no NaN, and terminal control characters escaped."""
    text = as_typed(json.dumps(values, indent=1, ensure_ascii=False, allow_nan=False))
    if not text.replace("\n", "").isprintable():
        text = "".join(one if one.isprintable() or one == "\n" else json.dumps(one)[1:-1] for one in text)
    try:
        text.encode(_output().encoding or "utf-8")
    except UnicodeEncodeError:
        text = as_typed(json.dumps(values, indent=1, allow_nan=False))  # escapes fit every encoding
    _output().write(text + "\n")


def print_line(*lines: str) -> None:
    """Print lines on standard output without wrapping them."""
    for line in lines:
        _output().write(_harmless(line) + "\n")


def say(*lines: str) -> None:
    """Print lines for people on standard error, apart from ``--json``."""
    for line in lines:
        sys.stderr.write(_harmless(line) + "\n")


def _harmless(text: str) -> str:
    """Return a text without characters that control a terminal; names may hold them."""
    return _plain(as_typed(text))


def _plain(text: str) -> str:
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() or one in "\n\t\u00a0\u202f\u2009" else "\ufffd" for one in text)


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def progress(what: str, unit: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on standard error with rate and time left; yield the function that moves it.

    Without a terminal it prints a line every few seconds.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True, emoji=False)
    if not console.is_terminal:
        yield _lines(what, unit)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(what, total=None, rate="")

        def move(done: int, total: int) -> None:
            speed = bar.tasks[task].speed
            bar.update(task, completed=done, total=total, rate=f"{speed:.1f}/s" if speed else "")

        yield move


@contextmanager
def patience(what: str, every_s: float = 2.0) -> Iterator[Callable[[str], None]]:
    """Yield a function that takes the current step; a step longer than ``every_s`` is printed."""
    import threading

    from eyechart.stats.statistic import special_functions

    special_functions()  # before the thread: beside others all of scipy.special is imported, a tenth of a second
    under_way: list[str] = []
    over = threading.Event()

    def watch() -> None:
        said = ""
        while not over.wait(every_s):
            if under_way and under_way[-1] != said:
                said = under_way[-1]
                say(f"{what}: {said}")

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield under_way.append
    finally:
        over.set()
        watcher.join()


_came: list[int] = []
"""The numbers of the signals that ended this process, apart from SIGINT."""


def end_as_interrupted() -> None:
    """Let SIGTERM and SIGHUP end a command as Ctrl-C does; an ignored signal stays ignored."""
    import signal

    def heard(number: int, _: object) -> None:
        _came.append(number)
        if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # a background job of a shell
            raise KeyboardInterrupt
        signal.raise_signal(signal.SIGINT)

    for name in ("SIGTERM", "SIGHUP"):
        one = getattr(signal, name, None)
        if one is not None and signal.getsignal(one) == signal.SIG_DFL:
            signal.signal(one, heard)


def was_told_to_end() -> bool:
    """Return whether SIGTERM or SIGHUP came; later failures follow from it."""
    return bool(_came)


def how_it_ends() -> tuple[int, str]:
    """Return the exit code after a signal, 128 and its number, and a word for the signal."""
    number = _came[0] if _came else 2
    return 128 + number, {1: "hung up", 15: "terminated"}.get(number, "interrupted")


@contextmanager
def resumable(kept: str = "finished calls are kept; the same command resumes") -> Iterator[None]:
    """On an interrupt, print one line that says what is kept, and exit.

    A second interrupt ends at once. The exit code is 130 for Ctrl-C, 143 for SIGTERM and 129 for
    SIGHUP.
    """
    import signal

    import typer

    try:
        yield
    except KeyboardInterrupt:
        status, happened = how_it_ends()
        signal.signal(signal.SIGINT, lambda *_: os._exit(status))
        with suppress(OSError):  # the terminal may be gone
            say(f"{happened}: {kept}")
        raise typer.Exit(status) from None


def _lines(what: str, unit: str) -> Callable[[int, int], None]:
    import time

    begun: tuple[int, float] | None = None
    now: float | None = None
    before: int | None = None  # the count falls when the next part of the work begins

    def move(done: int, total: int) -> None:
        nonlocal begun, now, before
        if begun is None or before is None or now is None or done < before:
            begun = (done, time.monotonic())
            now = begun[1] if now is None else now
        before = done
        if time.monotonic() - now < 2.0 and done < total:
            return
        now = time.monotonic()
        rate = (done - begun[0]) / max(now - begun[1], 1e-9)
        pace = f", {rate:.1f}/s" if rate > 0 else ""
        left = f", {(total - done) / rate:.0f} s left" if rate > 0 and done < total else ""
        say(f"{what}: {done}/{total} {unit}{pace}{left}")

    return move


def print_each(what: "Iterable[Table | Text | str]", width: int | None = None, *, names: "Iterable[str]" = ()) -> None:
    """Print tables and lines on standard output; long ``names`` are shortened, each uniquely."""
    print_read(as_read(what, width, names=names))


def as_read(
    what: "Iterable[Table | Text | str]", width: int | None = None, *, names: "Iterable[str]" = ()
) -> dict[str, Any]:
    """Return tables and lines as people read them, in plain values that `print_read` prints."""
    from eyechart.report.table import Table

    parts = [one.as_read() if isinstance(one, Table) else one if isinstance(one, str) else _spans(one) for one in what]
    return {"width": width, "names": list(names), "parts": parts}


def print_read(read: Mapping[str, Any]) -> None:
    """Print what `as_read` returned on standard output."""
    from rich.text import Span, Text

    from eyechart.report.short_names import shortener
    from eyechart.report.table import Table

    console, short = table_console(read["width"]), shortener(read["names"])
    for one in read["parts"]:
        if isinstance(one, dict):
            console.print(Table.of_read(one).renamed(lambda text: _harmless(short(text))), markup=False)
        elif isinstance(one, str):
            for line in _harmless(short(one)).split("\n"):
                _print_indented(console, line)
        else:
            text = Text(one[0], style=one[1])
            text.spans = [Span(*span) for span in one[2]]
            text.plain = _plain(short(one[0]))  # keeps the length, so that styles stay in place
            console.print(text, markup=False)


def _spans(one: "Text") -> list[Any]:
    """Return a styled line in plain values: its words, their style, and the spans of others."""
    return [one.plain, str(one.style), [[*span[:2], str(span.style)] for span in one.spans]]


def _print_indented(console: "Console", line: str) -> None:
    """Print a line; what it takes more than the width goes on below, two columns farther in."""
    from rich.text import Text

    if Text(line).cell_len <= console.width:
        console.print(line, markup=False)
        return
    words = line.lstrip(" ")
    indent = " " * min(len(line) - len(words), console.width // 2)
    for place, part in enumerate(Text(words).wrap(console, max(1, console.width - len(indent) - 2))):
        console.print(f"{indent}{'  ' if place else ''}{part.plain.rstrip()}", markup=False)


def table_console(width: int | None = None) -> "Console":
    """Return a console on standard output, as wide as the terminal, or 120 columns."""
    from rich.console import Console

    class Piped(Console):
        def on_broken_pipe(self) -> None:
            """Leave a broken pipe to ``main``, which exits as a shell expects."""
            raise BrokenPipeError

    console = Piped(file=_output(), highlight=False, emoji=False)
    return console if console.is_terminal else Piped(file=_output(), highlight=False, emoji=False, width=width or 120)
