"""What the balanced banks of a vehicle on the road hold, in five families of obstacles."""

from functools import partial

from eyechart.cameras import FORWARD
from eyechart.frames import Gap
from eyechart.simulators.banks import BankMaker, Preset, versions_of
from eyechart.simulators.road.layout import FAMILIES
from eyechart.simulators.road.picture import SCENERY
from eyechart.simulators.road.staging import Vehicle, stage


class RoadBanks(BankMaker):
    """The part of a simulator on the road that makes banks of ``vehicle``'s staged moments."""

    vehicle: Vehicle

    def open_preset(self, name: str) -> Preset:
        """Return the one preset that there is.

        Near is below the view's ``close_m``, from the vehicle's middle to the obstacle's near side: the highway's 18 m
        are four seconds and more for a slow vehicle.
        """
        del name
        distances = FORWARD[self.vehicle.view].distances
        return Preset(
            scenarios={family: {"beside": SCENERY[family]} for family in FAMILIES},
            moments=partial(stage, self.vehicle),
            gap=Gap(column="lead_gap_m", threshold=distances.close_m, unit="m"),
            settings={
                "stop_m": distances.stop_m,
                "close_m": distances.close_m,
                "free_m": distances.free_m,
                "side_clear_m": [-distances.behind_m, distances.ahead_m],
            },
        )

    def versions(self) -> dict[str, str]:
        """Return the version of numpy; the rest of this world is eyechart's own."""
        return versions_of(("numpy",))
