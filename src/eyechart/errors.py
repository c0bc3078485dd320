"""Errors that a user can cause and correct: one line says what, which and what to do."""

import errno
import os
import re
import stat
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import wraps
from numbers import Integral, Real
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

_LONGEST = 500
_NEAR = 0.6
_GREATEST = 1e30
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT})
_NO_ROOM_SAID = frozenset({"SQLITE_FULL", "SQLITE_IOERR_SHMSIZE"})
"""The second one: SQLite cannot make the file beside a ledger long enough."""
_TOO_LONG = "no file may be longer here (ulimit -f)"
_NOT_WRITTEN = "SQLITE_IOERR_WRITE"
"""SQLite's name for a file that may not be longer, and for a failing disk."""

_OF_ONE = {"are": "is", "have": "has", "were": "was"}
"""The singular of verbs that do not only get an s."""

_ARGUMENTS = {
    "accept-loss": "accept_loss=True",
    "again": "again=True",
    "body": "body",
    "convert": "convert=Convert()",
    "frames": "bank",
    "header": "headers",
    "independent": "independent=True",
    "json-mode": "structured",
    "map": "columns",
    "mode": "a RequestMode",
    "model": "model",
    "moved": "moved=True",
    "no-probe": "probe=False",
    "option": "options",
    "reread": "reread=True",
    "stop-early": "stop_early=True",
    "timeout": "timeout_s",
}
"""The Python arguments of command options with another name."""
_OPTION = re.compile(
    r"(?P<own>'eyechart run' with )(?=--)"
    r"|(?P<command>'(?:eyechart|hf|python -m) [^']*'|pip install [^;]*)"
    r"|--convert --longest (?P<longest>\d+)|(?P<file>(?:a )?--mode file)"
    r"|(?<![\w-])--(?P<name>[a-z][a-z0-9-]*[a-z0-9])"
    r"(?: (?:FILE\.toml|(?P<pair>[A-Za-z_]+=[^\s,;:.)\'\"]*)"
    r"|(?P<value>\d[\d.]*\d|\d|https?://[^\s;,)]+|[A-Z]\b|max_tokens|max_completion_tokens|default|user|reasoning|usage|plain"
    r"|json_schema|json_object)(?![\w-])))?"
)
"""An option in a message with its value, or a command to run, which stays as it is."""

P = ParamSpec("P")
R = TypeVar("R")


def in_arguments(words: str) -> str:
    """Return a message about command options (``--base-url``) with Python's names (``base_url``).

    A command to run, as 'eyechart probe', stays as it is; 'eyechart run' with an option is the call itself.
    """

    def said(found: re.Match[str]) -> str:
        if found["own"]:
            return ""
        if found["command"]:
            return found[0]
        if found["longest"] or found["file"]:
            return f"convert=Convert(longest={found['longest']})" if found["longest"] else "a RequestMode"
        name, value = found["name"], found["value"]
        if pair := found["pair"]:
            key, _, one = pair.partition("=")
            return f"{_ARGUMENTS.get(name, name)}={{{key!r}: {one!r}}}"
        argument = _ARGUMENTS.get(name) or name.replace("-", "_")
        if value is None or "=" in argument:
            return f"{argument}{'' if value is None else f' {value}'}"
        return f"{argument}={value if value[0].isdigit() or value.isupper() else repr(value)}"

    return _OPTION.sub(said, words)


def speaks_of_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function whose errors name Python arguments instead of options."""

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except EyechartError as error:
            error.args = (in_arguments(str(error)), *error.args[1:])
            raise

    return call


def printable(text: str) -> str:
    """Return another program's message as one line of bounded length, all printable."""
    line = " ".join(text[: 4 * _LONGEST].split())
    line = "".join(character if character.isprintable() else "�" for character in line)
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 1]}…"


def counted(number: int, noun: str, verb: str = "") -> str:
    """Return a number with its noun and verb: "1 policy is", "2 policies are" for ``are``."""
    many = f"{noun[:-1]}ies" if noun.endswith("y") else f"{noun}{'es' if noun.endswith('s') else 's'}"
    said = _OF_ONE.get(verb, f"{verb}s") if number == 1 and verb else verb
    return " ".join(filter(None, (str(number), noun if number == 1 else many, said)))


def listed(names: Sequence[str]) -> str:
    """Return names as a list in words: "a, b and c"."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def encodable(text: str) -> str:
    """Return a text with lone surrogates escaped, because no file can hold them."""
    return text.encode("utf-8", "backslashreplace").decode()


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return " did you mean 'depth'?" for a mistyped name that is near a known one, else ""."""
    import difflib  # noqa: PLC0415 - nobody needs it before a mistake

    folded = {one.lower(): one for one in known}
    near = difflib.get_close_matches(name.lower(), folded, n=1, cutoff=_NEAR)
    return f" did you mean '{folded[near[0]]}'?" if near and folded[near[0]] != name else ""


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return "; did you mean 'depth'?" for a mistyped name that is near a known one, else ""."""
    found = did_you_mean(name, known)
    return f";{found}" if found else ""


def require_known(what: str, name: str, known: Collection[str], rest: str = "") -> None:
    """Raise SpecError for an unknown name, with a near one, all known ones, and ``rest``."""
    if name not in known:
        raise SpecError(f"unknown {what};{did_you_mean(name, known)} known are {', '.join(known)}{rest}")


def is_full(error: BaseException) -> bool:
    """Return whether a system or SQLite error means a full disk or quota."""
    if isinstance(error, OSError):
        return error.errno in _NO_ROOM
    return vars(error).get("sqlite_errorname") in _NO_ROOM_SAID or "disk is full" in str(error)


def is_too_long(error: OSError) -> bool:
    """Return whether a file would exceed this process's limit of file size."""
    return error.errno == errno.EFBIG and error.strerror == os.strerror(errno.EFBIG)


