"""Score the study's runs without calls: the goals of each source, compared with blind ones."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from eyechart.episodes import Episode, UnfinishedEpisodes, read_episodes
from eyechart.errors import LedgerError
from eyechart.integrity import ServedGuard
from eyechart.records import plain, to_json_fields
from eyechart.stats.episodes import share_over_episodes
from eyechart.stats.statistic import ModelStatistics, Statistic
from eyechart.studies import is_episodes
from eyechart.studies.closed_loop import (
    CANNOT_SAY,
    DIFFERS,
    LEVEL,
    BlindBaseline,
    Driver,
    Drives,
    PairedDifference,
    SuccessCriteria,
    against,
    blind_baselines,
    corrected,
    exact_rate,
    mean_of_drives,
    measured,
    outcomes_of,
    paired,
    read_drives,
    served_of,
    unfinished_of,
)
from eyechart.studies.hierarchy.plans import MPC_ONLY, ORACLE, ORACLE_MIRRORED, PARTS, SCRIPTED, name_of
from eyechart.verdicts.labels import PLANNERS, Label
from eyechart.verdicts.rules import Axis, Rule, compared, fact, p_below

NOT_PERCEPTION = PLANNERS["completion_alone"].says
NEEDED = ("shuffled", "blank")
"""The pictures under which a model must complete fewer worlds; "shuffled" is the strictest."""

_FEWER = {name: (compared(name, "value", ">", 0.0, untested=False), p_below(name, LEVEL)) for name in NEEDED}
"""The clauses: fewer worlds completed without the own picture, significant after Holm."""

COMPLETES = Axis(
    "planners",
    (
        Rule("not_shown", broken=tuple(compared(f"driven.{name}", "value", ">", 0.0) for name in NEEDED)),
        Rule("by_pictures", NEEDED[0], needs=tuple(clause for both in _FEWER.values() for clause in both)),
        Rule("completion_alone", NEEDED[0]),
    ),
)
"""The labels of a planner, by its drives without its own pictures."""

_WITH = {"real": "with real pictures", "mirrored": "mirrored", "blank": "blank", "shuffled": "shuffled"}

PrintedRow = tuple[str, str, float | None, float | None]

PUBLISHED: Mapping[str, PrintedRow] = {
    "MPC-only": ("23/25", "0/25", 95.6, 0.0),
    "oracle intent": ("23/25", "0/25", 96.6, 0.072),
    "random intent": ("14/25", "0/25", 82.6, 0.214),
    "constant LEFT": ("24/25", "0/25", None, None),
    "mpc-oracle": ("30/32", "2/32", None, None),
    "mpc-blind": ("1/32", "31/32", None, None),
}
"""The paper's values of a source: goals, crashes, metres and the share of STOP."""

UNPUBLISHED: PrintedRow = ("", "", None, None)

PUBLISHED_MODELS: Mapping[str, Mapping[str, PrintedRow]] = {
    "primary": {
        "Gemma4 VLM": ("8/25", "0/25", 46.3, 0.816),
        "VLM, mirrored": ("8/25", "0/25", 47.1, 0.812),
        "VLM, blank": ("0/25", "0/25", 0.2, 1.0),
    },
    "second": {
        "lateral VLM intent": ("0/32", "32/32", None, None),
        "lateral VLM intent, mirrored": ("5/32", "27/32", None, None),
        "full VLM intent": ("0/32", "11/32", None, None),
    },
}
"""The paper's values for its model, by ablation: from Table t:mpc-intent and its text."""


@dataclass(frozen=True)
class IntentSource:
    """One source of intent in one arm: its rates with exact intervals, and its intents.

    ``intents`` counts the emitted intents, and ``stop_share`` is of them; a STOP of the fail-safe
    is in neither. ``no_decision`` counts the steps of the fail-safe by reason: the failure of the
    call, or why its reply has no decision. ``solver_failures`` counts plans that braked instead.
    The intervals of ``distance_m`` and ``stop_share`` resample episodes; they are None if all have
    the same value.
    """

    part: str
    name: str
    driver: Driver
    goals: Statistic
    crashes: Statistic
    distance_m: Statistic
    stop_share: Statistic
    intents: Mapping[str, int]
    no_decision: Mapping[str, int]
    solver_failures: int
    episodes_in_error: int

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        names = "part name goals crashes distance_m stop_share intents intents_emitted fail_safe_steps no_decision"
        own = to_json_fields(self, f"{names} solver_failures episodes_in_error", source=self.driver.policy)
        return own | to_json_fields(self.driver, "simulator condition")

    @property
    def intents_emitted(self) -> int:
        """Return how many intents were emitted."""
        return sum(self.intents.values())

    @property
    def fail_safe_steps(self) -> int:
        """Return the number of steps with the fail-safe, for want of a decision."""
        return sum(self.no_decision.values())


