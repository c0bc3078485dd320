"""Five families, some seeds and some steps become a bank on disk."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from eyechart.cameras import FORWARD
from eyechart.frames import BankManifest, FrameBank, Gap
from eyechart.simulators.banks import Asked, versions_of, write_bank
from eyechart.simulators.road.layout import FAMILIES
from eyechart.simulators.road.picture import SCENERY
from eyechart.simulators.road.staging import Vehicle, stage
from eyechart.spaces.discrete import DRIVING


def build_bank(
    out: Path,
    vehicle: Vehicle,
    asked: Asked,
    *,
    picture: str,
    progress: Callable[[int, int], None] | None,
) -> FrameBank:
    """Write a bank of a vehicle's staged moments.

    Near is below the view's ``close_m``, from the vehicle's middle to the obstacle's near side: the highway's 18 m are
    four seconds and more for a slow vehicle.
    """
    distances = FORWARD[vehicle.view].distances
    manifest = BankManifest(
        simulator=asked.simulator,
        preset=asked.preset,
        picture=picture,
        action_space=DRIVING,
        gap=Gap(column="lead_gap_m", threshold=distances.close_m, unit="m"),
        settings={
            **asked.settings({family: {"beside": SCENERY[family]} for family in FAMILIES}),
            "stop_m": distances.stop_m,
            "close_m": distances.close_m,
            "free_m": distances.free_m,
            "side_clear_m": [-distances.behind_m, distances.ahead_m],
        },
        versions=versions_of(("numpy",)),
    )
    return write_bank(
        out,
        manifest,
        asked,
        scenarios=list(FAMILIES),
        moments=partial(stage, vehicle),
        axis="horizontal",
        progress=progress,
    )
