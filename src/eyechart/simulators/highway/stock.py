"""The parts of highway-env that eyechart uses, imported without pandas and Matplotlib.

These two take most of its time to import, and only its tables of observations and its plots need
them. They are imported on first use.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType


class _LazyModule(ModuleType):
    """A placeholder for a module that is imported on its first use."""

    def __getattr__(self, name: str) -> object:
        _leave()
        if self.__name__ == "pandas":
            import pandas as pd  # noqa: PLC0415 - later is the point

            return getattr(pd, name)
        import matplotlib as mpl  # noqa: PLC0415
        import matplotlib.pyplot as plt  # noqa: PLC0415

        return getattr(plt if self.__name__ == "matplotlib.pyplot" else mpl, name)


def _leave() -> None:
    """Remove the placeholders, so that later imports get the real modules."""
    for name in [name for name, module in sys.modules.items() if isinstance(module, _LazyModule)]:
        del sys.modules[name]


@contextmanager
def _later() -> Iterator[None]:
    """Delay imports of pandas and Matplotlib in the context; loaded modules stay as they are."""
    if "matplotlib" not in sys.modules:
        plots = sys.modules["matplotlib"] = _LazyModule("matplotlib")
        sys.modules["matplotlib.pyplot"] = plots.pyplot = _LazyModule("matplotlib.pyplot")  # type: ignore[attr-defined]
    if "pandas" not in sys.modules:
        sys.modules["pandas"] = _LazyModule("pandas")
    try:
        yield
    finally:
        _leave()


with _later():
    from highway_env.envs.highway_env import HighwayEnv
    from highway_env.envs.merge_env import MergeEnv
    from highway_env.road.graphics import RoadGraphics, WorldSurface
    from highway_env.road.lane import StraightLane
    from highway_env.road.road import Road, RoadNetwork
    from highway_env.vehicle import behavior, controller
    from highway_env.vehicle.behavior import IDMVehicle
    from highway_env.vehicle.controller import MDPVehicle
    from highway_env.vehicle.graphics import VehicleGraphics
    from highway_env.vehicle.kinematics import Vehicle
    from highway_env.vehicle.objects import Landmark

__all__ = [
    "HighwayEnv",
    "IDMVehicle",
    "Landmark",
    "MDPVehicle",
    "MergeEnv",
    "Road",
    "RoadGraphics",
    "RoadNetwork",
    "StraightLane",
    "Vehicle",
    "VehicleGraphics",
    "WorldSurface",
    "behavior",
    "controller",
]
