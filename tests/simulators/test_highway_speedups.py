import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from highway_env.envs.intersection_env import IntersectionEnv
from highway_env.envs.merge_env import ConnectedLaneMergeEnv
from highway_env.envs.roundabout_env import RoundaboutEnv
from highway_env.road.lane import StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle import behavior, controller
from hypothesis import given
from hypothesis import strategies as st

from eyechart.simulators.highway.drives import DRIVES, drive_worlds, open_drive
from eyechart.simulators.highway.speedups import _ScalarNumpy, speedups

FINITE = st.floats(allow_nan=False, allow_infinity=False)
ACTIONS = {"faster": ("FASTER", "FASTER", "IDLE"), "aside": ("LANE_LEFT", "SLOWER", "LANE_RIGHT")}


def state(world: Any) -> bytes:  # noqa: ANN401  (highway-env has no types)
    """Return the raw floats of every vehicle's position, speed and heading, and who has crashed."""
    rows = [
        [*vehicle.position, vehicle.speed, vehicle.heading, vehicle.crashed, vehicle.lane_index[2]]
        for vehicle in world.road.vehicles
    ]
    return np.array(rows, dtype=np.float64).tobytes()


def states(scenario: str, seed: int, actions: Sequence[str]) -> list[bytes]:
    """Return the states of a drive with these actions, one before each and one after the last."""
    world = open_drive(scenario, seed)
    result = [state(world)]
    for action in actions:
        world.step(world.action_type.actions_indexes[action])
        result.append(state(world))
    return result


LATER = """
import sys
from eyechart.simulators.highway.drives import open_drive
from eyechart.simulators.highway.world import StockCamera
slow = {"matplotlib", "matplotlib.pyplot", "pandas"}
StockCamera(open_drive("merge", 1)).draw()
assert not slow & set(sys.modules)
from highway_env.envs.highway_env import HighwayEnv
from highway_env.vehicle import dynamics
seen, _ = HighwayEnv().reset(seed=1)
assert seen.shape == (5, 5)
import matplotlib, matplotlib.pyplot, pandas
assert dynamics.plt.subplots is matplotlib.pyplot.subplots
assert {type(sys.modules[name]).__name__ for name in slow} == {"module"}
"""


def test_tables_and_plots_are_imported_by_who_asks_for_them() -> None:
    """A drive needs neither pandas nor Matplotlib; the stock environment beside it gets both, and they are whole."""
    done = subprocess.run([sys.executable, "-c", LATER], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def stock_functions() -> list[object]:
    """Return what the speed-ups replace, as it stands now."""
    return [
        StraightLane.local_coordinates,
        RoadNetwork.get_closest_lane_index,
        Road.act,
        Road.neighbour_vehicles,
        Road.step,
        behavior.np,
        controller.np,
    ]


@pytest.mark.parametrize("actions", list(ACTIONS))
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("scenario", list(DRIVES))
def test_the_speedups_change_no_bit_of_any_state(scenario: str, seed: int, actions: str) -> None:
    """Positions, speeds and headings are equal byte for byte after every action, and so is who has crashed."""
    stock = states(scenario, seed, ACTIONS[actions])
    with speedups():
        faster = states(scenario, seed, ACTIONS[actions])
    assert faster == stock
    assert len(set(stock)) == len(stock)


def test_a_drive_is_what_stepping_the_stock_environment_gives() -> None:
    """The second of driving without observation and reward has the states of ``env.step``, before and after a crash."""
    faster = [(state(world), world.vehicle.crashed) for world in drive_worlds("blocked", 2, 5)]
    assert [each for each, _ in faster] == states("blocked", 2, ["IDLE"] * 4)
    assert {crashed for _, crashed in faster} == {False, True}


@pytest.mark.parametrize("road", [RoundaboutEnv, IntersectionEnv, ConnectedLaneMergeEnv])
def test_roads_that_do_not_point_east_go_the_stock_way(
    road: Callable[[], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Curved and crossing lanes, and lanes whose ends are connected, give the states of the stock functions."""
    for name in ("DISTANCE_WANTED", "COMFORT_ACC_MAX", "COMFORT_ACC_MIN"):  # an intersection sets them for good
        monkeypatch.setattr(behavior.IDMVehicle, name, getattr(behavior.IDMVehicle, name))

    def drive() -> list[bytes]:
        env = road()
        env.reset(seed=3)
        result = []
        for _ in range(3):
            env.step(1)
            result.append(state(env))
        return result

    stock = drive()
    with speedups():
        faster = drive()
    assert faster == stock


def test_the_stock_functions_come_back() -> None:
    """After the context, also a nested one, highway-env is as it was; inside, all seven functions are others."""
    before = stock_functions()
    with speedups():
        with speedups():
            pass
        inside = stock_functions()
        assert all(function is not other for function, other in zip(inside, before, strict=True))
    assert stock_functions() == before


def test_an_exception_inside_brings_the_stock_functions_back() -> None:
    """A step that fails, here in a vehicle's own decision, leaves no faster function behind."""
    before = stock_functions()
    world = open_drive("light", 0)

    def fail() -> None:
        raise ZeroDivisionError

    world.road.vehicles[3].act = fail
    with pytest.raises(ZeroDivisionError), speedups():
        world.road.act()
    assert stock_functions() == before
    assert "eyechart_members" not in vars(world.road)


@given(FINITE, FINITE, FINITE)
def test_clipping_one_number_is_numpys(value: float, one: float, other: float) -> None:
    """A float, numpy's or Python's, is clipped to the same number and sign of zero as by ``np.clip``."""
    low, high = sorted((one, other))
    for number in (value, np.float64(value)):
        clipped = _ScalarNumpy.clip(number, low, high)
        assert np.float64(clipped) == np.clip(number, low, high)
    assert _ScalarNumpy.clip(np.array([value]), low, high).shape == (1,)
