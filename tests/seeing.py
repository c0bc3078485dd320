"""A known-answer endpoint on loopback for doctor and probe: one that decodes the picture, and one a fault.

It answers what is asked about drawn pictures from their pixels, and a driving prompt with an action that follows them.
"""

import asyncio
import base64
import hashlib
import json
import random
import re
import threading
from dataclasses import dataclass, field

import numpy as np
from aiohttp import web

from eyechart.frames import RGB, decode
from eyechart.probe.pictures import COLOURS, COUNTS
from faults import FaultServer, completion, refuse
from ollama_stand_in import StandIn

ACTIONS = ("STOP", "SLOW", "STRAIGHT", "LEFT", "RIGHT")
SCENE = '{"lead_gap_m": 30.0, "close": false, "left_clear": true, "right_clear": true}'
"""What it says under a schema that asks for no action: always the same scene."""
SENTENCES = (
    "A red fox runs home.",
    "Rain falls on the tin roof.",
    "Two ships pass at night.",
    "The baker sleeps late.",
)


@dataclass
class Endpoint:
    """What answers, and what is wrong with it. ``seconds`` is what a computed reply takes; a cached one takes none.

    ``thinks`` is how many tokens a reply needs; ``noise`` the share of questions that are answered at random.
    """

    sees: bool = True
    counts_pictures: bool = True
    takes_pictures: bool = True
    cache: str = ""
    noise: float = 0.0
    binds_schema: bool = True
    only_new_tokens: bool = False
    only_default_temperature: bool = False
    refuses_unknown: bool = False
    thinks: int = 3
    seconds: float = 0.0
    dumb: str = ""
    refuses_system: tuple[int, str] | None = None
    refuses_driving: bool = False
    answers_in: str = "content"
    streams: str = ""
    kept: dict[str, str] = field(default_factory=dict)
    dice: random.Random = field(default_factory=lambda: random.Random(5))  # noqa: S311

    async def __call__(self, request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        """Answer one request."""
        del attempt
        if refused := self.refused(asked):
            return refused
        user, picture = read(asked)
        if picture is not None and not self.takes_pictures:
            return refuse(400, "this model does not support image input", type="invalid_request_error")
        key = json.dumps([user, asked.get("response_format"), str(picture) if self.cache == "all" else None])
        if not self.cache or key not in self.kept:
            await asyncio.sleep(self.seconds)
            self.kept[key] = self.say(user, picture if self.sees else None, asked)
        text, budget = self.kept[key], int(asked.get("max_tokens") or asked.get("max_completion_tokens") or 10**6)
        cut = self.thinks > budget
        shown = 85 if picture is not None and self.counts_pictures else 0
        usage = {"prompt_tokens": len(user.split()) + shown, "completion_tokens": min(self.thinks, budget)}
        said = completion("" if cut else text, "length" if cut else "stop", usage=usage)
        if self.answers_in != "content":
            said["choices"][0]["message"] = {"content": None, self.answers_in: f"I look at it. Hm.\n{text}"}
        return await stream(request, said, asked) if self.streams else web.json_response(said)

    def refused(self, asked: dict[str, object]) -> web.Response | None:
        """Return the refusal of a field, in OpenAI's words."""
        if self.only_new_tokens and "max_tokens" in asked:
            words = "Unsupported parameter: 'max_tokens' is not supported with this model. Use 'max_completion_tokens'"
            return refuse(400, f"{words} instead.", param="max_tokens", code="unsupported_parameter")
        if self.only_default_temperature and asked.get("temperature", 1) != 1:
            words = "Unsupported value: 'temperature' does not support 0 with this model. Only the default (1) value is"
            return refuse(400, f"{words} supported.", param="temperature", code="unsupported_value")
        if self.refuses_unknown and "eyechart_unknown" in asked:
            return refuse(400, "Unrecognized request argument supplied: eyechart_unknown")
        return self.refused_otherwise(asked)

    def refused_otherwise(self, asked: dict[str, object]) -> web.Response | None:
        """Return the refusal of a role, of a prompt, or of what is not streamed."""
        if self.streams in {"only", "bare"} and not asked.get("stream"):
            return refuse(400, "This server streams: set stream to true.", param="stream")
        if self.streams == "bare" and "stream_options" in asked:
            return refuse(400, "Unrecognized request argument supplied: stream_options", param="stream_options")
        if self.refuses_system and any(message["role"] == "system" for message in asked["messages"]):
            return refuse(*self.refuses_system)
        if self.refuses_driving and "STOP" in str(asked["messages"]):
            return refuse(400, "not this prompt")
        return None

    def say(self, user: str, picture: bytes | None, asked: dict[str, object]) -> str:
        """Return the answer; a schema that binds gives the first of its actions where the answer is none of them."""
        said = self.dumb or self.answer(user, picture, asked)
        form = asked.get("response_format")
        if isinstance(form, dict) and self.binds_schema:
            names = [said]
            if form["type"] == "json_schema":
                wanted = form["json_schema"]["schema"]["properties"]
                if "action" not in wanted:
                    return SCENE
                names = wanted["action"].get("enum", [said])
            return json.dumps({"action": said if said in names else names[0]})
        return said

    def answer(self, user: str, picture: bytes | None, asked: dict[str, object]) -> str:
        """Return what somebody who looks answers to these words."""
        if "sentence" in user:
            draw = random.Random(str(asked.get("seed"))) if "seed" in asked else self.dice  # noqa: S311
            return draw.choice(SENTENCES) if asked.get("temperature", 1) else SENTENCES[0]
        if "TEAPOT" in user or "word YES" in user:
            return "YES"
        choices = re.search(r"Answer with one word: ([\w, ]+)", user)
        if choices and picture is not None and self.dice.random() < self.noise:
            return self.dice.choice(re.findall(r"[A-Z]+", choices.group(1)))
        if picture is None:
            return "STOP" if "STOP" in user else "NONE"
        pixels = decode(picture, "the picture")
        for kind, look in (("ring", opening), ("colour", colour), ("side", side), ("How many", count)):
            if kind in user and "STOP" not in user:
                return look(pixels)
        return ACTIONS[hashlib.sha256(picture).digest()[0] % 5]


@dataclass
class Stalled(Endpoint):
    """An endpoint that lets the call of this number wait, until it may go on."""

    at: int = 12
    came: threading.Event = field(default_factory=threading.Event)
    goes_on: threading.Event = field(default_factory=threading.Event)

    async def __call__(self, request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        """Answer one request; this one once it may go on."""
        self.at -= 1
        if not self.at:
            self.came.set()
            await asyncio.to_thread(self.goes_on.wait, 60)
        return await super().__call__(request, asked, attempt)


async def stream(request: web.Request, said: dict[str, object], asked: dict[str, object]) -> web.StreamResponse:
    """Send a completion in events, its words in two, with its usage at the end where that is asked for."""
    (choice,) = said.pop("choices")
    usage = said.pop("usage")
    response = web.StreamResponse(headers={"Content-Type": "text/event-stream"})
    await response.prepare(request)
    parts: list[dict[str, object]] = [{"delta": {"role": "assistant", "content": ""}}]
    for name, text in choice["message"].items():
        if name != "role" and text is not None:
            parts += [{"delta": {name: text[:2]}}, {"delta": {name: text[2:]}}]
    parts.append({"delta": {}, "finish_reason": choice["finish_reason"]})
    events = [{**said, "choices": [{"index": 0, **part}]} for part in parts]
    if "stream_options" in asked:
        events.append({**said, "choices": [], "usage": usage})
    for event in events:
        await response.write(f": a comment\n\ndata: {json.dumps(event)}\n\n".encode())
    await response.write(b"data: [DONE]\n\n")
    return response


def read(asked: dict[str, object]) -> tuple[str, bytes | None]:
    """Return the words of the user's message and the picture in it."""
    parts = asked["messages"][-1]["content"]
    urls = [part["image_url"]["url"] for part in parts if part["type"] == "image_url"]
    words = " ".join(part["text"] for part in parts if part["type"] == "text")
    return words, base64.b64decode(urls[0].partition(",")[2]) if urls else None


def colour(pixels: RGB) -> str:
    """Return the name of the colour in the middle."""
    middle = pixels[len(pixels) // 2, pixels.shape[1] // 2].astype(int)
    return min(COLOURS, key=lambda name: int(np.abs(middle - COLOURS[name]).sum()))


def side(pixels: RGB) -> str:
    """Return where the dark disc is; of another picture, in which none is, that it sees none."""
    rows, columns = np.nonzero(pixels.sum(axis=2) < 100)
    if not rows.size:
        return "NONE"
    down, across = rows.mean() - pixels.shape[0] / 2, columns.mean() - pixels.shape[1] / 2
    if abs(across) > abs(down):
        return "LEFT" if across < 0 else "RIGHT"
    return "TOP" if down < 0 else "BOTTOM"


def opening(pixels: RGB) -> str:
    """Return on which side a dark ring is open: where its middle row or column has no dark pixel."""
    dark = pixels.sum(axis=2) < 200
    rows, columns = np.nonzero(dark)
    if len(rows) == 0:
        return "NONE"
    y, x = (rows.min() + rows.max()) // 2, (columns.min() + columns.max()) // 2
    sides = {"LEFT": dark[y, :x], "RIGHT": dark[y, x:], "TOP": dark[:y, x], "BOTTOM": dark[y:, x]}
    return next((side for side, line in sides.items() if not line.any()), "NONE")


def count(pixels: RGB) -> str:
    """Return how many dark squares of 64 × 64 pixels there are."""
    return COUNTS[round(int((pixels.sum(axis=2) < 100).sum()) / 65**2) - 1]


def served(**what: object) -> FaultServer:
    """Return the endpoint as a server to be entered; its requests are counted."""
    return FaultServer([Endpoint(**what)])


class OllamaEndpoint(StandIn):
    """The same behind Ollama's API: ``format`` binds, ``num_predict`` is the budget, pictures stand beside words."""

    endpoint = Endpoint()

    async def chat(self, request: web.Request) -> web.StreamResponse:
        """POST /api/chat, streamed as two objects."""
        asked = await request.json()
        user, options = asked["messages"][-1], asked["options"]
        picture = base64.b64decode(user["images"][0]) if user.get("images") else None
        form: dict[str, object] = {}
        if isinstance(asked.get("format"), dict):
            form = {"response_format": {"type": "json_schema", "json_schema": {"schema": asked["format"]}}}
        look = picture if self.endpoint.sees else None
        text = self.endpoint.say(user["content"], look, {**options, **form})
        count = len(user["content"].split()) + 85 * (picture is not None)
        end = {"done_reason": "stop", "done": True, "prompt_eval_count": count, "eval_count": self.endpoint.thinks}
        if options["num_predict"] < self.endpoint.thinks:
            text, end["done_reason"] = "", "length"
        said = {"message": {"role": "assistant", "content": text}, "done": False}
        lines = [json.dumps({"model": asked["model"], **one}) for one in (said, end)]
        return web.Response(text="\n".join(lines), content_type="application/x-ndjson")
