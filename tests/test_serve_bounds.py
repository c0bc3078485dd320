"""What bounds a server: the names it answers to, the pages that may not ask it, and how much it takes at a time."""

import asyncio
import json
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import aiohttp
import pytest
from multidict import CIMultiDict, CIMultiDictProxy

from eyechart.errors import GuardianError
from eyechart.serve.host_names import HostNames, require_name
from eyechart.serve.lifecycle import serve
from eyechart.serve.server import ServerLimits
from test_serve import FAR, NEAR, PNG, Seer, guardian_of, post, served

EVERYWHERE = "0.0.0.0"  # noqa: S104 - what is tested


def port_of(url: str) -> int:
    """Return the port of an address."""
    return int(url.rpartition(":")[2])


async def raw(url: str, *parts: bytes, wait_s: float = 0.0) -> bytes:
    """Send bytes as they are, with a pause between them, and return all that comes back until the end."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port_of(url))
    try:
        for part in parts:
            writer.write(part)
            await writer.drain()
            await asyncio.sleep(wait_s)
        async with asyncio.timeout(20):
            return await reader.read()
    except ConnectionError:
        return b""
    finally:
        writer.close()


def head(*lines: str, path: str = "/health", method: str = "GET") -> bytes:
    """Return the head of a request that closes its connection."""
    return "\r\n".join([f"{method} {path} HTTP/1.1", *lines, "Connection: close", "", ""]).encode()


def status(answer: bytes) -> int:
    """Return the status of an answer, 0 where there is none."""
    return int(answer.split()[1]) if answer else 0


OWN = ["localhost", "LOCALHOST:8600", "localhost.", "127.0.0.1", "127.0.0.1:1", "[::1]", "[::1]:8600", "127.8.9.1"]
OTHER = [
    "evil.example",
    "evil.example:8600",
    "localhost.evil.example",
    EVERYWHERE,
    "10.1.2.3",
    "[fe80::1]",
    "a b",
    "a@b",
    "",
]


def test_on_loopback_a_server_answers_to_its_own_names_only() -> None:
    """A page that lets its name lead here is refused, for every path and method; so is no Host, and two of them."""

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        for name in OWN:
            assert status(await raw(url, head(f"Host: {name}"))) == 200, name
        for name in OTHER:
            for path, method in (("/health", "GET"), ("/metrics", "GET"), ("/assess", "POST"), ("/no", "GET")):
                answer = await raw(url, head(f"Host: {name}", path=path, method=method))
                assert status(answer) in {421, 400}, (name, path, answer)
        assert status(await raw(url, head())) in {400, 421}
        assert status(await raw(url, head("Host: localhost", "Host: evil.example"))) in {400, 421}
        found, said = await post(session, url, FAR, Host="evil.example", **PNG)
        assert found == 421
        assert said["error"] == (
            "the Host 'evil.example' is none of this server's names; another is allowed with --allow-host"
        )

    served(ask, guardian_of())


def asked_at(host: str, hosts: tuple[str, ...], names: Mapping[str, int]) -> None:
    """Serve at an address with names, and require the status of each Host."""

    async def run() -> None:
        address: asyncio.Future[str] = asyncio.get_running_loop().create_future()

        async def until() -> None:
            url = await address
            for name, wanted in names.items():
                assert status(await raw(url, head(f"Host: {name}"))) == wanted, name

        with guardian_of() as guardian:
            await serve(
                guardian, host=host, port=0, limits=ServerLimits(hosts=hosts), started=address.set_result, until=until
            )

    asyncio.run(run())


def test_names_are_allowed_by_the_operator_and_elsewhere_any_where_none_is_given() -> None:
    """Beside its own on loopback; bound elsewhere those alone, without exception for this machine."""
    asked_at("127.0.0.1", ("Cam.Example",), {"cam.example": 200, "localhost": 200, "evil.example": 421})
    asked_at(EVERYWHERE, (), {"cam.example": 200, "localhost": 200, "10.1.2.3": 200})
    asked_at(EVERYWHERE, ("cam.example",), {"cam.example:9": 200, "evil.example": 421, "localhost": 421})


@pytest.mark.parametrize("name", ["", "a b", "http://a", "a:80", "a/b", "[::1", "ä.example", "a\nb", "*"])
def test_a_name_that_no_host_header_could_have_is_refused(name: str) -> None:
    """Before anything is served."""
    with pytest.raises(GuardianError, match="is no name of a host"):
        ServerLimits(hosts=(name,))


def test_names_in_any_writing_are_the_same() -> None:
    """Case, brackets and a dot at the end."""
    assert [require_name(name) for name in ("Cam.Example.", "[::1]", "10.0.0.1")] == ["cam.example", "::1", "10.0.0.1"]
    names = HostNames.of(("cam.example",), ["127.0.0.1", "::1"])
    assert names.loopback
    assert not HostNames.of((), ["127.0.0.1", "10.0.0.1"]).loopback
    assert names.refuses(CIMultiDictProxy(CIMultiDict({"Host": "CAM.example.:80"}))) is None


CROSS = [
    {"Origin": "http://evil.example"},
    {"Origin": "null"},
    {"Origin": "http://localhost:3000"},
    {"Origin": "file://"},
    {"Origin": "no address"},
    {"Origin": "http://[bad"},
    {"Sec-Fetch-Site": "cross-site"},
    {"Sec-Fetch-Site": "same-site"},
    {"Sec-Fetch-Site": "cross-site", "Origin": "http://localhost:{port}"},
]
SAME = [
    {},
    {"Origin": "http://localhost:{port}"},
    {"Origin": "https://LOCALHOST:{port}"},
    {"Sec-Fetch-Site": "same-origin"},
    {"Sec-Fetch-Site": "none"},
]


def test_another_sites_page_may_not_ask() -> None:
    """Whatever it says of itself; a page of the server's own origin may, also behind what speaks TLS for it."""

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        port = str(port_of(url))
        for wanted, cases in ((403, CROSS), (200, SAME)):
            for given in cases:
                headers = {name: value.replace("{port}", port) for name, value in given.items()}
                found, said = await post(session, url, FAR, Host=f"localhost:{port}", **headers, **PNG)
                assert found == wanted, (headers, said)
        asks = {"Origin": "http://evil.example", "Access-Control-Request-Method": "POST"}
        for method, path in (("OPTIONS", "/assess"), ("GET", "/health"), ("GET", "/metrics")):
            async with session.request(method, url + path, headers=asks) as came:
                assert came.status == (403 if method == "OPTIONS" else 200)
                assert not [name for name in came.headers if name.lower().startswith("access-control")]

    served(ask, guardian_of())


