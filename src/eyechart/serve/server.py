"""The guardian's server: it reads pictures, refuses them or has them assessed, and counts."""

import asyncio
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import orjson
from aiohttp import web
from aiohttp.typedefs import Handler
from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector, generate_latest
from prometheus_client.exposition import CONTENT_TYPE_LATEST

from eyechart import __version__
from eyechart.errors import BankError, GuardianError, encodable
from eyechart.frames import size_of
from eyechart.guardian import MOST_AT_ONCE, Assessment, Guardian, Pictures
from eyechart.records import to_json_fields
from eyechart.serve.connections import Connections
from eyechart.serve.host_names import HostNames, crosses, require_name
from eyechart.studies.guardian import VIEWS

_SIGNS = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"RIFF")
_READS = {"GET", "HEAD"}
_CLOSING = {403, 408, 413, 421}
_LEAST_S = 0.01
"""The least time left for a call of the models, in seconds."""
_REAP_S = 1.0
_TICK_S = 0.1
_FADING = 0.95
"""The decay of the measured lag at each tick: about a second."""
_BUCKETS = (0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class ServerLimits:
    """The limits of the server; raises GuardianError for a wrong value.

    ``concurrency`` pictures are assessed at a time, ``queue`` more may wait, and ``uploads`` are
    read; any more get 503. A picture has at most ``most_bytes``, and at most ``most_pixels`` by its
    header, before it is decoded. A connection without a request is closed after ``idle_s``. A new
    connection beyond ``connections`` gets 503. A request has at most ``headers`` headers. ``hosts``
    are names of the server: a server on this machine alone also has the machine's own names, and
    any other one without ``hosts`` answers to any name. The deadline is the
    guardian's, from the head of a request to its answer.
    """

    concurrency: int = 8
    queue: int = 32
    uploads: int = 64
    most_bytes: int = 4_000_000
    most_pixels: int = 2_100_000
    idle_s: float = 10.0
    connections: int = 256
    headers: int = 64
    hosts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("concurrency", "uploads", "most_bytes", "most_pixels", "connections", "headers"):
            if getattr(self, name) < 1:
                raise GuardianError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.queue < 0:
            raise GuardianError(f"the queue must have 0 places or more, got {self.queue}")
        if not self.idle_s > 0:
            raise GuardianError(f"idle_s must be a number of seconds above 0, got {self.idle_s:g}")
        for name in self.hosts:
            require_name(name)
        if self.concurrency > MOST_AT_ONCE:
            raise GuardianError(
                f"a guardian takes at most {MOST_AT_ONCE} pictures at a time, got concurrency={self.concurrency}"
            )


class Metrics:
    """The metrics for Prometheus."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        self.requests = Counter("eyechart_requests", "Requests by status.", ("status",), registry=self.registry)
        self.answers = Counter("eyechart_assessments", "Assessments by answer.", ("answer",), registry=self.registry)
        self.votes = Counter("eyechart_votes", "Votes.", ("model", "view", "vote"), registry=self.registry)
        self.seconds = Histogram(
            "eyechart_assessment_seconds",
            "From a request's head to its assessment.",
            buckets=_BUCKETS,
            registry=self.registry,
        )
        self.waiting = Gauge("eyechart_waiting", "Pictures that wait or are assessed.", registry=self.registry)

    def note(self, assessment: Assessment) -> None:
        """Count an assessment and its votes."""
        self.answers.labels(assessment.answer).inc()
        words = {True: "hazard", False: "clear", None: "missing"}
        for model, pair in assessment.votes.items():
            for view, vote in zip(VIEWS, pair, strict=True):
                self.votes.labels(model, view, words[vote]).inc()


@dataclass(slots=True)
class Server:
    """A guardian with the state of its server: the numbers of pictures that it reads and holds.

    ``quiet`` is set while there is no request. Requests to a server that is ``ending`` are refused.
    """

    guardian: Guardian
    limits: ServerLimits
    metrics: Metrics = field(default_factory=Metrics)
    turns: asyncio.Semaphore = field(init=False)
    decoding: ThreadPoolExecutor = field(init=False)
    names: HostNames = field(default_factory=HostNames)
    ending: bool = False
    under_way: int = 0
    quiet: asyncio.Event = field(default_factory=asyncio.Event)
    held: int = 0
    reading: int = 0
    usual_s: float = 0.1
    lag_s: float = 0.0
    connections: Connections = field(init=False)

    def __post_init__(self) -> None:
        self.quiet.set()
        self.connections = Connections(self.limits.connections, self.limits.idle_s, self.limits.headers)
        self.turns = asyncio.Semaphore(self.limits.concurrency)
        # Decoding may go on after the deadline of its turn: the threads bound it.
        self.decoding = ThreadPoolExecutor(self.limits.concurrency, "eyechart-decoding")

    async def assess(self, request: web.Request) -> web.Response:
        """Answer a picture, or give the reason of a refusal in one line."""
        start = time.perf_counter()
        picture = await self._read(request, start)
        assessment = await self._assessment(picture, start)
        response = _json(assessment.as_dict())
        self.metrics.seconds.observe(time.perf_counter() - start)
        self.metrics.note(assessment)
        return response

    async def health(self, request: web.Request) -> web.Response:
        """Return the status, the guardian, and the seconds since each model's last vote."""
        del request
        frozen = self.guardian.frozen
        return _json(
            {
                "status": "ok",
                **to_json_fields(frozen, "committee threshold", guardian=frozen.digest, operating_point=frozen.point),
                "deadline_s": self.guardian.deadline_s,
                "last_vote_s": {
                    spec: None if age is None else round(age, 1) for spec, age in self.guardian.since_votes().items()
                },
                "waiting": self.held,
                "eyechart": __version__,
            }
        )

    async def measured(self, request: web.Request) -> web.Response:
        """Return the metrics in the format of Prometheus."""
        del request
        self.metrics.waiting.set(self.held)
        body = generate_latest(self.metrics.registry)
        return web.Response(body=body, headers={"Content-Type": CONTENT_TYPE_LATEST})

    async def described(self, request: web.Request) -> web.Response:
        """Return the OpenAPI document."""
        del request
        return _json(openapi(self.limits, self.guardian.deadline_s))

    @web.middleware
    async def watch(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Count a request by its status; answer any fault in JSON, without a traceback.

        A request to another name, or to an ending server, is refused before its body is read.
        """
        self.under_way += 1
        self.quiet.clear()
        try:
            with self.connections.answering(request):
                self._require_welcome(request)
                response = await handler(request)
        except _RequestRefusal as refused:
            response = self._refuse(refused)
        except web.HTTPException as raised:
            response = _json({"error": f"{raised.status} {raised.reason}: see /openapi.json"}, raised.status)
            response.headers.update({name: value for name, value in raised.headers.items() if name == "Allow"})
        except (ConnectionError, asyncio.CancelledError):
            self.metrics.requests.labels("gone").inc()
            raise
        except Exception:  # noqa: BLE001 - the server must not fall over one request
            response = _json({"error": "an error inside the server"}, 500)
        finally:
            self.under_way -= 1
            if not self.under_way:
                self.quiet.set()
        self.metrics.requests.labels(str(response.status)).inc()
        return response

    def _require_welcome(self, request: web.Request) -> None:
        """Refuse requests to an ending server, to another name, or from another site's page."""
        if self.ending:
            raise _RequestRefusal(503, "the server is ending")
        if (why := self.names.refuses(request.headers)) is not None:
            raise _RequestRefusal(421, why)
        if request.method not in _READS and crosses(request.headers):
            raise _RequestRefusal(403, "another site's page may not use this server")

    async def _read(self, request: web.Request, start: float) -> bytes:
        """Read a picture's bytes within the limits of size, time and number."""
        most = self.limits.most_bytes
        self._require_picture(request)
        if (request.content_length or 0) > most:
            raise _RequestRefusal(413, f"the picture has {request.content_length} bytes; the limit is {most}")
        self._require_room(self._left(start))  # before it is read: refusing must stay cheap
        if self.reading >= self.limits.uploads:
            raise _RequestRefusal(503, "too many pictures are being uploaded")
        body = bytearray()
        self.reading += 1
        try:
            async with asyncio.timeout(self._left(start)):
                async for chunk in request.content.iter_any():
                    body += chunk
                    if len(body) > most:
                        raise _RequestRefusal(413, f"the picture has more than {most} bytes")
        except TimeoutError:
            limit = self.guardian.deadline_s
            raise _RequestRefusal(
                408, f"the picture did not arrive within {limit:g} s; {len(body)} bytes did"
            ) from None
        except web.RequestPayloadError:
            raise _RequestRefusal(400, "the body cannot be read: it does not match its headers") from None
        finally:
            self.reading -= 1
        if not body:
            raise _RequestRefusal(400, "the body is empty; it must be an encoded picture, PNG or JPEG")
        if not body.startswith(_SIGNS):
            raise _RequestRefusal(422, "the body is no picture: its first bytes are not those of PNG, JPEG or WebP")
        return bytes(body)

    def _require_picture(self, request: web.Request) -> None:
        """Refuse any other content type: browsers send forms to other sites, but no pictures."""
        kinds, given = ", ".join(TYPES), request.headers.getall("Content-Type", [])
        if len(given) != 1 or given[0].partition(";")[0].strip().lower() not in TYPES:
            sent = f"as {encodable(given[0])[:80]}" if given else "without a Content-Type"
            raise _RequestRefusal(415, f"a picture must be sent as one of {kinds}, not {sent}")
        if request.headers.get("Content-Encoding", "identity").lower() != "identity":
            raise _RequestRefusal(415, "a picture must be sent without a Content-Encoding")

    async def _assessment(self, picture: bytes, start: float) -> Assessment:
        """Wait for a turn, and call the guardian; refuse if too many wait, or no time is left."""
        self._require_room(self._left(start))
        self.held += 1
        turn, began = False, start
        try:
            async with asyncio.timeout(self._left(start)):
                await self.turns.acquire()
                turn, began = True, time.perf_counter()
                pictures = await asyncio.get_running_loop().run_in_executor(self.decoding, self._shown, picture)
            left = self._left(start)
            if left < _LEAST_S:
                raise _RequestRefusal(503, "no time is left to assess the picture")
            assessment = await self.guardian.ask_async(pictures, deadline_s=left)
        except BankError as error:
            raise _RequestRefusal(422, f"the picture cannot be shown to a model: {error}") from None
        except TimeoutError:
            raise _RequestRefusal(503, "its turn did not come by the deadline") from None
        else:
            self.usual_s += 0.1 * (time.perf_counter() - began - self.usual_s)
            return assessment
        finally:
            self.held -= 1
            if turn:
                self.turns.release()

    def _shown(self, picture: bytes) -> Pictures:
        """Return the views of a picture for the models; one of too many pixels is not decoded."""
        width, height = size_of(picture, "the picture")
        if width * height > (most := self.limits.most_pixels):
            raise _RequestRefusal(
                422, f"the picture has {width} × {height} pixels, {width * height}; the limit is {most}"
            )
        return self.guardian.show(picture)

    async def close(self, app: web.Application) -> None:
        """Stop the decoding of pictures."""
        del app
        self.decoding.shutdown(wait=False, cancel_futures=True)

    def _require_room(self, left_s: float) -> None:
        """Refuse a picture if the queue is full, or if its turn would come after the deadline."""
        waiting = self.held - self.limits.concurrency
        if waiting >= self.limits.queue:
            raise _RequestRefusal(503, f"{self.held} pictures wait already")
        rounds = 0 if waiting < 0 else waiting // self.limits.concurrency + 1
        if rounds and (rounds + 1) * self.usual_s > left_s:
            raise _RequestRefusal(503, f"{self.held} pictures wait already, so its turn would come too late")

    def _left(self, start: float) -> float:
        """Return the seconds that are left, minus the time of a busy machine to send an answer."""
        limit = self.guardian.deadline_s
        return max(0.0, limit - min(2 * self.lag_s, limit / 2) - (time.perf_counter() - start))

    def _refuse(self, refused: "_RequestRefusal") -> web.Response:
        response = _json({"error": encodable(refused.why)}, refused.status)
        if refused.status == 503:
            wait = math.ceil(self.usual_s * self.held / self.limits.concurrency)
            response.headers["Retry-After"] = str(min(max(1, wait), 60))
        if self.ending or refused.status in _CLOSING:
            response.force_close()  # the rest of the body is not read
        return response

    async def tend(self, connections: Callable[[], list[web.RequestHandler]]) -> None:
        """Measure the lag of this loop, and close connections that are idle for too long."""
        reap_s = min(_REAP_S, self.limits.idle_s / 2)
        due = time.monotonic() + reap_s
        while True:
            before = time.perf_counter()
            await asyncio.sleep(_TICK_S)
            self.lag_s = max(time.perf_counter() - before - _TICK_S, _FADING * self.lag_s)
            if time.monotonic() >= due:
                due = time.monotonic() + reap_s
                self.connections.reap(connections())


class _RequestRefusal(Exception):  # noqa: N818 - it is an answer, not an error of the server
    def __init__(self, status: int, why: str) -> None:
        super().__init__(why)
        self.status, self.why = status, why


def application(guardian: Guardian, limits: ServerLimits | None = None) -> tuple[web.Application, Server]:
    """Return the application that serves a guardian, and its state; call it in the running loop."""
    server = Server(guardian, limits or ServerLimits())
    app = web.Application(middlewares=[server.watch], client_max_size=server.limits.most_bytes)
    app.on_cleanup.append(server.close)
    app.router.add_post("/assess", server.assess)
    app.router.add_get("/health", server.health)
    app.router.add_get("/metrics", server.measured)
    app.router.add_get("/openapi.json", server.described)
    return app, server


def _json(values: object, status: int = 200) -> web.Response:
    return web.Response(body=orjson.dumps(values), status=status, content_type="application/json")


TYPES = ("image/png", "image/jpeg", "image/webp", "application/octet-stream")
"""The content types of a picture; its bytes decide the real format."""


def openapi(limits: ServerLimits, deadline_s: float) -> dict[str, object]:
    """Return the OpenAPI document of the server."""
    vote = {"type": ["boolean", "null"], "description": "true: hazard, false: clear, null: missing"}
    votes = {"type": "object", "properties": dict.fromkeys(VIEWS, vote)}
    assessment = {
        "type": "object",
        "required": ["answer", "votes", "missing", "latency_s", "why"],
        "properties": {
            "answer": {"type": "string", "enum": ["hazard", "clear", "abstain"]},
            "votes": {"type": "object", "additionalProperties": votes},
            "missing": {"type": "object", "additionalProperties": {"type": "string"}},
            "latency_s": {"type": "number", "description": "seconds from the guardian's call to its answer"},
            "why": {"type": "string"},
        },
    }
    error = {"type": "object", "required": ["error"], "properties": {"error": {"type": "string"}}}

    def said(words: str, schema: object) -> dict[str, object]:
        return {"description": words, "content": {"application/json": {"schema": schema}}}

    refusals = {
        "400": "the body is empty, or the request is malformed",
        "403": "the request comes from another site's page",
        "408": f"the picture did not arrive within {deadline_s:g} s",
        "413": f"the picture has more than {limits.most_bytes} bytes",
        "415": "the Content-Type is none of a picture, or is missing",
        "421": "the Host is none of the server's names",
        "422": f"the body is no picture that a bank would take, or one of more than {limits.most_pixels} pixels",
        "500": "an error inside the server",
    }
    full = said("the server is full or ending; try again after Retry-After seconds", error)
    full["headers"] = {"Retry-After": {"schema": {"type": "integer"}, "description": "seconds"}}
    picture = {"schema": {"type": "string", "format": "binary"}}
    post = {
        "summary": f"The committee's answer to a picture, within {deadline_s:g} s",
        "requestBody": {"required": True, "content": dict.fromkeys(TYPES, picture)},
        "responses": {
            "200": said("hazard, clear, or abstain; missing votes never count as clear", assessment),
            **{status: said(words, error) for status, words in refusals.items()},
            "503": full,
        },
    }

    def get(words: str, kind: str = "application/json") -> dict[str, object]:
        return {"get": {"summary": words, "responses": {"200": {"description": words, "content": {kind: {}}}}}}

    return {
        "openapi": "3.1.0",
        "info": {"title": "eyechart guardian", "version": __version__},
        "paths": {
            "/assess": {"post": post},
            "/health": get("the server's status, its guardian, and the seconds since each model voted"),
            "/metrics": get("metrics in the format of Prometheus", "text/plain"),
            "/openapi.json": get("this document"),
        },
    }
