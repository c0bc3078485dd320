"""Tiny simulators, made for the tests: a corridor of ten cells, and corridors with one fault each.

``SIMULATORS`` is to be put into the registry; workers learn of it from the run. A world's picture shows where the
vehicle is, and one pixel in it where the way is blocked.
"""

import hashlib
import os
import random
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import NoReturn

import numpy as np

from eyechart.frames import RGB, Scalar
from eyechart.simulators import Declaration, Drive, StepResult
from eyechart.spaces.discrete import DRIVING

LENGTH = 10
STEPS = 12


@dataclass
class Corridor:
    """A world of ten cells: STRAIGHT goes on, LEFT and RIGHT pass a block, every other action stands still."""

    seed: int
    at: int = 0
    steps: int = 0
    log: list[str] = field(default_factory=list)
    over: bool = False

    @property
    def blocked(self) -> bool:
        """Return whether the way ahead is blocked."""
        return (self.at * 7 + self.seed) % 4 == 3

    def picture(self) -> RGB:
        """Draw the place as a column of colour, and a block as a white one."""
        drawn = np.zeros((8, LENGTH + 2, 3), dtype=np.uint8)
        drawn[:, self.at] = (200, self.seed % 200, 50)
        if self.blocked:
            drawn[2:6, self.at + 1] = 255
        return drawn

    def truth(self) -> Mapping[str, Scalar]:
        """Tell the scene."""
        demand = "LEFT" if self.blocked else "STRAIGHT"
        return {"lead_gap_m": 1.0 if self.blocked else None, "left_clear": True, "right_clear": False, "demand": demand}

    def step(self, action: str) -> StepResult:
        """Move, and crash where STRAIGHT meets a block."""
        if self.over:
            raise ValueError("this drive is over")
        crashed = self.blocked and action == "STRAIGHT"
        self.at += action in {"STRAIGHT", "LEFT", "RIGHT"}
        self.steps += 1
        self.log.append(action)
        ended = "crash" if crashed else "goal" if self.at >= LENGTH else "time" if self.steps >= STEPS else None
        self.over = ended is not None
        return StepResult(
            reward=float(not crashed), speed_mps=1.0, distance_m=float(self.at), crashed=crashed, ended=ended
        )

    def state(self, decimals: int | None = None) -> bytes:  # noqa: ARG002 - whole already
        """Return the whole history."""
        return f"{self.seed} {self.at} {self.log}".encode()

    def close(self) -> None:
        """Hold nothing."""


class Black(Corridor):
    """A renderer without a display."""

    def picture(self) -> RGB:
        """Draw nothing."""
        return np.zeros((8, 8, 3), dtype=np.uint8)


class Endless(Corridor):
    """A world that never ends."""

    def step(self, action: str) -> StepResult:
        """Stand still for ever."""
        del action
        return StepResult(reward=0.0, speed_mps=0.0, distance_m=0.0, crashed=False, ended=None)


class Raising(Corridor):
    """A world that fails at its third step."""

    def step(self, action: str) -> StepResult:
        """Raise."""
        if self.steps == 2:
            raise RuntimeError("the physics engine diverged")
        return super().step(action)


class Nonsense(Corridor):
    """A world whose reward is no number."""

    def step(self, action: str) -> StepResult:
        """Give NaN."""
        super().step(action)
        return StepResult(reward=float("nan"), speed_mps=0.0, distance_m=0.0, crashed=False, ended=None)


class Fatal(Corridor):
    """A world that takes its process down."""

    def step(self, action: str) -> StepResult:
        """End the process as a segmentation fault does."""
        del action
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError("not reached")


class FatalOnce(Corridor):
    """A world that takes its process down the first time that it is driven."""

    def step(self, action: str) -> StepResult:
        """End the process, and leave a mark that it has."""
        mark = Path(os.environ["TINY_MARK"])
        if not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().step(action)


class Hanging(Corridor):
    """A world whose step never returns."""

    def step(self, action: str) -> StepResult:
        """Wait."""
        del action
        time.sleep(600)
        raise AssertionError("not reached")


class Restless(Corridor):
    """A world that does not repeat itself."""

    def picture(self) -> RGB:
        """Draw something new."""
        return np.frombuffer(os.urandom(8 * 8 * 3), dtype=np.uint8).reshape(8, 8, 3)


