"""Adversaries through the real run, on one fresh bank: none earns an authority that it does not deserve."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

BENCHMARK = Path(__file__).parents[1] / "benchmarks" / "adversarial_runs.py"


def test_no_adversary_earns_what_it_does_not_deserve(tmp_path: Path) -> None:
    """On 144 frames; readers of distance are told so, and the known answers are right."""
    result = tmp_path / "adversaries.json"
    command = [sys.executable, BENCHMARK, "--banks", "highway=1", "--out", tmp_path / "runs", "--result", result]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert result.is_file(), done.stderr
    found = json.loads(result.read_text(encoding="utf-8"))["highway"]
    assert found["adversaries"] >= 60
    assert {claim: counts["all"].split()[0] for claim, counts in found["untrue"].items()} == {
        "depth": "0",
        "depth_lateral": "0",
        "turns_clear": "0",
        "absence": "0",
    }
    right, _, readers = found["readers of distance"]["all"].partition(" of ")
    assert right == readers, found["readers of distance"]["lost"]
    assert int(readers) >= 7
    known, _, tried = found["known answers"].partition(" of ")
    assert int(tried) == 16
    assert int(known) >= 15, found["called"]
