"""A battery that is killed ten times and resumed each time ends as one that nobody disturbed."""

import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

import banks
import stand_ins
from eyechart.calls import CallKey
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.models import ADAPTERS
from eyechart.spaces.space import Decision
from eyechart.studies import battery as study
from eyechart.verdicts import judge

pytestmark = pytest.mark.slow

KILLS = 10
CONCURRENCY = 4


def kill_after(out: Path, bank: FrameBank, attempts: int) -> int:
    """Start or resume the battery in a process of its own; kill it when its ledger has grown by so many attempts."""
    env = os.environ | {"PYTHONPATH": str(Path(stand_ins.__file__).parent)}
    words = [sys.executable, "-m", "stand_ins", str(bank.root), str(out), "0.04"]
    attempts += stand_ins.rows_in(out / LEDGER, "attempts")
    with subprocess.Popen(words, env=env) as running:
        while running.poll() is None and stand_ins.rows_in(out / LEDGER, "attempts") < attempts:
            time.sleep(0.001)
        running.send_signal(signal.SIGKILL)
    return running.returncode


def decisions(out: Path, bank: FrameBank) -> dict[CallKey, Decision[str]]:
    """Read every decision of a run from its ledger."""
    with Ledger(out / LEDGER) as ledger:
        return {
            key: bank.manifest.action_space.read(reply)
            for spec in stand_ins.SPECS
            for key, reply in ledger.replies(spec)
        }


def readings(out: Path) -> tuple[str, str]:
    """Return score and verdicts as JSON, without the section that says what the calls took."""
    scored = study.score(out, resamples=300)
    plain = scored.as_dict()
    del plain["accounting"], plain["guards"]
    return json.dumps(plain), json.dumps({spec: one.as_dict() for spec, one in judge(scored).items()})


def test_a_battery_killed_at_ten_moments_ends_as_an_undisturbed_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every planned call finished exactly once; decisions, statistics and verdicts equal to the byte."""
    bank, out = banks.build_bank(tmp_path / "bank", steps=4), tmp_path / "killed"
    monkeypatch.setitem(ADAPTERS, "standin", "stand_ins")
    planned = study.plan(bank.root, stand_ins.SPECS, out, seed=7)
    keys = planned.plan.keys()
    for attempts in (1, *random.Random(2).sample(range(1, 50), KILLS - 1)):  # noqa: S311
        assert kill_after(out, bank, attempts) == -signal.SIGKILL
    assert 0 < planned.counts()[1] < len(keys)
    assert planned.counts()[2] > 0
    study.run(study.plan(bank.root, stand_ins.SPECS, out, seed=7), concurrency=CONCURRENCY)

    with closing(sqlite3.connect(out / LEDGER)) as sql:
        finals = sql.execute("SELECT call, count(*) FROM replies WHERE final = 1 GROUP BY call").fetchall()
        (attempts,) = sql.execute("SELECT count(*) FROM attempts").fetchone()
    assert planned.counts() == (len(keys), len(keys), 0)
    assert len(finals) == len(keys)
    assert {count for _, count in finals} == {1}
    assert len(keys) < attempts <= len(keys) + KILLS * CONCURRENCY * len(stand_ins.SPECS)

    whole = tmp_path / "whole"
    study.run(study.plan(bank.root, stand_ins.SPECS, whole, seed=7), concurrency=CONCURRENCY)
    assert decisions(out, bank) == decisions(whole, bank)
    assert set(decisions(out, bank)) == set(keys)
    assert readings(out) == readings(whole)
