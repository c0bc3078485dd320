"""score() reads the study's runs and makes no call: who reaches the goal, beside those who see nothing."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from eyechart.episodes import read_episodes
from eyechart.errors import LedgerError
from eyechart.stats.statistic import Statistic
from eyechart.studies.closed_loop import (
    LEVEL,
    Blind,
    Driver,
    Drives,
    Outcomes,
    Paired,
    blind_baselines,
    corrected,
    exact_rate,
    is_episodes,
    outcomes_of,
    paired,
    read_drives,
)
from eyechart.studies.hierarchy.planning import MPC_ONLY, PARTS

NOT_PERCEPTION = "completion does not show perception"

PUBLISHED: Mapping[tuple[str, str, str], tuple[str, str, float | None, float | None]] = {
    ("primary", MPC_ONLY, "real"): ("23/25", "0/25", 95.6, 0.0),
    ("primary", "route", "real"): ("23/25", "0/25", 96.6, 0.072),
    ("primary", "random", "real"): ("14/25", "0/25", 82.6, 0.214),
    ("primary", "constant:LEFT", "real"): ("24/25", "0/25", None, None),
    ("constrained", MPC_ONLY, "real"): ("30/32", "2/32", None, None),
    ("unaware", MPC_ONLY, "real"): ("1/32", "31/32", None, None),
}
"""Goals, crashes, metres and the share of STOP that the paper prints, by part, source and condition."""


@dataclass(frozen=True)
class Source:
    """One source of intent in one arm: its rates with exact intervals, and what it emitted.

    ``stop_share`` is of the intents that were executed, ``intents`` counts those that were emitted, ``fail_safe`` the
    steps without a decision. ``solver_failures`` are plans that braked instead.
    """

    part: str
    driver: Driver
    goals: Statistic
    crashes: Statistic
    distance_m: float | None
    stop_share: float | None
    intents: Mapping[str, int]
    fail_safe: int
    solver_failures: int
    errors: int

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            "part": self.part,
            "simulator": self.driver.simulator,
            "source": self.driver.policy,
            "condition": self.driver.condition,
            "goals": self.goals.as_dict(),
            "crashes": self.crashes.as_dict(),
            "distance_m": self.distance_m,
            "stop_share": self.stop_share,
            "intents": dict(self.intents),
            "fail_safe_steps": self.fail_safe,
            "solver_failures": self.solver_failures,
            "episodes_in_error": self.errors,
        }


@dataclass(frozen=True)
class HierarchyScore:
    """What the study's runs show, each part computed when it is asked for, from the episodes alone."""

    drives: Mapping[str, tuple[Drives, ...]]
    resamples: int = 5000

    @cached_property
    def outcomes(self) -> Outcomes:
        """Return what counts as success: the goal, without a crash."""
        return outcomes_of([one for drives in self.drives.values() for one in drives])

    @cached_property
    def sources(self) -> tuple[Source, ...]:
        """Return a row for each source, condition and part."""
        return tuple(_source(part, one, self.outcomes) for part, drives in self.drives.items() for one in drives)

    @cached_property
    def against_mpc_only(self) -> tuple[Paired, ...]:
        """Return every source of the primary ablation less MPC-only in the same worlds, Holm over all of them."""
        drives = self._of("primary", "primary-models")
        reference = next((one for one in drives if one.driver.policy == MPC_ONLY), None)
        if reference is None:
            return ()
        others = [one for one in drives if one is not reference]
        return tuple(corrected([paired(one, reference, self.outcomes, resamples=self.resamples) for one in others]))

    @cached_property
    def oracle_mirrored(self) -> Paired | None:
        """Return the positive control: the oracle's lateral intent less the same one mirrored, None where undriven."""
        drives = {one.driver.policy: one for one in self._of("lateral")}
        if {"route", "mirrored:route"} - drives.keys():
            return None
        found = paired(drives["route"], drives["mirrored:route"], self.outcomes, resamples=self.resamples)
        return corrected([found])[0]

    @cached_property
    def blind(self) -> tuple[tuple[str, Blind], ...]:
        """Return each model as its own blind baseline, by part; Holm within a part."""
        found = []
        for part in ("primary-models", "unaware-models", "lateral-models"):
            found += [(part, one) for one in blind_baselines(self._of(part), self.outcomes, resamples=self.resamples)]
        return tuple(found)

    @property
    def words(self) -> tuple[str, ...]:
        """Return what completion shows of each model, in words."""
        return tuple(f"{PARTS[part].simulator}: {one.sentence}{unless_shown(one)}" for part, one in self.blind)

    def as_dict(self) -> dict[str, object]:
        """Return every number as plain JSON values."""
        return {
            "study": "hierarchy",
            "sources": [one.as_dict() for one in self.sources],
            "against_mpc_only": [one.as_dict() for one in self.against_mpc_only],
            "oracle_against_its_mirror": None if self.oracle_mirrored is None else self.oracle_mirrored.as_dict(),
            "blind": [{"part": part, **one.as_dict()} for part, one in self.blind],
            "words": list(self.words),
        }

    def _of(self, *parts: str) -> list[Drives]:
        return [one for part in parts for one in self.drives.get(part, ())]


def score(out: Path, *, resamples: int = 5000) -> HierarchyScore:
    """Read the runs of the study in ``out``; raises LedgerError where there is none."""
    begun = [name for name in PARTS if is_episodes(out / name)]
    drives = {name: read_drives([out / name]) for name in begun if any(read_episodes(out / name))}
    if not drives:
        raise LedgerError(f"{out} holds no run of the hierarchy; 'eyechart run hierarchy --out {out}' makes one")
    return HierarchyScore(drives, resamples)


def unless_shown(one: Blind) -> str:
    """Return the caveat, but where more worlds are completed with real pictures, significantly so after Holm."""
    goals, p = one.paired.differences["success_rate"].value, one.paired.holm.get("success_rate")
    shown = goals is not None and goals > 0 and p is not None and p < LEVEL
    return "" if shown else f" So here {NOT_PERCEPTION}."


def _source(part: str, drives: Drives, outcomes: Outcomes) -> Source:
    episodes, steps = drives.episodes, drives.steps
    intents = Counter(step.decision.action for step in steps if step.decision.action is not None)
    stops = sum(step.executed_action == "STOP" for step in steps)
    return Source(
        part=part,
        driver=drives.driver,
        goals=exact_rate(sum(map(outcomes.success, episodes)), len(episodes)),
        crashes=exact_rate(sum(one.crashed for one in episodes), len(episodes)),
        distance_m=_mean([told for one in episodes if (told := one.distance_m) is not None]),
        stop_share=stops / len(steps) if steps else None,
        intents={action: intents[action] for action in drives.space.actions},
        fail_safe=sum(step.decision.action is None for step in steps),
        solver_failures=sum(_count(step.facts.get("solver_failures")) for step in steps),
        errors=len(drives.errors),
    )


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None


def _count(value: object) -> int:
    return value if isinstance(value, int) else 0
