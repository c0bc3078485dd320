"""The audit: whether a policy decides or only varies, and how often it agrees with a controller.

For comparison, every constant and the policy's own decisions in shuffled order stand beside each
agreement. Source: paper, Table t:degeneracy and figure fgr:mi, and section Results (decision-level
replay). The paper does not give its bins of scene geometry; these are the battery's quartiles.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eyechart.episodes import Step
from eyechart.policies import Observation
from eyechart.policies.scripted import NEEDS, Oracle
from eyechart.records import to_json_fields
from eyechart.seeds import key_seed
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import MISSING
from eyechart.stats.agreement import rate
from eyechart.stats.association import contingency, entropy_bits, modal_share, quantile_bins
from eyechart.stats.episode_permutation import exchange_mi_test
from eyechart.stats.episodes import share_over_episodes
from eyechart.stats.resamples import holm, permute_agreement, permute_mutual_information
from eyechart.stats.statistic import ModelStatistics, Statistic, not_available
from eyechart.studies.closed_loop.drives import MODAL_CONSTANT, Driver, Drives
from eyechart.studies.closed_loop.ladder import LEVEL

GAP, SIDE = "lead_gap_m", "nearest_side"
BINS = 4

GAP_ALONE = "gap in quartiles"
GAP_AND_SIDE = "gap in quartiles × side of the nearest obstacle"


@dataclass(frozen=True)
class SceneLabels:
    """The scene label of each step; ``geometry`` says of what, "" where the truth has no gap."""

    codes: NDArray[np.int64]
    geometry: str


def scene_of(drives: Drives) -> SceneLabels:
    """Return the scene at each step of a driver, by the quartiles of its gaps.

    A missing gap counts as the farthest. Where the truth names the side of the nearest obstacle
    (forward cameras), each gap bin is divided by side.
    """
    steps = drives.steps
    gaps = [None if isinstance(gap, bool) or not isinstance(gap, int | float) else gap for gap in drives.truth(GAP)]
    if any(GAP not in step.truth for step in steps) or all(gap is None for gap in gaps):
        return SceneLabels(np.zeros(len(steps), dtype=np.int64), "")
    bins = quantile_bins(gaps, BINS)
    if not all(SIDE in step.truth for step in steps):
        return SceneLabels(bins.codes, GAP_ALONE)
    sides = np.array([str(step.truth[SIDE]) for step in steps], dtype=np.str_)
    _, side = np.unique(sides, return_inverse=True)
    _, codes = np.unique(bins.codes * (int(side.max()) + 1) + side, return_inverse=True)
    return SceneLabels(codes.astype(np.int64), GAP_AND_SIDE)


@dataclass(frozen=True)
class Degeneracy:
    """One driver's row. ``geometry`` says what the information is about.

    ``statistics``: modal_share, distinct_actions, entropy_bits, information_bits (its p takes steps
    as independent, as the paper's does), information_share (of the entropy),
    information_episode_safe (p from exchanging whole episodes), unparsed_rate. ``holm_naive`` and
    ``holm`` are the two p corrected by Holm as in `audit`, None for a driver that does not vary.
    ``reasons`` counts the steps without a decision by reason.
    """

    driver: Driver
    geometry: str
    statistics: Mapping[str, Statistic]
    reasons: Mapping[str, int]
    holm_naive: float | None = None
    holm: float | None = None

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        own = to_json_fields(
            self, "geometry label statistics holm_naive holm", constant=self.is_constant, missing=self.reasons
        )
        return self.driver.as_dict() | own

    @property
    def varies(self) -> bool:
        """Return whether the policy took more than one action."""
        return (self.statistics["distinct_actions"].value or 0) > 1

    @property
    def is_constant(self) -> bool:
        """Return whether the policy is constant: a modal share of .98 or more."""
        modal = self.statistics["modal_share"].value
        return modal is not None and modal >= MODAL_CONSTANT

    @property
    def label(self) -> str:
        """Return the row's result: constant, follows the scene, varies only, or cannot say."""
        if self.statistics["modal_share"].value is None:
            return "no decisions"
        if self.is_constant:
            return "constant"
        if self.holm is None:
            return "cannot say"
        return "follows the scene" if self.holm < LEVEL else "varies, no link found"


def audit(drives: Sequence[Drives], *, resamples: int = 5000) -> list[Degeneracy]:
    """Return each driver's row, with both p corrected by Holm over the rows that vary.

    Models that drove with real pictures are one family, that of Table t:degeneracy; all others are
    another.
    """
    rows = [degeneracy(drive, resamples=resamples) for drive in drives]
    table = [is_in_table(drive) for drive in drives]
    for family in (True, False):
        mine = [place for place, inside in enumerate(table) if inside == family]
        for place, row in zip(mine, corrected([rows[place] for place in mine]), strict=True):
            rows[place] = row
    return rows


def is_in_table(drives: Drives) -> bool:
    """Return whether a driver is a model with real pictures: a row of Table t:degeneracy."""
    return bool(drives.is_model and drives.driver.condition == "real")


def corrected(rows: Sequence[Degeneracy]) -> list[Degeneracy]:
    """Return the rows with both p corrected by Holm over the rows that vary.

    In the paper's table four rows vary: no p of 5000 permutations becomes its .037 as the second of
    eight.
    """
    tests = ("information_bits", "information_episode_safe")
    naive, safe = (holm([row.statistics[name].p if row.varies else None for row in rows]) for name in tests)
    return [replace(row, holm_naive=p, holm=q) for row, p, q in zip(rows, naive, safe, strict=True)]


BITS = {"mutual_information.decision": "information_bits", "entropy": "entropy_bits"}
"""The battery's names of the same statistics."""


def measured(
    drives: Sequence[Drives], unfinished: Mapping[str, str], *, resamples: int = 5000
) -> tuple[ModelStatistics, ...]:
    """Return the audit of every model that drove with real pictures, also by the battery's names.

    Crash and success are left out, because they are compared with blind policies in the same
    worlds. ``unfinished`` says by model what its run lacks.
    """
    found = []
    for drive in drives:
        if is_in_table(drive):
            row = degeneracy(drive, resamples=resamples).statistics
            also = {name: row[mine] for name, mine in BITS.items()}
            who = drive.driver.policy
            found.append(ModelStatistics(who, drive.driver.simulator, {**also, **row}, unfinished.get(who, "")))
    return tuple(found)


def degeneracy(drives: Drives, *, resamples: int = 5000) -> Degeneracy:
    """Return one driver's row, without correction."""
    actions, scene = drives.actions, scene_of(drives)
    decided = actions != ""
    seed = key_seed("audit", drives.driver.simulator, drives.driver.policy, drives.driver.condition)
    entropy = entropy_bits(actions[decided])
    naive = not_available("the truth of these drives has no lead_gap_m")
    safe = naive
    if scene.geometry:
        naive = _naive(actions[decided], scene.codes[decided], seed, resamples)
        safe = _episode_safe(drives, scene.codes, seed, resamples)
    reasons = [step.decision.missing for step in drives.steps if step.decision.missing is not None]
    found = {
        "modal_share": modal_share(actions[decided]),
        "distinct_actions": _distinct(actions[decided]),
        "entropy_bits": entropy,
        "information_bits": naive,
        "information_share": _share(naive, entropy),
        "information_episode_safe": safe,
        "unparsed_rate": rate(len(reasons), len(actions)),
    }
    counts: dict[str, int] = {reason: reasons.count(reason) for reason in MISSING if reason in reasons}
    return Degeneracy(drives.driver, scene.geometry, found, counts)


def _naive(actions: NDArray[np.str_], scene: NDArray[np.int64], seed: int, resamples: int) -> Statistic:
    if not len(actions):
        return not_available("no decisions")
    table = contingency(actions, scene).table
    statistic = permute_mutual_information(table, seed=seed, resamples=resamples)
    rows, columns = table.shape
    bias = (rows - 1) * (columns - 1) / (2 * statistic.n * float(np.log(2)))
    detail = {**(statistic.detail or {}), "miller_madow": (statistic.value or 0.0) - bias, "shape": [rows, columns]}
    return replace(statistic, detail=detail)


def _episode_safe(drives: Drives, scene: NDArray[np.int64], seed: int, resamples: int) -> Statistic:
    """Test the same information with whole episodes exchanged, on steps that most episodes have.

    Episodes end when they crash, so those of a scenario differ in length. Per scenario, the length
    that keeps most steps is taken, among those that at least half of its episodes reach. Shorter
    episodes are left out, longer ones cut.
    """
    actions = drives.actions
    if not (actions != "").any():
        return not_available("no decisions")
    if len(np.unique(actions[actions != ""])) < 2:
        return replace(not_available("the decision never changes", int((actions != "").sum())), p=1.0)
    kept = _common_steps(drives)
    if not kept.any():
        return not_available("no scenario has two episodes that last two steps")
    found = exchange_mi_test(
        actions[kept],
        scene[kept],
        drives.scenario_of[kept],
        drives.world_of[kept],
        drives.step_of[kept],
        seed=seed,
        alpha=LEVEL,
        resamples=resamples,
    )
    left = int((~kept).sum())
    note = "; ".join(filter(None, [found.note, f"{left} of {len(kept)} steps are left out: episodes differ in length"]))
    return replace(found, note=note if left else found.note, detail={**(found.detail or {}), "left_out": left})


def _common_steps(drives: Drives) -> NDArray[np.bool_]:
    """Return the steps that the exchange uses."""
    length = {episode.key.world: len(episode.steps) for episode in drives.episodes}
    least: dict[str, int] = {}
    for scenario in np.unique(drives.scenario_of):
        mine = sorted(
            (len(episode.steps) for episode in drives.episodes if episode.key.scenario == scenario and episode.steps),
            reverse=True,
        )
        allowed = range(max(2, (len(mine) + 1) // 2), len(mine) + 1)
        best = max(allowed, key=lambda count: count * mine[count - 1], default=0)
        least[str(scenario)] = mine[best - 1] if best and mine[best - 1] >= 2 else 0
    cut = np.array([least[str(scenario)] for scenario in drives.scenario_of], dtype=np.int64)
    long = np.array([length[str(world)] for world in drives.world_of], dtype=np.int64)
    return (cut > 0) & (long >= cut) & (drives.step_of < cut)


def _distinct(actions: NDArray[np.str_]) -> Statistic:
    if not len(actions):
        return not_available("no decisions")
    names, counts = np.unique(actions, return_counts=True)
    detail = {"counts": dict(zip(names.tolist(), counts.tolist(), strict=True))}
    return Statistic(float(len(names)), len(actions), method="distinct decisions", detail=detail)


def _share(information: Statistic, entropy: Statistic) -> Statistic:
    method = "information over entropy"
    if information.value is None or entropy.value is None:
        return not_available(information.note or entropy.note, entropy.n, method)
    if entropy.value == 0:
        return not_available("the decision never changes: there is no variability to explain", entropy.n, method)
    return Statistic(information.value / entropy.value, entropy.n, method=method)


def _demand(step: Step) -> str | None:
    """Return the safety policy's action (the truth's column ``demand``)."""
    demand = step.truth.get("demand")
    return demand if isinstance(demand, str) else None


def _oracle(step: Step) -> str | None:
    """Return the action of the ladder's oracle; None where the truth lacks its inputs."""
    if any(step.truth.get(name) is None for name in NEEDS):
        return None
    return Oracle().decide(Observation(step.frame, step.step, lambda: None, step.truth, DRIVING, 0)).action


CONTROLLERS: dict[str, Callable[[Step], str | None]] = {"oracle": _oracle, "demand": _demand}
"""The scripted controllers for comparison: the ladder's oracle, and the safety policy."""


@dataclass(frozen=True)
class ReplayComparison:
    """One driver compared with one controller.

    ``agreement`` has an interval over episodes. ``constants`` maps each action to the agreement of
    always taking it at the same steps. ``shuffled`` is the expected agreement of the same decisions
    in random order. Its interval is that of 5000 permutations, and its p that of an order which
    agrees at least as often.
    """

    driver: Driver
    controller: str
    agreement: Statistic
    constants: Mapping[str, Statistic]
    shuffled: Statistic

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        own = to_json_fields(self, "controller agreement constants shuffled")
        return to_json_fields(self.driver, "policy condition run") | own

    @property
    def best_constant(self) -> tuple[str, float] | None:
        """Return the constant with the highest agreement, and its agreement."""
        known = [(name, constant.value) for name, constant in self.constants.items() if constant.value is not None]
        return max(known, key=lambda pair: pair[1], default=None)


def replays(drives: Drives, *, resamples: int = 5000) -> list[ReplayComparison]:
    """Return a driver's comparison with each controller that the truth allows, by decisions."""
    result = []
    for name, controller in CONTROLLERS.items():
        demanded = [controller(step) for step in drives.steps]
        if any(one is not None and one in drives.space.actions for one in demanded):
            whole = np.array([one or "" for one in demanded], dtype=np.str_)
            decided = (drives.actions != "") & (whole != "")
            actions, wanted, worlds = drives.actions[decided], whole[decided], drives.world_of[decided]
            seed = key_seed("replay", drives.driver.simulator, drives.driver.policy, drives.driver.condition, name)
            agreement = _agreement(actions == wanted, worlds)
            constants = {action: _agreement(wanted == action, worlds) for action in drives.space.actions}
            result.append(
                ReplayComparison(drives.driver, name, agreement, constants, _shuffled(actions, wanted, seed, resamples))
            )
    return result


def _agreement(hits: NDArray[np.bool_], worlds: NDArray[np.str_]) -> Statistic:
    if not len(hits):
        return not_available("no decisions to compare")
    _, codes = np.unique(worlds, return_inverse=True)
    statistic = share_over_episodes(np.bincount(codes, weights=hits), np.bincount(codes))
    return replace(rate(int(hits.sum()), len(hits)), note=statistic.note) if statistic.ci is None else statistic


def _shuffled(actions: NDArray[np.str_], demanded: NDArray[np.str_], seed: int, resamples: int) -> Statistic:
    """Return how often the same decisions agree in random order."""
    names, codes = np.unique(np.concatenate([actions, demanded]), return_inverse=True)
    table = np.zeros((len(names), len(names)), dtype=np.int64)
    np.add.at(table, (codes[: len(actions)], codes[len(actions) :]), 1)
    return permute_agreement(table, seed=seed, resamples=resamples)
