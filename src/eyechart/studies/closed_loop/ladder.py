"""The ladder: each policy's distance, reward and safety, and its comparison with the best constant.

Its episodes are every constant action, random and the scripted controller, in every scenario and
seed. Source: paper, Table t:baselines.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from operator import attrgetter
from pathlib import Path

import numpy as np

from eyechart.episodes import ACTION_MAP, Episode, EpisodesRun, Setup, plan
from eyechart.errors import SpecError, counted
from eyechart.modes import RequestMode
from eyechart.planned_run import RunAllowance
from eyechart.policies import open_policy
from eyechart.records import to_json_fields
from eyechart.seeds import key_seed
from eyechart.simulators import declared_by, open_simulator
from eyechart.spaces.discrete import Discrete
from eyechart.stats.agreement import clopper_pearson, rate
from eyechart.stats.paired_tests import DiscordantPairs, mcnemar_exact, paired_difference
from eyechart.stats.resamples import holm
from eyechart.stats.sign_flip import sign_flip_test
from eyechart.stats.statistic import Statistic, not_available
from eyechart.studies.closed_loop.drives import Driver, Drives

SEEDS = 8


def ladder_policies(space: Discrete) -> tuple[str, ...]:
    """Return the policies of a ladder: an action space's constants, random, and the oracle.

    The oracle is left out where the action space lacks its actions.
    """
    policies = (*(f"constant:{action}" for action in space.actions), "random")
    try:
        open_policy("oracle", space, lambda _: {})
    except SpecError:
        return policies
    return (*policies, "oracle")


@dataclass(frozen=True)
class Ladder(EpisodesRun):
    """The episodes of a ladder, or the rest of them."""

    def lines(self, how: RunAllowance) -> Iterator[str]:
        """Yield the number of episodes, and the expected cost of the models' calls."""
        yield f"{counted(len(self.keys), 'episode')}, {len(self.keys) - len(self.left())} driven already"
        yield from self.forecast(how)


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
) -> Ladder:
    """Plan a ladder, or the rest of one in ``out``: 7 policies × 4 scenarios × 8 seeds in highway.

    ``further`` are additional policies and models. The rest is as in `eyechart.episodes.plan`,
    which also raises.
    """
    actions = actions or (out / ACTION_MAP if (out / ACTION_MAP).is_file() else None)
    space = open_simulator(simulator, actions=actions).declared.action_space
    worlds, drivers = Setup(simulator, seed, actions=actions), (*ladder_policies(space), *further)
    made = plan(worlds, drivers, out, seeds=range(seeds), prompt=prompt)
    return Ladder(**{**vars(made), "again": again})


def require_reference(planned: EpisodesRun, against: str | None) -> None:
    """Raise SpecError where the reference policy is not among those that drive."""
    if against is not None and against not in planned.manifest.policies:
        known = ", ".join(planned.manifest.policies)
        raise SpecError(f"--against {against}: no such policy drives here; there are {known}")


CONSTANT = "constant:"
"""The beginning of a constant policy's SPEC."""

MARGINAL = "marginal:"
"""The beginning of the SPEC of a policy that draws from a controller's decisions."""

LEVEL = 0.05
UNTOLD = "the simulator does not tell it"

NUMBERS = {name: attrgetter(name) for name in ("distance_m", "reward", "speed_mps")}
"""The numbers of an episode; None where the simulator does not give one."""


@dataclass(frozen=True)
class SuccessCriteria:
    """The definition of success: the goal, or the time limit in scenarios not ``with_goal``.

    A scenario has a goal where any of the episodes reached one, or where the simulator declares it.
    """

    with_goal: frozenset[tuple[str, str]]

    def is_success(self, episode: Episode) -> bool:
        """Return whether an episode ended successfully, without a crash."""
        if episode.has_crashed:
            return False
        goal = (episode.key.simulator, episode.key.scenario) in self.with_goal
        return episode.ended == "goal" or (episode.ended == "time" and not goal)


def outcomes_of(drives: Sequence[Drives]) -> SuccessCriteria:
    """Return the definition of success in the worlds of these drives."""
    declared = {name: declared_by(name) for name in {drive.driver.simulator for drive in drives}}
    goals = {name for name, one in declared.items() if one is not None and one.has_goal}
    every = [episode for drive in drives for episode in drive.episodes]
    reached = (episode.key for episode in every if episode.ended == "goal" or episode.key.simulator in goals)
    return SuccessCriteria(frozenset((key.simulator, key.scenario) for key in reached))


@dataclass(frozen=True)
class LadderRow:
    """One driver's row of statistics with n and interval; exact for rates (Clopper-Pearson)."""

    driver: Driver
    statistics: Mapping[str, Statistic]
    errors: int

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return self.driver.as_dict() | to_json_fields(self, "statistics", episodes_in_error=self.errors)


@dataclass(frozen=True)
class PairedDifference:
    """Two drivers in the same worlds: first less second, each difference with n, interval and p.

    ``holm`` holds each p corrected over the whole family of comparisons.
    """

    first: Driver
    second: Driver
    worlds: int
    differences: Mapping[str, Statistic]
    holm: Mapping[str, float | None]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        pair = {"first": self.first.label, "second": self.second.label, "simulator": self.first.simulator}
        return pair | to_json_fields(self, "worlds differences holm changed")

    @property
    def changed(self) -> tuple[str, ...]:
        """Return the outcomes that differ significantly after correction."""
        return tuple(name for name, p in self.holm.items() if p is not None and p < LEVEL)