@dataclass(frozen=True)
class Completion:
    """How often a model reaches the goal in one arm, with real pictures and with other ones.

    ``goals`` are by condition. It ``is_shown`` if both paired differences, real less blank and real
    less other worlds' pictures, are above zero after Holm.
    """

    part: str
    policy: str
    goals: Mapping[str, Statistic]
    label: Label

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return to_json_fields(self, "part goals", source=self.policy, shows_perception=self.is_shown)

    @property
    def is_shown(self) -> bool:
        """Return whether the model completes worlds by its pictures."""
        return self.label is PLANNERS["by_pictures"]

    @property
    def sentence(self) -> str:
        """Return the result in a sentence, with the limits of what completion shows."""
        counts = ", ".join(f"{_WITH[name]} {count_of(goal)}" for name, goal in self.goals.items())
        found = "the paired differences exclude zero" if self.is_shown else NOT_PERCEPTION
        return f"{PARTS[self.part].simulator}, {self.policy}: goals {counts}: {found}."


@dataclass(frozen=True)
class HierarchyScore:
    """The study's results, computed on demand from the episodes alone.

    ``unfinished`` gives what the runs lack, by part, with the reason. ``served`` names the models
    that several served models answered for.
    """

    drives: Mapping[str, tuple[Drives, ...]]
    resamples: int = 5000
    unfinished: Mapping[str, tuple[UnfinishedEpisodes, ...]] = field(default_factory=dict)
    served: Mapping[str, ServedGuard] = field(default_factory=dict)

    @cached_property
    def outcomes(self) -> SuccessCriteria:
        """Return the definition of success: the goal, without a crash."""
        return outcomes_of([drive for drives in self.drives.values() for drive in drives])

    @cached_property
    def sources(self) -> tuple[IntentSource, ...]:
        """Return a row for each source by name; MPC-only and the constant STRAIGHT share one."""
        return tuple(_source(part, name, one, self.outcomes) for part, name, one in self._named())

    @cached_property
    def against_mpc_only(self) -> tuple[PairedDifference, ...]:
        """Return every source of the primary ablation less MPC-only, same worlds, Holm over all."""
        drives = self._of("primary", "primary-models")
        reference = next((drive for drive in drives if drive.driver.policy == MPC_ONLY), None)
        return () if reference is None else tuple(against(drives, reference, self.outcomes, resamples=self.resamples))

    @cached_property
    def oracle_mirrored(self) -> PairedDifference | None:
        """Return the positive control, oracle intent less mirrored one; None if not run."""
        drives = {one.driver.policy: one for one in self._of("lateral")}
        if {ORACLE, ORACLE_MIRRORED} - drives.keys():
            return None
        found = paired(drives[ORACLE], drives[ORACLE_MIRRORED], self.outcomes, resamples=self.resamples)
        return corrected([found])[0]

    @cached_property
    def blind(self) -> tuple[tuple[str, BlindBaseline], ...]:
        """Return each model's comparison with itself blind, by part; Holm within a part."""
        found = []
        for part in ("primary-models", "unaware-models", "lateral-models"):
            found += [
                (part, blind_baseline)
                for blind_baseline in blind_baselines(self._of(part), self.outcomes, resamples=self.resamples)
            ]
        return tuple(found)

    @cached_property
    def completions(self) -> tuple[Completion, ...]:
        """Return each model's goals in each arm, with real pictures and with others."""
        found = []
        for part in (name for name in self.drives if PARTS[name].models):
            goals: dict[str, dict[str, Statistic]] = {}
            for one in self.drives[part]:
                reached = exact_rate(sum(map(self.outcomes.is_success, one.episodes)), len(one.episodes))
                goals.setdefault(one.driver.policy, {})[one.driver.condition] = reached
            found += [
                Completion(part, policy, rates, self._label(part, policy))
                for policy, rates in goals.items()
                if "real" in rates  # without real pictures there is nothing to compare with
            ]
        return tuple(found)

    def _label(self, part: str, policy: str) -> Label:
        mine = {one.condition: one for name, one in self.blind if (name, one.driver.policy) == (part, policy)}
        found = {name: _fewer(mine.get(name)) for name in NEEDED}
        for name in NEEDED:
            found |= fact(f"driven.{name}", holds=name in mine and mine[name].finding != CANNOT_SAY)
        return PLANNERS[COMPLETES.evaluate(found).label]

    def measured(self) -> tuple[ModelStatistics, ...]:
        """Return the statistics of every model in every arm, a simulator each."""
        found: list[ModelStatistics] = []
        for part, drives in self.drives.items():
            lacking = {one.policy: one.words for one in self.unfinished.get(part, ())}
            found += measured(drives, lacking, resamples=self.resamples)
        return tuple(found)

    @property
    def words(self) -> tuple[str, ...]:
        """Return sentences on each model's completion: the conclusions, then each pair."""
        pairs = (f"{PARTS[part].simulator}: {one.sentence}{unless_shown(one)}" for part, one in self.blind)
        return (*(completion.sentence for completion in self.completions), *pairs)

    def as_dict(self) -> dict[str, object]:
        """Return every number as plain JSON values."""
        return {
            "study": "hierarchy",
            **to_json_fields(self, "sources against_mpc_only completions words served"),
            "oracle_against_its_mirror": plain(self.oracle_mirrored),
            "blind": [{"part": part, **one.as_dict()} for part, one in self.blind],
            "unfinished": [{"part": part, **one.as_dict()} for part, many in self.unfinished.items() for one in many],
        }

    def _named(self) -> Iterator[tuple[str, str, Drives]]:
        for name, (part, policy) in SCRIPTED.items():
            yield from ((part, name, one) for one in self._of(part) if one.driver.policy == policy)
        for part in (name for name in self.drives if PARTS[name].models):
            yield from ((part, name_of(part, one.driver), one) for one in self.drives[part])

    def _of(self, *parts: str) -> list[Drives]:
        return [one for part in parts for one in self.drives.get(part, ())]


