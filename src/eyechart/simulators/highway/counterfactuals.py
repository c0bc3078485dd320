"""Counterfactual and control pictures of a highway-env moment, with one thing changed each.

``exchange_own`` and ``exchange_beside`` exchange which vehicle is near: the lead, or a vehicle of a
neighbouring lane. Both use one straight-line distance, drawn from the whole range; in
``exchange_apart`` both vehicles are far. If the lead stayed in place, it would hide the other
vehicle from a rule that takes the nearest of all.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial

import numpy as np

from eyechart.cameras import PALETTE
from eyechart.frames import EXCHANGE, LEAD, RGB, Draws
from eyechart.simulators.banks import ControlPictures, Moment, first_shown
from eyechart.simulators.highway.stock import IDMVehicle, VehicleGraphics
from eyechart.simulators.highway.truth import Vehicle, find_lead, gap_to, is_visible, others, read_truth
from eyechart.simulators.highway.world import LANE_M, StockCamera, World, moved, recoloured
from eyechart.simulators.plan import other_gap

NEAR_M = (7.0, 9.0)
FAR_M = (50.0, 60.0)
"""The lead's distance in ``lead_near`` and ``lead_far``, centre to centre."""

LOWEST_M = 5.0
"""The lowest distance that can be shown: a car's length, at which lead and ego touch."""

_CAR_M = 5.0
_BUMPER_M = 1.0
_OFF_CENTRE_M = 1.0
_PLACES = 6
"""Number of draws of far places for one distance of the exchange."""


def record(world: World, camera: StockCamera, rng: np.random.Generator, *, lowest: bool = False) -> Moment:
    """Return a world's moment with every counterfactual that can be drawn; none after a crash.

    The lead moves only along a lane that is free from its old place to the new one. With
    ``lowest``, near is as near as can be shown.
    """
    lead = find_lead(world)
    gap_m = None if lead is None else gap_to(world.vehicle, lead)
    near_m, far_m = LOWEST_M if lowest else other_gap(gap_m, NEAR_M, rng), other_gap(gap_m, FAR_M, rng)
    pictures: dict[str, RGB | None] = {}
    if not world.vehicle.crashed:
        pictures["lead_near"] = _draw_with_lead_at(world, camera, near_m)
        pictures["lead_far"] = _draw_with_lead_at(world, camera, far_m)
        with recoloured(world.vehicle):
            pictures["recoloured"] = camera.draw()
    drawn = {name: picture for name, picture in pictures.items() if picture is not None}
    truth = read_truth(world)
    return Moment(
        truth,
        camera.draw(),
        drawn,
        ranged=partial(draw_ranged, world, camera),
        distances={f"{name}_m": m for name, m in (("lead_near", near_m), ("lead_far", far_m)) if name in drawn},
        strata={"lanes": truth["lanes"], "lead_colour": None if lead is None else colour_of(lead)},
    )


def draw_ranged(world: World, camera: StockCamera, draws: Draws, rng: np.random.Generator) -> ControlPictures:
    """Return the control pictures: without the lead, and at distances of the whole range.

    There are none after a crash, or without a lead.
    """
    lead = find_lead(world)
    if lead is None or world.vehicle.crashed:
        return ControlPictures()
    moved_m, pictures, distances = None, dict[str, RGB](), dict[str, float]()
    if (absent := _draw_without(world, camera, lead)) is not None:
        pictures["lead_absent"] = absent
    if alone := first_shown(partial(_draw_with_lead_at, world, camera), draws.lead()):
        moved_m, pictures["lead_drawn"] = alone
        distances[LEAD] = moved_m
    if both := first_shown(partial(_exchange_at, world, camera, lead, rng), draws.exchange(moved_m)):
        distances[EXCHANGE] = both[0]
        pictures |= both[1]
    return ControlPictures(pictures, distances)


def _draw_without(world: World, camera: StockCamera, lead: Vehicle) -> RGB | None:
    """Return the picture without the lead; None if it was not visible or another vehicle leads."""
    if not is_visible(gap_to(world.vehicle, lead)):
        return None
    with _placed(world, [vehicle for vehicle in world.road.vehicles if vehicle is not lead]):
        behind = find_lead(world)
        return camera.draw() if behind is None or not is_visible(gap_to(world.vehicle, behind)) else None


