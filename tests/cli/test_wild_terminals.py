"""What the command line prints where terminals, disks and hands are not as usual."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from eyechart.calls import CallKey, Reply, read_in
from eyechart.cli.terminal import print_each, print_line, say
from eyechart.costs import unread
from eyechart.ledger import Ledger
from eyechart.report.table import Column, Table
from eyechart.spaces.discrete import DRIVING

PROGRAM = (sys.executable, "-c", "from eyechart.cli import main; main()")


def run(*words: str, **environ: str) -> subprocess.CompletedProcess[bytes]:
    """Run the command line with other variables in its environment."""
    return subprocess.run([*PROGRAM, *words], capture_output=True, env=os.environ | environ, check=False)


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252"])
def test_a_terminal_that_cannot_print_a_sign_gets_another(encoding: str) -> None:
    """Whatever standard output can print, a list and an error line come without a traceback."""
    listed = run("list", "prompts", PYTHONIOENCODING=encoding)
    assert listed.returncode == 0
    assert b"Traceback" not in listed.stderr
    assert json.loads(run("list", "prompts", "--json", PYTHONIOENCODING=encoding).stdout.decode(encoding))
    wrong = run("verdict", "nö→such…", PYTHONIOENCODING=encoding)
    assert wrong.returncode == 2
    assert b"Traceback" not in wrong.stderr


def test_an_error_line_is_printable_whatever_a_name_holds() -> None:
    """An escape sequence in a path that the user gave does not reach the terminal."""
    wrong = run("verdict", "run\x1b[2J\x07", PYTHONIOENCODING="utf-8")
    assert wrong.returncode == 2
    assert b"\x1b" not in wrong.stderr
    assert wrong.stderr.count(b"\n") == 1


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_stream_that_is_closed_is_no_fault(closed: str, tmp_path: Path) -> None:
    """A file that a command opens never gets its number; what has no place for its output says so, and ends."""
    for words, status in (("list prompts", 2 if " >&-" in f" {closed}" else 0), (f"verdict {tmp_path}", 2)):
        line = f"{shlex.join(PROGRAM)} {words} {closed}"
        done = subprocess.run(["bash", "-c", line], capture_output=True, check=False)
        assert done.returncode == status, done.stderr
        assert b"Traceback" not in done.stdout + done.stderr
        if closed == ">&-":
            assert done.stderr == b"eyechart: the standard output is closed: redirect it to a file or to /dev/null\n"


def test_a_full_disk_is_called_a_full_disk() -> None:
    """Output that finds no room is one line that says so, and exit 2."""
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run([*PROGRAM, "list", "prompts"], stdout=full, stderr=subprocess.PIPE, check=False)
    assert done.returncode == 2
    assert b"the disk is full" in done.stderr
    assert done.stderr.count(b"\n") == 1


ENDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "hung up"}


@pytest.mark.slow
@pytest.mark.parametrize(("number", "again"), [(signal.SIGINT, 3), *((number, 1) for number in ENDS)])
@pytest.mark.parametrize("where", ["import", "options", "command"])
def test_a_signal_to_end_prints_one_line_and_its_exit_code(where: str, number: signal.Signals, again: int) -> None:
    """During imports, while options are read or in a command, once or several times at once: no traceback."""
    waits = "import sys, time, types; print('ready', flush=True, file=sys.__stderr__); time.sleep(30)"
    inside = {
        "import": f"class Slow:\n  def find_spec(self, name, *_):\n    if name == 'eyechart.cli.app':\n      {waits}\n"
        "import sys; sys.meta_path.insert(0, Slow())\nfrom eyechart.cli import main\nmain()",
        "options": f"from typer.core import TyperGroup\ndef slow(*_):\n  {waits}\nTyperGroup.parse_args = slow\n"
        "from eyechart.cli import main\nmain()",
        "command": f"import eyechart.models\ndef slow(*_):\n  {waits}\neyechart.models.known_models = slow\n"
        "from eyechart.cli import main\nmain()",
    }
    heard = "import signal\nsignal.signal(signal.SIGHUP, signal.SIG_DFL)\n"  # below nohup it would be ignored
    line = [sys.executable, "-c", f"{heard}{inside[where]}", "list", "models"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running:
        assert running.stderr is not None
        assert running.stderr.readline() == b"ready\n"
        for _ in range(again):
            running.send_signal(number)
            time.sleep(0.002)
        said = running.communicate(timeout=20)[1].decode()
    if again > 1:
        assert running.returncode in {128 + number, -number}  # a shell reports both alike
        assert "Traceback" not in said
        assert said.count("\n") <= 1
    else:
        assert running.returncode == 128 + number
        assert re.fullmatch(rf"{ENDS[number]}(: nothing more is done)?\n", said)


def test_a_signal_that_is_ignored_stays_so() -> None:
    """As ``nohup`` has it of a terminal that goes, and a shell of Ctrl-C for what runs in the background."""
    inside = (
        "import signal, sys, time\nfor one in (signal.SIGHUP, signal.SIGINT): signal.signal(one, signal.SIG_IGN)\n"
        "import eyechart.models\n"
        "def slow(*_):\n  print('ready', flush=True)\n  for _ in range(600): time.sleep(0.05)\n"
        "eyechart.models.known_models = slow\nfrom eyechart.cli import main\nmain()"
    )
    line = [sys.executable, "-c", inside, "list", "models"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running:
        assert running.stderr is not None
        assert running.stderr.readline() == b"ready\n"
        for number in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM):
            running.send_signal(number)
            time.sleep(0.1)
        said = running.communicate(timeout=20)[1]
    assert (running.returncode, said) == (143, b"terminated: nothing more is done\n")


@pytest.mark.parametrize("width", [80, 120])
def test_long_names_push_nothing_off_the_screen(width: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Two SPECs of 120 characters that differ in the middle: words beside them stand whole, and names stay distinct."""
    names = [f"openai:{'long/path/' * 6}{middle}{'/of/a/model' * 4}" for middle in ("one", "two")]
    rows = tuple((name[:120], "depth", "decided by near over far") for name in names)
    print_each([Table("verdicts", "", (Column("model"), Column("verdict", "word"), Column("by")), rows)], width)
    printed = capsys.readouterr().out
    assert printed.count("depth") == 2
    assert max(map(len, printed.splitlines())) <= width