def test_a_post_without_a_fitting_content_type_is_refused_before_it_is_read() -> None:
    """None, two of them, a form's, a text's and an unknown one; what a page can send without asking is among them."""

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        for kind in (
            "text/plain",
            "application/x-www-form-urlencoded",
            "multipart/form-data",
            "image/bmp",
            "png",
            "*/*",
        ):
            found, said = await post(session, url, FAR, **{"Content-Type": kind})
            assert (found, "a picture must be sent as one of" in str(said["error"])) == (415, True), kind
        lines = ["Host: localhost", f"Content-Length: {len(FAR)}"]
        for more in ([], ["Content-Type: image/png", "Content-Type: text/plain"], ["Content-Type:"]):
            answer = await raw(url, head(*lines, *more, path="/assess", method="POST") + FAR)
            assert status(answer) in {400, 415}, answer
        kinds = ("image/png", "IMAGE/PNG", "image/jpeg", "image/webp", "application/octet-stream", "image/png; a=b")
        for kind in kinds:
            assert (await post(session, url, FAR, **{"Content-Type": kind}))[0] == 200, kind

    served(ask, guardian_of())


def test_a_head_has_a_bound_of_lines_and_of_length() -> None:
    """Too many headers, one too long, an endless first line, and a head that never ends: 400 or a closed connection."""

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        del session
        many = [f"X-{n}: {n}" for n in range(100)]
        assert status(await raw(url, head("Host: localhost", *many[:40]))) == 200
        assert status(await raw(url, head("Host: localhost", *many))) == 400
        assert status(await raw(url, head("Host: localhost", f"X: {'a' * 20_000}"))) == 400
        assert status(await raw(url, b"GET /" + b"a" * 20_000 + b" HTTP/1.1\r\n\r\n")) == 400
        endless = (b"X-%d: %s\r\n" % (n, b"a" * 8000) for n in range(10_000))  # 80 MB, were all of it taken
        answer = await raw(url, b"GET /health HTTP/1.1\r\nHost: localhost\r\n", *endless)
        assert status(answer) in {0, 400}

    served(ask, guardian_of(), ServerLimits(idle_s=2.0))


