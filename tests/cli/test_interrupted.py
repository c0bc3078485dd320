"""A Ctrl-C at an awkward moment: one line and exit 130, and no traceback, of the command or of what it began."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

HEAD = """
import atexit, runpy, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell's background job ignores
sys.argv = ["eyechart", *sys.argv[1:]]
class Dying:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
def interrupted():
    exec("signal.raise_signal(signal.SIGINT)")  # as within a dataclass, where Python would end by the signal itself
"""
AT_IMPORT = """
class At:
    def find_spec(self, name, *_):
        if name == MODULE:
            sys.meta_path.remove(self)
            HOW
sys.meta_path.insert(0, At())
"""
TAIL = 'runpy.run_module("eyechart", run_name="__main__", alter_sys=True)'
POOL = """
import os, signal, sys, time
from eyechart.processes import open_pool
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with open_pool(2) as pool:
            asked = [pool.submit(time.sleep, 60) for _ in range(2)]
            os.write(1, b"begun\\n")
            [one.result() for one in asked]
    except KeyboardInterrupt:
        sys.exit(130)
"""


def ended(program: str, *words: str) -> tuple[int, str]:
    """Run a program to its end, and return its exit code and what it printed as errors."""
    command = [sys.executable, "-c", program, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    return done.returncode, done.stderr


@pytest.mark.parametrize("how", ["interrupted()", "Dying()"])
@pytest.mark.parametrize("module", ["eyechart.cli", "eyechart.cli.terminal", "eyechart.cli.app", "eyechart.models"])
def test_an_interrupt_of_an_import_is_one_line_and_130(module: str, how: str) -> None:
    """From the first module on, also where Python lets no error through, as in a finalizer."""
    hook = AT_IMPORT.replace("MODULE", repr(module)).replace("HOW", how)
    wait = "import threading; threading.Timer(20, print).start()" if how == "Dying()" else ""  # it comes a moment later
    code, said = ended(HEAD + hook + wait + "\n" + TAIL, "list", "models")
    assert (code, said.count("\n")) == (130, 1), said
    assert said.startswith("interrupted")


@pytest.mark.parametrize("words", [("--version",), ("list", "nothing")])
def test_an_interrupt_when_a_command_has_ended_is_no_traceback(words: tuple[str, ...]) -> None:
    """While Python tidies up, after a command that went well and after one that did not."""
    code, said = ended(f"{HEAD}atexit.register(signal.raise_signal, signal.SIGINT)\n{TAIL}", *words)
    assert code in {2, 130}, said
    assert "Traceback" not in said
    assert "Error" not in said.replace("Error ─", "").replace("Error: No such command", "")


@pytest.mark.parametrize("after_s", [0.0, 0.3, 1.0])
def test_the_interrupt_of_a_terminal_does_not_reach_a_pool_s_processes(after_s: float, tmp_path: Path) -> None:
    """They start, import, wait or work: their parent ends them, and they say nothing."""
    (tmp_path / "program.py").write_text(POOL)
    command = [sys.executable, str(tmp_path / "program.py")]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == "begun\n"
        time.sleep(after_s)
        os.killpg(parent.pid, signal.SIGINT)
        _, said = parent.communicate(timeout=60)
    assert (parent.returncode, said) == (130, "")
