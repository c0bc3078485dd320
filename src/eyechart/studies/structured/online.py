"""The online run: an estimator's scenes drive through the safety policy, in worlds that were vetted first.

Source: paper, section Constructive renderer-calibrated controller; the column of crashes of Table t:controller-local.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from eyechart import episodes as closed_loop
from eyechart.episodes import Bounds, Episode, Episodes, EpisodesManifest, Setup, read_episodes, read_manifest
from eyechart.errors import LedgerError, SpecError
from eyechart.limits import Outcome, Spent
from eyechart.modes import RequestMode
from eyechart.perception.forward import distances_of
from eyechart.perception.view import CALIBRATED, NONE, VIEWS, view_for
from eyechart.prompts import scene_prompt
from eyechart.records import Plain
from eyechart.run import Progress
from eyechart.simulators import open_simulator
from eyechart.stats.agreement import rate
from eyechart.stats.statistic import Statistic
from eyechart.studies.structured.vetting import Vetted, read_vetting, vet_worlds, write_vetting

EPISODES = 12
USUAL = Bounds()
CONTROL = "positive control (vetting)"
"""The drives by which the worlds were vetted, as a line of the table."""


@dataclass(frozen=True)
class Online:
    """An online run that was planned and not yet driven: its episodes, and how their worlds were vetted."""

    episodes: Episodes
    vetted: tuple[Vetted, ...]

    def counting(self, probes: Mapping[str, Spent]) -> "Online":
        """Return the plan with what was spent on probing models for it."""
        return replace(self, episodes=self.episodes.counting(probes))


def plan(
    simulator: str,
    specs: Sequence[str | RequestMode],
    out: Path,
    *,
    view: str | None = None,
    episodes: int = EPISODES,
    seed: int = 0,
    progress: Progress | None = None,
    vetted: tuple[Vetted, ...] | None = None,
) -> Online:
    """Vet worlds, or read which ones ``out`` holds already, and plan an episode of each model in each that passed.

    Nothing is written or asked yet. ``progress`` gets (worlds passed, of how many). ``vetted`` is how the worlds of
    this plan were vetted before. Raises SpecError and LedgerError as a closed loop's plan does, and SpecError where too
    few worlds pass.
    """
    if episodes < 1:
        raise SpecError(f"an online run needs at least 1 episode, got {episodes}")
    world = open_simulator(simulator).declared
    choice = view or (CALIBRATED if world.camera in VIEWS else NONE)
    shown = view_for(choice, world.camera or world.name)
    prompt = scene_prompt(world.picture, distances_of(world.camera), shown)

    def planned(seeds: Sequence[int]) -> Episodes:
        return closed_loop.plan(Setup(simulator, seed), specs, out, seeds=seeds, prompt=prompt, view=shown)

    planned((0,))  # what is wrong with the models or the folder is said before the worlds are driven
    kept = read_vetting(out)
    vetted = kept or vetted or vet_worlds(simulator, episodes, shown, progress)
    worlds = [(one.scenario, one.seed) for one in vetted if one.why is None]
    if kept and len(worlds) != episodes:
        raise LedgerError(
            f"this run has {len(worlds)} worlds that passed, now {episodes} episodes were asked for; "
            "give the same options to resume it, or another --out for another run"
        )
    whole = planned(tuple(dict.fromkeys(number for _, number in worlds)))
    keys = tuple(key for key in whole.keys if (key.scenario, key.seed) in worlds)
    return Online(replace(whole, keys=keys), vetted)


def keep_probes(planned: Online, probes: Mapping[str, Spent]) -> None:
    """Write into the run what was spent on probing models, before anything is driven; see `episodes.keep_probes`."""
    closed_loop.keep_probes(planned.episodes, probes)
    write_vetting(planned.episodes.out, planned.vetted)


def run(planned: Online, *, bounds: Bounds = USUAL, progress: Progress | None = None) -> Outcome:
    """Drive the planned episodes that the folder does not hold yet, and return how that ended; see `episodes.run`."""
    write_vetting(planned.episodes.out, planned.vetted)
    return closed_loop.run(planned.episodes, bounds=bounds, progress=progress)


@dataclass(frozen=True)
class Driven(Plain):
    """What came of one estimator's episodes: how many it drove, crashed in, and what it decided.

    ``fail_safe`` counts the steps at which SLOW was executed because there was no estimate; it is credited to nobody.
    ``errors`` ended otherwise than by driving and count in nothing.
    """

    crash_rate: Statistic
    decisions: Mapping[str, int]
    fail_safe: int
    errors: int


@dataclass(frozen=True)
class OnlineScore:
    """What came of an online run, by estimator, and how its worlds were vetted."""

    manifest: EpisodesManifest
    vetted: tuple[Vetted, ...]
    driven: Mapping[str, Driven]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            "study": "online",
            "simulator": self.manifest.simulator,
            "prompt": self.manifest.prompt.key,
            "view": self.manifest.view,
            "worlds": [f"{one.scenario}/{one.seed}" for one in self.vetted if one.why is None],
            "refused": {f"{one.scenario}/{one.seed}": one.why for one in self.vetted if one.why is not None},
            "models": {spec: one.as_dict() for spec, one in self.driven.items()},
        }


def score(path: Path) -> OnlineScore:
    """Score the online run in a folder, finished or not; raises LedgerError where it holds none."""
    vetted = read_vetting(path)
    if vetted is None:
        raise LedgerError(f"{path} holds no online run; 'eyechart run online' makes one")
    manifest, found = read_manifest(path), list(read_episodes(path))
    passed = [one for one in vetted if one.why is None]
    worlds = {(one.scenario, one.seed) for one in passed}
    driven = {CONTROL: _of_vetting(passed)}
    for spec in manifest.policies:
        mine = {one.key: one for one in found if one.key.policy == spec and (one.key.scenario, one.key.seed) in worlds}
        driven[spec] = _driven(list(mine.values()))
    return OnlineScore(manifest, vetted, driven)


def _of_vetting(passed: Sequence[Vetted]) -> Driven:
    decisions = sum((Counter(one.actions) for one in passed), Counter[str]())
    return Driven(rate(sum(one.ended == "crash" for one in passed), len(passed)), dict(decisions), 0, 0)


def _driven(episodes: Sequence[Episode]) -> Driven:
    good = [one for one in episodes if one.ended != "error"]
    taken = [step.decision.action for one in good for step in one.steps]
    return Driven(
        crash_rate=rate(sum(one.crashed for one in good), len(good)),
        decisions=dict(Counter(action for action in taken if action is not None)),
        fail_safe=sum(action is None for action in taken),
        errors=len(episodes) - len(good),
    )
