"""Faster forms of highway-env's functions, with results that are equal bit for bit.

The stock functions come back when the context ends, also after an exception. The results are equal
because nothing is reordered. Along a lane that points exactly east, the products with 1 and 0 are
left out. The neighbours on a lane are collected once for all vehicles that decide at the same
instant. Pairs of vehicles that are certainly apart are skipped. Everything else, curved lanes too,
uses the stock functions.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np

from eyechart.simulators.highway.stock import Landmark, Road, RoadNetwork, StraightLane, behavior, controller

_STOCK_COORDINATES = StraightLane.local_coordinates
_STOCK_NEIGHBOURS = Road.neighbour_vehicles
_TWO_PI = 2 * np.pi
_CERTAINLY_M = 1e-6
_ON_LANE_MARGIN_M = 1.0

_Any = Any
"""highway-env has no types of its own."""


@contextmanager
def speedups() -> Iterator[None]:
    """Speed up highway-env for the context, with equal states bit for bit; may be nested."""
    with _STATE.lock:
        if _STATE.depth == 0:
            _STATE.stock = [(owner, name, getattr(owner, name)) for owner, name, _ in _FASTER]
            for owner, name, faster in _FASTER:
                setattr(owner, name, faster)
        _STATE.depth += 1
    try:
        yield
    finally:
        with _STATE.lock:
            _STATE.depth -= 1
            if _STATE.depth == 0:
                for owner, name, stock in _STATE.stock:
                    setattr(owner, name, stock)


class _State:
    """The state of the faster forms across threads."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.depth = 0
        self.stock: list[tuple[_Any, str, _Any]] = []


_STATE = _State()


# ---- lanes


def _origin(lane: _Any) -> tuple[float, float] | None:
    """Return the start of a lane that points exactly east, or None; computed once a lane."""
    known: dict[str, _Any] = lane.__dict__
    if "_eyechart_origin" not in known:
        east = lane.direction.tolist() == [1.0, 0.0] and lane.direction_lateral.tolist() == [0.0, 1.0]
        start = lane.start.tolist()
        known["_eyechart_origin"] = (float(start[0]), float(start[1])) if east else None
    origin: tuple[float, float] | None = known["_eyechart_origin"]
    return origin


def _local_coordinates(self: _Any, position: _Any) -> tuple[float, float]:
    origin = _origin(self)
    if origin is None:
        stock: tuple[float, float] = _STOCK_COORDINATES(self, position)
        return stock
    x, y = position.tolist()
    return x - origin[0] + 0.0, y - origin[1] + 0.0


def _closest_lane_index(self: _Any, position: _Any, heading: float | None = None) -> tuple[str, str, int]:
    x, y = position.tolist()
    least, result = None, None
    for start, ends in self.graph.items():
        for end, lanes in ends.items():
            for number, lane in enumerate(lanes):
                origin = _origin(lane) if type(lane) is StraightLane and heading is not None else None
                if origin is None:
                    distance = lane.distance_with_heading(position, heading)
                else:
                    s, r = x - origin[0] + 0.0, y - origin[1] + 0.0
                    angle = abs((heading - lane.heading + np.pi) % _TWO_PI - np.pi)
                    distance = abs(r) + max(s - lane.length, 0) + max(0 - s, 0) + 1.0 * angle
                if least is None or distance < least:
                    least, result = distance, (start, end, number)
    assert result is not None
    return result


# ---- vehicles that decide at the same instant


def _act(self: _Any) -> None:
    self.eyechart_members = {}
    try:
        for vehicle in self.vehicles:
            vehicle.act()
    finally:
        del self.eyechart_members


def _neighbour_vehicles(self: _Any, vehicle: _Any, lane_index: _Any = None) -> tuple[_Any, _Any]:
    lane_index = lane_index or vehicle.lane_index
    known = self.__dict__.get("eyechart_members")
    if not lane_index or known is None or self.neighbour_vehicles_connected_lanes:
        return _stock_neighbours(self, vehicle, lane_index)
    lane = self.network.get_lane(lane_index)
    origin = _origin(lane) if type(lane) is StraightLane else None
    if origin is None:
        return _stock_neighbours(self, vehicle, lane_index)
    if lane not in known:
        known[lane] = _members(self, lane, origin)
    s = float(vehicle.position[0]) - origin[0] + 0.0
    front = rear = None
    s_front = s_rear = 0.0
    for s_other, other in known[lane]:
        if other is vehicle:
            continue
        if s <= s_other:
            if front is None or s_other <= s_front:
                s_front, front = s_other, other
        elif rear is None or s_other > s_rear:
            s_rear, rear = s_other, other
    return front, rear


def _stock_neighbours(road: _Any, vehicle: _Any, lane_index: _Any) -> tuple[_Any, _Any]:
    neighbours: tuple[_Any, _Any] = _STOCK_NEIGHBOURS(road, vehicle, lane_index)
    return neighbours


def _members(road: _Any, lane: _Any, origin: tuple[float, float]) -> list[tuple[float, _Any]]:
    """Return the vehicles and objects on a lane with their places, in the road's order."""
    aside = lane.width / 2 + _ON_LANE_MARGIN_M
    first, last = -lane.VEHICLE_LENGTH, float(lane.length) + lane.VEHICLE_LENGTH
    members = []
    for other in road.vehicles + road.objects:
        x, y = other.position.tolist()
        s = x - origin[0] + 0.0
        if abs(y - origin[1] + 0.0) <= aside and first <= s < last and not isinstance(other, Landmark):
            members.append((s, other))
    return members


# ---- collisions


def _step(self: _Any, dt: float) -> None:
    for vehicle in self.vehicles:
        vehicle.step(dt)
    things = [(thing, *thing.position.tolist(), thing.diagonal) for thing in self.vehicles + self.objects]
    count = len(self.vehicles)
    for number in range(count):
        vehicle, x, y, diagonal = things[number]
        reach = vehicle.speed * dt + _CERTAINLY_M
        for other, other_x, other_y, other_diagonal in things[number + 1 :]:
            near = (diagonal + other_diagonal) / 2 + reach
            if abs(other_x - x) <= near and abs(other_y - y) <= near:
                vehicle.handle_collisions(other, dt)


# ---- scalars


class _ScalarNumpy(ModuleType):
    """numpy for modules that clip one number at a time."""

    def __getattr__(self, name: str) -> _Any:
        value = getattr(np, name)
        setattr(self, name, value)
        return value

    @staticmethod
    def clip(value: _Any, low: _Any, high: _Any) -> _Any:
        """Return ``np.clip`` of one number, or of an array by numpy itself."""
        if isinstance(value, float):
            return low if value < low else min(value, high)
        return np.clip(value, low, high)


_SCALAR_NUMPY = _ScalarNumpy("numpy")

_FASTER: tuple[tuple[_Any, str, Callable[..., _Any] | ModuleType], ...] = (
    (StraightLane, "local_coordinates", _local_coordinates),
    (RoadNetwork, "get_closest_lane_index", _closest_lane_index),
    (Road, "act", _act),
    (Road, "neighbour_vehicles", _neighbour_vehicles),
    (Road, "step", _step),
    (behavior, "np", _SCALAR_NUMPY),
    (controller, "np", _SCALAR_NUMPY),
)
