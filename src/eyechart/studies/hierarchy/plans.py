"""Which sources of intent drive in which arm of the hierarchy: up to seven runs in sequence."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from eyechart.episodes import Bounds, EpisodesRun, Setup, drives_ended, errors_ended
from eyechart.episodes import plan as plan_episodes
from eyechart.episodes.coordinator import USUAL
from eyechart.errors import SpecError, counted
from eyechart.limits import RunOutcome
from eyechart.models.prices import Prices
from eyechart.modes import RequestMode
from eyechart.planned_run import Bar, PlannedRun, RunAllowance, RunEnding, moving
from eyechart.studies.closed_loop import Driver
from eyechart.studies.probes import beside

MPC_ONLY = "constant:STRAIGHT"
"""No intent: the controller stays on its track, as it does for the intent STRAIGHT."""

ORACLE, ORACLE_MIRRORED = "route", "mirrored:route"
FAMILIES = ("offset", "single", "slalom", "gate", "clutter")
SIDED = ("offset", "slalom", "gate", "clutter")
"""Families in which a side matters; in ``single`` both sides are free."""

CONDITIONS = ("real", "mirrored", "blank", "shuffled")
"""A model's conditions: its rates with real pictures are compared with its own blind ones."""

SILENCE = "fail-safe"
"""A planner's silence is a result here: STOP is executed (docs/decisions/drives.md)."""


@dataclass(frozen=True, slots=True)
class Part:
    """One run of the study: an arm's simulator, its drivers and its worlds.

    ``models`` says whether the studied models drive in it too, ``conditions`` what pictures they
    get.
    """

    simulator: str
    policies: tuple[str, ...]
    scenarios: tuple[str, ...]
    seeds: int
    conditions: tuple[str, ...] = ("real",)
    models: bool = False


SCRIPTED: Mapping[str, tuple[str, str]] = {
    "MPC-only": ("primary", MPC_ONLY),
    "oracle intent": ("primary", ORACLE),
    "random intent": ("primary", "random"),
    "constant STRAIGHT": ("primary", "constant:STRAIGHT"),
    "constant SLOW": ("primary", "constant:SLOW"),
    "constant STOP": ("primary", "constant:STOP"),
    "constant LEFT": ("primary", "constant:LEFT"),
    "constant RIGHT": ("primary", "constant:RIGHT"),
    "mpc-oracle": ("constrained", MPC_ONLY),
    "mpc-blind": ("unaware", MPC_ONLY),
    "oracle, lateral intent": ("lateral", ORACLE),
    "oracle, lateral intent, mirrored": ("lateral", ORACLE_MIRRORED),
}
"""The scripted sources by name: the part in which each drives, and its policy there.

MPC-only and the constant STRAIGHT are the same drives under two names; the paper prints the first.
"""


def _policies(part: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(policy for place, policy in SCRIPTED.values() if place == part))


PARTS: dict[str, Part] = {
    "primary": Part("rover-mpc", _policies("primary"), FAMILIES, 5),
    "primary-models": Part("rover-mpc", (), FAMILIES, 5, CONDITIONS, models=True),
    "constrained": Part("rover-mpc", _policies("constrained"), SIDED, 8),
    "unaware": Part("rover-mpc-unaware", _policies("unaware"), SIDED, 8),
    "unaware-models": Part("rover-mpc-unaware", (), SIDED, 8, CONDITIONS, models=True),
    "lateral": Part("rover-mpc-lateral", _policies("lateral"), SIDED, 8),
    "lateral-models": Part("rover-mpc-lateral", (), SIDED, 8, CONDITIONS, models=True),
}
"""The paper's two ablations by the name of their folders.

The primary one gives the controller the obstacles. The second does not, except for its reference
``constrained``.
"""

_INTENT = {"unaware-models": ", full intent", "lateral-models": ", lateral intent"}
_SHOWN = {"real": "", "mirrored": ", mirrored", "blank": ", blank", "shuffled": ", shuffled"}


