"""Frame banks from scenarios, seeds and steps: the part that all simulators share."""

import shutil
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice, product
from pathlib import Path
from typing import TypeVar

import numpy as np

from eyechart.conditions import CONTROLS
from eyechart.errors import BankError, SpecError, suggestion
from eyechart.frames import (
    MAIN,
    RGB,
    BankManifest,
    BankWriter,
    Camera,
    Controls,
    Draws,
    Frame,
    FrameBank,
    Gap,
    Scalar,
    Span,
    alone,
    draws_of,
    encode_sound,
    open_bank,
)
from eyechart.records import build as build_record
from eyechart.seeds import key_seed
from eyechart.simulators import SIMULATORS, Declaration, open_bank_simulator
from eyechart.simulators.plan import LEAST_STEPS
from eyechart.spaces.motion import MotionSpace

T = TypeVar("T")

MOST_SEED = 2**63 - 1
ShownPictures = RGB | Mapping[str, RGB]
"""The picture of the only camera, or the pictures of several cameras by name."""


@dataclass(frozen=True, slots=True)
class ControlPictures:
    """Control pictures (h, w, 3) by name, and the vehicles' distances in them in the gap's unit."""

    pictures: Mapping[str, RGB] = field(default_factory=dict)
    distances: Mapping[str, float] = field(default_factory=dict)


def _none(_: Draws, __: np.random.Generator) -> ControlPictures:
    """Draw no controls."""
    return ControlPictures()


@dataclass(frozen=True, slots=True)
class Moment:
    """A picture (h, w, 3), its ground truth, and its counterfactual pictures by name.

    ``ranged`` draws the moment's control pictures, at distances of the whole range, with a
    generator of its own. Call it before the next moment is taken: until then the world is
    unchanged. ``distances`` holds the lead's distance in each counterfactual. If a preset has
    several cameras, a picture is a mapping with one picture for each camera. ``fields``, ``state``,
    ``motion`` and ``strata`` are those of the frame.
    """

    truth: Mapping[str, Scalar]
    picture: ShownPictures
    counterfactuals: Mapping[str, ShownPictures]
    fields: Mapping[str, Scalar] = field(default_factory=dict)
    state: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    motion: tuple[tuple[float, ...], ...] = ()
    ranged: Callable[[Draws, np.random.Generator], ControlPictures] = _none
    distances: Mapping[str, float] = field(default_factory=dict)
    strata: Mapping[str, Scalar] = field(default_factory=dict)


def first_shown(draw: Callable[[float], T | None], distances: Iterable[float]) -> tuple[float, T] | None:
    """Return the first distance that can be drawn, with its drawing, or None."""
    shown = ((distance, draw(distance)) for distance in distances)
    return next(((one, made) for one, made in shown if made is not None), None)


def check_seed(seed: int) -> None:
    """Raise SpecError for a seed that is out of range."""
    if not 0 <= seed <= MOST_SEED:
        raise SpecError(f"seed {seed} is out of range; give seeds from 0 to {MOST_SEED}")


def versions_of(names: Sequence[str]) -> dict[str, str]:
    """Return the versions of the installed ones among these libraries."""
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415 - slow to import

    versions = {}
    for name in names:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    return versions


@dataclass(frozen=True)
class Preset:
    """The contents of a preset's banks.

    ``scenarios`` maps each name to its record in the manifest. ``moments(scenario, seed, steps)``
    yields the moments of an episode, and ``settings`` holds further records. ``gap`` is None if
    there is no vehicle ahead. ``cameras``, ``prompt_columns``, ``state`` and ``motion`` are those
    of the manifest; without ``cameras`` there is one camera. ``span`` runs from the lowest distance
    of the lead that can be shown to the farthest one. It is None if no pictures are drawn over a
    range. ``staged`` holds the moments of later versions of the staging if they differ.
    """

    scenarios: Mapping[str, object]
    moments: Callable[[str, int, int], Iterator[Moment]]
    gap: Gap | None
    settings: Mapping[str, object] = field(default_factory=dict)
    cameras: tuple[Camera, ...] = ()
    prompt_columns: tuple[str, ...] = ()
    state: tuple[str, ...] = ()
    motion: MotionSpace | None = None
    span: Span | None = None
    staged: Mapping[int, Callable[[str, int, int], Iterator[Moment]]] = field(default_factory=dict)

    def staging(self, version: int) -> tuple[int, Callable[[str, int, int], Iterator[Moment]]]:
        """Return the version that introduced a staging version's moments, and these moments."""
        since = max((one for one in self.staged if one <= version), default=DOZENS)
        return since, self.staged.get(since, self.moments)


DOZEN = 12
"""Number of moments that are staged together."""

DOZENS = 2
"""The first staging version with a number in manifests. In the version before it, the moments of an
episode of more than `DOZEN` steps differed from those of a shorter one."""

