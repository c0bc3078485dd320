"""``python -m eyechart``: the command ``eyechart``, which a signal can end at any moment.

It imports only what Python has at its start, because an interrupt may come during any other import.
"""

import os
import sys

_SIGNALLED = frozenset({129, 130, 143})
"""The exit codes of a command that SIGHUP, SIGINT or SIGTERM ended."""
_AGAIN_S = 0.05


def main() -> None:
    """Run the command line; Ctrl-C during its import or at Python's end is one line, exit 130."""
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
    """Repeat an interrupt a moment later if it came where Python swallows it, as in a finalizer."""
    if not issubclass(what.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(what)
        return
    import signal  # noqa: PLC0415 - seldom needed
    import threading  # noqa: PLC0415

    again = threading.Timer(_AGAIN_S, signal.raise_signal, (signal.SIGINT,))
    again.daemon = True
    again.start()


def _end_at_once() -> None:
    """Let an interrupt from now on end the process at once, while Python shuts down."""
    import signal  # noqa: PLC0415 - it takes a while to import

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupted)


def _interrupted(*_signal: object) -> None:
    try:
        os.write(2, b"interrupted\n")
    finally:  # also without a terminal
        os._exit(130)


def _leave(status: object) -> None:
    """End with this exact status, not by SIGINT as Python may after an interrupted ``exec``."""
    import atexit  # noqa: PLC0415 - seldom needed

    try:
        sys.stdout.flush()
        atexit._run_exitfuncs()  # noqa: SLF001 - it has no other name
    finally:
        os._exit(status if isinstance(status, int) else 1)


if __name__ == "__main__":
    main()
