"""Servers that are reached at a wrong address, or that serve otherwise than most, from the command line."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from aiohttp import web
from typer.testing import CliRunner, Result

import banks
from eyechart.calls import Reply, answer_from_reasoning
from eyechart.cli.app import app
from eyechart.errors import EyechartError
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.manifest import read_run
from eyechart.modes import RequestMode, read_mode
from eyechart.spaces.discrete import DRIVING
from faults import FaultServer, refuse
from seeing import served


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of a few frames."""
    return banks.build_bank(tmp_path_factory.mktemp("serving") / "bank", scenarios=["light"], episodes=1)


def call(*words: object) -> Result:
    """Return what a command does; an error of eyechart's is in what it says."""
    return CliRunner().invoke(app, list(map(str, words)))


def refused(*words: object) -> str:
    """Return the sentence with which a command refuses what it is given."""
    found = call(*words).exception
    assert isinstance(found, EyechartError), found
    return str(found)


@pytest.mark.parametrize(
    ("words", "near"),
    [
        (("run", "battery", "--model", "scripted:depht"), "scripted:depht'; did you mean 'depth'?"),
        (("run", "battery", "--model", "openia:gpt-4o"), "openia:gpt-4o'; did you mean 'openai'?"),
        (("run", "battery", "--model", "scripted:depth", "--prompt", "baselin"), "did you mean 'baseline'?"),
        (("run", "battery", "--model", "scripted:depth", "--conditions", "real,mirored"), "did you mean 'mirrored'?"),
        (("run", "policy", "--policy", "trained:seas"), "did you mean 'sees'?"),
    ],
)
def test_a_mistyped_name_is_answered_with_the_nearest_that_is_known(
    bank: FrameBank, tmp_path: Path, words: tuple[str, ...], near: str
) -> None:
    """Of a controller, an adapter, a prompt, a condition and a policy, and nothing is begun."""
    assert near in refused(*words, "--frames", bank.root, "--out", tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_mistyped_requirement_is_answered_with_the_nearest(bank: FrameBank, tmp_path: Path) -> None:
    """As ``--require dept``, and one that is like none of them with the list alone."""
    run = tmp_path / "run"
    call("run", "battery", "--model", "scripted:depth", "--frames", bank.root, "--out", run)
    assert refused("gate", run, "--require", "dept").endswith("got 'dept'; did you mean 'depth'?")
    assert "did you mean" not in refused("gate", run, "--require", "xyzzy")


def doctor(base_url: str) -> str:
    """Return what the doctor says of the model ``m`` at an address that is somehow wrong."""
    found = call("doctor", "openai:m", "--base-url", base_url)
    assert found.exit_code == 2, found.output
    return " ".join(found.output.split())


def test_a_missing_v1_is_named() -> None:
    """Where the server has no route of that name, and says so in a page or in JSON."""
    with served() as server:
        bare = server.base_url.removesuffix("/v1")
        assert f"the address does not end in /v1, as most do: try --base-url {bare}/v1" in doctor(bare)


def test_https_that_is_asked_of_a_server_of_http_is_named() -> None:
    """The handshake fails."""
    with served() as server:
        secure = server.base_url.replace("http:", "https:")
        assert f"may speak http: try --base-url {server.base_url}" in doctor(secure)


@pytest.mark.parametrize(
    "says",
    [
        lambda: web.Response(status=400, text="<h1>The plain HTTP request was sent to HTTPS port</h1>"),
        lambda: web.Response(status=400, text="Client sent an HTTP request to an HTTPS server (TLS)."),
        lambda: web.Response(status=301, headers={"Location": "https://127.0.0.1:1/v1/chat/completions"}),
    ],
)
def test_http_that_is_asked_of_a_server_of_https_is_named(says: Callable[[], web.Response]) -> None:
    """In the words of nginx, of Go, and by a redirect."""
    with always(says) as server:
        assert "may speak https: try --base-url https://127.0.0.1" in doctor(server.base_url)


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (400, "/chat/completions: Invalid model name passed in model=m. Call `/v1/models` to view available models"),
        (400, "The model `m` does not exist"),
        (400, "m is not a valid model ID"),
        (400, "unknown model: m"),
        (400, "The model `m` has been deprecated"),
        (422, "Model m does not exist"),
    ],
)
def test_an_unknown_model_in_a_400_or_422_is_a_missing_model(status: int, words: str) -> None:
    """As LiteLLM, OpenAI's older servers and OpenRouter say it; and where to see which there are."""
    with always(lambda: refuse(status, words)) as server:
        said = doctor(server.base_url)
        assert "there is no model of this name" in said
        assert f"{server.base_url}/models lists what there is" in said


