"""A served guardian under good, malformed, oversized and slow requests at once, while one of its two models dies.

Two stand-in model servers and ``eyechart serve`` run as processes of their own on loopback; requests are offered at a
fixed rate, whatever comes back. Half-way one model server is ended: from then on nothing may be called clear.

    python benchmarks/bench_serve.py [--seconds 60] [--rate 200] [--json]

Exits 1 where the server ended, a request was answered after its deadline or not at all, something was called clear that
a dead model should have voted on, or memory grew by more than a tenth after the first quarter.
Writes ``results/bench_serve.json``.
"""

import argparse
import asyncio
import base64
import io
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import aiohttp
import numpy as np
from aiohttp import web
from PIL import Image

from eyechart.modes import RequestMode
from eyechart.prompts import SCENE
from eyechart.studies import guardian as study
from eyechart.studies.guardian import VOTED
from pairs import keep

DEADLINE_S = 2.0
GRACE_S = 0.5
"""What the machine may add to the deadline between a client and a server that share two cores.

So may what the client itself was late: how much longer than asked it slept at most, which grows with other work.
"""
_DOZE_S = 0.05
MOST_BYTES = 400_000
KINDS = {"good": 0.6, "malformed": 0.15, "oversized": 0.1, "many pixels": 0.05, "slow": 0.1}
CLEAR = '{"lead_gap_m": null, "close": false, "left_clear": true, "right_clear": true, "confidence": 0.9}'
MODELS = ("openai:first", "openai:second")


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a request: when it was sent, its status (0: closed without one), the answer, and its seconds."""

    kind: str
    sent_s: float
    status: int
    answer: str
    seconds: float


def picture(seed: int = 0) -> bytes:
    """Return a picture of highway-env's size, encoded."""
    dice = np.random.default_rng(seed)
    pixels = np.full((150, 600, 3), 100, dtype=np.uint8)
    pixels[60:90, ::7] = dice.integers(0, 255, 3)
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG")
    return out.getvalue()


def bomb() -> bytes:
    """Return a picture of 25 million pixels, 75 MB as RGB, in 3 kB."""
    out = io.BytesIO()
    Image.new("1", (5000, 4990)).save(out, "PNG")
    return out.getvalue()


def frozen(addresses: Sequence[str]) -> study.FrozenGuardian:
    """Return a guardian of two models at these addresses, as a structured run would choose it."""
    about = study.VoteProvenance(
        bank="0" * 64,
        prompt=SCENE.key,
        view="none",
        versions=dict.fromkeys(MODELS, "as served"),
        modes={
            spec: RequestMode(spec, base_url=url, timeout_s=DEADLINE_S)
            for spec, url in zip(MODELS, addresses, strict=True)
        },
        wording=SCENE,
        axis="vertical",
        reader=VOTED.reader,
    )
    return study.FrozenGuardian(MODELS, 2, "two_way", about, None, "made for a benchmark")


async def answer(request: web.Request) -> web.Response:
    """Say that the road is clear, as an OpenAI-compatible server would, after 20 ms."""
    asked = await request.json()
    base64.b64decode(asked["messages"][-1]["content"][0]["image_url"]["url"].partition(",")[2])
    await asyncio.sleep(0.02)
    message = {"role": "assistant", "content": CLEAR}
    return web.json_response({"model": asked["model"], "choices": [{"message": message, "finish_reason": "stop"}]})


async def endpoint(port: int = 0) -> tuple[web.AppRunner, str]:
    """Start a stand-in model server, and return it with its address."""
    app = web.Application(client_max_size=MOST_BYTES * 20)
    app.router.add_post("/v1/chat/completions", answer)
    runner = web.AppRunner(app, access_log=None, shutdown_timeout=0.1)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", port).start()
    return runner, f"http://127.0.0.1:{runner.addresses[0][1]}/v1"


