"""Drives in a Gymnasium environment, with checks of its pictures, its info and its end."""

import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from typing import Any

import gymnasium
import numpy as np

from eyechart.errors import DriveError, SpecError, raising
from eyechart.frames import RGB, Scalar
from eyechart.frames.control_draws import number_of
from eyechart.modes import in_one_line
from eyechart.simulators import StepResult
from eyechart.simulators.gym.action_map import ActionMap

Env = gymnasium.Env[Any, Any]

_TRUTH = ("lead_gap_m", "left_clear", "right_clear", "demand", "speed_mps", "crashed")
_ABSENT = object()
_MOST_SEED = 2**32 - 1


def make(env_id: str, settings: Mapping[str, object]) -> Env:
    """Make an environment that renders RGB; raises SpecError if that is not possible.

    ``env_id`` may begin with the module that registers it (``highway_env:highway-v0``), as in
    ``gymnasium.make``.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            env: Env = gymnasium.make(
                env_id, render_mode="rgb_array", disable_env_checker=True, **dict[str, Any](settings)
            )
    except gymnasium.error.UnregisteredEnv as error:
        raise SpecError(
            f"no environment '{env_id}': {in_one_line(error)} One of another package is named gym:MODULE:ENV_ID"
        ) from error
    except Exception as error:  # an environment's own code may raise anything
        raise SpecError(f"environment '{env_id}' cannot be made: {in_one_line(error)}") from error
    modes = env.metadata.get("render_modes", ())
    if "rgb_array" not in modes:
        env.close()
        raise SpecError(f"environment '{env_id}' renders no RGB pictures; its render modes are {list(modes)}")
    return env


_PLAIN = ("gymnasium.envs.classic_control", "gymnasium.envs.toy_text")
"""Gymnasium's own purely arithmetic environments: they read no file and import nothing by name."""


def is_plain(env_id: str) -> bool:
    """Return whether an id names a purely arithmetic environment of Gymnasium's own."""
    known = gymnasium.registry.get(env_id)
    return known is not None and isinstance(known.entry_point, str) and known.entry_point.startswith(_PLAIN)


def action_count(env: Env, env_id: str) -> tuple[int, int]:
    """Return the first action and the number of actions; raises SpecError if not discrete."""
    space = env.action_space
    if not isinstance(space, gymnasium.spaces.Discrete):
        raise SpecError(
            f"environment '{env_id}' has the actions {space}; eyechart drives discrete actions (spaces.Discrete) only"
        )
    return int(space.start), int(space.n)


