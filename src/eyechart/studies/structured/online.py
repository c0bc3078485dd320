"""The online run: an estimator's scenes drive through the safety policy, in worlds that were vetted first.

Worlds are vetted before a model drives in them: the picture must be whole, and the scene be read from it. Source:
paper, section Constructive renderer-calibrated controller (renderer-integrity and positive-control checks); the column
of crashes of Table t:controller-local.
"""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from eyechart import episodes as closed_loop
from eyechart.conditions import flip
from eyechart.episodes import Bounds, Episode, Episodes, EpisodesManifest, Setup, read_episodes, read_manifest
from eyechart.episodes.running import USUAL
from eyechart.errors import BankError, LedgerError, SpecError
from eyechart.frames import RGB, Scalar, encode
from eyechart.integrity import ServedGuard
from eyechart.limits import Outcome, Spent
from eyechart.models.scripted import see
from eyechart.modes import RequestMode
from eyechart.perception.forward import distances_of
from eyechart.perception.view import View, view_for
from eyechart.prompts import scene_prompt
from eyechart.records import Plain, build, plain
from eyechart.run import Progress
from eyechart.simulators import Drive, HalfBlind, Simulator, open_simulator
from eyechart.spaces.scene import Estimate, Scene
from eyechart.stats.agreement import rate
from eyechart.stats.statistic import Statistic
from eyechart.studies.closed_loop import served_of

VETTING = "vetting.json"
GAP_ERROR_M = 0.1
"""Half a pixel of highway-env's picture is 0.091 m."""

SIDES_RIGHT = 0.9
"""Between two lanes a side may be read and told differently for a moment."""

_MOST_STEPS = 1000
_SEEDS_TRIED = 10


@dataclass(frozen=True, slots=True)
class Vetted:
    """What the positive control met when it drove in a world.

    ``why`` is None where the world passes. ``frames`` were checked, ``ended`` is how its drive ended, ``actions``
    counts its decisions, ``gap_mae_m`` is its error over the frames with a lead in the picture, None without one.
    ``unseen`` counts the frames at which a side was closed by what stands beside a forward camera, out of its picture.
    """

    scenario: str
    seed: int
    frames: int
    ended: str
    actions: Mapping[str, int]
    gap_mae_m: float | None
    why: str | None = None
    unseen: int = 0


@dataclass
class _Checks:
    """What is found frame by frame; ``failed`` is the first fault that fails a world."""

    frames: int = 0
    errors_m: list[float] = field(default_factory=list)
    actions: Counter[str] = field(default_factory=Counter)
    sides_right: int = 0
    unseen: int = 0
    failed: str | None = None

    def look(self, drive: Drive, pixels: RGB, view: View | None, axis: str) -> str | None:
        """Check one frame as a model is shown it; return the safe action of what was read, None where nothing was."""
        self.frames += 1
        sides = (pixels, flip(pixels, axis))
        shown, reflected = (np.ascontiguousarray(one if view is None else view.show(one)) for one in sides)
        reading, mirrored = see(encode(shown)).reading, see(encode(reflected)).reading
        if reading is None:
            self._fail("renderer integrity: no road with a vehicle is seen")
            return None
        scene = reading.scene
        if mirrored is None or mirrored.scene != scene.mirrored():
            self._fail("positive control: the reflection is read differently")
        self._compare(scene, drive.truth(), drive.unseen_sides() if isinstance(drive, HalfBlind) else frozenset())
        action = Estimate.of(scene).act(scene.distances)
        self.actions[action] += 1
        return action

    def _compare(self, scene: Scene, truth: Mapping[str, Scalar], unseen: frozenset[str]) -> None:
        told = truth["lead_gap_m"] if truth.get("lead_visible") is not False else None
        if isinstance(told, bool | str):
            raise SpecError(f"the world tells the gap {told!r}, which is no number")
        if (told is None) != (scene.gap_m is None):
            self._fail("positive control: a lead is read and not there, or there and not read")
        elif told is not None and scene.gap_m is not None:
            self.errors_m.append(abs(scene.gap_m - told))
            if self.errors_m[-1] > GAP_ERROR_M:
                self._fail(f"positive control: the gap is read {self.errors_m[-1]:.2f} m off")
        self.unseen += bool(unseen)
        read = {"left": scene.left_clear, "right": scene.right_clear}
        self.sides_right += all(side in unseen or clear == truth[f"{side}_clear"] for side, clear in read.items())

    def _fail(self, why: str) -> None:
        self.failed = self.failed or f"frame {self.frames - 1}: {why}"