BOXED = 3
"""The staging version in which a sixth of the moments have no clear side. Its ``lead_near`` is as
near as can be shown."""

STAGING = BOXED
"""The default staging version."""


def by_dozens(stage: Callable[[str, int, int], Iterator[Moment]]) -> Callable[[str, int, int], Iterator[Moment]]:
    """Return ``stage(scenario, seed, steps)``, extended to episodes longer than `DOZEN`.

    A longer episode begins with the moments of a `DOZEN`. Each further dozen is staged whole with a
    seed of its own and then cut, so that no moment depends on how many follow it. An episode below
    a dozen is planned at its own length: a cut dozen would lack some kinds of moment.
    """

    def moments(scenario: str, seed: int, steps: int) -> Iterator[Moment]:
        yield from stage(scenario, seed, min(steps, DOZEN))
        for turn, left in enumerate(range(steps - DOZEN, 0, -DOZEN), 1):
            yield from islice(stage(scenario, key_seed("dozen", seed, turn), DOZEN), min(left, DOZEN))

    return moments


class BankMaker(ABC):
    """The part of a simulator that makes banks of its presets."""

    declared: Declaration

    @abstractmethod
    def open_preset(self, name: str) -> Preset:
        """Return the contents of a preset's banks."""

    @abstractmethod
    def versions(self) -> dict[str, str]:
        """Return the versions of the libraries behind this world."""

    def build(
        self,
        out: Path,
        *,
        preset: str = "balanced",
        seeds: Sequence[int] = (0, 1, 2),
        steps: int = 12,
        controls_seed: int = 0,
        staging: int = STAGING,
        progress: Callable[[int, int], None] | None = None,
    ) -> FrameBank:
        """Write a bank of the preset's scenarios × ``seeds`` × ``steps`` frames into ``out``.

        ``controls_seed`` draws the distances in the control pictures, and affects nothing else.
        ``staging`` is the version of the moments. ``progress`` gets the number of frames written
        and their total. Raises SpecError for an unknown preset, for negative, repeated or missing
        seeds, and for too few steps. Raises BankError if ``out`` is taken.
        """
        declared, seeds = self.declared, [int(seed) for seed in seeds]
        if preset not in declared.presets:
            known = f"{', '.join(declared.presets)}{suggestion(preset, declared.presets)}"
            raise SpecError(f"simulator '{declared.name}' has no preset '{preset}'; known: {known}")
        _require(seeds, steps)
        check_seed(controls_seed)
        made = self.open_preset(preset)
        how = BankOrigin(preset, tuple(seeds), steps, controls_seed, made.staging(staging)[0])
        manifest = BankManifest(
            simulator=declared.name,
            preset=preset,
            picture=declared.picture,
            action_space=declared.action_space,
            gap=made.gap,
            settings={
                "seeds": seeds,
                "steps": steps,
                "staging": how.staging,
                "scenarios": dict(made.scenarios),
                **made.settings,
            },
            versions=self.versions(),
            controls=Controls(controls_seed),
            cameras=made.cameras,
            prompt_columns=made.prompt_columns,
            state=made.state,
            motion=made.motion,
            span=made.span,
            made="rendered",
        )
        with BankWriter(out, manifest) as writer:
            for number, (frame, picture, others) in enumerate(frames_of(declared, made, how), 1):
                writer.add(
                    frame, encode_pictures(picture), {name: encode_pictures(one) for name, one in others.items()}
                )
                if progress is not None:
                    progress(number, len(made.scenarios) * len(seeds) * steps)
        return open_bank(out)


@dataclass(frozen=True, slots=True)
class BankOrigin:
    """The settings of a build: preset, seeds and steps of episodes, and version of the staging."""

    preset: str
    seeds: tuple[int, ...]
    steps: int
    controls_seed: int = 0
    staging: int = DOZENS


def frames_of(
    declared: Declaration, made: Preset, how: BankOrigin
) -> Iterator[tuple[Frame, ShownPictures, Mapping[str, ShownPictures]]]:
    """Yield the frames of a bank in order, each with its picture and counterfactuals by name."""
    _, moments = made.staging(how.staging)
    episodes = list(product(made.scenarios, how.seeds))
    ids = [_id(*episode, step) for episode in episodes for step in range(how.steps)]
    draws = draws_of(how.controls_seed, made.span, ids)
    cameras = made.cameras or alone(declared.mirror_axis)
    for scenario, seed in episodes:
        for step, moment in enumerate(moments(scenario, seed, how.steps)):
            key = how.preset, scenario, seed, step, how.controls_seed
            rng = np.random.default_rng(key_seed(declared.name, "ranged", *key))
            placed = ControlPictures({}, {} if made.span is None else moment.distances)
            drawn = [placed, moment.ranged(draws[_id(scenario, seed, step)], rng)]
            whole = moment if made.span is not None else replace(moment, strata={})
            yield _frame(whole, drawn, (scenario, seed, step), cameras)


