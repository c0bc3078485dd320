"""Doctor and probe from the command line, and the probe that comes before a run: what it pins, counts and marks."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from aiohttp import web
from typer.testing import CliRunner, Result

import banks
from eyechart import episodes
from eyechart.cli.app import app
from eyechart.errors import LedgerError, OutputError, SpecError
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.manifest import read_manifest, read_run
from eyechart.modes import read_mode
from eyechart.probe import ProbeError
from eyechart.studies import battery
from faults import FaultServer, refuse
from seeing import Endpoint, Stalled, served

PRICE = '[[price]]\nmodel = "openai:m"\ninput = 10.0\noutput = 10.0\ndate = "2026-01-01"\nsource = "a test"\n'

Run = Callable[..., Result]


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of six frames."""
    return banks.build_bank(tmp_path_factory.mktemp("probing") / "bank", scenarios=["light", "dense"], episodes=1)


def call(*words: object) -> Result:
    """Return what a command does; an error of eyechart's is raised."""
    result = CliRunner().invoke(app, list(map(str, words)))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


@pytest.fixture
def run(bank: FrameBank, tmp_path: Path) -> Run:
    """Return a function that runs a battery of the model m at an address."""

    def battery_of(at: FaultServer, *options: object) -> Result:
        asked = ("--model", "openai:m", "--base-url", at.base_url, "--conditions", "real,text_only")
        return call("run", "battery", "--frames", bank.root, "--out", tmp_path / "run", *asked, *options)

    return battery_of


@pytest.mark.parametrize(
    ("what", "code", "says"),
    [
        ({}, 0, "openai:m: it sees: 14 of 14 right"),
        ({"sees": False, "counts_pictures": False}, 1, "openai:m: it is blind: 0 of 14 right"),
        ({"cache": "words"}, 1, "likely cause: a cache between here and the model"),
        ({"dumb": "Hello."}, 2, "openai:m: cannot say: none of 14 replies names any of the choices"),
    ],
)
def test_doctor_answers_with_its_exit_code_and_words(what: dict[str, object], code: int, says: str) -> None:
    """At a glance: the table with n and p, then the conclusion and its cause."""
    with served(**what) as server:
        result = call("doctor", "openai:m", "--base-url", server.base_url, "--seed", 1)
    assert result.exit_code == code
    assert says in result.stdout.replace("\n", " ")
    assert "all questions" in result.stdout
    assert "at most, if a call takes 1000 tokens in and 100 out: openai:m: 28 calls, 28,000 tokens in" in result.stderr
    assert ("28 calls," if code == 0 else "20 calls,") in result.stdout  # acuity is asked of one that sees


def test_doctor_prints_json_for_a_program() -> None:
    """With every reply and what it was asked."""
    with served(only_new_tokens=True) as server:
        result = call("doctor", "openai:m", "--base-url", server.base_url, "--seed", 1, "--json")
    found = json.loads(result.stdout)
    assert (found["outcome"], found["spent"]["calls"], len(found["replies"])) == ("sees", 28, 14)
    assert found["scores"]["colour"]["n"] == 6
    assert found["notes"] == ["max_tokens is refused: --token-field max_completion_tokens is used"]


def test_a_field_that_is_given_stays_and_its_refusal_says_what_to_do() -> None:
    """The error of the endpoint, with the option that mends it."""
    with served(only_new_tokens=True) as server:
        at = ("--base-url", server.base_url)
        refused = call("doctor", "openai:m", *at, "--token-field", "max_completion_tokens")
        assert refused.exit_code == 0
        with pytest.raises(ProbeError, match="ask with --token-field max_completion_tokens"):
            call("probe", "openai:m", *at, "--token-field", "max_tokens", "--out", "never.toml")


def test_probe_writes_a_mode_that_run_takes(bank: FrameBank, tmp_path: Path) -> None:
    """It is asked as the file says, without being probed again, and the estimate is made of it."""
    mode = tmp_path / "mode.toml"
    with served(only_new_tokens=True, only_default_temperature=True, thinks=300) as server:
        result = call("probe", "openai:m", "--base-url", server.base_url, "--out", mode, "--frames", bank.root)
        assert result.exit_code == 0, result.output
        assert "max_tokens = 640" in result.stdout
        found = read_mode(mode)
        assert (found.token_field, found.max_tokens, found.temperature) == ("max_completion_tokens", 640, None)
        probed = server.requests
        at = ("--frames", bank.root, "--out", tmp_path / "run", "--conditions", "real", "--limit", 2)
        asked = call("run", "battery", "--mode", mode, *at)
        assert asked.exit_code == 0, asked.output
        assert server.requests == probed + 2
    assert "is probed first" not in asked.output
    assert "600 out" in asked.output


