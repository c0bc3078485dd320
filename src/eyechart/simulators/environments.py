"""The worlds as Gymnasium environments for other runners, such as ``eyechart/Rover-v0``.

Gymnasium finds them with ``gymnasium.make("eyechart.simulators.environments:eyechart/Rover-v0")``,
which imports this module, or by its bare id after ``import eyechart.simulators.environments``.
"""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from eyechart.frames import RGB, Scalar
from eyechart.simulators import Drive, open_simulator

ENVIRONMENTS: Mapping[str, str] = {
    "eyechart/Rover-v0": "rover",
    "eyechart/Drone-v0": "drone",
}
"""The simulator behind each id."""

_MOST_SEED = 2**31 - 1
_FPS = 1


class DriveEnvironment(gymnasium.Env[RGB, np.int64]):
    """A simulator's drives: an observation is a picture, (h, w, 3) uint8, an action a number.

    Actions are numbered as in the simulator's action space: STOP, SLOW, STRAIGHT, LEFT, RIGHT.
    ``info`` holds the ground truth of the moment, the world's ``scenario`` and ``seed``, and after
    a step ``distance_m`` and ``ended``. A crash and the goal terminate an episode; the end of its
    time truncates it.

    ``scenario`` fixes the scenario; without it each episode draws one. ``reset(options={"scenario":
    …, "seed": …})`` opens the same world as ``eyechart run closed-loop`` does.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": _FPS}  # noqa: RUF012 - Gymnasium's own convention

    def __init__(self, simulator: str, scenario: str | None = None, render_mode: str | None = None) -> None:
        self._simulator = open_simulator(simulator)
        self._scenario = scenario
        self.render_mode = render_mode
        self._drive: Drive | None = None
        self._world: dict[str, Scalar] = {}
        drive = self._simulator.drive(scenario or next(iter(self._simulator.declared.scenarios)), 0)
        shape = drive.picture().shape
        drive.close()
        self.observation_space = gymnasium.spaces.Box(0, 255, shape, np.uint8)
        self.action_space = gymnasium.spaces.Discrete(len(self._simulator.declared.action_space.actions))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[RGB, dict[str, Any]]:
        """Open a world from the options, or from this environment's own random numbers.

        Raises SpecError for an unknown scenario or a seed out of range.
        """
        super().reset(seed=seed)
        chosen = options or {}
        names = list(self._simulator.declared.scenarios)
        drawn = names[int(self.np_random.integers(len(names)))]
        world_seed = int(self.np_random.integers(_MOST_SEED))
        self._world = {
            "scenario": str(chosen.get("scenario", self._scenario or drawn)),
            "seed": int(chosen.get("seed", world_seed)),
        }
        self.close()
        self._drive = self._simulator.drive(str(self._world["scenario"]), int(self._world["seed"] or 0))
        return self._drive.picture(), self._info({})

    def step(self, action: np.int64) -> tuple[RGB, float, bool, bool, dict[str, Any]]:
        """Drive on for the time of one decision; raises ResetNeeded before the first reset."""
        drive = self._under_way()
        moved = drive.step(self._simulator.declared.action_space.actions[int(action)])
        over = moved.ended is not None and moved.ended != "time"
        info = self._info({"distance_m": moved.distance_m, "ended": moved.ended})
        return drive.picture(), float(moved.reward), over, moved.ended == "time", info

    def render(self) -> RGB | None:
        """Return the camera's picture if the render mode is ``rgb_array``."""
        return self._under_way().picture() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the world."""
        if self._drive is not None:
            self._drive.close()
            self._drive = None

    def _info(self, more: Mapping[str, Scalar]) -> dict[str, Any]:
        return {**self._under_way().truth(), **self._world, **more}

    def _under_way(self) -> Drive:
        if self._drive is None:
            raise gymnasium.error.ResetNeeded("call reset() before step() and render()")
        return self._drive


def register_environments() -> None:
    """Register every environment that Gymnasium does not know yet."""
    for name, simulator in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            place = f"{__name__}:{DriveEnvironment.__name__}"
            gymnasium.register(name, entry_point=place, kwargs={"simulator": simulator}, order_enforce=True)


register_environments()
