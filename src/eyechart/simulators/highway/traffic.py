"""Natural traffic: highway-env's vehicles drive by its own models, and one of them lends its place to the ego."""

from dataclasses import dataclass
from typing import Any

from highway_env.envs.merge_env import MergeEnv
from highway_env.vehicle.behavior import IDMVehicle

from eyechart.errors import BankError
from eyechart.simulators.highway.world import LANE_M, SIMULATION_HZ, World, simulate

_BURN_IN_STEPS = 2 * SIMULATION_HZ
_STEPS_A_MOMENT = 9
_MOST_STEPS = 30 * SIMULATION_HZ
_RAMP_X_M = (60.0, 220.0)
"""Where merge-v0 shows its ramp and the joining lane has not begun."""

_MERGE_LANES = 2
_RAMP_Y_M = (_MERGE_LANES - 0.5) * LANE_M


@dataclass(frozen=True, slots=True)
class Placed:
    """A vehicle's place in metres, its heading in radians and its speed in m/s."""

    x: float
    y: float
    heading: float
    speed: float
    on_ramp: bool = False

    @property
    def lane(self) -> int:
        """Return the lane that it is nearest to, from the left."""
        return round(self.y / LANE_M)


@dataclass(frozen=True, slots=True)
class Traffic:
    """Traffic at one instant on a road of so many lanes, and the vehicle whose place the ego takes."""

    ego: Placed
    others: tuple[Placed, ...]
    lanes: int


def drive_naturally(world: World, moments: int) -> list[Traffic]:
    """Return instants of natural traffic in order of time, at 15 Hz; more where more moments are wanted.

    Raises BankError where merge-v0's traffic does not come by its ramp.
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
    """Return the instants at which the ego passes the ramp; merge-v0 starts it before."""
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
        raise BankError("the traffic of scenario 'merge' does not reach the ramp with this seed; give another one")
    return instants


def _read(world: World, ego: Any, *, lanes: int) -> Traffic:  # noqa: ANN401  (highway-env has no types)
    def place(vehicle: Any) -> Placed:  # noqa: ANN401  (highway-env has no types)
        x, y = map(float, vehicle.position)
        on_ramp = isinstance(world, MergeEnv) and y > _RAMP_Y_M
        return Placed(x=x, y=y, heading=float(vehicle.heading), speed=float(vehicle.speed), on_ramp=on_ramp)

    others = tuple(place(vehicle) for vehicle in world.road.vehicles if vehicle is not ego)
    return Traffic(ego=place(ego), others=others, lanes=lanes)
