"""A road world under way: a vehicle among obstacles, its track, its end and its picture."""

import math
import struct
from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar, Generic, Protocol, Self, TypeVar

from eyechart.cameras import FORWARD, ROVER, Colour, Eye, ForwardView
from eyechart.frames import RGB
from eyechart.simulators.camera import Cylinder, RoadCamera
from eyechart.simulators.road.layout import FAMILIES, GOAL_M, TRACKS_M, Layout

DECISION_S = 1.0
TIME_S = 40.0
MIDDLE = len(TRACKS_M) // 2


class VehicleState(Protocol):
    """The pose and speed of a vehicle, in m, rad and m/s."""

    @property
    def x(self) -> float:
        """Return the distance along the road."""

    @property
    def y(self) -> float:
        """Return the distance to the left of the road's middle."""

    @property
    def yaw(self) -> float:
        """Return the turn to the left."""

    @property
    def speed(self) -> float:
        """Return the speed."""

    def mirrored(self) -> Self:
        """Return the state in the mirrored world."""

    def numbers(self) -> tuple[float, ...]:
        """Return all numbers of the state."""


S_co = TypeVar("S_co", bound=VehicleState, covariant=True)


@dataclass(frozen=True)
class RoadWorld(Generic[S_co]):
    """A vehicle's state in a layout, its last chosen track, and the seconds passed.

    ``vehicle`` names the view of its camera.
    """

    vehicle: ClassVar[str]

    layout: Layout
    state: S_co
    track: int = MIDDLE
    seconds: float = 0.0
    crashed: bool = False

    @property
    def view(self) -> ForwardView:
        """Return the view of the vehicle's camera, which includes the vehicle's size."""
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
        """Return the world's state as bytes, with its obstacles, exact or rounded."""
        numbers = [*self.state.numbers(), self.seconds, float(self.track), float(self.crashed)]
        for obstacle in self.layout.obstacles:
            numbers += [obstacle.x, obstacle.y, obstacle.radius, obstacle.height]
        if decimals is not None:
            numbers = [round(number, decimals) for number in numbers]
        return struct.pack(f"<{len(numbers)}d", *(number + 0.0 for number in numbers))


def next_track(track: int, to_left: int) -> int:
    """Return the track this many to the left, or the outermost one."""
    return min(max(track + to_left, 0), len(TRACKS_M) - 1)


AnyWorld = RoadWorld[VehicleState]
"""The world of any vehicle."""


PAINTS: tuple[Colour, ...] = ((216, 84, 24), (190, 40, 130), (40, 70, 200))
"""The obstacles' colours."""

PAINT_NAMES = ("orange", "magenta", "blue")
"""Their names, in this order."""

SCENERY = dict(zip(FAMILIES, ROVER.verges, strict=True))
"""The scenery beside the road of each family: the only cue by which a picture shows its
scenario."""


def draw(world: AnyWorld, *, red: bool = False) -> RGB:
    """Return the vehicle's picture, uint8; its hood is red after a crash or with ``red``."""
    hood = world.view.bodies["red" if red or world.crashed else "green"]
    return camera_of(world.layout.family, world.vehicle).draw(eye_of(world), cylinders(world.layout), hood=hood)


def eye_of(world: AnyWorld) -> Eye:
    """Return the place and direction of the vehicle's camera."""
    return Eye(world.state.x, world.state.y, world.view.eye_m, world.state.yaw)


def cylinders(layout: Layout) -> list[Cylinder]:
    """Return a layout's obstacles as painted cylinders."""
    return [
        Cylinder(obstacle.x, obstacle.y, obstacle.radius, obstacle.height, PAINTS[obstacle.paint])
        for obstacle in layout.obstacles
    ]


def verge_of(family: str, view: ForwardView) -> Colour:
    """Return the colour beside the road of a family in a view."""
    return view.verges[SCENERY[family]]


@cache
def lowest_m(vehicle: str) -> float:
    """Return the lowest gap, to 0.1 m, at which an obstacle's foot is visible above the hood."""
    view, hood = FORWARD[vehicle], camera_of(next(iter(FAMILIES)), vehicle).hood
    above = int(hood.any(axis=1).argmax()) - view.horizon
    return math.ceil(10 * float(view.depth[above])) / 10


@cache
def camera_of(family: str, vehicle: str) -> RoadCamera:
    """Return the camera of a vehicle on the road of a family."""
    return RoadCamera(FORWARD[vehicle], verge_of(family, FORWARD[vehicle]))
