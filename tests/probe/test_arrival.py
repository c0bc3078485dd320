"""A probe shows that a run's pictures arrive: at their size, several at once, each with its own call."""

import asyncio
import base64
import copy
import io
import json
from dataclasses import dataclass, field, replace

import pytest
from aiohttp import web
from PIL import Image

from eyechart.frames import decode
from eyechart.modes import RequestMode
from eyechart.probe import Found, ProbeError, default_sample, doctor, probe
from eyechart.probe.arrival import MOST_CALLS as OF_ARRIVAL
from eyechart.probe.pinning import MOST_CALLS
from eyechart.probe.sample import Sample
from faults import FaultServer
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

    async def __call__(self, request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        """Answer about the picture that arrives."""
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
        if self.way == "drops":
            high, wide, _ = decode(sent, "the picture").shape
            return None if high * wide > 384 * 384 else sent
        if self.way == "mixes":
            self.under_way.append(sent)
            place = len(self.under_way)
            await asyncio.sleep(0.03)
            found = self.under_way[place % len(self.under_way)]
            await asyncio.sleep(0.03)
            self.under_way = []
            return found
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


def enlarged(picture: bytes) -> bytes:
    """Return a picture as large as a camera's."""
    written = io.BytesIO()
    Image.open(io.BytesIO(picture)).resize(LARGE).save(written, "PNG")
    return written.getvalue()


def large_sample() -> Sample:
    """Return the built-in sample with pictures of 640×400 pixels."""
    plain = default_sample()
    asked = [
        (prompt, replace(seen, images={name: enlarged(one) for name, one in seen.images.items()}))
        for prompt, seen in plain.asked
    ]
    return replace(plain, asked=asked)


def pinned(endpoint: Endpoint) -> Found:
    """Return what the probe finds of an endpoint that is asked about large pictures."""
    with FaultServer([endpoint]) as server:
        found = probe(RequestMode("openai:m", base_url=server.base_url), sample=large_sample())
        assert server.requests == found.spent.calls <= MOST_CALLS
        return found


@pytest.mark.parametrize(
    ("endpoint", "said"),
    [
        (OnTheWay(way="drops", honest=True), r"'picture' fails: the server drops this run's pictures of 640×400"),
        (OnTheWay(way="drops"), r"'picture' fails: pictures of this run's size \(640×400\) do not arrive"),
        (OnTheWay(way="drops", tokens=0), r"'picture' fails: pictures of this run's size \(640×400\)"),
        (OnTheWay(way="mixes"), r"'picture' fails: pictures of calls that are made together.*--concurrency 1"),
    ],
)
def test_a_server_that_drops_or_mixes_pictures_is_found_before_the_run_is_paid(endpoint: Endpoint, said: str) -> None:
    """By its count of tokens, or by what is named at the run's size and at once; with what to do."""
    with FaultServer([endpoint]) as server:
        with pytest.raises(ProbeError, match=said):
            probe(RequestMode("openai:m", base_url=server.base_url), sample=large_sample())
        assert server.requests <= MOST_CALLS


HEALTHY = (
    Endpoint(),
    OnTheWay(tokens=3),
    OnTheWay(tokens=0),
    OnTheWay(tokens=1105),
    OnTheWay(way="caches"),
    Endpoint(noise=0.1),
)


@pytest.mark.parametrize("endpoint", HEALTHY)
def test_a_healthy_server_is_probed_as_ever(endpoint: Endpoint) -> None:
    """Whether it counts pictures in many tokens, in few, in none, or only what no cache held."""
    assert pinned(endpoint).measured.sees_image is True


def test_what_is_shown_at_once_takes_few_calls_more() -> None:
    """And they stand in the bound that is shown before."""
    assert OF_ARRIVAL <= 16
    assert MOST_CALLS == 60 + OF_ARRIVAL


def test_a_cache_by_prefix_is_named_as_the_cause() -> None:
    """Every answer fits the first picture of its kind."""
    with FaultServer([OnTheWay(way="keeps")]) as server:
        found = doctor(RequestMode("openai:m", base_url=server.base_url))
    assert found.sight.outcome == "blind"
    assert "a cache by prefix" in found.causes[0]


@dataclass
class Rig(Endpoint):
    """An endpoint of several cameras. ``hands_on`` says how many pictures of a query the model is shown."""

    hands_on: int = 9
    counts_all: bool = False

    async def __call__(self, request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        """Name the colours of all pictures that are handed on."""
        urls = [part["image_url"]["url"] for part in asked["messages"][-1]["content"] if part["type"] == "image_url"]
        response = await super().__call__(request, asked, attempt)
        if not isinstance(response, web.Response) or response.status != 200 or "Which colours" not in read(asked)[0]:
            return response
        shown = [base64.b64decode(url.partition(",")[2]) for url in urls[: self.hands_on]]
        said = json.loads(str(response.text))
        said["choices"][0]["message"]["content"] = ", ".join(colour(decode(one, "one")) for one in shown)
        count = len(urls) if self.counts_all else len(shown)
        said["usage"]["prompt_tokens"] = 50 + 85 * count
        return web.json_response(said)


def rig_sample() -> Sample:
    """Return the sample with two cameras."""
    plain = default_sample()
    asked = [
        (prompt, replace(seen, images={"front": one, "rear": one}))
        for prompt, seen in plain.asked
        for one in [enlarged(next(iter(seen.images.values())))]
    ]
    return replace(plain, asked=asked)


def test_pictures_of_one_query_that_collapse_are_found_before_the_run() -> None:
    """Answers name one of two colours, and the tokens do not grow; a model that looks at one is noted only."""
    with FaultServer([Rig(hands_on=1)]) as server, pytest.raises(ProbeError, match="'picture' fails: of 2 pictures"):
        probe(RequestMode("openai:m", base_url=server.base_url), sample=rig_sample())
    for endpoint, noted in ((Rig(), False), (Rig(hands_on=1, counts_all=True), True)):
        with FaultServer([endpoint]) as server:
            found = probe(RequestMode("openai:m", base_url=server.base_url), sample=rig_sample())
            assert server.requests <= MOST_CALLS
        assert any("one of two colours" in note for note in found.notes) is noted


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


def test_a_cache_by_prefix_ends_the_probe_and_a_model_of_one_answer_does_not() -> None:
    """By two pictures of another size: the first is right there, and the second gets its answer."""
    with FaultServer([Kept()]) as server, pytest.raises(ProbeError, match="'cache' fails: every answer fits the first"):
        probe(RequestMode("openai:m", base_url=server.base_url))
    for seed in range(8):  # in one of eight the first picture has the colour that it always names
        with FaultServer([Endpoint(sees=False, dumb="")]) as server:
            assert probe(RequestMode("openai:m", base_url=server.base_url), seed=seed).measured.sees_image is False


def test_one_at_a_time_a_server_that_mixes_pictures_serves_a_run() -> None:
    """As the hint of the fault says."""
    with FaultServer([OnTheWay(way="mixes")]) as server:
        sample = replace(large_sample(), at_once=1)
        found = probe(RequestMode("openai:m", base_url=server.base_url), sample=sample)
    assert found.measured.facts["repeats alone"] == "5 of 5"
