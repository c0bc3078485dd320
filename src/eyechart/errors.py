"""The errors that a user can cause, and so can mend: one line that says what, which and what to do."""

import errno
import os
import re
import stat
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from functools import wraps
from numbers import Integral, Real
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

_LONGEST = 500
_NEAR = 0.6
_GREATEST = 1e30
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT})
_NO_ROOM_SAID = frozenset({"SQLITE_FULL", "SQLITE_IOERR_SHMSIZE"})
"""The second: of a file that stands beside a ledger, SQLite cannot make it as long as it must be."""
_TOO_LONG = "no file may be longer here (ulimit -f)"
_NOT_WRITTEN = "SQLITE_IOERR_WRITE"
"""What SQLite says of a file that may not be longer, and of a disk that fails."""

_OF_ONE = {"are": "is", "have": "has", "were": "was"}
"""What a verb of several things is of one, where it does not only get an s."""

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
"""What an option of a command is in Python, where that is not its own name with '_' for '-'."""
_OPTION = re.compile(
    r"(?P<command>'(?:eyechart|hf|python -m) [^']*'|pip install [^;]*)"
    r"|--convert --longest (?P<longest>\d+)|(?P<file>(?:a )?--mode file)"
    r"|(?<![\w-])--(?P<name>[a-z][a-z0-9-]*[a-z0-9])"
    r"(?: (?:FILE\.toml|(?P<pair>[A-Za-z_]+=[^\s,;:.)\'\"]*)"
    r"|(?P<value>\d[\d.]*\d|\d|https?://[^\s;,)]+|[A-Z]\b|max_tokens|max_completion_tokens|default|user|reasoning|usage|plain"
    r"|json_schema|json_object)(?![\w-])))?"
)
"""An option in a message, with the value that it is given there; or a command that is to be run, which stays."""

P = ParamSpec("P")
R = TypeVar("R")


def in_arguments(words: str) -> str:
    """Return a message about options of a command (``--base-url``) in the words of Python (``base_url``).

    A command that it names to be run, as 'eyechart probe', stays as it is.
    """

    def said(found: re.Match[str]) -> str:
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
    """Return a function whose errors that a user can mend speak of arguments, for who calls it from Python."""

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except EyechartError as error:
            error.args = (in_arguments(str(error)), *error.args[1:])
            raise

    return call


def printable(text: str) -> str:
    """Return what somebody else's program said as one line of bounded length, without control characters."""
    line = " ".join(text[: 4 * _LONGEST].split())
    line = "".join(character if character.isprintable() else "�" for character in line)
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 1]}…"


def counted(number: int, noun: str, verb: str = "") -> str:
    """Return a number with its noun, and its verb if there is one: "1 policy is", "2 policies are" for ``are``."""
    many = f"{noun[:-1]}ies" if noun.endswith("y") else f"{noun}{'es' if noun.endswith('s') else 's'}"
    said = _OF_ONE.get(verb, f"{verb}s") if number == 1 and verb else verb
    return " ".join(filter(None, (str(number), noun if number == 1 else many, said)))


def encodable(text: str) -> str:
    """Return a text, such as a model's error, with half a surrogate pair, which no file can hold, as its escape."""
    return text.encode("utf-8", "backslashreplace").decode()


def meant(name: str, known: Iterable[str]) -> str:
    """Return " did you mean 'depth'?" where a mistyped name is near one that is known, else nothing."""
    import difflib  # noqa: PLC0415 - nobody needs it before a mistake

    folded = {one.lower(): one for one in known}
    near = difflib.get_close_matches(name.lower(), folded, n=1, cutoff=_NEAR)
    return f" did you mean '{folded[near[0]]}'?" if near and folded[near[0]] != name else ""


def perhaps(name: str, known: Iterable[str]) -> str:
    """Return "; did you mean 'depth'?" for the end of a line, where a mistyped name is near one, else nothing."""
    found = meant(name, known)
    return f";{found}" if found else ""


def require_known(what: str, name: str, known: Collection[str], rest: str = "") -> None:
    """Raise SpecError where no such name is known, with the one that may be meant, all that are, and the ``rest``."""
    if name not in known:
        raise SpecError(f"unknown {what};{meant(name, known)} known are {', '.join(known)}{rest}")


