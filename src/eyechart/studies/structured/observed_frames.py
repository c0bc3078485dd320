"""The frames that estimators saw online, checked as worlds are vetted, and their figures.

Source: paper, section Constructive renderer-calibrated controller (the online diagnostic retains
the same gate, and online frames additionally pass renderer-integrity and positive-control checks).
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from eyechart.calls import CallKey, Reply
from eyechart.conditions import flip
from eyechart.episodes import Episode, EpisodesManifest, Step
from eyechart.errors import BankError, LedgerError, SpecError, raising
from eyechart.frames import RGB, Frame, Scalar, alone, encode
from eyechart.models.scripted import see
from eyechart.perception.forward import distances_of
from eyechart.perception.view import View
from eyechart.records import JsonRecord, build, parse_json
from eyechart.run import Progress
from eyechart.simulators import Drive, PartialView, Simulator, declared_by, execute
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.scene import SCENES, Estimate, Scene
from eyechart.stats.statistic import Statistic
from eyechart.studies.structured.scene_answers import scene_answers_of
from eyechart.studies.structured.scores import Bootstrap, Figures

SEEN = "seen.json"
GAP_ERROR_M = 0.1
"""Half a pixel of highway-env's picture is 0.091 m."""

SIDES_RIGHT = 0.9
"""Between two lanes the reading of a side may differ from the truth for a moment."""


@dataclass
class FrameChecks:
    """The results of the checks by frame; ``failed`` is the first fault that fails a world."""

    frames: int = 0
    errors_m: list[float] = field(default_factory=list)
    actions: Counter[str] = field(default_factory=Counter)
    sides_right: int = 0
    unseen: int = 0
    failed: str | None = None

    def look(self, drive: Drive, pixels: RGB, view: View | None, axis: str) -> str | None:
        """Check a frame as a model sees it; return the safe action of its scene, if any."""
        self.frames += 1
        sides = (pixels, flip(pixels, axis))
        shown, reflected = (np.ascontiguousarray(side if view is None else view.show(side)) for side in sides)
        reading, mirrored = see(encode(shown)).reading, see(encode(reflected)).reading
        if reading is None:
            self._fail("renderer integrity: no road with a vehicle is seen")
            return None
        scene = reading.scene
        if mirrored is None or mirrored.scene != scene.mirrored():
            self._fail("positive control: the reflection is read differently")
        self._compare(scene, drive.truth(), drive.unseen_sides() if isinstance(drive, PartialView) else frozenset())
        action = Estimate.of(scene).act(scene.distances)
        self.actions[action] += 1
        return action

    def _compare(self, scene: Scene, truth: Mapping[str, Scalar], unseen: frozenset[str]) -> None:
        gap_m = truth["lead_gap_m"] if truth.get("lead_visible") is not False else None
        if isinstance(gap_m, bool | str):
            raise SpecError(f"the world gives the gap {gap_m!r}, which is no number")
        if (gap_m is None) != (scene.gap_m is None):
            self._fail("positive control: a lead is read and not there, or there and not read")
        elif gap_m is not None and scene.gap_m is not None:
            self.errors_m.append(abs(scene.gap_m - gap_m))
            if self.errors_m[-1] > GAP_ERROR_M:
                self._fail(f"positive control: the gap is read {self.errors_m[-1]:.2f} m off")
        self.unseen += bool(unseen)
        read = {"left": scene.left_clear, "right": scene.right_clear}
        self.sides_right += all(side in unseen or clear == truth[f"{side}_clear"] for side, clear in read.items())

    @property
    def gap_mae_m(self) -> float | None:
        """Return the mean absolute error of the gap, in metres, None without a lead."""
        return float(np.mean(self.errors_m)) if self.errors_m else None

    def whole(self) -> str | None:
        """Return why the frames do not pass, sides included; None where they do."""
        if self.failed is None and self.sides_right < SIDES_RIGHT * self.frames:
            return f"positive control: the sides are read right on {self.sides_right} of {self.frames} frames"
        return self.failed

    def _fail(self, why: str) -> None:
        self.failed = self.failed or f"frame {self.frames - 1}: {why}"


