"""Batteries, policies and calibration on a Ray cluster of two local nodes: the same rows as on this machine."""

import asyncio
import signal
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

import banks
import guests_of_ray
from eyechart import api, cli
from eyechart.calibrate.policies import try_rules
from eyechart.calls import Query
from eyechart.clusters import require_engine
from eyechart.errors import SpecError
from eyechart.frames import Stimulus
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, read_manifest
from eyechart.models import actors, open_model
from eyechart.modes import RequestMode
from eyechart.simulators import open_bank_simulator
from eyechart.studies import policy
from eyechart_organisms.calibration import calibrate
from ray_cluster import two_nodes, workers_after, workers_there

pytestmark = pytest.mark.models

GUEST, ACT = "python:guests_of_ray:answer", "python:guests_of_ray:act"
NAMED = ["swap 0.2, 12"]


@pytest.fixture(scope="module")
def _cluster() -> Iterator[None]:
    """Have a cluster as a user has one."""
    with two_nodes():
        yield


def rows(run: Path) -> list[tuple[object, ...]]:
    """Return what a ledger holds of each call, but for order and times."""
    with closing(sqlite3.connect(run / LEDGER)) as sql:
        return sorted(
            sql.execute(
                "SELECT model, frame, condition, repeat, request_sha256, text, error FROM calls "
                "JOIN attempts ON attempts.call = calls.id JOIN replies ON replies.attempt = attempts.id"
            )
        )


@pytest.mark.usefixtures("_cluster")
def test_two_workers_give_the_rows_and_the_verdict_of_one_process(tmp_path: Path) -> None:
    """A battery with its stages, and a run of policies."""
    bank = banks.build_bank(tmp_path / "bank", ranged=True, episodes=3)
    here = api.run_battery(bank, GUEST, tmp_path / "here")
    there = api.run_battery(bank, GUEST, tmp_path / "there", engine="ray", workers=2)
    assert rows(tmp_path / "there") == rows(tmp_path / "here")
    assert there.verdicts[GUEST].as_dict() == here.verdicts[GUEST].as_dict()
    table = open_bank_simulator("tabletop").build(tmp_path / "table", seeds=(0, 1, 2), steps=4)
    api.run_policies(table, ACT, tmp_path / "acts-here")
    api.run_policies(table, ACT, tmp_path / "acts-there", engine="ray", workers=2)
    assert rows(tmp_path / "acts-there") == rows(tmp_path / "acts-here")
    assert policy.score(tmp_path / "acts-there").models[ACT].statistics["T.blank"].n == len(table)


@pytest.mark.usefixtures("_cluster")
def test_the_batches_of_every_worker_are_full(tmp_path: Path) -> None:
    """But for the last ones; the answers are those of single calls, and what it declares stands in the run."""
    table = open_bank_simulator("tabletop").build(tmp_path / "table", seeds=(0, 1), steps=4)
    (tmp_path / "sizes").mkdir()
    guests_of_ray.SIZES.write_text(str(tmp_path / "sizes"), encoding="utf-8")
    asked = {"conditions": ["real", "blank", "swapped@cameras"]}
    batched = "python:guests_of_ray:acts"
    try:
        api.run_policies(table, batched, tmp_path / "there", engine="ray", workers=2, **asked)  # type: ignore[arg-type]
    finally:
        guests_of_ray.SIZES.unlink()
    api.run_policies(table, ACT, tmp_path / "here", **asked)  # type: ignore[arg-type]
    assert [row[1:] for row in rows(tmp_path / "there")] == [row[1:] for row in rows(tmp_path / "here")]
    assert read_manifest(tmp_path / "there").facts[batched]["batch"] == "6"
    sizes = [[*map(int, path.read_text().split())] for path in (tmp_path / "sizes").iterdir()]
    assert len(sizes) == 2
    assert sum(map(sum, sizes)) == 3 * len(table)
    for many in sizes:
        assert sum(size == 6 for size in many) >= 0.6 * len(many), sizes


