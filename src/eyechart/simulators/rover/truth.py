"""Ground truth is read from a world's geometry, never from its picture."""

from collections.abc import Iterable

from eyechart.frames import Scalar
from eyechart.perception.forward import ROVER
from eyechart.perception.scene import Scene, safe_action
from eyechart.simulators.rover.layout import TRACKS_M, Obstacle
from eyechart.simulators.rover.world import World

DISTANCES = ROVER.distances


def gap_to(world: World, obstacle: Obstacle) -> float:
    """Return how far ahead an obstacle's near side is, in metres along the road from the rover's middle, 0 or more."""
    return max(obstacle.x - obstacle.radius - world.state.x, 0.0)


def blocks(obstacle: Obstacle, track: int) -> bool:
    """Return whether an obstacle reaches into a track's corridor, which is 1.5 m wide: the rover and its margin."""
    return abs(obstacle.y - TRACKS_M[track]) < obstacle.radius + ROVER.beside_m


def ahead(world: World) -> list[Obstacle]:
    """Return the obstacles whose middle is ahead of the rover's."""
    return [one for one in world.layout.obstacles if one.x > world.state.x]


def find_lead(world: World) -> Obstacle | None:
    """Return the nearest obstacle ahead that blocks the corridor of the own track, or None."""
    return _nearest(world, (one for one in ahead(world) if blocks(one, world.track)))


def read_scene(world: World) -> Scene:
    """Return what a controller with perfect eyes would know; an obstacle beyond 30 m is none."""
    lead = find_lead(world)
    gap_m = None if lead is None else gap_to(world, lead)
    return Scene(
        gap_m=gap_m if gap_m is not None and gap_m < ROVER.view_ahead_m else None,
        left_clear=_is_clear(world, world.track + 1),
        right_clear=_is_clear(world, world.track - 1),
        distances=DISTANCES,
    )


def _is_clear(world: World, track: int) -> bool:
    """Return whether a track exists and nothing blocks it from beside the rover to ``ahead_m`` before it."""
    if not 0 <= track < len(TRACKS_M):
        return False
    x = world.state.x
    return not any(
        blocks(one, track)
        and one.x + one.radius > x - DISTANCES.behind_m
        and one.x - one.radius <= x + DISTANCES.ahead_m
        for one in world.layout.obstacles
    )


def read_truth(world: World) -> dict[str, Scalar]:
    """Return the ground truth of a world as it stands; None means that there is none.

    ``lead_gap_m`` is exact also beyond what is seen, where ``lead_visible`` is False. ``demand`` is what the safety
    policy asks for. ``track`` counts from the left, of three; ``nearest_side`` is where the nearest obstacle ahead
    stands as seen from the own corridor.
    """
    lead, scene, state = find_lead(world), read_scene(world), world.state
    gap_m = None if lead is None else gap_to(world, lead)
    return {
        "lead_gap_m": gap_m,
        "lead_visible": gap_m is not None and gap_m < ROVER.view_ahead_m,
        "left_clear": scene.left_clear,
        "right_clear": scene.right_clear,
        "demand": safe_action(scene),
        "nearest_side": _nearest_side(world),
        "track": len(TRACKS_M) - 1 - world.track,
        "speed_mps": state.speed,
        "crashed": world.crashed,
        "x_m": state.x,
        "y_m": state.y,
        "yaw": state.yaw,
    }


def _nearest_side(world: World) -> str | None:
    """Return left, right or centre; None where nothing stands ahead within sight."""
    seen = (one for one in ahead(world) if gap_to(world, one) < ROVER.view_ahead_m)
    nearest = _nearest(world, seen)
    if nearest is None:
        return None
    if blocks(nearest, world.track):
        return "centre"
    return "left" if nearest.y > TRACKS_M[world.track] else "right"


def _nearest(world: World, obstacles: Iterable[Obstacle]) -> Obstacle | None:
    return min(obstacles, key=lambda one: (gap_to(world, one), abs(one.y - TRACKS_M[world.track])), default=None)
