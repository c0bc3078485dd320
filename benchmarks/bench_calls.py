"""What a call costs the client: 1152 calls with real frames, 64 at once, against a server that takes 50 ms.

The same work three ways: a run with its ledger, a bare aiohttp loop, and Inspect AI. The server is a process of its
own, and CPU is that of the client's process. Then 100 000 calls with pictures of 30 kB, for memory. Exits 1 where a
bound is missed.
"""

import argparse
import asyncio
import base64
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

CALLS = 1152
AT_ONCE = 64
LATENCY_S = 0.05
CONDITIONS = ("real", "real_repeat", "shuffled", "cross_scenario")
"""Four that show frames as they are, so that no picture is drawn while the clock runs."""
BARE, INSPECT, ROUNDS = 2.5, 15.0, 7
MEMORY = 1.1
REPLY = {
    "model": "m",
    "choices": [{"message": {"role": "assistant", "content": "SLOW"}, "finish_reason": "stop"}],
    "usage": {"prompt_tokens": 300, "completion_tokens": 2, "total_tokens": 302},
}


def serve(latency_s: float) -> None:
    """Answer every request after so long, until killed; print the port first."""
    from aiohttp import web  # noqa: PLC0415 - the server's alone

    body = json.dumps(REPLY).encode()

    async def answer(request: web.Request) -> web.Response:
        await request.read()
        await asyncio.sleep(latency_s)
        return web.Response(body=body, content_type="application/json")

    async def main() -> None:
        app = web.Application(client_max_size=10_000_000)
        app.router.add_post("/v1/chat/completions", answer)
        runner = web.AppRunner(app, access_log=None)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        print(runner.addresses[0][1], flush=True)
        await asyncio.Event().wait()

    asyncio.run(main())


