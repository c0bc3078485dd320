"""Worlds in a worker: each drives one episode, shows its camera's picture, and keeps its record."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from eyechart.conditions import show
from eyechart.episodes.records import Episode, EpisodeKey, Step
from eyechart.errors import SpecError
from eyechart.frames import (
    AS_STORED,
    ENCODINGS,
    MAIN,
    RGB,
    Frame,
    PictureEncoding,
    Scalar,
    Stimulus,
    alone,
    decode,
    encode,
    rounded_truth,
)
from eyechart.modes import in_one_line
from eyechart.policies import Observation, Policy, open_policy
from eyechart.records import LARGEST
from eyechart.seeds import key_seed
from eyechart.simulators import SIMULATORS, Drive, Simulator, StepResult, execute, open_simulator
from eyechart.spaces.space import Decision

MAX_STEPS = 1000
POOL_SEEDS = (1000, 1001, 1002)
"""The seeds of worlds whose pictures ``shuffled`` shows; an episode in one of them gets those of
the others."""

_POOL_STEPS = 60
_DETAIL = 500


@dataclass(frozen=True, slots=True)
class Setup:
    """The settings from which a worker makes a run's worlds.

    ``simulators`` is the registry of the process that began the run, and ``seed`` the run's. After
    ``max_steps`` decisions, an episode that has not ended is an error. ``actions`` is the action
    map of ``gym:``. ``silence`` is one of `SILENCES`: whether a model's silence executes the
    fail-safe. With ``reflected``, models also get each picture's reflection; a resumed run keeps
    its first setting.
    """

    simulator: str
    seed: int = 0
    max_steps: int = MAX_STEPS
    actions: Path | None = None
    silence: str = "unfinished"
    reflected: bool = False
    simulators: Mapping[str, str] = field(default_factory=lambda: dict(SIMULATORS))


@dataclass(frozen=True, slots=True)
class EpisodeView:
    """A moment's stimulus for a model, under the episode's condition."""

    frame: str
    step: int
    stimulus: Stimulus


class Worlds:
    """The worlds of one worker, by the keys of their episodes."""

    def __init__(self, setup: Setup) -> None:
        SIMULATORS.update(setup.simulators)
        self._setup = setup
        self._simulator = open_simulator(setup.simulator, actions=setup.actions)
        self._rollouts: dict[EpisodeKey, _Rollout] = {}
        self._pool = _Pool(self._simulator, setup.seed)

    def drive(self, key: EpisodeKey, policy: Policy, alive: Callable[[], None] = lambda: None) -> Episode:
        """Let a policy that is no model drive an episode; ``alive`` is called at every step."""
        rollout = self._begin(key)
        while rollout.over is None:
            alive()
            rollout.decide(lambda: policy.decide(rollout.observe()))
        return rollout.over

    def open(self, key: EpisodeKey) -> EpisodeView | Episode:
        """Begin an episode with outside decisions; return the first picture, or its failure."""
        self._rollouts[key] = self._begin(key)
        return self._shown(key)

    def act(self, key: EpisodeKey, decision: Decision[str], error: str = "") -> EpisodeView | Episode:
        """Execute a decision; return the next picture, or the episode if it is over.

        ``error`` is the kind of failure of a call without a decision.
        """
        self._rollouts[key].decide(lambda: decision, error)
        return self._shown(key)

    def fail(self, key: EpisodeKey, detail: str) -> Episode:
        """End an episode with an error from outside."""
        return self._rollouts.pop(key).end("error", detail)

    def close(self, key: EpisodeKey) -> None:
        """Leave an episode that is not driven on; an unknown key is ignored."""
        if key in self._rollouts:
            self.fail(key, "left")

    def _begin(self, key: EpisodeKey) -> "_Rollout":
        return _Rollout(key, self._simulator, self._pool, self._setup)

    def _shown(self, key: EpisodeKey) -> EpisodeView | Episode:
        shown = self._rollouts[key].shown()
        if isinstance(shown, Episode):
            del self._rollouts[key]
        return shown


class _Rollout:
    """An episode under way. Any error of its world or its policy ends it as an error."""

    def __init__(self, key: EpisodeKey, simulator: Simulator, pool: "_Pool", setup: Setup) -> None:
        self.over: Episode | None = None
        self._key, self._simulator, self._pool, self._setup = key, simulator, pool, setup
        self._steps: list[Step] = []
        self._drive: Drive | None = None
        self._truth: Mapping[str, Scalar] = {}
        try:
            self._drive = simulator.drive(key.scenario, key.seed)
            self._first = _checked(self._drive.picture(), first=True)
            self._look()
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a world that fails is a record, not the end of a run
            self.end("error", in_one_line(error, _DETAIL))

    def observe(self) -> Observation:
        """Return the moment as a policy that is no model gets it."""
        frame = self._key.frame(len(self._steps))
        return Observation(
            frame=frame,
            step=len(self._steps),
            picture=self._pixels,
            truth=self._truth,
            action_space=self._simulator.declared.action_space,
            seed=key_seed("policy", self._setup.seed, self._key.policy, frame),
        )

    def shown(self) -> EpisodeView | Episode:
        """Return the moment as a model gets it, or the episode if it is over."""
        if self.over is not None:
            return self.over
        try:
            return EpisodeView(self._key.frame(len(self._steps)), len(self._steps), self._stimulus())
        except (Exception, SystemExit) as error:  # noqa: BLE001 - as above
            return self.end("error", in_one_line(error, _DETAIL))

    def decide(self, decide: Callable[[], Decision[str]], error: str = "") -> None:
        """Take a decision and drive on; without a decision the fail-safe is executed."""
        if self.over is not None:
            return
        try:
            self._execute(decide(), error)
        except (Exception, SystemExit) as raised:  # noqa: BLE001 - as above
            self.end("error", in_one_line(raised, _DETAIL))

    def end(self, ended: str, detail: str = "") -> Episode:
        """Close the world and return the record."""
        digest = ""
        if self._drive is not None:
            digest = _digest(self._drive) or ""
            with suppress(Exception):
                self._drive.close()
        self._drive = None
        self.over = Episode(self._key, tuple(self._steps), ended, digest, detail)
        return self.over

    def _execute(self, decision: Decision[str], error: str) -> None:
        assert self._drive is not None
        executed = decision.action if decision.action is not None else self._simulator.declared.fail_safe
        moved = execute(self._drive, executed, decided=decision.action is not None)
        _require_finite(moved)
        number = len(self._steps)
        self._steps.append(
            Step(
                step=number,
                frame=self._key.frame(number),
                decision=decision,
                executed_action=executed,
                truth=self._truth,
                reward=moved.reward,
                speed_mps=moved.speed_mps,
                distance_m=moved.distance_m,
                crashed=moved.crashed,
                facts=rounded_truth(moved.facts, self._key.frame(number)),
                error=error,
                rounded_state_sha256=_digest(self._drive, 3),
            )
        )
        if moved.ended is not None:
            self.end(moved.ended)
        elif len(self._steps) >= self._setup.max_steps:
            self.end("error", f"it did not end within {self._setup.max_steps} steps")
        else:
            self._look()

    def _look(self) -> None:
        assert self._drive is not None
        self._truth = rounded_truth(self._drive.truth(), self._key.frame(len(self._steps)))

    def _stimulus(self) -> Stimulus:
        """Return this moment's stimulus under the episode's condition."""
        assert self._drive is not None
        key, drive, step = self._key, self._drive, len(self._steps)
        cameras = alone(self._simulator.declared.mirror_axis)
        now = Frame(key.frame(step), key.scenario, key.world, step, cameras, {MAIN: "the camera's picture"})
        real = drive.picture if step else lambda: self._first
        return show(key.condition, now, _Moment(now, real, self._first, self._pool, key), self._setup.seed)

    def _pixels(self) -> RGB | None:
        """Return this moment's picture for a policy, or None if the condition shows none."""
        image = self._stimulus().images.get(MAIN)
        return None if image is None else decode(image, "the camera's picture")


