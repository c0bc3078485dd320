"""The online run: an estimator's scenes drive through the safety policy, in vetted worlds.

Worlds are vetted before a model drives in them: the picture must be whole, and the scene must be
readable. Source: paper, section Constructive renderer-calibrated controller (renderer-integrity and
positive-control checks); the column of crashes of Table t:controller-local.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from eyechart import episodes as closed_loop
from eyechart.episodes import Bounds, Episode, EpisodesManifest, EpisodesRun, Setup, read_episodes, read_manifest
from eyechart.episodes.coordinator import USUAL
from eyechart.errors import BankError, LedgerError, SpecError, counted, raising
from eyechart.integrity import ServedGuard
from eyechart.ledger import Ledger
from eyechart.limits import RunOutcome
from eyechart.manifest import LEDGER
from eyechart.modes import RequestMode
from eyechart.perception.forward import distances_of
from eyechart.perception.view import View, find_view, view_for
from eyechart.planned_run import Bar, RunAllowance, RunEnding
from eyechart.prompts import scene_prompt
from eyechart.records import JsonRecord, build, parse_json, plain, to_json_fields
from eyechart.run import Progress
from eyechart.simulators import Simulator, open_simulator
from eyechart.stats.agreement import rate
from eyechart.stats.statistic import ModelStatistics, Statistic, not_available
from eyechart.studies.closed_loop import Drives, measured, read_drives, served_of
from eyechart.studies.structured.observed_frames import FrameChecks, ObservedFrames, check_all, figures, read_seen
from eyechart.studies.structured.plans import bound
from eyechart.verdicts import Evidence
from eyechart.verdicts.admission import CLAUSES, ClauseResult, hold

VETTING = "vetting.json"
_MOST_STEPS = 1000
_SEEDS_TRIED = 10


@dataclass(frozen=True, slots=True)
class WorldCheck:
    """The result of vetting a world by a drive of the positive control.

    ``why`` is None where the world passes. ``frames`` were checked, ``ended`` is how the drive
    ended, ``actions`` counts its decisions. ``gap_mae_m`` is the error over frames with a lead in
    the picture, None without one. ``unseen`` counts the frames where a side was blocked by a
    vehicle beside a forward camera, out of its picture.
    """

    scenario: str
    seed: int
    frames: int
    ended: str
    actions: Mapping[str, int]
    gap_mae_m: float | None
    why: str | None = None
    unseen: int = 0


def check_world(simulator: Simulator, scenario: str, seed: int, view: View | None) -> WorldCheck:
    """Let the positive control drive in a world and check every frame of the drive.

    Renderer integrity: the picture fits the view, is not empty, and shows a road with the own
    vehicle. Positive control: the lead is read within 0.1 m of the truth at every frame, its sides
    correctly on 90 % of them, and the reflection exactly equal. A side is not judged where nothing
    in the picture blocks it, because the vehicle stands beside a forward camera.
    """
    checks, ended = FrameChecks(), "time"
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
    why = checks.whole()
    return WorldCheck(scenario, seed, checks.frames, ended, dict(checks.actions), checks.gap_mae_m, why, checks.unseen)


def vet_worlds(
    name: str, episodes: int, view: View | None, progress: Callable[[int, int], None] | None = None
) -> tuple[WorldCheck, ...]:
    """Vet worlds of every scenario in turn, by seed, until ``episodes`` pass; return all tried.

    Raises SpecError where too few pass within ten seeds per scenario.
    """
    simulator = open_simulator(name)
    share, rest = divmod(episodes, len(simulator.declared.scenarios))
    checks: list[WorldCheck] = []
    for number, scenario in enumerate(simulator.declared.scenarios):
        wanted = share + (number < rest)
        for seed in range(_SEEDS_TRIED):
            if wanted == 0:
                break
            checks.append(check_world(simulator, scenario, seed, view))
            wanted -= checks[-1].why is None
            if progress is not None:
                progress(sum(check.why is None for check in checks), episodes)
        if wanted:
            why = next(check.why for check in reversed(checks) if check.why)
            raise SpecError(
                f"'{name}' has too few worlds of '{scenario}' that pass the checks, among seeds 0 to "
                f"{_SEEDS_TRIED - 1}; the last failed at {why}"
            )
    return tuple(checks)


def write_vetting(out: Path, vetted: tuple[WorldCheck, ...]) -> None:
    """Write the vetted worlds and their results into the run's folder."""
    out.mkdir(parents=True, exist_ok=True)
    partial = out / f".{VETTING}"
    partial.write_text(json.dumps([asdict(check) for check in vetted], indent=1) + "\n", encoding="utf-8")
    partial.replace(out / VETTING)