def test_requests_in_one_go_are_read_as_they_are_answered() -> None:
    """Ten thousand requests on one connection, sent before an answer is read: a few wait, the others stay outside."""
    seer = Seer(held=True)

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port_of(url))
        lines = ("Content-Type: image/png", f"Content-Length: {len(NEAR)}")
        first = "\r\n".join(["POST /assess HTTP/1.1", "Host: localhost", *lines, "", ""]).encode() + NEAR
        writer.write(first)
        assert await asyncio.to_thread(seer.asked.wait, 20)
        more = b"GET /health HTTP/1.1\r\nHost: localhost\r\n\r\n" * 100
        sent = 0
        with suppress(TimeoutError):
            async with asyncio.timeout(1.0):
                while sent < 200_000_000:
                    writer.write(more)
                    await writer.drain()
                    sent += len(more)
        assert sent < 20_000_000  # what the kernel holds, and not what the server would
        async with session.get(f"{url}/health") as came:
            assert came.status == 200
        seer.go_on.set()
        assert b" 200 " in await reader.readline()
        writer.transport.abort()

    served(ask, guardian_of(seer))


def test_one_connection_too_many_gets_503_and_the_others_are_answered() -> None:
    """Before anything of it is read; when one has gone there is room again."""

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        held = [await asyncio.open_connection("127.0.0.1", port_of(url)) for _ in range(3)]
        await asyncio.sleep(0.1)
        answer = await raw(url)
        assert status(answer) == 503
        assert json.loads(answer.partition(b"\r\n\r\n")[2]) == {"error": "too many connections"}
        held[0][1].write(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert b" 200 " in await held[0][0].readline()
        for _, writer in held:
            writer.close()
            await writer.wait_closed()
        await asyncio.sleep(0.1)
        assert (await post(session, url, FAR))[0] == 200

    served(ask, guardian_of(), ServerLimits(connections=3, idle_s=20.0))


def test_no_more_is_read_at_a_time_than_there_are_places() -> None:
    """Bodies that come slowly take the places of ``uploads``; one more gets 503, and they end at the deadline."""

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        lines = ("Host: localhost", "Content-Type: image/png", "Content-Length: 1000")
        slow = [
            asyncio.create_task(raw(url, head(*lines, path="/assess", method="POST") + b"\x89PNG")) for _ in range(2)
        ]
        await asyncio.sleep(0.3)
        found, said = await post(session, url, FAR)
        assert (found, said["error"]) == (503, "too many pictures are being uploaded")
        assert [status(answer) for answer in await asyncio.gather(*slow)] == [408, 408]
        assert (await post(session, url, FAR))[0] == 200

    served(ask, guardian_of(deadline_s=1.5), ServerLimits(uploads=2))


def test_an_answer_that_nobody_reads_holds_nothing_for_long() -> None:
    """A client that asks and never reads is closed like an idle one; others are answered meanwhile."""

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        _, writer = await asyncio.open_connection("127.0.0.1", port_of(url))
        writer.write(b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n" * 2000)
        await asyncio.sleep(0.2)
        assert (await post(session, url, FAR))[0] == 200
        writer.transport.abort()

    served(ask, guardian_of())


def test_no_picture_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No file is written, neither where the server was started nor where temporary ones lie."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    async def ask(session: aiohttp.ClientSession, url: str) -> None:
        assert (await post(session, url, FAR))[0] == 200
        for picture in (FAR, NEAR, NEAR[:60]):
            await post(session, url, picture)

    served(ask, guardian_of())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["connections", "headers"])
def test_a_bound_is_at_least_one(name: str) -> None:
    """As the others are."""
    with pytest.raises(GuardianError, match=f"{name} must be at least 1, got 0"):
        replace(ServerLimits(), **{name: 0})


def test_an_address_that_cannot_be_written_is_said() -> None:
    """In one line, as one that is taken."""
    with guardian_of() as guardian, pytest.raises(GuardianError, match="is no address to listen on"):
        asyncio.run(serve(guardian, host="a" * 70 + ".example", port=0))
    assert threading.active_count() < 200
