"""A setting is a kind of bank: how many episodes of what length, and what the bank lacks."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

Episode = tuple[str, int]
"""An episode's scenario, and how many frames it has."""


@dataclass(frozen=True, slots=True)
class Road:
    """What the pictures of a scenario show: lanes, a ramp, and the median gap in metres."""

    lanes: int
    ramp: bool
    median_gap_m: float


ROADS: Mapping[str, Road] = {
    "light": Road(4, False, 26.0),
    "dense": Road(3, False, 19.0),
    "merge": Road(3, True, 15.0),
    "blocked": Road(2, False, 12.0),
}
"""The scenarios: their gaps differ, so that to recognise the scenario looks like reading the distance."""

FEWEST_FRAMES, MOST_FRAMES = 8, 40
"""How long the episodes of the setting ``unequal`` are."""


@dataclass(frozen=True, slots=True)
class Setting:
    """A kind of bank. ``episodes`` and ``frames`` count per scenario and per episode; 0 episodes: one to three in all.

    ``exchanges`` says whether the bank has episodes enough to test the gap without counterfactuals.
    """

    name: str
    says: str
    scenarios: int = 4
    episodes: int = 3
    frames: int = 12
    gaps: bool = True
    ordered: bool = False
    exchanges: bool = True

    def draw(self, rng: np.random.Generator) -> list[Episode]:
        """Return the episodes of one bank."""
        names = tuple(ROADS)[: self.scenarios]
        if self.episodes:
            return [(name, self.frames) for name in names for _ in range(self.episodes)]
        count = int(rng.integers(1, 4))
        lengths = rng.choice(np.arange(FEWEST_FRAMES, MOST_FRAMES + 1), size=count, replace=False)
        return [(names[int(rng.integers(len(names)))], int(length)) for length in lengths]


SETTINGS: Mapping[str, Setting] = {
    one.name: one
    for one in (
        Setting("default", "4 scenarios, 12 episodes of 12 frames"),
        Setting("unequal", "1 to 3 episodes of unequal length (8 to 40 frames)", episodes=0, exchanges=False),
        Setting("short_48", "48 episodes of 3 frames", episodes=12, frames=3),
        Setting("no_gaps", "as default, and the bank records no gap", gaps=False, exchanges=False),
        Setting("one_scenario", "12 episodes of 12 frames in one scenario", scenarios=1, episodes=12),
        Setting("ordered", "as default, and the gap closes all through every episode", ordered=True),
        Setting("small_10", "2 episodes of 5 frames", scenarios=2, episodes=1, frames=5, exchanges=False),
        Setting("small_24", "4 episodes of 6 frames", scenarios=2, episodes=2, frames=6, exchanges=False),
        Setting("frames_48", "4 episodes of 12 frames", episodes=1, exchanges=False),
        Setting("frames_96", "8 episodes of 12 frames", episodes=2, exchanges=False),
        Setting("frames_288", "24 episodes of 12 frames", episodes=6),
    )
}

POWER = ("small_10", "small_24", "frames_48", "frames_96", "default", "frames_288")
"""The settings that differ in size alone, from the smallest."""
