"""Staged moments: natural traffic with the lead and the ego's sides placed by a balanced plan.

A drive closes its gaps as time goes by and rarely needs a side (8 of 144 frames). It therefore
cannot separate a controller that follows the gap from one that follows the clock. Here only the
lead, the sides and the own lane are placed. All else is highway-env's own traffic: its vehicles
drive by its own models, and the ego takes the place of one of them.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from eyechart.errors import BankError
from eyechart.frames import LEAD_GAP
from eyechart.seeds import key_seed
from eyechart.simulators.banks import BOXED, Moment, Preset, by_dozens
from eyechart.simulators.highway.counterfactuals import FAR_M, LOWEST_M, record
from eyechart.simulators.highway.speedups import speedups
from eyechart.simulators.highway.stock import IDMVehicle, MDPVehicle, MergeEnv, Vehicle
from eyechart.simulators.highway.truth import is_visible, read_scene
from eyechart.simulators.highway.world import LANE_M, SIMULATION_HZ, EnvironmentSetting, StockCamera, World, simulate
from eyechart.simulators.plan import Bands, Lanes, MomentSpec, make_plan
from eyechart.spaces.scene import Scene

_BURN_IN_STEPS = 2 * SIMULATION_HZ
_STEPS_A_MOMENT = 9
_MOST_STEPS = 30 * SIMULATION_HZ
_RAMP_X_M = (60.0, 220.0)
"""The places where merge-v0 shows its ramp and the joining lane has not begun."""

_MERGE_LANES = 2
_RAMP_Y_M = (_MERGE_LANES - 0.5) * LANE_M


@dataclass(frozen=True, slots=True)
class PlacedVehicle:
    """A vehicle's place in metres, its heading in radians and its speed in m/s."""

    x: float
    y: float
    heading: float
    speed: float
    on_ramp: bool = False

    @property
    def lane(self) -> int:
        """Return the nearest lane, from the left."""
        return round(self.y / LANE_M)


@dataclass(frozen=True, slots=True)
class Traffic:
    """Traffic at one instant, and the vehicle whose place the ego takes."""

    ego: PlacedVehicle
    others: tuple[PlacedVehicle, ...]
    lanes: int


