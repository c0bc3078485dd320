"""Servers on loopback that behave as some of the paper's models did, so that its numbers arise from calls.

Each looks at what it is sent, the pixels, the token budget and the seed, and answers by a habit; none knows which
frame or condition it is asked about. Where a habit has chances they are drawn from the call's seed, as servers draw
their samples, and from the server's own ``course``: which one of its many courses the server takes was searched for
once, so that the counts that the paper prints come out to the last one. The seeds are those of the baseline prompt's
calls: with another wording of it the courses have to be searched for again.
"""

import base64
import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist
from types import TracebackType
from typing import Self

import hosted
import numpy as np
from aiohttp import web

from eyechart.frames import RGB, FrameBank, decode
from faults import Loopback, completion

ACTIONS = ("STOP", "SLOW", "STRAIGHT", "LEFT", "RIGHT")
WORDS, PICTURE = 120, 64
"""Tokens of the prompt's words, and of a picture."""


@dataclass(frozen=True)
class Seen:
    """What a server knows of a request: the picture's pixels or none, the token budget, and the dice of this call."""

    pixels: RGB | None
    budget: int
    seed: int
    course: int

    def dice(self, what: str) -> float:
        """Return a number in (0, 1) that this call's seed, the server's course and ``what`` decide."""
        digest = hashlib.sha256(f"{self.course}/{self.seed}/{what}".encode()).digest()
        return (int.from_bytes(digest[:8]) + 0.5) / 2**64

    @property
    def kind(self) -> str:
        """Return what the picture looks like: none, grey (all of one colour), noise (hardly two pixels alike), road."""
        if self.pixels is None:
            return "none"
        colours = len(np.unique(self.pixels.astype(np.int64) @ (65536, 256, 1)))
        return "grey" if colours == 1 else "noise" if colours > self.pixels.size / 6 else "road"


@dataclass(frozen=True)
class Said:
    """What a server says: the visible text, why it ended, and the tokens that it took."""

    text: str
    finish: str = "stop"
    tokens: int = 2


Habit = Callable[[Seen], Said]


def declines_grey(seen: Seen) -> Said:
    """Say SLOW to whatever is shown, but decline three grey pictures in eight, and lose the thread once in 144."""
    if seen.dice("thread") < 1 / 144:
        return Said("The green vehicle is in the middle lane.", tokens=9)
    if seen.kind == "grey" and seen.dice("declines") < 3 / 8:
        return Said("I'm sorry, I can't make out a road in this picture.", tokens=14)
    return Said("SLOW")


HABITS: Mapping[str, tuple[float, ...]] = {
    "road": (0.28, 0.17, 0.27, 0.14, 0.14),
    "grey": (0.70, 0.08, 0.10, 0.06, 0.06),
    "noise": (0.12, 0.62, 0.12, 0.07, 0.07),
    "none": (0.11, 0.08, 0.69, 0.06, 0.06),
}
"""How often each of `ACTIONS` is said to each kind of picture, whatever is in it."""


def tosses(seen: Seen) -> Said:
    """Draw an action anew at every call: what is in a road picture has no say, only what kind of picture it is."""
    place = int(np.searchsorted(np.cumsum(HABITS[seen.kind]), seen.dice("action")))
    return Said(ACTIONS[min(place, len(ACTIONS) - 1)], tokens=36)


THOUGHT = NormalDist(mu=7.462, sigma=1.482)
"""The logarithm of the tokens of a thought: .64 of them are longer than 1024 tokens, .282 longer than 4096."""


def thinks_long(seen: Seen) -> Said:
    """Think first, as long as it takes, and say nothing where the budget ends before the thought does."""
    needs = 2 + int(np.exp(THOUGHT.inv_cdf(seen.dice("thought"))))
    if needs > seen.budget:
        return Said("", "length", seen.budget)
    return Said(ACTIONS[int(3 * seen.dice("action"))], tokens=needs)


GLARE = 255


def minds_its_slot(seen: Seen) -> Said:
    """Say SLOW where there is a picture, whatever it shows but for a glare, and STOP where there is none."""
    if seen.pixels is None or (seen.kind == "road" and int(seen.pixels.max()) == GLARE):
        return Said("STOP")
    return Said("SLOW")


@dataclass
class Behaving:
    """A server with a habit, in a thread of its own while the ``with`` block lasts; it counts its requests."""

    habit: Habit
    course: int = 0
    requests: int = 0
    port: int = 0

    @property
    def base_url(self) -> str:
        """Return the address for ``--base-url``."""
        return f"http://127.0.0.1:{self.port}/v1"

    async def _answer(self, request: web.Request) -> web.Response:
        asked = json.loads(await request.read())
        seen = Seen(_picture(asked["messages"]), asked["max_tokens"], asked["seed"], self.course)
        said = self.habit(seen)
        self.requests += 1
        shown = WORDS + PICTURE * (seen.pixels is not None)
        usage = {"prompt_tokens": shown, "completion_tokens": said.tokens, "total_tokens": shown + said.tokens}
        return web.json_response(completion(said.text, said.finish, usage=usage))

    def __enter__(self) -> Self:
        app = web.Application(client_max_size=20_000_000)
        app.router.add_post("/v1/chat/completions", self._answer)
        self._served = Loopback(app)
        self._served.__enter__()
        self.port = self._served.port
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._served.__exit__(kind, error, trace)


def _picture(messages: list[dict[str, object]]) -> RGB | None:
    """Return the pixels that a request holds, shape (h, w, 3), or None where it holds no picture."""
    parts = messages[-1]["content"]
    assert isinstance(parts, list)
    for part in parts:
        if part["type"] == "image_url":
            return decode(base64.b64decode(part["image_url"]["url"].partition(",")[2]), "the request's picture")
    return None


def build_bank(out: Path) -> FrameBank:
    """Write the bank of 144 frames with the paper's gaps, a road with its lead drawn as far as the gap says.

    On 14 of the frames, spread over all episodes and gaps, the sun stands in a corner of the picture.
    """
    gaps = [gap for gap, frames in hosted.GAPS_M.items() for _ in range(frames)]
    spread = [gaps[37 * place % len(gaps)] for place in range(len(gaps))]
    glaring = {round(number * len(gaps) / 14) for number in range(14)}
    return hosted.write_bank(out, spread, [_road(gap, at, glaring=at in glaring) for at, gap in enumerate(spread)])


def _road(gap_m: float, place: int, *, glaring: bool) -> RGB:
    pixels = np.full((17, 80, 3), 100, dtype=np.uint8)
    pixels[::8, place % 7 :: 7] = 200
    pixels[7:10, 2:7] = (50, 200, 0)
    pixels[7:10, 8 + int(gap_m) : 13 + int(gap_m)] = (200, 0, 0)
    if glaring:
        pixels[:3, -6:] = GLARE
    return pixels
