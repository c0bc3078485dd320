"""A bank of one camera: what is said of all cameras is said of it by its name, without a further call."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from arm_logs import arm_bank
from eyechart.channels import channels_of
from eyechart.cli.app import app
from eyechart.studies import policy

pytestmark = pytest.mark.slow


def test_the_camera_has_its_label_and_its_share(tmp_path: Path) -> None:
    """In the JSON that scripts rely on; a policy that declares the camera by its name is asked."""
    bank = arm_bank(tmp_path / "arm")
    assert channels_of(bank) == ("cameras", "state", "instruction")
    spec = "python:arm_logs:declared"
    planned = policy.plan(bank.root, [spec], tmp_path / "run")
    assert not any("camera:" in name for name in planned.plan.conditions)
    policy.run(planned)
    found = json.loads(CliRunner().invoke(app, ["verdict", str(tmp_path / "run"), "--json"]).stdout)["policies"][spec]
    assert list(found)[:7] == ["camera", "cameras", "state", "instruction", "guards", "because", "channels"]
    assert list(found)[7:9] == ["answer", "holes"]
    assert found["cameras"] == {"front": found["camera"]}
    assert set(found["channels"]) == {"cameras", "camera:front", "state", "instruction"}
    assert found["channels"]["camera:front"] == found["channels"]["cameras"]
    assert found["axes"]["camera:front"] == found["axes"]["camera"]
    assert found["channels"]["cameras"]["T"] > 0.1