@dataclass(frozen=True)
class _Moment:
    """One moment of a drive as a source of pictures: now, the first one, and other worlds'."""

    now: Frame
    real: Callable[[], RGB]
    first: RGB
    pool: "_Pool"
    key: EpisodeKey
    frames: tuple[Frame, ...] = ()
    said: tuple[str, ...] = ()
    encoding: PictureEncoding = ENCODINGS[AS_STORED]

    @property
    def scenarios(self) -> Mapping[str, tuple[Frame, ...]]:
        others = range(len(self.pool.pictures(self.key.scenario, self.key.seed)))
        return {self.now.scenario: (*(replace(self.now, id=str(other), step=other) for other in others), self.now)}

    @property
    def places(self) -> Mapping[str, int]:
        return {self.now.id: len(self.pool.pictures(self.key.scenario, self.key.seed))}

    def alike(self, frame: Frame) -> tuple[Sequence[Frame], Sequence[int]]:
        del frame
        return (), ()  # a drive states no text of a bank

    def images(self, frame: Frame, counterfactual: str | None = None) -> Mapping[str, bytes]:
        if frame.id != self.now.id:
            return {MAIN: self.pool.pictures(self.key.scenario, self.key.seed)[frame.step]}
        return {MAIN: encode(self.first if counterfactual else _checked(self.real()))}

    def shapes(self, frame: Frame) -> Mapping[str, tuple[int, ...]]:
        del frame
        return {MAIN: self.first.shape}


