"""One policy in the shapes in which people bring it: of its inputs, of its answer, of what is named, and with a past.

All are the network of faulty_arms.py, which reads every channel, behind a few lines.
"""

import asyncio
from collections import namedtuple
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from arms import Images
from faulty_arms import GoesOn
from faulty_arms import sound as network


def plain(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Return an array (8, 3)."""
    return network(images, state, instruction)


def _said(change: Callable[[np.ndarray], object]) -> Callable[..., object]:
    """Return the policy behind a change of its answer."""

    def act(images: Images, state: np.ndarray, instruction: str | None) -> object:
        return change(network(images, state, instruction))

    return act


class _Tensor:
    """A tensor of torch: on a device, of a type, with or without a gradient; torch's own words where it is no array."""

    def __init__(self, numbers: np.ndarray, device: str = "cpu", *, dtype: str = "float32", grad: bool = False) -> None:
        self.numbers, self.device, self.dtype, self.grad, self.shape = numbers, device, dtype, grad, numbers.shape

    def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
        del dtype, copy
        if self.device != "cpu":
            raise TypeError(f"can't convert {self.device} device type tensor to numpy. Use Tensor.cpu() to copy the ten"
                            "sor to host memory first.")  # fmt: skip
        if self.grad:
            raise RuntimeError("Can't call numpy() on Tensor that requires grad. Use tensor.detach().numpy() instead.")
        if self.dtype == "bfloat16":
            raise TypeError("Got unsupported ScalarType BFloat16")
        return self.numbers

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, place: object) -> "_Tensor":
        return _Tensor(self.numbers[place], self.device, dtype=self.dtype, grad=self.grad)


class _Chunk:
    """A record with the array as an attribute, as several libraries have it."""

    def __init__(self, numbers: np.ndarray) -> None:
        self.actions, self.control_hz = numbers, 10.0


_Pair = namedtuple("_Pair", "actions info")  # noqa: PYI024 - one that nobody typed

# Answers that are the array.
tensor = _said(_Tensor)
actions_in_a_dict = _said(lambda one: {"actions": one})
action_in_a_dict = _said(lambda one: {"action": one.tolist(), "policy_timing": {"infer_ms": 3.0}})
lists = _said(np.ndarray.tolist)
list_of_rows = _said(list)
tuple_of_rows = _said(tuple)
double = _said(lambda one: one.astype(np.float64))
fortran = _said(np.asfortranarray)
read_only = _said(lambda one: np.frombuffer(one.tobytes(), one.dtype).reshape(one.shape))
nothing_masked = _said(np.ma.masked_array)
_BUFFER = np.zeros((8, 3), np.float32)


