"""Highway's short scenario, and two of its worlds with a fault each, made for the tests of the online run."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from eyechart.frames import RGB, Scalar
from eyechart.simulators import Drive, StepResult
from eyechart.simulators.highway import Highway


class Faulty:
    """A drive whose pictures turn black at one frame, or whose truth is off."""

    def __init__(self, inside: Drive, *, dark: bool, off_m: float) -> None:
        self._inside, self._dark, self._off_m, self._frame = inside, dark, off_m, 0

    def picture(self) -> RGB:
        """Draw, or do not."""
        pixels = self._inside.picture()
        return np.zeros_like(pixels) if self._dark and self._frame == 3 else pixels

    def truth(self) -> Mapping[str, Scalar]:
        """Tell the scene, with the gap off."""
        told = dict(self._inside.truth())
        gap = told["lead_gap_m"]
        return {**told, "lead_gap_m": gap + self._off_m if isinstance(gap, float) else gap}

    def step(self, action: str) -> StepResult:
        """Drive on."""
        self._frame += 1
        return self._inside.step(action)

    def state(self, decimals: int | None = None) -> bytes:
        """Return the world's state."""
        return self._inside.state(decimals)

    def close(self) -> None:
        """Let go."""
        self._inside.close()


class Short(Highway):
    """Highway-env's merge alone, which ends after a dozen steps; its world 0 turns dark."""

    declared = replace(Highway.declared, name="short", scenarios={"merge": Highway.declared.scenarios["merge"]})

    def drive(self, scenario: str, seed: int) -> Drive:
        """Open a world at its beginning."""
        return Faulty(super().drive(scenario, seed), dark=seed == 0, off_m=0.0)


class Off(Short):
    """The same, but every gap is told 0.2 m too long."""

    declared = replace(Short.declared, name="off")

    def drive(self, scenario: str, seed: int) -> Drive:
        """Open a world at its beginning."""
        return Faulty(Highway.drive(self, scenario, seed), dark=False, off_m=0.2)


SIMULATORS = {"short": "short_worlds:Short", "off": "short_worlds:Off"}