def read_vetting(out: Path) -> tuple[WorldCheck, ...] | None:
    """Return a run folder's vetting, None without one; raises LedgerError for another file."""
    file = out / VETTING
    if not file.is_file():
        return None
    with raising(LedgerError, f"{file} is no record of vetted worlds", of=(ValueError, RecursionError)):
        result = build(tuple[WorldCheck, ...], parse_json(file.read_text(encoding="utf-8")))
    if not any(one.why is None for one in result):
        raise LedgerError(f"{file} is no record of vetted worlds: no world in it passed; choose another --out")
    return result


EPISODES = 12
CONTROL = "positive control (vetting)"
"""The drives that vetted the worlds, as a line of the table."""


@dataclass(frozen=True)
class OnlineRun(EpisodesRun):
    """An online run, planned but not yet driven: its episodes, and the vetting of their worlds."""

    vetted: tuple[WorldCheck, ...] = ()

    @property
    def episodes(self) -> EpisodesRun:
        """Return the run itself, which has the episodes."""
        return self

    def begin(self) -> EpisodesManifest:
        """Begin the run, with the vetted worlds."""
        write_vetting(self.out, self.vetted)
        return super().begin()

    def lines(self, how: RunAllowance) -> Iterator[str]:
        """Yield the refused worlds, the number of episodes, and their expected cost."""
        yield from (
            f"refused: {check.scenario}/{check.seed}: {check.why}" for check in self.vetted if check.why is not None
        )
        yield f"view: {self.manifest.view}"
        yield f"{counted(len(self.keys), 'episode')} in worlds that pass the checks, {len(self.left())} to drive"
        yield from bound(self.manifest.modes.values())
        yield from self.forecast(how)

    def make(self, how: RunAllowance, bar: Bar) -> RunOutcome:
        """Drive the remaining episodes."""
        write_vetting(self.out, self.vetted)
        return super().make(how, bar)

    def ends(self, outcome: RunOutcome, failed: Mapping[str, str]) -> Iterator[RunEnding]:
        """Yield what is left and why, and how many episodes ended in an error."""
        yield closed_loop.drives_ended({"": self}, outcome, failed)
        if errors := sum(one.errors for one in score(self.out).driven.values()):
            yield RunEnding([f"{errors} episodes ended in an error; no number counts them"], 1)


