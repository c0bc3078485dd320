"""Ground truth from a world's geometry, never from its picture."""

from typing import Any

from eyechart.frames import Scalar
from eyechart.simulators.highway.world import LANE_M, VIEW_AHEAD_M, VIEW_ASIDE_M, VIEW_BEHIND_M, World
from eyechart.spaces.scene import CLEAR_AHEAD_M, CLEAR_BEHIND_M, Scene, safe_action

Vehicle = Any
"""A highway-env vehicle."""


def find_lead(world: World) -> Vehicle | None:
    """Return the nearest vehicle ahead whose centre is less than 2 m aside, or None."""
    ego = world.vehicle
    own = [vehicle for vehicle in others(world) if abs(vehicle.position[1] - ego.position[1]) < LANE_M / 2]
    ahead = [vehicle for vehicle in own if gap_to(ego, vehicle) > 0]
    return min(ahead, key=lambda vehicle: gap_to(ego, vehicle), default=None)


def others(world: World) -> list[Vehicle]:
    """Return every vehicle but the ego."""
    return [vehicle for vehicle in world.road.vehicles if vehicle is not world.vehicle]


def gap_to(ego: Vehicle, vehicle: Vehicle) -> float:
    """Return the distance of a vehicle ahead, centre to centre, in metres along the road."""
    return float(vehicle.position[0] - ego.position[0])


def is_visible(gap_m: float) -> bool:
    """Return whether a vehicle this far ahead has its centre within the picture."""
    return gap_m < VIEW_AHEAD_M


def read_scene(world: World) -> Scene:
    """Return the scene of a perfect observer; a lead beyond the picture's edge does not count."""
    lead = find_lead(world)
    gap_m = None if lead is None else gap_to(world.vehicle, lead)
    return Scene(
        gap_m=gap_m if gap_m is not None and is_visible(gap_m) else None,
        left_clear=_is_clear(world, side=-1),
        right_clear=_is_clear(world, side=1),
    )


def _is_clear(world: World, *, side: int) -> bool:
    """Return whether the lane on that side exists and is empty from 12 m behind to 40 m ahead.

    A lane exists if highway-env draws a dashed line to it, so merge-v0's joining lane counts while
    it lasts.
    """
    ego = world.vehicle
    start, end, own = ego.lane_index
    lanes = world.road.network.graph[start][end]
    if not 0 <= own + side < len(lanes):
        return False
    lane = lanes[own + side]
    return not any(
        -CLEAR_BEHIND_M <= gap_to(ego, vehicle) <= CLEAR_AHEAD_M
        and abs(lane.local_coordinates(vehicle.position)[1]) <= LANE_M / 2
        for vehicle in others(world)
    )


def read_truth(world: World) -> dict[str, Scalar]:
    """Return the ground truth of a world at this moment; None means that there is none.

    ``lead_gap_m`` is centre to centre and exact also beyond the picture's edge, where
    ``lead_visible`` is False. ``demand`` is the action of the safety policy. ``ego_lane`` counts
    from the left, of ``lanes``.
    """
    ego, lead, scene = world.vehicle, find_lead(world), read_scene(world)
    gap_m = None if lead is None else gap_to(ego, lead)
    start, end, own = ego.lane_index
    return {
        "lead_gap_m": gap_m,
        "lead_visible": gap_m is not None and is_visible(gap_m),
        "left_clear": scene.left_clear,
        "right_clear": scene.right_clear,
        "demand": safe_action(scene),
        "ego_lane": int(own),
        "lanes": len(world.road.network.graph[start][end]),
        "speed_mps": float(ego.speed),
        "crashed": bool(ego.crashed),
        "vehicles_in_view": sum(_is_in_view(ego, vehicle) for vehicle in others(world)),
        "ego_x_m": float(ego.position[0]),
    }


def _is_in_view(ego: Vehicle, vehicle: Vehicle) -> bool:
    aside = abs(vehicle.position[1] - ego.position[1])
    return bool(-VIEW_BEHIND_M <= gap_to(ego, vehicle) < VIEW_AHEAD_M and aside < VIEW_ASIDE_M)
