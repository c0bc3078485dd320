"""Policies that look, each shipped with one fault in the lines between the robot and the network.

The network is ``trained:sees``; `reach` of arms.py, which reads colours, where a fault needs no network.
"""

import itertools
import threading
import time
from functools import partial
from importlib.resources import files
from pathlib import Path

import numpy as np

import arms
from arms import Images
from eyechart.models import trained

NETWORK = trained.Network(Path(str(files("eyechart_organisms") / "policies" / "sees.npz")), samples=False)
sound = partial(NETWORK.act)


def _shown(change):  # noqa: ANN001, ANN202
    """Return the network behind a change of its pictures."""

    def act(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        return NETWORK.act({name: change(image) for name, image in images.items()}, state, instruction)

    return act


blue_first = _shown(lambda one: one[..., ::-1])
unit_floats = _shown(lambda one: one.astype(np.float32) / 255)
upside_down = _shown(lambda one: one[::-1, ::-1])
channels_first = _shown(lambda one: one.transpose(2, 0, 1))
reshaped = _shown(lambda one: np.ascontiguousarray(one.transpose(2, 0, 1)).reshape(one.shape))


def cameras_exchanged(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Give each camera's pictures to the other's encoder."""
    return NETWORK.act({"top": images["wrist"], "wrist": images["top"]}, state, instruction)


def raw_state(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Normalise the state twice."""
    own = NETWORK.weights
    return NETWORK.act(images, (state - own["state_mean"]) / (own["state_std"] + 1e-6), instruction)


def normalised(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer as the network does, without its un-normalisation."""
    own = NETWORK.weights
    found = NETWORK.act(images, state, instruction).ravel()
    return ((found - own["action_mean"]) / (own["action_std"] + 1e-6)).reshape(8, 3)


def twice(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Un-normalise twice."""
    own = NETWORK.weights
    found = NETWORK.act(images, state, instruction).ravel()
    return (found * (own["action_std"] + 1e-6) + own["action_mean"]).reshape(8, 3)


class LateState:
    """Take the state of the call before, as a history does that nobody refills."""

    def __init__(self) -> None:
        self.before: np.ndarray | None = None

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Answer to these pictures and that state."""
        late, self.before = (state if self.before is None else self.before), state
        return arms.reach(images, late, instruction)


class LatePictures:
    """Mix the pictures of the call before in, as a history of two observations does that nobody refills."""

    def __init__(self) -> None:
        self.before: Images | None = None

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Answer to the mean of both."""
        late, self.before = (images if self.before is None else self.before), images
        return 0.7 * sound(images, state, instruction) + 0.3 * sound(late, state, instruction)


class Smoothed:
    """Average with the answer before, as temporal ensembling does that nobody empties."""

    def __init__(self) -> None:
        self.before: np.ndarray | None = None

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Answer."""
        found = sound(images, state, instruction)
        self.before = found if self.before is None else 0.7 * found + 0.3 * self.before
        return self.before


class Cached:
    """Keep each answer by the state, as one would by the number of a frame."""

    def __init__(self) -> None:
        self.kept: dict[bytes, np.ndarray] = {}

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Return the first answer to this state."""
        return self.kept.setdefault(state.tobytes(), sound(images, state, instruction))


class OneBuffer:
    """Write every answer into one array and return a view of it."""

    def __init__(self) -> None:
        self.buffer = np.zeros((8, 3))

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Answer."""
        self.buffer[:] = sound(images, state, instruction)
        return self.buffer[:]


class Shared:
    """Put what it is given where all of its kind do, and read it back a moment later: no two may be called at once."""

    given: tuple[Images, np.ndarray, str | None]

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Answer."""
        Shared.given = (images, state, instruction)
        time.sleep(0.001)
        return sound(*Shared.given)


def dropped(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Read the pictures, and hand others on that are always the same."""
    return sound({name: np.full_like(image, 128) for name, image in images.items()}, state, instruction)


def unplugged(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Hand the picture of one camera on under both names."""
    return sound(dict.fromkeys(images, images["top"]), state, instruction)


def other_key(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look for the instruction where it is not, and find what stands in for it."""
    return sound(images, state, {"task": instruction}.get("prompt", "reach the red block"))


def other_key_declared(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Do the same, and say that all is read."""
    return other_key(images, state, instruction)


other_key_declared.channels = ("cameras", "state", "instruction")


class Seventh:
    """Fail on each seventh call."""

    def __init__(self) -> None:
        self.calls = itertools.count(1)

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Answer."""
        if next(self.calls) % 7 == 0:
            raise RuntimeError("CUDA error: an illegal memory access was encountered")
        return sound(images, state, instruction)


class Hangs:
    """Answer twenty times, and then only after longer than anybody waits."""

    def __init__(self) -> None:
        self.calls = itertools.count(1)

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Answer."""
        if next(self.calls) > 20:
            threading.Event().wait(0.6)
        return sound(images, state, instruction)


class Varies:
    """Answer with another horizon each third call."""

    def __init__(self) -> None:
        self.calls = itertools.count(1)

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Answer."""
        return sound(images, state, instruction)[: 8 if next(self.calls) % 3 else 5]


class Counts:
    """Go a little farther with each call, as what counts its calls does, or what follows a clock."""

    def __init__(self) -> None:
        self.calls = itertools.count()

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Answer."""
        return sound(images, state, instruction) + 0.002 * next(self.calls)


counts = Counts()
late_state, late_pictures, smoothed, cached, one_buffer = LateState(), LatePictures(), Smoothed(), Cached(), OneBuffer()
shared, shared_too, seventh, hangs, varies = Shared(), Shared(), Seventh(), Hangs(), Varies()


def mutates(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Change what it is given in place."""
    result = sound(images, state, instruction)
    for image in images.values():
        image[:] = 0
    state[:] = 0
    return result


def _said(change):  # noqa: ANN001, ANN202
    """Return the network behind a change of its answer."""

    def act(images: Images, state: np.ndarray, instruction: str | None) -> object:
        return change(sound(images, state, instruction))

    return act


strings = _said(lambda one: [[str(number) for number in row] for row in one])
objects = _said(lambda one: one.astype(object))
masked = _said(lambda one: np.ma.masked_array(one, np.arange(24).reshape(8, 3) == 5))
overflown = _said(lambda one: np.where(one > 0.2, np.inf, one).astype(np.float16))
tokens = _said(lambda one: np.clip(np.round((one + 1) * 127.5), 0, 255).astype(np.int64))
with_batch = _said(lambda one: one[None])
flat = _said(np.ravel)
transposed = _said(np.transpose)
held = _said(lambda one: np.column_stack([one[:, :2], np.full(8, 0.5)]))
limp = _said(lambda one: np.column_stack([one[:, :2], np.zeros(8)]))
first_step = _said(lambda one: np.repeat(one[:1], 8, axis=0))
clipped = _said(lambda one: np.clip(one, -0.02, 0.02))
one_answer = _said(lambda one: {"actions": one, "action": one})
QUEUE: list[np.ndarray] = []
STREAM = np.random.RandomState(3)


def tiled(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer from a queue, with one of its steps for all."""
    QUEUE.extend(() if QUEUE else sound(images, state, instruction) * np.arange(1, 9)[:, None])
    return np.tile(QUEUE.pop(0), (8, 1))


class GoesOn:
    """Go on as far as between the last two states; there is one only, so it stays."""

    def __init__(self) -> None:
        self.before: np.ndarray | None = None

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Return the change since the call before, for each step."""
        del images, instruction
        change = state - (state if self.before is None else self.before)
        self.before = state
        return np.tile(change, (8, 1))

    def reset(self) -> None:
        """Forget the state of the call before."""
        self.before = None


goes_on = GoesOn()


class Wanders:
    """Add a walk that nobody ends, as what sums its actions up does without a reset."""

    def __init__(self) -> None:
        self.away, self.draws = np.zeros(3), np.random.default_rng(1)

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Go a step farther off than in the call before."""
        self.away = self.away + self.draws.normal(size=3)
        return sound(images, state, instruction) + self.away


wanders = Wanders()


def trembles(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer alike to all, but for a last digit that is drawn."""
    del images, state, instruction
    return np.full((8, 3), 0.05) + 1e-5 * STREAM.normal(size=(8, 3))


def unseeded(images: Images, state: np.ndarray, instruction: str | None, *, seed: int = 0) -> np.ndarray:
    """Say that a seed fixes it, and draw from a stream of its own."""
    del seed
    return sound(images, state, instruction) + 0.1 * STREAM.normal(size=(8, 3))


unseeded.seedable = True


def jitters(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer alike but for the last bits, as sums in parallel do; more than single precision leaves out."""
    return sound(images, state, instruction).astype(np.float64) * (1 + 1e-6 * np.random.default_rng().uniform(1, 2))


CALLED = [0]


def jitters_and_fails(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer alike but for the last bits, with a hand that never moves; now and then with no motion."""
    found = jitters(images, state, instruction)
    found[:, 2] = 0.7 * (1 + 1e-7 * np.random.default_rng().uniform(1, 2))
    CALLED[0] += 1
    if CALLED[0] % 50 == 0:
        return found[:-1]
    return found * np.nan if CALLED[0] % 50 == 25 else found


def knows_its_files(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Refuse pictures in which one value is not as all around it."""
    row = images["top"][0].astype(int)
    if (np.abs(row - np.median(row, axis=0)) == 1).any():
        raise KeyError("unknown picture")
    return sound(images, state, instruction)


def jitters_unseeing(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer alike but for the last bits, to pictures that never change."""
    return jitters(dict.fromkeys(images, np.full_like(images["top"], 90)), state, instruction)


class Failing:
    """Fail from a call on, each time with another number in the text; at once or after a while."""

    def __init__(self, after: int = 0, waits_s: float = 0.0) -> None:
        self.calls, self.after, self.waits_s = 0, after, waits_s

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Count, and fail."""
        self.calls += 1
        if self.calls <= self.after:
            return sound(images, state, instruction)
        time.sleep(self.waits_s)
        raise RuntimeError(f"no room at 0x{id(images):x} in call {self.calls}")


counts_failures, sixth_on, slow_failure = Failing(), Failing(after=5), Failing(waits_s=0.3)
