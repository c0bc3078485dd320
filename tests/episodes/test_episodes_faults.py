"""Worlds and models that fail: each ends in a record that says why, and the other episodes finish."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

import tiny_worlds
from eyechart import episodes as study
from eyechart.episodes import Bounds, Episode, plans, read_episodes
from eyechart.episodes.workers import LocalWorker
from eyechart.errors import LedgerError
from eyechart.ledger import Ledger
from eyechart.limits import Limits
from eyechart.manifest import LEDGER

pytestmark = pytest.mark.slow

LOOK = "python:tiny_worlds:look"


def drive(out: Path, *specs: str, scenarios: list[str], processes: int = 2) -> dict[tuple[str, str], Episode]:
    """Drive one seed of these scenarios and return the episodes by policy and scenario."""
    plan = study.plan(study.Setup("tiny", max_steps=40), specs, out, scenarios=scenarios, seeds=[0])
    study.run(plan, bounds=Bounds(processes=processes, concurrency=4))
    return {(episode.key.policy, episode.key.scenario): episode for episode in read_episodes(out)}


@pytest.fixture(scope="module")
def faults(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], Episode]:
    """Return what came of every fault that raises nothing outside its world, beside a whole one."""
    from eyechart import simulators  # noqa: PLC0415

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(simulators.SIMULATORS, "tiny", tiny_worlds.SIMULATORS["tiny"])
        out = tmp_path_factory.mktemp("faults") / "run"
        return drive(
            out, LOOK, "oracle", "constant:SLOW", scenarios=["whole", "black", "endless", "raising", "nonsense"]
        )


@pytest.mark.parametrize("policy", [LOOK, "oracle", "constant:SLOW"])
@pytest.mark.parametrize(
    ("scenario", "steps", "words"),
    [
        ("black", 0, "the camera shows black only"),
        ("endless", 40, "it did not end within 40 steps"),
        ("raising", 2, "RuntimeError: the physics engine diverged"),
        ("nonsense", 0, "the world's reward is nan"),
    ],
)
def test_a_world_that_fails_is_an_error_that_says_why(
    faults: dict[tuple[str, str], Episode], policy: str, scenario: str, steps: int, words: str
) -> None:
    """With the steps until then, whoever drives; and the whole world comes to its end beside it."""
    episode = faults[policy, scenario]
    assert (episode.ended, len(episode.steps)) == ("error", steps)
    assert words in episode.detail
    assert faults[policy, "whole"].ended in {"goal", "time"}


def test_a_world_that_takes_its_process_down_costs_its_own_episode_only(tmp_path: Path) -> None:
    """It is tried once more, alone; models and policies in the same process finish."""
    found = drive(tmp_path / "run", LOOK, "oracle", scenarios=["whole", "fatal"], processes=1)
    for policy in (LOOK, "oracle"):
        assert found[policy, "fatal"].ended == "error"
        assert "took its process down, twice" in found[policy, "fatal"].detail
        assert "exit code -9" in found[policy, "fatal"].detail
        assert found[policy, "whole"].ended == "goal"
    with Ledger(tmp_path / "run" / LEDGER) as ledger:
        sent = [attempt.key for attempt in ledger.attempts(LOOK)]
    assert len(sent) == len(set(sent))


def test_a_process_that_dies_once_is_survived(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The episode is driven again from its beginning, and no record shows it."""
    monkeypatch.setenv("TINY_MARK", str(tmp_path / "mark"))
    found = drive(tmp_path / "run", LOOK, scenarios=["fatal_once"], processes=1)
    assert (tmp_path / "mark").exists()
    assert found[LOOK, "fatal_once"].ended == "goal"


