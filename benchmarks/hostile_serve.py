"""A served guardian whose members refuse, deny, contradict themselves and fail, asked by hostile clients among others.

    make long-serve
    python benchmarks/hostile_serve.py --seconds 60 --rate 200

Each vote of each picture is a reply of a class in ``tests/reply_classes.jsonl``, drawn by the picture's number, or a
fault of the road; so it is known which answers that table allows. ``eyechart serve`` and the members are processes of
their own on loopback; requests are offered at a fixed rate, whatever comes back. Parts of ten seconds are kept on disk,
so that an interrupted measurement goes on. Writes ``benchmarks/results/serve.json``; exit 1 where anything was answered
otherwise than the table allows, an answer came late or not at all, or the server ended otherwise than asked.
"""

import argparse
import asyncio
import base64
import datetime as dt
import hashlib
import io
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import aiohttp
import numpy as np
from aiohttp import web
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT / "tests")]

import bench_serve  # noqa: E402 - beside this file
import eyechart  # noqa: E402
import odd_pictures  # noqa: E402 - of the tests, as the classes are
import reply_classes  # noqa: E402
from eyechart.stats.committee_votes import ABSTAIN, CLEAR, HAZARD, answers  # noqa: E402
from eyechart.studies import guardian as study  # noqa: E402

RESULT = ROOT / "benchmarks" / "results" / "serve.json"
KEPT = ROOT / "build" / "hostile_serve.json"
PART_S = 10.0
DEADLINE_S, GRACE_S = bench_serve.DEADLINE_S, bench_serve.GRACE_S
VOTERS, THRESHOLD = ("first", "second"), 2
WORDS = {HAZARD: "hazard", CLEAR: "clear", ABSTAIN: "abstain"}

FAULTS = ("500", "429", "html", "cut", "no choice", "hang")
"""Faults of the road on the way of a vote."""
HANG = 0.02
"""The share of faults that hang; each takes a turn until the deadline."""

KINDS = {
    "good": 0.55,
    "odd": 0.12,
    "malformed": 0.08,
    "oversized": 0.05,
    "many pixels": 0.03,
    "slow": 0.07,
    "other host": 0.03,
    "other site": 0.03,
    "untyped": 0.02,
    "no HTTP": 0.02,
}
ALLOWED = {
    "good": {200, 503},
    "odd": {400, 422, 503},
    "malformed": {400, 422, 503},
    "oversized": {0, 413},
    "many pixels": {422, 503},
    "slow": {408, 503},
    "headless": {0, 503},
    "other host": {421},
    "other site": {403},
    "untyped": {415},
    "no HTTP": {0, 400},
}


@dataclass(frozen=True, slots=True)
class Fate:
    """What becomes of a vote: a reply of a class, or a fault of the road."""

    row: reply_classes.Row | None
    fault: str = ""

    @property
    def vote(self) -> bool | None:
        """Return what the table says that it counts for."""
        return None if self.row is None else {"hazard": True, "clear": False}.get(self.row.expected)


def fate(number: int, model: str, view: str) -> Fate:
    """Return the fate of a picture's vote: in two of five pictures all votes are clear, in one most are hazards."""
    mood = random.Random(f"{number}").random()  # noqa: S311 - no secret
    dice = random.Random(f"{number} {model} {view}")  # noqa: S311
    by_vote = {
        word: [row for row in reply_classes.ROWS if row.expected.partition(":")[0] == word]
        for word in ("clear", "hazard", "abstain")
    }
    shares = (1.0, 0.0, 0.0) if mood < 0.4 else (0.3, 0.7, 0.0) if mood < 0.6 else (0.55, 0.15, 0.25)
    drawn = dice.random()
    for word, share in zip(by_vote, shares, strict=True):
        if drawn < share:
            return Fate(dice.choice(by_vote[word]))
        drawn -= share
    return Fate(None, "hang" if dice.random() < HANG else dice.choice(FAULTS[:-1]))