def own_buffer(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Return one array, which the next call changes."""
    _BUFFER[:] = network(images, state, instruction)
    return _BUFFER


# What is named.
class Arm:
    """One with a network, as an object."""

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Answer."""
        return network(images, state, instruction)

    def act(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Answer."""
        return network(images, state, instruction)

    def select_action(self, batch: dict[str, np.ndarray]) -> np.ndarray:
        """Answer to a dict, as LeRobot's policies do."""
        return batch["observation.state"]

    @staticmethod
    def still(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Answer without the object."""
        return network(images, state, instruction)


class _Policy:
    def select_action(self, batch: dict[str, np.ndarray]) -> np.ndarray:
        """Answer to a dict, as LeRobot's policies do."""
        return batch["observation.state"]


arm, policy = Arm(), _Policy()
bound = arm.act
partly = partial(lambda _, *given: network(*given), 3)
nameless = lambda images, state, instruction: network(images, state, instruction)  # noqa: E731, PLW0108


# Arguments.
def other_names(obs: Images, proprio: np.ndarray, task: str | None) -> np.ndarray:
    """Take them under names of its own."""
    return network(obs, proprio, task)


def further_options(images: Images, state: np.ndarray, instruction: str | None, temperature: float = 1.0) -> np.ndarray:
    """Take one more, with a default."""
    del temperature
    return network(images, state, instruction)


def any_arguments(*given: object) -> np.ndarray:
    """Take any."""
    return network(*given)


def keywords(*, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Take them by name alone."""
    return network(images, state, instruction)


def without_words(images: Images, state: np.ndarray) -> np.ndarray:
    """Take no instruction."""
    return network(images, state, "reach the red block")


def one_batch(batch: dict[str, np.ndarray]) -> np.ndarray:
    """Take one dict, as LeRobot's policies do."""
    return batch["observation.state"]


def controller(prompt: str, image: bytes | None) -> str:
    """Answer with a name."""
    del prompt, image
    return "left"


def wrong_camera(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look for another robot's camera."""
    return network({**images, "top": images["cam_high"]}, state, instruction)


def channels_first(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Take pictures of another order of axes."""
    if images["top"].shape[0] != 3:
        raise ValueError(f"expected 3 channels, got {images['top'].shape}")
    return network(images, state, instruction)


# What it does beside answering.
def writes(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Change its inputs."""
    found = network(images, state, instruction)
    for picture in images.values():
        picture[:] = 0
    state[:] = 0
    return found


_GIVEN: list[object] = []


def keeps(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Keep its inputs, and change those of the call before."""
    for before in _GIVEN:
        before[:] = 0
    _GIVEN[:] = [*images.values(), state]
    return network(images, state, instruction)


def prints(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Print a line a call."""
    print("INFO step", flush=True)  # noqa: T201
    return network(images, state, instruction)


def fails_in_lines(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Raise with a text of several lines, as libraries do that draw a frame around theirs."""
    del images, instruction
    raise RuntimeError(f"CUDA error:\n\n  device-side assert\r\n\tin {type(state).__name__}\n")


def leaves(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """End the program."""
    del images, state, instruction
    raise SystemExit(3)


def blind_to_grey(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Raise where nothing is to be seen."""
    if images["top"].std() < 1:
        raise RuntimeError("no object found")
    return network(images, state, instruction)


def ragged(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Return few steps in one half of the table."""
    return network(images, state, instruction)[: 5 if state[0] > 0.5 else 8]


# Answers that are not the array.
cuda = _said(lambda one: _Tensor(one, "cuda:0"))
with_gradient = _said(lambda one: _Tensor(one, grad=True))
bfloat16 = _said(lambda one: _Tensor(one, dtype="bfloat16"))
batch_axis = _said(lambda one: one[None])
batch_axis_in_a_dict = _said(lambda one: {"action": one[None]})
parts = _said(lambda one: {"action.arm": one[:, :2], "action.gripper": one[:, 2:]})
many_parts = _said(lambda one: {f"action.joint_position_{number}": one[:, :1] for number in range(60)})
two_arrays = _said(lambda one: {"actions": one, "values": one})
actions_and_attention = _said(lambda one: {"actions": one, "attn": one})
action_and_list = _said(lambda one: {"action": one, "info": [1, 2]})
parts_and_info = _said(lambda one: [{"action.arm": one[None, :, :2], "action.gripper": one[None, :, 2:]}, {}])
answer_and_info = _said(lambda one: (one, {"latency": 3}))
named_pair = _said(lambda one: _Pair(one, {}))
record = _said(_Chunk)
one_step = _said(lambda one: one[0])
one_step_batch = _said(lambda one: one[:1])
longer = _said(lambda one: np.concatenate([one, one]))
padded = _said(lambda one: np.pad(one, ((0, 0), (0, 29))))
padded_batch = _said(lambda one: np.pad(one, ((0, 0), (0, 29)))[None])
flat = _said(np.ravel)
transposed = _said(np.transpose)
no_steps = _said(lambda one: one[:0])
number = _said(lambda one: float(one[0, 0]))
ragged_rows = _said(lambda one: [row[: 2 + number % 2].tolist() for number, row in enumerate(one)])
not_a_number = _said(lambda one: np.where(np.arange(3) == 1, np.nan, one))
infinite = _said(lambda one: np.where(np.arange(24).reshape(8, 3) == 5, np.inf, one))
nothing = _said(lambda _: None)
word = _said(lambda _: "left")
word_in_a_dict = _said(lambda _: {"action": "left"})
numbers_as_text = _said(lambda one: [[f"{number:.3f}" for number in row] for row in one])
json_text = _said(lambda one: str(one.tolist()))
raw_bytes = _said(lambda one: one.tobytes())
masked = _said(lambda one: np.ma.masked_array(one, np.arange(24).reshape(8, 3) == 5))
objects = _said(lambda one: one.astype(object))
whether = _said(lambda one: one > 0)


async def coroutine(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer later."""
    await asyncio.sleep(0)
    return network(images, state, instruction)


def returns_a_coroutine(images: Images, state: np.ndarray, instruction: str | None) -> object:
    """Forget to wait."""
    return coroutine(images, state, instruction)


def generator(images: Images, state: np.ndarray, instruction: str | None) -> Iterator[np.ndarray]:
    """Answer step by step."""
    yield from network(images, state, instruction)


def returns_an_iterator(images: Images, state: np.ndarray, instruction: str | None) -> object:
    """Return one over the steps."""
    return iter(network(images, state, instruction))


def normalised(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Leave its un-normalisation out."""
    return 60 * (network(images, state, instruction) - 0.01)


# A past.
_STEPS: list[np.ndarray] = []
_TILED: list[np.ndarray] = []
_HIDDEN: list[np.ndarray] = []


def queue(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Return one step a call."""
    _STEPS.extend(() if _STEPS else network(images, state, instruction))
    return _STEPS.pop(0)


def queue_tiled(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Return one step a call, for all steps."""
    _TILED.extend(() if _TILED else network(images, state, instruction) * np.linspace(1, 2, 8)[:, None])
    return np.tile(_TILED.pop(0), (8, 1))


def recurrent(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Mix its last answers in."""
    _HIDDEN.append(network(images, state, instruction))
    return np.mean(_HIDDEN[-5:], axis=0)


def forget() -> None:
    """Empty what these three keep."""
    for kept in (_STEPS, _TILED, _HIDDEN):
        kept.clear()


class _Queue:
    """Plans eight steps, and asks its network again once they are gone; ``reset`` drops them."""

    def __init__(self) -> None:
        self.steps: list[np.ndarray] = []

    def __call__(self, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        self.steps = self.steps or list(network(images, state, instruction))
        return np.stack(self.steps)

    def reset(self) -> None:
        self.steps = []


queue_with_reset, two_observations = _Queue(), GoesOn()


def with_history(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Take one instant before the frame too."""
    return network({name: many[-1] for name, many in images.items()}, state[-1], instruction)


with_history.history = 1  # type: ignore[attr-defined]


# Batches.
def _each(images: list[Images], state: list[np.ndarray], instruction: list[str | None]) -> np.ndarray:
    return np.stack([network(*given) for given in zip(images, state, instruction, strict=True)])


batch_of_arrays = lambda *given: list(_each(*given))  # noqa: E731
batch_of_arrays.batch = 4  # type: ignore[attr-defined]
one_array_of_a_batch = lambda *given: {"actions": _each(*given)}  # noqa: E731
one_array_of_a_batch.batch = 4  # type: ignore[attr-defined]
first_of_a_batch = lambda *given: _each(*given)[:1]  # noqa: E731
first_of_a_batch.batch = 4  # type: ignore[attr-defined]


def one_query(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Declare batch, and be written for one query."""
    return network({**images, "top": images["top"]}, state, instruction)


one_query.batch = 4  # type: ignore[attr-defined]
reversed_batch = lambda *given: _each(*given)[::-1]  # noqa: E731
reversed_batch.batch = 4  # type: ignore[attr-defined]
