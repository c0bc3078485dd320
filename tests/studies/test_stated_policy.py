"""A model that answers with numbers is a policy: asked, paid, resumed and judged as one."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from aiohttp import web
from typer.testing import CliRunner

from eyechart.api import examine_policy, look, run_policies
from eyechart.cli.app import app
from eyechart.errors import BankError, LedgerError, SpecError
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, read_run
from eyechart.modes import RequestMode
from eyechart.prompts import Prompt
from eyechart.studies.battery.scores import score as battery_score
from eyechart.studies.policy.scores import score
from faults import FaultServer, Loopback, completion
from seeing import read
from steering import PROMPT, Driver, OllamaDriver, rover_bank

FEW = "real,real_repeat,nudged,swapped@cameras,swapped@state,swapped@instruction"


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of eighty moments of a rover."""
    return rover_bank(tmp_path_factory.mktemp("steering"))


@pytest.fixture
def prompt(tmp_path: Path) -> Path:
    """Return the prompt that asks for steering and speed."""
    file = tmp_path / "drive.toml"
    file.write_text(PROMPT)
    return file


def eyechart(*words: object, code: int = 0) -> str:
    """Run a command, and return its output."""
    done = CliRunner().invoke(app, list(map(str, words)))
    assert done.exit_code == code, done.output
    return done.output


def refused(*words: object) -> str:
    """Run a command that refuses, and return its error."""
    done = CliRunner().invoke(app, list(map(str, words)))
    assert isinstance(done.exception, SpecError | BankError), done.output
    return str(done.exception)


def command(bank: FrameBank, out: Path, server: FaultServer, *more: object) -> Sequence[object]:
    """Return the command that asks the model behind a server."""
    asked = ("--policy", "openai:m", "--base-url", server.base_url, "--frames", bank.root, "--out", out)
    return ("run", "policy", *asked, *more)


def verdict(out: Path, spec: str = "openai:m") -> dict[str, object]:
    """Return what the verdict's command says of a policy."""
    found = json.loads(eyechart("verdict", out, "--json"))["policies"][spec]
    assert isinstance(found, dict)
    return found


@pytest.mark.parametrize(("looks", "label", "gate"), [(1, "camera_content", 0), (0, "ignores_camera", 1)])
def test_who_looks_and_who_does_not_get_opposite_verdicts(
    bank: FrameBank, prompt: Path, tmp_path: Path, looks: int, label: str, gate: int
) -> None:
    """The same prompt, bank and protocol; the endpoint is probed, and all of a run's readers know the run."""
    out, prices = tmp_path / "run", tmp_path / "prices.toml"
    prices.write_text('[[price]]\nmodel = "openai:m"\ninput = 1.0\noutput = 2.0\ndate = "2026-11"\nsource = "a test"\n')
    with FaultServer([Driver(looks=bool(looks))]) as server:
        said = eyechart(*command(bank, out, server, "--prompt", prompt, "--prices", prices))
    assert "is probed first" in said
    assert "$" in next(line for line in said.splitlines() if "up to 3920 calls" in line)
    assert "80 frames × 13 conditions: 1040 calls" in said
    found = verdict(out)
    assert found["camera"] == label
    assert (found["state"], found["instruction"]) == ("state_used" if looks else found["state"], "instruction_followed")
    scored = score(out)
    account = scored.accounting["openai:m"]["all"]
    assert account.calls == 1040
    assert account.prompt_tokens > 0
    assert {one.name: one.holds for one in scored.guards["openai:m"]}["picture"] is True
    assert read_run(out)[0].mode("openai:m").structured == "json_schema"
    eyechart("gate", out, "--require", "looks", code=gate)
    eyechart("report", out, "--out", tmp_path / "page.html")
    eyechart("bundle", out, "--out", tmp_path / "run.zip")
    assert "no decision" in eyechart("costs", out)


