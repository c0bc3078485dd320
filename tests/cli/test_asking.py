"""Models that are asked over a network, from the command line: options, limits, prices, and no trace of a key."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from aiohttp import web
from typer.testing import CliRunner, Result

import banks
from eyechart.cli.app import app
from eyechart.errors import SpecError
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.manifest import read_run
from faults import FaultServer, answer, refuse

KEY = "sk-proj-THIS-must-never-be-written-0123456789"
MODE = 'spec = "openai:m"\nbase_url = "{}"\nmax_tokens = 55\n[measured]\nprompt_tokens = 300\ncompletion_tokens = 2.5\n'

Run = Callable[..., Result]


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of six frames."""
    return banks.build_bank(tmp_path_factory.mktemp("asking") / "bank", scenarios=["light", "dense"], episodes=1)


@pytest.fixture
def run(bank: FrameBank, tmp_path: Path) -> Run:
    """Return a function that runs a battery with further options."""

    def battery(*options: str) -> Result:
        words = ["run", "battery", "--frames", str(bank.root), "--out", str(tmp_path / "run"), "--no-probe", *options]
        return CliRunner().invoke(app, words)

    return battery


def test_a_run_whose_calls_failed_says_with_what(run: Run) -> None:
    """Also where they are too few to set the model aside, and where they are over, so that the run is whole."""
    options = ("--model", "openai:m", "--conditions", "real", "--limit", "2", "--no-probe", "--base-url")
    with FaultServer(["400"]) as server:
        result = run(*options, server.base_url)
    assert result.exit_code == 0
    assert "openai:m: 2 calls ended in an error, the last one with bad_request: HTTP 400: " in result.stderr


def test_options_are_the_request_and_stand_in_the_manifest(run: Run, tmp_path: Path) -> None:
    """What was asked for is what is sent, and what resuming must ask for again."""
    options = ("--model", "openai:m", "--conditions", "real", "--limit", "2", "--max-tokens", "9")
    with FaultServer() as server:
        at = ("--base-url", server.base_url)
        more = (
            "--temperature",
            "default",
            "--json-mode",
            "json_object",
            "--timeout",
            "9",
            "--header",
            "X-Team: a: b",
        )
        bodies = ("--body", "top_p=0.5", "--body", 'provider={"only": ["x"]}', "--body", "user=me")
        result = run(*options, *at, *more, *bodies)
        assert result.exit_code == 0, result.output
        assert server.requests == 2
        sent = {name: value for name, value in server.asked[0].items() if name not in {"messages", "model"}}
        assert sent == {
            "max_tokens": 9,
            "response_format": {"type": "json_object"},
            "top_p": 0.5,
            "provider": {"only": ["x"]},
            "user": "me",
        }
        assert server.headers[0]["X-Team"] == "a: b"
        mode = read_run(tmp_path / "run")[0].mode("openai:m")
        assert (mode.max_tokens, mode.temperature, mode.timeout_s) == (9, None, 9.0)
        with pytest.raises(Exception, match="this run asked openai:m in another mode: "):
            raise run(*options, *at).exception or AssertionError
        assert server.requests == 2


