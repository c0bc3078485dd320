"""What a bank can say of a policy is simulated before a call is made."""

import json
from functools import partial
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eyechart.calibrate.policies import power
from eyechart.cli.app import app
from eyechart.simulators import open_bank_simulator


@pytest.mark.slow
def test_more_episodes_settle_more_and_too_few_settle_nothing() -> None:
    """By the share that the camera carries; what draws its answers is settled less often."""
    few, some, many = (power(count, 6 * count, 1, {}, draws=12).said for count in (4, 12, 36))
    assert {pair for shares in few.values() for pair in shares.values()} == {(0.0, 0.0)}
    assert some["same"]["0"][0] > 0.9
    assert some["same"]["0.4"][1] > 0.9
    assert many["same"]["0.05"][0] > some["same"]["0.05"][0]


@pytest.mark.slow
def test_the_command_says_it_and_what_cannot_be_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In calls, channels and shares, and as JSON."""
    monkeypatch.setattr("eyechart.calibrate.policies.power", partial(power, draws=6))
    bank = open_bank_simulator("tabletop").build(tmp_path / "bank", steps=4, seeds=(0, 1))
    found = CliRunner().invoke(app, ["plan", str(bank.root)])
    assert found.exit_code == 0, found.output
    assert "channels: cameras, camera:top, camera:wrist, state, instruction" in found.stdout
    assert "how often 8 episodes (32 frames) settle it" in found.stdout
    assert "--shapley asks 64 calls more" in found.stdout
    words = " ".join(found.stdout.split())
    assert "said of these episodes, not of the data set: where none of 8 responds, up to 43.8% may" in words
    said = json.loads(CliRunner().invoke(app, ["plan", str(bank.root), "--json"]).stdout)
    assert (said["episodes"], said["frames"]) == (8, 32)
    assert said["calls"] % 32 == 0
    assert said["said"]["same"]["0"][0] > 0.5