def name_of(part: str, driver: Driver) -> str:
    """Return a source's name: SPEC or policy, the part of its intent that counts, its pictures."""
    for name, place in SCRIPTED.items():
        if place == (part, driver.policy):
            return name
    return f"{driver.policy}{_INTENT.get(part, '')}{_SHOWN[driver.condition]}"


@dataclass(frozen=True, slots=True)
class HierarchySelection:
    """The chosen part of the study; None means all.

    ``sources`` are scripted ones, as pairs of a part and a policy. ``arms`` are parts without
    ``-models``, ``worlds`` families of obstacles, ``seeds`` those of each family, instead of the
    paper's 5 and 8.
    """

    sources: frozenset[tuple[str, str]] | None = None
    arms: tuple[str, ...] | None = None
    worlds: tuple[str, ...] | None = None
    seeds: tuple[int, ...] | None = None

    def of(self, name: str, part: Part) -> Part | None:
        """Return the runs of a part that this choice keeps, None if none."""
        if self.arms is not None and name.removesuffix(MODELS) not in self.arms:
            return None
        policies = [policy for policy in part.policies if self.sources is None or (name, policy) in self.sources]
        worlds = [scenario for scenario in part.scenarios if self.worlds is None or scenario in self.worlds]
        left = replace(part, policies=tuple(policies), scenarios=tuple(worlds))
        return left if worlds and (policies or part.models) else None


ALL = HierarchySelection()
MODELS = "-models"
NOBODY = "none"
"""The word for no scripted source."""


def read_sources(text: str) -> frozenset[tuple[str, str]]:
    """Read source names of the tables, or their policies, with commas; ``none`` is no scripted one.

    A policy stands for its source in every arm; case does not matter. Raises SpecError that lists
    the known names.
    """
    known = {name: {place} for name, place in SCRIPTED.items()}
    for place in SCRIPTED.values():
        known.setdefault(place[1], set()).add(place)
    known[NOBODY] = set()
    found, rest = set[tuple[str, str]](), text.strip()
    while rest:
        fits = [name for name in known if re.match(rf"{re.escape(name)}\s*(,|$)", rest, re.IGNORECASE)]
        if not fits:
            raise SpecError(f"--sources takes one or more of {'; '.join(known)}, with commas; got '{rest}'")
        longest = max(fits, key=len)
        found |= known[longest]
        rest = rest[len(longest) :].lstrip(" ,")
    return frozenset(found)


def read_choice(
    sources: str | None = None, arms: str | None = None, worlds: str | None = None, seeds: Sequence[int] | None = None
) -> HierarchySelection:
    """Read a choice from names with commas; raises SpecError for an unknown one."""
    parts = tuple(name for name in PARTS if not name.endswith(MODELS))
    families = tuple(dict.fromkeys(family for part in PARTS.values() for family in part.scenarios))
    return HierarchySelection(
        None if sources is None else read_sources(sources),
        _named("--arms", arms, parts),
        _named("--worlds", worlds, families),
        None if seeds is None else tuple(seeds),
    )


def _named(option: str, text: str | None, known: Sequence[str]) -> tuple[str, ...] | None:
    if text is None:
        return None
    names = tuple(dict.fromkeys(one.strip() for one in text.split(",") if one.strip()))
    if not names or set(names) - set(known):
        raise SpecError(f"{option} takes one or more of {', '.join(known)}, with commas; got '{text}'")
    return names


