"""What a command read of a run is kept, believed only where it is this user's, and read anew after any change."""

import json
import os
import shutil
import sqlite3
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from banks import build_bank
from eyechart import cli, kept
from eyechart.calls import CallKey, Reply, read_in
from eyechart.errors import MissingCallsWarning, SpecError
from eyechart.ledger import COLUMNS, Ledger, SentAttempt, columns_of
from eyechart.ledger.counter import LedgerCount, WrittenCounts, write_counter
from eyechart.spaces.discrete import DRIVING
from eyechart.studies import battery
from eyechart.studies.battery.study import BatteryStudy

COMMANDS = ("verdict", "score", "score --all", "costs", "costs --all", "costs --unread", "gate --require looks")
Say = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of two controllers on the tiny bank, not read by any command."""
    folder = tmp_path_factory.mktemp("kept")
    bank = build_bank(folder / "bank")
    planned = battery.plan(bank.root, ["scripted:depth", "scripted:constant"], folder / "run")
    battery.run(planned)
    return folder / "run"


@pytest.fixture(autouse=True)
def _home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Give each test a home of its own."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    kept._key.cache_clear()


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    """Return a copy of the run."""
    return shutil.copytree(made, tmp_path / "run")


@pytest.fixture
def say(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Say:
    """Return a function that runs a command line and returns its exit code and output."""

    def ask(command: str, run: Path, *more: object) -> tuple[int, str, str]:
        name, *options = command.split()
        monkeypatch.setattr(sys, "argv", ["eyechart", name, str(run), *options, *map(str, more)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            cli.main()
        return int(left.value.code or 0), *capsys.readouterr()

    return ask


def readings(run: Path) -> list[Path]:
    """Return the readings that are kept of a run."""
    return sorted((run / kept.FOLDER).glob("*.json"))


def read_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every reading of a run from now on fail."""

    def fail(*_: object, **__: object) -> None:
        raise SpecError("it is read anew")

    for name in ("score", "took", "unread"):
        monkeypatch.setattr(BatteryStudy, name, fail)


