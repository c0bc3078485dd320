"""Published controllers behind a loopback server are asked, read and judged with a prompt file alone."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from aiohttp import web
from typer.testing import CliRunner

import banks
from eyechart.cli.app import app
from eyechart.frames import BankWriter, FrameBank, decode, open_bank
from eyechart.manifest import read_run
from eyechart.models.prices import read_prices
from eyechart.prompts import Prompt, read_prompt
from eyechart.serve.live import LiveRun
from eyechart.studies import study_of
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


def ask(
    server: FaultServer, bank: FrameBank, prompt: Path, out: Path, conditions: str = CONDITIONS, *more: str
) -> None:
    """Run a battery with this prompt file."""
    words = ["run", "battery", "--frames", str(bank.root), "--out", str(out), "--no-probe", "--controls", "none"]
    words += ["--model", "openai:m", "--base-url", server.base_url, "--prompt", str(prompt), "--conditions", conditions]
    words += more
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


NUMBERS = """
user = "Reply with steer in degrees and speed in m/s as JSON."
[[answer.fields]]
name = "steer"
kind = "number"
key = "steer"
values = ["< -5", "-5..5", "> 5"]
mirror_pairs = [["< -5", "> 5"]]
[[answer.fields]]
name = "speed"
kind = "number"
key = "speed"
unit = "m/s"
values = ["< 4", "< 10", ">= 10"]
brake = ["< 4", "< 10"]
proceed = [">= 10"]
"""


def drives(picture: bytes | None) -> str:
    """Return a steering angle towards the middle lane, and a speed by the gap."""
    if picture is None:
        return '{"steer": 0.25, "speed": "12 m/s"}'
    pixels = decode(picture, "it").astype(int)
    own, lead = pixels[:, :, 1] > 150, pixels[:, :, 0] > 150
    row = float(np.flatnonzero(own.any(axis=1)).mean()) if own.any() else 7.5
    gap = float(np.flatnonzero(lead.any(axis=0))[0]) - 10 if lead.any() else 40.0
    return json.dumps({"steer": round(3 * (row - 7.5), 2), "speed": round(gap / 2, 2)})


def test_numbers_that_follow_the_picture_and_numbers_that_do_not_get_opposite_verdicts(tmp_path: Path) -> None:
    """Each field is an axis: the speed brakes by its ranges, and the steering exchanges under reflection."""
    bank, file, labels = bank_of(tmp_path / "bank", 4, 8), tmp_path / "numbers.toml", {}
    file.write_text(NUMBERS, encoding="utf-8")
    for name, reply in (("looks", drives), ("blind", lambda _: drives(None))):
        with server_of(reply) as server:
            ask(server, bank, file, tmp_path / name, f"{CONDITIONS},noise,recoloured,cross_scenario")
        found = score(tmp_path / name, resamples=50)
        (verdict,) = judge(found).values()
        labels[name] = verdict.calibrated.label
        swaps = found.models["openai:m"].statistics["mirror_swap_rate"]
        assert (swaps.value, name) in {(1.0, "looks"), (None, "blind")}
    assert labels == {"looks": "depth_associated", "blind": "image_invariant"}


def test_an_answer_outside_the_frames_own_names_is_no_answer(bank: FrameBank, tmp_path: Path) -> None:
    """Under another frame's words the names are that frame's; the schema asks for the same."""
    out = tmp_path / "arrows"
    frames = [replace(frame, fields={"arrows": "1, 2" if at % 2 else "7"}) for at, frame in enumerate(bank)]
    with BankWriter(out, replace(banks.manifest(), prompt_columns=("arrows",))) as writer:
        for code, frame in enumerate(frames):
            writer.add(frame, *banks.pictures_of(frame, code))
    file = tmp_path / "arrow.toml"
    file.write_text(PUBLISHED["VLMnav"].prompt, encoding="utf-8")
    with server_of(lambda _: '{"action": 7}') as server:
        ask(
            server,
            open_bank(out),
            file,
            tmp_path / "run",
            "real,real_repeat,text_swapped",
            "--json-mode",
            "json_schema",
        )
    answers = score(tmp_path / "run", resamples=50).models["openai:m"].answers
    assert answers.actions("real").tolist() == ["7", ""] * 4
    assert answers.actions("text_swapped").tolist() == ["", "7"] * 4
    assert answers.space.actions == ("7", "1", "2")
    assert answers.counts()["real"] == {"decision": 4, "unparsed: other_value": 4}
    allowed = {json.dumps(one["response_format"]["json_schema"]["schema"]["properties"]) for one in server.asked}
    assert allowed == {json.dumps({"action": {"type": "string", "enum": names}}) for names in (["7"], ["1", "2"])}


def test_a_run_of_declared_answers_is_packed_and_validated(bank: FrameBank, tmp_path: Path) -> None:
    """A page of a space whose answers are not known beforehand is drawn again, byte for byte."""
    one, file = PUBLISHED["LightEMMA"], tmp_path / "controller.toml"
    file.write_text(one.prompt, encoding="utf-8")
    with server_of(lambda picture: one.reply(code_of(picture))) as server:
        ask(server, bank, file, tmp_path / "run", "real,real_repeat,blank,mirrored")
    for words in (
        ["bundle", str(tmp_path / "run"), "--out", str(tmp_path / "b.zip")],
        ["validate", str(tmp_path / "b.zip")],
    ):
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0, done.output


@pytest.mark.parametrize("name", ["VLMnav", "NavGPT"])
def test_counts_know_the_names_of_each_frame(name: str, tmp_path: Path) -> None:
    """A name of another frame is no decision for the score, the costs, the unread replies and the live page alike."""
    one, file, out = PUBLISHED[name], tmp_path / "controller.toml", tmp_path / "run"
    file.write_text(one.prompt, encoding="utf-8")
    frames = banks.frames_of(["light", "dense"], 2, 2, "vertical", drawn=True)
    with BankWriter(tmp_path / "bank", replace(banks.manifest(), prompt_columns=tuple(COLUMNS))) as writer:
        for code, frame in enumerate(frames):
            own = {**COLUMNS, "arrows": str(10 + code), "viewpoints": f"{code:032x}"}
            writer.add(replace(frame, fields=own), *banks.pictures_of(frame, code))
    bank = open_bank(tmp_path / "bank")

    reply = '{"action": 10}' if name == "VLMnav" else f'Action Input: "{0:032x}"'
    with server_of(lambda _: reply) as server:
        ask(server, bank, file, out, "real,real_repeat,blank")
    study, others = study_of(out), 3 * (len(bank) - 1)
    answers = score(out, resamples=50).models["openai:m"].answers
    assert (
        sum(one is not None and one.action is None for column in answers.decisions.values() for one in column) == others
    )
    (unread,) = study.unread(out)["openai:m"]
    assert (unread.count, unread.missing, unread.why) == (others, "unparsed", "other_value")
    account = study.took(out, read_prices()).accounts["openai:m"]["all"]
    assert (account.missing, account.finished) == ({"unparsed": others}, 3 * len(bank))
    (shown,) = LiveRun(out, read_prices()).models()
    assert f"in {others} of {3 * len(bank)} answers no decision is read" in shown.warnings