def test_probe_refuses_what_it_may_not_write_and_tells_blindness_and_limits(tmp_path: Path) -> None:
    """Nothing of another kind is overwritten; exit 1 where the mode is of a blind model, 3 at the limit."""
    other, mode = tmp_path / "notes.txt", tmp_path / "mode.toml"
    other.write_text("mine")
    (tmp_path / "prices.toml").write_text(PRICE)
    with served(sees=False, counts_pictures=False) as server:
        at = ("--base-url", server.base_url)
        with pytest.raises(OutputError, match="is no request mode"):
            call("probe", "openai:m", *at, "--out", other)
        assert server.requests == 0
        limited = call(
            "probe", "openai:m", *at, "--out", mode, "--max-cost", 0.005, "--prices", tmp_path / "prices.toml"
        )
        assert (limited.exit_code, mode.exists()) == (3, False)
        assert "--max-cost is 0.005; the findings are not kept" in limited.stderr
        assert call("probe", "openai:m", *at, "--out", mode).exit_code == 1
        assert read_mode(mode).measured.sees_image is False


def test_a_run_probes_once_and_its_guard_says_what_the_probe_saw(run: Run, tmp_path: Path) -> None:
    """The picture arrives: the guard holds, whatever tokens say; a resumed run is asked alike, without a probe."""
    with served(counts_pictures=False, only_new_tokens=True) as server:
        first = run(server, "--limit", 4)
        assert first.exit_code == 0, first.output
        manifest = read_run(tmp_path / "run")[0]
        spent = manifest.probes["openai:m"].calls
        assert server.requests == spent + 8
        assert "openai:m: it sees: 14 of 14 right" in first.stderr
        again = run(server, "--limit", 6)
        assert again.exit_code == 0, again.output
        assert server.requests == spent + 12
        mode = read_run(tmp_path / "run")[0].mode("openai:m")
        assert (mode.token_field, mode.measured.sees_image) == ("max_completion_tokens", True)
        with pytest.raises(LedgerError, match="in another mode: max_tokens was 256, now 9"):
            run(server, "--max-tokens", 9)
    guard = battery.took(tmp_path / "run")[1]["openai:m"][0]
    assert (guard.name, guard.holds) == ("picture", True)
    costs = json.loads(call("costs", tmp_path / "run", "--json").stdout)
    assert costs["probes"]["openai:m"]["calls"] == spent
    assert f"{spent} calls" in call("costs", tmp_path / "run").stdout


def test_a_blind_model_s_run_is_marked_with_the_cause(run: Run, tmp_path: Path) -> None:
    """In words, wherever its verdict is printed; the run warns before it spends."""
    with served(sees=False, counts_pictures=False) as server:
        result = run(server)
        assert result.exit_code == 0, result.output
        assert "warning: openai:m did not see the probe's pictures" in result.stderr
    said = " ".join(call("verdict", tmp_path / "run").stdout.split())
    assert (
        "guard 'picture' failed: the model did not see the probe's pictures: the picture is dropped on the way" in said
    )


def test_a_model_that_cannot_be_seen_to_see_leaves_the_guard_open(run: Run, tmp_path: Path) -> None:
    """The tokens of the run itself then say what they can."""
    with served(dumb="SLOW") as server:
        assert run(server).exit_code == 0
    guard = battery.took(tmp_path / "run")[1]["openai:m"][0]
    assert (guard.holds, guard.because) == (True, "a picture adds 85 tokens to the prompt, as the server counts it")
    assert read_run(tmp_path / "run")[0].mode("openai:m").measured.sees_image is None


def test_the_probe_counts_towards_the_limits_of_its_run(run: Run, tmp_path: Path) -> None:
    """Calls and dollars; where there is no room for it, nothing is asked."""
    (tmp_path / "prices.toml").write_text(PRICE)
    with served() as server:
        with pytest.raises(SpecError, match="--max-calls 20 leaves no room to probe openai:m, which may take 76 calls"):
            run(server, "--max-calls", 20)
        assert server.requests == 0
        prices = ("--prices", tmp_path / "prices.toml")
        dear = run(server, *prices, "--max-cost", 0.01)
        assert dear.exit_code == 3
        assert read_run(tmp_path / "run")[0].probes["openai:m"].calls == server.requests > 0
        cut = server.requests
        assert (run(server, *prices, "--max-cost", 0.01).exit_code, server.requests) == (3, cut)
        stopped = run(server, *prices, "--max-cost", 0.06)
        made = read_run(tmp_path / "run")[0].probes["openai:m"]
        assert (stopped.exit_code, made.unknown) == (3, 0)
        assert server.requests == made.calls + battery.took(tmp_path / "run")[0]["openai:m"]["all"].attempts
        assert 0.02 < made.cost_usd < 0.06
        assert run(server, *prices, "--max-cost", 0.06).exit_code == 3
        assert server.requests < made.calls + 12


