"""The ladder's episodes: every constant action, random and the scripted controller, in every scenario and seed."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from eyechart.episodes import ACTION_MAP, Episodes, Setup, plan
from eyechart.errors import SpecError
from eyechart.modes import RequestMode
from eyechart.policies import open_policy
from eyechart.simulators import open_simulator
from eyechart.spaces.discrete import Discrete

SEEDS = 8


def ladder_policies(space: Discrete) -> tuple[str, ...]:
    """Return the policies that a ladder ranks: the constants of an action space, random, and the oracle.

    An action space without the actions that the oracle drives with has none.
    """
    policies = (*(f"constant:{action}" for action in space.actions), "random")
    try:
        open_policy("oracle", space, lambda _: {})
    except SpecError:
        return policies
    return (*policies, "oracle")


def plan_ladder(
    out: Path,
    *,
    simulator: str = "highway",
    seeds: int = SEEDS,
    further: Sequence[str | RequestMode] = (),
    actions: Path | None = None,
    prompt: str | None = None,
    seed: int = 0,
    again: bool = False,
) -> Episodes:
    """Plan the ladder, or the rest of what ``out`` holds of it: 7 policies × 4 scenarios × 8 seeds in the highway.

    ``further`` are policies and models that climb it beside these; the rest is as in `eyechart.episodes.plan`, which
    also raises.
    """
    actions = actions or (out / ACTION_MAP if (out / ACTION_MAP).is_file() else None)
    space = open_simulator(simulator, actions=actions).declared.action_space
    worlds, drivers = Setup(simulator, seed, actions=actions), (*ladder_policies(space), *further)
    return replace(plan(worlds, drivers, out, seeds=range(seeds), prompt=prompt), again=again)


def require_reference(planned: Episodes, against: str | None) -> None:
    """Raise SpecError where the policy that the others are to be held against is none of those that drive."""
    if against is not None and against not in planned.manifest.policies:
        known = ", ".join(planned.manifest.policies)
        raise SpecError(f"--against {against}: no such policy drives here; there are {known}")
