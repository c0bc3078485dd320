"""Policies of LeRobot in a process of their own: what they are given, how they end, and what is refused.

LeRobot is a stand-in here; the process, its pipes and its ends are real. `tests/extras/test_lerobot_real.py` asks
LeRobot itself.
"""

import asyncio
import io
import json
import os
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import lerobot_stand_in as stand_in
from eyechart.calls import Query, Reply
from eyechart.cli.app import app
from eyechart.errors import EyechartError, SpecError
from eyechart.frames import FrameBank, Stimulus, encode
from eyechart.ledger import Ledger
from eyechart.manifest import read_manifest
from eyechart.models import lerobot, open_model, open_policy
from eyechart.models.lerobot.process import LENGTHS, MOST_BYTES, read_message
from eyechart.modes import RequestMode
from eyechart.simulators import open_bank_simulator
from eyechart.spaces.motion import Motion
from eyechart.studies import policy
from test_processes import ENDS, is_there, left_after_a_kill

TOP = np.full((32, 32, 3), (204, 40, 40), np.uint8)
SEEN = Stimulus({"wrist": encode(TOP // 2), "top": encode(TOP)}, {}, {"tool": (0.75, 0.5), "grip": (1.0,)})
SOON_S = 10.0


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the stand-ins."""
    return stand_in.install(tmp_path_factory.mktemp("packages"))


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a tabletop of four episodes."""
    return open_bank_simulator("tabletop").build(tmp_path_factory.mktemp("b") / "bank", seeds=(0,), steps=4)


@pytest.fixture(autouse=True)
def python(packages: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have this Python found with the stand-ins, by the processes that it begins alone."""
    monkeypatch.setenv(lerobot.PYTHON, sys.executable)
    for name, value in stand_in.environment(packages).items():
        monkeypatch.setenv(name, value)


def opened(folder: Path, timeout_s: float = 60.0) -> lerobot.LeRobotPolicy:
    """Return the policy of a checkpoint."""
    spec = f"lerobot:{folder}"
    made = open_model(spec, RequestMode(spec, timeout_s=timeout_s), answering="policy")
    assert isinstance(made, lerobot.LeRobotPolicy)
    return made


def answers(model: lerobot.LeRobotPolicy, *queries: Query) -> list[Reply]:
    """Return what a policy answers, one call after another; its process has ended then."""

    async def ask() -> list[Reply]:
        try:
            return [await model.answer(query) for query in queries]
        finally:
            await model.close()

    return asyncio.run(ask())


def query(bank: FrameBank | None = None, seed: int = 3, words: str = "go") -> Query:
    """Return a query about one instant, for motions of a bank."""
    schema = {} if bank is None else {"schema": bank.manifest.motion.schema()}
    return Query("", words, SEEN, seed, **schema)


def only(reply: Reply) -> np.ndarray:
    """Return the numbers of an answer."""
    assert reply.error is None, reply.error_detail
    return Motion.read(reply.text).array


def test_it_is_given_what_lerobot_gives_and_returns_the_units_of_the_log(tmp_path: Path) -> None:
    """Pictures from 0 to 1 by name, a normalised state, and the chunk after its own processor."""
    (reply,) = answers(opened(stand_in.checkpoint(tmp_path / "act")), query())
    found = only(reply)
    assert found.shape == (stand_in.CHUNK, 3)
    drawn = np.float32(np.random.default_rng(3).standard_normal())
    np.testing.assert_allclose(found[0], [2 * 204 / 255, 2 * (0.75 - 0.5) / 0.25, 10 + 2 * drawn], rtol=1e-6)
    np.testing.assert_allclose(found[3, :2], 4 * found[0, :2], rtol=1e-6)


@pytest.mark.parametrize("kind", ["diffusion", "vqbet"])
def test_a_type_that_reads_a_window_is_given_it_in_its_own_way(kind: str, tmp_path: Path) -> None:
    """On an axis of its own, or by a queue that holds nothing of the call before."""
    first, again = answers(opened(stand_in.checkpoint(tmp_path / kind, type=kind)), query(), query())
    usual = answers(opened(stand_in.checkpoint(tmp_path / "act")), query())
    assert only(first).tolist() == only(again).tolist() == only(usual[0]).tolist()


@pytest.mark.parametrize("kind", ["diffusion", "vqbet"])
def test_a_window_reaches_it_with_the_oldest_instant_first(kind: str, tmp_path: Path) -> None:
    """Exactly as many instants as it reads, each normalised alone; a bank may hold more."""
    model = opened(stand_in.checkpoint(tmp_path / kind, type=kind, n_obs_steps=3))
    assert model.facts["history"] == "2"
    past = tuple(
        Stimulus({name: encode(TOP // 4 * n) for name in ("top", "wrist")}, {}, {"tool": (n / 8, 0.5), "grip": (1.0,)})
        for n in range(4)
    )
    seen = replace(SEEN, past=past)
    (reply,) = answers(model, replace(query(), stimulus=seen))
    bright, place = (204 - 204 // 4 * 2) / 255, (0.75 - 2 / 8) / 0.25
    np.testing.assert_allclose(only(reply)[0], [2 * bright, 2 * place, 10 + 2 * 3], rtol=1e-6)


def test_a_bank_of_single_instants_is_refused_with_what_makes_another(bank: FrameBank, tmp_path: Path) -> None:
    """Copies of one instant are no window."""
    spec = f"lerobot:{stand_in.checkpoint(tmp_path / 'act', type='diffusion', n_obs_steps=2)}"
    with pytest.raises(SpecError, match=r"holds 0 instants before each frame; make the bank with .*--history 1"):
        policy.plan(bank.root, [spec], tmp_path / "run")


def test_a_shorter_bank_gets_the_first_steps(tmp_path: Path, bank: FrameBank) -> None:
    """As many as its motions have."""
    short = replace(bank.manifest.motion, horizon=3)
    asked = replace(query(), schema=short.schema())
    model = opened(stand_in.checkpoint(tmp_path / "act"))
    some, whole = answers(model, asked, query())
    assert only(some).tolist() == only(whole)[:3].tolist()


def test_a_seed_fixes_an_answer(tmp_path: Path) -> None:
    """Whatever was drawn before it."""
    model = opened(stand_in.checkpoint(tmp_path / "act"))
    assert model.facts["seedable"] == "true"
    first, other, again = (only(one).tolist() for one in answers(model, query(), query(seed=4), query()))
    assert first == again
    assert first != other


def test_what_libraries_print_reaches_no_message(tmp_path: Path) -> None:
    """Not even what writes past Python, and what reads its input takes no call."""
    replies = answers(opened(stand_in.checkpoint(tmp_path / "act", "prints")), query(), query())
    assert [only(one).shape for one in replies] == [(stand_in.CHUNK, 3)] * 2


def test_a_policy_that_raises_is_a_row_in_words(tmp_path: Path) -> None:
    """And its process stays for the next call."""
    model = opened(stand_in.checkpoint(tmp_path / "act", "raises"))
    for reply in answers(model, query(), query()):
        assert (reply.error, reply.error_detail) == ("exception", "ValueError: the arm is tired")


def test_a_process_that_dies_is_no_finding_about_the_policy(tmp_path: Path) -> None:
    """The call can be made again, by a new process, and what it printed last is in the error."""
    died, then = answers(opened(stand_in.checkpoint(tmp_path / "act", "dies once")), query(), query())
    assert died.error == "connection"
    assert "its process ended with exit code 7; it printed last:" in died.error_detail
    assert "out of luck" in died.error_detail
    assert only(then).shape == (stand_in.CHUNK, 3)


def test_a_process_that_is_killed_is_said_to_be(tmp_path: Path) -> None:
    """As the system kills what takes too much memory."""
    model = opened(stand_in.checkpoint(tmp_path / "act"))

    async def kill_between() -> list[Reply]:
        first = await model.answer(query())
        os.kill(model._process._process.pid, signal.SIGKILL)
        replies = [first, await model.answer(query()), await model.answer(query())]
        await model.close()
        return replies

    first, killed, then = asyncio.run(kill_between())
    assert (killed.error, only(first).tolist()) == ("connection", only(then).tolist())
    assert "was killed, as a system without memory does" in killed.error_detail


def test_a_call_past_its_time_limit_ends_the_process(tmp_path: Path) -> None:
    """With the thread that waited for it; loading is not counted."""
    model = opened(stand_in.checkpoint(tmp_path / "act", "hangs"), timeout_s=0.5)

    async def hang() -> tuple[Reply, int]:
        await asyncio.to_thread(model._load)
        pid = model._process._process.pid
        return await model.answer(query()), pid

    reply, pid = asyncio.run(hang())
    assert (reply.error, reply.error_detail) == ("timeout", "no answer within 0.5 s")
    assert not is_there(pid)
    end = time.monotonic() + SOON_S
    while any(thread.is_alive() for thread in model.left) and time.monotonic() < end:
        time.sleep(0.01)
    assert not any(thread.is_alive() for thread in model.left)


def test_a_closed_policy_leaves_nothing_and_opens_again(tmp_path: Path) -> None:
    """Not even what its libraries began."""
    model = opened(stand_in.checkpoint(tmp_path / "act", "begins another"))
    for _ in range(2):
        (reply,) = answers(model, query())
        assert only(reply).shape == (stand_in.CHUNK, 3)
        assert model._process is None
        child, last = int((tmp_path / "act" / "child").read_text()), time.monotonic() + 10
        while is_there(child) and time.monotonic() < last:
            time.sleep(0.01)
        assert not is_there(child)
    asyncio.run(model.close())


HELD = """
import asyncio, os, time
from eyechart.calls import Query
from eyechart.frames import Stimulus
from eyechart.models import open_model
model = open_model("lerobot:FOLDER", answering="policy")
model._load()
os.write(1, f"{model._process._process.pid}\\n".encode())
if "DOES" == "hangs":
    import test_lerobot
    asyncio.run(model.answer(test_lerobot.query()))
time.sleep(300)
"""


@pytest.mark.parametrize("how", ENDS)
@pytest.mark.parametrize("does", ["answers", "hangs"])
def test_a_process_ends_with_its_parent(
    does: str, how: signal.Signals, packages: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While it waits for a call, and during one."""
    folder, program = stand_in.checkpoint(tmp_path / "act", does), tmp_path / "program.py"
    program.write_text(HELD.replace("FOLDER", str(folder)).replace("DOES", does))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(packages), *filter(None, sys.path)]))
    assert not left_after_a_kill(program, lines=1, how=how)


def _edited(folder: Path, file: str, **fields: Any) -> None:  # noqa: ANN401 - fields of all kinds
    path = folder / file
    path.write_text(json.dumps({**json.loads(path.read_text()), **fields}))


def _step(folder: Path, **fields: object) -> None:
    """Give the first step of what comes before the policy other fields."""
    path = folder / "policy_preprocessor.json"
    whole = json.loads(path.read_text())
    whole["steps"][0] = fields
    path.write_text(json.dumps(whole))


def _without_step(folder: Path, file: str) -> None:
    path = folder / file
    whole = json.loads(path.read_text())
    path.write_text(json.dumps({"steps": whole["steps"][:-1]}))


VECTOR, DEPTH = {"type": "STATE", "shape": [3]}, {"type": "VISUAL", "shape": [1, 8, 8]}
FAULTS: dict[str, tuple[Any, str]] = {
    "no folder": (lambda f: f.rename(f.with_name("gone")), "there is no folder"),
    "no config": (lambda f: (f / "config.json").unlink(), "holds no config.json: give the folder that save_pretrained"),
    "no JSON": (lambda f: (f / "config.json").write_text("{"), "config.json cannot be read"),
    "a count in words": (lambda f: _edited(f, "config.json", n_obs_steps="two"), "n_obs_steps"),
    "no weights": (
        lambda f: (f / "model.safetensors").unlink(),
        "holds no model.safetensors: weights",
    ),
    "before LeRobot 0.4": (lambda f: (f / "policy_preprocessor.json").unlink(), "migrate_policy_normalization --pretr"),
    "no numbers": (
        lambda f: (f / "policy_preprocessor_numbers.safetensors").unlink(),
        "holds no policy_preprocessor_numbers.safetensors, which policy_preprocessor.json names",
    ),
    "an unknown type": (lambda f: _edited(f, "config.json", type="difusion"), "did you mean 'diffusion'"),
    "code of the Hub": (lambda f: _edited(f, "config.json", type="groot"), "lerobot: calls act, diffusion, vqbet"),
    "an adapter": (lambda f: _edited(f, "config.json", use_peft=True), r"is an adapter \(PEFT\): merge it"),
    "a history": (
        lambda f: _edited(f, "config.json", n_obs_steps=2),
        r"reads 2 instants .*not known how",
    ),
    "another input": (
        lambda f: _edited(f, "config.json", input_features={"observation.environment_state": VECTOR}),
        "reads observation.environment_state, and a bank has pictures in colour",
    ),
    "a depth picture": (
        lambda f: _edited(f, "config.json", input_features={"observation.depth": DEPTH}),
        "reads observation.depth, and a bank has pictures in colour",
    ),
    "no action": (lambda f: _edited(f, "config.json", output_features={"torque": VECTOR}), "has no 'action' among its"),
    "a table of actions": (
        lambda f: _edited(f, "config.json", output_features={"action": {"type": "ACTION", "shape": [2, 3]}}),
        r"'action' must be a vector, not \[2, 3\]",
    ),
    "no chunk": (lambda f: _edited(f, "config.json", chunk_size=None), "has no chunk_size, the number of steps"),
    "a step of its own": (
        lambda f: _step(f, **{"class": "os.path.join"}),
        "the step 'os.path.join' is none of",
    ),
    "remote code": (
        lambda f: _step(f, registry_name="action_tokenizer_processor"),  # by default it trusts the Hub
        "the step 'action_tokenizer_processor' is none of those that are loaded",
    ),
    "a file elsewhere": (
        lambda f: _step(f, registry_name="normalizer_processor", state_file="../other.safetensors"),
        "'../other.safetensors' is no safetensors file of the checkpoint's folder",
    ),
    "a pickle": (
        lambda f: _step(f, registry_name="normalizer_processor", state_file="numbers.pt"),
        "'numbers.pt' is no safetensors file of the checkpoint's folder",
    ),
    "inputs as they are": (
        lambda f: _without_step(f, "policy_preprocessor.json"),
        "has no step 'normalizer_processor', and config.json names a normalisation of STATE",
    ),
    "answers as they are": (
        lambda f: _without_step(f, "policy_postprocessor.json"),
        "has no step 'unnormalizer_processor', and config.json names a normalisation of ACTION",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_cannot_be_called_is_refused_before_a_process_loads_it(fault: str, tmp_path: Path) -> None:
    """With what is wrong, and the way."""
    folder = stand_in.checkpoint(tmp_path / "act")
    make, words = FAULTS[fault]
    make(folder)
    with pytest.raises(SpecError, match=words):
        opened(folder)


def test_an_option_of_served_models_is_refused_with_what_names_its_python() -> None:
    """Of which somebody may think who looks for its Python."""
    with pytest.raises(SpecError, match=r"options would not change 'lerobot:x'.*; --lerobot-python, or EYECHART_LER"):
        open_policy(RequestMode("lerobot:x", options={"python": "python3.12"}))


def test_an_id_of_the_hub_is_answered_with_what_downloads_it() -> None:
    """Nothing is fetched by itself."""
    with pytest.raises(SpecError, match="'hf download lerobot/act_aloha --local-dir FOLDER', then lerobot:FOLDER"):
        open_model("lerobot:lerobot/act_aloha", answering="policy")


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({lerobot.PYTHON: ""}, f"needs LeRobot, which this Python lacks.*{lerobot.PYTHON}=lerobot/bin/python"),
        (
            {lerobot.PYTHON: "/nowhere/python"},
            "the Python '/nowhere/python' cannot be started: No such file or directory; name the Python that has",
        ),
        ({lerobot.PYTHON: "/bin/false"}, "the Python /bin/false does not answer: its process ended with exit code 1"),
        ({lerobot.DEVICE: "tpu"}, "EYECHART_LEROBOT_DEVICE must be cpu, mps, cuda, xpu"),
    ],
)
def test_a_python_that_does_not_do_is_said_with_what_does(
    environment: dict[str, str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is planned."""
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SpecError, match=words):
        opened(stand_in.checkpoint(tmp_path / "act"))


@pytest.mark.parametrize(
    "command", [("doctor",), ("run", "policy", "--out", "run", "--policy"), ("look", "--out", "look")]
)
def test_an_option_names_the_python(
    command: tuple[str, ...], bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For one command, and before the variable."""
    monkeypatch.setenv(lerobot.PYTHON, "/bin/false")
    spec = f"lerobot:{stand_in.checkpoint(tmp_path / 'act')}"
    words = ["--frames", str(bank.root), "--lerobot-python", "/nowhere/python"]
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, [*command, spec, *words])
    assert isinstance(done.exception, SpecError)
    assert "'/nowhere/python' cannot be started" in str(done.exception)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("words.txt", None, "cannot be started: Permission denied"),
        ("words", "hello", "cannot be started: Exec format error"),
        ("says", "#!/bin/sh\nexec yes\n", "does not answer: its process answered with no message"),
        ("sleeps", "#!/bin/sh\nexec sleep 60\n", "does not answer: it has not within 0.5 s"),
    ],
)
def test_a_file_here_that_is_no_python_is_said(
    name: str, text: str | None, words: str, bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also one that never answers; the variable names one that would do."""
    monkeypatch.setenv(lerobot.PYTHON, sys.executable)
    if name == "sleeps":
        monkeypatch.setattr(lerobot, "_GREETING_S", 0.5)
    spec = f"lerobot:{stand_in.checkpoint(tmp_path / 'act')}"
    (tmp_path / name).write_text(text or "hello", encoding="utf-8")
    (tmp_path / name).chmod(0o600 if text is None else 0o700)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["doctor", spec, "--frames", str(bank.root), "--lerobot-python", f"./{name}"])
    assert isinstance(done.exception, SpecError)
    assert words in str(done.exception)
    assert "name the Python that has LeRobot with --lerobot-python" in str(done.exception)


@pytest.mark.parametrize(
    "command", [("doctor",), ("run", "policy", "--out", "run", "--policy"), ("look", "--out", "look")]
)
def test_the_option_is_refused_where_nothing_runs_by_it(
    command: tuple[str, ...], bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A callable runs in this Python, whatever is named."""
    monkeypatch.setenv(lerobot.PYTHON, sys.executable)
    monkeypatch.chdir(tmp_path)
    words = ["python:arms:reach", "--frames", str(bank.root), "--lerobot-python", "/nowhere/python"]
    done = CliRunner().invoke(app, [*command, *words])
    assert isinstance(done.exception, SpecError)
    assert str(done.exception) == (
        "--lerobot-python is for a lerobot: SPEC, and 'python:arms:reach' runs without it: leave the option out"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_python_without_lerobot_is_said_with_what_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In that Python, and not in this one."""
    monkeypatch.setenv("PYTHONPATH", str(stand_in.install(tmp_path / "packages", lerobot=False)))
    with pytest.raises(SpecError, match=f"has no LeRobot: '{sys.executable} -m pip install lerobot'"):
        opened(stand_in.checkpoint(tmp_path / "act"))


MISFITS: dict[str, tuple[dict[str, Any], str]] = {
    "a camera": (
        {"input_features": {"observation.images.side": {"type": "VISUAL", "shape": [3, 32, 32]}}},
        "reads the camera 'side', and the bank has top, wrist",
    ),
    "a size": (
        {"input_features": {"observation.images.top": {"type": "VISUAL", "shape": [3, 96, 128]}}},
        "reads pictures of 128×96 of the camera 'top', and the bank's have 32×32",
    ),
    "a state": (
        {"input_features": {"observation.state": {"type": "STATE", "shape": [7]}}},
        "reads 7 numbers of a state, and the bank's has 3",
    ),
    "an action": (
        {"output_features": {"action": {"type": "ACTION", "shape": [7]}}},
        "answers with steps of 7 numbers, and the bank's have 3",
    ),
    "a chunk": ({"chunk_size": 4}, "answers with 4 steps, and the bank's motions have 8: import it again with"),
}


@pytest.mark.parametrize("misfit", MISFITS)
def test_a_bank_that_does_not_fit_is_refused_by_name_before_any_call(
    misfit: str, bank: FrameBank, tmp_path: Path
) -> None:
    """By a run and by the doctor."""
    config, words = MISFITS[misfit]
    spec = f"lerobot:{stand_in.checkpoint(tmp_path / 'act', **config)}"
    with pytest.raises(SpecError, match=words):
        policy.plan(bank.root, [spec], tmp_path / "run")
    done = CliRunner().invoke(app, ["doctor", spec, "--frames", str(bank.root)])
    assert words in str(done.exception)


def run(*words: object) -> Any:  # noqa: ANN401 - of typer
    """Run a command."""
    return CliRunner().invoke(app, [*map(str, words)])


def test_one_command_runs_it_and_its_checkpoint_is_recorded(bank: FrameBank, tmp_path: Path) -> None:
    """Plan, run, verdict, gate, report and costs; what is changed in its folder is another version."""
    folder, out = stand_in.checkpoint(tmp_path / "checkpoints" / "020000" / "pretrained_model"), tmp_path / "run"
    spec = f"lerobot:{folder}"
    asked = ("run", "policy", "--policy", spec, "--frames", bank.root, "--out", out)
    assert run(*asked, "--dry-run").exit_code == 0
    assert run(*asked, "--max-calls", 9).exit_code == 3
    done = run(*asked)
    assert done.exit_code == 0, done.output
    facts = read_manifest(out).facts[spec]
    assert {name: facts[name] for name in ("type", "lerobot", "n_obs_steps", "chunk_size", "step", "device")} == {
        "type": "act",
        "lerobot": "0.6.1",
        "n_obs_steps": "1",
        "chunk_size": "8",
        "step": "20000",
        "device": "the checkpoint's",
    }
    assert facts["channels"] == "camera:top, camera:wrist, state"
    assert json.loads(facts["input_features"])["observation.state"] == VECTOR
    assert json.loads(facts["output_features"])["action"]["shape"] == [3]
    with Ledger(out / "ledger.sqlite") as ledger:
        assert {reply.error for _, reply in ledger.replies(spec)} == {None}
    for words in (("verdict", out), ("costs", out), ("report", out, "--out", tmp_path / "page.html")):
        assert run(*words).exit_code == 0, words
    assert run("gate", out, "--require", "camera:ignores_camera").exit_code in {0, 1, 2}
    (folder / "model.safetensors").write_text("prints")
    refused = run(*asked)
    assert isinstance(refused.exception, EyechartError)
    assert "(model.safetensors is changed)" in str(refused.exception)


def test_the_instruction_is_a_channel_of_types_that_read_it(tmp_path: Path) -> None:
    """And it reaches them as the task."""
    pictures = {"observation.images.top": {"type": "VISUAL", "shape": [3, 32, 32]}}
    model = opened(stand_in.checkpoint(tmp_path / "vla", type="smolvla", input_features=pictures))
    assert model.facts["channels"] == "camera:top, instruction"
    found = [only(one)[0, 1] for one in answers(model, query(words="go"), query(words="go left"))]
    assert found == [2 * len("go"), 2 * len("go left")]


def test_a_checkpoint_that_cannot_be_loaded_is_set_aside_and_goes_on_after_a_repair(
    bank: FrameBank, tmp_path: Path
) -> None:
    """At its first call, whose number is no finding about it."""
    folder, out = stand_in.checkpoint(tmp_path / "act"), tmp_path / "run"
    numbers = folder / "policy_preprocessor_numbers.safetensors"
    whole = numbers.read_text()
    numbers.write_text(json.dumps({"observation.state.mean": [0, 0, 0]}))
    asked = ("run", "policy", "--policy", f"lerobot:{folder}", "--frames", bank.root, "--out", out)
    done = run(*asked)
    assert done.exit_code == 1
    said = " ".join(done.output.split())
    assert "the normalisation of 'observation.state' (MEAN_STD) lacks its std" in said
    with Ledger(out / "ledger.sqlite") as ledger:
        assert len(ledger.finished()) == 0
    numbers.write_text(whole)
    assert "policy_preprocessor_numbers.safetensors is changed" in str(run(*asked).exception)
    (tmp_path / "other").mkdir()
    assert run(*asked[:-1], tmp_path / "other" / "run").exit_code == 0


def test_weights_that_do_not_fit_are_an_error_of_every_call(tmp_path: Path) -> None:
    """The second is not loaded again; a closed policy tries anew."""
    model = opened(stand_in.checkpoint(tmp_path / "act", "cannot be loaded"))
    first, second = answers(model, query(), query())
    assert first == second
    assert first.error == "missing_model"
    assert "cannot be loaded: RuntimeError: Missing key(s) in state_dict: model.head.weight" in first.error_detail
    (tmp_path / "act" / "model.safetensors").write_text("answers")
    (third,) = answers(model, query())
    assert only(third).shape == (stand_in.CHUNK, 3)


def test_one_look_takes_a_checkpoint(bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing else is typed, and no consent is needed: it runs on the user's own machine."""
    monkeypatch.chdir(tmp_path)
    done = run("look", f"lerobot:{stand_in.checkpoint(tmp_path / 'act')}", "--frames", bank.root)
    assert done.exit_code in {0, 1, 2}, done.output
    assert done.exception is None or isinstance(done.exception, SystemExit)
    assert done.stdout.startswith(("Yes", "No", "In part", "Inconclusive"))


@pytest.mark.parametrize(("given", "offline"), [({}, "1"), ({"HF_HUB_OFFLINE": "0"}, "0")])
def test_nothing_is_fetched_unless_the_user_says_so(
    given: dict[str, str], offline: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the variable of the Hub's own library."""
    monkeypatch.delenv("HF_HUB_OFFLINE", raising=False)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    model = opened(stand_in.checkpoint(tmp_path / "act"))
    model._load()
    held = Path(f"/proc/{model._process._process.pid}/environ").read_bytes().split(b"\0")
    asyncio.run(model.close())
    assert f"HF_HUB_OFFLINE={offline}".encode() in held


def frames_of(words: bytes, raw: bytes = b"") -> bytes:
    """Return a message."""
    return LENGTHS.pack(len(words), len(raw)) + words + raw


@pytest.mark.parametrize(
    ("stream", "error"),
    [
        (b"", EOFError),
        (b"\0\0", EOFError),
        (frames_of(b"{}", b"abc")[:-1], EOFError),
        (LENGTHS.pack(2, MOST_BYTES + 1) + b"{}", ValueError),
        (LENGTHS.pack(2**32 - 1, 0), ValueError),
        (frames_of(b"[1]"), ValueError),
        (frames_of(b"{"), ValueError),
        (b"Loading weights from local directory\n", ValueError),
    ],
)
def test_what_is_no_message_is_refused_by_both_ends(stream: bytes, error: type[Exception]) -> None:
    """Before it is read where it is too large."""
    with pytest.raises(error):
        read_message(io.BytesIO(stream))
    assert read_message(io.BytesIO(frames_of(b'{"a": 1}', b"xy"))) == ({"a": 1}, b"xy")


@pytest.fixture(autouse=True)
def _nothing_is_left() -> Iterator[None]:
    """Hold that no process of a policy outlives its test."""
    yield
    mine = os.getpid()
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(path.read_text().rpartition(")")[2].split()[1])
            words = (path.parent / "cmdline").read_bytes()
        except (OSError, IndexError, ValueError):
            continue
        assert parent != mine or b"lerobot/process.py" not in words