def always(says: Callable[[], web.Response]) -> FaultServer:
    """Return a server that says this whatever it is asked."""

    async def handle(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        del request, asked, attempt
        return says()

    return FaultServer([handle])


def battery(bank: FrameBank, out: Path, server: FaultServer, *options: object) -> Result:
    """Return what a small battery of the model ``m`` does."""
    asked = ("--model", "openai:m", "--base-url", server.base_url, "--conditions", "real,text_only")
    return call("run", "battery", "--frames", bank.root, "--out", out, *asked, *options)


@pytest.mark.parametrize(
    ("status", "words"),
    [(400, "System role not supported"), (400, "messages[0]: 'user' or 'assistant' was expected"), (500, "it raised")],
)
def test_a_refused_system_role_is_folded_into_the_user_s_turn(
    bank: FrameBank, tmp_path: Path, status: int, words: str
) -> None:
    """Found by the probe by asking so, whatever words the server uses, said in the mode, and kept by the run."""
    with served(refuses_system=(status, words)) as server:
        out = tmp_path / "mode.toml"
        found = call("probe", "openai:m", "--base-url", server.base_url, "--out", out)
        assert found.exit_code == 0, found.output
        assert read_mode(out).system == "user"
        assert "the system role is refused" in found.output
        assert battery(bank, tmp_path / "run", server).exit_code == 0
    assert read_run(tmp_path / "run")[0].mode("openai:m").system == "user"
    *_, last = (asked["messages"] for asked in server.asked)
    assert [message["role"] for message in last] == ["user"]
    assert "You " in last[0]["content"][-1]["text"]
    assert "STOP" in last[0]["content"][-1]["text"]


def test_a_doctor_never_passes_a_model_that_cannot_be_asked_to_drive() -> None:
    """It sees the drawn pictures, and refuses the prompt in every form."""
    with served(refuses_driving=True) as server:
        found = call("doctor", "openai:m", "--base-url", server.base_url)
    assert found.exit_code == 2
    assert "it sees drawn pictures, but the call with the prompt 'baseline' fails: bad_request" in " ".join(
        found.output.split()
    )


def test_a_doctor_passes_a_model_whose_system_words_go_into_the_user_s_turn() -> None:
    """And says so."""
    with served(refuses_system=(400, "System role not supported")) as server:
        found = call("doctor", "openai:m", "--base-url", server.base_url)
    assert found.exit_code == 0
    assert "--system user is used" in found.output


THOUGHT = "have their words in the reasoning (reasoning_content)"


@pytest.mark.parametrize("name", ["reasoning_content", "reasoning"])
def test_words_in_the_reasoning_alone_are_named_as_the_cause(bank: FrameBank, tmp_path: Path, name: str) -> None:
    """By doctor, probe, run and verdict; none of them ends with 0."""
    run = tmp_path / "run"
    with served(answers_in=name) as server:
        for words in (
            ("doctor", "openai:m", "--base-url", server.base_url),
            ("probe", "openai:m", "--base-url", server.base_url, "--out", tmp_path / "mode.toml"),
        ):
            found = call(*words)
            said = " ".join(f"{found.output} {found.exception}".split())
            assert THOUGHT in said
            assert found.exit_code != 0
        probed = battery(bank, run, server)
        assert (probed.exit_code, THOUGHT in probed.output) == (1, True)
        for _ in range(2):  # and when nothing is left to ask
            made = battery(bank, run, server, "--no-probe")
            assert (made.exit_code, THOUGHT in made.output) == (1, True)
            assert "nothing can be judged: openai:m: all 6 replies are empty" in made.output
    assert not (tmp_path / "mode.toml").exists()
    verdict = call("verdict", run)
    assert THOUGHT in " ".join(verdict.output.split())


def test_the_answer_is_read_from_the_end_of_the_reasoning_where_that_is_asked_for(
    bank: FrameBank, tmp_path: Path
) -> None:
    """By an option that the mode keeps; doctor, probe and battery then do as with any other server."""
    asked = ("--answer", "reasoning")
    with served(answers_in="reasoning_content") as server:
        assert call("doctor", "openai:m", "--base-url", server.base_url, *asked).exit_code == 0
        out = tmp_path / "mode.toml"
        assert call("probe", "openai:m", "--base-url", server.base_url, "--out", out, *asked).exit_code == 0
        assert read_mode(out).answer == "reasoning"
        assert battery(bank, tmp_path / "run", server, *asked).exit_code == 0
    manifest, ledger = read_run(tmp_path / "run")[0], tmp_path / "run" / "ledger.sqlite"
    assert manifest.mode("openai:m").answer == "reasoning"
    with Ledger(ledger) as held:
        replies = [reply for _, reply in held.replies("openai:m")]
    assert all(DRIVING.read(reply).action is not None for reply in replies)
    assert all(reply.reasoning.startswith("I look at it. ") for reply in replies)


@pytest.mark.parametrize(
    ("reasoning", "finish", "text"),
    [
        ("LEFT is free.\nSo: SLOW", "stop", "So: SLOW"),
        ("Hm.\n</think>\nSTOP", "stop", "STOP"),
        ('Hm {x}.\n```json\n{\n "action": "STOP"\n}\n```\n', "stop", '{\n "action": "STOP"\n}'),
        ("SLOW", None, "SLOW"),
        ("SLOW", "length", ""),
        ("SLOW", "content_filter", ""),
        ("SLOW", "tool_calls", ""),
        ("", "stop", ""),
    ],
)
def test_what_is_the_end_of_a_reasoning(reasoning: str, finish: str | None, text: str) -> None:
    """The last line, or the object that it ends with; never of a reply that was cut or filtered."""
    assert answer_from_reasoning(Reply("", finish, reasoning=reasoning)).text == text
    assert answer_from_reasoning(Reply("LEFT", finish, reasoning=reasoning)).text == "LEFT"


def test_a_run_goes_on_at_another_address_where_that_is_said(bank: FrameBank, tmp_path: Path) -> None:
    """Without ``--moved`` it is refused in words that name it; with it the move is recorded, once and for good."""
    run = tmp_path / "run"
    with served() as first:
        assert battery(bank, run, first, "--no-probe", "--max-calls", "2").exit_code == 3
    with served() as second:
        refusal = battery(bank, run, second, "--no-probe").exception
        assert f"this run asked openai:m at {first.base_url}" in str(refusal)
        assert "continue a run with --moved, which records it" in str(refusal)
        for _ in range(2):
            assert battery(bank, run, second, "--no-probe", "--moved").exit_code == 0
        assert battery(bank, run, second, "--no-probe").exit_code == 0
        assert (first.requests, second.requests) == (2, 4)
    manifest = read_run(run)[0]
    assert manifest.mode("openai:m").base_url == second.base_url
    assert manifest.facts["openai:m"]["moved"].endswith(f"from {first.base_url} to {second.base_url}")
    other = battery(bank, run, second, "--no-probe", "--moved", "--max-tokens", "9").exception
    assert "this run asked openai:m in another mode: max_tokens was 1024, now 9" in str(other)


def test_a_slash_the_route_and_the_case_of_a_host_are_no_other_address(bank: FrameBank, tmp_path: Path) -> None:
    """The run goes on, and nothing is recorded."""
    run = tmp_path / "run"
    with served() as server:
        assert battery(bank, run, server, "--no-probe", "--max-calls", "2").exit_code == 3
        at = server.base_url.replace("127.0.0.1", "LOCALHOST")
        same = (f"{server.base_url}/", f"{server.base_url}/chat/completions", server.base_url)
        for base_url in same:
            assert battery(bank, run, server, "--no-probe", "--base-url", base_url).exit_code == 0
        assert battery(bank, run, server, "--no-probe", "--base-url", at).exit_code == 1
    assert "moved" not in read_run(run)[0].facts["openai:m"]


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("http://HOST.example/v1", "http://host.example:80/v1/", True),
        ("https://h/v1", "https://h:443/v1/chat/completions", True),
        ("http://[::1]:8000/v1", "http://[::1]:8000/v1/", True),
        ("http://h/v1", "https://h/v1", False),
        ("http://h/V1", "http://h/v1", False),
        ("http://h:8000/v1", "http://h:8001/v1", False),
        ("", "http://h/v1", False),
    ],
)
def test_which_addresses_are_the_same(one: str, other: str, *, same: bool) -> None:
    """The path's case may matter, and so do scheme and port."""
    modes = [RequestMode("openai:m", base_url=address) for address in (one, other)]
    assert modes[0].is_same_request(modes[1]) is same