class GymnasiumDrive:
    """A drive in a Gymnasium environment.

    It ends when the environment terminates: ``crash`` or ``goal``, as its info or the map says. It
    also ends when the info reports a crash, or after the time limit of the environment or the map
    (``time``). A column without a key in the map is None in the truth; speed and distance are None
    then too. Distance counts from its value before the first step, or from 0 if there was none.
    Raises DriveError if the environment raises, and if it renders a picture of one colour.
    """

    def __init__(self, env_id: str, action_map: ActionMap, settings: Mapping[str, object], seed: int) -> None:
        if not 0 <= seed <= _MOST_SEED:
            raise SpecError(f"seed {seed} is out of range; give seeds from 0 to {_MOST_SEED}")
        self._id = env_id
        self._map = action_map
        self._env = make(env_id, settings)
        self._steps = 0
        self._ended: str | None = None
        self._picture: RGB | None = None
        observation, info = self._ask("reset", lambda: self._env.reset(seed=seed))
        self._observation: object = observation
        self._truth = self._read(info, begun=False)
        self._start_m = number_of(self._truth.get("distance_m")) or 0.0

    def picture(self) -> RGB:
        """Return the rendered picture, shape (h, w, 3), uint8."""
        if self._picture is None:
            self._picture = self._render()
        return self._picture

    def truth(self) -> Mapping[str, Scalar]:
        """Return the truth from the environment's info; a column without a key is None."""
        return dict(self._truth)

    def step(self, action: str) -> StepResult:
        """Repeat this action as often as the map says, or until the environment ends."""
        if self._ended is not None:
            raise ValueError(f"the drive is over: {self._ended}")
        if action not in self._map.numbers:
            raise ValueError(f"'{action}' is none of {', '.join(self._map.numbers)}")
        number = self._map.numbers[action]
        self._picture = None
        self._steps += 1
        reward, terminated, truncated = 0.0, False, False
        for _ in range(self._map.repeat):
            outcome = self._ask(f"step {self._steps}", lambda: self._env.step(number))
            self._observation, gained, terminated, truncated, info = outcome
            self._truth = self._read(info, begun=True)
            reward += float(gained)
            if terminated or truncated or self._truth["crashed"]:
                break
        if not math.isfinite(reward):
            raise DriveError(f"environment '{self._id}' gave the reward {reward} in step {self._steps}")
        ended_badly = bool(terminated) and self._map.terminated == "crash"
        crashed = bool(self._truth["crashed"]) if "crashed" in self._map.info else ended_badly
        out_of_time = truncated or self._steps >= self._map.most_steps
        self._ended = "crash" if crashed else "goal" if terminated else "time" if out_of_time else None
        self._truth["crashed"] = crashed
        covered = number_of(self._truth.get("distance_m"))
        return StepResult(
            reward=reward,
            speed_mps=number_of(self._truth["speed_mps"]),
            distance_m=None if covered is None else covered - self._start_m,
            crashed=crashed,
            ended=self._ended,
        )

    def state(self, decimals: int | None = None) -> bytes:
        """Return a digest of the observation, the truth and the random numbers."""
        generator = getattr(self._env.unwrapped, "np_random", None)
        random = None if generator is None else generator.bit_generator.state
        digest = sha256()
        _feed(digest.update, (self._steps, self._observation, self._truth, random), decimals)
        return digest.digest()

    def close(self) -> None:
        """Close the environment; errors in closing are ignored."""
        with suppress(Exception):
            self._env.close()

    def _ask(self, when: str, ask: Callable[[], Any]) -> Any:  # noqa: ANN401  (whatever the environment gives)
        what = f"environment '{self._id}' raised in {when}"  # its own code may raise anything
        with raising(DriveError, what, of=Exception, words=in_one_line), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ask()

    def _render(self) -> RGB:
        drawn = np.array(self._ask(f"render after step {self._steps}", self._env.render))  # it may draw into it again
        if hasattr(self._env.unwrapped, "enable_auto_render"):
            # After its first picture, highway-env draws fourteen more in every step.
            self._env.unwrapped.enable_auto_render = False
        if drawn.dtype != np.uint8 or drawn.ndim != 3 or drawn.shape[2] != 3 or not drawn.size:
            raise DriveError(
                f"environment '{self._id}' renders {drawn.dtype} of shape {drawn.shape}, no RGB picture (h, w, 3) uint8"
            )
        if (drawn == drawn[0, 0]).all():
            dummy = os.environ.get("SDL_VIDEODRIVER") == "dummy"
            raise DriveError(
                f"environment '{self._id}' renders a picture of one colour, {tuple(drawn[0, 0].tolist())}, which "
                "shows nothing" + ("; SDL_VIDEODRIVER=dummy makes pygame draw nothing: unset it" if dummy else "")
            )
        return drawn

    def _read(self, info: Mapping[str, Any], *, begun: bool) -> dict[str, Scalar]:
        """Return the columns of truth; they may be missing before the first step."""
        truth: dict[str, Scalar] = dict.fromkeys(_TRUTH)
        truth["crashed"] = False
        for column, path in self._map.info.items():
            value: object = info
            for key in path.split("."):
                value = value.get(key, _ABSENT) if isinstance(value, Mapping) else _ABSENT
            if value is _ABSENT and begun:
                raise DriveError(f"environment '{self._id}': info has no '{path}'; it has {', '.join(map(str, info))}")
            if value is not _ABSENT:
                plain = value.item() if isinstance(value, np.generic | np.ndarray) and value.size == 1 else value
                if not isinstance(plain, str | int | float | bool | None):
                    kind = type(plain).__name__
                    raise DriveError(
                        f"environment '{self._id}': info '{path}' is a {kind}, and must be a number, text or flag"
                    )
                truth[column] = None if isinstance(plain, float) and not math.isfinite(plain) else plain
        return truth


def _feed(update: Callable[[bytes], object], value: object, decimals: int | None) -> None:
    """Feed plain values and arrays, however nested, to a digest; floats are rounded."""
    if decimals is not None and (
        isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind == "f")
    ):
        value = np.round(value, decimals) + 0.0  # no sign of zero
    if isinstance(value, np.ndarray):
        update(f"{value.dtype.str}{value.shape}".encode())
        update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Mapping):
        for key in sorted(value, key=str):
            _feed(update, key, decimals)
            _feed(update, value[key], decimals)
    elif isinstance(value, Sequence) and not isinstance(value, str | bytes):
        update(f"[{len(value)}".encode())
        for one in value:
            _feed(update, one, decimals)
    else:
        update(f"{type(value).__name__}:{value!r}\n".encode())
