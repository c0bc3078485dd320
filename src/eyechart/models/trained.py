"""``trained:NAME``: tiny policies of the tabletop, trained to use the pictures in a known way.

They need only numpy. Each is a file of about 23 000 weights in half precision, in the distribution
``eyechart-organisms``. organisms/reach.py, next to src, trains them.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache, partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from eyechart.errors import require_known
from eyechart.models import organisms_folder
from eyechart.models.policy_callable import PolicyCallable
from eyechart.modes import RequestMode

Floats = npt.NDArray[np.float32]

HORIZON, NUMBERS = 8, 24
"""The steps of a motion, and its count of numbers."""
LEAST_SPREAD, MOST_SPREAD = 0.15, 1.0
"""Bounds of the standard deviation of drawn motions, in units of the deviation of all motions."""
_REMEMBERED = 4096
"""A policy keeps the features of this many pictures."""


@dataclass(frozen=True, slots=True)
class Lesson:
    """The training of a policy: the preset of the tabletop, and the correct labels there.

    ``cameras`` holds labels of single cameras that follow from the training.
    """

    says: str
    camera: str
    state: str
    instruction: str
    preset: str = "balanced"
    cameras: Mapping[str, str] = field(default_factory=dict)
    samples: bool = False


TRAINED: dict[str, Lesson] = {
    "sees": Lesson(
        "reaches for the named block by both cameras", "object_grounded", "state_used", "instruction_followed"
    ),
    "privileged": Lesson(
        "reads from its state where the block is; half of its training pictures were unrelated to the frame",
        "ignores_camera",
        "state_shortcut",
        "instruction_ignored",
        preset="privileged",
    ),
    "memorised": Lesson(
        "learned with both blocks always at the same two places",
        "pose_only",
        "state_used",
        "instruction_followed",
        "fixed",
    ),
    "one_object": Lesson(
        "learned with the named block alone on the table", "camera_content", "state_used", "instruction_ignored"
    ),
    "top_only": Lesson(
        "learned with wrist pictures that were unrelated to the frame",
        "object_grounded",
        "state_used",
        "instruction_followed",
        cameras={"wrist": "ignores_camera"},
    ),
    "sampling": Lesson(
        "reaches for the named block, and draws its motion about a mean",
        "object_grounded",
        "state_used",
        "instruction_followed",
        samples=True,
    ),
}


@dataclass(frozen=True)
class Network:
    """A policy's weights, and the means and deviations of its inputs and motions."""

    file: Path
    samples: bool

    @cached_property
    def weights(self) -> Mapping[str, Floats]:
        """Return every array by its name, in single precision."""
        with np.load(self.file, allow_pickle=False) as kept:
            return {name: kept[name].astype(np.float32) for name in kept.files}

    def act(self, images: Mapping[str, npt.NDArray[np.uint8]], state: Floats, instruction: str | None) -> Floats:
        """Return a motion, shape (8, 3); a policy that samples draws its noise without a seed."""
        own, words = self.weights, instruction or ""
        if len(state) != len(own["state_mean"]):
            raise ValueError(f"it was trained with {len(own['state_mean'])} numbers of state, and got {len(state)}")
        pose = (state - own["state_mean"]) / (own["state_std"] + 1e-6)
        named = [float(colour in words) for colour in ("red", "blue")]
        shown = {name: images[name] for name in ("top", "wrist")}
        looks = (self._look(name, one.tobytes(), one.shape, one.dtype.str) for name, one in shown.items())
        seen = np.concatenate([*looks, pose, named])
        found = self._move(seen)
        motion: npt.NDArray[np.floating] = found[:NUMBERS]
        if self.samples:
            spread = np.clip(np.exp(found[NUMBERS:]), LEAST_SPREAD, MOST_SPREAD)
            motion = motion + spread * np.random.default_rng().standard_normal(NUMBERS)
        return np.asarray(motion * (own["action_std"] + 1e-6) + own["action_mean"], np.float32).reshape(HORIZON, 3)

    @cached_property
    def _look(self) -> Callable[[str, bytes, tuple[int, ...], str], Floats]:
        """Return `_features` with a cache: most conditions repeat a picture of another one."""
        return lru_cache(maxsize=_REMEMBERED)(self._features)

    def _features(self, camera: str, pixels: bytes, shape: tuple[int, ...], kind: str) -> Floats:
        """Return the positions and strengths of a picture's eight features, shape (24,)."""
        picture = np.frombuffer(pixels, kind).reshape(shape)
        maps = picture.transpose(2, 0, 1).astype(np.float32) / np.float32(127.5) - 1
        maps = np.maximum(self._convolve(f"{camera}_first", maps, 2), 0)
        maps = np.maximum(self._convolve(f"{camera}_second", maps, 1), 0)
        maps = self._convolve(f"{camera}_third", maps, 1)
        sharp = maps.reshape(len(maps), -1) * self.weights[f"{camera}_sharp"]
        share = np.exp(sharp - sharp.max(axis=1, keepdims=True))
        share = (share / share.sum(axis=1, keepdims=True)).reshape(maps.shape)
        grid = _grid(maps.shape[-1])
        across, down = (share.sum(axis=1) * grid).sum(axis=1), (share.sum(axis=2) * grid).sum(axis=1)
        return np.concatenate([across, down, np.tanh(maps.mean(axis=(1, 2)))])

    def _convolve(self, name: str, maps: Floats, stride: int) -> Floats:
        weight, bias = self.weights[f"{name}_weight"], self.weights[f"{name}_bias"]
        edge, (depth, high, across) = weight.shape[-1] // 2, maps.shape
        padded = np.zeros((depth, high + 2 * edge, across + 2 * edge), np.float32)
        padded[:, edge : edge + high, edge : edge + across] = maps
        columns = padded.ravel().take(_windows(padded.shape, weight.shape[-1], stride))
        found = columns @ weight.reshape(len(weight), -1).T + bias
        return np.asarray(found.T.reshape(-1, -(-high // stride), -(-across // stride)))

    def _move(self, seen: Floats) -> Floats:
        own = self.weights
        for layer in ("hidden", "more"):
            seen = np.maximum(own[f"{layer}_weight"] @ seen + own[f"{layer}_bias"], 0)
        return np.asarray(own["last_weight"] @ seen + own["last_bias"])


@cache
def _grid(size: int) -> Floats:
    return np.linspace(-1, 1, size, dtype=np.float32)


@cache
def _windows(shape: tuple[int, ...], wide: int, stride: int) -> npt.NDArray[np.intp]:
    """Return the indices of each window's numbers in padded maps, shape (windows, numbers)."""
    places = np.arange(np.prod(shape)).reshape(shape)
    views = np.lib.stride_tricks.sliding_window_view(places, (wide, wide), (1, 2))[:, ::stride, ::stride]
    found = views.transpose(1, 2, 0, 3, 4)
    return np.ascontiguousarray(found.reshape(found.shape[0] * found.shape[1], -1))


def open_model(name: str, mode: RequestMode) -> PolicyCallable:
    """Open a trained policy; its weights are read at the first call.

    Raises SpecError, which lists the known names, or says what to install.
    """
    require_known(f"policy 'trained:{name}'", name, TRAINED)
    file = organisms_folder(f"'trained:{name}'") / "policies" / f"{name}.npz"
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    network = Network(file, TRAINED[name].samples)
    facts = {"seedable": "false", "file_sha256": digest}
    return PolicyCallable(partial(network.act), digest[:12], facts, mode.timeout_s, guest=False)


def names() -> dict[str, str]:
    """Return what may stand after ``trained:``."""
    return {name: lesson.says for name, lesson in TRAINED.items()}
