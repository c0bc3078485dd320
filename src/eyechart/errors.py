"""The errors that a user can cause, and so can mend: one line that says what, which and what to do."""

import errno
import os
from collections.abc import Iterable

_LONGEST = 500
_NEAR = 0.6
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT})
_NO_ROOM_SAID = frozenset({"SQLITE_FULL", "SQLITE_IOERR_SHMSIZE"})
"""The second: of a file that stands beside a ledger, SQLite cannot make it as long as it must be."""


def printable(text: str) -> str:
    """Return what somebody else's program said as one line of bounded length, without control characters."""
    line = " ".join(text[: 4 * _LONGEST].split())
    line = "".join(character if character.isprintable() else "�" for character in line)
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 1]}…"


def meant(name: str, known: Iterable[str]) -> str:
    """Return " did you mean 'depth'?" where a mistyped name is near one that is known, else nothing."""
    import difflib  # noqa: PLC0415 - nobody needs it before a mistake

    folded = {one.lower(): one for one in known}
    near = difflib.get_close_matches(name.lower(), folded, n=1, cutoff=_NEAR)
    return f" did you mean '{folded[near[0]]}'?" if near else ""


def is_full(error: BaseException) -> bool:
    """Return whether an error of the system's, or of SQLite's, says that the disk has no room left, or a quota."""
    if isinstance(error, OSError):
        return error.errno in _NO_ROOM
    return vars(error).get("sqlite_errorname") in _NO_ROOM_SAID or "disk is full" in str(error)


def why(error: Exception) -> str:
    """Return in words why a file cannot be written or read: a full disk is called one."""
    if is_full(error):
        target = error.filename2 if isinstance(error, OSError) else None
        return f"the disk is full ({os.fspath(target)})" if target else "the disk is full"
    return (error.strerror if isinstance(error, OSError) else None) or printable(str(error))


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
