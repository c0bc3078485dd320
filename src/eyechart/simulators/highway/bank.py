"""Four scenarios, some seeds and some steps become a bank on disk."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from eyechart.actions import DRIVING
from eyechart.errors import SpecError
from eyechart.frames import LEAD_GAP, BankManifest, BankWriter, Frame, FrameBank, encode, open_bank
from eyechart.simulators.highway.declared import MOST_SEED, PICTURE, versions
from eyechart.simulators.highway.driving import DRIVES, drive
from eyechart.simulators.highway.moment import Moment
from eyechart.simulators.highway.plan import LEAST_STEPS
from eyechart.simulators.highway.staging import STAGES, stage
from eyechart.simulators.highway.world import Setting

_PRESETS: Mapping[str, tuple[Mapping[str, Setting], Callable[[str, int, int], Iterator[Moment]]]] = {
    "balanced": (STAGES, stage),
    "paper": (DRIVES, drive),
}


def build_bank(
    out: Path, *, preset: str, seeds: Sequence[int], steps: int, progress: Callable[[int, int], None] | None
) -> FrameBank:
    """Write a bank; see ``Highway.build``."""
    seeds = [int(seed) for seed in seeds]
    _check(preset, seeds, steps)
    settings, moments = _PRESETS[preset]
    manifest = BankManifest(
        simulator="highway",
        preset=preset,
        picture=PICTURE,
        action_space=DRIVING,
        gap=LEAD_GAP,
        settings={
            "seeds": seeds,
            "steps": steps,
            "scenarios": {scenario: setting.as_dict() for scenario, setting in settings.items()},
        },
        versions=versions(),
    )
    total = len(settings) * len(seeds) * steps
    done = 0
    with BankWriter(out, manifest) as writer:
        for scenario in settings:
            for seed in seeds:
                for step, moment in enumerate(moments(scenario, seed, steps)):
                    _write(writer, moment, scenario=scenario, episode=f"{scenario}-{seed}", step=step)
                    done += 1
                    if progress is not None:
                        progress(done, total)
    return open_bank(out)


def _check(preset: str, seeds: Sequence[int], steps: int) -> None:
    if preset not in _PRESETS:
        raise SpecError(f"simulator 'highway' has no preset '{preset}'; known: {', '.join(_PRESETS)}")
    if not seeds:
        raise SpecError("a bank needs at least one seed")
    for seed in seeds:
        if not 0 <= seed <= MOST_SEED:
            raise SpecError(f"seed {seed} is out of range; give seeds from 0 to {MOST_SEED}")
        if seeds.count(seed) > 1:
            raise SpecError(f"seed {seed} is given twice; each seed is an episode of its own")
    if steps < LEAST_STEPS:
        raise SpecError(f"an episode needs {LEAST_STEPS} steps or more to hold every kind of moment, not {steps}")


def _write(writer: BankWriter, moment: Moment, *, scenario: str, episode: str, step: int) -> None:
    frame_id = f"{episode}-{step:02d}"
    frame = Frame(
        id=frame_id,
        scenario=scenario,
        episode=episode,
        step=step,
        mirror_axis="vertical",
        file=f"images/{frame_id}.png",
        truth=moment.truth,
        counterfactuals={name: f"counterfactuals/{frame_id}-{name}.png" for name in moment.counterfactuals},
    )
    pictures = {name: encode(picture) for name, picture in moment.counterfactuals.items()}
    writer.add(frame, encode(moment.picture), pictures)
