"""Servers that are reached at a wrong address, or that serve otherwise than most, from the command line."""

from collections.abc import Callable
from pathlib import Path

import pytest
from aiohttp import web
from typer.testing import CliRunner, Result

import banks
from eyechart.cli.app import app
from eyechart.errors import EyechartError
from eyechart.frames import FrameBank
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
    "words",
    [
        "/chat/completions: Invalid model name passed in model=m. Call `/v1/models` to view available models",
        "The model `m` does not exist",
        "m is not a valid model ID",
        "unknown model: m",
    ],
)
def test_an_unknown_model_in_a_400_is_a_missing_model(words: str) -> None:
    """As LiteLLM, OpenAI's older servers and OpenRouter say it; and where to see which there are."""
    with always(lambda: refuse(400, words)) as server:
        said = doctor(server.base_url)
        assert "there is no model of this name" in said
        assert f"{server.base_url}/models lists what there is" in said


def always(says: Callable[[], web.Response]) -> FaultServer:
    """Return a server that says this whatever it is asked."""

    async def handle(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        del request, asked, attempt
        return says()

    return FaultServer([handle])
