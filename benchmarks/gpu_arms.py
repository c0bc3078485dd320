"""The arm of Transformers on a GPU: a battery beside the CPU's, every way of loading, memory, energy, and faults.

    make long-gpu
    python benchmarks/gpu_arms.py --only medium --only squeezed

Every part runs in processes of its own, and a part that raises leaves the others to go on. Needs a GPU that torch
reaches, and the model organisms (eyechart-organisms); every other checkpoint is made here, of random weights.
``--rehearse`` does the same on a CPU with small checkpoints and writes nothing. Writes ``benchmarks/results/gpu.json``;
``--only`` replaces those parts of it. Exit 1 where something is not as it should be, 2 where no GPU is there.
"""

import argparse
import asyncio
import contextlib
import datetime as dt
import json
import multiprocessing
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Self

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests")]

import eyechart  # noqa: E402 - the tests lie beside
from eyechart.calls import Query, Reply  # noqa: E402
from eyechart.errors import SpecError  # noqa: E402
from eyechart.frames import Stimulus, encode, open_bank  # noqa: E402
from eyechart.ledger import Ledger  # noqa: E402
from eyechart.manifest import LEDGER  # noqa: E402
from eyechart.models import energy, open_model  # noqa: E402
from eyechart.models.huggingface.checkpoint import require_library  # noqa: E402
from eyechart.models.huggingface.organisms import ORGANISMS  # noqa: E402
from eyechart.modes import RequestMode  # noqa: E402
from eyechart.prompts import PROMPTS  # noqa: E402
from eyechart.studies import battery as study  # noqa: E402
from eyechart.verdicts import judge  # noqa: E402

RESULT = ROOT / "benchmarks" / "results" / "gpu.json"
SPECS = {f"hf:organism:{name}": organism.calibrated for name, organism in ORGANISMS.items()}
LIBRARIES = ("torch", "transformers", "accelerate", "bitsandbytes", "nvidia-ml-py", "torchvision", "numpy")
WAYS: dict[str, dict[str, Any]] = {
    "default": {},
    "float16": {"dtype": "float16"},
    "bfloat16": {"dtype": "bfloat16"},
    "device_map": {"device_map": "auto"},
    "bits8": {"bits": 8},
    "bits4": {"bits": 4},
}
MEDIUM = {
    "text": {
        "hidden_size": 2048,
        "intermediate_size": 5504,
        "num_hidden_layers": 16,
        "num_attention_heads": 16,
        "num_key_value_heads": 16,
        "max_position_embeddings": 4096,
    },
    "vision": {"hidden_size": 512, "intermediate_size": 2048, "num_hidden_layers": 12, "num_attention_heads": 8},
    "side": 336,
}
"""A LLaVA of 0.86 billion parameters: 1.7 GB in bfloat16, and 576 tokens a picture."""
SMALL: dict[str, Any] = {"side": 56}
"""What a rehearsal takes instead."""
MB = 1e6
STEPS_S = 0.25
"""How far the sum of calls may be off the counter, as time: it moves every 0.1 s, and both ends fall between steps."""

QUERIES, TOKENS = 32, 24


@dataclass(frozen=True)
class Place:
    """Where checkpoints, banks and runs are made, and on which device the models run."""

    folder: Path
    device: str

    @property
    def medium(self) -> Path:
        """Return the checkpoint of a gigabyte or two."""
        return self.folder / "medium"

    @property
    def bank(self) -> Path:
        """Return the bank of frames."""
        return self.folder / "bank"


