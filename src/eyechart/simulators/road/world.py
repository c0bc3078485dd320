"""A world under way: a vehicle among a layout's obstacles, its track, how a drive ends, and what its camera shows."""

import math
import struct
from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar, Generic, Protocol, Self, TypeVar

from eyechart.cameras import FORWARD, ROVER, Colour, Eye, ForwardView
from eyechart.frames import RGB
from eyechart.simulators.camera import Camera, Cylinder
from eyechart.simulators.road.layout import FAMILIES, GOAL_M, TRACKS_M, Layout

DECISION_S = 1.0
TIME_S = 40.0
MIDDLE = len(TRACKS_M) // 2


class VehicleState(Protocol):
    """Where a vehicle is, how it is turned, and how fast it goes, in m, rad and m/s."""

    @property
    def x(self) -> float:
        """Return how far along the road it is."""

    @property
    def y(self) -> float:
        """Return how far to the left of the road's middle it is."""

    @property
    def yaw(self) -> float:
        """Return how far it is turned to the left."""

    @property
    def speed(self) -> float:
        """Return how fast it goes."""

    def mirrored(self) -> Self:
        """Return the state in the mirrored world."""

    def numbers(self) -> tuple[float, ...]:
        """Return all that the state consists of."""


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


PAINTS: tuple[Colour, ...] = ((216, 84, 24), (190, 40, 130), (40, 70, 200))
"""The obstacles' colours."""

PAINT_NAMES = ("orange", "magenta", "blue")
"""Their names, in this order."""

SCENERY = dict(zip(FAMILIES, ROVER.verges, strict=True))
"""What lies beside the road of each family: the one cue by which a picture tells its scenario."""


def draw(world: AnyWorld, *, red: bool = False) -> RGB:
    """Return the picture of the vehicle's view, uint8; its own hood is red after a crash, or where it is painted so."""
    hood = world.view.bodies["red" if red or world.crashed else "green"]
    return camera_of(world.layout.family, world.vehicle).draw(eye_of(world), cylinders(world.layout), hood=hood)


def eye_of(world: AnyWorld) -> Eye:
    """Return where the vehicle's camera is and looks."""
    return Eye(world.state.x, world.state.y, world.view.eye_m, world.state.yaw)


def cylinders(layout: Layout) -> list[Cylinder]:
    """Return a layout's obstacles as bodies in their paint."""
    return [Cylinder(one.x, one.y, one.radius, one.height, PAINTS[one.paint]) for one in layout.obstacles]


def verge_of(family: str, view: ForwardView) -> Colour:
    """Return what lies beside the road of a family as a view has it."""
    return view.verges[SCENERY[family]]


@cache
def lowest_m(vehicle: str) -> float:
    """Return the lowest gap, to 0.1 m, at which the foot of an obstacle ahead stands in the picture, above the hood."""
    view, hood = FORWARD[vehicle], camera_of(next(iter(FAMILIES)), vehicle).hood
    above = int(hood.any(axis=1).argmax()) - view.horizon
    return math.ceil(10 * float(view.depth[above])) / 10


@cache
def camera_of(family: str, vehicle: str) -> Camera:
    """Return the camera of a vehicle on the road of a family."""
    return Camera(FORWARD[vehicle], verge_of(family, FORWARD[vehicle]))
