"""The organisms behind a real ``transformers serve`` process get the labels that they get through ``hf:``."""

import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.models.huggingface.organisms import ORGANISMS, folder
from eyechart.modes import RequestMode
from eyechart.simulators import open_simulator
from eyechart.studies import battery as study
from eyechart.verdicts import judge

pytestmark = [pytest.mark.models, pytest.mark.filterwarnings("ignore")]

CONDITIONS = ("real", "real_repeat", "blank", "shuffled", "mirrored", "lead_near", "lead_far")
_START_S = 120


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Run ``transformers serve`` on loopback, offline, and end it by its process id."""
    base = tmp_path_factory.mktemp("serve")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [str(Path(sys.executable).with_name("transformers")), "serve", "--host", "127.0.0.1", "--port", str(port)]
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_HUB_CACHE": str(base), "OMP_NUM_THREADS": "1"}
    with (base / "log").open("w") as log:
        process = subprocess.Popen(
            [*command, "--device", "cpu", "--dtype", "float32"], stdout=log, stderr=log, env=environment
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
    """Build 48 frames of four episodes."""
    return open_simulator("highway").build(tmp_path_factory.mktemp("serve") / "bank", seeds=(21,))


@pytest.fixture(scope="module")
def served(server: str, bank: FrameBank, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run the battery of all five through the server, decoded as each checkpoint says."""
    out = tmp_path_factory.mktemp("serve") / "run"
    modes = [
        RequestMode(f"openai:{folder(name)}", base_url=server, temperature=None, max_tokens=16) for name in ORGANISMS
    ]
    study.run(study.plan(bank.root, modes, out, conditions=CONDITIONS), concurrency=4)
    return out


def test_every_served_organism_gets_the_label_that_it_was_trained_for(served: Path) -> None:
    """Verdict and lateral label of all five, on 48 frames and seven conditions."""
    verdicts = judge(study.score(served))
    found = {Path(spec).name: (one.calibrated.label, one.lateral.label) for spec, one in verdicts.items()}
    assert found == {name: (one.calibrated, one.lateral) for name, one in ORGANISMS.items()}


def test_served_greedy_answers_are_equal_to_those_of_hf(served: Path, bank: FrameBank, tmp_path: Path) -> None:
    """Text, finish reason and token counts, call by call; every call of both is accounted for."""
    greedy = [name for name, one in ORGANISMS.items() if not one.sampled]
    modes = [RequestMode(f"hf:organism:{name}", temperature=None, max_tokens=16) for name in greedy]
    study.run(study.plan(bank.root, modes, tmp_path / "run", conditions=CONDITIONS), concurrency=48)
    with Ledger(served / LEDGER) as theirs, Ledger(tmp_path / "run" / LEDGER) as ours:
        for name in greedy:
            through_http, here = (
                {
                    (key.frame, key.condition): (
                        reply.error, reply.text, reply.finish_reason, reply.prompt_tokens, reply.completion_tokens
                    )
                    for key, reply in ledger.replies(spec)
                }
                for ledger, spec in ((theirs, f"openai:{folder(name)}"), (ours, f"hf:organism:{name}"))
            )  # fmt: skip
            assert len(here) == len(CONDITIONS) * len(bank)
            assert through_http == here
