"""Runs of episodes as drives: all episodes of a policy in a simulator under a condition."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eyechart.calls import Reply
from eyechart.episodes import (
    ACTION_MAP,
    EPISODES,
    STUDY,
    Episode,
    EpisodesManifest,
    Step,
    read_episodes,
    read_manifest,
)
from eyechart.errors import LedgerError
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.records import JsonRecord
from eyechart.simulators import Simulator, open_simulator
from eyechart.spaces.discrete import Discrete
from eyechart.studies import names_of

ERROR = "error"
MODAL_CONSTANT = 0.98
"""The least modal share of a constant policy (paper, section Edge models are image-invariant)."""

UNDECIDED = 0.5
"""From this share of steps without a decision on, a drive belongs to the fail-safe."""


@dataclass(frozen=True, slots=True, order=True)
class Driver(JsonRecord):
    """A policy that drives in a simulator, under a condition, in a run.

    ``run`` is empty if there is only one run. If the policy drove in several, the run's name is
    ``needed`` in its label.
    """

    simulator: str
    policy: str
    condition: str
    run: str = ""
    needed: bool = field(default=True, compare=False)

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {"simulator": self.simulator, "policy": self.policy, "condition": self.condition, "run": self.run}

    @property
    def label(self) -> str:
        """Return the driver's name in tables: the policy, and what is needed to distinguish it."""
        shown = self.policy if self.condition == "real" else f"{self.policy} ({self.condition})"
        return f"{self.run} · {shown}" if self.run and self.needed else shown


@dataclass(frozen=True)
class Drives:
    """The episodes of one driver that count, by world; ``errors`` are those that ended in an error.

    ``is_model`` says whether the driver is a model. ``marginal_of`` names the driver of the same run
    whose marginal this is.
    """

    driver: Driver
    path: Path
    episodes: tuple[Episode, ...]
    errors: tuple[Episode, ...]
    space: Discrete
    is_model: bool
    marginal_of: str = ""

    @cached_property
    def by_world(self) -> Mapping[str, Episode]:
        """Return each episode by its world's name."""
        return {episode.key.world: episode for episode in self.episodes}

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """Return every step, episode by episode."""
        return tuple(step for episode in self.episodes for step in episode.steps)

    @cached_property
    def actions(self) -> NDArray[np.str_]:
        """Return the policy's decision at each step, "" where there is none."""
        return np.array([step.decision.action or "" for step in self.steps], dtype=np.str_)

    @cached_property
    def scenario_of(self) -> NDArray[np.str_]:
        """Return each step's scenario."""
        return np.array([episode.key.scenario for episode in self.episodes for _ in episode.steps], dtype=np.str_)

    @cached_property
    def world_of(self) -> NDArray[np.str_]:
        """Return each step's world."""
        return np.array([episode.key.world for episode in self.episodes for _ in episode.steps], dtype=np.str_)

    @cached_property
    def step_of(self) -> NDArray[np.int64]:
        """Return each step's number within its episode."""
        return np.array([step.step for step in self.steps], dtype=np.int64)

    def truth(self, column: str) -> list[object]:
        """Return a column of the truth at each step, None where it is missing."""
        return [step.truth.get(column) for step in self.steps]

    def open_simulator(self) -> Simulator:
        """Open the simulator of the drives, with the run's own action map if it has one."""
        actions = self.path / ACTION_MAP
        return open_simulator(self.driver.simulator, actions=actions if actions.is_file() else None)

    @cached_property
    def replies(self) -> tuple[tuple[str, Reply, str], ...]:
        """Return the replies in the order of sending: frame, reply, digest of the request."""
        if not self.is_model:
            return ()
        with Ledger(self.path / LEDGER, absent=True) as ledger:
            prefix, whose = f"{self.driver.simulator}/", (STUDY, self.driver.condition)
            return tuple(
                (sent.key.frame, sent.reply, sent.request_sha256)
                for sent in ledger.attempts(self.driver.policy)
                if sent.reply is not None
                and (sent.key.study, sent.key.condition) == whose
                and sent.key.frame.startswith(prefix)
            )

    @property
    def texts(self) -> dict[str, str]:
        """Return the text of the last reply about each frame."""
        return {frame: reply.text for frame, reply, _ in self.replies}