def plan(
    simulator: str | Setup,
    specs: Sequence[str | RequestMode],
    out: Path,
    *,
    view: str | None = None,
    episodes: int = EPISODES,
    seed: int = 0,
    progress: Progress | None = None,
    vetted: tuple[WorldCheck, ...] | None = None,
) -> OnlineRun:
    """Vet worlds, or read the vetting in ``out``, and plan an episode per model and passed world.

    Writes nothing and makes no call. ``progress`` gets (worlds passed, of how many). ``vetted`` is
    an earlier vetting for this plan. ``simulator`` is a name or a `Setup`. A `Setup` also says
    whether the estimator sees the reflection of each picture, as by default; the reflection steers
    nothing. Raises SpecError and LedgerError as a closed loop's plan does, and SpecError where too
    few worlds pass.
    """
    if episodes < 1:
        raise SpecError(f"an online run needs at least 1 episode, got {episodes}")
    setup = simulator if isinstance(simulator, Setup) else Setup(simulator, seed, reflected=True)
    world = open_simulator(setup.simulator).declared
    shown = view_for(view, world.camera or world.name)
    prompt = scene_prompt(world.picture, distances_of(world.camera), shown)

    def planned(seeds: Sequence[int]) -> EpisodesRun:
        return closed_loop.plan(setup, specs, out, seeds=seeds, prompt=prompt, view=shown)

    planned((0,))  # to report faults of the models or the folder before driving the worlds
    checks = read_vetting(out)
    vetted = checks or vetted or vet_worlds(setup.simulator, episodes, shown, progress)
    worlds = [(check.scenario, check.seed) for check in vetted if check.why is None]
    if checks and len(worlds) != episodes:
        raise LedgerError(
            f"this run has {len(worlds)} worlds that passed, now {episodes} episodes were given; "
            "give the same options to resume it, or another --out for another run"
        )
    whole = planned(tuple(dict.fromkeys(number for _, number in worlds)))
    keys = tuple(key for key in whole.keys if (key.scenario, key.seed) in worlds)
    return OnlineRun(**{**vars(whole), "keys": keys}, vetted=vetted)


def run(planned: OnlineRun, *, bounds: Bounds = USUAL, progress: Progress | None = None) -> RunOutcome:
    """Drive the planned episodes that the folder lacks; see `episodes.run`."""
    write_vetting(planned.out, planned.vetted)
    return closed_loop.run(planned, bounds=bounds, progress=progress)


def check_seen(out: Path, progress: Progress | None = None) -> tuple[ObservedFrames, ...]:
    """Check every frame of a run's estimators that was not checked yet; see `observed_frames.check`.

    It replays the worlds and makes no call.
    """
    manifest = read_manifest(out)
    episodes = [episode for episode in read_episodes(out) if episode.ended != "error"]
    return check_all(out, open_simulator(manifest.simulator), episodes, find_view(manifest.view), progress)


@dataclass(frozen=True)
class OnlineResult(JsonRecord):
    """The results of one estimator's episodes: crash rate and decisions.

    ``fail_safe`` counts the steps without an estimate, at which SLOW was executed; they are
    credited to no model. ``errors`` are episodes that ended in an error and count in nothing.
    ``statistics`` are the figures of the static battery over the frames of the drives; empty for
    the vetting.
    """

    crash_rate: Statistic
    decisions: Mapping[str, int]
    fail_safe: int
    errors: int
    statistics: Mapping[str, Statistic] = field(default_factory=dict)

    @property
    def clauses(self) -> tuple[ClauseResult, ...]:
        """Return the clauses of admission, checked on the frames of the drives."""
        return hold(self.statistics) if self.statistics else ()