def rung(drives: Drives, outcomes: SuccessCriteria) -> LadderRow:
    """Return a driver's row; episodes that ended in an error count only in ``errors``."""
    episodes = drives.episodes
    statistics: dict[str, Statistic] = {}
    for name, measure in NUMBERS.items():
        values = [value for episode in episodes if (value := measure(episode)) is not None]
        if episodes and not values:
            statistics[name] = not_available(UNTOLD)
            continue
        statistics[name] = mean_of_drives(values)
    statistics["crash_rate"] = exact_rate(sum(episode.has_crashed for episode in episodes), len(episodes))
    statistics["success_rate"] = exact_rate(sum(map(outcomes.is_success, episodes)), len(episodes))
    return LadderRow(drives.driver, statistics, len(drives.errors))


NO_INTERVAL = "no interval: where few drives end early none was found that covers"
"""With one drive in ten that crashes, Student's t over 12 drives covers the mean in only .68."""


def mean_of_drives(values: Sequence[float]) -> Statistic:
    """Return the mean of a number over drives, without an interval; None without drives."""
    if not len(values):
        return not_available("no episodes", method="mean over episodes")
    return Statistic(float(np.mean(values)), len(values), method="mean over episodes", note=NO_INTERVAL)


def exact_rate(k: int, n: int) -> Statistic:
    """Return a share with its exact 95 % interval (Clopper-Pearson); None for n = 0."""
    result = rate(k, n)
    if result.value is None:
        return result
    return replace(result, ci=clopper_pearson(k, n), method="share, 95% Clopper-Pearson interval")


def paired(first: Drives, second: Drives, outcomes: SuccessCriteria, *, resamples: int = 5000) -> PairedDifference:
    """Compare two drivers in common worlds: numbers by sign flips, rates by exact McNemar.

    ``holm`` is empty until `corrected` fills it in.
    """
    worlds = sorted(first.by_world.keys() & second.by_world.keys())
    one, other = [first.by_world[name] for name in worlds], [second.by_world[name] for name in worlds]
    who = (*astuple(first.driver)[:3], *astuple(second.driver)[:3])
    statistics: dict[str, Statistic] = {}
    for name, measure in NUMBERS.items():
        pairs = [(measure(mine), measure(theirs)) for mine, theirs in zip(one, other, strict=True)]
        known = [(mine, theirs) for mine, theirs in pairs if mine is not None and theirs is not None]
        if pairs and not known:
            statistics[name] = not_available(UNTOLD)
            continue
        a, b = np.array([mine for mine, _ in known]), np.array([theirs for _, theirs in known])
        seed = key_seed("paired", *who, name)
        tested = sign_flip_test(a, b, seed=seed, resamples=resamples)
        if tested.value is not None and (a != b).any():
            tested = replace(tested, note=tested.note or NO_INTERVAL)
        statistics[name] = tested
    statistics["crash_rate"] = _binary([each.has_crashed for each in one], [each.has_crashed for each in other])
    statistics["success_rate"] = _binary(list(map(outcomes.is_success, one)), list(map(outcomes.is_success, other)))
    return PairedDifference(first.driver, second.driver, len(worlds), statistics, {})


def _binary(one: Sequence[bool], other: Sequence[bool]) -> Statistic:
    """Return the difference of two paired rates with Tango's interval and exact McNemar's p."""
    if not one:
        return not_available("no world was driven by both")
    statistic = paired_difference(np.array(one, dtype=int), np.array(other, dtype=int))
    assert isinstance(statistic, DiscordantPairs)  # there is a pair
    tested = mcnemar_exact(statistic.b, statistic.c)
    return replace(statistic, p=tested.p, method=f"{statistic.method}; {tested.method}")


def corrected(family: Sequence[PairedDifference]) -> list[PairedDifference]:
    """Return the comparisons with the p of all their tests corrected together by Holm."""
    places = [(turn, name) for turn, each in enumerate(family) for name in each.differences]
    ps = holm([family[turn].differences[name].p for turn, name in places])
    adjusted: list[dict[str, float | None]] = [{} for _ in family]
    for (turn, name), p in zip(places, ps, strict=True):
        adjusted[turn][name] = p
    return [replace(each, holm=mine) for each, mine in zip(family, adjusted, strict=True)]


def reference_of(drives: Sequence[Drives], against: str | None = None) -> Drives | None:
    """Return the reference driver: ``against``, or the constant with the highest mean reward.

    None where no constant drove with real pictures. Raises SpecError where ``against`` is not among
    the drivers.
    """
    real = [drive for drive in drives if drive.driver.condition == "real" and drive.episodes]
    if against is not None:
        if named := [drive for drive in real if drive.driver.policy == against]:
            return named[0]
        known = ", ".join(dict.fromkeys(drive.driver.policy for drive in real))
        raise SpecError(f"--against {against}: no such policy drove with real pictures here; there are {known}")
    constants = [drive for drive in real if drive.driver.policy.startswith(CONSTANT)]

    def worth(one: Drives) -> tuple[float, bool]:
        """Return the mean reward, and whether it is the mildest brake, preferred among aliases."""
        mildest = one.driver.policy in [f"{CONSTANT}{action}" for action in one.space.brake[-1:]]
        return sum(each.reward for each in one.episodes) / len(one.episodes), mildest

    return max(constants, key=worth, default=None)


def against(
    drives: Sequence[Drives], reference: Drives, outcomes: SuccessCriteria, *, resamples: int = 5000
) -> list[PairedDifference]:
    """Return each other driver less the reference in the same worlds, by Holm over all tests."""
    others = [drive for drive in drives if drive is not reference]
    return corrected([paired(drive, reference, outcomes, resamples=resamples) for drive in others])