@contextmanager
def server(latency_s: float) -> Iterator[str]:
    """Yield the address of a server in a process of its own."""
    words = [sys.executable, __file__, "--serve", str(latency_s)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        try:
            yield f"http://127.0.0.1:{running.stdout.readline().strip()}/v1"
        finally:
            running.kill()


def clocked(work: object) -> tuple[float, float]:
    """Return the seconds of CPU of this process, and of the wall, that a callable takes."""
    cpu, wall = time.process_time(), time.perf_counter()
    work()  # type: ignore[operator]
    return time.process_time() - cpu, time.perf_counter() - wall


def ours(bank: Path, base_url: str) -> tuple[float, float]:
    """Run the calls with a ledger, and check that every one is there."""
    from eyechart.ledger import Ledger  # noqa: PLC0415 - before the clock
    from eyechart.manifest import LEDGER  # noqa: PLC0415
    from eyechart.modes import RequestMode  # noqa: PLC0415
    from eyechart.studies import battery as study  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        planned = study.plan(bank, [RequestMode("openai:m", base_url=base_url)], out, conditions=CONDITIONS)
        assert len(planned.plan.keys()) == CALLS
        took = clocked(lambda: study.run(planned, concurrency=AT_ONCE))
        with Ledger(out / LEDGER) as ledger:
            assert [reply.text for _, reply in ledger.replies("openai:m")] == ["SLOW"] * CALLS
    return took


def bare(pictures: list[bytes], base_url: str, words: tuple[str, str]) -> tuple[float, float]:
    """Send the same requests from a loop that keeps nothing."""
    import aiohttp  # noqa: PLC0415
    import orjson  # noqa: PLC0415

    said: list[str] = []

    async def work(session: aiohttp.ClientSession, queue: Iterator[bytes]) -> None:
        for picture in queue:
            url = f"data:image/png;base64,{base64.b64encode(picture).decode()}"
            content = [{"type": "image_url", "image_url": {"url": url}}, {"type": "text", "text": words[1]}]
            messages = [{"role": "system", "content": words[0]}, {"role": "user", "content": content}]
            payload = orjson.dumps({"model": "m", "max_tokens": 1024, "temperature": 0.0, "messages": messages})
            headers = {"Content-Type": "application/json"}
            async with session.post(f"{base_url}/chat/completions", data=payload, headers=headers) as came:
                said.append(orjson.loads(await came.read())["choices"][0]["message"]["content"])

    async def main() -> None:
        queue = iter(pictures)
        async with aiohttp.ClientSession(connector=aiohttp.TCPConnector(limit=0)) as session:
            await asyncio.gather(*(work(session, queue) for _ in range(AT_ONCE)))

    took = clocked(lambda: asyncio.run(main()))
    assert said == ["SLOW"] * CALLS
    return took


def inspect(folder: Path, base_url: str, python: str) -> tuple[float, float] | None:
    """Return what Inspect AI takes for the same requests, in a process of its own; None where it is not installed."""
    words = [python, __file__, "--inspect-in", str(folder), base_url]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        print((done.stderr.strip().splitlines() or ["it failed without a word"])[-1], file=sys.stderr)
        return None
    cpu, wall = json.loads(done.stdout.strip().splitlines()[-1])
    return cpu, wall


def inspect_in(folder: Path, base_url: str) -> None:
    """Send the requests of a folder through Inspect AI; print CPU and wall seconds as JSON."""
    from inspect_ai import Task  # noqa: PLC0415
    from inspect_ai import eval as evaluate  # noqa: PLC0415
    from inspect_ai.dataset import Sample  # noqa: PLC0415
    from inspect_ai.model import (  # noqa: PLC0415
        ChatMessageSystem,
        ChatMessageUser,
        ContentImage,
        ContentText,
        GenerateConfig,
        get_model,
    )
    from inspect_ai.solver import generate  # noqa: PLC0415

    system, user = json.loads((folder / "words.json").read_text())
    names = json.loads((folder / "order.json").read_text())
    samples = [
        Sample(
            input=[
                ChatMessageSystem(content=system),
                ChatMessageUser(content=[ContentImage(image=str(folder / name)), ContentText(text=user)]),
            ],
            target="SLOW",
        )
        for name in names
    ]
    os.environ["BENCH_API_KEY"], os.environ["BENCH_BASE_URL"] = "none", base_url
    model = get_model("openai-api/bench/m", config=GenerateConfig(max_tokens=1024, temperature=0.0, max_retries=0))
    made = []

    def run() -> None:
        task = Task(dataset=samples, solver=generate(cache=False))
        how = {"max_connections": AT_ONCE, "max_samples": AT_ONCE, "display": "none", "log_dir": str(folder / "log")}
        made.extend(evaluate(task, model=model, **how))

    took = clocked(run)
    (log,) = made
    assert log.status == "success", log.error
    assert [sample.output.completion for sample in log.samples] == ["SLOW"] * len(names)
    print(json.dumps(took))


def stored(bank: Path, folder: Path) -> tuple[list[bytes], tuple[str, str]]:
    """Write the pictures of the calls into a folder for Inspect; return them and the words beside them."""
    from eyechart.conditions import show  # noqa: PLC0415
    from eyechart.frames import MAIN, open_bank  # noqa: PLC0415
    from eyechart.prompts import find_prompt  # noqa: PLC0415

    frames, prompt = open_bank(bank), find_prompt("baseline")
    pictures = [show(condition, frame, frames, 0).images[MAIN] for condition in CONDITIONS for frame in frames]
    names = []
    for number, picture in enumerate(pictures):
        names.append(f"{number}.png")
        (folder / names[-1]).write_bytes(picture)
    (folder / "order.json").write_text(json.dumps(names))
    (folder / "words.json").write_text(json.dumps([prompt.system, prompt.user]))
    return pictures, (prompt.system, prompt.user)


def memory_mb(name: str) -> float:
    """Return this process's memory in MB: ``VmRSS`` is what it holds, ``VmHWM`` the most that it ever held."""
    lines = Path("/proc/self/status").read_text().splitlines()
    (line,) = [one for one in lines if one.startswith(f"{name}:")]
    return int(line.split()[1]) * 1024 / 1e6


def camera_pictures(number: int) -> list[bytes]:
    """Draw pictures as a camera of 320 × 240 gives them, 30 kB each: a gradient, a box, and a grainy band."""
    import numpy as np  # noqa: PLC0415

    from eyechart.frames import encode  # noqa: PLC0415

    rng, drawn = np.random.default_rng(0), []
    for at in range(number):
        pixels = np.repeat(np.linspace(40, 200, 240).astype(np.uint8)[:, None, None], 320, axis=1).repeat(3, axis=2)
        pixels[200:230] = rng.integers(0, 256, (30, 320, 3), dtype=np.uint8)
        pixels[80:120, at % 280 : at % 280 + 40] = 0
        drawn.append(encode(pixels))
    return drawn


def memory(calls: int) -> dict[str, list[float]]:
    """Run so many calls against a server without latency, each of its own frame and condition.

    Returns, by how many calls had ended (a tenth, three tenths, all), the memory in MB, the most so far, and CPU
    milliseconds a call.
    """
    from eyechart.frames import MAIN, BankManifest, BankWriter, Frame, alone  # noqa: PLC0415
    from eyechart.modes import RequestMode  # noqa: PLC0415
    from eyechart.spaces.discrete import DRIVING  # noqa: PLC0415
    from eyechart.studies import battery as study  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder, server(0.0) as base_url:
        drawn = camera_pictures(200)
        with BankWriter(Path(folder) / "bank", BankManifest("bench", "bench", "camera", DRIVING, None)) as writer:
            for at in range(calls // len(CONDITIONS)):
                frame = Frame(f"f{at}", f"s{at % 4}", f"e{at % 12}", at, alone("none"), {MAIN: f"images/f{at}.png"})
                writer.add(frame, {MAIN: drawn[at % len(drawn)]}, {})
        mode = RequestMode("openai:m", base_url=base_url)
        planned = study.plan(Path(folder) / "bank", [mode], Path(folder) / "run", conditions=CONDITIONS)
        marks, seen = {calls // 10, 3 * calls // 10, calls}, dict[str, list[float]]()
        cpu = time.process_time()

        def look(done: int, total: int) -> None:
            del total
            if done in marks:
                each = 1000 * (time.process_time() - cpu) / done
                seen[str(done)] = [memory_mb("VmRSS"), memory_mb("VmHWM"), each]

        study.run(planned, concurrency=AT_ONCE, progress=look)
    return seen


def flat(calls: int) -> bool:
    """Run the calls in a process of its own, print its memory on the way, and return whether that stays flat."""
    words = [sys.executable, __file__, "--memory-in", str(calls)]
    done = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True)
    seen: dict[str, list[float]] = json.loads(done.stdout.strip().splitlines()[-1])
    for number, (now, most, each) in seen.items():
        print(f"after {number} calls: {now:.0f} MB, at most {most:.0f} MB so far, {each:.2f} ms CPU a call")
    early, *_, late = (most for _, most, _ in seen.values())
    print(f"the most memory at the end is {late / early:.3f}x that after a tenth (bound {MEMORY}x)")
    return late <= MEMORY * early


def main(python: str, many: int) -> int:
    """Print the table; return 1 where a bound is missed."""
    from eyechart.simulators import open_simulator  # noqa: PLC0415

    missed = []
    with tempfile.TemporaryDirectory() as folder, server(LATENCY_S) as base_url:
        bank, pictures = Path(folder) / "bank", Path(folder) / "pictures"
        pictures.mkdir()
        open_simulator("highway").build(bank, seeds=range(6))
        shown, words = stored(bank, pictures)
        assert len(shown) == CALLS
        print(f"{CALLS} calls, pictures of {sum(map(len, shown)) / CALLS / 1000:.0f} kB, {AT_ONCE} at once")
        mine, loop = [], []
        for _ in range(ROUNDS):
            loop.append(bare(shown, base_url, words))
            mine.append(ours(bank, base_url))
        theirs = inspect(pictures, base_url, python)
    ratio = statistics.median(one[0] / other[0] for one, other in zip(mine, loop, strict=True))
    (cpu, wall), (bare_cpu, bare_wall) = (
        tuple(map(statistics.median, zip(*both, strict=True))) for both in (mine, loop)
    )
    wall = min(seconds for _, seconds in mine)
    limit = CALLS / AT_ONCE * LATENCY_S
    print(f"eyechart with its ledger: {1000 * cpu / CALLS:.2f} ms CPU a call, {wall:.2f} s (limit {limit:.2f} s)")
    print(f"bare aiohttp loop:        {1000 * bare_cpu / CALLS:.2f} ms CPU a call, {bare_wall:.2f} s")
    print(f"eyechart is {ratio:.2f}x the bare loop (bound {BARE}x; median of {ROUNDS} rounds, one after the other)")
    missed += ["bare loop"] * (ratio > BARE)
    if theirs is None:
        print("Inspect AI: not measured")
        missed.append("Inspect AI")
    else:
        print(f"Inspect AI:               {1000 * theirs[0] / CALLS:.2f} ms CPU a call, {theirs[1]:.2f} s")
        print(f"eyechart takes {theirs[0] / cpu:.1f}x less (bound {INSPECT}x)")
        missed += ["Inspect AI"] * (theirs[0] < INSPECT * cpu)
    most = max(1.5 * limit, 1.2 * cpu)
    print(f"wall {wall:.2f} s, at most {most:.2f} s")
    missed += ["wall"] * (wall > most)
    missed += ["memory"] * (many > 0 and not flat(many))
    print(f"missed: {', '.join(missed)}" if missed else "every bound holds")
    return bool(missed)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inspect-python", default=sys.executable, help="an interpreter that has inspect_ai")
    parser.add_argument("--calls", type=int, default=100_000, help="calls for memory; 0 leaves it out")
    parser.add_argument("--memory", action="store_true", help="measure memory alone")
    parser.add_argument("--memory-in", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--serve", type=float, help=argparse.SUPPRESS)
    parser.add_argument("--inspect-in", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.serve is not None:
        serve(given.serve)
    elif given.memory_in:
        print(json.dumps(memory(given.memory_in)))
    elif given.memory:
        sys.exit(not flat(given.calls))
    elif given.inspect_in:
        inspect_in(Path(given.inspect_in[0]), given.inspect_in[1])
    else:
        sys.exit(main(given.inspect_python, given.calls))