def undecided_share(steps: Sequence[Step]) -> float:
    """Return the share of steps without a decision, when the fail-safe drove; 0 of no steps."""
    return sum(step.decision.action is None for step in steps) / len(steps) if steps else 0.0


def read_drives(runs: Sequence[Path]) -> tuple[Drives, ...]:
    """Read every driver of some runs, in the order of the runs and of their manifests.

    Raises LedgerError where a folder is no run of episodes, or holds none. Also raises it for two
    different episodes of one key, or an episode that the run's manifest does not have.
    """
    found: list[Drives] = []
    for path, name in zip(runs, told_apart(runs), strict=True):
        manifest, episodes = read_manifest(path), _once(read_episodes(path), path)
        if not episodes:
            raise LedgerError(f"{path / EPISODES} holds no finished episode; repeat the command that began the run")
        for episode in episodes:
            _hold(episode, manifest, path)
        found += _drivers(path, name, episodes, manifest)
    runs_of: dict[str, set[str]] = {}
    for one in found:
        runs_of.setdefault(one.driver.policy, set()).add(one.driver.run)
    return tuple(replace(one, driver=replace(one.driver, needed=len(runs_of[one.driver.policy]) > 1)) for one in found)


def told_apart(runs: Sequence[Path]) -> list[str]:
    """Return the runs' names; "" for a single run."""
    return names_of(runs) if len(runs) > 1 else [""] * len(runs)


def _once(episodes: Iterable[Episode], path: Path) -> list[Episode]:
    found: dict[object, Episode] = {}
    for episode in episodes:
        if (before := found.setdefault(episode.key, episode)) != episode:
            if before.ended != ERROR:
                raise LedgerError(f"{path / EPISODES} holds two different episodes of {episode.key}; which one counts?")
            found[episode.key] = episode
    return list(found.values())


def _hold(episode: Episode, manifest: EpisodesManifest, path: Path) -> None:
    """Raise LedgerError for an episode with a name that the run does not have."""
    key, actions = episode.key, {None, *manifest.action_space.actions}
    named = {
        "simulator": (key.simulator, {manifest.simulator}),
        "policy": (key.policy, set(manifest.policies)),
        "condition": (key.condition, set(manifest.conditions)),
        "scenario": (key.scenario, set(manifest.scenarios)),
    }
    wrong = next((f"the {what} '{name}'" for what, (name, known) in named.items() if name not in known), None)
    for step in () if wrong else episode.steps:
        if odd := [one for one in (step.decision.action, step.executed_action) if one not in actions]:
            wrong = f"the action '{odd[0]}' at step {step.step}"
            break
    if wrong is not None:
        raise LedgerError(
            f"{path / EPISODES}: an episode of {key.policy} in {key.world} has {wrong}, which the run does not have; "
            "restore the file from a copy, or delete its line"
        )


def _drivers(path: Path, name: str, episodes: Sequence[Episode], manifest: EpisodesManifest) -> list[Drives]:
    order, conditions = list(manifest.policies), list(manifest.conditions)
    groups: dict[Driver, list[Episode]] = {}
    for episode in episodes:
        key = episode.key
        groups.setdefault(Driver(key.simulator, key.policy, key.condition, name), []).append(episode)
    drivers = []
    for driver in sorted(
        groups, key=lambda group: (order.index(group.policy), conditions.index(group.condition), group)
    ):
        mine = sorted(groups[driver], key=lambda one: (one.key.scenario, one.key.seed))
        good = tuple(one for one in mine if one.ended != ERROR)
        bad = tuple(one for one in mine if one.ended == ERROR)
        is_model = driver.policy in manifest.models
        own = manifest.marginal_of(driver.policy)
        drivers.append(Drives(driver, path, good, bad, manifest.action_space, is_model=is_model, marginal_of=own))
    return drivers
