"""What a vehicle's forward camera shows of a world."""

from functools import cache

from eyechart.cameras import FORWARD, ROVER, Colour, Eye, ForwardView
from eyechart.frames import RGB
from eyechart.simulators.camera import Camera, Cylinder
from eyechart.simulators.road.layout import FAMILIES, Layout
from eyechart.simulators.road.world import AnyWorld

PAINTS: tuple[Colour, ...] = ((216, 84, 24), (190, 40, 130), (40, 70, 200))
"""The obstacles' colours: orange, magenta, blue."""

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
def camera_of(family: str, vehicle: str) -> Camera:
    """Return the camera of a vehicle on the road of a family."""
    return Camera(FORWARD[vehicle], verge_of(family, FORWARD[vehicle]))