@pytest.mark.parametrize("form", ["", " --json"])
@pytest.mark.parametrize("command", COMMANDS)
def test_a_second_answer_is_the_first_one_and_reads_nothing(
    command: str, form: str, run: Path, say: Say, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit code, standard output and standard error are the same; --fresh alone reads anew, to the same answer."""
    first = say(command + form, run)
    assert say(command + form, run, "--fresh") == first
    read_no_more(monkeypatch)
    assert say(command + form, run) == first
    assert say(command + form, run, "--fresh")[0] == 2


def test_each_setting_has_an_answer_of_its_own(run: Path, say: Say, tmp_path: Path) -> None:
    """Also the content of a price file; none is answered by what was kept for another."""
    prices = tmp_path / "prices.toml"
    entry = '[[price]]\nmodel = "scripted:depth"\ninput = {}\noutput = 1.0\ndate = "2026-01-01"\nsource = "s"\n'
    lines = []
    for command in ("verdict", "verdict --json", "score", "score --all", "costs", "gate", "gate --require looks"):
        say(command, run)
        lines.append(len(readings(run)))
    for dollars in ("1.0", "2.0"):
        prices.write_text(entry.format(dollars))
        say("costs", run, "--prices", prices)
        lines.append(len(readings(run)))
    assert lines == list(range(1, 10))
    say("costs", run, "--prices", prices)
    assert len(readings(run)) == 9


def test_a_changed_byte_of_the_ledger_is_found_whatever_its_time_says(run: Path, say: Say) -> None:
    """Size and time of the file are as before: the digest is not, and the damaged reply is refused."""
    assert say("gate --require looks", run)[0] in {0, 1, 2}
    ledger, before = run / "ledger.sqlite", (run / "ledger.sqlite").stat()
    content = ledger.read_bytes()
    at = content.rindex(b"SLOW")
    ledger.write_bytes(content[:at] + b"STOP" + content[at + 4 :])
    os.utime(ledger, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert (ledger.stat().st_size, ledger.stat().st_mtime_ns) == (before.st_size, before.st_mtime_ns)
    code, out, err = say("gate --require looks", run)
    assert (code, out) == (2, "")
    assert "is damaged in" in err


@pytest.mark.parametrize("name", ["run.json", "bank/bank.json"])
def test_a_changed_text_of_the_run_is_read_anew(
    name: str, run: Path, say: Say, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A byte more is another content."""
    say("verdict", run)
    with (run / name).open("a") as file:
        file.write(" ")
    read_no_more(monkeypatch)
    assert "read anew" in say("verdict", run)[2]


def test_a_run_that_grew_is_read_anew(made: Path, tmp_path: Path, say: Say) -> None:
    """An unfinished run, then a finished one: each answer is that of a run which nobody read before."""
    bank, answers = made.parent / "bank", []
    for read_before in (True, False):
        out = tmp_path / f"{read_before}"
        for limit in (2, None):
            extent = battery.BatterySelection(limit=limit)
            battery.run(battery.plan(bank, ["scripted:depth"], out, extent=extent))
            if read_before or limit is None:
                answers.append(say("verdict", out)[1].replace(str(out), "RUN"))
    assert answers[0] != answers[1]
    assert answers[1] == answers[2]


SPOILED: dict[str, Callable[[bytes], bytes]] = {
    "cut": lambda content: content[: len(content) // 2],
    "empty": lambda _: b"",
    "a changed byte": lambda content: content[:-3] + bytes([content[-3] ^ 1]) + content[-2:],
    "forged": lambda content: content[:64] + b'\n{"width": null, "names": [], "parts": ["it looks"]}',
    "no seal": lambda content: content[65:],
    "not JSON": lambda content: content[:64] + b"\n{",
}


@pytest.mark.parametrize("how", [*SPOILED, "a pipe", "a link", "of another user", "too large"])
def test_a_reading_that_is_not_whole_or_not_this_user_s_is_read_anew(
    how: str, run: Path, say: Say, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The answer is the one of a run that nobody read, in silence, and it is kept in place of the other."""
    first = say("verdict", run)
    (file,) = readings(run)
    content = file.read_bytes()
    if how == "of another user":
        monkeypatch.setenv("HOME", str(tmp_path / "another"))
        kept._key.cache_clear()
        say("verdict", run, "--fresh")
        monkeypatch.setenv("HOME", str(tmp_path / "home"))
        kept._key.cache_clear()
    elif how == "too large":
        monkeypatch.setitem(vars(kept.JSON), "most_bytes", len(content) - 1)
    else:
        file.unlink()
        if how == "a pipe":
            os.mkfifo(file)
        elif how == "a link":
            (tmp_path / "elsewhere").write_bytes(content)
            file.symlink_to(tmp_path / "elsewhere")
        else:
            file.write_bytes(SPOILED[how](content))
    assert say("verdict", run) == first
    read_no_more(monkeypatch)
    assert (say("verdict", run) == first) is (how != "too large")


@pytest.mark.parametrize("why", ["no folder can be made", "no home", "the folder leads elsewhere"])
def test_where_nothing_can_be_kept_every_answer_is_read(
    why: str, run: Path, say: Say, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder that cannot be written is read as any other; what leads out of the run is not written to."""
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    if why == "no folder can be made":
        (run / kept.FOLDER).write_text("a file")
    elif why == "no home":
        (tmp_path / "home").write_text("a file")
    else:
        (run / kept.FOLDER).symlink_to(elsewhere)
    first = say("verdict", run)
    assert first[0] == 0
    assert say("verdict", run) == first
    assert list(elsewhere.iterdir()) == []
    read_no_more(monkeypatch)
    assert say("verdict", run)[0] == 2


def test_what_is_missing_is_said_at_every_answer(run: Path) -> None:
    """A ledger that lost calls is warned of; such an answer is not kept."""
    with Ledger(run / "ledger.sqlite") as ledger:
        held = ledger.held()
    write_counter(run / "ledger.sqlite", LedgerCount(held.plus(WrittenCounts(2, 1))))
    words = [sys.executable, "-m", "eyechart", "verdict", str(run)]
    for unheard in (True, False, False):  # an answer that hides warnings is not kept for those who want them
        environment = {**os.environ, "PYTHONWARNINGS": "ignore" if unheard else ""}
        said = subprocess.run(words, capture_output=True, text=True, timeout=120, check=True, env=environment)
        assert ("2 requests and 1 reply" in said.stderr) is not unheard
    assert readings(run) == []


def test_a_warning_that_was_shown_already_keeps_nothing_either(run: Path) -> None:
    """Python shows a text once in a process; the next process has not shown it."""

    def make() -> int:
        warnings.warn("calls are missing", MissingCallsWarning, stacklevel=1)
        return 1

    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("default")
        for number in (1, 1, 2):
            kept.kept(run, ["count", number], make)
    assert shown
    assert readings(run) == []


@pytest.mark.parametrize("rights", [0o644, 0o620, 0o606])
def test_a_key_that_others_may_read_or_write_is_replaced(run: Path, say: Say, tmp_path: Path, rights: int) -> None:
    """Who knows it can seal; so no reading under it is believed, and the next one is sealed with another."""
    first = say("verdict", run)
    key = tmp_path / "home" / ".cache" / "eyechart" / "readings.key"
    before, (reading,) = key.read_bytes(), readings(run)
    forged = b'{"width": null, "names": [], "parts": ["it looks"]}'
    reading.write_bytes(kept._sealed(reading.name, [memoryview(forged)], before) + b"\n" + forged)
    key.chmod(rights)
    kept._key.cache_clear()
    assert say("verdict", run) == first
    assert key.read_bytes() != before
    assert key.stat().st_mode & 0o777 == 0o600
    assert [path.name for path in key.parent.iterdir()] == [key.name]


@pytest.mark.parametrize("how", ["a pipe", "a link", "a folder", "of another user"])
def test_a_key_that_is_no_file_of_this_user_s_is_not_used(
    run: Path, say: Say, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    """Nothing is kept, and the place stays as it is."""
    first = say("verdict", run, "--fresh")
    shutil.rmtree(run / kept.FOLDER)
    key = tmp_path / "home" / ".cache" / "eyechart" / "readings.key"
    if how == "of another user":
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
    else:
        key.rename(tmp_path / "key")
        {"a pipe": os.mkfifo, "a folder": os.mkdir, "a link": lambda at: at.symlink_to(tmp_path / "key")}[how](key)
    before = key.lstat()
    kept._key.cache_clear()
    assert say("verdict", run) == first
    assert not (run / kept.FOLDER).exists()
    assert key.lstat() == before


def test_a_home_without_hard_links_keeps_no_part_of_a_key(
    run: Path, say: Say, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Then nothing is kept."""

    def refuse(*_: object) -> None:
        raise PermissionError("no links here")

    monkeypatch.setattr(os, "link", refuse)
    assert say("verdict", run)[0] == 0
    assert list((tmp_path / "home" / ".cache" / "eyechart").iterdir()) == []


def test_what_a_killed_command_left_goes_with_the_next_reading(run: Path, say: Say) -> None:
    """A part of a reading; but not that of a command that is at work."""
    say("verdict", run)
    for name, age_s in (("left", 10**5), ("at work", 10)):
        part = run / kept.FOLDER / f".{name}.1.ab.new"
        part.write_bytes(b"part")
        os.utime(part, (time.time() - age_s,) * 2)
    say("costs", run)
    assert [path.name for path in (run / kept.FOLDER).glob(".*.new")] == [".at work.1.ab.new"]


def test_another_program_reads_anew(run: Path, say: Say, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another source, or another numpy, may count otherwise."""
    say("verdict", run)
    monkeypatch.setattr(kept, "_program", lambda: "another")
    read_no_more(monkeypatch)
    assert say("verdict", run)[0] == 2


def test_a_run_that_changes_meanwhile_is_not_kept(run: Path, say: Say, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was read may be of the content before or of that after."""
    score = BatteryStudy.score

    def changing(study: BatteryStudy, *given: object) -> object:
        found = score(study, *given)  # type: ignore[arg-type]
        (run / "notes.txt").write_text("now")
        return found

    monkeypatch.setattr(BatteryStudy, "score", changing)
    assert say("verdict", run)[0] == 0
    assert readings(run) == []


def test_a_ledger_that_was_another_meanwhile_is_not_kept(
    run: Path, say: Say, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It lay elsewhere while another in its place was read, and came back: same name, size, time and number."""
    first, score, ledger = say("verdict", run), BatteryStudy.score, run / "ledger.sqlite"
    shutil.rmtree(run / kept.FOLDER)
    for path in run.rglob("*"):
        os.utime(path, ns=(10**18, 10**18))

    def swapping(study: BatteryStudy, *given: object) -> object:
        ledger.rename(tmp_path / "aside")
        shutil.copyfile(tmp_path / "aside", ledger)
        with sqlite3.connect(ledger) as sql:
            sql.execute("DELETE FROM replies WHERE attempt > 20")
        try:
            return score(study, *given)  # type: ignore[arg-type]
        finally:
            (tmp_path / "aside").rename(ledger)

    monkeypatch.setattr(BatteryStudy, "score", swapping)
    assert say("verdict", run) != first
    monkeypatch.setattr(BatteryStudy, "score", score)
    assert say("verdict", run) == first


def test_commands_at_once_do_not_harm_one_another(run: Path) -> None:
    """Each answers as one alone; one reading is left, and no part of one."""
    words = [sys.executable, "-m", "eyechart", "verdict", str(run), "--json"]
    several = [subprocess.Popen(words, stdout=subprocess.PIPE) for _ in range(4)]
    answers = {one.communicate(timeout=120)[0] for one in several}
    assert len(answers) == 1
    assert json.loads(answers.pop())["models"]
    assert sorted(path.suffix for path in (run / kept.FOLDER).iterdir()) == [".columns", ".json"]


def test_only_so_many_readings_are_kept(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The oldest go first."""
    monkeypatch.setattr(kept, "_MOST_KEPT", 3)
    for number in range(5):
        kept.kept(run, ["count", number], lambda number=number: number)
        os.utime(max(readings(run), key=lambda path: path.stat().st_mtime_ns), ns=(number, number))
    assert len(readings(run)) == 3
    counted: list[int] = []
    for number in (4, 0):
        kept.kept(run, ["count", number], lambda number=number: counted.append(number))
    assert counted == [0]


def test_a_picture_elsewhere_that_comes_back_is_compared_again(run: Path, say: Say) -> None:
    """The pictures that the run recorded lie outside it; a score compares its requests with those that are there."""
    say("verdict", run)
    place = Path(json.loads((run / "run.json").read_text())["bank_path"])
    picture = next(place.rglob("*.png"))
    before = picture.stat()
    try:
        os.utime(picture, ns=(before.st_atime_ns, before.st_mtime_ns - 10**9))
        say("verdict", run)
        assert len(readings(run)) == 2
    finally:
        os.utime(picture, ns=(before.st_atime_ns, before.st_mtime_ns))


def test_a_ledger_is_read_once_for_all_commands(run: Path, say: Say, monkeypatch: pytest.MonkeyPatch) -> None:
    """Other commands, settings and prices count the columns that the first one kept; --fresh alone reads anew."""
    nobody = shutil.copytree(run, run.with_name("nobody"))
    commands = ("verdict --json", "score --json", "costs --json", "gate --json", "score --all --json")
    alone = [say(command, nobody, "--fresh")[:2] for command in commands]
    say("verdict", run)

    def fail(*_: object, **__: object) -> None:
        raise SpecError("the ledger is read anew")

    monkeypatch.setattr(Ledger, "columns", fail)
    found = [say(command, run)[:2] for command in commands]
    assert [(code, out.replace(str(run), "RUN")) for code, out in found] == [
        (code, out.replace(str(nobody), "RUN")) for code, out in alone
    ]
    for command in commands:
        assert say(command, run, "--fresh")[0] == 2


@pytest.mark.parametrize("how", ["cut", "a changed byte"])
def test_damaged_columns_are_read_anew(how: str, run: Path, say: Say) -> None:
    """A command that finds them spoiled answers as one that finds none."""
    first = say("score", run)
    (columns,) = (run / kept.FOLDER).glob("*.columns")
    for file in readings(run):
        file.unlink()
    columns.write_bytes(SPOILED[how](columns.read_bytes()))
    assert say("score", run) == first


def test_columns_are_read_back_as_they_were() -> None:
    """Codes, numbers, times, names of servers, reasons and texts; an array that is no number is refused."""
    key = CallKey("battery", "m", "p", "f0", "real")
    replies = [
        Reply("SLOW", "stop", prompt_tokens=7, seconds=0.25, served="a", cost_usd=0.5),
        Reply("No road.", "length", reasoning="because", seconds=0.5),
        Reply(error="timeout"),
        None,
    ]
    sent = [
        SentAttempt(
            key._replace(frame=f"f{at}", model="mn"[at % 2]), 1, None, reply, f"{at:064x}", final=reply is not None
        )
        for at, reply in enumerate(replies)
    ]
    made = columns_of(sent, read_in(DRIVING))
    parts = COLUMNS.write(made)
    assert parts is not None
    body = b"".join(parts)
    back = COLUMNS.read(memoryview(body))
    for name, one in vars(back).items():
        other = getattr(made, name)
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other)
        elif name in {"codes", "whole", "real"}:
            assert one.keys() == other.keys()
            for column, values in one.items():
                np.testing.assert_array_equal(values, other[column])
        elif name != "repeats":
            assert one == other
    np.testing.assert_array_equal(back.repeats.text, made.repeats.text)
    with pytest.raises(ValueError, match="no column of numbers"):
        COLUMNS.read(memoryview(body.replace(b'"|b1"', b'"|O1"', 1).replace(b"|O1", b"|O8", 1)))
    with pytest.raises(ValueError, match="no line"):
        COLUMNS.read(memoryview(body.replace(b"\n", b" ")))


@pytest.mark.parametrize(("young_ns", "times"), [(0, 1), (10**18, 3)])
def test_a_file_is_hashed_once_a_process_unless_it_changed_lately(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, young_ns: int, times: int
) -> None:
    """A ledger may be large; one that changed lately may change again within a tick of its clock."""
    (tmp_path / "ledger.sqlite").write_bytes(b"rows")
    hashed: list[str] = []
    whole = kept._hashed
    monkeypatch.setattr(kept, "_hashed", lambda path: hashed.append(path) or whole(path))
    monkeypatch.setattr(kept, "_YOUNG_NS", young_ns)
    assert len({kept._seen(tmp_path, ["score"]).digest for _ in range(3)}) == 1
    assert len(hashed) == times
    (tmp_path / "ledger.sqlite").write_bytes(b"more")
    kept._seen(tmp_path, ["score"])
    assert len(hashed) == times + 1