@dataclass(frozen=True)
class OnlineScore:
    """The results of an online run by estimator, the vetting, and mixed models behind one name."""

    manifest: EpisodesManifest
    vetted: tuple[WorldCheck, ...]
    driven: Mapping[str, OnlineResult]
    served: Mapping[str, ServedGuard] = field(default_factory=dict)
    seen: tuple[ObservedFrames, ...] = ()
    drives: tuple[Drives, ...] = ()

    def left(self, spec: str) -> tuple[int, int]:
        """Return how many episodes an estimator finished, and how many were planned."""
        over = self.driven[spec]
        return over.crash_rate.n + over.errors, sum(check.why is None for check in self.vetted)

    def frames(self, spec: str) -> tuple[bool | None, str]:
        """Return whether an estimator's frames all pass both checks, and why; None if unchecked."""
        mine = [one for one in self.seen if one.policy == spec]
        if faults := [one for one in mine if one.why is not None]:
            first = f"{faults[0].scenario}/{faults[0].seed}: {faults[0].why}"
            return False, f"{len(faults)} of {len(mine)} episodes hold a frame that fails; first {first}"
        frames, driven = sum(one.frames for one in mine), self.driven[spec].crash_rate.n
        if len(mine) < driven or not mine:
            return None, f"the frames of {driven - len(mine)} episodes were not checked: the same command checks them"
        return True, f"renderer integrity and positive control hold on all {frames} frames that it saw"

    def evidence(self) -> dict[str, Evidence]:
        """Return the gate's evidence on every estimator; without frames no clause has a value."""
        result = {}
        for spec in self.manifest.models:
            one, guard = self.driven[spec], self.served.get(spec)
            steps = sum(one.decisions.values()) + one.fail_safe
            nothing = dict.fromkeys(CLAUSES, not_available("the drives have no frame"))
            guards = () if guard is None else (guard,)
            result[spec] = Evidence(spec, one.statistics or nothing, steps, steps, {}, guards)
        return result

    def measured(self) -> tuple[ModelStatistics, ...]:
        """Return the audit and the figures of every estimator in its simulator."""
        return tuple(
            replace(one, statistics={**one.statistics, **self.driven[one.model].statistics})
            for one in measured(self.drives, {})
        )

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            "study": "online",
            **to_json_fields(self.manifest, "simulator view", prompt=self.manifest.prompt.key),
            "worlds": [f"{check.scenario}/{check.seed}" for check in self.vetted if check.why is None],
            "refused": {f"{check.scenario}/{check.seed}": check.why for check in self.vetted if check.why is not None},
            "models": {
                spec: {**one.as_dict(), "clauses": plain(one.clauses), "frames_seen": self._said(spec)}
                for spec, one in self.driven.items()
            },
            "served": plain(self.served),
        }

    def _said(self, spec: str) -> dict[str, object] | None:
        if spec == CONTROL:
            return None
        holds, why = self.frames(spec)
        return {"holds": holds, "because": why, "episodes": [one.as_dict() for one in self.seen if one.policy == spec]}


def score(path: Path) -> OnlineScore:
    """Score the online run in a folder, finished or not; raises LedgerError where it holds none."""
    vetted = read_vetting(path)
    if vetted is None:
        raise LedgerError(f"{path} holds no online run; 'eyechart run online' makes one")
    manifest, found = read_manifest(path), list(read_episodes(path))
    passed = [check for check in vetted if check.why is None]
    worlds = {(check.scenario, check.seed) for check in passed}
    decisions = sum((Counter(check.actions) for check in passed), Counter[str]())
    driven = {
        CONTROL: OnlineResult(rate(sum(check.ended == "crash" for check in passed), len(passed)), dict(decisions), 0, 0)
    }
    with Ledger(path / LEDGER, absent=True) as ledger:
        replies = {spec: list(ledger.replies(spec)) for spec in manifest.models}
    for spec in manifest.policies:
        mine = {one.key: one for one in found if one.key.policy == spec and (one.key.scenario, one.key.seed) in worlds}
        driven[spec] = _driven(list(mine.values()))
        good = [one for one in mine.values() if one.ended != "error"]
        if spec in replies and any(one.steps for one in good):
            driven[spec] = replace(driven[spec], statistics=figures(manifest, good, replies[spec]))
    drives = read_drives([path]) if found else ()
    return OnlineScore(manifest, vetted, driven, served_of(path), read_seen(path), drives)


def _driven(episodes: Sequence[Episode]) -> OnlineResult:
    good = [episode for episode in episodes if episode.ended != "error"]
    taken = [step.decision.action for episode in good for step in episode.steps]
    return OnlineResult(
        crash_rate=rate(sum(episode.has_crashed for episode in good), len(good)),
        decisions=dict(Counter(action for action in taken if action is not None)),
        fail_safe=sum(action is None for action in taken),
        errors=len(episodes) - len(good),
    )