def _id(scenario: str, seed: int, step: int) -> str:
    return f"{scenario}-{seed}-{step:02d}"


def _frame(
    moment: Moment, drawn: Sequence[ControlPictures], place: tuple[str, int, int], cameras: tuple[Camera, ...]
) -> tuple[Frame, ShownPictures, Mapping[str, ShownPictures]]:
    """Return a moment as a frame, with its picture and its counterfactuals."""
    scenario, seed, step = place
    pictures, distances = dict[str, ShownPictures](moment.counterfactuals), dict[str, float]()
    for one in drawn:
        pictures |= one.pictures
        distances |= one.distances
    frame_id, names = _id(*place), [camera.name for camera in cameras]
    frame = Frame(
        id=frame_id,
        scenario=scenario,
        episode=f"{scenario}-{seed}",
        step=step,
        cameras=cameras,
        pictures=_files("images", frame_id, names),
        truth={**moment.truth, **distances},
        counterfactuals={name: _files("counterfactuals", f"{frame_id}-{name}", names) for name in pictures},
        fields=moment.fields,
        state=moment.state,
        motion=moment.motion,
        placed=frozenset(distances),
        strata=moment.strata,
    )
    return frame, moment.picture, pictures


def redraw(root: Path, out: Path, controls_seed: int, progress: Callable[[int, int], None] | None = None) -> FrameBank:
    """Write the bank at ``root`` again into ``out``, with control distances of another seed.

    Raises SpecError if no known simulator made the bank, or if it draws no controls. Raises
    BankError if the simulator draws other pictures today. After an error, nothing stays at ``out``.
    """
    bank = open_bank(root)
    made, why = bank.manifest, f"the controls of {root} cannot be drawn again: "
    if made.simulator not in SIMULATORS or not {"seeds", "steps"} <= made.settings.keys():
        raise SpecError(f"{why}it was not built by 'eyechart frames build' from a known simulator")
    simulator = open_bank_simulator(made.simulator)
    how = built_of(bank)
    anew = simulator.build(
        out,
        preset=how.preset,
        seeds=how.seeds,
        steps=how.steps,
        controls_seed=controls_seed,
        staging=how.staging,
        progress=progress,
    )
    if "staging" not in made.settings and how.steps > DOZEN:
        shutil.rmtree(out)
        raise BankError(
            f"{why}an older eyechart staged its episodes of {how.steps} steps differently; build the bank again, or "
            "leave out --fresh-controls"
        )
    if _pictured(anew) != _pictured(bank) or made.fingerprint != anew.manifest.fingerprint:
        shutil.rmtree(out)
        now = ", ".join(f"{name} {version}" for name, version in anew.manifest.versions.items())
        raise BankError(
            f"{why}{now} draw other pictures than the bank has; build the bank again, or leave out --fresh-controls"
        )
    if not anew.manifest.controls.distances:
        shutil.rmtree(out)
        raise SpecError(f"{why}simulator '{made.simulator}' draws no controls")
    return anew


def _pictured(bank: FrameBank) -> dict[str, str]:
    """Return the digest of every picture of a bank by its file, without the control pictures."""
    drawn = {file for one in bank for name in CONTROLS for file in one.counterfactuals.get(name, {}).values()}
    return {file: digest for file, digest in bank.manifest.images.items() if file not in drawn}


def built_of(bank: FrameBank) -> BankOrigin:
    """Return the settings of a bank's build from its manifest; raises ValueError if it has none."""
    made = bank.manifest
    settings = {name: made.settings[name] for name in ("seeds", "steps", "staging") if name in made.settings}
    return build_record(BankOrigin, {"preset": made.preset, **settings, "controls_seed": made.controls.seed or 0})


def _require(seeds: Sequence[int], steps: int) -> None:
    if not seeds:
        raise SpecError("a bank needs at least one seed")
    for seed in seeds:
        check_seed(seed)
        if seeds.count(seed) > 1:
            raise SpecError(f"seed {seed} is given twice; each seed is an episode of its own")
    if steps < LEAST_STEPS:
        raise SpecError(f"an episode needs {LEAST_STEPS} steps or more to contain every kind of moment, not {steps}")


def _files(folder: str, name: str, cameras: Sequence[str]) -> dict[str, str]:
    """Return the files of a picture by camera; several cameras have a folder each."""
    if cameras == [MAIN]:
        return {MAIN: f"{folder}/{name}.png"}
    return {camera: f"{folder}/{camera}/{name}.png" for camera in cameras}


def encode_pictures(picture: ShownPictures) -> dict[str, bytes]:
    """Return a picture as PNGs by camera."""
    by_camera = picture if isinstance(picture, Mapping) else {MAIN: picture}
    return {name: encode_sound(one) for name, one in by_camera.items()}
