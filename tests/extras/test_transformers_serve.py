"""The organisms behind a real ``transformers serve`` process get the labels that they get through ``hf:``."""

import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from eyechart.conditions import CONTROLS
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.models.huggingface.organisms import ORGANISMS, folder
from eyechart.modes import RequestMode
from eyechart.simulators import open_simulator
from eyechart.studies import battery as study
from eyechart.verdicts import judge

pytestmark = [pytest.mark.models, pytest.mark.filterwarnings("ignore")]

ASKED = {
    ("grounded", "depth_only"): (36, ("real", "real_repeat", "mirrored", "lead_near", "lead_far")),
    ("presence_only", "blind"): (64, ("real", "real_repeat", "blank", "shuffled")),
    ("self_inconsistent",): (96, ("real", "real_repeat", "mirrored", "recoloured")),
}
"""Frames and conditions that suffice for an organism's label: a server answers one call at a time."""

_START_S = 120


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Run ``transformers serve`` on loopback, offline, and end it by its process id.

    It stands in the folder of the organisms and is asked for them by name: a path in the name would be in every call's
    key, and so another stream of seeds wherever the project is installed.
    """
    base = tmp_path_factory.mktemp("serve")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [str(Path(sys.executable).with_name("transformers")), "serve", "--host", "127.0.0.1", "--port", str(port)]
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_HUB_CACHE": str(base), "OMP_NUM_THREADS": "1"}
    with (base / "log").open("w") as log:
        process = subprocess.Popen(
            [*command, "--device", "cpu", "--dtype", "float32"],
            stdout=log,
            stderr=log,
            env=environment,
            cwd=folder("blind").parent,
        )
        try:
            _await(f"http://127.0.0.1:{port}/health", process, base / "log")
            yield f"http://127.0.0.1:{port}/v1"
        finally:
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _await(address: str, process: "subprocess.Popen[bytes]", log: Path) -> None:
    deadline = time.monotonic() + _START_S
    while time.monotonic() < deadline and process.poll() is None:
        try:
            with urllib.request.urlopen(address, timeout=5):  # noqa: S310 - loopback
                return
        except (urllib.error.URLError, ConnectionError, TimeoutError):
            time.sleep(0.3)
    raise AssertionError(f"transformers serve did not answer:\n{log.read_text()[-2000:]}")


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Build 96 frames of eight episodes."""
    return open_simulator("highway").build(tmp_path_factory.mktemp("serve") / "bank", seeds=(21, 22))


@pytest.fixture(scope="module")
def served(server: str, bank: FrameBank, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Run a battery of each organism through the server, decoded as its checkpoint says.

    The sampled one sends its calls' seeds and is asked one call at a time: the server has one stream for all.
    """
    base = tmp_path_factory.mktemp("serve")
    runs = {}
    for names, (frames, conditions) in ASKED.items():
        drawn = ORGANISMS[names[0]].sampled
        modes = [
            RequestMode(f"openai:{name}", base_url=server, temperature=None, max_tokens=16, seed=drawn)
            for name in names
        ]
        out = base / names[0]
        planned = study.plan(
            bank.root, modes, out, conditions=conditions, extent=study.BatterySelection(frames, controls="auto")
        )
        study.run(planned, concurrency=1 if drawn else 4)
        runs |= dict.fromkeys(names, out)
    return runs


@pytest.mark.parametrize("name", ORGANISMS)
def test_a_served_organism_gets_the_label_that_it_was_trained_for(served: dict[str, Path], name: str) -> None:
    """Verdict, and the lateral label where the mirrored picture was shown.

    96 frames give some fifteen pairs of directions of a sampled organism: too few to bound a coin's rate below .65, so
    that "no_power" is as right of it as "does_not_swap". 36 frames hold too few turns with one clear side to show where
    they go, so that "swaps" is as right of one that turns to the clear side; and too few distances for depth.
    """
    verdict = judge(study.score(served[name]))[f"openai:{name}"]
    asked = next(conditions for names, (_, conditions) in ASKED.items() if name in names)
    lateral = ORGANISMS[name].lateral if "mirrored" in asked else "not_tested"
    few = {"depth_associated"}
    fewer = {"depth_lateral": few, "depth": few, "turns_clear": {"turns_clear", "swaps"}}
    label = ORGANISMS[name].calibrated
    assert verdict.calibrated.label in fewer.get(label, {label})
    assert verdict.lateral.label in fewer.get(lateral, {lateral, "no_power"} if ORGANISMS[name].sampled else {lateral})


@pytest.mark.parametrize("names", [names for names in ASKED if not ORGANISMS[names[0]].sampled])
def test_served_greedy_answers_are_equal_to_those_of_hf(
    served: dict[str, Path], bank: FrameBank, tmp_path: Path, names: tuple[str, ...]
) -> None:
    """Text, finish reason and token counts, call by call; every call of both is accounted for."""
    frames, conditions = ASKED[names]
    modes = [RequestMode(f"hf:organism:{name}", temperature=None, max_tokens=16) for name in names]
    study.run(
        study.plan(
            bank.root,
            modes,
            tmp_path / "run",
            conditions=conditions,
            extent=study.BatterySelection(frames, controls="auto"),
        ),
        concurrency=48,
    )
    for name in names:
        through_http = _replies(served[name], f"openai:{name}")
        here = _replies(tmp_path / "run", f"hf:organism:{name}")
        counter = Counter(condition for _, condition in here)
        assert all(counter[condition] == frames for condition in conditions)
        assert set(counter) <= {*conditions, *CONTROLS}  # the same controls are called for by the same answers
        assert through_http == here


def _replies(run: Path, spec: str) -> dict[tuple[str, str], tuple[object, ...]]:
    with Ledger(run / LEDGER) as ledger:
        return {
            (key.frame, key.condition): (
                reply.error,
                reply.text,
                reply.finish_reason,
                reply.prompt_tokens,
                reply.completion_tokens,
            )
            for key, reply in ledger.replies(spec)
        }