def _exchange_at(
    world: World, camera: StockCamera, lead: Vehicle, rng: np.random.Generator, own_m: float
) -> dict[str, RGB] | None:
    """Return the exchange's pictures at this distance, or None if no neighbour has room for it."""
    x, y = map(float, world.vehicle.position)
    away_m = math.hypot(own_m, float(lead.position[1]) - y)
    for _ in range(_PLACES):
        far_m, its_far_m = (float(rng.uniform(*FAR_M)) for _ in range(2))
        for other in _neighbours(world, rng):
            aside_m = abs(float(other.position[1]) - y)
            if aside_m >= away_m:
                continue
            beside_m = math.sqrt(away_m**2 - aside_m**2)
            wanted = {
                "exchange_own": (own_m, its_far_m),
                "exchange_beside": (far_m, beside_m),
                "exchange_apart": (far_m, its_far_m),
            }
            ways = all(_is_way_free(world, lead, x + gap_m) for gap_m in (own_m, far_m))
            if ways and all(_has_room(world, other, x + ahead) for ahead in (its_far_m, beside_m)):
                pictures = _draw_placed(world, camera, lead, other, wanted)
                if len(pictures) == len(wanted):
                    return pictures
    return None


def _draw_placed(
    world: World, camera: StockCamera, lead: Vehicle, other: Vehicle, wanted: Mapping[str, tuple[float, float]]
) -> dict[str, RGB]:
    """Return the pictures with lead and other vehicle at these places, if the lead still leads."""
    x, pictures = float(world.vehicle.position[0]), {}
    with _there(world, other):
        for name, (lead_m, other_m) in wanted.items():
            with moved(lead, x + lead_m), moved(other, x + other_m):
                if find_lead(world) is lead:
                    pictures[name] = camera.draw()
    return pictures


def colour_of(vehicle: Vehicle) -> str:
    """Return the name of a vehicle's colour."""
    drawn = tuple(VehicleGraphics.get_color(vehicle))[:3]
    return next(name for name, (body, _) in PALETTE.items() if body == drawn)


def _draw_with_lead_at(world: World, camera: StockCamera, gap_m: float) -> RGB | None:
    """Return the picture with the lead at this gap, or None if it cannot be moved there."""
    lead = find_lead(world)
    if lead is None:
        return None
    x = float(world.vehicle.position[0]) + gap_m
    if not _is_way_free(world, lead, x):
        return None
    with moved(lead, x):
        return camera.draw() if find_lead(world) is lead else None


def _is_way_free(world: World, lead: Vehicle, x: float) -> bool:
    reach = _CAR_M + _BUMPER_M
    low, high = sorted((float(lead.position[0]), x))
    return not any(
        low - reach < vehicle.position[0] < high + reach and _are_side_by_side(vehicle, lead)
        for vehicle in others(world)
        if vehicle is not lead
    )


def _are_side_by_side(vehicle: Vehicle, other: Vehicle) -> bool:
    """Return whether two vehicles would meet if one of them were moved along the road."""
    return bool(abs(vehicle.position[1] - other.position[1]) < LANE_M - _BUMPER_M)


def _neighbours(world: World, rng: np.random.Generator) -> Iterator[Vehicle]:
    """Yield the vehicles of each neighbouring lane, or a new one for an empty lane."""
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
    """Return whether a vehicle at this place would stand on the road and touch no other."""
    place = np.array([x, vehicle.position[1]])
    return any(lane.on_lane(place) for lane in world.road.network.lanes_list()) and not any(
        abs(one.position[0] - x) < _CAR_M + _BUMPER_M and _are_side_by_side(one, vehicle)
        for one in others(world)
        if one is not vehicle
    )


def _there(world: World, vehicle: Vehicle) -> AbstractContextManager[None]:
    """Put a vehicle on the road for the context if it is not there already."""
    on_road = any(one is vehicle for one in world.road.vehicles)
    return nullcontext() if on_road else _placed(world, [*world.road.vehicles, vehicle])


@contextmanager
def _placed(world: World, vehicles: list[Vehicle]) -> Iterator[None]:
    """Replace the vehicles on the road for the context."""
    before = world.road.vehicles
    world.road.vehicles = vehicles
    try:
        yield
    finally:
        world.road.vehicles = before
