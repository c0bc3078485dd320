"""Scenarios, seeds and steps become a bank on disk: what the staged banks of all simulators have in common."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from pathlib import Path

from eyechart.errors import SpecError
from eyechart.frames import (
    MAIN,
    RGB,
    BankManifest,
    BankWriter,
    Frame,
    FrameBank,
    Gap,
    MirrorAxis,
    Scalar,
    alone,
    encode,
    open_bank,
)
from eyechart.simulators import Declaration
from eyechart.simulators.plan import LEAST_STEPS

MOST_SEED = 2**63 - 1


@dataclass(frozen=True, slots=True)
class Moment:
    """A picture (h, w, 3), its ground truth, and its counterfactual pictures by name."""

    truth: Mapping[str, Scalar]
    picture: RGB
    counterfactuals: Mapping[str, RGB]


def check_seed(seed: int) -> None:
    """Raise SpecError for a seed that is out of range."""
    if not 0 <= seed <= MOST_SEED:
        raise SpecError(f"seed {seed} is out of range; give seeds from 0 to {MOST_SEED}")


def versions_of(names: Sequence[str]) -> dict[str, str]:
    """Return the versions of those of these libraries that are installed."""
    found = {}
    for name in names:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


@dataclass(frozen=True)
class Preset:
    """What a preset's banks hold.

    ``scenarios`` map each name to what a manifest records of it, ``moments(scenario, seed, steps)`` are those of an
    episode, and ``settings`` what else is recorded.
    """

    scenarios: Mapping[str, object]
    moments: Callable[[str, int, int], Iterator[Moment]]
    gap: Gap
    settings: Mapping[str, object] = field(default_factory=dict)


class BankMaker(ABC):
    """The part of a simulator that makes banks of its presets."""

    declared: Declaration

    @abstractmethod
    def open_preset(self, name: str) -> Preset:
        """Return what the banks of a preset hold."""

    @abstractmethod
    def versions(self) -> dict[str, str]:
        """Return the versions of what makes this world."""

    def build(
        self,
        out: Path,
        *,
        preset: str = "balanced",
        seeds: Sequence[int] = (0, 1, 2),
        steps: int = 12,
        progress: Callable[[int, int], None] | None = None,
    ) -> FrameBank:
        """Write a bank of the preset's scenarios × ``seeds`` × ``steps`` frames into ``out``.

        ``progress`` gets the number of frames written and their total. Raises SpecError for an unknown preset,
        seeds that are negative, doubled or missing, and too few steps; BankError where ``out`` is taken.
        """
        declared, seeds = self.declared, [int(seed) for seed in seeds]
        if preset not in declared.presets:
            known = ", ".join(declared.presets)
            raise SpecError(f"simulator '{declared.name}' has no preset '{preset}'; known: {known}")
        _require(seeds, steps)
        made = self.open_preset(preset)
        manifest = BankManifest(
            simulator=declared.name,
            preset=preset,
            picture=declared.picture,
            action_space=declared.action_space,
            gap=made.gap,
            settings={"seeds": seeds, "steps": steps, "scenarios": dict(made.scenarios), **made.settings},
            versions=self.versions(),
        )
        episodes = list(product(made.scenarios, seeds))
        with BankWriter(out, manifest) as writer:
            for number, (scenario, seed) in enumerate(episodes):
                for step, moment in enumerate(made.moments(scenario, seed, steps)):
                    episode, axis = f"{scenario}-{seed}", declared.mirror_axis
                    _write(writer, moment, scenario=scenario, episode=episode, step=step, axis=axis)
                    if progress is not None:
                        progress(number * steps + step + 1, len(episodes) * steps)
        return open_bank(out)


def _require(seeds: Sequence[int], steps: int) -> None:
    if not seeds:
        raise SpecError("a bank needs at least one seed")
    for seed in seeds:
        check_seed(seed)
        if seeds.count(seed) > 1:
            raise SpecError(f"seed {seed} is given twice; each seed is an episode of its own")
    if steps < LEAST_STEPS:
        raise SpecError(f"an episode needs {LEAST_STEPS} steps or more to hold every kind of moment, not {steps}")


def _write(writer: BankWriter, moment: Moment, *, scenario: str, episode: str, step: int, axis: MirrorAxis) -> None:
    frame_id = f"{episode}-{step:02d}"
    frame = Frame(
        id=frame_id,
        scenario=scenario,
        episode=episode,
        step=step,
        cameras=alone(axis),
        pictures={MAIN: f"images/{frame_id}.png"},
        truth=moment.truth,
        counterfactuals={name: {MAIN: f"counterfactuals/{frame_id}-{name}.png"} for name in moment.counterfactuals},
    )
    drawn = {name: {MAIN: encode(picture)} for name, picture in moment.counterfactuals.items()}
    writer.add(frame, {MAIN: encode(moment.picture)}, drawn)