def why(error: Exception) -> str:
    """Return in words why a file cannot be written or read, a full disk in particular."""
    if is_full(error):
        target = error.filename2 if isinstance(error, OSError) else None
        return f"the disk is full ({os.fspath(target)})" if target else "the disk is full"
    if isinstance(error, OSError) and is_too_long(error):
        return _TOO_LONG
    if vars(error).get("sqlite_errorname") == _NOT_WRITTEN:
        return f"{printable(str(error))}: the disk does not take more, or {_TOO_LONG}"
    return (error.strerror if isinstance(error, OSError) else None) or printable(str(error))


@contextmanager
def raising(
    kind: type[Exception],
    what: str,
    then: str = "",
    of: type[Exception] | tuple[type[Exception], ...] = OSError,
    words: Callable[[Exception], str] | None = None,
) -> Iterator[None]:
    """Raise errors of the system as ``kind``: ``what`` failed, why, and ``then``.

    Errors of other types ``of`` are quoted, or put in ``words``.
    """
    try:
        yield
    except of as error:
        raise kind(f"{what}: {(words or (why if of is OSError else str))(error)}{then}") from error


MOST_BYTES = 1_000_000_000
"""The most bytes of a run's or bank's text; 100 000 frames take a hundredth of it."""


_ERRORS = 2
"""The number of standard error."""


def fill_streams() -> None:
    """Lead the numbers of standard streams that are closed to the null device, so that no file gets one."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number: this one


def above_streams(path: str, flags: int) -> int:
    """Open a file, as an opener of `open`, on no number of a standard stream: called code may close these."""
    while (number := os.open(path, flags)) <= _ERRORS:
        with suppress(OSError):  # closed by that code already
            os.close(number)
        fill_streams()
    return number


def plain_file(path: Path) -> Path:
    """Return the path of a regular file or folder; raises OSError for anything else."""
    mode = path.stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise OSError(errno.EINVAL, "a pipe or a device is not a file", os.fspath(path))
    return path


def text_file(path: Path) -> Path:
    """Return the path of a text to read whole; raises OSError as `plain_file`, and if too large."""
    if (size := plain_file(path).stat().st_size) > MOST_BYTES:
        words = f"it has {size} bytes, more than the {MOST_BYTES} that are read; restore it from a copy"
        raise OSError(errno.EFBIG, words, os.fspath(path))
    return path


def read_at_most(path: Path, most: int, kind: "type[EyechartError]", what: str) -> bytes:
    """Return a file's bytes; raises ``kind`` if it cannot be read or is too large for ``what``."""
    with raising(kind, f"{path} cannot be read"), path.open("rb") as file:
        result = file.read(most + 1)
    if len(result) > most:
        raise kind(f"{path} has more than {most} bytes, too many for {what}")
    return result


def whole_number(name: str, value: object, least: int) -> int:
    """Return an argument that is a whole number of at least ``least``, also one of numpy.

    Raises SpecError that names the argument otherwise; True and False are no numbers.
    """
    if isinstance(value, bool) or not isinstance(value, Integral) or int(value) < least:
        raise SpecError(f"{name} must be a whole number of {least} or more, not {printable(repr(value))[:60]}")
    return int(value)


def finite_number(name: str, value: object) -> float:
    """Return an argument that is a number up to 1e30; raises SpecError that names it otherwise."""
    if isinstance(value, bool) or not isinstance(value, Real) or not abs(cast("float", value)) <= _GREATEST:
        raise SpecError(f"{name} must be a number up to {_GREATEST:g}, not {printable(repr(value))[:60]}")
    return float(value)


class EyechartError(Exception):
    """A fault in the input, not in the program; the command prints one line and exits 2."""


class BankError(EyechartError):
    """A frame bank is damaged, incomplete, or too small for its use."""


class SourceError(EyechartError):
    """A table, a folder of pictures or a data set cannot become a bank."""


class LedgerError(EyechartError):
    """A run's ledger or manifest does not fit its use."""


class SpecError(EyechartError):
    """A name (model, condition, prompt, simulator, preset) is unknown or malformed."""


class ArgumentError(SpecError, TypeError):
    """A function for Python takes no argument of this name."""


class SecretError(SpecError):
    """A request mode would write a likely secret into a file."""


class DriveError(EyechartError):
    """A world broke while driving: it raised, or its camera shows nothing."""


class OutputError(EyechartError):
    """An output path is taken by something else, or cannot be written."""


class BundleError(EyechartError):
    """A file is no bundle, is damaged, or is harmful to open."""


class StateError(EyechartError):
    """A vehicle's state or target is not a number, so no plan is possible."""


class VoteError(EyechartError):
    """A table of votes has a fault."""


class GuardianError(EyechartError):
    """A guardian was edited, or a frame or model is not allowed for it."""


class MissingCallsWarning(UserWarning):
    """Finished calls are missing from a ledger; the command prints it on one line."""