async def offer(
    url: str, *, seconds: float, rate: float, seed: int = 1, deadline_s: float = DEADLINE_S
) -> list[Outcome]:
    """Offer requests of every kind at a fixed rate, and return what became of each."""
    dice = random.Random(seed)  # noqa: S311 - no secret
    bodies = {"good": [picture(n) for n in range(8)], "oversized": [b"\x89PNG" + bytes(2 * MOST_BYTES)]}
    bodies["many pixels"] = [bomb()]
    bodies["malformed"] = [b"", b"no picture", bodies["good"][0][:90], bytes(range(256)) * 40, b"{}"]
    tasks, began = [], time.perf_counter()
    limit = aiohttp.ClientTimeout(total=deadline_s + 10)
    async with aiohttp.ClientSession(connector=aiohttp.TCPConnector(limit=0), timeout=limit) as session:
        for number in range(round(seconds * rate)):
            await asyncio.sleep(max(0.0, began + number / rate - time.perf_counter()))
            kind = dice.choices(list(KINDS), KINDS.values())[0]
            if kind == "slow":
                one = slow(url, began, bodies["good"][0], whole=dice.random() < 0.5, deadline_s=deadline_s)
            else:
                one = post(session, url, began, kind, dice.choice(bodies[kind]))
            tasks.append(asyncio.create_task(one))
        return list(await asyncio.gather(*tasks))


async def post(session: aiohttp.ClientSession, url: str, began: float, kind: str, body: bytes) -> Outcome:
    """Send a body at once."""
    sent = time.perf_counter()
    status, said = 0, ""
    try:
        async with session.post(f"{url}/assess", data=body, headers={"Content-Type": "image/png"}) as came:
            status, text = came.status, await came.text()
            said = json.loads(text).get("answer", "")
    except (aiohttp.ClientError, OSError):
        status = -1 if kind == "good" else status  # an oversized body may be cut off, a good one may not
    except TimeoutError:
        status = -2
    return Outcome(kind, sent - began, status, said, time.perf_counter() - sent)


async def slow(url: str, began: float, body: bytes, *, whole: bool, deadline_s: float) -> Outcome:
    """Send a head, then the body byte by byte and never all of it; or not even the head whole."""
    sent, status = time.perf_counter(), 0
    host, _, port = url.removeprefix("http://").partition(":")
    head = f"POST /assess HTTP/1.1\r\nHost: {host}\r\nContent-Type: image/png\r\nContent-Length: {len(body)}\r\n"
    try:
        reader, writer = await asyncio.open_connection(host, int(port))
        writer.write((head + ("\r\n" if whole else "")).encode())
        answered = asyncio.create_task(reader.readline())
        for place in range(int(10 * (deadline_s + 10)) if whole else int(10 * deadline_s)):
            done, _ = await asyncio.wait([answered], timeout=0.1)
            if done or writer.is_closing():
                break
            if whole:
                writer.write(body[place : place + 1])
        if answered.done():
            line = answered.result()
            status = int(line.split()[1]) if line else 0
        else:
            answered.cancel()
        writer.close()
    except OSError:
        status = 0
    return Outcome("slow" if whole else "headless", sent - began, status, "", time.perf_counter() - sent)


