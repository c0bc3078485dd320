"""The command line: one short function a command; nothing heavy is imported before its command runs."""

import os
import sys

from eyechart.cli.app import app
from eyechart.errors import EyechartError


def main() -> None:
    """Run the command line. Bad input prints one line and exits 2; a traceback comes only with ``--debug``."""
    debug = "--debug" in sys.argv
    if debug:
        sys.argv.remove("--debug")
    try:
        app(prog_name="eyechart")
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or its last flush would complain
        sys.exit(141)  # as a shell reports SIGPIPE
    except (EyechartError, OSError) as error:
        if debug:
            raise
        print(f"eyechart: {error}", file=sys.stderr)  # noqa: T201
        sys.exit(2)
