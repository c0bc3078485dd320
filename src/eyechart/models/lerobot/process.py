"""The program that holds a policy of LeRobot: it loads a checkpoint, and answers over pipes.

It runs in a Python that has lerobot and need not have eyechart, so it imports nothing of eyechart.
A message is the lengths of its two parts, a JSON object and raw bytes. Its own output stream and
its errors are apart, so that what libraries print reaches no message. It ends when its input ends.
"""

import importlib.metadata
import json
import os
import queue
import random
import struct
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import IO, Any

import numpy as np

LENGTHS = struct.Struct(">II")
MOST_WORDS, MOST_BYTES = 1_000_000, 500_000_000
"""The most bytes of a message's JSON object, and of its raw part."""
_LONGEST = 2000

Header = dict[str, Any]
Batch = Mapping[str, Any]


def read_message(source: IO[bytes]) -> tuple[Header, bytes]:
    """Return a message's object and raw bytes.

    Raises EOFError at the end of the source, and ValueError for what is no message.
    """
    words, raw = LENGTHS.unpack(_exactly(source, LENGTHS.size))
    if words > MOST_WORDS or raw > MOST_BYTES:
        raise ValueError(f"a message of {words} and {raw} bytes is too large")
    header = json.loads(_exactly(source, words))
    if not isinstance(header, dict):
        raise ValueError("a message begins with no object")  # noqa: TRY004 - it is a value of the other end
    return header, _exactly(source, raw)


def _exactly(source: IO[bytes], count: int) -> bytes:
    found = source.read(count)
    if len(found) < count:
        raise EOFError
    return found


def write_message(target: IO[bytes], header: Header, raw: bytes = b"") -> None:
    """Write a message; raises OSError where the other end is gone."""
    words = json.dumps(header).encode()
    target.write(LENGTHS.pack(len(words), len(raw)) + words + raw)
    target.flush()


def versions() -> Header:
    """Return the versions of this Python and of its packages; a missing package has none."""
    found: Header = {"python": ".".join(map(str, sys.version_info[:3]))}
    for name in ("lerobot", "torch"):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = ""
    return found


class LoadedPolicy:
    """A policy with its processors, as a checkpoint's folder holds them.

    ``request`` has the ``folder``, the ``device`` ("" for the checkpoint's own), ``window`` (how the
    policy takes several instants) and ``moves`` (whether a processor moves the inputs). Raises the
    errors of LeRobot, and ValueError where a normalisation lacks its statistics.
    """

    def __init__(self, request: Header) -> None:
        import torch  # noqa: PLC0415 - only the other Python has it
        from lerobot.configs import PreTrainedConfig  # noqa: PLC0415
        from lerobot.policies.factory import get_policy_class, make_pre_post_processors  # noqa: PLC0415

        folder = str(request["folder"])
        config = PreTrainedConfig.from_pretrained(folder, local_files_only=True)
        if request["device"]:
            config.device = str(request["device"])
        if "pretrained_backbone_weights" in vars(config):
            config.pretrained_backbone_weights = None  # the checkpoint has its own: nothing is fetched
        kind = get_policy_class(config.type)
        self.policy = kind.from_pretrained(folder, config=config, local_files_only=True, strict=True)
        moved = {"device_processor": {"device": config.device}} if request["moves"] else {}
        self.before, self.after = make_pre_post_processors(config, pretrained_path=folder, preprocessor_overrides=moved)
        for step in (*self.before.steps, *self.after.steps):
            _require_statistics(step)
        self.torch, self.config, self._seed = torch, config, 0
        self.chunk: Callable[[Sequence[Batch]], Any] = _WAYS[request["window"]](self)

    def answer(self, request: Header, raw: bytes) -> tuple[Header, bytes]:
        """Return a chunk of actions in the units of the data set, shape (steps, dimensions)."""
        self._seed = int(request["seed"])
        self.seed()
        for one in (self.policy, self.before, self.after):
            one.reset()
        with self.torch.no_grad():
            given = [self.before(self._batch(one, request["task"])) for one in _instants(request["instants"], raw)]
            chunk = self.after(self.chunk([_without_action(one) for one in given]))
        array = np.ascontiguousarray(chunk[0].float().cpu().numpy(), "<f4")
        return {"shape": array.shape}, array.tobytes()

    def seed(self) -> None:
        """Set what policies draw from to the seed of the call."""
        random.seed(self._seed)
        np.random.seed(self._seed % 2**32)  # noqa: NPY002 - policies draw from it
        self.torch.manual_seed(self._seed)

    def _batch(self, seen: tuple[Mapping[str, Any], Any], task: str) -> Header:
        """Return one instant as LeRobot's processors take it: pictures (1, 3, h, w) from 0 to 1."""
        pictures, state = seen
        found: Header = {"task": [task]}
        for name, pixels in pictures.items():
            scaled = np.ascontiguousarray(pixels.transpose(2, 0, 1)[None], np.float32) / np.float32(255)
            found[name] = self.torch.from_numpy(scaled)
        if len(state):
            found["observation.state"] = self.torch.from_numpy(state.astype(np.float32)[None])
        return found


