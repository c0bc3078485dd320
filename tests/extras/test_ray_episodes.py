"""Episodes on a Ray cluster of two local nodes: the same records as in one process."""

from collections.abc import Iterator
from pathlib import Path

import pytest

import tiny_worlds
from eyechart import episodes as study
from eyechart import simulators
from eyechart.episodes import Bounds, Episode, read_episodes
from eyechart.errors import SpecError
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.studies.closed_loop import score
from ray_cluster import two_nodes

pytestmark = pytest.mark.models

LOOK = "python:tiny_worlds:look"


@pytest.fixture(scope="module")
def _cluster() -> Iterator[None]:
    """Have a cluster as a user has one."""
    with two_nodes():
        yield


def drive(out: Path, engine: str, *specs: str, simulator: str, **asked: object) -> dict[str, Episode]:
    """Drive and return the episodes by their lines' keys."""
    plan = study.plan(simulator, specs, out, seeds=range(2), **asked)  # type: ignore[arg-type]
    study.run(plan, engine=engine, bounds=Bounds(processes=2, concurrency=3))
    return {str(episode.key): episode for episode in read_episodes(out)}


def table(out: Path) -> tuple[object, object]:
    """Return the rows that a run prints, and every number of its score but the times of replies."""
    scored = score(out).as_dict()
    del scored["repeated_requests"]
    return [
        row.as_dict() for row in study.summarise(sorted(read_episodes(out), key=lambda episode: episode.key))
    ], scored


@pytest.mark.usefixtures("_cluster")
def test_two_nodes_drive_the_same_episodes_as_one_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Policies and a model, real and shuffled pictures, in the tiny world and on the highway."""
    import ray  # noqa: PLC0415 - an extra

    monkeypatch.setitem(simulators.SIMULATORS, "tiny", tiny_worlds.SIMULATORS["tiny"])
    tiny = {"simulator": "tiny", "scenarios": ["whole"], "conditions": ["real", "shuffled"]}
    highway = {"simulator": "highway", "scenarios": ["merge"]}
    for name, specs, asked in (
        ("tiny", (LOOK, "random", "oracle"), tiny),
        ("highway", ("scripted:depth_lateral", "constant:SLOW"), highway),
    ):
        there = drive(tmp_path / f"{name}-ray", "ray", *specs, **asked)  # type: ignore[arg-type]
        here = drive(tmp_path / f"{name}-local", "local", *specs, **asked)  # type: ignore[arg-type]
        assert there == here
        assert table(tmp_path / f"{name}-ray") == table(tmp_path / f"{name}-local")
        assert all(one.ended != "error" for one in here.values())
    assert len([node for node in ray.nodes() if node["Alive"]]) == 2
    with Ledger(tmp_path / "tiny-ray" / LEDGER) as ledger:
        sent = [attempt.key for attempt in ledger.attempts(LOOK)]
    assert len(sent) == len(set(sent))


@pytest.mark.usefixtures("_cluster")
def test_an_actor_that_dies_costs_its_own_episode_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As with a process of this machine."""
    monkeypatch.setitem(simulators.SIMULATORS, "tiny", tiny_worlds.SIMULATORS["tiny"])
    found = drive(tmp_path / "run", "ray", "oracle", simulator="tiny", scenarios=["fatal", "whole"])
    assert sorted(one.ended for one in found.values()) == ["error", "error", "goal", "goal"]
    assert all("took its process down, twice" in one.detail for one in found.values() if one.ended == "error")


def test_without_a_cluster_none_is_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray's servers listen on every address of a machine, so they are never started behind one's back."""
    import ray  # noqa: PLC0415 - an extra

    ray.shutdown()
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    with pytest.raises(SpecError, match="name it in RAY_ADDRESS"):
        drive(tmp_path / "run", "ray", "oracle", simulator="highway", scenarios=["merge"])
    assert not ray.is_initialized()