class Watch:
    """Notes the counters of energy and the board's power while it is open, by the clock; calls are read beside it."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, float, float]] = []
        self._counters = (*energy.gpu_counters(), *energy.processor_counters())
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._note)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _note(self) -> None:
        if not self._counters:
            return
        nvml = import_module("pynvml")
        boards = [nvml.nvmlDeviceGetHandleByIndex(at) for at in range(nvml.nvmlDeviceGetCount())]
        while not self._over.is_set():
            joules = sum(counter() for counter in self._counters)
            watts = sum(nvml.nvmlDeviceGetPowerUsage(board) for board in boards) / 1000.0
            self._rows.append((time.time(), joules, watts))
            time.sleep(0.005)

    def between(self, first: float, last: float) -> dict[str, float | None]:
        """Return what counters and power say of a time: joules, and power times time, with its mean."""
        if len(self._rows) < 2:
            return {"counter_j": None, "power_times_time_j": None, "watts": None}
        moments, joules, watts = np.array(self._rows).T
        before, after = np.interp([first, last], moments, joules)
        mean = float(np.interp(np.linspace(first, last, 1000), moments, watts).mean())
        return {
            "counter_j": round(float(after - before), 2),
            "power_times_time_j": round(mean * (last - first), 2),
            "watts": round(mean, 1),
        }

    def steps(self) -> dict[str, float | None]:
        """Return how often the counter moved: the median and the longest time between two changes, in seconds."""
        rows = self._rows
        moved = [rows[at][0] for at in range(1, len(rows)) if rows[at][1] != rows[at - 1][1]]
        gaps = np.diff(moved)
        whole = bool(len(gaps))
        return {
            "counter_step_s": round(float(np.median(gaps)), 4) if whole else None,
            "longest_step_s": round(float(gaps.max()), 4) if whole else None,
        }


def apart(function: Callable[..., Any], *args: object, seconds: float = 600) -> Any:  # noqa: ANN401 - what it returns
    """Return what a function returns in a fresh process, which holds nothing of a GPU before or after."""
    kind = multiprocessing.get_context("spawn")
    reading, writing = kind.Pipe(duplex=False)
    child = kind.Process(target=_send, args=(writing, function, *args))
    child.start()
    writing.close()
    try:
        if not reading.poll(seconds):
            raise TimeoutError(f"{function.__name__} took longer than {seconds:g} s")
        raised, value = reading.recv()
    finally:
        child.join(5)
        child.kill()
    if raised:
        raise RuntimeError(raised)
    return value


def _send(pipe: Any, function: Callable[..., Any], *args: object) -> None:  # noqa: ANN401 - the end of a pipe
    try:
        pipe.send(("", function(*args)))
    except Exception as error:  # noqa: BLE001 - it is raised where it was asked for
        traceback.print_exc()
        pipe.send((f"{type(error).__name__}: {error}"[:400], None))


def say(words: Sequence[object], *, first: str = "") -> dict[str, Any]:
    """Run a command of eyechart; return its exit code, what it printed last, and whether that was a traceback.

    ``first`` is Python that runs before, in its process.
    """
    began = time.monotonic()
    done = subprocess.run(command(words, first), capture_output=True, text=True, check=False)
    lines = [line for line in done.stderr.splitlines() if line.strip() and " calls, " not in line]
    return {
        "exit": done.returncode,
        "seconds": round(time.monotonic() - began, 1),
        "said": [line[:400] for line in lines[-4:]],
        "traceback": "Traceback" in done.stderr,
        "out": done.stdout,
    }


def command(words: Sequence[object], first: str = "") -> list[str]:
    """Return how a command of eyechart is started with this Python."""
    return [sys.executable, "-c", f"{first}\nfrom eyechart.cli import main\nmain()", *map(str, words)]


def battery_words(place: Place, out: Path, specs: Sequence[str], *more: object, device: str = "") -> list[object]:
    """Return the words of a battery as the demo of the organisms runs it."""
    words = [word for spec in specs for word in ("--model", spec)]
    how = ["--temperature", "default", "--max-tokens", 16, "--concurrency", 48, "--option", "batch=24"]
    where = ["--option", f"device={device or place.device}"]
    return ["run", "battery", "--frames", place.bank, "--out", out, *words, *how, *where, *more]


# ---------------------------------------------------------------------------------------------------------- checkpoints


def make_medium(folder: Path, device: str) -> None:
    """Write the medium checkpoint, in bfloat16; its random weights are drawn where it is to run."""
    import torch  # noqa: PLC0415

    from tiny_checkpoints import save_llava  # noqa: PLC0415

    require_library()
    torch.manual_seed(0)
    with torch.device(device):
        save_llava(folder, dtype=torch.bfloat16, **(MEDIUM if device != "cpu" else SMALL))


def prepare(place: Place) -> None:
    """Make the bank and the checkpoints that the parts share."""
    if not place.bank.exists():
        built = say(["frames", "build", "highway", "--out", place.bank, "--seeds", "0,1", "--steps", 12])
        if built["exit"]:
            raise RuntimeError(f"no bank: {built['said']}")
    if not (place.folder / "another").exists():
        apart(make_medium, place.medium, place.device)
        shutil.copytree(place.medium, place.folder / "another")


# --------------------------------------------------------------------------------------------------- the counter itself


def measure_counter(device: str) -> dict[str, Any]:
    """Return power and counter of an idle board and of a busy one, and how often the counter moves."""
    import torch  # noqa: PLC0415

    found: dict[str, Any] = {
        "gpu_counters": len(energy.gpu_counters()),
        "processor_counters": len(energy.processor_counters()),
    }
    with Watch() as watch:
        began = time.time()
        time.sleep(4)
        found["idle"] = {"seconds": 4, **watch.between(began, time.time())}
        numbers = torch.randn(4096, 4096, device=device, dtype=torch.bfloat16)
        began = time.time()
        while (spent_s := time.time() - began) < (6 if device != "cpu" else 0.2):
            for _ in range(20 if device != "cpu" else 1):
                numbers @ numbers
            if device != "cpu":
                torch.cuda.synchronize()
        whole = watch.between(began, began + spent_s)
        found["busy"] = {"seconds": round(spent_s, 2), **whole}
        found["busy_after_two_seconds"] = watch.between(
            began + 2, began + spent_s
        )  # power is a mean of the last second
    return found | watch.steps()


# --------------------------------------------------------------------------------------------------------- the battery


FRAMES = {"default": 48, "float32": 16}
"""Frames of a battery; in float32 it is asked for the answers alone."""


def on_cpu(place: Place, spec: str) -> Path:
    """Return the run of an organism on the CPU."""
    return place.folder / f"cpu-{spec.rpartition(':')[2]}"


def cpu(place: Place) -> dict[str, Any]:
    """Run the battery of every organism on the CPU, each a run of its own, side by side."""
    few = {**os.environ, "OMP_NUM_THREADS": str(max(1, (os.cpu_count() or 1) // 8))}
    running = []
    for spec in SPECS:
        words = battery_words(place, on_cpu(place, spec), [spec], "--limit", FRAMES["default"], device="cpu")
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        running.append(subprocess.Popen(command(words), env=few, **quiet))
    return {"exits": [one.wait() for one in running]}


def battery(place: Place) -> dict[str, Any]:
    """Run the battery of the organisms on the device, by its default and in float32, with what it took."""
    result: dict[str, Any] = {}
    for name, frames in FRAMES.items():
        out, more = place.folder / f"gpu-{name}", [] if name == "default" else ["--option", f"dtype={name}"]
        with Watch() as watch:
            said = say(battery_words(place, out, list(SPECS), *more, "--limit", frames))
        accounts = json.loads(say(["costs", out, "--json"])["out"])["accounting"]
        rows = {spec: spent(out, spec, watch, accounts[spec]["all"]) for spec in SPECS}
        facts = json.loads((out / "run.json").read_text())["facts"][next(iter(SPECS))]
        kept = {name: facts.get(name) for name in ("device", "dtype", "weights_gb", "memory_gb")}
        result[name] = {"exit": said["exit"], "seconds": said["seconds"], "facts": kept, "models": rows}
    printed = say(["costs", place.folder / "gpu-default"])["out"].splitlines()
    result["printed_energy"] = [line.strip()[:300] for line in printed if "energy" in line.lower()][-3:]
    return result


def labels(place: Place) -> dict[str, Any]:
    """Return the labels of the battery on the device and on the CPU, and how many answers are equal."""
    got, result = labels_of(place.folder / "gpu-default"), {}
    for spec, trained in SPECS.items():
        own = on_cpu(place, spec)
        told, whole = labels_of(own)[spec], answers(own, spec)
        equal = {name: shared(whole, answers(place.folder / f"gpu-{name}", spec)) for name in FRAMES}
        right = got[spec]["calibrated"] == trained
        result[spec] = {"labels": got[spec], "as_on_cpu": got[spec] == told, "as_trained": right, **equal}
    return result


def outcomes(place: Place) -> dict[str, Any]:
    """Return how doctor and probe end on the device and on the CPU."""
    kinds = [(what, device) for what in ("doctor", "probe") for device in (place.device, "cpu")]
    with ThreadPoolExecutor() as pool:
        ends = pool.map(lambda kind: outcome(place, *kind, next(iter(SPECS))), kinds)
        return {f"{what} {device}": end for (what, device), end in zip(kinds, ends, strict=True)}


def outcome(place: Place, what: str, device: str, spec: str) -> dict[str, Any]:
    """Return how doctor or probe ends on a device."""
    more = ["--out", place.folder / f"{device}-mode.toml"] if what == "probe" else []
    said = say([what, spec, "--seed", 1, "--temperature", "default", "--option", f"device={device}", *more])
    first = [line.strip() for line in said["out"].splitlines() if spec in line][:1]
    return {name: said[name] for name in ("exit", "seconds", "traceback")} | {"first": [one[:200] for one in first]}


def labels_of(out: Path) -> dict[str, dict[str, str]]:
    """Return the labels of a run by model."""
    return {
        spec: {"calibrated": one.calibrated.label, "lateral": one.lateral.label, "paper": one.paper.label}
        for spec, one in judge(study.score(out)).items()
    }


def answers(out: Path, spec: str) -> dict[tuple[object, ...], str]:
    """Return the text of every finished call by frame, condition and repeat."""
    if not (out / LEDGER).is_file():
        return {}
    with Ledger(out / LEDGER) as ledger:
        finished = ledger.finished()
        return {
            (key.frame, key.condition, key.repeat): reply.text
            for key, reply in ledger.replies(spec)
            if key in finished and reply.error is None
        }


def shared(one: Mapping[tuple[object, ...], str], other: Mapping[tuple[object, ...], str]) -> dict[str, object]:
    """Return how many calls of two runs are the same calls, and how many of these have equal answers."""
    both = one.keys() & other.keys()
    return {
        "calls": len(other),
        "calls_of_both": len(both),
        "answers_equal": sum(one[key] == other[key] for key in both),
    }


def spent(out: Path, spec: str, watch: Watch, account: Mapping[str, Any]) -> dict[str, object]:
    """Return what the calls of a model took, and beside it what the counters say of the same time."""
    with contextlib.closing(sqlite3.connect(f"file:{out / LEDGER}?mode=ro", uri=True)) as sql:
        rows = sql.execute(
            "SELECT a.sent_at, r.closed_at, r.energy_j FROM replies r JOIN attempts a ON a.id = r.attempt "
            "JOIN calls c ON c.id = r.call WHERE c.model = ?",
            (spec,),
        ).fetchall()
    first, last = (
        choose(dt.datetime.fromisoformat(row[at]).timestamp() for row in rows) for at, choose in ((0, min), (1, max))
    )
    each = [row[2] for row in rows if row[2] is not None]
    seen = watch.between(first, last)
    total = sum(each) if each else None
    return {
        "seconds": round(last - first, 2),
        "median_s": account["latency_median_s"],
        "p95_s": account["latency_p95_s"],
        "prompt_tokens": account["prompt_tokens"],
        "completion_tokens": account["completion_tokens"],
        "measured": account["energy_measured"],
        "energy_j": None if total is None else round(total, 2),
        "j_per_call": None if not each else round(float(np.mean(each)), 4),
        "zero_j": sum(one == 0 for one in each),
        **seen,
        "sum_over_counter": None if not total or not seen["counter_j"] else round(total / seen["counter_j"], 4),
    }


# ------------------------------------------------------------------------------------------------- ways of loading


def pictures(count: int) -> list[bytes]:
    """Return so many different pictures, of noise."""
    rng = np.random.default_rng(5)
    return [encode(rng.integers(0, 255, (60, 120, 3), dtype=np.uint8)) for _ in range(count)]


@contextlib.contextmanager
def counting() -> Iterator[Callable[[], dict[str, float | None]]]:
    """Yield what tells of memory on the GPU in MB since here: what tensors hold, held at most, what torch has taken."""
    import torch  # noqa: PLC0415

    if not torch.cuda.is_available():
        yield lambda: {"held_mb": None, "peak_mb": None, "taken_mb": None}
        return
    torch.cuda.synchronize()
    torch.cuda.reset_peak_memory_stats()
    held, taken = torch.cuda.memory_allocated(), torch.cuda.memory_reserved()

    def tell() -> dict[str, float | None]:
        torch.cuda.synchronize()
        return {
            "held_mb": round((torch.cuda.memory_allocated() - held) / MB, 2),
            "peak_mb": round((torch.cuda.max_memory_allocated() - held) / MB, 2),
            "taken_mb": round((torch.cuda.memory_reserved() - taken) / MB, 2),
        }

    yield tell


async def ask_all(model: Any, seen: Sequence[bytes | None]) -> list[Reply]:  # noqa: ANN401 - a HuggingFaceModel
    """Ask about all pictures at once."""
    prompt = PROMPTS["baseline"]
    queries = [Query(prompt.system, prompt.user, Stimulus.of(one) if one else Stimulus(), 1) for one in seen]
    return list(await asyncio.gather(*map(model.answer, queries)))


async def twice(
    model: Any,  # noqa: ANN401 - a HuggingFaceModel
    seen: Sequence[bytes | None],
    tell: Callable[[], dict[str, float | None]],
) -> dict[str, Any]:
    """Ask a model the same twice, the first time with its loading, and close it; return what that took."""
    meter = energy.meter()
    try:
        cold = time.perf_counter()
        first = await ask_all(model, seen)
        cold = time.perf_counter() - cold
        loaded, before = tell(), sum(counter() for counter in meter.counters)
        began = time.time()
        again = await ask_all(model, seen)
        ended, after = time.time(), sum(counter() for counter in meter.counters)
    finally:
        await model.close()
    joules = [one.energy_j for one in again if one.energy_j is not None]
    return {
        "errors": sorted({str(one.error_detail)[:300] for one in (*first, *again) if one.error}),
        "answers": sum(one.error is None for one in again),
        "different": len({one.text for one in again}),
        "same_twice": sum(one.text == other.text for one, other in zip(first, again, strict=True)),
        "first_s": round(cold, 2),
        "seconds": round(ended - began, 3),
        "tokens": sum(one.completion_tokens or 0 for one in again),
        "energy_j": round(sum(joules), 3) if joules else None,
        "counter_j": round(after - before, 3) if meter.counters else None,
        "loaded": loaded,
        "span": (began, ended),
    }


def load(name: str, options: Mapping[str, Any], device: str, seen: Sequence[bytes | None]) -> dict[str, Any]:
    """Open a checkpoint in one way, ask it twice, and close it; return what it said, took and left."""
    spec = f"hf:{name}"
    where = {} if "device_map" in options else {"device": device}
    with counting() as tell:
        try:
            model: Any = open_model(spec, RequestMode(spec, max_tokens=TOKENS, options={**where, **options}))
        except SpecError as error:
            return {"refused": str(error)}
        row = asyncio.run(twice(model, seen, tell))
        facts = {key: model.facts.get(key) for key in ("device", "dtype", "device_map", "quantisation", "weights_gb")}
        row |= {"facts": {key: value for key, value in facts.items() if value}, "version": model.version[-24:]}
        del model
        return row | {"closed": tell()}


def load_tiny(device: str) -> dict[str, Any]:
    """Load every edge architecture in every way, one after another, in this process."""
    from tiny_checkpoints import EDGE  # noqa: PLC0415

    require_library()
    result: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as made:
        for place, (name, save) in enumerate(EDGE.items()):
            folder = Path(made) / str(place)
            folder.mkdir()
            save(folder)
            rows = {way: load(str(folder), options, device, [*pictures(4), *[None]]) for way, options in WAYS.items()}
            for row in rows.values():
                for shared_with_others in ("span", "energy_j", "counter_j"):
                    row.pop(shared_with_others, None)
            result[name] = rows
    return result


def load_medium(folder: Path, device: str) -> dict[str, Any]:
    """Load the medium checkpoint in every way, with what answering takes of power."""
    result: dict[str, Any] = {}
    with Watch() as watch:
        for way, options in WAYS.items():
            row = load(str(folder), {**options, "batch": 16}, device, pictures(QUERIES if device != "cpu" else 4))
            if "span" in row:
                row["by_power"] = watch.between(*row.pop("span"))
            result[way] = row
    return result


def batched(name: str, device: str, dtype: str, seen: Sequence[bytes]) -> dict[str, Any]:
    """Ask about each picture in a batch with others, then alone; return how many texts are equal."""
    spec = f"hf:{name}"
    options: dict[str, Any] = {"device": device, "batch": 16}
    options |= {"dtype": dtype} if dtype else {}
    model: Any = open_model(spec, RequestMode(spec, temperature=None, max_tokens=TOKENS, options=options))

    async def both() -> tuple[list[Reply], list[Reply]]:
        try:
            together = await ask_all(model, seen)
            return together, [one for picture in seen for one in await ask_all(model, [picture])]
        finally:
            await model.close()

    together, alone = asyncio.run(both())
    equal = sum(one.text == other.text for one, other in zip(together, alone, strict=True))
    return {"dtype": model.facts["dtype"], "pictures": len(seen), "equal": equal}


def batches(place: Place) -> dict[str, Any]:
    """Return for an organism and the medium checkpoint, by precision, how many answers a batch leaves as they are."""
    bank = open_bank(place.bank)
    frames = [bank.image(frame) for frame in bank][: 4 if place.device == "cpu" else 48]
    kinds = {"organism:grounded": frames, str(place.medium): pictures(2 if place.device == "cpu" else 12)}
    return {
        Path(name).name: {kind or "default": batched(name, place.device, kind, seen) for kind in ("", "float32")}
        for name, seen in kinds.items()
    }


def follow(place: Place) -> dict[str, Any]:
    """Run three checkpoints one after another, then at once: what the GPU holds at every loading, in MB."""
    import torch  # noqa: PLC0415

    from eyechart.api import run_battery  # noqa: PLC0415
    from eyechart.models.huggingface import generation  # noqa: PLC0415

    held: list[float] = []
    plain = generation.TextGenerator._load  # noqa: SLF001 - it is watched

    def noting(speaker: generation.TextGenerator) -> None:
        held.append(round(torch.cuda.memory_allocated() / MB, 1) if torch.cuda.is_available() else 0.0)
        plain(speaker)

    generation.TextGenerator._load = noting  # noqa: SLF001
    names = [f"hf:{place.medium}", "hf:organism:grounded", f"hf:{place.folder / 'another'}"]
    modes = [RequestMode(name, max_tokens=8, options={"device": place.device, "batch": 8}) for name in names]
    result: dict[str, Any] = {}
    for name, sequential in (("one_after_another", None), ("together", False)):
        held.clear()
        report = run_battery(
            place.bank,
            modes,
            place.folder / f"follow-{name}",
            conditions=("real", "real_repeat", "blank"),
            limit=3,
            sequential=sequential,
        )
        left = round(torch.cuda.memory_allocated() / MB, 1) if torch.cuda.is_available() else None
        result[name] = {"held_before_each_mb": list(held), "held_after_mb": left, "models": len(report)}
    return result


# ------------------------------------------------------------------------------------------------------------- faults


def hold(left_mb: float, ready: Any, over: Any) -> None:  # noqa: ANN401 - events of another process
    """Take all of the GPU's memory but so much, and keep it until told."""
    import torch  # noqa: PLC0415

    free, _ = torch.cuda.mem_get_info()
    blocks = [torch.empty(int(free - left_mb * MB), dtype=torch.uint8, device="cuda")]
    ready.set()
    over.wait()
    blocks.clear()


