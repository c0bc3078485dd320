"""Which sources of intent drive which arm of the hierarchy, and where: up to seven runs of episodes in one folder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from eyechart.episodes import Episodes
from eyechart.episodes import plan as plan_episodes
from eyechart.limits import Spent
from eyechart.modes import RequestMode

MPC_ONLY = "constant:STRAIGHT"
"""No intent: the controller cruises on the track that it is on, as it does for the intent STRAIGHT."""

ORACLE, ORACLE_MIRRORED = "route", "mirrored:route"
FAMILIES = ("offset", "single", "slalom", "gate", "clutter")
SIDED = ("offset", "slalom", "gate", "clutter")
"""The families in which a side matters: in ``single`` both sides are free."""

_CONSTANTS = tuple(f"constant:{action}" for action in ("STRAIGHT", "SLOW", "STOP", "LEFT", "RIGHT"))


@dataclass(frozen=True, slots=True)
class Part:
    """One run of the study: an arm's simulator, who drives in it, and where.

    ``models`` says whether the models that are studied drive in it too, ``conditions`` what they are shown.
    """

    simulator: str
    policies: tuple[str, ...]
    scenarios: tuple[str, ...]
    seeds: int
    conditions: tuple[str, ...] = ("real",)
    models: bool = False


PARTS: dict[str, Part] = {
    "primary": Part("rover-mpc", (*_CONSTANTS, ORACLE, "random"), FAMILIES, 5),
    "primary-models": Part("rover-mpc", (), FAMILIES, 5, ("real", "mirrored", "blank", "shuffled"), models=True),
    "constrained": Part("rover-mpc", (MPC_ONLY,), SIDED, 8),
    "unaware": Part("rover-mpc-unaware", (MPC_ONLY,), SIDED, 8),
    "unaware-models": Part("rover-mpc-unaware", (), SIDED, 8, ("real", "mirrored"), models=True),
    "lateral": Part("rover-mpc-lateral", (ORACLE, ORACLE_MIRRORED), SIDED, 8),
    "lateral-models": Part("rover-mpc-lateral", (), SIDED, 8, ("real", "mirrored", "blank", "shuffled"), models=True),
}
"""The paper's two ablations by the name of their folders. The primary one tells the controller where the obstacles
are; the second does not, but for ``constrained``, its reference."""


def plan(
    out: Path,
    models: Sequence[RequestMode] = (),
    *,
    seed: int = 0,
    prompt: str | None = None,
    again: bool = False,
    probes: Mapping[str, Spent] | None = None,
) -> dict[str, Episodes]:
    """Plan the study's runs in folders of ``out``, or the rest of what it holds of them; nothing is asked.

    Without ``models`` only the scripted sources drive. ``probes`` says what was spent on probing models; the first run
    with models keeps it. Raises what `eyechart.episodes.plan` raises.
    """
    planned: dict[str, Episodes] = {}
    for name, part in PARTS.items():
        drivers: list[str | RequestMode] = [*part.policies, *(models if part.models else ())]
        if drivers:
            planned[name] = plan_episodes(
                part.simulator,
                drivers,
                out / name,
                scenarios=part.scenarios,
                seeds=range(part.seeds),
                conditions=part.conditions,
                prompt=prompt,
                seed=seed,
                again=again,
                probes=probes if part.models else None,
            )
            probes = None if part.models else probes
    return planned
