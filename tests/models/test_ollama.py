"""Ollama's adapter against a stand-in with the routes, fields and errors of Ollama's documented API (docs/api.md)."""

import asyncio
import base64
import gc
import socket
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from aiohttp import web

import banks
from eyechart.api import run_battery
from eyechart.calls import Query, Reply
from eyechart.errors import SpecError
from eyechart.frames import Stimulus, encode
from eyechart.models import Model, ollama, open_model
from eyechart.modes import RequestMode
from eyechart.spaces.discrete import DRIVING, Discrete
from eyechart.spaces.scene import SCHEMA
from faults import Loopback
from ollama_stand_in import COUNTS, DIGEST, TEMPLATE, StandIn

PICTURE = encode(np.full((8, 8, 3), 128, dtype=np.uint8))
QUERY = Query("Drive.", "Which action?", Stimulus.of(PICTURE), 2**62 + 5, DRIVING.schema())


@pytest.fixture
def server() -> Iterator[StandIn]:
    """Yield a stand-in that listens."""
    stand_in = StandIn()
    with Loopback(stand_in.app()) as served:
        stand_in.port = served.port
        yield stand_in


def ask(server: StandIn, name: str = "llava", query: Query = QUERY, **mode: object) -> Reply:
    """Ask a model of the stand-in once."""
    asked = RequestMode(f"ollama:{name}", base_url=f"http://127.0.0.1:{server.port}", **mode)  # type: ignore[arg-type]
    return asyncio.run(_once(open_model(asked.spec, asked), query))


async def _once(model: Model, query: Query = QUERY) -> Reply:
    try:
        return await model.answer(query)
    finally:
        await model.close()


def test_a_streamed_answer_is_put_together_with_its_counts(server: StandIn) -> None:
    """Text, verbatim reason of the end, tokens, times."""
    reply = ask(server)
    assert (reply.text, reply.finish_reason, reply.error) == ("SLOW", "stop", None)
    assert (reply.prompt_tokens, reply.completion_tokens, reply.served, reply.status) == (26, 282, "llava", 200)
    assert reply.seconds is not None
    assert reply.first_byte_s is not None
    assert 0 < reply.first_byte_s <= reply.seconds
    assert (reply.cost_usd, reply.energy_j, reply.reasoning_tokens) == (None, None, None)


def test_the_request_is_as_the_api_has_it(server: StandIn) -> None:
    """System and user message, the picture in base64 without a prefix, budget, temperature and seed as options."""
    ask(server, max_tokens=77, seed=True, temperature=0.5)
    (asked,) = server.asked
    assert asked == {
        "model": "llava",
        "stream": True,
        "messages": [
            {"role": "system", "content": "Drive."},
            {"role": "user", "content": "Which action?", "images": [base64.b64encode(PICTURE).decode()]},
        ],
        "options": {"num_predict": 77, "temperature": 0.5, "seed": 5},
    }


def test_a_model_of_this_machine_is_unloaded_when_it_is_closed(server: StandIn) -> None:
    """Once, and only where it was asked; one that is to be kept alive stays, and the next may need its memory."""
    ask(server)
    assert server.events == ["ask llava", "unload llava"]
    mode = RequestMode("ollama:llava", base_url=f"http://127.0.0.1:{server.port}")
    model = open_model(mode.spec, mode)

    async def close_twice_and_ask_again() -> None:
        await model.close()
        await model.answer(QUERY)
        await model.close()
        await model.close()

    asyncio.run(close_twice_and_ask_again())
    assert server.events[2:] == ["ask llava", "unload llava"]
    server.events.clear()
    ask(server, options={"keep_alive": "10m"})
    ask(server, body={"keep_alive": -1})
    assert server.events == ["ask llava", "ask llava"]


def test_a_server_of_another_machine_keeps_its_models(server: StandIn, monkeypatch: pytest.MonkeyPatch) -> None:
    """Others may be asking it."""
    monkeypatch.setattr(ollama, "machine_of", lambda _: "box")
    ask(server)
    assert server.events == ["ask llava"]


