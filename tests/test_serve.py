"""A guardian over HTTP: answers, refusals that say why, and never "clear" where a model is gone."""

import asyncio
import importlib.util
import json
import sys
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path
from types import ModuleType

import aiohttp
import pytest

from banks import draw
from eyechart.calls import Query, Reply
from eyechart.errors import GuardianError
from eyechart.frames import encode
from eyechart.guardian import Guardian, interface_of
from eyechart.serve.lifecycle import serve
from eyechart.serve.server import ServerLimits, openapi
from eyechart.studies.guardian import FrozenGuardian, write_frozen
from stand_ins import Held
from voters import gap_of, says

NEAR, FAR = encode(draw(8.0, 3)), encode(draw(38.0, 4))
PNG = {"Content-Type": "image/png"}


def load_bench() -> ModuleType:
    """Return the benchmark's module, whose load generator the test shares."""
    path = Path(__file__).parents[1] / "benchmarks" / "bench_serve.py"
    spec = importlib.util.spec_from_file_location("bench_serve", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["bench_serve"] = module
    spec.loader.exec_module(module)
    return module


BENCH = load_bench()


class Seer(Held):
    """A model that sees the drawn gap, as soon as it may go on."""

    def __init__(self, *, held: bool) -> None:
        self.asked, self.go_on = threading.Event(), threading.Event()
        if not held:
            self.go_on.set()

    async def answer(self, query: Query) -> Reply:
        """Answer from the picture."""
        self.asked.set()
        await asyncio.to_thread(self.go_on.wait, 30)
        assert query.image is not None
        return says(gap_of(query.image))


def guardian_of(seer: Seer | None = None, deadline_s: float = 20.0) -> Guardian:
    """Return a guardian of two seers."""
    frozen: FrozenGuardian = BENCH.frozen(("http://127.0.0.1:1/v1",) * 2)
    models = dict.fromkeys(frozen.committee, seer or Seer(held=False))
    return Guardian(frozen, models, interface_of(frozen), deadline_s=deadline_s)


Ask = Callable[[aiohttp.ClientSession, str], Awaitable[None]]


def served(ask: Ask, guardian: Guardian, limits: ServerLimits | None = None) -> None:
    """Serve a guardian on a free port as long as ``ask`` takes."""

    async def run() -> None:
        address: asyncio.Future[str] = asyncio.get_running_loop().create_future()

        async def until() -> None:
            async with aiohttp.ClientSession(timeout=aiohttp.ClientTimeout(total=20)) as session:
                await ask(session, await address)

        await serve(guardian, port=0, limits=limits, started=address.set_result, until=until)

    with guardian:
        asyncio.run(run())


async def post(session: aiohttp.ClientSession, url: str, body: bytes, **headers: str) -> tuple[int, dict[str, object]]:
    """Send a picture."""
    async with session.post(f"{url}/assess", data=body, headers=headers or PNG) as came:
        return came.status, await came.json()


def test_a_picture_gets_its_answer_and_the_metrics_count_it() -> None:
    """Hazard and clear; health names the guardian; the OpenAPI document describes what is there."""

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        assert url.startswith("http://127.0.0.1:")
        (near, hazard), (far, clear) = await post(session, url, NEAR), await post(session, url, FAR)
        assert (near, far, hazard["answer"], clear["answer"]) == (200, 200, "hazard", "clear")
        assert hazard["votes"] == {model: {"original": True, "reflected": True} for model in BENCH.MODELS}
        async with session.get(f"{url}/health") as came:
            assert (came.status, (await came.json())["threshold"]) == (200, 2)
        async with session.get(f"{url}/metrics") as came:
            said = await came.text()
        assert 'eyechart_assessments_total{answer="hazard"} 1.0' in said
        assert 'eyechart_votes_total{model="openai:first",view="reflected",vote="clear"} 1.0' in said
        assert "eyechart_assessment_seconds_count 2.0" in said
        assert 'eyechart_requests_total{status="200"} 3.0' in said
        async with session.get(f"{url}/openapi.json") as came:
            document = await came.json()
        assert document["openapi"].startswith("3.1")
        assert set(document["paths"]) == {"/assess", "/health", "/metrics", "/openapi.json"}
        answers = document["paths"]["/assess"]["post"]["responses"]
        assert {"200", "400", "408", "413", "415", "422", "503"} <= set(answers)
        assert set(answers["200"]["content"]["application/json"]["schema"]["properties"]) == set(hazard)

    served(ask, guardian_of())


def test_bad_input_is_refused_in_one_line() -> None:
    """Empty, no picture, cut off, too large, of another type, to another place, by another method."""

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        for body, headers, status, why in (
            (b"", PNG, 400, "the body is empty"),
            (b"hello", PNG, 422, "the body is no picture"),
            (NEAR[:60], PNG, 422, "the picture cannot be shown"),
            (NEAR, {"Content-Type": "text/html"}, 415, "a picture must be sent as"),
            (bytes(3000), PNG, 413, "3000 bytes; the limit is 2000"),
        ):
            found, said = await post(session, url, body, **headers)
            assert (found, why in str(said["error"])) == (status, True), said
            assert "\n" not in str(said["error"])

        async def chunks() -> object:
            for _ in range(10):
                yield bytes(500)

        async with session.post(f"{url}/assess", data=chunks(), headers=PNG) as came:
            assert (came.status, "more than 2000 bytes" in await came.text()) == (413, True)
        for method, path, status in (("GET", "/nowhere", 404), ("GET", "/assess", 405), ("POST", "/health", 405)):
            async with session.request(method, url + path) as came:
                assert (came.status, "/openapi.json" in (await came.json())["error"]) == (status, True)

    served(ask, guardian_of(), ServerLimits(most_bytes=2000))


def test_too_much_is_refused_at_once_with_when_to_come_back() -> None:
    """One at a time and one waiting: the others get 503 before anybody is answered."""
    seer, ended = Seer(held=True), list[int]()

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        async def one() -> None:
            async with session.post(f"{url}/assess", data=NEAR, headers=PNG) as came:
                await came.read()
                ended.append(came.status)
                retry = came.headers.get("Retry-After")
                assert (retry is not None and int(retry) >= 1) == (came.status == 503)
                if len(ended) == 4:
                    seer.go_on.set()

        await asyncio.gather(*(one() for _ in range(6)))

    served(ask, guardian_of(seer), ServerLimits(concurrency=1, queue=1))
    assert ended == [503, 503, 503, 503, 200, 200]


def test_a_slow_sender_is_cut_off() -> None:
    """A body that does not come gets 408 by the deadline; a head that does not come is closed after the idle time."""

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        del session
        for whole, status in ((True, 408), (False, 0)):
            found = await BENCH.slow(url, 0.0, NEAR, whole=whole, deadline_s=15.0)
            assert found.status == status
            assert found.seconds < 15.0

    served(ask, guardian_of(deadline_s=0.3), ServerLimits(idle_s=0.4))


def test_a_request_under_way_is_answered_before_the_server_ends() -> None:
    """Shutting down is graceful."""
    under_way: list[asyncio.Task[tuple[int, dict[str, object]]]] = []
    session, seer = [], Seer(held=True)

    async def ask(_: aiohttp.ClientSession, url: str) -> None:
        session.append(aiohttp.ClientSession())
        under_way.append(asyncio.create_task(post(session[0], url, NEAR)))
        assert await asyncio.to_thread(seer.asked.wait, 30)
        asyncio.get_running_loop().call_later(0.2, seer.go_on.set)

    async def run() -> None:
        address: asyncio.Future[str] = asyncio.get_running_loop().create_future()

        async def until() -> None:
            await ask(session, await address)  # type: ignore[arg-type]

        await serve(guardian, port=0, started=address.set_result, until=until)
        status, said = await under_way[0]
        assert (status, said["answer"]) == (200, "hazard")
        await session[0].close()

    with guardian_of(seer) as guardian:
        asyncio.run(run())


def test_an_address_that_is_taken_is_said_and_limits_must_be_limits() -> None:
    """In one line."""

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        del session
        with pytest.raises(GuardianError, match="give another --port"):
            await serve(guardian, port=int(url.rpartition(":")[2]))
        with pytest.raises(GuardianError, match=r"cannot listen on 256\.1\.1\.1:0: .*; give another --host"):
            await serve(guardian, host="256.1.1.1", port=0)

    guardian = guardian_of()
    served(ask, guardian)
    with pytest.raises(GuardianError, match=r"^concurrency must be at least 1, got 0$"):
        ServerLimits(concurrency=0)
    with pytest.raises(GuardianError, match="at most 64 pictures at a time, got concurrency=65"):
        ServerLimits(concurrency=65)


def test_under_load_everything_is_answered_and_a_dead_model_makes_nothing_clear(tmp_path: Path) -> None:
    """A short version of benchmarks/bench_serve.py: mixed requests, and one of two model servers ends half-way."""
    seconds, deadline_s = 3.0, 3.0

    async def run() -> dict[str, object]:
        endpoints = [await BENCH.endpoint() for _ in BENCH.MODELS]
        path = tmp_path / "guardian.json"
        write_frozen(path, BENCH.frozen([url for _, url in endpoints]))
        found: list[dict[str, object]] = []
        address: asyncio.Future[str] = asyncio.get_running_loop().create_future()

        async def kill() -> None:
            await asyncio.sleep(seconds / 2)
            await endpoints[1][0].cleanup()

        async def until() -> None:
            killer = asyncio.create_task(kill())
            offered = await BENCH.offer(await address, seconds=seconds, rate=15, deadline_s=deadline_s)
            await killer
            found.append(BENCH.judged(offered, died_s=seconds / 2, deadline_s=deadline_s, grace_s=10.0))

        limits = ServerLimits(most_bytes=BENCH.MOST_BYTES, idle_s=10.0)
        with Guardian.load(path, deadline_s=deadline_s) as guardian:
            await serve(guardian, port=0, limits=limits, started=address.set_result, until=until)
        await endpoints[0][0].cleanup()
        return found[0]

    said = asyncio.run(run())
    assert said["wrong"] == [], json.dumps(said)
    assert "clear" in said["answers_before"]  # type: ignore[operator]
    assert "abstain" in said["answers_after"]  # type: ignore[operator]


def test_an_encoded_body_is_refused_and_what_is_no_http_leaves_no_traceback(
    capfd: pytest.CaptureFixture[str],
) -> None:
    """415 for a picture that is packed once more, 400 for what cannot be understood; no log is printed."""

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        headers = {**PNG, "Content-Encoding": "gzip"}
        async with session.post(f"{url}/assess", data=NEAR, headers=headers) as came:
            assert (came.status, "without a Content-Encoding" in await came.text()) == (415, True)
        reader, writer = await asyncio.open_connection("127.0.0.1", int(url.rpartition(":")[2]))
        writer.write(b"\x00 nonsense\r\n\r\n")
        assert b" 400 " in await reader.readline()
        writer.close()
        assert (await post(session, url, NEAR))[0] == 200

    served(ask, guardian_of())
    assert capfd.readouterr().err == ""


def test_latency_is_described_as_it_is_measured() -> None:
    """From when the guardian was asked, views included."""
    assert "from the guardian's call" in json.dumps(openapi(ServerLimits(), 1.0))


class Broken(Held):
    """A model that fails in words that UTF-8 cannot encode."""

    async def answer(self, query: Query) -> Reply:
        """Fail."""
        del query
        return Reply(error="exception", error_detail="half a pair: \ud83d")


def test_words_that_cannot_be_encoded_are_written_out_and_an_answer_is_counted_once_it_is_one() -> None:
    """A model's error with a lone surrogate is a missing vote with its reason, and so is a header an answer."""
    guardian = guardian_of(Broken())  # type: ignore[arg-type]

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        status, said = await post(session, url, NEAR)
        assert (status, said["answer"]) == (200, "abstain")
        assert "half a pair: \\ud83d" in str(said["why"])
        reader, writer = await asyncio.open_connection("127.0.0.1", int(url.rpartition(":")[2]))
        writer.write(
            b"POST /assess HTTP/1.1\r\nHost: localhost\r\nContent-Type: \xff/png\r\nContent-Length: 1\r\n\r\nx"
        )
        assert b" 415 " in await reader.readline()
        writer.close()

    served(ask, guardian)


def test_a_picture_of_too_many_pixels_is_refused_before_it_is_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    """25 million pixels in 3 kB: 422 with the numbers; and no more are decoded at once than there are turns."""
    bomb, guardian = BENCH.bomb(), guardian_of(deadline_s=0.5)
    shown: list[int] = []
    most, go_on = [0], threading.Event()

    def show(picture: bytes) -> object:
        shown.append(len(picture))
        most[0] = max(most[0], len(shown))
        go_on.wait(20)
        shown.pop()
        return interface_of(guardian.frozen).views(picture)

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        status, said = await post(session, url, bomb)
        assert (status, said["error"]) == (
            422,
            "the picture has 5000 × 4990 pixels, 24950000; the limit is 2100000",
        )
        assert shown == []
        for _ in range(3):  # each ends at its deadline, and its decoding does not
            came = await asyncio.gather(*(post(session, url, NEAR) for _ in range(2)))
            assert {status for status, _ in came} == {503}
        assert most == [2]
        go_on.set()

    monkeypatch.setattr(guardian, "show", show)
    served(ask, guardian, ServerLimits(concurrency=2))


def test_each_model_is_asked_once_before_the_server_says_that_it_is_started() -> None:
    """One that fails or is late is a warning; health tells since when each has not voted."""
    seer, told = Seer(held=False), list[str]()
    frozen: FrozenGuardian = BENCH.frozen(("http://127.0.0.1:1/v1",) * 2)
    models = {"openai:first": seer, "openai:second": Seer(held=True)}
    guardian = Guardian(frozen, models, interface_of(frozen), deadline_s=1.0)
    before: list[bool] = []

    async def run() -> None:
        address: asyncio.Future[str] = asyncio.get_running_loop().create_future()

        def started(url: str) -> None:
            before.append(seer.asked.is_set())
            address.set_result(url)

        async def until() -> None:
            async with aiohttp.ClientSession() as session:
                url = await address
                for votes in (False, True):
                    async with session.get(f"{url}/health") as came:
                        since = (await came.json())["last_vote_s"]
                        assert came.status == 200
                    assert (since["openai:first"] is not None, since["openai:second"]) == (votes, None)
                    await post(session, url, NEAR)

        await serve(guardian, port=0, warm_up_s=0.5, tell=told.append, started=started, until=until)

    with guardian:
        asyncio.run(run())
    models["openai:second"].go_on.set()
    assert before == [True]
    assert told[0] == "calling each of 2 models once, for at most 0.5 s"
    assert told[1:] == [
        "warning: 'openai:second' does not answer: no reply within 0.5 s; without its votes nothing is called clear"
    ]
