"""A run over a network, killed twenty times: no finished call is repeated or lost, and every repeat is marked."""

import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

import banks
import killed
from eyechart.ledger import UNKNOWN, Ledger
from eyechart.manifest import LEDGER
from eyechart.modes import RequestMode
from eyechart.studies import battery as study
from faults import FaultServer, _seeded, seeded_action

KILLS = 20


@pytest.mark.slow
def test_a_run_killed_at_twenty_moments_repeats_only_what_was_under_way(tmp_path: Path) -> None:
    """The server's own count says so: every call once, and once more for each attempt whose outcome was lost."""
    bank, out = banks.build_bank(tmp_path / "bank", steps=4), tmp_path / "run"
    env = os.environ | {"PYTHONPATH": str(Path(killed.__file__).parent)}
    with FaultServer([_seeded], pause_s=0.12) as server:
        words = [sys.executable, killed.__file__, str(bank.root), str(out), server.base_url, str(KILLS)]
        process = subprocess.run(words, env=env, check=True, capture_output=True, text=True, timeout=120)
        ends = [int(line) for line in process.stdout.split()]
        assert ends == [-signal.SIGKILL] * KILLS
        mode = RequestMode(killed.SPEC, base_url=server.base_url, seed=True)
        planned = study.plan(bank.root, [mode], out, seed=7)
        before = planned.counts()
        assert 0 < before[1] < before[0]
        assert before[2] > 0
        outcome = study.run(planned, concurrency=killed.CONCURRENCY)
        answered = {asked["seed"]: seeded_action(asked) for asked in server.asked}
    assert (outcome.set_aside, outcome.stopped) == ({}, None)
    with Ledger(out / LEDGER) as ledger:
        sent = list(ledger.attempts(killed.SPEC))
        replies = {key: reply.text for key, reply in ledger.replies(killed.SPEC)}
    keys = set(replies)  # those of later stages too
    assert keys > set(planned.plan.keys())
    lost = [attempt for attempt in sent if attempt.reply is None]
    assert planned.counts() == (len(keys), len(keys), 0)
    assert Counter(attempt.key for attempt in sent if attempt.reply is not None) == Counter(keys)
    assert len(sent) == len(keys) + len(lost)
    assert 0 < len(lost) <= (KILLS + 1) * killed.CONCURRENCY
    assert sum(attempt.reason == UNKNOWN for attempt in sent) == len(lost)
    assert all(attempt.reason == (UNKNOWN if attempt.number > 1 else None) for attempt in sent)
    assert len(sent) - len(lost) <= server.requests <= len(sent)
    assert replies == {key: answered[key.seed(7) % 2**31] for key in keys}
