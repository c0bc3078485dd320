"""A run of episodes that is killed at random moments and resumed ends as one that nobody disturbed."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import tiny_worlds
from eyechart import episodes as study
from eyechart.episodes import read_episodes
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER

pytestmark = pytest.mark.slow

KILLS = 4
MODEL = "python:tiny_worlds:slow_look"


def size(file: Path) -> int:
    """Return how many calls the model has noted."""
    return file.stat().st_size // 5 if file.exists() else 0


def kill_after(out: Path, calls: Path, more: int) -> int:
    """Start or resume the run in a process of its own; kill it when its model was called so many times more."""
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "TINY_CALLS": str(calls)}
    enough = size(calls) + more
    with subprocess.Popen([sys.executable, "-m", "tiny_worlds", str(out)], env=env) as running:
        while running.poll() is None and size(calls) < enough:
            time.sleep(0.002)
        running.send_signal(signal.SIGKILL)
    return running.returncode


def test_episodes_killed_at_random_moments_end_as_undisturbed_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Equal records to the byte; no finished call is made again, and an unfinished one at most once a kill."""
    out, calls = tmp_path / "killed", tmp_path / "calls"
    moments = random.SystemRandom().sample(range(1, 16), KILLS)
    for more in moments:
        assert kill_after(out, calls, more) == -signal.SIGKILL, moments
    monkeypatch.setenv("TINY_CALLS", str(calls))
    assert tiny_worlds.planned(out).left()
    study.run(tiny_worlds.planned(out), bounds=study.Bounds(processes=2, concurrency=3))

    monkeypatch.setenv("TINY_CALLS", str(tmp_path / "other"))
    whole = tmp_path / "whole"
    study.run(tiny_worlds.planned(whole), bounds=study.Bounds(processes=2, concurrency=3))
    killed, undisturbed = (sorted(episode.as_line() for episode in read_episodes(folder)) for folder in (out, whole))
    assert killed == undisturbed, moments
    assert len(killed) == 24

    with Ledger(out / LEDGER) as ledger:
        sent = list(ledger.attempts(MODEL))
    finished = [attempt.key for attempt in sent if attempt.reply is not None]
    steps = sum(len(episode.steps) for episode in read_episodes(whole) if episode.key.policy == MODEL)
    assert len(finished) == len(set(finished)) == steps == size(tmp_path / "other")
    assert steps <= size(calls) <= len(sent) <= steps + KILLS * 3
