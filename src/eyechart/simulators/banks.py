"""Scenarios, seeds and steps become a bank on disk: what the staged banks of all simulators have in common."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from eyechart.errors import SpecError
from eyechart.frames import (
    MAIN,
    RGB,
    BankManifest,
    BankWriter,
    Frame,
    FrameBank,
    MirrorAxis,
    Scalar,
    alone,
    encode,
    open_bank,
)
from eyechart.simulators.plan import LEAST_STEPS

MOST_SEED = 2**63 - 1


@dataclass(frozen=True, slots=True)
class Moment:
    """A picture (h, w, 3), its ground truth, and its counterfactual pictures by name."""

    truth: Mapping[str, Scalar]
    picture: RGB
    counterfactuals: Mapping[str, RGB]


@dataclass(frozen=True, slots=True)
class Asked:
    """What a bank was asked to hold."""

    simulator: str
    preset: str
    seeds: tuple[int, ...]
    steps: int

    def check(self, presets: Mapping[str, object]) -> None:
        """Raise SpecError for an unknown preset, seeds that are negative, doubled or missing, and too few steps."""
        if self.preset not in presets:
            raise SpecError(f"simulator '{self.simulator}' has no preset '{self.preset}'; known: {', '.join(presets)}")
        if not self.seeds:
            raise SpecError("a bank needs at least one seed")
        for seed in self.seeds:
            check_seed(seed)
            if self.seeds.count(seed) > 1:
                raise SpecError(f"seed {seed} is given twice; each seed is an episode of its own")
        if self.steps < LEAST_STEPS:
            raise SpecError(
                f"an episode needs {LEAST_STEPS} steps or more to hold every kind of moment, not {self.steps}"
            )

    def settings(self, scenarios: Mapping[str, object]) -> dict[str, object]:
        """Return what a manifest records of it."""
        return {"seeds": list(self.seeds), "steps": self.steps, "scenarios": dict(scenarios)}


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


def write_bank(
    out: Path,
    manifest: BankManifest,
    asked: Asked,
    *,
    scenarios: Sequence[str],
    moments: Callable[[str, int, int], Iterator[Moment]],
    axis: MirrorAxis,
    progress: Callable[[int, int], None] | None,
) -> FrameBank:
    """Write the ``moments(scenario, seed, steps)`` of every scenario and seed; an episode is one of each."""
    total = len(scenarios) * len(asked.seeds) * asked.steps
    done = 0
    with BankWriter(out, manifest) as writer:
        for scenario in scenarios:
            for seed in asked.seeds:
                for step, moment in enumerate(moments(scenario, seed, asked.steps)):
                    _write(writer, moment, scenario=scenario, episode=f"{scenario}-{seed}", step=step, axis=axis)
                    done += 1
                    if progress is not None:
                        progress(done, total)
    return open_bank(out)


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
