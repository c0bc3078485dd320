"""A model that answers with numbers is a policy: asked, paid, resumed and judged as one."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eyechart.cli.app import app
from eyechart.frames import FrameBank
from faults import FaultServer
from steering import PROMPT, Driver, rover_bank


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of sixty moments of a rover."""
    return rover_bank(tmp_path_factory.mktemp("steering"))


def eyechart(*words: object) -> str:
    """Run a command that succeeds, and return its output."""
    done = CliRunner().invoke(app, list(map(str, words)))
    assert done.exit_code == 0, done.output
    return done.output


def asked(bank: FrameBank, out: Path, server: FaultServer, *more: object) -> Sequence[object]:
    """Return the command that asks the model behind a server."""
    return (
        "run",
        "policy",
        "--policy",
        "openai:m",
        "--base-url",
        server.base_url,
        "--frames",
        bank.root,
        "--out",
        out,
        *more,
    )


@pytest.mark.parametrize(("looks", "label"), [(True, "camera_content"), (False, "ignores_camera")])
def test_who_looks_and_who_does_not_get_opposite_verdicts(
    bank: FrameBank, tmp_path: Path, looks: bool, label: str
) -> None:
    file, out = tmp_path / "drive.toml", tmp_path / "run"
    file.write_text(PROMPT)
    with FaultServer([Driver(looks=looks)]) as server:
        print(eyechart(*asked(bank, out, server, "--prompt", file)))
        print(server.requests)
    print(eyechart("verdict", out))
    print(eyechart("costs", out))
    found = json.loads(eyechart("verdict", out, "--json"))["policies"]["openai:m"]
    assert found["camera"] == label
