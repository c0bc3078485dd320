"""LeRobot itself, in a Python of its own: ACT, VQ-BeT and Diffusion with random weights, from its data set to a gate.

Run by `EYECHART_LEROBOT_PYTHON=/path/to/python make test-lerobot`; that Python has lerobot[dataset,diffusion].
"""

import asyncio
import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from eyechart.calls import Query
from eyechart.cli.app import app
from eyechart.frames import Stimulus, encode
from eyechart.ledger import Ledger
from eyechart.manifest import read_manifest
from eyechart.models import lerobot, open_model
from eyechart.spaces.motion import Motion

pytestmark = [pytest.mark.slow, pytest.mark.lerobot]
HERE = Path(__file__).parents[1]
KINDS = ("act", "vqbet", "diffusion")


def by_lerobot(*words: object) -> str:
    """Run a program with the Python that has LeRobot, and return what it printed."""
    environment = {**os.environ, "HF_HUB_OFFLINE": "1"}
    environment.pop("PYTHONPATH", None)
    done = subprocess.run(
        [os.environ[lerobot.PYTHON], *map(str, words)], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a data set and checkpoints, as LeRobot writes them."""
    folder = tmp_path_factory.mktemp("lerobot")
    by_lerobot(HERE / "lerobot_checkpoints.py", folder)
    return folder


def run(*words: object) -> Any:  # noqa: ANN401 - of typer
    """Run a command."""
    return CliRunner().invoke(app, [*map(str, words)])


@pytest.fixture(scope="module")
def bank(made: Path) -> Path:
    """Return the data set as a bank."""
    given = ("--format", "lerobot", "--horizon", 8, "--every", 8, "--history", 1)
    done = run("frames", "import", made / "data", *given, "--out", made / "b")
    assert done.exit_code == 0, done.output
    return made / "b"


@pytest.mark.parametrize("kind", KINDS)
def test_an_answer_is_that_of_lerobot_itself(kind: str, made: Path, tmp_path: Path) -> None:
    """To the last bits, for the same seed, also after another call."""
    rng = np.random.default_rng(1)
    top, state = rng.integers(0, 256, (2, 64, 64, 3)).astype(np.uint8), rng.normal(size=(2, 5))
    np.savez(tmp_path / "seen.npz", top=top, state=state)
    direct = json.loads(by_lerobot(HERE / "lerobot_direct.py", made / kind, tmp_path / "seen.npz", 7).splitlines()[-1])
    model = open_model(f"lerobot:{made / kind}", answering="policy")
    before, now = (
        Stimulus({"top": encode(one)}, {}, {"state": tuple(own)}) for one, own in zip(top, state, strict=True)
    )
    seen, other = replace(now, past=(before,)), replace(before, past=(now,))

    async def ask() -> list[np.ndarray]:
        queries = (Query("", "reach the block", one, seed) for one, seed in ((seen, 7), (other, 8), (seen, 7)))
        replies = [await model.answer(query) for query in queries]
        await model.close()
        return [Motion.read(reply.text).array for reply in replies]

    first, another, again = asyncio.run(ask())
    np.testing.assert_allclose(first, direct, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - another).max() > 1e-6


def test_each_goes_from_a_plan_to_a_gate(made: Path, bank: Path, tmp_path: Path) -> None:
    """By the commands that a person types; what it is stands in the run."""
    specs, out = [f"lerobot:{made / kind}" for kind in KINDS], tmp_path / "run"
    asked = ["run", "policy", "--frames", bank, "--out", out, *(word for spec in specs for word in ("--policy", spec))]
    assert run(*asked, "--dry-run").exit_code == 0
    assert run(*asked, "--max-calls", 20).exit_code == 3
    done = run(*asked)
    assert done.exit_code == 0, done.output
    with Ledger(out / "ledger.sqlite") as ledger:
        assert {reply.error for spec in specs for _, reply in ledger.replies(spec)} == {None}
    facts = read_manifest(out).facts
    assert [facts[spec]["type"] for spec in specs] == [*KINDS]
    assert {facts[spec]["lerobot"].partition(".")[0] for spec in specs} == {"0"}
    assert run("verdict", out).exit_code == 0
    assert run("gate", out, "--require", "looks").exit_code in {1, 2}


@pytest.mark.parametrize(("kind", "history"), [("act", 0), ("diffusion", 1)])
def test_one_look_imports_the_data_set_with_the_policys_own_horizon_and_window(
    kind: str, history: int, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing else is typed."""
    monkeypatch.chdir(tmp_path)
    done = run("look", f"lerobot:{made / kind}", "--dataset", made / "data", "--out", "look")
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    manifest = json.loads((tmp_path / "look" / "bank" / "manifest.json").read_text())
    assert (manifest["motion"]["horizon"], manifest.get("history", 0)) == (8, history)


def test_weights_of_another_size_are_said_in_lerobots_words(made: Path, tmp_path: Path) -> None:
    """And the policy answers nothing."""
    for file in (made / "act").iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    config = json.loads((tmp_path / "config.json").read_text())
    (tmp_path / "config.json").write_text(json.dumps({**config, "dim_feedforward": 64}))
    model = open_model(f"lerobot:{tmp_path}", answering="policy")
    seen = Stimulus({"top": encode(np.zeros((64, 64, 3), np.uint8))}, {}, {"state": (0.0,) * 5})

    async def ask() -> Any:  # noqa: ANN401 - a reply
        reply = await model.answer(Query("", "", seen, 0))
        await model.close()
        return reply

    reply = asyncio.run(ask())
    assert reply.error == "missing_model"
    assert "size mismatch" in reply.error_detail