def drive_naturally(world: World, moments: int) -> list[Traffic]:
    """Return instants of natural traffic in order of time, at 15 Hz; more moments need more.

    Raises BankError if merge-v0's traffic does not reach its ramp.
    """
    if isinstance(world, MergeEnv):
        return _drive_by_the_ramp(world)
    world.road.vehicles.remove(world.vehicle)
    for _ in range(_BURN_IN_STEPS):
        simulate(world)
    in_order = sorted(world.road.vehicles, key=lambda vehicle: float(vehicle.position[0]))
    ego = in_order[len(in_order) // 2]
    instants = []
    for _ in range(min(_STEPS_A_MOMENT * moments, _MOST_STEPS)):
        simulate(world)
        instants.append(_read(world, ego, lanes=int(world.config["lanes_count"])))
    return instants


def _drive_by_the_ramp(world: World) -> list[Traffic]:
    """Return the instants at which the ego passes the ramp; merge-v0 starts it before the ramp."""
    ego = IDMVehicle.create_from(world.vehicle)
    world.road.vehicles = [ego if vehicle is world.vehicle else vehicle for vehicle in world.road.vehicles]
    instants = []
    for _ in range(_MOST_STEPS):
        simulate(world)
        x = float(ego.position[0])
        if x > _RAMP_X_M[1]:
            break
        if x >= _RAMP_X_M[0]:
            instants.append(_read(world, ego, lanes=_MERGE_LANES))
    if not instants:
        raise BankError("the traffic of scenario 'merge' does not reach the ramp with this seed; use another seed")
    return instants


def _read(world: World, ego: Any, *, lanes: int) -> Traffic:  # noqa: ANN401  (highway-env has no types)
    def place(vehicle: Any) -> PlacedVehicle:  # noqa: ANN401  (highway-env has no types)
        x, y = map(float, vehicle.position)
        on_ramp = isinstance(world, MergeEnv) and y > _RAMP_Y_M
        return PlacedVehicle(x=x, y=y, heading=float(vehicle.heading), speed=float(vehicle.speed), on_ramp=on_ramp)

    others = tuple(place(vehicle) for vehicle in world.road.vehicles if vehicle is not ego)
    return Traffic(ego=place(ego), others=others, lanes=lanes)


STAGES: Mapping[str, EnvironmentSetting] = {
    "light": EnvironmentSetting("highway-v0", {"lanes_count": 4, "vehicles_count": 18, "vehicles_density": 0.7}),
    "dense": EnvironmentSetting("highway-v0", {"lanes_count": 3, "vehicles_count": 42, "vehicles_density": 3.0}),
    "merge": EnvironmentSetting("merge-v0", {}),
    "blocked": EnvironmentSetting("highway-v0", {"lanes_count": 5, "vehicles_count": 14, "vehicles_density": 0.5}),
}
"""The scenarios of preset ``balanced``. The picture tells them apart: two lanes and a ramp, or
three, four or five lanes. The lead of ``blocked`` stands still, and highway-env paints it
yellow."""

_LANES = {
    "light": Lanes(count=4, ego=(1, 2)),
    "dense": Lanes(count=3, ego=(0, 1, 2)),
    "merge": Lanes(count=2, ego=(0, 1)),
    "blocked": Lanes(count=5, ego=(1, 2, 3)),
}
"""The picture does not reach far enough to tell the outer lanes of four and of five apart."""

GAPS = Bands(near=(6.5, 5.0), close=(12.6, 4.8), middle=(18.6, 20.8), far=(42.0, 28.0), beyond=(82.0, 18.0))
"""About 12, 18 and 40 m, and the picture's edge at 76 m."""

_BEHIND_M = -9.0
_CLEAR_M = (-14.0, 42.0)
_BLOCKING_M = (-10.0, 38.0)
"""Inside and outside -12 to 40 m by enough that no side is a borderline case."""

_SPACING_M = 7.5
_OFF_CENTRE_M = 0.6
_JOINING_Y_M = 2 * LANE_M
"""The lane to which the ramp of merge-v0 leads."""

_SAME_M = 1e-6
_TRIES = 100


@dataclass(frozen=True, slots=True)
class _TrafficLayout:
    """The places of a moment's vehicles."""

    ego: PlacedVehicle
    lead: PlacedVehicle
    others: tuple[PlacedVehicle, ...]


def stage(scenario: str, seed: int, steps: int, *, boxed: bool = False) -> Iterator[Moment]:
    """Yield the moments of one episode in the order of natural time.

    With ``boxed`` they are those of the staging version `BOXED`.
    """
    rng = np.random.default_rng(key_seed("highway", "balanced", scenario, seed))
    with speedups():
        world = STAGES[scenario].open(seed)
        instants = drive_naturally(world, steps)
    camera = StockCamera(world)
    for number, wish in enumerate(make_plan(_LANES[scenario], GAPS, steps, rng, boxed=boxed)):
        _set_up(world, instants[number * len(instants) // steps], wish, still=scenario == "blocked", rng=rng)
        yield record(world, camera, rng, lowest=boxed)


def _set_up(world: World, traffic: Traffic, wish: MomentSpec, *, still: bool, rng: np.random.Generator) -> None:
    """Put a moment that fulfils the plan on the world's road."""
    for _ in range(_TRIES):
        layout = _lay_out(traffic, wish, rng)
        if layout is None:
            continue
        _show(world, layout, still=still)
        if _holds(read_scene(world), wish):
            return
    raise BankError(f"no moment with a gap of {wish.gap_m:.1f} m could be staged; use another seed")


def _holds(scene: Scene, wish: MomentSpec) -> bool:
    """Return whether a scene fulfils the plan, as far as the picture reaches."""
    seen = scene.gap_m is not None
    as_wished = scene.gap_m is not None and abs(scene.gap_m - wish.gap_m) < _SAME_M
    return (scene.left_clear, scene.right_clear) == wish.sides and (as_wished if is_visible(wish.gap_m) else not seen)


def _lay_out(traffic: Traffic, wish: MomentSpec, rng: np.random.Generator) -> _TrafficLayout | None:
    """Return the traffic with its lead and sides placed, or None if a blocked side has no room."""
    ego = replace(traffic.ego, y=wish.lane * LANE_M, heading=0.0)
    lead = replace(ego, x=ego.x + wish.gap_m)
    vehicles: list[PlacedVehicle] = []
    for vehicle in traffic.others:
        settled = _settle(vehicle)
        if _may_stay(settled, ego, wish) and not _overlaps(settled, vehicles):
            vehicles.append(settled)
    for side, clear in zip((-1, 1), wish.sides, strict=True):
        lane = wish.lane + side
        if clear or not 0 <= lane < traffic.lanes or any(_blocks(vehicle, ego, lane) for vehicle in vehicles):
            continue
        beside = replace(ego, x=ego.x + float(rng.uniform(*_BLOCKING_M)), y=lane * LANE_M)
        if _overlaps(beside, vehicles):
            return None
        vehicles.append(beside)
    return _TrafficLayout(ego=ego, lead=lead, others=tuple(vehicles))


def _settle(vehicle: PlacedVehicle) -> PlacedVehicle:
    """Return a vehicle that changes lanes as if it had arrived, so that no lane is half taken."""
    centre = vehicle.lane * LANE_M
    on_the_slope = vehicle.on_ramp and vehicle.y > _JOINING_Y_M
    return (
        vehicle if on_the_slope or abs(vehicle.y - centre) <= _OFF_CENTRE_M else replace(vehicle, y=centre, heading=0.0)
    )


def _may_stay(vehicle: PlacedVehicle, ego: PlacedVehicle, wish: MomentSpec) -> bool:
    """Return whether a natural vehicle leaves the own lane ahead free and the sides unambiguous."""
    ahead, aside = vehicle.x - ego.x, vehicle.lane - ego.lane
    if vehicle.on_ramp:
        return True
    if aside == 0:
        return ahead < _BEHIND_M
    if abs(aside) == 1:
        clear = wish.sides[0] if aside < 0 else wish.sides[1]
        return not _CLEAR_M[0] < ahead < _CLEAR_M[1] or (not clear and _BLOCKING_M[0] <= ahead <= _BLOCKING_M[1])
    return True


def _blocks(vehicle: PlacedVehicle, ego: PlacedVehicle, lane: int) -> bool:
    inside = _BLOCKING_M[0] <= vehicle.x - ego.x <= _BLOCKING_M[1]
    return inside and vehicle.lane == lane and not vehicle.on_ramp


def _overlaps(vehicle: PlacedVehicle, placed: list[PlacedVehicle]) -> bool:
    """Return whether a vehicle stands too near to another one of its lane or on a ramp."""
    return any(abs(vehicle.x - other.x) < _SPACING_M and abs(vehicle.y - other.y) < LANE_M - 1.0 for other in placed)


def _show(world: World, layout: _TrafficLayout, *, still: bool) -> None:
    """Put a layout's vehicles on the road; a lead that stands still is a plain vehicle."""
    road = world.road
    ego, lead = layout.ego, layout.lead
    place = [lead.x, lead.y]
    driver = MDPVehicle(road, [ego.x, ego.y], ego.heading, ego.speed)
    leader = Vehicle(road, place, 0.0, 0.0) if still else IDMVehicle(road, place, 0.0, lead.speed)
    others = [IDMVehicle(road, [other.x, other.y], other.heading, other.speed) for other in layout.others]
    road.vehicles = [driver, leader, *others]
    world.controlled_vehicles = [driver]


BALANCED = Preset(
    {name: one.as_dict() for name, one in STAGES.items()},
    by_dozens(stage),
    LEAD_GAP,
    span=(LOWEST_M, FAR_M[1]),
    staged={BOXED: by_dozens(partial(stage, boxed=True))},
)
