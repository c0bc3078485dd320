"""Commands about policies that cannot be judged: what they say of it, how they exit, and what stays readable."""

import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

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
        ("arms:half", "return 8 steps, or import or build the bank with --horizon 4"),
        ("arms:not_a_number", "some of its numbers are no numbers (NaN"),
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
    assert "calls are unfinished: mend what is wrong with" in said
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