@dataclass(frozen=True, slots=True)
class ObservedFrames(JsonRecord):
    """The checked frames of one episode that an estimator drove.

    ``why`` is None where every frame passes. ``frames`` were checked. ``gap_mae_m`` is the positive
    control's error over frames with a lead in the picture, None without one.
    """

    policy: str
    scenario: str
    seed: int
    frames: int
    gap_mae_m: float | None
    why: str | None = None


def check(simulator: Simulator, episode: Episode, view: View | None) -> ObservedFrames:
    """Replay an episode by its executed actions, and check every frame of its estimator.

    Renderer integrity and the positive control are those of `online.check_world`.
    """
    key, checks = episode.key, FrameChecks()
    drive = simulator.drive(key.scenario, key.seed)
    try:
        for step in episode.steps:
            pixels = drive.picture()
            if (pixels == pixels[0, 0]).all():
                checks.failed = f"frame {checks.frames}: renderer integrity: the picture has one colour"
                break
            if not _has_same_gap(step, drive.truth()):
                checks.failed = f"frame {checks.frames}: the world does not repeat itself: its gap is another one now"
                break
            if checks.look(drive, pixels, view, simulator.declared.mirror_axis) is None:
                break
            execute(drive, step.executed_action, decided=step.decision.action is not None)
    except (BankError, KeyError) as error:
        checks.failed = f"frame {checks.frames}: renderer integrity: {error}"
    finally:
        drive.close()
    return ObservedFrames(key.policy, key.scenario, key.seed, checks.frames, checks.gap_mae_m, checks.whole())


def _has_same_gap(step: Step, truth: Mapping[str, Scalar]) -> bool:
    """Return whether a step has its recorded gap, to 3 decimals."""
    before, now = step.truth.get("lead_gap_m"), truth["lead_gap_m"]
    if isinstance(before, int | float) and isinstance(now, int | float):
        return abs(before - now) < _ROUNDED
    return before == now


_ROUNDED = 0.002


def check_all(
    out: Path, simulator: Simulator, episodes: Sequence[Episode], view: View | None, progress: Progress | None = None
) -> tuple[ObservedFrames, ...]:
    """Check the unchecked episodes of a run, and write all results into the run's folder."""
    found = {(one.policy, one.scenario, one.seed): one for one in read_seen(out)}
    for done, episode in enumerate(episodes, 1):
        key = episode.key
        if (place := (key.policy, key.scenario, key.seed)) not in found:
            found[place] = check(simulator, episode, view)
        if progress is not None:
            progress(done, len(episodes))
    partial = out / f".{SEEN}"
    partial.write_text(json.dumps([asdict(one) for one in found.values()], indent=1) + "\n", encoding="utf-8")
    partial.replace(out / SEEN)
    return tuple(found.values())


def read_seen(out: Path) -> tuple[ObservedFrames, ...]:
    """Return the checked frames of a run, empty where none were.

    Raises LedgerError where the file is no such record.
    """
    file = out / SEEN
    if not file.is_file():
        return ()
    again = "; run the same command again"
    with raising(LedgerError, f"{file} is no record of checked frames", again, of=(ValueError, RecursionError)):
        return build(tuple[ObservedFrames, ...], parse_json(file.read_text(encoding="utf-8")))


def figures(
    manifest: EpisodesManifest, episodes: Sequence[Episode], replies: Iterable[tuple[CallKey, Reply]]
) -> dict[str, Statistic]:
    """Return the static battery's figures of one estimator, over all frames of its drives."""
    declared = declared_by(manifest.simulator)
    axis = "vertical" if declared is None else declared.mirror_axis
    distances = distances_of("" if declared is None else declared.camera)
    frames = tuple(
        Frame(step.frame, episode.key.scenario, episode.key.world, step.step, alone(axis), {}, step.truth)
        for episode in episodes
        for step in episode.steps
    )
    gaps = [gap if isinstance(gap := frame.truth.get("lead_gap_m"), int | float) else np.inf for frame in frames]
    space = SCENES.by(manifest.reader).in_world(distances)
    answers = scene_answers_of(replies, frames, np.array(gaps, dtype=np.float64), distances.close_m, space)
    every = np.ones(len(frames), dtype=np.bool_)
    worlds = np.array([frame.episode for frame in frames], dtype=np.str_)
    return Figures(answers, DRIVING, every, Bootstrap(worlds)).statistics()
