"""Newcomers in a simulated world, and the known answers through the real run on a fresh bank: rows that are kept."""

import importlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
Measure = Callable[..., dict[str, Any]]


@pytest.fixture
def measure(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Measure:
    """Return a function that measures groups in a world, in this process, and returns what is said of the world.

    What a controller does in truth is found from a third of the draws: of all newcomers the same as from all of them.
    """
    monkeypatch.syspath_prepend(BENCHMARKS)
    truth, runs = (importlib.import_module(name) for name in ("adversary_truth", "adversarial_runs"))
    for name, draws in {"DRAWS": 16, "CURVE_DRAWS": 8, "WARM": 1000}.items():
        monkeypatch.setattr(truth, name, draws)

    def run(world: str, group: str) -> dict[str, Any]:
        result = tmp_path / "adversaries.json"
        words = ["--worlds", f"{world}=1", "--groups", group, "--out", str(tmp_path / "runs"), "--result", str(result)]
        monkeypatch.setattr("sys.argv", ["adversarial_runs.py", *words])
        runs.main()
        found: dict[str, Any] = json.loads(result.read_text(encoding="utf-8"))[world]
        return found

    return run


def test_hardly_a_newcomer_earns_what_it_does_not_deserve(measure: Measure, tmp_path: Path) -> None:
    """In a simulated world of 144 frames; a second run makes no row anew."""
    found = measure("simulated-144", "new")
    for claim, most in (("depth", 2), ("depth_lateral", 0), ("turns_clear", 2)):
        said = found["untrue"][claim]["by kind"]["new"]
        assert int(said.split()[0]) <= most, found["untrue"][claim]
    right, _, readers, *_ = found["readers told so"]["one error"]["all"].split()
    assert int(right) >= 0.8 * int(readers), found["readers told so"]
    rows = tmp_path / "runs" / "rows.jsonl"
    before = rows.read_bytes()
    measure("simulated-144", "new")
    assert rows.read_bytes() == before


def test_the_known_answers_are_right_through_the_real_run(measure: Measure, tmp_path: Path) -> None:
    """On a fresh bank of the highway; what a picture shows was read once, and no run is left."""
    found = measure("highway", "known")
    right, _, tried, *_ = found["known answers right"].split()
    assert int(tried) == 16
    assert int(right) >= 15, found["called"]
    assert not list((tmp_path / "runs").glob("run-*"))
