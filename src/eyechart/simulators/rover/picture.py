"""What the rover's forward camera shows of a world."""

from functools import cache

from eyechart.frames import RGB
from eyechart.perception.forward import ROVER, Colour
from eyechart.simulators.camera import Camera, Cylinder, Eye, Lens, Road
from eyechart.simulators.rover.layout import FAMILIES
from eyechart.simulators.rover.world import World

PICTURE = (
    f"view of a forward camera on a rover, drawn by column ray casting ({ROVER.width} × {ROVER.height} pixels); its "
    "own hood at the lower edge, obstacles as coloured cylinders"
)

PAINTS: tuple[Colour, ...] = ((216, 84, 24), (190, 40, 130), (40, 70, 200))
"""The obstacles' colours: orange, magenta, blue."""

SCENERY = dict(zip(FAMILIES, ROVER.verges, strict=True))
"""What lies beside the road of each family: the one cue by which a picture tells its scenario."""


@cache
def camera_of(family: str) -> Camera:
    """Return the camera on the road of a family."""
    lens = Lens(ROVER.width, ROVER.height, ROVER.focal_px, ROVER.horizon)
    road = Road(
        half_width=ROVER.half_width_m,
        dashed=ROVER.dashed_m,
        mark=ROVER.mark_m,
        dash=ROVER.dash_m,
        period=ROVER.period_m,
        surface=ROVER.surface,
        verge=ROVER.verges[SCENERY[family]],
        zenith=ROVER.zenith,
    )
    return Camera(lens, road)


def draw(world: World, *, red: bool = False) -> RGB:
    """Return the picture, shape (240, 320, 3), uint8; the hood is red after a crash, or where it is painted so."""
    state = world.state
    bodies = [Cylinder(one.x, one.y, one.radius, one.height, PAINTS[one.paint]) for one in world.layout.obstacles]
    hood = ROVER.bodies["red" if red or world.crashed else "green"]
    eye = Eye(state.x, state.y, ROVER.eye_m, state.yaw)
    return camera_of(world.layout.family).draw(eye, bodies, hood=hood)