def expected(number: int) -> str:
    """Return the answer that the table makes of a picture's votes, where all of them come in time."""
    votes = [fate(number, model, view).vote for model in VOTERS for view in study.VIEWS]
    hazard, missing = votes.count(True), votes.count(None)
    return WORDS[int(answers(hazard, missing, voters=len(votes), threshold=THRESHOLD, point="two_way"))]


def picture(number: int) -> bytes:
    """Return a small picture that holds its number in its first row, which its reflection has last."""
    pixels = np.full((24, 40, 3), 90, dtype=np.uint8)
    pixels[0, 0] = list(number.to_bytes(3, "big"))
    pixels[0, 1], pixels[-1, 1] = 255, 0
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG")
    return out.getvalue()


def shown(url: str) -> tuple[int, str]:
    """Return the number that a picture holds, and which view it is."""
    with Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2]))) as opened:
        pixels = np.asarray(opened.convert("RGB"))
    original = bool(pixels[0, 1, 0] == 255)
    row = pixels[0 if original else -1]
    return int.from_bytes(row[0].tobytes(), "big"), study.VIEWS[0 if original else 1]


async def answer(request: web.Request) -> web.StreamResponse:
    """Give a vote its fate."""
    asked = await request.json()
    number, view = shown(asked["messages"][-1]["content"][0]["image_url"]["url"])
    found = fate(number, asked["model"], view)
    if found.row is not None:
        return web.json_response({"model": asked["model"], "choices": [found.row.choice]})
    if found.fault == "hang":
        await asyncio.sleep(4 * DEADLINE_S)
    if found.fault == "cut":
        cut = web.StreamResponse(headers={"Content-Length": "1000", "Content-Type": "application/json"})
        await cut.prepare(request)
        await cut.write(b'{"choices": [')
        assert request.transport is not None
        request.transport.close()
        return cut
    if found.fault == "no choice":
        return web.json_response({"choices": []})
    if found.fault == "html":
        return web.Response(text="<html>" + reply_classes.OBJECTS["@clear"], content_type="text/html")
    return web.json_response({"error": {"message": "busy"}}, status=429 if found.fault == "429" else 500)