def test_a_mode_file_names_its_model_and_is_asked_as_it_says(run: Run, tmp_path: Path) -> None:
    """Options are for the others; the estimate comes from what a probe measured."""
    with FaultServer() as server:
        (tmp_path / "m.toml").write_text(MODE.format(server.base_url), encoding="utf-8")
        words = ("--mode", str(tmp_path / "m.toml"), "--conditions", "real", "--limit", "2")
        result = run(*words, "--model", "openai:n", "--base-url", server.base_url, "--max-tokens", "7")
        assert result.exit_code == 0, result.output
        assert {(one["model"], one["max_tokens"]) for one in server.asked} == {("m", 55), ("n", 7)}
        assert "openai:m: 2 calls, 600 tokens in, 5 out, cost unknown (no price known), time unknown" in result.output
        assert "openai:n: 2 calls, tokens unknown, cost unknown" in result.output
        with pytest.raises(SpecError, match="max_tokens would change no model"):
            raise run(*words, "--max-tokens", "7").exception or AssertionError


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ((), "at least one --model"),
        (("--model", "openai:m", "--header", "nonsense"), "--header 'NAME: VALUE'"),
        (("--model", "openai:m", "--body", "nonsense"), "--body KEY=JSON"),
        (("--model", "openai:m", "--header", KEY), "--header 'NAME: VALUE'"),
        (("--model", "openai:m", "--body", KEY), "--body KEY=JSON"),
        (("--model", "openai:m", "--body", "messages=[]"), "hold the prompt and the picture"),
        (("--model", "openai:m", "--temperature", "hot"), "temperature must be"),
        (("--model", "openai:m", "--header", f"Authorization: Bearer {KEY}"), "looks like a secret"),
        (("--model", "openai:m", "--option", "device=cuda"), "has no option 'device'"),
        (("--model", "openai:m", "--base-url", "localhost:8000"), "base_url must be a URL"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_words(run: Run, options: tuple[str, ...], says: str) -> None:
    """Before any call, and without quoting a secret."""
    error = run(*options).exception
    assert isinstance(error, SpecError)
    assert says in str(error)
    assert KEY not in str(error)


def test_limits_stop_a_run_with_an_exit_code_of_their_own(run: Run, tmp_path: Path) -> None:
    """The same command with a higher limit goes on; a price file makes a cost known."""
    price = '[[price]]\nmodel = "openai:m"\ninput = 100.0\noutput = 0.0\ndate = "2026-01-01"\nsource = "a test"\n'
    (tmp_path / "prices.toml").write_text(price, encoding="utf-8")
    with FaultServer() as server:
        words = ("--model", "openai:m", "--base-url", server.base_url, "--conditions", "real,blank")
        stopped = run(*words, "--max-calls", "5")
        assert (stopped.exit_code, server.requests) == (3, 5)
        assert "5 calls were sent, and --max-calls is 5; 7 calls are left" in stopped.output
        words = (*words, "--prices", str(tmp_path / "prices.toml"), "--concurrency", "1")
        dear = run(*words, "--max-cost", "0.07")  # a cent a call: 100 tokens at $100 a million
        assert (dear.exit_code, server.requests) == (3, 7)
        assert "$0.0700 were spent, and --max-cost is 0.07" in dear.output
        assert run(*words).exit_code == 0
        assert server.requests == 12
    costs = CliRunner().invoke(app, ["costs", str(tmp_path / "run"), "--prices", words[-3], "--json"])
    account = json.loads(costs.stdout)["accounting"]["openai:m"]["all"]
    assert (account["attempts"], account["cost_from"]) == (12, {"priced": 12})
    assert account["cost_usd"] == pytest.approx(0.12)
    decided = 12 - sum(account["missing"].values())
    dollars = f"{1000 * 0.12 / decided:.3f}"
    result = CliRunner().invoke(app, ["costs", str(tmp_path / "run"), "--prices", words[-3]])
    assert dollars in result.stdout
    page, tables = tmp_path / "page.html", tmp_path / "tables"
    made = ["report", str(tmp_path / "run"), "--out", str(page), "--tables", str(tables)]
    assert CliRunner().invoke(app, [*made, "--prices", words[-3]]).exit_code == 0
    section = page.read_text().partition('<section id="costs"')[2].partition("</section>")[0]
    assert f'<td class="number">{dollars}</td>' in section
    assert "$ per 1000 decisions" in (tables / "deployment.csv").read_text()


def test_a_model_that_is_set_aside_is_told_with_its_reason(run: Run) -> None:
    """And the exit code says that calls are unfinished."""

    async def locked(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        del request, asked, attempt
        return refuse(401, "no such key")

    with FaultServer([locked]) as server:
        result = run("--model", "openai:m", "--base-url", server.base_url)
    assert result.exit_code == 1
    assert "set aside: openai:m: auth: HTTP 401: no such key" in result.output


@pytest.mark.slow
def test_a_key_stands_in_no_file_and_no_output(bank: FrameBank, tmp_path: Path) -> None:
    """Searched byte by byte: answers, errors and upstream names that send it back, a failed run, and a traceback."""

    async def echo(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        del asked
        said = f"{request.headers['Authorization']} {request.headers['X-Org']}"
        if attempt == 1:
            return refuse(500, f"cannot use {said}")
        return answer(f"I was sent {said}", provider=said, model=said, system_fingerprint=said)

    env = os.environ | {"OPENAI_API_KEY": KEY, "ORG_TOKEN": f"org-{KEY}"}
    eyechart = [sys.executable, "-c", "from eyechart.cli import main; main()"]
    out = tmp_path / "run"
    words = [
        "run",
        "battery",
        "--frames",
        str(bank.root),
        "--out",
        str(out),
        "--model",
        "openai:m",
        "--no-probe",
        "--debug",
    ]
    words += ["--conditions", "real,blank", "--limit", "2", "--header", "X-Org: $ORG_TOKEN"]
    told = b""
    with FaultServer([echo]) as server:
        for more in (["--base-url", server.base_url], ["--base-url", f"https://{KEY}@127.0.0.1/v1"]):
            done = subprocess.run([*eyechart, *words, *more], env=env, capture_output=True, check=False)
            told += done.stdout + done.stderr
    for command in ("score", "costs", "verdict"):
        done = subprocess.run([*eyechart, command, str(out), "--json"], env=env, capture_output=True, check=False)
        assert done.returncode == 0
        told += done.stdout + done.stderr
    assert server.requests == 4 + 1
    files = [path for path in out.rglob("*") if path.is_file()]
    assert {"run.json", "ledger.sqlite"} <= {path.name for path in files}
    assert [path for path in files if KEY.encode() in path.read_bytes()] == []
    assert KEY.encode() not in told
    with Ledger(out / "ledger.sqlite") as ledger:
        assert "[key removed]" in "".join(reply.text for _, reply in ledger.replies("openai:m"))
