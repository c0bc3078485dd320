"""A battery through every fault of the road at random, killed in between, comes to what it comes to undisturbed."""

import importlib.util
import sys
from pathlib import Path

import pytest

import banks

FILE = Path(__file__).parents[1] / "benchmarks" / "broken_roads_run.py"


@pytest.mark.slow
def test_a_run_through_broken_roads_loses_nothing_and_comes_to_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The short form of `make long-faults`."""
    spec = importlib.util.spec_from_file_location("broken_roads_run", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "broken_roads_run", module)
    monkeypatch.setattr(sys, "path", [*sys.path])
    spec.loader.exec_module(module)
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light"], episodes=1).root
    found = module.measured(bank, tmp_path, share=0.3, kills=2, longest_s=0.5)
    assert not module.is_wrong(found), found
    assert found["kills"] == 2
    assert found["faults"] > 5