async def members(port: int = 0) -> tuple[web.AppRunner, str]:
    """Start the members' server, and return it with its address."""
    app = web.Application(client_max_size=20 * bench_serve.MOST_BYTES)
    app.router.add_post("/v1/chat/completions", answer)
    runner = web.AppRunner(app, access_log=None, shutdown_timeout=0.1)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", port).start()
    return runner, f"http://127.0.0.1:{runner.addresses[0][1]}/v1"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a request; ``number`` is of a good picture."""

    kind: str
    status: int
    seconds: float
    number: int = -1
    answer: str = ""
    late: bool = False
    """Whether a vote was missing for want of time, and not by its reply."""


async def offer(
    url: str, *, seconds: float, rate: float, first: int = 0, deadline_s: float = DEADLINE_S
) -> list[Outcome]:
    """Offer requests of every kind at a fixed rate; good pictures are numbered from ``first`` on."""
    dice, client = random.Random(f"offer {first}"), Client(url, deadline_s)  # noqa: S311
    tasks, began = [], time.perf_counter()
    limit = aiohttp.ClientTimeout(total=deadline_s + 10)
    async with aiohttp.ClientSession(connector=aiohttp.TCPConnector(limit=0), timeout=limit) as session:
        for turn in range(round(seconds * rate)):
            await asyncio.sleep(max(0.0, began + turn / rate - time.perf_counter()))
            kind = dice.choices(list(KINDS), KINDS.values())[0]
            tasks.append(asyncio.create_task(client.ask(session, kind, first + turn, dice.random())))
        return list(await asyncio.gather(*tasks))


class Client:
    """Clients of every kind."""

    def __init__(self, url: str, deadline_s: float) -> None:
        self.url, self.deadline_s = url, deadline_s
        self.odd = [make() for make, _ in odd_pictures.ODD.values()]
        good = picture(0)
        self.bodies = {
            "odd": self.odd,
            "malformed": [b"", b"no picture", good[:60], bytes(range(256)) * 40, b"{}"],
            "oversized": [b"\x89PNG" + bytes(2 * bench_serve.MOST_BYTES)],
            "many pixels": [bench_serve.bomb()],
        }
        self.headers: Mapping[str, Mapping[str, str]] = {
            "other host": {"Host": "evil.example"},
            "other site": {"Origin": "http://evil.example", "Sec-Fetch-Site": "cross-site"},
        }

    async def ask(self, session: aiohttp.ClientSession, kind: str, number: int, drawn: float) -> Outcome:
        """Ask once."""
        if kind == "slow":
            body = picture(number)
            one = await bench_serve.slow(self.url, 0.0, body, whole=drawn < 0.5, deadline_s=self.deadline_s)
            return Outcome(one.kind, one.status, one.seconds)
        if kind == "no HTTP":
            return await self._nonsense(drawn)
        bodies = self.bodies.get(kind, [picture(number)])
        body = bodies[int(drawn * len(bodies))]
        headers = {"Content-Type": "image/png", **self.headers.get(kind, {})}
        if kind == "untyped":
            headers = {"Content-Type": "text/plain"}
        sent, status, said = time.perf_counter(), 0, {}
        try:
            async with session.post(f"{self.url}/assess", data=body, headers=headers) as came:
                status, said = came.status, json.loads(await came.text())
        except (aiohttp.ClientError, OSError):
            status = 0 if kind == "oversized" else -1  # such a body may be cut off, another one may not
        except TimeoutError:
            status = -2
        missing = said.get("missing", {}).values()
        late = any(reason.startswith(("late:", "timeout", "connection", "no vote came")) for reason in missing)
        return Outcome(kind, status, time.perf_counter() - sent, number, said.get("answer", ""), late)

    async def _nonsense(self, drawn: float) -> Outcome:
        sent, status = time.perf_counter(), 0
        host, _, port = self.url.removeprefix("http://").partition(":")
        try:
            reader, writer = await asyncio.open_connection(host, int(port))
            writer.write(random.Random(drawn).randbytes(200) + b"\r\n\r\n")  # noqa: S311
            async with asyncio.timeout(self.deadline_s + 10):
                line = await reader.readline()
            status = int(line.split()[1]) if line.startswith(b"HTTP/") else 0
            writer.close()
        except (OSError, TimeoutError):
            status = 0
        return Outcome("no HTTP", status, time.perf_counter() - sent)


def judged(
    outcomes: Sequence[Outcome], *, deadline_s: float = DEADLINE_S, grace_s: float = GRACE_S
) -> dict[str, object]:
    """Return the counts, and under ``wrong`` what must not be: a list that should be empty."""
    wrong = [
        f"{outcome.kind} got {outcome.status}" for outcome in outcomes if outcome.status not in ALLOWED[outcome.kind]
    ]
    timed = [outcome for outcome in outcomes if outcome.kind not in {"headless", "no HTTP"}]
    wrong += [
        f"{outcome.kind} took {outcome.seconds:.2f} s" for outcome in timed if outcome.seconds > deadline_s + grace_s
    ]
    answered = [outcome for outcome in outcomes if outcome.kind == "good" and outcome.status == 200]
    allowed = Counter(expected(outcome.number) for outcome in answered)
    otherwise = [outcome for outcome in answered if outcome.answer != expected(outcome.number)]
    excused = [outcome for outcome in otherwise if outcome.answer == "abstain" and outcome.late]
    unlike = [outcome for outcome in otherwise if outcome not in excused]
    wrong += [
        f"picture {outcome.number}: {outcome.answer}, and {expected(outcome.number)} is allowed" for outcome in unlike
    ]
    times = sorted(outcome.seconds for outcome in answered) or [0.0]
    return {
        "requests": len(outcomes),
        "answered": len(answered),
        "counts": dict(sorted(Counter(f"{outcome.kind} {outcome.status}" for outcome in outcomes).items())),
        "answers": dict(sorted(Counter(outcome.answer for outcome in answered).items())),
        "allowed": dict(sorted(allowed.items())),
        "clear_not_allowed": sum(outcome.answer == "clear" for outcome in unlike),
        "abstained_for_time": len(excused),
        "p50_s": round(times[len(times) // 2], 4),
        "p99_s": round(times[min(len(times) - 1, int(0.99 * len(times)))], 4),
        "wrong": wrong[:20],
        "wrong_in_all": len(wrong),
    }


def total(parts: Sequence[Mapping[str, object]]) -> dict[str, object]:
    """Return parts as one: counts are added, of times the worst part's stands."""
    result: dict[str, object] = {}
    for name, value in parts[0].items():
        values = [part[name] for part in parts]
        if isinstance(value, dict):
            added: Counter[str] = Counter()
            for one in values:
                added.update(one)  # type: ignore[arg-type]
            result[name] = dict(sorted(added.items()))
        elif isinstance(value, list):
            result[name] = [line for one in values for line in one][:20]  # type: ignore[attr-defined]
        else:
            result[name] = max(values) if name in {"p50_s", "p99_s"} else sum(values)  # type: ignore[type-var,arg-type]
    return result