class _Pool:
    """Pictures of a scenario's other worlds, driven by the oracle, or at random without scenes."""

    def __init__(self, simulator: Simulator, seed: int) -> None:
        self._simulator, self._seed = simulator, seed
        self._driven = lru_cache(maxsize=None)(self._drive)

    def pictures(self, scenario: str, seed: int) -> Sequence[bytes]:
        """Return the pictures of a scenario's pool, but for those of the world with this seed."""
        return [picture for other in POOL_SEEDS if other != seed for picture in self._driven(scenario, other)]

    def _drive(self, scenario: str, seed: int) -> tuple[bytes, ...]:
        drive = self._simulator.drive(scenario, seed)
        key = EpisodeKey("pool", self._simulator.declared.name, scenario, seed)
        pictures: list[bytes] = []
        try:
            while len(pictures) < _POOL_STEPS:
                pictures.append(encode(_checked(drive.picture())))
                if drive.step(self._choose(drive, key.frame(len(pictures) - 1))).ended is not None:
                    break
        finally:
            drive.close()
        return tuple(pictures)

    def _choose(self, drive: Drive, frame: str) -> str:
        space = self._simulator.declared.action_space
        moment = Observation(frame, 0, drive.picture, drive.truth(), space, key_seed("pool", self._seed, frame))
        for spec in ("oracle", "random"):
            with suppress(SpecError):
                action = open_policy(spec, space, lambda _: {}).decide(moment).action
                assert action is not None
                return action
        raise AssertionError("a random policy always decides")


def _checked(picture: object, *, first: bool = False) -> RGB:
    """Return a camera's picture; raises SpecError if it is none, or shows nothing."""
    if not isinstance(picture, np.ndarray) or picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3:
        found = f"{picture.dtype} {picture.shape}" if isinstance(picture, np.ndarray) else type(picture).__name__
        raise SpecError(f"the camera's picture is no RGB picture of shape (h, w, 3) and uint8, but {found}")
    if not picture.size or not picture.any():
        raise SpecError("the camera shows black only, as a renderer without a display does (unset SDL_VIDEODRIVER)")
    if first and (picture == picture[0, 0]).all():
        raise SpecError(f"the camera shows one colour only, {picture[0, 0].tolist()}: its renderer draws nothing")
    return picture


def _digest(drive: Drive, decimals: int | None = None) -> str | None:
    with suppress(Exception):
        return hashlib.sha256(drive.state(decimals)).hexdigest()
    return None


def _require_finite(moved: StepResult) -> None:
    for name in ("reward", "speed_mps", "distance_m"):
        value = getattr(moved, name)
        if not (value is None and name != "reward") and not abs(value) <= LARGEST:
            raise SpecError(f"the world's {name} is {value}, not a number up to {LARGEST:g}")
