"""Commands about policies that cannot be judged: what they say of it, how they exit, and what stays readable."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

import stand_ins
from eyechart.cli.app import app
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.simulators import open_bank_simulator

BATCH = "its shape is (1, 8, 3), and that of the bank's motions (8, 3): return the chunk alone, without the axis of the"


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small tabletop."""
    return open_bank_simulator("tabletop").build(tmp_path_factory.mktemp("commands") / "bank", seeds=(0,), steps=4)


def told(*words: object, code: int = 0) -> str:
    """Return all that a command prints."""
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == code, done.output
    return " ".join(done.output.split())


def asked(bank: FrameBank, out: Path, name: str, *more: object, code: int = 0) -> str:
    """Return what a run of one policy prints."""
    return told("run", "policy", "--policy", f"python:{name}", "--frames", bank.root, "--out", out, *more, code=code)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("faulty_arms:with_batch", f"{BATCH} batch: [0]"),
        ("arms:half", "return 8 steps, or import the bank with --horizon 4"),
        ("arms:not_a_number", "some of its values are not numbers (NaN"),
        ("faulty_arms:one_answer", "exception: ValueError: a dict is no array of numbers"),
    ],
)
def test_a_policy_that_answers_with_no_motion_is_set_aside(
    bank: FrameBank, tmp_path: Path, name: str, words: str
) -> None:
    """After ten calls, with what is wrong and what is to be done; it is not said that this may pass."""
    said = asked(bank, tmp_path / "run", name, code=1)
    assert f"set aside: python:{name}: 10 calls in a row failed, the last one with" in said
    assert words in said
    assert "nothing can be judged" in said
    assert "of 10 finished calls none holds a motion" in said
    assert "calls are unfinished: correct the cause for" in said
    assert "may pass" not in said
    with Ledger(tmp_path / "run" / "ledger.sqlite") as ledger:
        assert len(ledger.finished()) == 10


def test_who_answers_with_a_motion_now_and_then_is_asked_to_the_end(bank: FrameBank, tmp_path: Path) -> None:
    """Failures in a row count alone; how many there were is said."""
    said = asked(bank, tmp_path / "run", "faulty_arms:varies", "--conditions", "real,real_repeat")
    assert "set aside" not in said
    assert "calls came back with no motion: its shape is (5, 3)" in said


def test_a_run_none_of_whose_calls_holds_a_motion_exits_1(bank: FrameBank, tmp_path: Path) -> None:
    """Also one that ends before anybody is set aside, and one that a limit stops."""
    few = ("--conditions", "real,real_repeat")
    said = asked(bank, tmp_path / "few", "faulty_arms:with_batch", *few, "--limit", 2, code=1)
    assert "of 4 finished calls none holds a motion" in said
    assert "done:" not in said
    stopped = asked(bank, tmp_path / "stopped", "faulty_arms:with_batch", *few, "--max-calls", 3, code=1)
    assert "of 3 finished calls none holds a motion" in stopped


def test_costs_lists_what_answers_lack_and_the_errors_and_no_numbers(bank: FrameBank, tmp_path: Path) -> None:
    """A line a reason, counted."""
    asked(bank, tmp_path / "run", "faulty_arms:varies", "--conditions", "real,real_repeat")
    said = told("costs", tmp_path / "run", "--unread")
    assert "its shape is (5, 3), and that of the bank's motions (8, 3)" in said
    assert "base64" not in said
    rows = json.loads(CliRunner().invoke(app, ["costs", str(tmp_path / "run"), "--unread", "--json"]).stdout)["unread"]
    ((one,),) = rows.values()
    assert (one["missing"], one["why"]) == ("unparsed", "wrong_shape")
    assert one["count"] > 1
    asked(bank, tmp_path / "fails", "arms:broken", code=1)
    assert "KeyError: 'left'" in told("costs", tmp_path / "fails", "--unread")


