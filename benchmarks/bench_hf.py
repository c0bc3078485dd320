"""Concurrent queries through ``hf:``, which batches them, against one ``generate`` a call, as examples are written.

Both answer the same frames with the same weights in the same process; decisions must be equal on all of them. Target:
at least 3 times faster on a CPU, where nothing else runs; on a GPU, where there is one, the same is measured there.
Times are of the wall, as batches use several threads; of the pairs that alternate the greatest ratio counts. Writes
``results/bench_hf.json``.
"""

import argparse
import asyncio
import io
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import torch
from PIL import Image
from transformers import AutoModelForImageTextToText, AutoProcessor

from eyechart.calls import Query, Reply
from eyechart.frames import Stimulus
from eyechart.models import open_model
from eyechart.models.huggingface import organisms
from eyechart.modes import RequestMode
from eyechart.prompts import PROMPTS
from eyechart.simulators import open_simulator
from eyechart.spaces.discrete import DRIVING
from pairs import alternating, keep, ratios

TARGET = 3.0
PAIRS = 3
"""A pair takes as long as ten of other benchmarks."""
PROMPT = PROMPTS["baseline"]


def main() -> None:
    """Measure on every device that is here; exit 1 where the target is missed on the CPU, or a decision differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default="organism:grounded", help="what stands after hf:")
    parser.add_argument("--batch", type=int, default=36)
    parser.add_argument("--frames", type=int, default=144)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bank = open_simulator("highway").build(Path(folder) / "bank", seeds=(61, 62, 63))
        pictures = [bank.image(frame) for frame in bank][: args.frames]
    devices = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
    found = {device: measure(args.model, device, args.batch, pictures) for device in devices}
    keep("bench_hf", {"model": args.model, "batch": args.batch, "target": TARGET, **found})
    if (ratio := float(str(found["cpu"]["ratio"]))) < TARGET:
        raise SystemExit(f"hf: batches are {ratio:.1f} times faster; the target is {TARGET}")


def measure(name: str, device: str, batch: int, pictures: list[bytes]) -> dict[str, object]:
    """Print and return the times of both ways on a device, and the greatest ratio of the pairs."""
    batched, single = Batched(name, device, batch), Single(name, device)
    answers: dict[object, list[str]] = {}

    def asked(way: Single | Batched) -> Callable[[], None]:
        def ask() -> None:
            answers[way] = [DRIVING.read(Reply(text, "stop", None)).symbol for text in way.answer(pictures)]

        return ask

    for way in (single, batched):
        way.answer(pictures[: 2 * batch])  # warms up
    together_s, singly_s = alternating(asked(batched), asked(single), PAIRS, wall_s)
    batched.close()
    equal = sum(one == other for one, other in zip(answers[single], answers[batched], strict=True))
    singly, together = (min(taken) / len(pictures) for taken in (singly_s, together_s))
    ratio = max(ratios(together_s, singly_s))
    print(
        f"{device}, {torch.get_num_threads()} threads: one generate a call {1e3 * singly:.1f} ms a call, batches of "
        f"{batch} {1e3 * together:.1f} ms: {ratio:.1f} times faster; decisions equal on {equal} of "
        f"{len(pictures)} frames"
    )
    if equal < len(pictures):
        raise SystemExit("a batch changed a decision")
    each = {"one_generate_a_call_ms": 1e3 * singly, "in_batches_ms": 1e3 * together, "ratio": ratio}
    return {"pairs": PAIRS, "threads": torch.get_num_threads(), "frames": len(pictures), "equal": equal, **each}


def wall_s(way: Callable[[], object]) -> float:
    """Return the seconds of the wall that a way takes."""
    start = time.perf_counter()
    way()
    return time.perf_counter() - start


class Single:
    """Transformers as its examples use it: a picture and a prompt in, one ``generate``, a text out."""

    def __init__(self, name: str, device: str) -> None:
        place = str(organisms.folder(name.removeprefix("organism:"))) if name.startswith("organism:") else name
        self._processor = AutoProcessor.from_pretrained(place)
        dtype = torch.float32 if device == "cpu" else "auto"
        self._model = AutoModelForImageTextToText.from_pretrained(place, dtype=dtype).to(device).eval()

    def answer(self, pictures: list[bytes]) -> list[str]:
        """Return the text for each picture."""
        return [self._ask(Image.open(io.BytesIO(picture))) for picture in pictures]

    @torch.inference_mode()
    def _ask(self, picture: Image.Image) -> str:
        messages = [
            {"role": "system", "content": [{"type": "text", "text": PROMPT.system}]},
            {"role": "user", "content": [{"type": "image", "image": picture}, {"type": "text", "text": PROMPT.user}]},
        ]
        inputs = self._processor.apply_chat_template(
            messages, add_generation_prompt=True, tokenize=True, return_dict=True, return_tensors="pt"
        ).to(self._model.device, dtype=self._model.dtype)
        tokens = self._model.generate(**inputs, do_sample=False, max_new_tokens=64)
        return str(self._processor.decode(tokens[0, inputs["input_ids"].shape[1] :], skip_special_tokens=True))


class Batched:
    """The adapter, asked by as many callers as two batches hold: one is prepared while the other is generated."""

    def __init__(self, name: str, device: str, batch: int) -> None:
        spec = f"hf:{name}"
        mode = RequestMode(spec, max_tokens=64, options={"device": device, "batch": batch})
        self._model, self._callers = open_model(spec, mode), 2 * batch
        self._loop = asyncio.new_event_loop()

    def answer(self, pictures: list[bytes]) -> list[str]:
        """Return the text for each picture."""
        return self._loop.run_until_complete(self._ask(pictures))

    def close(self) -> None:
        """Let the model and the loop go."""
        self._loop.run_until_complete(self._model.close())
        self._loop.close()

    async def _ask(self, pictures: list[bytes]) -> list[str]:
        gate = asyncio.Semaphore(self._callers)

        async def one(picture: bytes) -> str:
            async with gate:
                return (await self._model.answer(Query(PROMPT.system, PROMPT.user, Stimulus.of(picture), 0))).text

        return await asyncio.gather(*map(one, pictures))


if __name__ == "__main__":
    main()
