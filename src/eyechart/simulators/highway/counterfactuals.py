"""A moment of highway-env with one thing changed: its counterfactual pictures, and the controls of those.

``lane_own`` and ``lane_beside`` exchange who is near: the lead and a vehicle of a neighbouring lane, at equal
straight-line distance. Left in its place the lead would hide the other one from a rule that takes the nearest of all.
"""

import math
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial

import numpy as np

from eyechart.frames import RGB
from eyechart.simulators.banks import Drawn, Moment
from eyechart.simulators.highway.stock import IDMVehicle
from eyechart.simulators.highway.truth import Vehicle, find_lead, gap_to, is_visible, others, read_truth
from eyechart.simulators.highway.world import LANE_M, Camera, World, moved, recoloured
from eyechart.simulators.plan import log_uniform, other_gap

NEAR_M = (7.0, 9.0)
FAR_M = (50.0, 60.0)
"""Where ``lead_near`` and ``lead_far`` put the lead, centre to centre."""

MIDS_M = {"lead_mid_near": (9.1, 20.0), "lead_mid_far": (20.0, 49.0)}
"""Between which distances the mids spread the lead, evenly in their logarithm."""

_LEAST_AHEAD_M = 5.6
"""A car's length and a little: a vehicle this far ahead in the next lane is ahead, not beside."""

_CAR_M = 5.0
_BUMPER_M = 1.0
_OFF_CENTRE_M = 1.0
_TRIES = 20


def record(world: World, camera: Camera, rng: np.random.Generator) -> Moment:
    """Return a world's moment with every counterfactual that can be drawn honestly; none after a crash.

    The lead is moved only along a lane that is free from where it was to where it goes.
    """
    lead = find_lead(world)
    gap_m = None if lead is None else gap_to(world.vehicle, lead)
    near_m, far_m = other_gap(gap_m, NEAR_M, rng), other_gap(gap_m, FAR_M, rng)
    pictures: dict[str, RGB | None] = {}
    if not world.vehicle.crashed:
        pictures["lead_near"] = _draw_with_lead_at(world, camera, near_m)
        pictures["lead_far"] = _draw_with_lead_at(world, camera, far_m)
        with recoloured(world.vehicle):
            pictures["recoloured"] = camera.draw()
    drawn = {name: picture for name, picture in pictures.items() if picture is not None}
    return Moment(read_truth(world), camera.draw(), drawn, controls=partial(draw_controls, world, camera))


def draw_controls(world: World, camera: Camera, rng: np.random.Generator) -> Drawn:
    """Return the control pictures of a world's moment; none after a crash, or without a lead."""
    lead = find_lead(world)
    if lead is None or world.vehicle.crashed:
        return Drawn()
    pictures, distances = _exchange(world, camera, lead, rng)
    for name, bounds in MIDS_M.items():
        gap_m = log_uniform(bounds, rng)
        picture = _draw_with_lead_at(world, camera, gap_m)
        if picture is not None:
            pictures[name], distances[f"{name}_m"] = picture, gap_m
    if is_visible(gap_to(world.vehicle, lead)):
        with _placed(world, [one for one in world.road.vehicles if one is not lead]):
            next_one = find_lead(world)
            if next_one is None or not is_visible(gap_to(world.vehicle, next_one)):
                pictures["lead_absent"] = camera.draw()
    return Drawn(pictures, distances)


def _draw_with_lead_at(world: World, camera: Camera, gap_m: float) -> RGB | None:
    """Return the picture with the lead at this gap, or None where it cannot get there."""
    lead = find_lead(world)
    if lead is None:
        return None
    x = float(world.vehicle.position[0]) + gap_m
    if not _way_is_free(world, lead, x):
        return None
    with moved(lead, x):
        return camera.draw() if find_lead(world) is lead else None


def _way_is_free(world: World, lead: Vehicle, x: float) -> bool:
    reach = _CAR_M + _BUMPER_M
    low, high = sorted((float(lead.position[0]), x))
    return not any(
        low - reach < vehicle.position[0] < high + reach and _side_by_side(vehicle, lead)
        for vehicle in others(world)
        if vehicle is not lead
    )


def _side_by_side(one: Vehicle, other: Vehicle) -> bool:
    """Return whether two vehicles would meet if one of them were moved along the road."""
    return bool(abs(one.position[1] - other.position[1]) < LANE_M - _BUMPER_M)


def _exchange(
    world: World, camera: Camera, lead: Vehicle, rng: np.random.Generator
) -> tuple[dict[str, RGB], dict[str, float]]:
    """Return the two pictures of who is near, and their distances; nothing where no neighbour has room for both."""
    x, y = map(float, world.vehicle.position)
    for _ in range(_TRIES):
        near_m, far_m = float(rng.uniform(*NEAR_M)), float(rng.uniform(*FAR_M))
        for other in _neighbours(world, rng):
            away_m = math.hypot(near_m, float(lead.position[1]) - y)
            beside_m = max(_LEAST_AHEAD_M, math.sqrt(away_m**2 - (float(other.position[1]) - y) ** 2))
            places = x + far_m, x + beside_m
            ways = all(_way_is_free(world, lead, x + gap_m) for gap_m in (near_m, far_m))
            if not ways or not all(_has_room(world, other, place) for place in places):
                continue
            pictures = {}
            with _there(world, other):
                for name, gap_m, place in zip(("lane_own", "lane_beside"), (near_m, far_m), places, strict=True):
                    with moved(lead, x + gap_m), moved(other, place):
                        if find_lead(world) is lead:
                            pictures[name] = camera.draw()
            if len(pictures) == len(places):
                return pictures, {"lane_near_m": near_m, "lane_far_m": far_m}
    return {}, {}


def _neighbours(world: World, rng: np.random.Generator) -> Iterator[Vehicle]:
    """Yield the vehicles of the lanes beside the own one, one lane after the other, and a new one for an empty lane."""
    ego = world.vehicle
    start, end, own = ego.lane_index
    lanes = world.road.network.graph[start][end]
    for side in rng.permutation([-1, 1]).tolist():
        if not 0 <= own + side < len(lanes):
            continue
        lane = lanes[own + side]
        there = [one for one in others(world) if abs(lane.local_coordinates(one.position)[1]) <= _OFF_CENTRE_M]
        yield from sorted(there, key=lambda one: abs(gap_to(ego, one)))
        if not there:
            along, _ = lane.local_coordinates(ego.position)
            yield IDMVehicle(world.road, lane.position(along, 0.0), 0.0, float(ego.speed))


def _has_room(world: World, vehicle: Vehicle, x: float) -> bool:
    """Return whether a vehicle would stand on the road there, and touch no other."""
    place = np.array([x, vehicle.position[1]])
    return any(lane.on_lane(place) for lane in world.road.network.lanes_list()) and not any(
        abs(one.position[0] - x) < _CAR_M + _BUMPER_M and _side_by_side(one, vehicle)
        for one in others(world)
        if one is not vehicle
    )


def _there(world: World, vehicle: Vehicle) -> AbstractContextManager[None]:
    """Put a vehicle on the road, where it is not there already, and take it away again."""
    on_road = any(one is vehicle for one in world.road.vehicles)
    return nullcontext() if on_road else _placed(world, [*world.road.vehicles, vehicle])


@contextmanager
def _placed(world: World, vehicles: list[Vehicle]) -> Iterator[None]:
    """Have these vehicles on the road, and then those that there were."""
    before = world.road.vehicles
    world.road.vehicles = vehicles
    try:
        yield
    finally:
        world.road.vehicles = before
