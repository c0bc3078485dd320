"""Policies of the tabletop whose answer is known, as somebody would write them: callables, and some with a fault."""

import itertools
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from eyechart.simulators.tabletop.pictures import BLOCKS, SIZE, ZOOM
from eyechart.simulators.tabletop.world import COLOURS, Workspace, oracle

Images = Mapping[str, np.ndarray]


def blocks(picture: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Return where red and blue are seen from above; where the tool is, for one that is covered or not there."""
    found = []
    for paint in BLOCKS:
        down, across = np.nonzero(np.abs(picture - np.array(paint, np.int16)).sum(axis=2) < 60)
        found.append(np.array([across.mean() + 0.5, down.mean() + 0.5]) / SIZE if len(down) else tool)
    return np.array(found)


def reach(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look from above, and go to the block that is named."""
    named = next(colour for colour in COLOURS if colour in (instruction or "red"))
    return oracle(Workspace(state[:2], float(state[2]), blocks(images["top"], state[:2]), named))


def middle(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Never look, and go to the middle of the table."""
    del images, instruction
    return oracle(Workspace(state[:2], float(state[2]), np.full((2, 2), 0.5), "red"))


def deaf(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look, and go to the red block whatever is said."""
    del instruction
    return reach(images, state, "red")


reach.channels = ("camera:top", "state", "instruction")  # type: ignore[attr-defined]
middle.channels = ("state",)  # type: ignore[attr-defined]
deaf.channels = ("camera:top", "state")  # type: ignore[attr-defined]


def unsteady(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look, and draw the answer."""
    return reach(images, state, instruction) + 0.2 * np.random.default_rng().normal(size=(8, 3))


def tossed(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Draw the answer from much noise."""
    return reach(images, state, instruction) / 2 + np.random.default_rng().normal(size=(8, 3)) * 0.6


def fixed(images: Images, state: np.ndarray, instruction: str | None, *, seed: int) -> np.ndarray:
    """Look, and draw the answer by a seed."""
    return reach(images, state, instruction) + 0.2 * np.random.default_rng(seed).normal(size=(8, 3))


fixed.seedable = True
fixed.version = "seven"
fixed.channels = ("cameras", "state", "instruction")


def not_a_number(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look, and answer with one number that is none."""
    result = reach(images, state, instruction)
    result[3, 1] = np.nan
    return result


def half(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look, and answer with the first half of a motion."""
    return reach(images, state, instruction)[:4]


def raw(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look, and answer in another unit."""
    return 10 * reach(images, state, instruction)


def still(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Stay where it is."""
    del images, state, instruction
    return np.zeros((8, 3))


def broken(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Ask for a camera that is not there."""
    del state, instruction
    return images["left"]


class Queue:
    """Answers two calls in three from what it planned before, as a policy does that nobody resets."""

    def __init__(self) -> None:
        self.calls, self.plan = itertools.count(), np.zeros((8, 3))

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Return the plan of the last call in three."""
        if next(self.calls) % 3 == 0:
            self.plan = reach(images, state, instruction)
        return self.plan


class Reset(Queue):
    """The same, and it can be reset."""

    def reset(self) -> None:
        """Forget what was planned."""
        self.calls = itertools.count()


queue: Callable[..., np.ndarray] = Queue()
reset: Callable[..., np.ndarray] = Reset()


def poses(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look from above for nothing but its own tool, and go from there to the middle."""
    del instruction
    down, across = np.nonzero(images["top"].astype(int).sum(axis=2) < 150)
    tool = np.array([across.mean() + 0.5, down.mean() + 0.5]) / SIZE if len(down) else np.full(2, 0.5)
    return oracle(Workspace(tool, float(state[2]), np.full((2, 2), 0.5), "red"))


def liar(images: Images, state: np.ndarray, instruction: str | None, *, seed: int) -> np.ndarray:
    """Never look, say that a seed fixes the answer, and draw it."""
    del seed
    return middle(images, state, instruction) + 0.25 * np.random.default_rng().normal(size=(8, 3))


liar.seedable = True  # type: ignore[attr-defined]


def by_wrist(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look with the wrist's camera alone, which shows blocks from the tool; go to the middle where none is seen."""
    named = next(colour for colour in COLOURS if colour in (instruction or "red"))
    seen = blocks(images["wrist"], np.full(2, np.nan))
    places = np.where(np.isfinite(seen), state[:2] + (seen - 0.5) / ZOOM, 0.5)
    return oracle(Workspace(state[:2], float(state[2]), places, named))


def parcel(images: Images, state: np.ndarray, instruction: str | None) -> dict[str, np.ndarray]:
    """Look, and put the answer into a dict beside another array, so that neither is the answer."""
    motion = reach(images, state, instruction)
    return {"actions": motion, "velocities": motion / 2}


async def awaited(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look, once somebody awaits it."""
    return reach(images, state, instruction)


def sightless(images: Images, state: np.ndarray) -> np.ndarray:
    """Take no instruction."""
    return reach(images, state, "red")


def seedless(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Say that a seed fixes it, and take none."""
    return reach(images, state, instruction)


seedless.seedable = True  # type: ignore[attr-defined]


middle_undeclared, reach_undeclared, deaf_undeclared = partial(middle), partial(reach), partial(deaf)
reach_all_cameras, middle_all_cameras, reach_wrist_too = partial(reach), partial(middle), partial(reach)
reach_all_cameras.channels = ("cameras", "state", "instruction")  # type: ignore[attr-defined]
middle_all_cameras.channels = ("cameras", "state")  # type: ignore[attr-defined]
reach_wrist_too.channels = ("camera:top", "camera:wrist", "state", "instruction")  # type: ignore[attr-defined]


def front(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Declare a camera that the bank has not."""
    return reach(images, state, instruction)


def secret(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Read the instruction, and declare that it does not."""
    return reach(images, state, instruction)


front.channels = ("camera:front",)  # type: ignore[attr-defined]
secret.channels = ("camera:top", "state")  # type: ignore[attr-defined]


def nearly_still(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Move by rounding alone."""
    return 1e-7 * reach(images, state, instruction)


DRAWS = np.random.default_rng()
"""What draws the answers of `trembling`."""


def trembling(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Draw its answer, whatever it is shown, as large as the log's."""
    del images, state, instruction
    return DRAWS.normal(size=(8, 3)) * 0.6
