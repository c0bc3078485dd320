"""Worlds that yield frames, one module or package a simulator, one door for all."""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Protocol

from eyechart.errors import SpecError
from eyechart.frames import FrameBank


class Simulator(Protocol):
    """The door to a simulator. ``presets`` maps a preset's name to one sentence on its banks."""

    name: str
    presets: Mapping[str, str]

    def build(
        self,
        out: Path,
        *,
        preset: str = "balanced",
        seeds: Sequence[int] = (0, 1, 2),
        steps: int = 12,
        progress: Callable[[int, int], None] | None = None,
    ) -> FrameBank:
        """Write a bank of ``steps`` frames an episode into ``out``; ``progress`` gets (frames done, of how many)."""
        ...


SIMULATORS: dict[str, str] = {
    "highway": "eyechart.simulators.highway:Highway",
}
"""What a simulator's name means: ``module:class``, imported when it is opened."""


def open_simulator(name: str) -> Simulator:
    """Open the simulator of this name; raises SpecError that lists what is known."""
    if name not in SIMULATORS:
        raise SpecError(f"unknown simulator '{name}'; known: {', '.join(SIMULATORS)}")
    module, _, attribute = SIMULATORS[name].partition(":")
    simulator: Simulator = getattr(import_module(module), attribute)()
    return simulator