def test_no_line_steers_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    """What steers a terminal or turns the direction of writing is replaced, in lines, tables and what is said."""
    evil = "model\x1b[2J\x9b\u202e\x07"
    print_each([evil, Table("a", "", (Column("model"),), ((evil,),))])
    print_line(evil)
    say(evil)
    both = "".join(capsys.readouterr())
    assert both.count("model") == 5  # four names and a head
    assert not set(both) & set("\x1b\x9b\x07")


REPLIES = [("Brake!", None), ("Brake!", None), ("\x1b[31mLEFT or RIGHT\x07", None), ("STOP", None), ("", "timeout")]


def test_unread_replies_are_listed_with_their_counts(kept_replies: Path) -> None:
    """Each different reply once, most frequent first and printable; neither errors nor what is read."""
    with Ledger(kept_replies) as ledger:
        found = unread(ledger, "m", DRIVING, read_in(DRIVING))
    assert [(one.count, one.missing) for one in found] == [(2, "unparsed"), (1, "unparsed")]
    assert found[0].text == "Brake!"
    assert found[1].text.isprintable()


@pytest.fixture
def kept_replies(tmp_path: Path) -> Path:
    """Return a ledger of one model's replies."""
    path = tmp_path / "ledger.sqlite"
    with Ledger(path, create=True) as ledger:
        for place, (text, error) in enumerate(REPLIES):
            key = CallKey("battery", "m", "p", f"f{place}", "real")
            ledger.close(ledger.begin(key, "digest"), Reply(text, "stop", error))  # type: ignore[arg-type]
    return path