def judged(
    outcomes: Sequence[Outcome], *, died_s: float, deadline_s: float = DEADLINE_S, grace_s: float = GRACE_S
) -> dict[str, object]:
    """Return what is reported, and under ``wrong`` what must not be: a list that should be empty."""
    counts = Counter(f"{outcome.kind} {outcome.status}" for outcome in outcomes)
    good = [outcome for outcome in outcomes if outcome.kind == "good"]
    answered = [outcome for outcome in good if outcome.status == 200]
    before, after = ([outcome for outcome in answered if (outcome.sent_s > died_s) == late] for late in (False, True))
    times = sorted(outcome.seconds for outcome in answered) or [0.0]
    allowed = {
        "good": {200, 503},
        "malformed": {400, 422, 503},
        "oversized": {0, 413},
        "many pixels": {422, 503},
        "slow": {408, 503},
        "headless": {0},
    }
    wrong = [
        f"{outcome.kind} got {outcome.status}" for outcome in outcomes if outcome.status not in allowed[outcome.kind]
    ]
    late = [outcome for outcome in outcomes if outcome.kind != "headless" and outcome.seconds > deadline_s + grace_s]
    wrong += [f"{outcome.kind} took {outcome.seconds:.2f} s" for outcome in late]
    wrong += ["clear without all models" for one in after if one.answer == "clear" and one.sent_s > died_s + deadline_s]
    return {
        "requests": len(outcomes),
        "offered_per_s": len(outcomes) / max(1e-9, max((outcome.sent_s for outcome in outcomes), default=0.0)),
        "counts": dict(sorted(counts.items())),
        "good_answered": len(answered) / max(1, len(good)),
        "good_per_s": len(answered) / max(1e-9, max((outcome.sent_s for outcome in outcomes), default=0.0)),
        "p50_s": times[len(times) // 2],
        "p99_s": times[min(len(times) - 1, int(0.99 * len(times)))],
        "longest_s": max((outcome.seconds for outcome in outcomes if outcome.kind != "headless"), default=0.0),
        "answers_before": dict(Counter(one.answer for one in before)),
        "answers_after": dict(Counter(one.answer for one in after)),
        "wrong": wrong[:20],
        "wrong_in_all": len(wrong),
    }


def resident_mb(pid: int) -> float:
    """Return a process's resident memory."""
    lines = Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS"))


def cpu_s(pid: int) -> float:
    """Return the processor time that a process has taken."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


async def started(*words: str) -> tuple[asyncio.subprocess.Process, str]:
    """Start a process that prints an address, and return both."""
    process = await asyncio.create_subprocess_exec(sys.executable, *words, stderr=asyncio.subprocess.PIPE)
    assert process.stderr is not None
    while "http://" not in (line := (await process.stderr.readline()).decode()):
        if not line:
            raise RuntimeError(f"{' '.join(words)} ended without an address")
    return process, line.strip().rpartition(" ")[2]


async def measure(seconds: float, rate: float) -> dict[str, object]:
    """Run all of it."""
    models = [await started(__file__, "--endpoint") for _ in MODELS]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "guardian.json"
        study.write_frozen(path, frozen([url for _, url in models]))
        words = (
            "-c",
            "from eyechart.cli import main; main()",
            "serve",
            str(path),
            "--port",
            "0",
            "--max-bytes",
            str(MOST_BYTES),
        )
        server, url = await started(*words)
        memory: list[float] = []

        async def watch() -> None:
            while True:
                memory.append(resident_mb(server.pid))
                await asyncio.sleep(seconds / 60)

        async def kill() -> float:
            await asyncio.sleep(seconds / 2)
            models[1][0].send_signal(signal.SIGKILL)
            return seconds / 2

        async def doze() -> None:
            while True:
                began = time.perf_counter()
                await asyncio.sleep(_DOZE_S)
                late.append(time.perf_counter() - began - _DOZE_S)

        late = [0.0]
        watchers, killer = [asyncio.create_task(one()) for one in (watch, doze)], asyncio.create_task(kill())
        try:
            outcomes = await offer(url, seconds=seconds, rate=rate)
            found = judged(outcomes, died_s=await killer, grace_s=GRACE_S + max(late))
            alive = server.returncode is None
            found["server_cpu_s"] = cpu_s(server.pid) if alive else None
        finally:
            for watcher in watchers:
                watcher.cancel()
            for process in (server, models[0][0]):
                if process.returncode is None:
                    process.send_signal(signal.SIGTERM)
            ended = [await process.wait() for process in (server, models[0][0], models[1][0])]
    quarter = memory[len(memory) // 4 : len(memory) // 4 + 3]
    grew = np.median(memory[-3:]) / np.median(quarter)
    wrong = [*found["wrong"]] if isinstance(found["wrong"], list) else []
    wrong += [] if alive and ended[0] == 0 else [f"the server ended with {ended[0]}"]
    wrong += [] if grew <= 1.1 else [f"memory grew to {grew:.2f} of what it was after a quarter"]
    load = os.getloadavg()[0]
    return {
        **found,
        "client_late_s": max(late),
        "wrong": wrong,
        "memory_mb": [round(one, 1) for one in memory[:: max(1, len(memory) // 6)]],
        "load": load,
    }


async def stand() -> None:
    """Be a model server until ended."""
    _, url = await endpoint()
    print(url, file=sys.stderr, flush=True)
    await asyncio.Event().wait()


def main() -> int:
    """Measure, print and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=200.0)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--endpoint", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.endpoint:
        asyncio.run(stand())
        return 0
    found = asyncio.run(measure(asked.seconds, asked.rate))
    keep("bench_serve", {"seconds": asked.seconds, "rate": asked.rate, **found})
    if asked.json:
        print(json.dumps(found))
    else:
        for name, value in found.items():
            print(f"{name:>16}  {value}")
    return 1 if found["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
