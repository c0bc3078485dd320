"""A benchmark's result has the numbers of the two runs before beside its own, each with its load."""

import json
from pathlib import Path

import pytest

import pairs


def test_a_result_has_the_numbers_of_the_runs_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two at most, the latest last; their lists are left out."""
    monkeypatch.setattr(pairs, "RESULTS", tmp_path)
    for ratio in (1.0, 2.0, 3.0, 4.0):
        pairs.keep("bench", {"ratio": ratio, "ratios": [ratio], "parts": {"median": ratio, "all": [ratio]}})
    found = json.loads((tmp_path / "bench.json").read_text(encoding="utf-8"))
    assert (found["ratio"], found["ratios"], len(found["load"])) == (4.0, [4.0], 3)
    assert [one["ratio"] for one in found["before"]] == [2.0, 3.0]
    assert [one["parts"] for one in found["before"]] == [{"median": 2.0}, {"median": 3.0}]
    assert all(len(one["load"]) == 3 and "ratios" not in one and "before" not in one for one in found["before"])
