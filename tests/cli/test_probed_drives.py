"""The probe before drives and scenes: once, with the run's own pictures, counted, kept, and not made again."""

import json
from collections.abc import Mapping
from pathlib import Path

import pytest
from aiohttp import web
from typer.testing import CliRunner, Result

import banks
import short_worlds
import tiny_worlds
from eyechart.cli.app import app
from eyechart.episodes import Episode, EpisodeKey, read_episodes, write_episodes
from eyechart.episodes import read_manifest as read_drives
from eyechart.errors import SpecError
from eyechart.frames import FrameBank
from eyechart.manifest import read_manifest
from eyechart.simulators import SIMULATORS
from eyechart.studies import hierarchy
from eyechart.studies.hierarchy import Part
from eyechart.studies.hierarchy import tables as hierarchy_tables
from faults import FaultServer, refuse
from seeing import Endpoint, read, served

pytestmark = pytest.mark.slow

MODEL = "openai:m"
MORE: Mapping[str, tuple[object, ...]] = {"closed-loop": ("--seeds", 2), "structured": ("--limit", 4)}
"""Options under which a run goes on with further calls."""


@pytest.fixture(autouse=True)
def _worlds(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, place in {**tiny_worlds.SIMULATORS, **short_worlds.SIMULATORS}.items():
        monkeypatch.setitem(SIMULATORS, name, place)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of 36 frames with no calibrated view."""
    return banks.build_bank(tmp_path_factory.mktemp("probed") / "bank", episodes=4)


def call(*words: object) -> Result:
    """Return what a command does; an error of eyechart's is raised."""
    result = CliRunner().invoke(app, list(map(str, words)))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def words_of(name: str, bank: FrameBank) -> tuple[object, ...]:
    """Return a small run of each kind."""
    return {
        "closed-loop": ("run", "closed-loop", "--simulator", "tiny", "--scenarios", "whole", "--seeds", 1, "--policy"),
        "structured": ("run", "structured", "--frames", bank.root, "--limit", 2, "--model"),
        "online": ("run", "online", "--simulator", "short", "--view", "none", "--episodes", 1, "--model"),
    }[name]


@pytest.mark.parametrize("name", ["closed-loop", "structured", "online"])
def test_a_served_model_is_probed_once_before_it_is_asked(name: str, bank: FrameBank, tmp_path: Path) -> None:
    """With the pictures of the run itself; what it took is kept, counted, and a resume is asked alike without it."""
    out = tmp_path / "run"
    words = (*words_of(name, bank), MODEL, "--out", out)
    with served(only_new_tokens=True) as server:
        at = ("--base-url", server.base_url)
        dry = call(*words, *at, "--dry-run")
        assert f"not probed yet, so that nothing is known of its replies: {MODEL}" in dry.stderr
        with pytest.raises(SpecError, match="--max-calls 20 leaves no room to probe openai:m"):
            call(*words, *at, "--max-calls", 20)
        assert (server.requests, out.exists()) == (0, False)
        first = call(*words, *at)
        assert "openai:m: it sees: 14 of 14 right" in first.stderr
        manifest = (read_drives if name in {"closed-loop", "online"} else read_manifest)(out)
        probed = manifest.probes[MODEL].calls
        assert first.exit_code == 0, first.output
        mode, made = manifest.mode(MODEL), server.requests - probed
        assert (mode.token_field, mode.measured is not None) == ("max_completion_tokens", True)
        again = call(*words, *at, *MORE.get(name, ()))
        assert again.exit_code == 0, again.output
        assert "is probed first" not in again.stderr
        assert server.requests > probed + made or name not in MORE
    pictures, asked = ({read(one)[1] for one in some} for some in (server.asked[:probed], server.asked[probed:]))
    assert len(pictures & asked - {None}) >= 1
    if name != "closed-loop":
        assert any("left_clear" in str(one.get("response_format")) for one in server.asked[:probed])


def test_the_probe_of_a_run_of_drives_counts_towards_its_limit(tmp_path: Path) -> None:
    """Also when it is resumed, and what is left says so."""
    words = ("run", "closed-loop", "--simulator", "tiny", "--scenarios", "whole", "--seeds", 4, "--policy", MODEL)
    with served() as server:
        words = (*words, "--base-url", server.base_url, "--out", tmp_path / "run", "--max-calls", 77)
        for _ in range(2):
            told = call(*words)
            assert (told.exit_code, server.requests) == (3, 77)
            assert "77 calls were sent, and --max-calls is 77" in told.stderr


@pytest.mark.parametrize("name", ["closed-loop", "structured"])
def test_no_probe_asks_as_the_options_say(name: str, bank: FrameBank, tmp_path: Path) -> None:
    """Nothing is asked beside the run's own calls."""
    with served() as server:
        words = (*words_of(name, bank), MODEL, "--out", tmp_path / "run", "--base-url", server.base_url)
        stopped = call(*words, "--no-probe", "--max-calls", 1)
        assert (stopped.exit_code, server.requests) == (3, 1)


def test_the_hierarchy_is_probed_once_for_all_of_its_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first run with models keeps what it took; the others ask alike, and so does a resume."""
    small = {
        "primary": Part("tiny", ("oracle",), ("whole",), 1),
        "primary-models": Part("tiny", (), ("whole",), 1, models=True),
        "lateral-models": Part("tiny", (), ("whole",), 1, ("blank",), models=True),
    }
    for room in (hierarchy, hierarchy.plans, hierarchy.scores):
        monkeypatch.setattr(room, "PARTS", small)
    words = ("run", "hierarchy", "--policy", MODEL, "--out", tmp_path, "--processes", 1)
    with served(only_new_tokens=True) as server:
        first = call(*words, "--base-url", server.base_url)
        assert first.exit_code == 0, first.output
        runs = {name: read_drives(tmp_path / name) for name in small}
        assert [list(run.probes) for run in runs.values()] == [[], [MODEL], []]
        assert {run.mode(MODEL).token_field for name, run in runs.items() if name != "primary"} == {
            "max_completion_tokens"
        }
        asked = sum(len(episode.steps) for name in list(small)[1:] for episode in read_episodes(tmp_path / name))
        assert server.requests == runs["primary-models"].probes[MODEL].calls + asked
        assert call(*words, "--base-url", server.base_url).exit_code == 0
        assert server.requests == runs["primary-models"].probes[MODEL].calls + asked


def test_a_hierarchy_with_episodes_in_error_says_so_and_names_its_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit 1 with the first of them, or 3 where a limit stopped what is driven anew; other commands name its runs."""
    small = {
        "primary": Part("tiny", ("oracle",), ("whole", "black"), 1),
        "primary-models": Part("tiny", (), ("whole",), 1, models=True),
    }
    for room in (hierarchy, hierarchy.plans, hierarchy.scores, hierarchy_tables):
        monkeypatch.setattr(room, "PARTS", small)
    words = ("run", "hierarchy", "--policy", "python:tiny_worlds:onward", "--out", tmp_path, "--processes", 1)
    assert call(*words, "--max-calls", 1).exit_code == 3
    key = EpisodeKey("python:tiny_worlds:onward", "tiny", "whole", 0)
    write_episodes(tmp_path / "primary-models", [Episode(key, (), "error", "", "it broke")])
    told = call(*words, "--max-calls", 1)
    assert told.exit_code == 1
    assert "+ 1 in error" in told.stdout
    assert "2 episodes ended in an error, first primary: oracle in tiny/black/0: SpecError: the camera" in told.stderr
    assert call(*words, "--again", "--max-calls", 1).exit_code == 3
    for other in (("audit",), ("film", "--episode", "oracle", "--out", tmp_path / "a.gif")):
        with pytest.raises(SpecError, match=f"name one of them: {tmp_path / 'primary'}, "):
            call(*other, tmp_path)
    took = json.loads(call("costs", tmp_path, "--json").stdout)["accounting"]
    assert {name: one["all"]["attempts"] for name, one in took.items()} == {
        "python:tiny_worlds:onward in primary-models": 1
    }


class Locked(Endpoint):
    """An endpoint that knows no key."""

    async def __call__(self, request: web.Request, asked: Mapping[str, object], attempt: int) -> web.StreamResponse:
        """Refuse."""
        del request, asked, attempt
        return refuse(401, "no such key")


@pytest.mark.parametrize("name", ["closed-loop", "structured", "online", "hierarchy"])
def test_what_a_probe_took_that_failed_counts_towards_the_limit_of_every_repeat(
    name: str, bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that the same command over and over asks no more than it may; and the model is probed anew each time."""
    small = {"primary": Part("tiny", ("oracle",), ("whole",), 1), "more": Part("tiny", (), ("whole",), 1, models=True)}
    for room in (hierarchy, hierarchy.plans, hierarchy.scores):
        monkeypatch.setattr(room, "PARTS", small)
    words = ("run", "hierarchy", "--policy") if name == "hierarchy" else words_of(name, bank)
    with FaultServer([Locked()]) as server:
        words = (*words, MODEL, "--base-url", server.base_url, "--out", tmp_path / "run")
        assert call(*words, "--max-calls", 76).exit_code == 1
        requests = server.requests
        assert requests > 0
        with pytest.raises(SpecError, match="--max-calls 76 leaves no room to probe openai:m"):
            call(*words, "--max-calls", 76)
        assert server.requests == requests
        if name in {"closed-loop", "structured"}:
            assert call(*words, "--max-calls", 76 + requests).exit_code == 1
            assert server.requests == 2 * requests


def test_policies_drive_on_where_a_model_beside_them_cannot_be_probed(tmp_path: Path) -> None:
    """It is set aside with the reason, and the exit code says that something is left to do."""
    with FaultServer([Locked()]) as server:
        words = ("run", "closed-loop", "--simulator", "tiny", "--scenarios", "whole", "--seeds", 1, "--processes", 1)
        drivers = ("--policy", "oracle", "--policy", MODEL, "--base-url", server.base_url)
        told = call(*words, *drivers, "--out", tmp_path / "run")
    assert told.exit_code == 1
    assert f"set aside: {MODEL}: it cannot be probed: the key is missing, wrong" in told.stderr
    assert [episode.key.policy for episode in read_episodes(tmp_path / "run")] == ["oracle"]