def _without_action(batch: Batch) -> Batch:
    """Return a batch without the empty places that processors keep for an action and a reward."""
    return {name: one for name, one in batch.items() if one is not None and name != "action"}


def _instants(described: Sequence[Header], raw: bytes) -> Iterator[tuple[dict[str, Any], Any]]:
    """Yield each instant: its pictures (h, w, 3) by feature, and its state (n,)."""
    at = 0
    for one in described:
        pictures = {}
        for name, high, wide in one["pictures"]:
            pictures[name] = np.frombuffer(raw, np.uint8, high * wide * 3, at).reshape(high, wide, 3)
            at += high * wide * 3
        yield pictures, np.array(one["state"], np.float64)


def _alone(loaded: LoadedPolicy) -> Callable[[Sequence[Batch]], Any]:
    """Return the way of a policy that reads one instant."""
    return lambda instants: loaded.policy.predict_action_chunk(instants[-1])


def _stacked(loaded: LoadedPolicy) -> Callable[[Sequence[Batch]], Any]:
    """Return the way of a policy that takes its instants on an axis of their own."""

    def chunk(instants: Sequence[Batch]) -> Any:  # noqa: ANN401 - of torch
        names = [name for name in loaded.config.input_features if name in instants[-1]]
        whole = {name: loaded.torch.stack([one[name] for one in instants], dim=1) for name in names}
        return loaded.policy.predict_action_chunk({**instants[-1], **whole})

    return chunk


def _queued(loaded: LoadedPolicy) -> Callable[[Sequence[Batch]], Any]:
    """Return the way of a policy that keeps its instants in a queue: it is filled one by one."""

    def chunk(instants: Sequence[Batch]) -> Any:  # noqa: ANN401 - of torch
        for one in instants:
            loaded.policy.select_action(dict(one))
        loaded.seed()  # to fill the queue, numbers were drawn
        return loaded.policy.predict_action_chunk({**instants[-1], "observation.images": None})

    return chunk


_WAYS = {"alone": _alone, "stacked": _stacked, "queued": _queued}
_STATISTICS = {
    "MEAN_STD": ("mean", "std"),
    "MIN_MAX": ("min", "max"),
    "QUANTILES": ("q01", "q99"),
    "QUANTILE10": ("q10", "q90"),
}
"""The statistics that each normalisation needs; one without an entry needs none."""


def _require_statistics(step: Any) -> None:  # noqa: ANN401 - of LeRobot
    """Raise ValueError if a step normalises a feature whose statistics it lacks.

    LeRobot would leave such a feature as it is.
    """
    if type(step).__name__ not in {"NormalizerProcessorStep", "UnnormalizerProcessorStep"}:
        return
    known = step.state_dict()
    inwards, only = type(step).__name__ == "NormalizerProcessorStep", step.normalize_observation_keys
    for name, feature in step.features.items():
        if (name == "action") == inwards or (inwards and only is not None and name not in only):
            continue
        mode = step.norm_map.get(feature.type)
        needs = _STATISTICS.get("" if mode is None else mode.value, ())
        if lacking := [one for one in needs if f"{name}.{one}" not in known]:
            raise ValueError(f"the normalisation of '{name}' ({mode.value}) lacks its {' and '.join(lacking)}")


def serve(source: "queue.Queue[tuple[Header, bytes]]", target: IO[bytes]) -> None:
    """Answer messages: ``versions``, ``load`` and ``answer``; an error is answered in words."""
    loaded: LoadedPolicy | None = None
    while True:
        header, raw = source.get()
        answer: tuple[Header, bytes]
        try:
            if "load" in header:
                loaded = LoadedPolicy(header["load"])
                answer = {"loaded": loaded.config.type}, b""
            elif "answer" in header:
                assert loaded is not None
                answer = loaded.answer(header["answer"], raw)
            else:
                answer = versions(), b""
        except (Exception, SystemExit) as error:  # noqa: BLE001 - without an answer the other end waits for ever
            answer = {"failed": f"{type(error).__name__}: {error}"[:_LONGEST]}, b""
        write_message(target, *answer)


def _receive(source: IO[bytes], into: "queue.Queue[tuple[Header, bytes]]") -> None:
    """Pass messages on; end this process, whatever it is doing, when they end."""
    try:
        while True:
            into.put(read_message(source))
    except (EOFError, OSError, ValueError):
        os._exit(0)


def main() -> None:
    """Keep the pipes for messages, and give libraries an empty input and the stream of errors."""
    source, target = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    received: queue.Queue[tuple[Header, bytes]] = queue.Queue()
    threading.Thread(target=_receive, args=(source, received), daemon=True).start()
    try:
        serve(received, target)
    except OSError:  # the other end is gone
        os._exit(0)


if __name__ == "__main__":
    main()