@contextlib.contextmanager
def held(left_mb: float) -> Iterator[None]:
    """Have another process hold the GPU's memory but so much."""
    kind = multiprocessing.get_context("spawn")
    ready, over = kind.Event(), kind.Event()
    holder = kind.Process(target=hold, args=(left_mb, ready, over))
    holder.start()
    try:
        if not ready.wait(60):
            raise RuntimeError("the other process did not take the memory")
        yield
    finally:
        over.set()
        holder.join()


def squeeze(folder: Path) -> dict[str, Any]:
    """Ask the medium checkpoint in a memory too small for a batch, then for one query, then in enough again."""
    import torch  # noqa: PLC0415

    spec = f"hf:{folder}"
    model: Any = open_model(spec, RequestMode(spec, max_tokens=TOKENS, options={"device": "cuda", "batch": 16}))
    seen, result = pictures(16), {}
    total = torch.cuda.get_device_properties("cuda").total_memory

    async def ask() -> None:
        whole = await ask_all(model, seen)
        for name, more_mb in {"for_few": 300, "for_none": 1, "enough_again": None}.items():
            torch.cuda.empty_cache()
            limit = 1.0 if more_mb is None else (torch.cuda.memory_reserved() + more_mb * MB) / total
            torch.cuda.set_per_process_memory_fraction(min(1.0, limit))
            replies = await ask_all(model, seen)
            result[name] = {
                "answers": sum(reply.error is None for reply in replies),
                "equal": sum(one.text == other.text for one, other in zip(whole, replies, strict=True)),
                "most_at_once": model._speaker._most,  # noqa: SLF001 - what the halving came to
                "errors": sorted({f"{one.error}: {one.error_detail}"[:300] for one in replies if one.error})[:2],
            }
        await model.close()
        result["held_after_mb"] = round(torch.cuda.memory_allocated() / MB, 2)

    asyncio.run(ask())
    return result


