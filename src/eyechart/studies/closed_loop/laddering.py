"""The ladder's episodes: every constant action, random and the scripted controller, in every scenario and seed."""

from collections.abc import Sequence
from pathlib import Path

from eyechart.actions import ActionSpace
from eyechart.episodes import Episodes, plan
from eyechart.simulators import open_simulator

SEEDS = 8


def ladder_policies(space: ActionSpace) -> tuple[str, ...]:
    """Return the policies that a ladder ranks: the constants of an action space, random, and the oracle."""
    return (*(f"constant:{action}" for action in space.actions), "random", "oracle")


def plan_ladder(
    out: Path, *, simulator: str = "highway", seeds: int = SEEDS, further: Sequence[str] = (), seed: int = 0
) -> Episodes:
    """Plan the ladder, or the rest of what ``out`` holds of it: 7 policies × 4 scenarios × 8 seeds in the highway.

    ``further`` are policies that climb it beside these. Raises what `eyechart.episodes.plan` raises.
    """
    space = open_simulator(simulator).action_space
    return plan(simulator, (*ladder_policies(space), *further), out, seeds=range(seeds), seed=seed)