@pytest.mark.parametrize(("streams", "pinned"), [("always", "none"), ("only", "usage"), ("bare", "plain")])
def test_servers_that_stream_are_asked_and_read(bank: FrameBank, tmp_path: Path, streams: str, pinned: str) -> None:
    """One that always does, one that refuses anything else, and one that refuses to tell the tokens."""
    run = tmp_path / "run"
    with served(streams=streams) as server:
        assert call("doctor", "openai:m", "--base-url", server.base_url).exit_code == 0
        made = battery(bank, run, server)
        assert made.exit_code == 0, made.output
    assert read_run(run)[0].mode("openai:m").stream == pinned
    with Ledger(run / "ledger.sqlite") as held:
        replies = [reply for _, reply in held.replies("openai:m")]
    assert all(reply.first_byte_s and DRIVING.read(reply).action for reply in replies)
    assert {reply.completion_tokens for reply in replies} == {3 if pinned == "usage" else None}


def test_tokens_that_no_server_reports_are_no_0(bank: FrameBank, tmp_path: Path) -> None:
    """In what doctor and probe took, in the run's own record of it, and in its costs."""
    run = tmp_path / "run"
    with served(streams="always") as server:
        for words in (("doctor", "openai:m"), ("probe", "openai:m", "--out", tmp_path / "mode.toml")):
            found = call(*words, "--base-url", server.base_url)
            assert "— tokens in, — out" in " ".join(found.output.split())
        assert "— tokens in, — out" in battery(bank, run, server).output
    assert json.loads((run / "run.json").read_text())["probes"]["openai:m"]["prompt_tokens"] is None
    assert '"completion_tokens": null' in call("costs", run, "--json").output