@pytest.mark.usefixtures("_cluster")
def test_a_worker_that_dies_costs_what_it_had_under_way(tmp_path: Path) -> None:
    """Its calls are failed attempts, and are made again on a new one; no finished call is asked twice."""
    bank = banks.build_bank(tmp_path / "bank")
    deadly = "python:guests_of_ray:dies_once"
    guests_of_ray.GRAVE.write_text(str(tmp_path / "died"), encoding="utf-8")
    try:
        api.run_battery(bank, deadly, tmp_path / "run", engine="ray", workers=2, conditions=["real", "blank"])
    finally:
        guests_of_ray.GRAVE.unlink()
    with Ledger(tmp_path / "run" / LEDGER) as ledger:
        attempts = [*ledger.attempts(deadly)]
        assert len(ledger.finished()) == 2 * len(bank)
    lost = [one for one in attempts if one.reply is not None and one.reply.error == "server_error"]
    assert 1 <= len(lost) <= 16
    assert "its worker was lost" in lost[0].reply.error_detail  # type: ignore[union-attr]
    answered = [one.key for one in attempts if one.reply is not None and one.reply.error is None]
    assert len(answered) == len(set(answered)) == 2 * len(bank)


@pytest.mark.usefixtures("_cluster")
def test_a_coordinator_that_is_killed_loses_no_finished_call(tmp_path: Path) -> None:
    """The same command goes on, its actors are gone, and the verdict is that of an undisturbed run."""
    bank = banks.build_bank(tmp_path / "bank", episodes=3)
    words = ("run", "battery", "--model", "python:guests_of_ray:slow", "--frames", bank.root, "--out", tmp_path / "run")
    command = [sys.executable, "-m", "eyechart", *map(str, words), "--engine", "ray", "--workers", "2"]
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    ledger = tmp_path / "run" / LEDGER
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and (not ledger.exists() or len(finished(ledger)) < 20):
        time.sleep(0.05)
    run.send_signal(signal.SIGKILL)
    run.wait()
    before = finished(ledger)
    assert 20 <= len(before) < 8 * len(bank)
    assert workers_after(10.0) == []
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    with Ledger(ledger) as opened:
        keys = [one.key for one in opened.attempts("python:guests_of_ray:slow") if one.reply is not None]
    assert before <= set(keys)
    assert all(keys.count(key) == 1 for key in before)


def finished(ledger: Path) -> set[object]:
    """Return a ledger's finished calls."""
    with Ledger(ledger) as opened:
        return set(opened.finished())


@pytest.mark.usefixtures("_cluster")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("command", ["run battery", "run closed-loop", "calibrate"])
def test_no_worker_of_a_cluster_outlives_its_command(command: str, how: signal.Signals, tmp_path: Path) -> None:
    """Actors that hold models, actors that hold worlds, and tasks are gone ten seconds later, however it was ended."""
    more = {
        "run battery": ("--model", "python:guests_of_ray:slow", "--frames", "BANK", "--out", "OUT", "--workers", "2"),
        "run closed-loop": ("--simulator", "rover", "--policy", "oracle", "--seeds", "99", "--out", "OUT"),
        "calibrate": ("--replications", "200", "--processes", "2"),
    }
    bank = banks.build_bank(tmp_path / "bank", episodes=12)
    given = {"BANK": str(bank.root), "OUT": str(tmp_path / "run")}
    words = [*command.split(), *(given.get(word, word) for word in more[command]), "--engine", "ray"]
    assert workers_after(10.0) == []
    with (tmp_path / "said").open("w+") as said:
        run = subprocess.Popen([sys.executable, "-m", "eyechart", *words], stdout=said, stderr=said)
        deadline = time.monotonic() + 120
        while run.poll() is None and not workers_there() and time.monotonic() < deadline:
            time.sleep(0.05)
        assert run.poll() is None, (tmp_path / "said").read_text()
        assert workers_there()
        run.send_signal(how)
        assert run.wait(10.0) != 0
    assert workers_after(10.0) == []