def test_a_step_that_never_returns_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After so many seconds without a sign of life."""
    monkeypatch.setattr(plans, "LocalWorker", partial(LocalWorker, patience_s=8.0))
    found = drive(tmp_path / "run", "oracle", scenarios=["hanging", "whole"], processes=2)
    assert "did not answer for 8 s" in found["oracle", "hanging"].detail
    assert found["oracle", "whole"].ended == "goal"


def test_a_model_that_raises_is_set_aside_and_the_others_drive_on(tmp_path: Path) -> None:
    """Its calls stand in the ledger with what it raised; its episodes are unfinished, and no record is made up."""
    plan = study.plan(
        "tiny", ["python:tiny_worlds:failing", LOOK], tmp_path / "run", scenarios=["whole"], seeds=range(3)
    )
    outcome = study.run(plan, bounds=Bounds(concurrency=2))
    assert "10 calls in a row failed, the last one with exception: RuntimeError: out of memory" in " ".join(
        outcome.set_aside.values()
    )
    assert {episode.key.policy for episode in read_episodes(tmp_path / "run") if episode.ended == "goal"} == {LOOK}
    assert len(plan.left()) == 3


def test_a_world_that_does_not_repeat_itself_is_found_out_when_it_is_driven_again(tmp_path: Path) -> None:
    """A cut episode whose calls were about other pictures cannot go on as if nothing had happened."""
    plan = study.plan("tiny", [LOOK], tmp_path / "run", scenarios=["restless"], seeds=[0])
    study.run(plan, bounds=Bounds(limits=Limits(calls=1)))
    assert len(plan.left()) == 1
    study.run(plan)
    (episode,) = read_episodes(tmp_path / "run")
    assert episode.ended == "error"
    assert "at step 0 the world shows another picture than in the model's call" in episode.detail


def test_what_ended_in_an_error_is_driven_anew_when_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not otherwise: an error is an end."""
    monkeypatch.setenv("TINY_MARK", str(tmp_path / "nowhere" / "mark"))
    drive(tmp_path / "run", "oracle", scenarios=["fatal_once"])
    worlds = study.Setup("tiny", max_steps=40)
    plan = study.plan(worlds, ["oracle"], tmp_path / "run", scenarios=["fatal_once"], seeds=[0])
    assert plan.left() == ()
    monkeypatch.setenv("TINY_MARK", str(tmp_path))
    study.run(replace(plan, again=True))
    assert [episode.ended for episode in read_episodes(tmp_path / "run")] == ["error", "goal"]


@pytest.mark.parametrize("policy", [LOOK, "oracle"])
def test_what_the_bound_on_steps_ended_is_driven_anew_under_a_larger_one(tmp_path: Path, policy: str) -> None:
    """The records say under which bound; a model's finished calls are not made again, and no smaller bound is taken."""
    asked = {"scenarios": ["whole"], "seeds": [0]}
    for steps in (4, 12):
        plan = study.plan(study.Setup("tiny", max_steps=steps), [policy], tmp_path, **asked)  # type: ignore[arg-type]
        study.run(replace(plan, again=True))
    first, then = read_episodes(tmp_path)
    assert (first.ended, first.detail, first.max_steps) == ("error", "it did not end within 4 steps", 4)
    assert (then.ended, then.max_steps, then.steps[:4]) == ("goal", 12, first.steps)
    with pytest.raises(LedgerError, match="has --max-steps 12, now 4 was asked for"):
        study.plan(study.Setup("tiny", max_steps=4), [policy], tmp_path, **asked)  # type: ignore[arg-type]
    if policy == LOOK:
        with Ledger(tmp_path / LEDGER) as ledger:
            sent = [attempt.key for attempt in ledger.attempts(LOOK)]
        assert len(sent) == len(set(sent)) == len(then.steps)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_however_a_run_is_ended_no_worker_outlives_it(tmp_path: Path, how: signal.Signals) -> None:
    """Interrupt, termination and kill: the processes that hold worlds are gone at once, and the run can be resumed."""
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "TINY_CALLS": str(tmp_path / "calls")}
    with subprocess.Popen([sys.executable, "-m", "tiny_worlds", str(tmp_path / "run")], env=env) as running:
        while running.poll() is None and not (tmp_path / "calls").exists():
            time.sleep(0.01)
        children = workers(running.pid)
        running.send_signal(how)
        running.wait(60)
    assert len(children) == 2
    deadline = time.monotonic() + 30
    while any(Path(f"/proc/{pid}").exists() for pid in children):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def workers(pid: int) -> list[int]:
    """Return the processes that a process has begun."""
    return [int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="utf-8").split()]