CHATTY = """
import sys

import numpy as np

print("imported")


def act(images, state, instruction):
    print("called")
    sys.stdout.write("by itself\\n")
    return np.zeros((8, 3))


def words(prompt, image):
    print("asked")
    return "SLOW"


act.reset = lambda: print("emptied")
"""


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("python:chatty:act", "--frames", "BANK"), {"imported", "called", "by itself", "emptied"}),
        (("python:chatty:words",), {"imported", "asked"}),
    ],
)
def test_json_is_json_whatever_a_callable_prints(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], said: set[str]
) -> None:
    """While it is imported, emptied and called: that goes to standard error."""
    (tmp_path / "chatty.py").write_text(CHATTY)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "chatty", raising=False)
    given = [str(bank.root) if word == "BANK" else word for word in words]
    done = CliRunner().invoke(app, ["doctor", *given, "--json"])
    assert "calls" in json.loads(done.stdout) or "spent" in json.loads(done.stdout)
    assert said <= set(done.stderr.splitlines())
    assert CliRunner().invoke(app, ["doctor", "--help"]).stdout  # what is no callable's stays where it was


HUNG = """
import atexit
import os
import threading
import time

import numpy as np

atexit.register(lambda: os.abort() if threading.active_count() > 1 else None)  # as torch does below a call
calls = 0


def act(images, state, instruction):
    global calls
    calls += 1
    if calls > int(os.environ["QUICK"]):
        time.sleep(60)
    return np.zeros((8, 3)) + state + images["top"].mean() / 255
"""


def _run_hung(bank: FrameBank, folder: Path, quick: int, *more: str) -> "subprocess.Popen[bytes]":
    line = "from eyechart.cli import main; main()"
    words = ["run", "policy", "--policy", "python:hung:act", "--frames", str(bank.root), "--out", str(folder / "run")]
    (folder / "hung.py").write_text(HUNG)
    environ = os.environ | {"PYTHONPATH": f"{os.environ.get('PYTHONPATH', '')}:{folder}", "QUICK": str(quick)}
    few = ("--conditions", "real,real_repeat", "--limit", "6")
    return subprocess.Popen([sys.executable, "-c", line, *words, *few, *more], env=environ, stderr=subprocess.PIPE)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_while_a_callable_is_called_ends_so_and_keeps_what_is_finished(
    bank: FrameBank, tmp_path: Path, number: signal.Signals
) -> None:
    """The interpreter does not end below its thread; and the same command goes on."""
    with _run_hung(bank, tmp_path, 3) as running:
        deadline = time.monotonic() + 30
        while stand_ins.rows_in(tmp_path / "run" / "ledger.sqlite", "replies") < 3 and time.monotonic() < deadline:
            time.sleep(0.02)
        time.sleep(0.2)
        running.send_signal(number)
        said = running.communicate(timeout=20)[1].decode()
    assert running.returncode == 128 + number, said
    assert said.endswith("finished calls are kept; the same command resumes\n")
    with Ledger(tmp_path / "run" / "ledger.sqlite") as ledger:
        assert (len(ledger.finished()), len(ledger.unknown())) == (3, 1)
    with _run_hung(bank, tmp_path, 99) as again:
        assert again.wait(30) == 0
    with Ledger(tmp_path / "run" / "ledger.sqlite") as ledger:
        assert len(ledger.finished()) == 12


def test_a_call_that_was_given_up_does_not_abort_a_command_that_ends(bank: FrameBank, tmp_path: Path) -> None:
    """Its time was over; what was said is said, and the exit is the command's own."""
    with _run_hung(bank, tmp_path, 3, "--timeout-s", "0.2", "--max-calls", "4") as running:
        said = running.communicate(timeout=30)[1].decode()
    assert (running.returncode, "stopped: 4 calls were sent" in said) == (3, True), said


CALLED_FROM_A_PROGRAM = """
import sys
import threading

from eyechart.cli import main
from eyechart.models.python_callable import _CALL

done = threading.Event()
threading.Thread(target=done.wait, name=_CALL, daemon=True).start()
sys.argv = ["eyechart", "list", "no such kind"]
try:
    main()
except SystemExit as ended:
    print("went on after", ended.code)
done.set()
"""


def test_a_call_of_a_program_s_own_does_not_end_it_with_a_command() -> None:
    """A command that is called from Python raises SystemExit; only a call that it made itself ends the process."""
    process = subprocess.run([sys.executable, "-c", CALLED_FROM_A_PROGRAM], capture_output=True, text=True, check=False)
    assert (process.returncode, process.stdout) == (0, "went on after 2\n"), process.stderr