@pytest.mark.usefixtures("_cluster")
def test_calibration_is_the_same_on_a_cluster(tmp_path: Path) -> None:
    """Banks of controllers, with what is kept, and draws of policies."""
    settings = {"replications": 2, "settings": ["small_10"], "seed": 3}
    here = calibrate(**settings)  # type: ignore[arg-type]
    assert calibrate(**settings, processes=2, engine="ray", keep=tmp_path / "kept").as_dict() == here.as_dict()  # type: ignore[arg-type]
    assert calibrate(**settings, keep=tmp_path / "kept").as_dict() == here.as_dict()  # type: ignore[arg-type]
    few = [*try_rules(3, chosen=NAMED)][:2]
    assert [*try_rules(3, chosen=NAMED, processes=2, engine="ray")][:2] == few


@pytest.mark.usefixtures("_cluster")
def test_what_a_cluster_cannot_do_is_said_before_a_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """GPUs that are not there, workers without an engine, an object of this process, an unknown engine."""
    bank = banks.build_bank(tmp_path / "bank")
    with pytest.raises(SpecError, match="claim 2 GPUs, and the cluster has 0"):
        api.run_battery(bank, GUEST, tmp_path / "gpus", engine="ray", workers=2, gpus=1.0)
    with pytest.raises(SpecError, match="a worker of the cluster has python:mine as SpecError"):
        api.run_battery(bank, {"mine": guests_of_ray.answer}, tmp_path / "mine", engine="ray")
    with pytest.raises(SpecError, match="unknown engine 'rey'"):
        api.run_battery(bank, GUEST, tmp_path / "rey", engine="rey")
    words = ["eyechart", "run", "battery", "--model", GUEST, "--frames", str(bank.root), "--out", str(tmp_path / "no")]
    monkeypatch.setattr(sys, "argv", [*words, "--workers", "2"])
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code == 2
    assert "give --engine ray too" in capsys.readouterr().err


@pytest.mark.usefixtures("_cluster")
def test_a_worker_that_no_node_has_a_place_for_hangs_no_call(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the GPUs went with a node: while one is open it answers alone, and without one the model is missing."""
    query, model = Query("", "Go on.", Stimulus.of(None), seed=1), open_model(GUEST)
    held = actors.PooledModel(RequestMode(GUEST), "", model.version, {}, actors.ActorPool(2))
    without = actors.PooledModel(RequestMode(GUEST), "", model.version, {}, actors.ActorPool(1, gpus=1.0))
    held.open()
    monkeypatch.setattr(actors, "OPENING_S", 3.0)
    with pytest.raises(SpecError, match=r"no node of the cluster opened .* within 3 s: do other jobs hold its GPUs"):
        without.open()
    reply = asyncio.run(without.answer(query))
    assert (reply.error, "no node of the cluster opened" in (reply.error_detail or "")) == ("missing_model", True)
    without.end()
    held._actors[0] = without._new()  # a worker whose node is gone
    assert [asyncio.run(held.answer(query)).error for _ in range(4)] == [None] * 4
    held.end()


def test_an_address_without_a_cluster_is_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray itself tries for a quarter of an hour; and no word of its own begins a cluster."""
    monkeypatch.setattr("ray.is_initialized", lambda: False)
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        free = taken.getsockname()[1]
    for address, said in (
        (f"127.0.0.1:{free}", f"no Ray cluster answers at 127.0.0.1:{free}: Connection refused"),
        ("local", "RAY_ADDRESS=local begins a cluster, and eyechart begins none"),
    ):
        monkeypatch.setenv("RAY_ADDRESS", address)
        before = time.monotonic()
        with pytest.raises(SpecError, match=said):
            require_engine("ray")
        assert time.monotonic() - before < 30
