"""A world under way: a vehicle among a layout's obstacles, the track it was asked to follow, and how a drive ends."""

import struct
from dataclasses import dataclass, replace
from typing import ClassVar, Generic, Protocol, Self, TypeVar

from eyechart.cameras import FORWARD, ForwardView
from eyechart.simulators.road.layout import GOAL_M, TRACKS_M, Layout

DECISION_S = 1.0
TIME_S = 40.0
MIDDLE = len(TRACKS_M) // 2


class VehicleState(Protocol):
    """Where a vehicle is, how it is turned, and how fast it goes, in m, rad and m/s."""

    @property
    def x(self) -> float:
        """Return how far along the road it is."""
        ...

    @property
    def y(self) -> float:
        """Return how far to the left of the road's middle it is."""
        ...

    @property
    def yaw(self) -> float:
        """Return how far it is turned to the left."""
        ...

    @property
    def speed(self) -> float:
        """Return how fast it goes."""
        ...

    def mirrored(self) -> Self:
        """Return the state in the mirrored world."""
        ...

    def numbers(self) -> tuple[float, ...]:
        """Return all that the state consists of."""
        ...


S_co = TypeVar("S_co", bound=VehicleState, covariant=True)


@dataclass(frozen=True)
class RoadWorld(Generic[S_co]):
    """A vehicle's state in a layout, the track it was last asked to follow, and how many seconds have passed.

    ``vehicle`` names the view of the vehicle's camera.
    """

    vehicle: ClassVar[str]

    layout: Layout
    state: S_co
    track: int = MIDDLE
    seconds: float = 0.0
    crashed: bool = False

    @property
    def view(self) -> ForwardView:
        """Return what is known of the vehicle's camera, and with it of the vehicle."""
        return FORWARD[self.vehicle]

    @property
    def ended(self) -> str | None:
        """Return why the drive is over, None while it goes on."""
        if self.crashed:
            return "crash"
        if self.state.x >= GOAL_M:
            return "goal"
        return "time" if self.seconds >= TIME_S else None

    def mirrored(self) -> Self:
        """Return the mirrored world."""
        return replace(
            self,
            layout=self.layout.mirrored(),
            state=self.state.mirrored(),
            track=len(TRACKS_M) - 1 - self.track,
        )

    def as_bytes(self, decimals: int | None = None) -> bytes:
        """Return the state of the world as bytes: numbers as they are or rounded, obstacles too."""
        numbers = [*self.state.numbers(), self.seconds, float(self.track), float(self.crashed)]
        for one in self.layout.obstacles:
            numbers += [one.x, one.y, one.radius, one.height]
        if decimals is not None:
            numbers = [round(number, decimals) for number in numbers]
        return struct.pack(f"<{len(numbers)}d", *(number + 0.0 for number in numbers))


def next_track(track: int, to_left: int) -> int:
    """Return the number of the track so many to the left, as far as there is one."""
    return min(max(track + to_left, 0), len(TRACKS_M) - 1)


AnyWorld = RoadWorld[VehicleState]
"""The world of any vehicle."""