def replies_in(out: Path) -> int:
    """Return how many replies a run has, while it may be written."""
    with (
        contextlib.suppress(sqlite3.Error),
        contextlib.closing(sqlite3.connect(f"file:{out / LEDGER}?mode=ro", uri=True)) as sql,
    ):
        return int(sql.execute("SELECT count(*) FROM replies").fetchone()[0])
    return 0


def interrupted(place: Place) -> dict[str, Any]:
    """Kill a run twice and interrupt it once, each after some more calls, and let it end: what became of its calls."""
    spec, out, whole = "hf:organism:depth_only", place.folder / "interrupted", place.folder / "not-interrupted"
    words, found, before, lost = battery_words(place, out, [spec], "--limit", 12), [], {}, 0
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    beside = subprocess.Popen(command(battery_words(place, whole, [spec], "--limit", 12)), **quiet)
    for how in (signal.SIGKILL, signal.SIGINT, signal.SIGKILL, None):
        least = replies_in(out) + 40
        child = subprocess.Popen(command(words), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        began = time.monotonic()
        while how is not None and replies_in(out) < least and child.poll() is None and time.monotonic() - began < 120:
            time.sleep(0.02)
        if how is not None:
            child.send_signal(how)
        _, said = child.communicate()
        now = answers(out, spec)
        lost += sum(now.get(key) != text for key, text in before.items())
        before = now
        last = [line[:300] for line in said.splitlines() if line.strip()][-1:]
        name = "none" if how is None else how.name
        found.append({"signal": name, "exit": child.returncode, "finished": len(now), "said": last})
    beside.wait()
    return {
        "stops": found,
        "calls": len(before),
        "lost_or_changed": lost,
        "equal_to_one_never_stopped": sum(before[key] == text for key, text in answers(whole, spec).items()),
        "replies_without_energy": without_energy(out),
    }


def without_energy(out: Path) -> int:
    """Return how many replies of a run have no measured energy."""
    with contextlib.closing(sqlite3.connect(f"file:{out / LEDGER}?mode=ro", uri=True)) as sql:
        return int(sql.execute("SELECT count(*) FROM replies WHERE energy_j IS NULL").fetchone()[0])


HIDDEN = """
import importlib.metadata as known
plain = known.version
def version(name):
    if name == "bitsandbytes":
        raise known.PackageNotFoundError(name)
    return plain(name)
known.version = version
"""
"""Python that hides an installed bitsandbytes."""


def refused(place: Place, name: str, *more: object, first: str = "") -> dict[str, Any]:
    """Run a battery that must be refused before a call; return what it said, and whether it left a folder."""
    out = place.folder / f"refused-{name}"
    asked = ["--model", "hf:organism:blind", "--limit", 2]
    said = say(["run", "battery", "--frames", place.bank, "--out", out, *asked, *more], first=first)
    said.pop("out")
    return said | {"left": sorted(path.name for path in out.iterdir()) if out.exists() else None}


def refusals(place: Place) -> dict[str, Any]:
    """Return what is said where a device or a package is missing."""
    return {
        "no_such_gpu": refused(place, "device", "--option", "device=cuda:9"),
        "no_bitsandbytes": refused(place, "bits", "--option", "bits=4", first=HIDDEN),
    }


def too_large(place: Place) -> dict[str, Any]:
    """Run a checkpoint too large for what is left of the GPU beside one that fits, and once more when there is room."""
    out, specs = place.folder / "too-large", [f"hf:{place.medium}", "hf:organism:blind"]
    words = battery_words(place, out, specs, "--limit", 4, "--conditions", "real,real_repeat,blank")
    result = {}
    for name, left in (("full", held(1300)), ("room", contextlib.nullcontext())):
        with left:
            said = say(words)
        said.pop("out")
        result[name] = said | {"answers": [len(answers(out, spec)) for spec in specs]}
    return result


def spilled(place: Place) -> dict[str, Any]:
    """Load the medium checkpoint by device_map=auto where the GPU holds a part of it only."""
    with held(1500):
        row: dict[str, Any] = apart(load, str(place.medium), {"device_map": "auto", "batch": 2}, "cuda", pictures(2))
    row.pop("span", None)
    return row


# ------------------------------------------------------------------------------------------------------------ the whole


def wrong(found: Mapping[str, Any]) -> list[str]:
    """Return in words what is not as it should be."""
    told = [f"not installed, so that its rows are missing: {name}" for name in LIBRARIES if name not in found]
    told += [f"{part}: {one['raised']}" for part, one in found.items() if isinstance(one, dict) and "raised" in one]
    for spec, one in found.get("labels", {}).items():
        told += [f"{spec}: other labels"] * (isinstance(one, dict) and not one["as_on_cpu"])
    asked = [one["models"] for one in found.get("battery", {}).values() if isinstance(one, dict) and "models" in one]
    for spec, one in [row for models in asked for row in models.items()]:
        if one["energy_j"] is not None and one["counter_j"] is not None:
            off = abs(one["energy_j"] - one["counter_j"])
            told += [f"{spec}: its calls are {off:.0f} J off the counter"] * (off > STEPS_S * one["watts"])
    rows = {f"medium {way}": row for way, row in found.get("medium", {}).items()}
    for name, one in found.get("tiny", {}).items():
        rows |= {f"{name} {way}": row for way, row in one.items()} if isinstance(one, dict) else {}
    for name, row in rows.items():
        if isinstance(row, dict) and "errors" in row:
            told += [f"{name}: {row['errors']}"] * bool(row["errors"])
            left = row["closed"]["held_mb"]
            told += [f"{name}: {left} MB are not let go"] * (left is not None and left > 64)
    said = [*found.get("refusals", {}).values(), *found.get("too_large", {}).values()]
    told += [f"a traceback: {one['said']}" for one in said if isinstance(one, dict) and one["traceback"]]
    stopped = found.get("interrupted", {})
    told += ["finished calls were lost or changed"] * bool(stopped.get("lost_or_changed"))
    return told


def machine() -> dict[str, Any]:
    """Return the GPU, its driver and the versions of what is used."""
    result: dict[str, Any] = {"python": sys.version.split()[0]}
    for name in LIBRARIES:
        with contextlib.suppress(PackageNotFoundError):
            result[name] = version(name)
    with contextlib.suppress(Exception):
        nvml = import_module("pynvml")
        nvml.nvmlInit()
        board = nvml.nvmlDeviceGetHandleByIndex(0)
        result |= {"gpu": nvml.nvmlDeviceGetName(board), "driver": nvml.nvmlSystemGetDriverVersion()}
        result["memory_gb"] = round(nvml.nvmlDeviceGetMemoryInfo(board).total / 1e9, 1)
    return result


Part = Callable[[Place], dict[str, Any]]
BESIDE: dict[str, Part] = {
    "cpu": cpu,
    "tiny": lambda place: dict(apart(load_tiny, place.device)),
    "turns": lambda place: dict(apart(follow, place)),
    "batches": lambda place: dict(apart(batches, place)),
    "outcomes": outcomes,
    "refusals": refusals,
    "interrupted": interrupted,
}
"""What measures no energy and leaves most of the memory: these parts go on side by side."""

ALONE: dict[str, Part] = {
    "battery": battery,
    "medium": lambda place: dict(apart(load_medium, place.medium, place.device)),
    "too_large": too_large,
    "squeezed": lambda place: dict(apart(squeeze, place.medium)),
    "spilled": spilled,
    "counter": lambda place: dict(apart(measure_counter, place.device)),
    "labels": labels,
}
NEED_GPU = ("too_large", "squeezed", "spilled")


def measured(place: Place, parts: Sequence[str], keep: Callable[[dict[str, Any]], None]) -> None:
    """Have ``keep`` hear what every part found; one that raises is told, and the others go on."""

    def find(name: str, part: Part) -> None:
        began = time.monotonic()
        try:
            found = part(place)
        except Exception as error:  # noqa: BLE001 - the other parts are to be seen too
            traceback.print_exc()
            found = {"raised": f"{type(error).__name__}: {error}"[:400]}
        found["part_s"] = round(time.monotonic() - began, 1)
        print(f"{name}: {found['part_s']} s", flush=True)
        keep({name: found})

    prepare(place)
    with ThreadPoolExecutor(len(BESIDE)) as pool:
        for name, part in BESIDE.items():
            if name in parts:
                pool.submit(find, name, part)
    for name, part in ALONE.items():
        if name in parts:
            find(name, part)


def main() -> int:
    """Measure, write the result, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    everything = [*BESIDE, *ALONE]
    parser.add_argument("--only", action="append", choices=everything, help="this part; again for more")
    parser.add_argument("--rehearse", action="store_true", help="on a CPU, with small checkpoints; writes nothing")
    parser.add_argument("--work", type=Path, help="keeps bank, checkpoints and runs in this folder, and goes on there")
    parser.add_argument("--out", type=Path, default=RESULT, help="where the result is written")
    asked = parser.parse_args()
    import torch  # noqa: PLC0415 - an extra, and slow

    if not asked.rehearse and asked.only != ["labels"] and not torch.cuda.is_available():
        print("no GPU that torch reaches is here: run this on a machine with one, or give --rehearse", file=sys.stderr)
        return 2
    head = {"date": dt.datetime.now(dt.UTC).date().isoformat(), "version": eyechart.__version__, **machine()}

    parts = asked.only or [name for name in everything if not (asked.rehearse and name in NEED_GPU)]
    found = json.loads(asked.out.read_text()) if asked.only and asked.out.is_file() and not asked.rehearse else {}
    found |= head if asked.only != ["labels"] else {}
    FRAMES.update({"default": 3, "float32": 2} if asked.rehearse else {})
    writing = threading.Lock()

    def keep(more: Mapping[str, Any]) -> None:
        with writing:
            found.update(more)
            found["not_run"] = [name for name in everything if name not in found]
            if not asked.rehearse:
                asked.out.write_text(json.dumps(found, indent=1) + "\n")

    with tempfile.TemporaryDirectory() as made:
        folder = asked.work or Path(made)
        folder.mkdir(exist_ok=True)
        measured(Place(folder.resolve(), "cpu" if asked.rehearse else "cuda"), parts, keep)
    if asked.rehearse:
        print(json.dumps(found, indent=1))
    for line in (told := wrong(found)):
        print(f"not as it should be: {line}")
    return 1 if told else 0


if __name__ == "__main__":
    sys.exit(main())