FAULTS: Mapping[str, Callable[[int], Drive]] = {
    "whole": Corridor,
    "black": Black,
    "endless": Endless,
    "raising": Raising,
    "nonsense": Nonsense,
    "fatal": Fatal,
    "fatal_once": FatalOnce,
    "hanging": Hanging,
    "restless": Restless,
}


class Tiny:
    """The corridors behind the door of a simulator: one scenario a fault."""

    declared = Declaration(
        name="tiny",
        picture="a corridor",
        mirror_axis="vertical",
        action_space=DRIVING,
        scenarios={name: f"{fault.__doc__}" for name, fault in FAULTS.items()},
    )

    def drive(self, scenario: str, seed: int) -> Drive:
        """Open a corridor."""
        return FAULTS[scenario](seed)

    def versions(self) -> dict[str, str]:
        """Return the one version there is."""
        return {"tiny": os.environ.get("TINY_VERSION", "1")}


class Unopened(Tiny):
    """Corridors of which the first takes its process down when it is opened."""

    declared = replace(Tiny.declared, name="unopened")

    def drive(self, scenario: str, seed: int) -> Drive:
        """Open a corridor, or end the process."""
        if seed == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().drive(scenario, seed)


SIMULATORS = {"tiny": "tiny_worlds:Tiny"}


def look(prompt: str, image: bytes | None) -> str:
    """Drive by the picture: LEFT at a block, else STRAIGHT (``python:tiny_worlds:look``)."""
    from eyechart.frames import decode  # noqa: PLC0415

    assert image is not None
    assert "LEFT" in prompt
    return "LEFT" if (decode(image, "x") == 255).all(axis=2).any() else "STRAIGHT"


def slow_look(prompt: str, image: bytes | None) -> str:
    """Drive by the picture, with a while of thought, and write down every call in the file that is named."""
    with Path(os.environ["TINY_CALLS"]).open("a", encoding="utf-8") as file:
        file.write("call\n")
    time.sleep(0.01)
    return look(prompt, image)


_ONE_AT_A_TIME = threading.Lock()


@cache
def _dealt(image: bytes) -> str:
    """Draw a thought, and pass on either side; the same for every picture that was seen before: a cache by content."""
    side = ("LEFT", "RIGHT")[hashlib.sha256(image).digest()[0] % 2]
    return f"Thought number {random.SystemRandom().randrange(10**9)}. I choose {side}"


def brief(prompt: str, image: bytes | None) -> str:
    """Answer with the action alone that the cache deals."""
    return dealt(prompt, image).rpartition(" ")[2]


def brief_too(prompt: str, image: bytes | None) -> str:
    """Answer the same, as another model."""
    return brief(prompt, image)


def dealt(prompt: str, image: bytes | None) -> str:
    """Answer from a cache that knows no model."""
    del prompt
    with _ONE_AT_A_TIME:  # the cache of the standard library computes twice what two ask for at once
        return _dealt(image or b"")


def dealt_too(prompt: str, image: bytes | None) -> str:
    """Answer from the same cache, as another model."""
    return dealt(prompt, image)


def onward(prompt: str, image: bytes | None) -> str:
    """Answer LEFT, whatever is shown."""
    del prompt, image
    return "LEFT"


def silent(prompt: str, image: bytes | None) -> str:
    """Answer nothing."""
    del prompt, image
    return ""


def failing(prompt: str, image: bytes | None) -> NoReturn:
    """Raise."""
    del prompt, image
    raise RuntimeError("out of memory")


def main(out: Path) -> None:
    """Begin or resume the run that the tests of resuming kill: ``python -m tiny_worlds OUT``."""
    from eyechart import episodes, simulators  # noqa: PLC0415

    simulators.SIMULATORS.update(SIMULATORS)
    episodes.run(planned(out), bounds=episodes.Bounds(processes=2, concurrency=3))


def planned(out: Path) -> "episodes.Episodes":  # type: ignore[name-defined]  # noqa: F821
    """Return the run that is killed: a model that looks, and two policies, in four worlds."""
    from eyechart import episodes  # noqa: PLC0415

    drivers = ["python:tiny_worlds:slow_look", "random", "oracle"]
    return episodes.plan("tiny", drivers, out, scenarios=["whole"], seeds=range(4), conditions=["real", "shuffled"])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