@pytest.mark.parametrize("name", ["battery", "prompts", "closed-loop"])
def test_a_kill_while_probing_loses_no_call_of_it(name: str, bank: FrameBank, tmp_path: Path) -> None:
    """Each stands in the run before it is sent: limits count it, and so does the account of the run that goes on."""
    frames = ("--model", "openai:m", "--frames", bank.root, "--conditions", "real", "--limit", 1)
    drives = ("--policy", "openai:m", "--seeds", 1, "--scenarios", "light", "--max-steps", 2, "--no-marginal")
    asked = {
        "battery": frames,
        "prompts": (*frames, "--prompt", "minimal"),
        "closed-loop": (*drives, "--condition", "real"),
    }
    home = tmp_path / "run" / "minimal" if name == "prompts" else tmp_path / "run"
    manifest = episodes.read_manifest if name == "closed-loop" else read_manifest
    endpoint = Stalled()
    with FaultServer([endpoint]) as server:
        words = [*map(str, ("run", name, *asked[name], "--base-url", server.base_url, "--out", tmp_path / "run"))]
        with subprocess.Popen([sys.executable, "-m", "eyechart", *words], stderr=subprocess.PIPE) as running:
            came = endpoint.came.wait(120)
            running.kill()
        assert came, running.stderr
        endpoint.goes_on.set()
        sent, counted = server.requests, manifest(home).probes["openai:m"].calls
        assert sent <= counted <= sent + 1
        with pytest.raises(SpecError, match="--max-calls 76 leaves no room to probe openai:m"):
            call(*words, "--max-calls", 76)
        assert server.requests == sent
        call(*words)
        with Ledger(home / "ledger.sqlite") as ledger:
            made = manifest(home).probes["openai:m"].calls + sum(1 for _ in ledger.attempts("openai:m"))
        assert server.requests <= made <= server.requests + 1


def test_what_needs_no_probe_is_not_probed(run: Run, bank: FrameBank, tmp_path: Path) -> None:
    """A dry run, --no-probe, a scripted controller; and shards, which must ask alike, refuse to probe each."""
    with served() as server:
        dry = run(server, "--dry-run")
        assert "not probed yet, so that nothing is known of its replies: openai:m" in dry.stderr
        with pytest.raises(SpecError, match="all shards of a run need the same request mode"):
            run(server, "--shard", "1/2")
        assert server.requests == 0
        assert run(server, "--no-probe", "--limit", 1).exit_code == 0
        assert run(server, "--limit", 2).exit_code == 0
        assert server.requests == 4
    assert read_run(tmp_path / "run")[0].probes == {}
    at = ("--frames", bank.root, "--out", tmp_path / "scripted", "--limit", 1)
    assert "probed first" not in call("run", "battery", "--model", "scripted:depth", *at).output


def test_a_model_that_cannot_be_probed_is_set_aside_and_the_others_go_on(run: Run, tmp_path: Path) -> None:
    """With its reason, and an exit code that says that something is left to do; what it took is counted each time."""

    class Locked(Endpoint):
        async def __call__(self, request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
            if asked["model"] == "locked":
                return refuse(401, "no such key")
            return await super().__call__(request, asked, attempt)

    with FaultServer([Locked()]) as server:
        result = run(server, "--model", "openai:locked", "--limit", 2)
        manifest, _ = read_run(tmp_path / "run")
        assert set(manifest.models) == {"openai:m"}
        assert server.requests == manifest.spent_before().calls + 4
        run(server, "--model", "openai:locked", "--limit", 2)
        manifest, _ = read_run(tmp_path / "run")
        assert server.requests == manifest.spent_before().calls + 4
    assert result.exit_code == 1
    assert "set aside: openai:locked: it cannot be probed: the key is missing, wrong" in result.stderr
    assert "1 model × 2 frames" in result.stderr


def test_failed_attempts_of_unknown_cost_are_said_where_a_cost_is_bounded(run: Run, tmp_path: Path) -> None:
    """They are not taken for nothing without a word."""
    (tmp_path / "prices.toml").write_text(PRICE)
    with FaultServer(["500 once"]) as server:
        words = ("--no-probe", "--limit", 1, "--prices", tmp_path / "prices.toml", "--max-cost", 1)
        result = run(server, *words)
    assert result.exit_code == 0, result.output
    assert "1 attempt failed without a reported cost, which --max-cost does not count" in result.stderr


def test_a_prompt_study_probes_once_for_all_of_its_cells(bank: FrameBank, tmp_path: Path) -> None:
    """With the words of each; it pins no format, which is a factor; a further cell is asked alike."""
    at = ("run", "prompts", "--model", "openai:m", "--frames", bank.root, "--out", tmp_path / "study", "--limit", 2)
    with served() as server:
        words = (*at, "--base-url", server.base_url, "--prompt", "structured")
        assert call(*words, "--prompt", "minimal").exit_code == 0
        cells = [read_run(tmp_path / "study" / name)[0] for name in ("structured", "minimal")]
        assert [len(cell.probes) for cell in cells] == [1, 0]
        calls = cells[0].probes["openai:m"].calls
        assert server.requests == calls + 8
        assert {cell.mode("openai:m").structured for cell in cells} == {"none"}
        took = json.loads(call("costs", tmp_path / "study", "--json").stdout)
        assert took["probes"]["openai:m"]["calls"] == calls
        assert call(*words, "--prompt", "baseline").exit_code == 0
        assert server.requests == calls + 12
        asked = {json.dumps(one["messages"][0]["content"]) for one in server.asked if "messages" in one}
        assert len(asked) > 2