def is_full(error: BaseException) -> bool:
    """Return whether an error of the system's, or of SQLite's, says that the disk has no room left, or a quota."""
    if isinstance(error, OSError):
        return error.errno in _NO_ROOM
    return vars(error).get("sqlite_errorname") in _NO_ROOM_SAID or "disk is full" in str(error)


def is_too_long(error: OSError) -> bool:
    """Return whether the system says that a file would be longer than this process may make one."""
    return error.errno == errno.EFBIG and error.strerror == os.strerror(errno.EFBIG)


def why(error: Exception) -> str:
    """Return in words why a file cannot be written or read: a full disk is called one."""
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
    """Raise as an error of this kind what the system says against a file: ``what`` cannot be, why, and ``then``.

    Of other errors that are named, what they say is told as it is, or in other ``words``.
    """
    try:
        yield
    except of as error:
        raise kind(f"{what}: {(words or (why if of is OSError else str))(error)}{then}") from error


MOST_BYTES = 1_000_000_000
"""A text of a run or a bank has no more bytes; one of a hundred thousand frames has a hundredth of that."""


def plain_file(path: Path) -> Path:
    """Return a path of a file that has an end; raises OSError where a pipe or a device stands there, or nothing."""
    mode = path.stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise OSError(errno.EINVAL, "a pipe or a device is no file", os.fspath(path))
    return path


def text_file(path: Path) -> Path:
    """Return a path of a text that is read whole; raises OSError as `plain_file` does, and where it is too large."""
    if (size := plain_file(path).stat().st_size) > MOST_BYTES:
        words = f"it has {size} bytes, more than the {MOST_BYTES} that are read; restore it from a copy"
        raise OSError(errno.EFBIG, words, os.fspath(path))
    return path


def read_at_most(path: Path, most: int, kind: "type[EyechartError]", what: str) -> bytes:
    """Return the bytes of a file; raises an error of this kind where it cannot be read or has too many for ``what``."""
    with raising(kind, f"{path} cannot be read"), path.open("rb") as file:
        found = file.read(most + 1)
    if len(found) > most:
        raise kind(f"{path} has more than {most} bytes, too many for {what}")
    return found


def whole_number(name: str, value: object, least: int) -> int:
    """Return an argument that is a whole number of ``least`` or more; raises SpecError that names it where it is none.

    True and False are none; a whole number of numpy is one.
    """
    if isinstance(value, bool) or not isinstance(value, Integral) or int(value) < least:
        raise SpecError(f"{name} is a whole number of {least} or more, not {printable(repr(value))[:60]}")
    return int(value)


def finite_number(name: str, value: object) -> float:
    """Return an argument that is a number up to 1e30; raises SpecError that names it where it is none."""
    if isinstance(value, bool) or not isinstance(value, Real) or not abs(cast("float", value)) <= _GREATEST:
        raise SpecError(f"{name} is a number up to {_GREATEST:g}, not {printable(repr(value))[:60]}")
    return float(value)


class EyechartError(Exception):
    """A fault in the input, not in the program; the command line prints it on one line and exits 2."""


class BankError(EyechartError):
    """A frame bank is damaged, incomplete, or too small for what was asked of it."""


class SourceError(EyechartError):
    """A table, a folder of pictures or a data set that should become a bank is not what it must be."""


class LedgerError(EyechartError):
    """A run's ledger or manifest does not fit what was asked of it."""


class SpecError(EyechartError):
    """A name (model, condition, prompt, simulator, preset) is unknown or malformed."""


class ArgumentError(SpecError, TypeError):
    """A function for Python takes no argument of this name."""


class SecretError(SpecError):
    """A mode would carry what looks like a secret into a file."""


class DriveError(EyechartError):
    """A world under way broke: it raised, or its camera shows nothing."""


class OutputError(EyechartError):
    """A place to write to is taken by something else, or cannot be written."""


class BundleError(EyechartError):
    """A file is no bundle, is damaged, or would do harm when it is opened."""


class StateError(EyechartError):
    """A vehicle's state or target is no number, so that nothing can be planned from it."""


class VoteError(EyechartError):
    """A table of votes is not what it must be."""


class GuardianError(EyechartError):
    """A guardian was edited, or is asked about frames or by models that it may not be asked about."""


class MissingCallsWarning(UserWarning):
    """Calls that were made are missing from a ledger; the command line prints it on one line."""