def runs_of(path: Path) -> dict[str, Path]:
    """Return the runs of the study that a folder holds, by the names of their parts."""
    return {name: path / name for name in PARTS if is_episodes(path / name)}


def score(out: Path, *, resamples: int = 5000) -> HierarchyScore:
    """Read the runs of the study in ``out``; raises LedgerError if there is none."""
    begun = runs_of(out)
    drives = {name: read_drives([run]) for name, run in begun.items() if any(read_episodes(run))}
    if not drives:
        raise LedgerError(f"{out} holds no run of the hierarchy; 'eyechart run hierarchy --out {out}' makes one")
    served = {f"{spec} in {part}": one for part, run in begun.items() for spec, one in served_of(run).items()}
    unfinished = {part: left for part, run in begun.items() if (left := unfinished_of(run))}
    return HierarchyScore(drives, resamples, unfinished, served)


def _fewer(baseline: BlindBaseline | None) -> Statistic:
    """Return how many more worlds are completed with real pictures, with its p after Holm.

    None if nothing can be concluded: the model never decided under a condition, or calls failed so
    often that the fail-safe may explain the difference.
    """
    if baseline is None or baseline.finding != DIFFERS:
        return Statistic(None, 0)
    return replace(baseline.paired.differences["success_rate"], p=baseline.paired.holm.get("success_rate"))


def shows(one: BlindBaseline) -> bool:
    """Return whether significantly more worlds are completed with real pictures (Holm)."""
    found = {NEEDED[0]: _fewer(one)}
    return all(clause.holds(found) for clause in _FEWER[NEEDED[0]])


def unless_shown(baseline: BlindBaseline) -> str:
    """Return the caveat if a pair does not show perception, else nothing."""
    return "" if shows(baseline) else f" So here {NOT_PERCEPTION}."


def _source(part: str, name: str, drives: Drives, outcomes: SuccessCriteria) -> IntentSource:
    episodes, steps = drives.episodes, drives.steps
    intents = Counter(step.decision.action for step in steps if step.decision.action is not None)
    silent = Counter(step.error or str(step.decision.missing) for step in steps if step.decision.action is None)

    distance = mean_of_drives([episode.distance_m for episode in episodes if episode.distance_m is not None])
    stops = np.array([_stops(episode) for episode in episodes]).reshape(-1, 2)
    return IntentSource(
        part=part,
        name=name,
        driver=drives.driver,
        goals=exact_rate(sum(map(outcomes.is_success, episodes)), len(episodes)),
        crashes=exact_rate(sum(episode.has_crashed for episode in episodes), len(episodes)),
        distance_m=distance,
        stop_share=share_over_episodes(stops[:, 0], stops[:, 1]),
        intents={action: intents[action] for action in drives.space.actions},
        no_decision=dict(sorted(silent.items())),
        solver_failures=sum(n for step in steps if isinstance(n := step.facts.get("solver_failures"), int)),
        episodes_in_error=len(drives.errors),
    )


def _stops(episode: Episode) -> tuple[float, float]:
    """Return the number of an episode's STOP intents, and of all its intents."""
    said = [step.decision.action for step in episode.steps if step.decision.action is not None]
    return said.count("STOP"), len(said)


def count_of(one: Statistic) -> str:
    """Return a rate as a count, k of n."""
    return "—" if one.value is None else f"{round(one.value * one.n)}/{one.n}"
