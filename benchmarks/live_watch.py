"""What ``run … --watch`` costs beside a slow server, and when its first answers are in sight, in pairs that alternate.

    make long-watch

A server of this machine answers each call after a second. A run is made with a page that somebody looks at as a browser
does, and without one. Writes ``benchmarks/results/watch.json``; exit 1 where first answers took more than 5 s, the
median pair took more than 5 % more processor time, or the server was asked another number of calls.
"""

import argparse
import asyncio
import contextlib
import datetime as dt
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from pathlib import Path

from aiohttp import web

from eyechart import __version__
from eyechart.simulators import open_bank_simulator

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks" / "results" / "watch.json"
LATENCY_S, IN_SIGHT_S, MORE = 1.0, 5.0, 0.05


class SlowServer:
    """A chat endpoint that answers SLOW after a second, and counts its calls."""

    def __init__(self) -> None:
        self.asked, self.url, self._ready = 0, "", threading.Event()
        threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True).start()
        self._ready.wait(10)

    async def _answer(self, request: web.Request) -> web.Response:
        await request.read()
        self.asked += 1
        await asyncio.sleep(LATENCY_S)
        choice = {"index": 0, "message": {"role": "assistant", "content": "SLOW"}, "finish_reason": "stop"}
        usage = {"prompt_tokens": 300, "completion_tokens": 2}
        return web.json_response({"id": "1", "model": "slow", "choices": [choice], "usage": usage})

    async def _serve(self) -> None:
        app = web.Application(client_max_size=1 << 26)
        app.router.add_post("/v1/chat/completions", self._answer)
        runner = web.AppRunner(app, access_log=None)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        self.url = f"http://127.0.0.1:{runner.addresses[0][1]}/v1"
        self._ready.set()
        await asyncio.Event().wait()


def wait_for_the_end(url: str, over: threading.Event) -> None:
    """Ask for the end of the run as the page's script does: the request is held until the run ends."""
    while not over.is_set():
        with contextlib.suppress(OSError), urllib.request.urlopen(f"{url.rstrip('/')}/over", timeout=90) as page:  # noqa: S310 - our own
            page.read()
        over.wait(0.1)


def look(url: str, begun: float, seen: list[float], over: threading.Event) -> None:
    """Look at the page as its script does; note when the first answers were in sight."""
    threading.Thread(target=wait_for_the_end, args=(url, over), daemon=True).start()
    while not over.is_set():
        with contextlib.suppress(OSError), urllib.request.urlopen(url, timeout=5) as page:  # noqa: S310 - our own
            if not seen and b">SLOW</td>" in page.read():
                seen.append(time.monotonic() - begun)
        over.wait(1.0 if not seen and time.monotonic() - begun < 20 else 5.0)


def run(server: SlowServer, bank: Path, out: Path, frames: int, *, watch: bool) -> dict[str, float]:
    """Make one run: its processor seconds, calls at the server, and when its first answers were in sight."""
    before, seen, over = server.asked, list[float](), threading.Event()
    words = ["run", "battery", "--frames", bank, "--out", out, "--limit", frames]
    words += ["--model", "openai:slow", "--base-url", server.url, "--no-probe", "--concurrency", 32]
    program = [sys.executable, "-c", "from eyechart.cli import main; main()", *map(str, words)]
    begun = time.monotonic()
    env = {**os.environ, "OPENAI_API_KEY": "none"}
    child = subprocess.Popen([*program, *(["--watch"] if watch else [])], stderr=subprocess.PIPE, text=True, env=env)
    assert child.stderr is not None
    looking: threading.Thread | None = None
    for line in child.stderr:
        if looking is None and (found := re.search(r"watch: (http://\S+)", line)):
            looking = threading.Thread(target=look, args=(found[1], time.monotonic(), seen, over))
            looking.start()
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    over.set()
    if looking is not None:
        looking.join()
    if child.returncode:
        raise SystemExit(f"the run exits {child.returncode}: {' '.join(program)}")
    shutil.rmtree(out)
    cpu = used.ru_utime + used.ru_stime
    return {
        "cpu_s": cpu,
        "wall_s": time.monotonic() - begun,
        "calls": server.asked - before,
        "seen_s": (seen or [-1])[0],
    }


def main() -> int:
    """Measure the pairs and write what they took; the first of each pair alternates."""
    options = argparse.ArgumentParser()
    options.add_argument("--pairs", type=int, default=5)
    options.add_argument("--frames", type=int, default=144)
    given = options.parse_args()
    server, pairs = SlowServer(), []
    with tempfile.TemporaryDirectory() as work:
        bank = Path(work) / "bank"
        open_bank_simulator("highway").build(bank)
        for number in range(given.pairs):
            order = (True, False) if number % 2 else (False, True)
            pairs.append({watch: run(server, bank, Path(work) / "run", given.frames, watch=watch) for watch in order})
            sys.stderr.write(f"{pairs[-1]}\n")
    ratios = [pair[True]["cpu_s"] / pair[False]["cpu_s"] for pair in pairs]
    found = {
        "eyechart": __version__,
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "calls_a_run": pairs[0][False]["calls"],
        "latency_s": LATENCY_S,
        "pairs": len(pairs),
        "cpu_s": {
            name: [round(pair[watch]["cpu_s"], 3) for pair in pairs]
            for name, watch in (("plain", False), ("watched", True))
        },
        "wall_s": [round(pair[True]["wall_s"], 1) for pair in pairs],
        "ratios": [round(ratio, 3) for ratio in ratios],
        "median_ratio": round(statistics.median(ratios), 3),
        "first_answers_in_sight_s": [round(pair[True]["seen_s"], 2) for pair in pairs],
        "same_calls": all(pair[True]["calls"] == pair[False]["calls"] for pair in pairs),
    }
    RESULT.write_text(json.dumps(found, indent=1) + "\n")
    sys.stdout.write(json.dumps(found, indent=1) + "\n")
    late = any(not 0 <= one <= IN_SIGHT_S for one in found["first_answers_in_sight_s"])
    return int(late or found["median_ratio"] > 1 + MORE or not found["same_calls"])


if __name__ == "__main__":
    raise SystemExit(main())
