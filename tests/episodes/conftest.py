"""The tiny worlds, in the registry while a test runs."""

import pytest

import tiny_worlds
from eyechart import simulators


@pytest.fixture(autouse=True)
def _tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """Register the tiny worlds; workers learn of them from the run."""
    for name, place in tiny_worlds.SIMULATORS.items():
        monkeypatch.setitem(simulators.SIMULATORS, name, place)