def test_a_server_that_does_not_unload_holds_nobody_up(server: StandIn, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is given some time, and then left alone."""
    monkeypatch.setattr(ollama, "_UNLOADING_S", 0.2)
    server.hangs = True
    began = time.monotonic()
    assert ask(server).error is None
    assert time.monotonic() - began < 5


def test_two_models_of_a_server_are_asked_one_after_another(
    server: StandIn, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Through a run: the first is unloaded before the second is asked for anything; their sizes are said."""
    folder = tmp_path_factory.mktemp("turns")
    bank = banks.build_bank(folder / "bank", scenarios=["light", "dense"], episodes=1)
    at = {"base_url": f"http://127.0.0.1:{server.port}", "probe": False, "conditions": ("real", "blank")}
    report = run_battery(bank, ["ollama:llava", "ollama:qwen3-vl:8b"], folder / "run", **at)  # type: ignore[arg-type]
    order = [event for place, event in enumerate(server.events) if event != ([None, *server.events])[place]]
    assert order == ["ask llava", "unload llava", "ask qwen3-vl:8b", "unload qwen3-vl:8b"]
    assert {fact["weights_gb"] for fact in report.score.manifest.facts.values()} == {"7e-09"}


def test_several_cameras_are_sent_in_their_order(server: StandIn) -> None:
    """As one list of the message."""
    ask(server, query=Query("", "Which?", Stimulus({"wrist": PICTURE[::-1], "front": PICTURE}), 1))
    sent = server.asked[0]["messages"][0]["images"]  # type: ignore[index]
    assert sent == [base64.b64encode(one).decode() for one in (PICTURE[::-1], PICTURE)]


def test_options_and_formats_go_where_the_api_wants_them(server: StandIn) -> None:
    """A schema binds the action to the query's actions, or the scene; without a picture there is no list of them."""
    ask(
        server,
        query=Query("", "Which?", Stimulus(), 1, Discrete("two", ("GO", "STOP"), (), (), ()).schema()),
        structured="json_schema",
        temperature=None,
        options={"think": False, "keep_alive": "10m", "num_ctx": 2048},
        body={"options": {"top_k": 1}},
    )
    ask(server, structured="json_object")
    ask(server, query=Query("", "Which scene?", Stimulus(), 1, schema=SCHEMA), structured="json_schema")
    first, second, third = server.asked
    assert third["format"] == SCHEMA
    assert (first["think"], first["keep_alive"]) == (False, "10m")
    assert first["options"] == {"num_predict": 1024, "num_ctx": 2048, "top_k": 1}
    assert first["messages"] == [{"role": "user", "content": "Which?"}]
    assert first["format"]["properties"] == {"action": {"type": "string", "enum": ["GO", "STOP"]}}  # type: ignore[index]
    assert second["format"] == "json"


def test_what_it_thinks_is_kept_apart_from_what_it_says(server: StandIn) -> None:
    """Thinking comes in fields of its own, in parts too."""
    server.thinking = ("A car ", "is near.")
    reply = ask(server, "qwen3-vl:8b", options={"think": True})
    assert (reply.text, reply.reasoning) == ("SLOW", "A car is near.")


def test_a_model_that_cannot_think_is_told_apart(server: StandIn) -> None:
    """With what to do."""
    reply = ask(server, options={"think": "high"})
    assert (reply.error, reply.status, reply.text) == ("bad_request", 400, "")
    assert "ask it without --option think" in reply.error_detail


@pytest.mark.parametrize(
    ("parts", "end", "kind", "finish"),
    [
        (("The",), {"done_reason": "length", "done": True, **COUNTS}, None, "length"),
        ((), {"done_reason": "stop", "done": True, **COUNTS}, None, "stop"),
        (("SLOW",), {"done": True}, None, None),
        (("SLOW",), None, "cut_short", None),
    ],
)
def test_every_end_of_a_stream_has_its_own_outcome(
    server: StandIn, parts: tuple[str, ...], end: dict[str, object] | None, kind: str | None, finish: str | None
) -> None:
    """A budget that is used up, nothing said, an old server that gives no reason, and a stream that just stops."""
    server.parts, server.end = parts, end
    reply = ask(server)
    assert (reply.error, reply.finish_reason) == (kind, finish)
    assert reply.text == ("" if kind else "".join(parts))


def test_an_error_in_the_stream_is_an_error(server: StandIn) -> None:
    """The status was 200 already; what came before is not taken for an answer."""
    server.fails_inside = "an error was encountered while running the model"
    reply = ask(server)
    assert (reply.error, reply.text) == ("server_error", "")
    assert "while running the model" in reply.error_detail


def test_the_digest_is_the_version_and_the_template_is_recorded(server: StandIn) -> None:
    """From /api/tags and /api/show; a name without a tag is the latest."""
    url = f"http://127.0.0.1:{server.port}"
    model = open_model("ollama:llava", RequestMode("ollama:llava", base_url=url))
    assert model.version == f"{DIGEST[:12]} Q4_K_M"
    assert model.facts["digest"] == DIGEST
    assert model.facts["template"] == TEMPLATE
    assert (model.facts["quantisation"], model.facts["size"], model.facts["server"]) == ("Q4_K_M", "7B", "0.32.5")
    assert "warning" not in model.facts
    server.capabilities = ["completion", "tools"]
    blind = open_model("ollama:llava", RequestMode("ollama:llava", base_url=url))
    assert blind.facts["warning"] == "'llava' takes no pictures: its capabilities are completion, tools"


def test_a_missing_model_is_told_with_the_command_that_gets_it(server: StandIn) -> None:
    """Before the run; and as a kind of its own where it goes away in the middle."""
    with pytest.raises(SpecError, match="Ollama has no model 'bakllava:7b': get it with 'ollama pull bakllava:7b'"):
        ask(server, "bakllava:7b")
    reply = ask(server, body={"model": "gone"})
    assert (reply.error, reply.status) == ("missing_model", 404)
    assert "ollama pull" in reply.error_detail


def test_a_server_that_is_not_running_is_told_with_the_command_that_starts_it() -> None:
    """Before the run; and as a connection's failure where it ends in the middle."""
    stand_in = StandIn()
    with Loopback(stand_in.app()) as served:
        url = f"http://127.0.0.1:{served.port}"
        model = open_model("ollama:llava", RequestMode("ollama:llava", base_url=url))
    reply = asyncio.run(_once(model))
    assert reply.error == "connection"
    assert "ollama serve" in reply.error_detail
    with pytest.raises(SpecError, match=r"no Ollama server answers at http://127\.0\.0\.1:\d+ .*'ollama serve'"):
        open_model("ollama:llava", RequestMode("ollama:llava", base_url=url))


def test_another_server_is_not_taken_for_ollama() -> None:
    """A page, or a list where an object must be, is named."""

    async def page(request: web.Request) -> web.Response:
        del request
        return web.Response(text="hello")

    app = web.Application()
    app.router.add_get("/api/tags", page)
    with Loopback(app) as served:
        mode = RequestMode("ollama:llava", base_url=f"http://127.0.0.1:{served.port}")
        with pytest.raises(SpecError, match="is no Ollama server: /api/tags gave no JSON"):
            open_model(mode.spec, mode)
        mode = RequestMode("ollama:llava", base_url=f"http://127.0.0.1:{served.port}/else")
        with pytest.raises(SpecError, match="is no Ollama server: /api/tags gave HTTP 404"):
            open_model(mode.spec, mode)


def test_an_option_that_ollama_does_not_know_is_refused(server: StandIn) -> None:
    """Before anything is asked."""
    with pytest.raises(SpecError, match="has no option 'thinks'"):
        ask(server, options={"thinks": True})


def test_a_redirect_is_not_followed_with_the_headers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another address would get the secret in them."""
    monkeypatch.setenv("TEAM_TOKEN", "team-token-1234")
    seen: list[str] = []

    async def there(request: web.Request) -> web.Response:
        seen.append(request.headers.get("X-Team", ""))
        return web.json_response({"models": []})

    other = web.Application()
    other.router.add_get("/api/tags", there)
    with Loopback(other) as elsewhere:

        async def away(request: web.Request) -> web.Response:
            del request
            raise web.HTTPFound(f"http://127.0.0.1:{elsewhere.port}/api/tags")

        app = web.Application()
        app.router.add_get("/api/tags", away)
        with Loopback(app) as served:
            url = f"http://127.0.0.1:{served.port}"
            mode = RequestMode("ollama:llava", base_url=url, headers={"X-Team": "$TEAM_TOKEN"})
            with pytest.raises(SpecError, match="/api/tags gave HTTP 302"):
                open_model(mode.spec, mode)
    assert seen == []


@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # the thread is left behind, as it must be
@pytest.mark.parametrize("said", [b"no HTTP at all\r\n\r\n", b"HTTP/1.1 200 OK\r\nX: 1\r\n"])
def test_what_drips_or_speaks_no_http_is_told_in_time(monkeypatch: pytest.MonkeyPatch, said: bytes) -> None:
    """However steadily its bytes come."""
    monkeypatch.setattr(ollama, "_ASKING_S", 0.5)
    over = threading.Event()

    def serve(listener: socket.socket) -> None:
        connection, _ = listener.accept()
        with connection:
            try:
                connection.recv(65_536)
                connection.sendall(said)
                while not over.wait(0.05):
                    connection.sendall(b"a")
            except OSError:
                return

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve, args=(listener,))
        thread.start()
        began = time.monotonic()
        mode = RequestMode("ollama:llava", base_url=f"http://127.0.0.1:{listener.getsockname()[1]}")
        with pytest.raises(SpecError, match="no Ollama server answers"):
            open_model(mode.spec, mode)
        assert time.monotonic() - began < 30
        over.set()
        for one in (thread, *(one for one in threading.enumerate() if one.name == "ollama-opens")):
            one.join(5)
        gc.collect()


def test_an_error_in_the_stream_may_be_an_object(server: StandIn) -> None:
    """Its message is told."""
    server.fails_inside = {"message": "out of memory", "code": 500}  # type: ignore[assignment]
    reply = ask(server)
    assert (reply.error, reply.error_detail) == ("server_error", "out of memory")


@pytest.mark.parametrize(
    ("words", "kind"),
    [("model 'llava' not found", "missing_model"), ("image: unknown format not found", "server_error")],
)
def test_only_a_model_that_is_not_found_is_missing(server: StandIn, words: str, kind: str) -> None:
    """A picture's format that is not found sets no model aside."""
    server.fails_inside = words
    assert ask(server).error == kind
