"""``python -m eyechart`` is the command ``eyechart``: a process of its own, which a signal ends in words at any moment.

Nothing is imported here that Python has not at its start: whatever is imported takes a while, in which an interrupt may
come.
"""

import os
import sys

_SIGNALLED = frozenset({129, 130, 143})
"""The exit codes of a command that SIGHUP, SIGINT or SIGTERM ended."""
_AGAIN_S = 0.05


def main() -> None:
    """Run the command line; a Ctrl-C while it is imported, or as Python ends, is one line and exit 130 too."""
    try:
        try:
            sys.unraisablehook = _not_swallowed
            from eyechart.cli import main as command  # noqa: PLC0415 - an interrupt of the import is met here

            command()
        finally:
            _end_at_once()
    except KeyboardInterrupt:
        _interrupted()
    except SystemExit as ended:
        if ended.code in _SIGNALLED:
            _leave(ended.code)
        raise


def _not_swallowed(what: "sys.UnraisableHookArgs") -> None:
    """Have an interrupt that came where Python lets no error through, as in a finalizer, come again a moment later."""
    if not issubclass(what.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(what)
        return
    import signal  # noqa: PLC0415 - seldom needed
    import threading  # noqa: PLC0415

    again = threading.Timer(_AGAIN_S, signal.raise_signal, (signal.SIGINT,))
    again.daemon = True
    again.start()


def _end_at_once() -> None:
    """Let an interrupt from now on end the process at once: the command has ended, and Python tidies up."""
    import signal  # noqa: PLC0415 - it takes a while to import

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupted)


def _interrupted(*_signal: object) -> None:
    try:
        os.write(2, b"interrupted\n")
    finally:  # also of a terminal that is gone
        os._exit(130)


def _leave(status: object) -> None:
    """End with the very status: Python would end itself by SIGINT where that came inside an ``exec`` of a module."""
    import atexit  # noqa: PLC0415 - seldom needed

    try:
        sys.stdout.flush()
        atexit._run_exitfuncs()  # noqa: SLF001 - it has no other name
    finally:
        os._exit(status if isinstance(status, int) else 1)


if __name__ == "__main__":
    main()
