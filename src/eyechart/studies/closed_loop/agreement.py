"""Decision-level replay: at the moments that a policy met, how often it decides as a scripted controller would.

Beside it stand every constant at the same moments, and the policy's own decisions in shuffled order. Source: paper,
section Results (decision-level replay).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eyechart.episodes import Step
from eyechart.policies import Observation
from eyechart.policies.scripted import NEEDS, Oracle
from eyechart.records import plain
from eyechart.seeds import key_seed
from eyechart.spaces.discrete import DRIVING
from eyechart.stats.agreement import rate
from eyechart.stats.resampling import cluster_bootstrap, permutation_p
from eyechart.stats.statistic import Statistic, cannot_say
from eyechart.studies.closed_loop.reading import Driver, Drives

SHUFFLES = 1000


def _demand(step: Step) -> str | None:
    """Return what the safety policy asks for (the truth's column ``demand``)."""
    asked = step.truth.get("demand")
    return asked if isinstance(asked, str) else None


def _oracle(step: Step) -> str | None:
    """Return what the ladder's oracle decides; None where the truth lacks what it reads."""
    if any(step.truth.get(name) is None for name in NEEDS):
        return None
    return Oracle().decide(Observation(step.frame, step.step, lambda: None, step.truth, DRIVING, 0)).action


CONTROLLERS: dict[str, Callable[[Step], str | None]] = {"oracle": _oracle, "demand": _demand}
"""The scripted controllers that decisions are held against: the ladder's oracle, and the safety policy."""


@dataclass(frozen=True)
class Replay:
    """One driver held against one controller.

    ``agreement`` has an interval over episodes. ``constants`` maps each action to the agreement of always taking it at
    the same moments. ``shuffled`` is the mean agreement of the same decisions in random order, its interval that of the
    permutations, and its p that of an order which agrees at least as often.
    """

    driver: Driver
    controller: str
    agreement: Statistic
    constants: Mapping[str, Statistic]
    shuffled: Statistic

    @property
    def best_constant(self) -> tuple[str, float] | None:
        """Return the constant that agrees most, and how often."""
        known = [(name, one.value) for name, one in self.constants.items() if one.value is not None]
        return max(known, key=lambda pair: pair[1], default=None)

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            "policy": self.driver.policy,
            "condition": self.driver.condition,
            "run": self.driver.run,
            "controller": self.controller,
            "agreement": self.agreement.as_dict(),
            "constants": plain(self.constants),
            "shuffled": self.shuffled.as_dict(),
        }


def replays(drives: Drives, *, resamples: int = 5000) -> list[Replay]:
    """Return a driver held against each controller that the truth of its moments tells; only decisions count."""
    found = []
    for name, controller in CONTROLLERS.items():
        asked = [controller(step) for step in drives.steps]
        if any(one is not None and one in drives.space.actions for one in asked):
            wanted = np.array([one or "" for one in asked], dtype=np.str_)
            found.append(_replay(drives, name, wanted, resamples))
    return found


def _replay(drives: Drives, name: str, wanted: NDArray[np.str_], resamples: int) -> Replay:
    decided = (drives.actions != "") & (wanted != "")
    actions, asked, worlds = drives.actions[decided], wanted[decided], drives.world_of[decided]
    seed = key_seed("replay", drives.driver.simulator, drives.driver.policy, drives.driver.condition, name)
    agreement = _agreement(actions == asked, worlds, seed, resamples)
    constants = {one: _agreement(asked == one, worlds, seed, resamples) for one in drives.space.actions}
    return Replay(drives.driver, name, agreement, constants, _shuffled(actions, asked, seed))


def _agreement(hits: NDArray[np.bool_], worlds: NDArray[np.str_], seed: int, resamples: int) -> Statistic:
    if not len(hits):
        return cannot_say("no decisions to compare")
    _, codes = np.unique(worlds, return_inverse=True)
    sums = np.column_stack([np.bincount(codes, weights=hits), np.bincount(codes)])
    found = cluster_bootstrap(sums, seed=seed, resamples=resamples, enumerate_up_to=20_000)
    if found.ci is None or found.ci[0] == found.ci[1]:  # no width would claim certainty
        return rate(int(hits.sum()), len(hits))
    return Statistic(found.value, len(hits), found.ci, method=f"share of decisions, {found.method}")


def _shuffled(actions: NDArray[np.str_], asked: NDArray[np.str_], seed: int) -> Statistic:
    """Return how often the same decisions agree in random order."""
    method = f"the same decisions in random order, 95% of {SHUFFLES} orders"
    if not len(actions):
        return cannot_say("no decisions to compare", method=method)
    names, codes = np.unique(np.concatenate([actions, asked]), return_inverse=True)
    mine, theirs = codes[: len(actions)], codes[len(actions) :]
    rng = np.random.default_rng(seed)
    rates = np.array([float(np.mean(rng.permutation(mine) == theirs)) for _ in range(SHUFFLES)])
    low, high = (float(edge) for edge in np.quantile(rates, [0.025, 0.975]))
    observed = float(np.mean(mine == theirs))
    k = int(np.count_nonzero(rates >= observed - 1e-12))
    detail = {"labels": len(names), "observed": observed}
    return Statistic(float(rates.mean()), len(actions), (low, high), permutation_p(k, SHUFFLES), method, detail=detail)