async def part(seconds: float, rate: float, first: int) -> dict[str, object]:
    """Serve, offer and judge for some seconds."""
    models, address = await bench_serve.started(__file__, "--members")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "guardian.json"
        study.write_frozen(path, bench_serve.frozen([address, address]))
        more = ("--port", "0", "--max-bytes", str(bench_serve.MOST_BYTES), "--concurrency", "32", "--queue", "64")
        words = ("-c", "from eyechart.cli import main; main()", "serve", str(path), *more, "--no-warm-up")
        server, url = await bench_serve.started(*words)
        try:
            result = judged(await offer(url, seconds=seconds, rate=rate, first=first))
            alive = server.returncode is None
        finally:
            for process in (server, models):
                if process.returncode is None:
                    process.send_signal(signal.SIGTERM)
            ended = [await process.wait() for process in (server, models)]
    if not alive or ended[0] != 0:
        result["wrong"] = [f"the server ended with {ended[0]}", *result["wrong"]]  # type: ignore[misc]
        result["wrong_in_all"] = int(str(result["wrong_in_all"])) + 1
    return result


def digest() -> str:
    """Return the digest of what is measured: the source, the classes, and this file."""
    files = [*sorted((ROOT / "src").rglob("*.py")), Path(__file__), ROOT / "tests" / "reply_classes.jsonl"]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def measured(seconds: float, rate: float) -> list[dict[str, object]]:
    """Return all parts, with those that an earlier measurement of the same source kept."""
    begun = {"of": digest(), "seconds": seconds, "rate": rate}
    kept = json.loads(KEPT.read_text()) if KEPT.is_file() else {}
    parts = kept["parts"] if kept and {name: kept[name] for name in begun} == begun else []
    KEPT.parent.mkdir(exist_ok=True)
    while len(parts) * PART_S < seconds:
        length = min(PART_S, seconds - len(parts) * PART_S)
        parts.append(asyncio.run(part(length, rate, round(len(parts) * PART_S * rate))))
        KEPT.write_text(json.dumps({**begun, "parts": parts}))
        print(
            f"{len(parts) * PART_S:.0f} s: {parts[-1]['answers']}, {parts[-1]['wrong_in_all']} wrong", file=sys.stderr
        )
    return parts


async def stand() -> None:
    """Be the members until ended."""
    _, url = await members()
    print(url, file=sys.stderr, flush=True)
    await asyncio.Event().wait()


def main() -> int:
    """Measure, write the result, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=200.0)
    parser.add_argument("--members", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.members:
        asyncio.run(stand())
        return 0
    found = {
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "version": eyechart.__version__,
        "seconds": asked.seconds,
        "rate": asked.rate,
        "classes": len(reply_classes.ROWS),
        "load": round(os.getloadavg()[0], 1),
        **total(measured(asked.seconds, asked.rate)),
    }
    RESULT.write_text(json.dumps(found, indent=1) + "\n")
    for name, value in found.items():
        print(f"{name:>20}  {value}")
    return 1 if found["wrong_in_all"] else 0


if __name__ == "__main__":
    sys.exit(main())
