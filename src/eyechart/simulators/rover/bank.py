"""Five families, some seeds and some steps become a bank on disk."""

from collections.abc import Callable, Sequence
from pathlib import Path

from eyechart.actions import DRIVING
from eyechart.frames import BankManifest, FrameBank, Gap
from eyechart.perception.forward import ROVER
from eyechart.simulators.banks import Asked, versions_of, write_bank
from eyechart.simulators.rover.layout import FAMILIES
from eyechart.simulators.rover.picture import PICTURE, SCENERY
from eyechart.simulators.rover.staging import stage

GAP = Gap(column="lead_gap_m", threshold=ROVER.distances.close_m, unit="m")
"""Near below 8 m, from the rover's middle to the obstacle's near side; the highway's 18 m are 4 seconds for a rover."""


def build_bank(
    out: Path,
    *,
    presets: Sequence[str],
    preset: str,
    seeds: Sequence[int],
    steps: int,
    progress: Callable[[int, int], None] | None,
) -> FrameBank:
    """Write a bank; see ``Rover.build``."""
    asked = Asked("rover", preset, tuple(int(seed) for seed in seeds), steps)
    asked.check(dict.fromkeys(presets))
    distances = ROVER.distances
    manifest = BankManifest(
        simulator="rover",
        preset=preset,
        picture=PICTURE,
        action_space=DRIVING,
        gap=GAP,
        settings={
            **asked.settings({family: {"beside": SCENERY[family]} for family in FAMILIES}),
            "stop_m": distances.stop_m,
            "close_m": distances.close_m,
            "free_m": distances.free_m,
            "side_clear_m": [-distances.behind_m, distances.ahead_m],
        },
        versions=versions_of(("numpy",)),
    )
    scenarios = list(FAMILIES)
    return write_bank(out, manifest, asked, scenarios=scenarios, moments=stage, axis="horizontal", progress=progress)
