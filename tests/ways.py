"""Endpoints whose way does something to pictures: it drops them by size, mixes them up, caches, or collapses them."""

import asyncio
import base64
import copy
import io
import json
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from aiohttp import web
from PIL import Image

from eyechart.frames import decode, media_type
from seeing import Endpoint, colour, read

LARGE = (640, 400)


@dataclass
class OnTheWay(Endpoint):
    """An endpoint whose way does something to pictures. It counts the picture that was sent, as ``tokens``.

    One that is ``honest`` counts the picture that arrived; of no tokens it tells no usage at all.
    """

    way: str = ""
    tokens: int = 85
    honest: bool = False
    under_way: list[bytes] = field(default_factory=list)
    first: dict[str, bytes] = field(default_factory=dict)
    turn: bool = False

    async def __call__(self, request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        """Answer about the picture that arrives."""
        self.turn = not self.turn
        user, sent = read(asked)
        arrived = await self.arrived(user, sent)
        response = await super().__call__(request, with_picture(asked, arrived), attempt)
        if not isinstance(response, web.Response) or response.status != 200:
            return response
        said = json.loads(str(response.text))
        shown = arrived if self.honest else sent
        counted = len(user.split()) + (0 if shown is None else self.tokens)
        if self.way == "caches":  # and counts what it had to compute: of known words the last alone
            counted -= 0 if user not in self.first else len(user.split()) - 1
            self.first[user] = b""
        said["usage"] = {"prompt_tokens": counted, "completion_tokens": 3} if self.tokens else None
        return web.json_response(said)

    async def arrived(self, user: str, sent: bytes | None) -> bytes | None:
        """Return the picture that the model is shown."""
        if sent is None:
            return None
        if self.way in {"drops", "knows PNG", "takes turns"}:
            high, wide, _ = decode(sent, "the picture").shape
            lost = {"drops": high * wide > 384 * 384, "knows PNG": media_type(sent) != "image/png"}
            return None if lost.get(self.way, self.turn) else sent  # one of two servers in turn has no eyes
        if self.way == "blinks":
            return None if self.dice.random() < 0.1 else sent
        if self.way == "mixes":
            self.under_way.append(sent)
            place = len(self.under_way)
            await asyncio.sleep(0.15)  # on a busy machine too, several requests come in this time
            result = self.under_way[place % len(self.under_way)]
            await asyncio.sleep(0.03)
            self.under_way = []
            return result
        if self.way == "keeps":
            kind = next((kind for kind in ("colour", "side", "How many") if kind in user), "")
            return self.first.setdefault(kind, sent)
        return sent


def with_picture(asked: dict[str, object], picture: bytes | None) -> dict[str, object]:
    """Return a request with another picture, or with none."""
    changed = copy.deepcopy(asked)
    parts = [part for part in changed["messages"][-1]["content"] if part["type"] == "text"]
    if picture is not None:
        url = f"data:image/png;base64,{base64.b64encode(picture).decode()}"
        parts.insert(0, {"type": "image_url", "image_url": {"url": url}})
    changed["messages"][-1]["content"] = parts
    return changed


def enlarged(picture: bytes, kind: str = "PNG") -> bytes:
    """Return a picture as large as a camera's, in this format."""
    written = io.BytesIO()
    Image.open(io.BytesIO(picture)).resize(LARGE).save(written, kind)
    return written.getvalue()


@dataclass
class Rig(Endpoint):
    """An endpoint of several cameras. ``hands_on`` says how many pictures of a query the model is shown.

    None of more than ``most`` pixels is. Where it ``turns``, they come in the reverse of their order; ``lists`` is how
    the model lists colours, whatever their order.
    """

    hands_on: int = 9
    turns: bool = False
    lists: Callable[[list[str]], list[str]] = list
    most: int = 10**9
    counts_all: bool = False

    async def __call__(self, request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        """Name the colours of all pictures that are handed on."""
        urls = [part["image_url"]["url"] for part in asked["messages"][-1]["content"] if part["type"] == "image_url"]
        response = await super().__call__(request, asked, attempt)
        if not isinstance(response, web.Response) or response.status != 200 or "Which colour" not in read(asked)[0]:
            return response
        if "Each picture" not in read(asked)[0]:
            return response
        shown = [base64.b64decode(url.partition(",")[2]) for url in urls[: self.hands_on]]
        shown = shown[::-1] if self.turns else shown
        shown = [one for one in shown if np.prod(decode(one, "one").shape[:2]) <= self.most]
        said = json.loads(str(response.text))
        named = [colour(decode(one, "one")) for one in shown]
        first = "in the first picture" in read(asked)[0]
        said["choices"][0]["message"]["content"] = ", ".join(named[:1] if first else self.lists(named))
        count = len(urls) if self.counts_all else len(shown)
        said["usage"]["prompt_tokens"] = 50 + 85 * count * self.counts_pictures
        return web.json_response(said)


@dataclass
class Kept(Endpoint):
    """An endpoint whose cache by prefix takes all pictures of one size for the first."""

    first: dict[object, bytes] = field(default_factory=dict)

    async def __call__(self, request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        """Answer about the first picture of this size."""
        sent = read(asked)[1]
        if sent is not None:
            sent = self.first.setdefault(decode(sent, "one").shape, sent)
        if sent is not None and "Which action" not in read(asked)[0] and "colour" not in read(asked)[0]:
            sent = None
        return await super().__call__(request, with_picture(asked, sent), attempt)