def test_a_killed_run_goes_on_and_asks_no_finished_call_again(bank: FrameBank, prompt: Path, tmp_path: Path) -> None:
    """A process is killed in the middle; the same command makes what its ledger lacks, and nothing else."""
    out = tmp_path / "run"
    with FaultServer([Driver()], pause_s=0.02) as server:
        words = command(bank, out, server, "--prompt", prompt, "--no-probe", "--conditions", FEW)
        with subprocess.Popen([sys.executable, "-m", "eyechart", *map(str, words)], stderr=subprocess.DEVNULL) as child:
            while server.requests < 100:
                assert child.poll() is None
                time.sleep(0.01)
            child.kill()
        time.sleep(0.1)
        with Ledger(out / LEDGER) as ledger:
            finished, before = len(ledger.finished()), server.requests
        assert 0 < finished < 480
        eyechart(*words)
        assert server.requests - before == 480 - finished
        eyechart(*command(bank, out, server, "--no-probe", "--conditions", FEW))  # the run knows its prompt
        assert server.requests - before == 480 - finished
    assert score(out).models["openai:m"].motions.finished == 480


def test_a_model_that_trembles_is_asked_four_times_and_its_noise_is_measured(
    bank: FrameBank, prompt: Path, tmp_path: Path
) -> None:
    """At temperature 1 two answers to one moment differ; what goes with noise is no use of a channel."""
    out = tmp_path / "run"
    with FaultServer([Driver(trembles=0.2)]) as server:
        more = ("--no-probe", "--conditions", FEW, "--limit", 32, "--temperature", 1)
        eyechart(*command(bank, out, server, "--prompt", prompt, *more))
        assert server.requests == 32 * (5 * 4 + 1)
    found = score(out).models["openai:m"]
    assert found.drawn
    assert (found.statistics["noise"].value or 0) > 0.005
    with FaultServer([Driver(trembles=0.2)]) as server:
        eyechart(*command(bank, tmp_path / "cold", server, "--prompt", prompt, *more[:-1], 0))
        assert server.requests == 32 * 6
    assert score(tmp_path / "cold").models["openai:m"].statistics["noise"].value == 0.0


