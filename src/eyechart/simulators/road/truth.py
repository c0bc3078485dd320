"""Ground truth from a world's geometry, never from its picture."""

import math
from collections.abc import Iterable

import numpy as np

from eyechart.frames import Scalar
from eyechart.simulators.road.layout import TRACKS_M, Obstacle
from eyechart.simulators.road.world import AnyWorld
from eyechart.spaces.scene import Scene, safe_action

_ROUND = np.stack([fn(np.linspace(0, 2 * math.pi, 72, endpoint=False)) for fn in (np.cos, np.sin)])
"""Points around a foot, as directions from its middle, shape (2, 72)."""


def gap_to(world: AnyWorld, obstacle: Obstacle) -> float:
    """Return the distance from the vehicle's middle to an obstacle's near side, 0 m or more."""
    return max(obstacle.x - obstacle.radius - world.state.x, 0.0)


def blocks(world: AnyWorld, obstacle: Obstacle, track: int) -> bool:
    """Return whether an obstacle reaches into a track's corridor: the vehicle and its margins."""
    return abs(obstacle.y - TRACKS_M[track]) < obstacle.radius + world.view.beside_m


def ahead(world: AnyWorld) -> list[Obstacle]:
    """Return the obstacles whose middle is ahead of the vehicle's."""
    return [obstacle for obstacle in world.layout.obstacles if obstacle.x > world.state.x]


def find_lead(world: AnyWorld) -> Obstacle | None:
    """Return the nearest obstacle ahead that blocks the corridor of the own track, or None."""
    return _nearest(world, (one for one in ahead(world) if blocks(world, one, world.track)))


def read_scene(world: AnyWorld) -> Scene:
    """Return the scene of a perfect observer; an obstacle beyond the view does not count."""
    lead = find_lead(world)
    gap_m = None if lead is None else gap_to(world, lead)
    return Scene(
        gap_m=gap_m if gap_m is not None and gap_m < world.view.view_ahead_m else None,
        left_clear=_is_clear(world, world.track + 1),
        right_clear=_is_clear(world, world.track - 1),
        distances=world.view.distances,
    )


def _is_clear(world: AnyWorld, track: int) -> bool:
    """Return whether a track exists and is free from the vehicle's side to ``ahead_m`` ahead."""
    return 0 <= track < len(TRACKS_M) and not _closing(world, track)


def _closing(world: AnyWorld, track: int) -> list[Obstacle]:
    """Return the obstacles that block a track from the vehicle's side to ``ahead_m`` ahead."""
    x, distances = world.state.x, world.view.distances
    return [
        obstacle
        for obstacle in world.layout.obstacles
        if blocks(world, obstacle, track)
        and obstacle.x + obstacle.radius > x - distances.behind_m
        and obstacle.x - obstacle.radius <= x + distances.ahead_m
    ]


def unseen_sides(world: AnyWorld) -> frozenset[str]:
    """Return the sides, left or right, that are blocked only by obstacles outside the picture.

    An obstacle blocks a side from ``behind_m`` behind the vehicle on, and a forward camera sees it
    only from some distance ahead.
    """
    sides = {"left": world.track + 1, "right": world.track - 1}
    return frozenset(
        side
        for side, track in sides.items()
        if 0 <= track < len(TRACKS_M)
        and (closing := _closing(world, track))
        and not any(_is_in_picture(world, obstacle, track) for obstacle in closing)
    )


def _is_in_picture(world: AnyWorld, obstacle: Obstacle, track: int) -> bool:
    """Return whether the camera shows any part of an obstacle inside a track's corridor.

    Such a part is a point of its foot that faces the camera, and lies in the corridor and in the
    visible wedge of ground.
    """
    view, state = world.view, world.state
    x, y = obstacle.x + obstacle.radius * _ROUND[0], obstacle.y + obstacle.radius * _ROUND[1]
    ahead, aside = x - state.x, y - state.y
    faces = ahead * _ROUND[0] + aside * _ROUND[1] < 0
    depth = ahead * math.cos(state.yaw) + aside * math.sin(state.yaw)
    across = aside * math.cos(state.yaw) - ahead * math.sin(state.yaw)
    shown = (depth > view.depth[-1]) & (np.abs(across) < view.width / 2 / view.focal_px * depth)
    return bool((faces & shown & (np.abs(y - TRACKS_M[track]) < view.beside_m)).any())


def free_tracks(world: AnyWorld) -> tuple[float, ...]:
    """Return how far each track, from the right, is free ahead, in metres, within the view."""
    behind = world.state.x - world.view.distances.behind_m
    beside = [obstacle for obstacle in world.layout.obstacles if obstacle.x + obstacle.radius > behind]
    return tuple(
        min(
            [
                world.view.view_ahead_m,
                *(gap_to(world, obstacle) for obstacle in beside if blocks(world, obstacle, track)),
            ]
        )
        for track in range(len(TRACKS_M))
    )


def read_truth(world: AnyWorld) -> dict[str, Scalar]:
    """Return the ground truth of a world at this moment; None means that there is none.

    ``lead_gap_m`` is exact also beyond the view, where ``lead_visible`` is False. ``demand`` is the
    action of the safety policy. ``track`` counts from the left, of three. ``nearest_side`` is the
    side of the nearest obstacle ahead, as seen from the own corridor.
    """
    lead, scene, state = find_lead(world), read_scene(world), world.state
    gap_m = None if lead is None else gap_to(world, lead)
    return {
        "lead_gap_m": gap_m,
        "lead_visible": gap_m is not None and gap_m < world.view.view_ahead_m,
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


def _nearest_side(world: AnyWorld) -> str | None:
    """Return left, right or centre; None if nothing stands ahead within sight."""
    seen = (one for one in ahead(world) if gap_to(world, one) < world.view.view_ahead_m)
    nearest = _nearest(world, seen)
    if nearest is None:
        return None
    if blocks(world, nearest, world.track):
        return "centre"
    return "left" if nearest.y > TRACKS_M[world.track] else "right"


def _nearest(world: AnyWorld, obstacles: Iterable[Obstacle]) -> Obstacle | None:
    return min(
        obstacles, key=lambda obstacle: (gap_to(world, obstacle), abs(obstacle.y - TRACKS_M[world.track])), default=None
    )
