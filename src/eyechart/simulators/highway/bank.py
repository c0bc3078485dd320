"""Four scenarios, some seeds and some steps become a bank on disk."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from eyechart.frames import LEAD_GAP, BankManifest, FrameBank
from eyechart.simulators.banks import Asked, Moment, write_bank
from eyechart.simulators.highway.declared import PICTURE, versions
from eyechart.simulators.highway.driving import DRIVES, drive
from eyechart.simulators.highway.staging import STAGES, stage
from eyechart.simulators.highway.world import Setting
from eyechart.spaces.discrete import DRIVING

_PRESETS: Mapping[str, tuple[Mapping[str, Setting], Callable[[str, int, int], Iterator[Moment]]]] = {
    "balanced": (STAGES, stage),
    "paper": (DRIVES, drive),
}


def build_bank(
    out: Path, *, preset: str, seeds: Sequence[int], steps: int, progress: Callable[[int, int], None] | None
) -> FrameBank:
    """Write a bank; see ``Highway.build``."""
    asked = Asked("highway", preset, tuple(int(seed) for seed in seeds), steps)
    asked.check(_PRESETS)
    settings, moments = _PRESETS[preset]
    manifest = BankManifest(
        simulator="highway",
        preset=preset,
        picture=PICTURE,
        action_space=DRIVING,
        gap=LEAD_GAP,
        settings=asked.settings({scenario: setting.as_dict() for scenario, setting in settings.items()}),
        versions=versions(),
    )
    return write_bank(
        out, manifest, asked, scenarios=list(settings), moments=moments, axis="vertical", progress=progress
    )