def test_a_tool_call_holds_the_fields(bank: FrameBank, prompt: Path, tmp_path: Path) -> None:
    """The tool's parameters are the declared fields, and its arguments the answer."""

    async def call(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        del request, attempt
        (tool,) = asked["tools"]
        assert set(tool["function"]["parameters"]["properties"]) == {"steer", "speed"}
        pace = read(asked)[0].split("drives at ")[1].split()[0]
        called = {"name": tool["function"]["name"], "arguments": f'{{"steer": 0.5, "speed": {pace}}}'}
        said = completion("", "tool_calls")
        said["choices"][0]["message"] = {
            "content": None,
            "tool_calls": [{"id": "1", "type": "function", "function": called}],
        }
        return web.json_response(said)

    more = ("--prompt", prompt, "--no-probe", "--conditions", "real", "--json-mode", "tool_call")
    with FaultServer([call]) as server:
        eyechart(*command(bank, tmp_path / "run", server, *more))
    motions = score(tmp_path / "run").models["openai:m"].motions
    assert motions.missing == {}
    assert motions.answers["real"][0, :, 0].tolist() == [[0.5, frame.state["pace"][0]] for frame in bank]


ODD = (
    ("I'm sorry, I can't help with that.", "stop", "refused"),
    ('{"steer": 0.1, "spe', "length", "truncated"),
    ("", "stop", "empty"),
    ('{"steer": "left", "speed": 1}', "stop", "unparsed: not_a_number"),
    ('{"steer": 0.1, "speed": "5 km/h"}', "stop", "unparsed: other_unit"),
    ('{"steer": 0.1} or {"steer": 0.2, "speed": 1}', "stop", "unparsed: several_values"),
    ('{"steer": 0.1}', "stop", "unparsed: no_answer"),
    ('{"steer": NaN, "speed": 1}', "stop", "unparsed: not_finite"),
)


def test_each_reply_without_numbers_is_a_row_with_its_reason(bank: FrameBank, prompt: Path, tmp_path: Path) -> None:
    """Nothing is put in its place, and the costs list the words."""
    out = tmp_path / "run"
    with FaultServer([Driver(odd=[one[:2] for one in ODD])]) as server:
        more = ("--no-probe", "--conditions", "real,swapped@cameras", "--concurrency", 1)
        eyechart(*command(bank, out, server, "--prompt", prompt, *more))
    missing = score(out).models["openai:m"].motions.missing
    assert missing == {reason: 10 for _, _, reason in ODD}
    assert "not_scorable" in verdict(out)["guards"]
    assert "5 km/h" in eyechart("costs", out, "--unread")


def test_a_model_without_a_single_motion_is_set_aside(bank: FrameBank, prompt: Path, tmp_path: Path) -> None:
    """After ten in a row, with its words; a model that refuses is asked to the end."""
    names = [('{"steer": "hard left", "speed": 1}', "stop")]
    with FaultServer([Driver(odd=names, driven=1)]) as server:
        server.faults = [Stubborn(names[0])]
        words = command(bank, tmp_path / "run", server, "--prompt", prompt, "--no-probe", "--conditions", "real")
        said = eyechart(*words, code=1)
        assert "not_a_number" in said
        assert "hard left" in said
        assert server.requests < 40
        server.faults, server.requests = [Stubborn(ODD[0][:2])], 0
        server.dealt.clear()
        words = command(bank, tmp_path / "other", server, "--prompt", prompt, "--no-probe", "--conditions", "real")
        eyechart(*words, code=1)
        assert server.requests == 80


@dataclass
class Stubborn:
    """An endpoint that says one thing."""

    said: tuple[str, str]

    async def __call__(self, request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        """Answer one request."""
        del request, asked, attempt
        return web.json_response(completion(*self.said, usage={"prompt_tokens": 9, "completion_tokens": 3}))


def test_an_endpoint_that_drops_pictures_is_no_finding_about_the_model(
    bank: FrameBank, prompt: Path, tmp_path: Path
) -> None:
    """The probe saw that it is blind: the guard stands where a label would."""
    out = tmp_path / "run"
    with FaultServer([Driver(sees=False)]) as server:
        said = eyechart(*command(bank, out, server, "--prompt", prompt))
    assert "did not see the probe's pictures" in said
    found = verdict(out)
    assert "picture" in found["guards"]
    assert (found["camera"], found["answer"]) == ("undecided", "Inconclusive")
    assert "picture" in eyechart("gate", out, "--require", "looks", code=2)


def test_ollama_is_asked_without_a_prompt_by_plain_words(bank: FrameBank, tmp_path: Path) -> None:
    """The plainest prompt says camera, state, instruction and the form; its rows are read into motions."""
    out = tmp_path / "run"
    with Loopback(OllamaDriver().app()) as server:
        asked = ("--policy", "ollama:llava", "--base-url", f"http://127.0.0.1:{server.port}", "--frames", bank.root)
        eyechart("run", "policy", *asked, "--out", out, "--conditions", FEW)
    found = score(out)
    (result,) = found.models.values()
    assert (result.motions.finished, result.motions.missing) == (480, {})
    assert found.manifest.prompt.user == (
        "You control a machine by its camera (forward camera of a rover). Its state (pace): {pace}. Your task: {task}. "
        "Answer with one row of the numbers steer (rad), speed (m/s); each number is a change. Reply with JSON and "
        'nothing else: {"motion": [[<steer>, <speed>]]}'
    )
    assert Prompt.from_dict(json.loads(json.dumps(found.manifest.prompt.as_dict()))) == found.manifest.prompt


def test_what_the_words_leave_out_is_neither_exchanged_nor_judged(bank: FrameBank, tmp_path: Path) -> None:
    """A prompt without the state: no call exchanges it, and its label says so."""
    file, out = tmp_path / "short.toml", tmp_path / "run"
    file.write_text(PROMPT.replace("It drives at {pace} m/s now.", ""))
    with FaultServer([Driver()]) as server:
        said = eyechart(*command(bank, out, server, "--prompt", file, "--no-probe"))
    assert "swapped@state, kept@state, because prompt 'drive' does not say the state" in said
    assert not [name for name in read_run(out)[0].conditions if name.endswith("@state")]
    found = verdict(out)
    assert found["state"] == "undecided"
    assert "prompt 'drive' does not say the state" in str(found["axes"])
    asked = command(bank, tmp_path / "other", server, "--prompt", file, "--conditions", "kept@state")
    assert "prompt 'drive' does not say the state" in refused(*asked)


def test_python_runs_examines_and_looks_at_the_same_policy(bank: FrameBank, prompt: Path, tmp_path: Path) -> None:
    """By its SPEC or its mode; the doctor of policies says what reaches it, a look says Yes."""
    with FaultServer([Driver()]) as server:
        mode = RequestMode("openai:m", base_url=server.base_url)
        report = run_policies(bank, mode, tmp_path / "run", prompt=str(prompt))
        assert report["openai:m"].camera.label == "camera_content"
        known = server.requests
        run_policies(bank, "openai:m", tmp_path / "run", base_url=server.base_url, prompt=str(prompt), probe=False)
        assert server.requests == known
        found = examine_policy(bank, mode, prompt=str(prompt))
        assert found.exit_code == 0, str(found)
        words = ("--base-url", server.base_url, "--frames", bank.root, "--prompt", prompt)
        assert "fine" in eyechart("doctor", "openai:m", *words)
        seen = look("openai:m", bank=bank.root, prompt=str(prompt), base_url=server.base_url, out=tmp_path / "look")
        assert (seen.answer, seen.label) == ("Yes", "camera_content")


def test_a_policy_on_a_server_that_has_moved_goes_on_where_that_is_said(
    bank: FrameBank, prompt: Path, tmp_path: Path
) -> None:
    """As a battery does: the error names the argument, no call is made anew, and the run records it."""
    asked: dict[str, Any] = {"prompt": str(prompt), "probe": False, "conditions": ["real"]}
    with FaultServer([Driver()]) as server:
        run_policies(bank, "openai:m", tmp_path / "run", base_url=server.base_url, limit=3, **asked)
    with FaultServer([Driver()]) as server:
        with pytest.raises(LedgerError, match="or continue a run with moved=True, which records it"):
            run_policies(bank, "openai:m", tmp_path / "run", base_url=server.base_url, limit=5, **asked)
        asked["moved"] = True
        found = run_policies(bank, "openai:m", tmp_path / "run", base_url=server.base_url, limit=5, **asked)
        assert server.requests == 2
    manifest = found.score.manifest
    assert manifest.mode("openai:m").base_url == server.base_url
    assert f"to {server.base_url}" in manifest.facts["openai:m"]["moved"]


REFUSED = {
    "a name": (
        'fields = [{name = "steer", key = "steer", values = ["LEFT", "RIGHT"]}]',
        "a controller: 'eyechart run battery",
    ),
    "lacking": ('fields = [{name = "steer", kind = "number", key = "steer"}]', "the numbers steer, speed"),
    "unit": (
        'fields = [{name = "steer", kind = "number", key = "a", unit = "deg"}, SPEED]'.replace(
            "SPEED", '{name = "speed", kind = "number", key = "b"}'
        ),
        "let the prompt ask for rad",
    ),
    "size": ('fields = [{name = "all", kind = "vector", size = 4}]', "write size = 2"),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_an_answer_that_is_not_the_banks_motion_is_refused(fault: str, bank: FrameBank, tmp_path: Path) -> None:
    """Before any call, with the way."""
    answer, says = REFUSED[fault]
    file = tmp_path / "drive.toml"
    file.write_text(f'user = "Drive."\n[answer]\n{answer}\n')
    asked = ("--policy", "openai:m", "--base-url", "http://127.0.0.1:9", "--frames", bank.root)
    assert says in refused("run", "policy", *asked, "--out", tmp_path / "run", "--prompt", file)
    assert not (tmp_path / "run").exists()


def test_no_step_is_repeated(tmp_path: Path) -> None:
    """A bank of three steps wants three: a number is refused, a vector of each is read, and rows."""
    bank, file = rover_bank(tmp_path, horizon=3), tmp_path / "drive.toml"
    file.write_text(PROMPT)
    asked = ("--policy", "openai:m", "--base-url", "http://127.0.0.1:9", "--frames", bank.root, "--out", tmp_path / "r")
    said = refused("run", "policy", *asked, "--prompt", file)
    assert "1 of the 3 steps of a motion, and no step is repeated" in said


def test_arrays_and_words_are_not_asked_in_one_run(bank: FrameBank, prompt: Path, tmp_path: Path) -> None:
    """Nor does a policy called here take what asks a model in words."""
    asked = ("run", "policy", "--policy", "python:arms:middle", "--frames", bank.root, "--out", tmp_path / "run")
    with FaultServer([Driver()]) as server:
        words = refused(*asked, "--policy", "openai:m", "--base-url", server.base_url)
    assert "base_url would not change 'python:arms:middle'" in words
    assert "--prompt is for models" in refused(*asked, "--prompt", prompt)
    assert "max_tokens would not change 'python:arms:middle'" in refused(*asked, "--max-tokens", 5)
    mode = tmp_path / "mode.toml"
    mode.write_text('spec = "openai:m"\nbase_url = "http://127.0.0.1:9/v1"\n')
    assert "states numbers in words" in refused(*asked, "--mode", mode)
    assert not (tmp_path / "run").exists()


NAMES = """
user = "Steer LEFT or RIGHT. It drives at {pace} m/s now. Your task: {task}."
[answer]
fields = [{name = "steer", values = ["LEFT", "RIGHT"], mirror_pairs = [["LEFT", "RIGHT"]]}]
"""


def test_a_model_that_answers_with_names_is_a_controller_on_the_same_bank(bank: FrameBank, tmp_path: Path) -> None:
    """The battery asks it, states the state in words, and exchanges it with the words."""
    file, out, said = tmp_path / "names.toml", tmp_path / "run", []
    file.write_text(NAMES)

    async def answer_by_pace(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        del request, attempt
        words = read(asked)[0]
        said.append(words)
        fast = float(words.split("drives at ")[1].split()[0]) > 1.5
        return web.json_response(completion("LEFT" if fast else "RIGHT", "stop"))

    with FaultServer([answer_by_pace]) as server:
        asked = ("--model", "openai:m", "--base-url", server.base_url, "--frames", bank.root, "--prompt", file)
        more = ("--no-probe", "--controls", "none", "--conditions", "real,real_repeat,blank,shuffled,text_swapped")
        eyechart("run", "battery", *asked, "--out", out, *more)
    answers = battery_score(out, resamples=50).models["openai:m"].answers
    assert len(said) == 5 * len(bank)
    assert (answers.actions("real") == answers.actions("shuffled")).all()
    assert (answers.actions("real") != answers.actions("text_swapped")).any()


def by_name(images: object, state: object, instruction: object) -> object:
    """Answer with the name of an action, as a controller does."""
    del images, state, instruction
    return "LEFT"


def in_parts(images: object, state: object, instruction: object) -> object:
    """Answer with names by their parts."""
    del images, state, instruction
    return {"steer": "LEFT", "speed": "SLOW"}


@pytest.mark.parametrize("act", [by_name, in_parts])
def test_a_callable_that_answers_with_names_is_sent_to_the_battery(
    act: Callable[..., object], bank: FrameBank, tmp_path: Path
) -> None:
    """By the sentence of its set-aside, in a command that takes it."""
    with pytest.warns(UserWarning, match="is a controller: let it take .prompt, image., and ask it with 'eyechart run"):
        run_policies(bank, {"names": act}, tmp_path / "run", conditions=["real"])