def plan(
    out: Path,
    models: Sequence[RequestMode] = (),
    *,
    choice: HierarchySelection = ALL,
    seed: int = 0,
    prompt: str | None = None,
    silence: str = SILENCE,
    again: bool = False,
) -> dict[str, EpisodesRun]:
    """Plan the study's runs in folders of ``out``, or the rest of them; make no calls.

    Without ``models`` only scripted sources drive; a ``choice`` leaves out sources or worlds.
    ``silence`` decides about a call that fails temporarily, one of `eyechart.episodes.SILENCES`.
    Raises what `eyechart.episodes.plan` raises, and SpecError if no source is left.
    """
    planned: dict[str, EpisodesRun] = {}
    chosen = {name: left for name, part in PARTS.items() if (left := choice.of(name, part)) is not None}
    for name, part in chosen.items():
        drivers: list[str | RequestMode] = [*part.policies, *(models if part.models else ())]
        if drivers:
            made = plan_episodes(
                Setup(part.simulator, seed, silence=silence),
                drivers,
                out / name,
                scenarios=part.scenarios,
                seeds=range(part.seeds) if choice.seeds is None else choice.seeds,
                conditions=part.conditions,
                prompt=prompt,
            )
            planned[name] = replace(made, again=again)
    if models and not any(chosen[name].models for name in planned):
        arms = ", ".join(name.removesuffix(MODELS) for name, part in PARTS.items() if part.models)
        raise SpecError(f"no model drives in this choice: models drive in the arms {arms}")
    if not planned:
        raise SpecError("no source is left: this choice has none in any of its arms and worlds")
    _require_arms(choice, planned)
    return planned


def _require_arms(choice: HierarchySelection, planned: Mapping[str, EpisodesRun]) -> None:
    """Raise SpecError if a named arm has no driver."""
    driven = {name.removesuffix(MODELS) for name in planned}
    for arm in choice.arms or ():
        if arm not in driven:
            mine = ", ".join(f"{name!r} ({policy})" for name, (part, policy) in SCRIPTED.items() if part == arm)
            raise SpecError(f"no source drives in the arm '{arm}' in this choice; its scripted sources are {mine}")


@dataclass(frozen=True)
class Arms(PlannedRun):
    """The study's runs, by the names of their folders in ``out``."""

    unit: ClassVar[str] = "episodes of this part"
    kept: ClassVar[str] = EpisodesRun.kept
    parts: Mapping[str, EpisodesRun]
    out: Path

    @property
    def keeper(self) -> EpisodesRun:
        """Return the first run with models."""
        return next(part for part in self.parts.values() if part.drivers.models)

    def lines(self, how: RunAllowance) -> Iterator[str]:
        """Yield each run's size, and the expected cost of its models' calls."""
        for name, part in self.parts.items():
            size = f"{counted(len(part.keys), 'episode')} in {part.manifest.simulator}"
            yield f"{name}: {size}, {len(part.left())} to drive"
            yield from (f"  {line}" for line in part.forecast(how))

    def make(self, how: RunAllowance, bar: Bar) -> RunOutcome:
        """Drive the rest of each run within common limits; a model set aside stays so."""
        aside: dict[str, str] = {}
        stopped, uncounted = None, 0
        for name, part in self.parts.items():
            here = replace(part, keys=tuple(key for key in part.keys if key.policy not in aside))
            if here.left():
                outcome = here.make(beside([part.out.parent / one for one in PARTS], part, how), _of_part(bar, name))
                aside |= outcome.set_aside
                stopped, uncounted = stopped or outcome.stopped, max(uncounted, outcome.uncounted)
        return RunOutcome(aside, stopped, uncounted)

    def ends(self, outcome: RunOutcome, failed: Mapping[str, str]) -> Iterator[RunEnding]:
        """Yield what is left with the reason, and which episodes ended in an error."""
        yield drives_ended(self.parts, outcome, failed)
        yield errors_ended(self.parts, bound="")


def _of_part(bar: Bar, name: str) -> Bar:
    return lambda _, unit: bar(name, unit)


def run(
    planned: Mapping[str, EpisodesRun],
    prices: Prices,
    *,
    bounds: Bounds = USUAL,
    calls: int | None = None,
    cost_usd: float | None = None,
) -> RunOutcome:
    """Drive the rest of each part; a model set aside in one drives in no later part.

    ``calls`` and ``cost_usd`` bound the whole study, with the ledgers of its other parts. Raises
    what `eyechart.episodes.run` raises.
    """
    how = RunAllowance(prices, max_calls=calls, max_cost=cost_usd, sequential=bounds.sequential)
    how = replace(how, processes=bounds.processes, concurrency=bounds.concurrency)
    return Arms(planned, Path()).make(how, moving(None))
