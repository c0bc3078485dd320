"""Growth is measured on ledgers that a script fills, which are as a run writes them, and its exponents are slopes."""

import json
import shutil
import sqlite3
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import growth
from eyechart.conditions import BATTERY
from eyechart.ledger import Ledger
from eyechart.ledger.counter import read_counter
from eyechart.ledger.rows import KEY_OF_CALL
from eyechart.manifest import LEDGER
from eyechart.studies.battery import plan, run

FRAMES, MODELS = 48, 2
RESULT = json.loads(growth.RESULT.read_text(encoding="utf-8"))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> growth.Folder:
    """Return an empty folder, whose models can be imported."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, growth.ANSWERS, raising=False)
    return growth.Folder(tmp_path)


def _asked(ledger: Path) -> tuple[Any, ...]:
    """Return a ledger's schema, the head of its file, its counter, and every call with its attempt, in order."""
    rows = (
        f"SELECT {KEY_OF_CALL}, a.number, a.reason, a.request_sha256, r.final "  # noqa: S608 - of this text
        "FROM calls c JOIN attempts a ON a.call = c.id JOIN replies r ON r.attempt = a.id AND r.call = c.id"
    )
    with closing(sqlite3.connect(ledger)) as sql:
        schema = sorted(sql.execute("SELECT type, name, tbl_name, sql FROM sqlite_master").fetchall(), key=repr)
        return schema, ledger.read_bytes()[:24], read_counter(ledger), sorted(sql.execute(rows).fetchall(), key=repr)


def test_a_filled_ledger_holds_what_a_run_asks(folder: growth.Folder) -> None:
    """The same calls and requests in a file of the same kind; nothing is damaged, and nothing is left to ask."""
    filled = folder.run(FRAMES, MODELS)
    asked = plan(folder.bank(FRAMES), folder.specs(MODELS), folder.root / "made", conditions=BATTERY)
    run(asked)
    assert _asked(filled / LEDGER) == _asked(asked.out / LEDGER)
    with Ledger(filled / LEDGER) as ledger:
        assert ledger.damaged() == []
        assert ledger.unchecked() == 0
    assert plan(folder.bank(FRAMES), folder.specs(MODELS), filled, conditions=BATTERY).left() == 0


def test_what_is_whole_is_not_filled_again_and_what_is_not_is(folder: growth.Folder) -> None:
    """A script that was killed leaves a folder without its mark."""
    filled = folder.run(FRAMES, 1)
    shutil.rmtree(filled)
    assert not folder.run(FRAMES, 1).exists()
    filled.with_name(f"{filled.name}.whole").unlink()
    assert (folder.run(FRAMES, 1) / LEDGER).is_file()


@pytest.mark.slow
def test_every_command_is_measured(folder: growth.Folder) -> None:
    """Of a bank of few frames, with its memory."""
    for command in growth.COMMANDS:
        took, memory = growth.least(command, (FRAMES, 1), folder, start=1000.0)
        assert 0.05 < took < 600, command
        assert 20 < memory < 2000, command


def test_the_exponent_is_the_slope_above_the_start() -> None:
    """A start counts for nothing; what takes little more than it is left out, and two sizes have no slope."""
    sizes = [10, 1000, 2000, 4000, 8000]
    took = [0.5 + 1e-5 * size**1.5 for size in sizes]
    assert growth.exponent(sizes, took, 0.5) == {"exponent": 1.5, "low": 1.5, "high": 1.5, "n": 4}
    assert growth.exponent(sizes[:3], took[:3], 0.5) is None
    noisy = growth.exponent(sizes, [*took[:4], 1.3 * took[4]], 0.5)
    assert noisy is not None
    assert noisy["low"] < 1.5 < noisy["exponent"] < noisy["high"]


def test_the_result_has_the_exponents_of_its_rows() -> None:
    """Of every command along each axis, as the script finds them today."""
    for axis in growth.AXES:
        for command, one in RESULT[axis].items():
            calls, took = zip(*((row["calls"], row["cpu_s"]) for row in one["rows"]), strict=True)
            assert one["grows"] == growth.exponent(calls, took, RESULT["start_s"][command]), (axis, command)
