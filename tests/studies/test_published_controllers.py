"""Published controllers behind a loopback server are asked, read and judged with a prompt file alone."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from aiohttp import web
from typer.testing import CliRunner

import banks
from eyechart.cli.app import app
from eyechart.frames import BankWriter, FrameBank, decode, open_bank
from eyechart.manifest import read_run
from eyechart.prompts import Prompt, read_prompt
from eyechart.studies.battery.scores import score
from eyechart.verdicts import judge
from faults import FaultServer, answer
from published import COLUMNS, PUBLISHED
from seeing import read

CONDITIONS = "real,real_repeat,blank,mirrored,shuffled,lead_near,lead_far,text_only"


def bank_of(out: Path, episodes: int, steps: int) -> FrameBank:
    """Write a bank whose frames have the columns of the controllers."""
    frames = banks.frames_of(["light", "dense"], episodes, steps, "vertical", drawn=True)
    with BankWriter(out, replace(banks.manifest(), prompt_columns=tuple(COLUMNS))) as writer:
        for code, frame in enumerate(frames):
            writer.add(replace(frame, fields=COLUMNS), *banks.pictures_of(frame, code))
    return open_bank(out)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of eight frames."""
    return bank_of(tmp_path_factory.mktemp("published") / "bank", 2, 2)


def server_of(reply: Callable[[bytes | None], str]) -> FaultServer:
    """Return an endpoint that answers by the picture."""

    async def handle(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        del request, attempt
        return answer(reply(read(asked)[1]))

    return FaultServer([handle])


def code_of(picture: bytes | None) -> int:
    """Return a number that follows from a picture's pixels."""
    return 0 if picture is None else int(decode(picture, "it").astype(int).sum()) // 7


def ask(server: FaultServer, bank: FrameBank, prompt: Path, out: Path, conditions: str = CONDITIONS) -> None:
    """Run a battery with this prompt file."""
    words = ["run", "battery", "--frames", str(bank.root), "--out", str(out), "--no-probe", "--controls", "none"]
    words += ["--model", "openai:m", "--base-url", server.base_url, "--prompt", str(prompt), "--conditions", conditions]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_published_controller_is_asked_read_and_judged(name: str, bank: FrameBank, tmp_path: Path) -> None:
    """Every reply is read as what it means; the run has a verdict, and another start of it asks nothing."""
    one, file, out = PUBLISHED[name], tmp_path / "controller.toml", tmp_path / "run"
    file.write_text(one.prompt, encoding="utf-8")
    with server_of(lambda picture: one.reply(code_of(picture))) as server:
        ask(server, bank, file, out, "real,blank")
        assert server.requests == 2 * len(bank)
        ask(server, bank, file, out)
        whole = server.requests
        ask(server, bank, file, out)
        assert server.requests == whole
    found = score(out, resamples=50)
    answers = found.models["openai:m"].answers
    assert answers.actions("real").tolist() == [one.action(code_of(bank.images(frame)["main"])) for frame in bank]
    assert all(one is None or one.action for column in answers.decisions.values() for one in column)
    (verdict,) = judge(found).values()
    assert verdict.calibrated.label not in {"not_scorable", "depth"}
    manifest, _ = read_run(out)
    assert Prompt.from_dict(json.loads(json.dumps(manifest.prompt.as_dict()))) == manifest.prompt == read_prompt(file)
