"""Newcomers in a simulated world, and the known answers through the real run on a fresh bank: rows that are kept."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

BENCHMARK = Path(__file__).parents[1] / "benchmarks" / "adversarial_runs.py"


def test_hardly_a_newcomer_earns_what_it_does_not_deserve(tmp_path: Path) -> None:
    """In a simulated world of 144 frames; a second run makes no row anew."""
    result, rows = tmp_path / "adversaries.json", tmp_path / "runs" / "rows.jsonl"
    command = [sys.executable, BENCHMARK, "--worlds", "simulated-144=1", "--groups", "new"]
    command += ["--out", tmp_path / "runs", "--result", result]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert result.is_file(), done.stderr
    found = json.loads(result.read_text(encoding="utf-8"))["simulated-144"]
    for claim, most in (("depth", 2), ("depth_lateral", 0), ("turns_clear", 2)):
        said = found["untrue"][claim]["by kind"]["new"]
        assert int(said.split()[0]) <= most, found["untrue"][claim]
    right, _, readers, *_ = found["readers told so"]["one error"]["all"].split()
    assert int(right) >= 0.8 * int(readers), found["readers told so"]
    before = rows.read_bytes()
    subprocess.run(command, check=False, capture_output=True)
    assert rows.read_bytes() == before


def test_the_known_answers_are_right_through_the_real_run(tmp_path: Path) -> None:
    """On a fresh bank of the highway; what a picture shows was read once, and no run is left."""
    result, folder = tmp_path / "adversaries.json", tmp_path / "runs"
    command = [sys.executable, BENCHMARK, "--worlds", "highway=1", "--groups", "known"]
    done = subprocess.run([*command, "--out", folder, "--result", result], check=False, capture_output=True, text=True)
    assert result.is_file(), done.stderr
    found = json.loads(result.read_text(encoding="utf-8"))["highway"]
    right, _, tried, *_ = found["known answers right"].split()
    assert int(tried) == 16
    assert int(right) >= 15, found["called"]
    assert not list(folder.glob("run-*"))
