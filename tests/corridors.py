"""A tiny simulator whose drives repeat to the last bit, and a run in it with replies that mean harm."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from drives import add_replies, always, drive, make_run
from eyechart.calls import Reply
from eyechart.episodes import Episode, EpisodeKey, Step
from eyechart.frames import RGB, Scalar
from eyechart.simulators import Declaration, StepResult
from eyechart.spaces.discrete import DRIVING
from report_runs import HOSTILE

HOSTILE_NAME = "<img src=x onerror=alert(1)>"


class Corridor:
    """A tiny world: a picture that counts its steps, and a state that remembers the actions."""

    def __init__(self, seed: int) -> None:
        self.done: list[str] = [str(seed)]

    def picture(self) -> RGB:
        """Return a grey that tells the step."""
        return np.full((30, 60, 3), 10 + 5 * len(self.done), dtype=np.uint8)

    def truth(self) -> Mapping[str, Scalar]:
        """Return a gap."""
        return {"lead_gap_m": 50.0 - len(self.done)}

    def step(self, action: str) -> StepResult:
        """Remember; ValueError from the seventh step on."""
        if len(self.done) > 6:
            raise ValueError("this drive is over")
        self.done.append(action)
        return StepResult(1.0, 20.0, 20.0 * len(self.done), crashed=False, ended="time" if len(self.done) > 6 else None)

    def state(self, decimals: int | None = None) -> bytes:  # noqa: ARG002 - whole already
        """Return all that was done."""
        return " ".join(self.done).encode()

    def close(self) -> None:
        """Nothing is held."""


class Corridors:
    """The simulator of such worlds."""

    declared = Declaration(
        name="corridor", picture="a grey", mirror_axis="none", action_space=DRIVING, scenarios={"light": "A corridor."}
    )

    def drive(self, scenario: str, seed: int) -> Corridor:
        """Open one."""
        del scenario
        return Corridor(seed)

    def versions(self) -> dict[str, str]:
        """Return its version."""
        return {"corridor": "2"}


def open_corridors() -> Corridors:
    """Open the simulator."""
    return Corridors()


def driven(policy: str, action: str, *, condition: str = "real", seed: int = 0) -> Episode:
    """Drive a corridor."""
    world, key, steps = Corridor(seed), EpisodeKey(policy, "corridor", "light", seed, condition), []
    made = drive(policy, always(action), simulator="corridor", condition=condition, seeds=[seed], steps=6)[0]
    for step in made.steps:
        truth = dict(world.truth())
        moved = world.step(action)
        told = {"reward": moved.reward, "speed_mps": moved.speed_mps, "distance_m": moved.distance_m}
        steps.append(Step(step.step, step.frame, step.decision, action, truth, crashed=False, **told))
    return Episode(key, tuple(steps), "time", hashlib.sha256(world.state()).hexdigest())


def corridor_run(out: Path) -> Path:
    """Make a run of a model whose replies mean harm, and of a constant, with real and blank pictures."""
    episodes = [
        driven(policy, action, condition=condition, seed=seed)
        for policy, action in ((HOSTILE_NAME, "LEFT"), ("constant:SLOW", "SLOW"))
        for condition in ("real", "blank")
        for seed in range(3)
    ]
    made = make_run(out, episodes, models=[HOSTILE_NAME], simulator="corridor", world={"corridor": "1"})
    asked = [episode for episode in episodes if episode.key.policy == HOSTILE_NAME]
    add_replies(made, asked, lambda _step, n: Reply(HOSTILE[n % len(HOSTILE)], "stop"), lambda step: step.frame)
    return made