def vet(simulator: Simulator, scenario: str, seed: int, view: View | None) -> Vetted:
    """Let the positive control drive in a world and check every frame that it is shown.

    Renderer integrity: the picture is one that the view is for, shows something, and is a road with the own vehicle.
    Positive control: the lead is read within 0.1 m of the truth at every frame, its sides right on 90 % of them, and
    the reflection exactly alike. A side that is closed by nothing in the picture, because what closes it stands beside
    a forward camera, is not judged: no picture could tell.
    """
    checks, ended = _Checks(), "time"
    drive = simulator.drive(scenario, seed)
    try:
        while checks.frames < _MOST_STEPS:
            pixels = drive.picture()
            if (pixels == pixels[0, 0]).all():
                checks.failed = f"frame {checks.frames}: renderer integrity: the picture has one colour"
                break
            action = checks.look(drive, pixels, view, simulator.declared.mirror_axis)
            if action is None:
                break
            moved = drive.step(action)
            if moved.ended is not None:
                ended = moved.ended
                break
    except (BankError, KeyError) as error:
        checks.failed = f"frame {checks.frames}: renderer integrity: {error}"
    finally:
        drive.close()
    if checks.failed is None and checks.sides_right < SIDES_RIGHT * checks.frames:
        checks.failed = f"positive control: the sides are read right on {checks.sides_right} of {checks.frames} frames"
    error_m = float(np.mean(checks.errors_m)) if checks.errors_m else None
    return Vetted(scenario, seed, checks.frames, ended, dict(checks.actions), error_m, checks.failed, checks.unseen)


def vet_worlds(
    name: str, episodes: int, view: View | None, progress: Callable[[int, int], None] | None = None
) -> tuple[Vetted, ...]:
    """Vet worlds of every scenario in turn, seed by seed, until ``episodes`` of them pass; all that were tried.

    Raises SpecError where so many do not pass within ten seeds a scenario.
    """
    simulator = open_simulator(name)
    share, rest = divmod(episodes, len(simulator.declared.scenarios))
    found: list[Vetted] = []
    for number, scenario in enumerate(simulator.declared.scenarios):
        wanted = share + (number < rest)
        for seed in range(_SEEDS_TRIED):
            if wanted == 0:
                break
            found.append(vet(simulator, scenario, seed, view))
            wanted -= found[-1].why is None
            if progress is not None:
                progress(sum(one.why is None for one in found), episodes)
        if wanted:
            why = next(one.why for one in reversed(found) if one.why)
            raise SpecError(
                f"'{name}' has too few worlds of '{scenario}' that pass the checks, among seeds 0 to "
                f"{_SEEDS_TRIED - 1}; the last failed at {why}"
            )
    return tuple(found)


def write_vetting(out: Path, vetted: tuple[Vetted, ...]) -> None:
    """Write which worlds were tried, and how they came out, into the run's folder."""
    out.mkdir(parents=True, exist_ok=True)
    partial = out / f".{VETTING}"
    partial.write_text(json.dumps([asdict(one) for one in vetted], indent=1) + "\n", encoding="utf-8")
    partial.replace(out / VETTING)


def read_vetting(out: Path) -> tuple[Vetted, ...] | None:
    """Return the vetting of a run's folder, None where there is none; raises LedgerError where it is none."""
    file = out / VETTING
    if not file.is_file():
        return None
    try:
        found = build(tuple[Vetted, ...], json.loads(file.read_text(encoding="utf-8")))
    except (ValueError, RecursionError) as error:
        raise LedgerError(f"{file} is no record of vetted worlds: {error}") from error
    if not any(one.why is None for one in found):
        raise LedgerError(f"{file} is no record of vetted worlds: it has none that passed; choose another --out")
    return found


EPISODES = 12
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
    shown = view_for(view, world.camera or world.name)
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
    """What came of an online run, by estimator, how its worlds were vetted, and for which several models answered."""

    manifest: EpisodesManifest
    vetted: tuple[Vetted, ...]
    driven: Mapping[str, Driven]
    served: Mapping[str, ServedGuard] = field(default_factory=dict)

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
            "served": plain(self.served),
        }


def score(path: Path) -> OnlineScore:
    """Score the online run in a folder, finished or not; raises LedgerError where it holds none."""
    vetted = read_vetting(path)
    if vetted is None:
        raise LedgerError(f"{path} holds no online run; 'eyechart run online' makes one")
    manifest, found = read_manifest(path), list(read_episodes(path))
    passed = [one for one in vetted if one.why is None]
    worlds = {(one.scenario, one.seed) for one in passed}
    decisions = sum((Counter(one.actions) for one in passed), Counter[str]())
    driven = {CONTROL: Driven(rate(sum(one.ended == "crash" for one in passed), len(passed)), dict(decisions), 0, 0)}
    for spec in manifest.policies:
        mine = {one.key: one for one in found if one.key.policy == spec and (one.key.scenario, one.key.seed) in worlds}
        driven[spec] = _driven(list(mine.values()))
    return OnlineScore(manifest, vetted, driven, served_of(path))


def _driven(episodes: Sequence[Episode]) -> Driven:
    good = [one for one in episodes if one.ended != "error"]
    taken = [step.decision.action for one in good for step in one.steps]
    return Driven(
        crash_rate=rate(sum(one.crashed for one in good), len(good)),
        decisions=dict(Counter(action for action in taken if action is not None)),
        fail_safe=sum(action is None for action in taken),
        errors=len(episodes) - len(good),
    )
