"""What every command says of a run whose ledger is damaged, is no ledger, or lacks calls: one line, and exit code 2."""

import json
import re
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import banks
import stand_ins
from bundles import checked
from eyechart import models
from eyechart.bundle import validate
from eyechart.calls import MOST
from eyechart.cli.app import app
from eyechart.errors import EyechartError
from eyechart.limits import Limits
from eyechart.studies import battery

READING = {
    "score": "score RUN",
    "score --json": "score RUN --json",
    "verdict": "verdict RUN",
    "costs": "costs RUN",
    "gate": "gate RUN",
    "report": "report RUN --out page.html",
    "bundle": "bundle RUN --out run.zip --frames BANK",
    "compare": "compare RUN SOUND",
    "transfer": "transfer RUN --scores scores.csv",
    "merge": "merge RUN --out merged",
    "run": "run battery --frames BANK --out RUN --model standin:noisy",
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a bank and a run of it, of which 30 calls are made."""
    folder = tmp_path_factory.mktemp("made")
    bank = banks.build_bank(folder / "bank", drawn=False)
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(models.ADAPTERS, "standin", "stand_ins")
        battery.run(battery.plan(bank.root, stand_ins.SPECS[:1], folder / "run"), limits=Limits(calls=30))
    return folder


@pytest.fixture
def run(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a copy of the run, to be changed, in the folder in which commands are given."""
    monkeypatch.setitem(models.ADAPTERS, "standin", "stand_ins")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scores.csv").write_text("model,score\nstandin:noisy,0.5\n", encoding="utf-8")
    shutil.copytree(made / "run", tmp_path / "sound")
    return shutil.copytree(made / "run", tmp_path / "run")


@pytest.fixture
def say(made: Path) -> Callable[[str], Result]:
    """Return a function that gives a command by its name."""

    def give(name: str) -> Result:
        words = READING[name].replace("RUN", "run").replace("BANK", str(made / "bank")).replace("SOUND", "sound")
        return CliRunner().invoke(app, words.split())

    return give


def flip(run: Path) -> None:
    """Change one sign of one reply in a run's ledger, as a damaged disk does, without a word to SQLite."""
    ledger = run / "ledger.sqlite"
    with closing(sqlite3.connect(ledger)) as sql:
        sql.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        ((digest,),) = sql.execute("SELECT row_sha256 FROM replies WHERE attempt = 17")
    whole = ledger.read_bytes()
    at = whole.index(digest.encode()) + 3
    ledger.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])


@pytest.mark.parametrize("command", READING)
def test_a_flipped_bit_in_a_reply_is_named_by_every_command(
    run: Path, say: Callable[[str], Result], command: str
) -> None:
    """With the call that it answered; nothing is printed or written that rests on it, and no call is made."""
    flip(run)
    before = sorted(Path().rglob("*"))
    said = say(command)
    assert isinstance(said.exception, EyechartError)  # which the command line prints, and exits 2
    assert "run/ledger.sqlite is damaged in standin:" in str(said.exception)
    assert "'s reply about " in str(said.exception)
    assert said.stdout == ""
    assert sorted(Path().rglob("*")) == before


@pytest.mark.parametrize("command", READING)
def test_an_empty_ledger_is_refused_by_every_command(run: Path, say: Callable[[str], Result], command: str) -> None:
    """It is no run without calls, but one whose calls were lost."""
    for path in run.glob("ledger.sqlite*"):
        path.unlink()
    (run / "ledger.sqlite").touch()
    said = say(command)
    assert isinstance(said.exception, EyechartError)
    assert "run/ledger.sqlite holds no table (0 bytes)" in str(said.exception)
    assert said.stdout == ""


@pytest.mark.parametrize("command", READING)
def test_a_foreign_trigger_is_refused_by_every_command(run: Path, say: Callable[[str], Result], command: str) -> None:
    """Not in bundles alone: what it does to rows that are appended nobody knows."""
    with closing(sqlite3.connect(run / "ledger.sqlite")) as sql:
        sql.execute("CREATE TRIGGER loud AFTER INSERT ON replies BEGIN DELETE FROM calls; END")
    said = say(command)
    assert isinstance(said.exception, EyechartError)
    assert "run/ledger.sqlite is no plain ledger: loud of its schema differ" in str(said.exception)


@pytest.mark.slow
def test_no_command_falls_over_a_number_that_nobody_can_have_measured(run: Path, say: Callable[[str], Result]) -> None:
    """What an older eyechart kept of a server that said so is shown as not reported, and a bundle of it validates."""
    with closing(sqlite3.connect(run / "ledger.sqlite")) as sql:
        ((trigger,),) = sql.execute("SELECT sql FROM sqlite_master WHERE name = 'replies_UPDATE'")
        sql.execute("DROP TRIGGER replies_UPDATE")
        whole = [name for name in MOST if name.endswith(("tokens", "bytes")) or name == "status"]
        for values, names in ((("-1", 2**63 - 1), whole), (("1e308", "9e999", "-1"), MOST.keys() - set(whole))):
            for place, name in enumerate(sorted(names)):
                value = values[place % len(values)]
                sql.execute(f"UPDATE replies SET {name} = {value}")  # noqa: S608 - our own names
        checked(sql)
        sql.execute(trigger)
        sql.commit()
    for command in (*READING, "costs RUN --json", "verdict RUN --json", "report RUN --tables tables --out page.html"):
        if command in {"merge", "run"}:
            continue
        said = say(command) if command in READING else CliRunner().invoke(app, command.replace("RUN", "run").split())
        assert said.exception is None or isinstance(said.exception, SystemExit | EyechartError), command
        assert not isinstance(said.exception, EyechartError) or command == "compare", command
        if "--json" in command:
            assert not re.search(r"1e\+?308|Infinity|NaN", said.stdout)
        if command == "costs RUN --json":
            account = json.loads(said.stdout)["accounting"]["standin:noisy"]["all"]
            assert (account["cost_usd"], account["latency_median_s"], account["energy_j"]) == (None, None, None)
    assert [difference.where for difference in validate(Path("run.zip")).differences] == []
