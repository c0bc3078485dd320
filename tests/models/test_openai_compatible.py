"""The adapter for chat completions: what it sends, and how it reads what comes back."""

import asyncio
import base64
import email.utils
import gzip
import hashlib
import json
import time
from collections.abc import Callable
from urllib.parse import quote

import numpy as np
import orjson
import pytest
from aiohttp import web

from eyechart.calls import Query, Reply, bounded
from eyechart.errors import SpecError
from eyechart.frames import Stimulus, encode
from eyechart.limits import is_asking_too_much
from eyechart.messages import Turn
from eyechart.models import Model, open_model
from eyechart.models.http import proxy_for
from eyechart.modes import RequestMode
from eyechart.spaces.discrete import DRIVING, Discrete
from eyechart.spaces.scene import SCHEMA
from faults import FaultServer, answer, completion, refuse

PICTURE = encode(np.full((8, 8, 3), 128, dtype=np.uint8))
QUERY = Query("Drive.", "Which action?", Stimulus.of(PICTURE), 2**62 + 5, DRIVING.schema())
JPEG = b"\xff\xd8\xff\xe0"
KEY = "sk-test-0123456789abcdef"


def mode_of(base_url: str, **fields: object) -> RequestMode:
    """Return a mode of the model ``m`` at an address."""
    return RequestMode("openai:m", base_url=base_url, **fields)  # type: ignore[arg-type]


async def once(model: Model, query: Query = QUERY) -> Reply:
    """Ask once and let the model go."""
    try:
        return await model.answer(query)
    finally:
        await model.close()


def ask(server: FaultServer, query: Query = QUERY, **fields: object) -> Reply:
    """Ask a server once."""
    return asyncio.run(once(open_model("openai:m", mode_of(server.base_url, **fields)), query))


def says(response: Callable[[], web.StreamResponse]) -> FaultServer:
    """Return a server that always gives this response."""

    async def handle(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        del request, asked, attempt
        return response()

    return FaultServer([handle])


def reads(body: object) -> Reply:
    """Return how a body of status 200 is read."""
    with says(lambda: web.json_response(body)) as server:
        return ask(server)


def test_the_request_is_as_the_api_has_it() -> None:
    """The picture before the words, as a data URI; budget and temperature; no seed unless the mode says so."""
    with FaultServer() as server:
        ask(server, max_tokens=77)
    (asked,) = server.asked
    url = f"data:image/png;base64,{base64.b64encode(PICTURE).decode()}"
    assert asked == {
        "model": "m",
        "messages": [
            {"role": "system", "content": "Drive."},
            {
                "role": "user",
                "content": [
                    {"type": "image_url", "image_url": {"url": url}},
                    {"type": "text", "text": "Which action?"},
                ],
            },
        ],
        "max_tokens": 77,
        "temperature": 0.0,
    }


def test_a_mode_changes_the_request(monkeypatch: pytest.MonkeyPatch) -> None:
    """Token field, seed, no temperature, schema, headers with their variables filled in, and a body that wins.

    The schema is that of an action, or of a scene where one is asked for.
    """
    monkeypatch.setenv("TEAM_TOKEN", "team-token-1234")
    with FaultServer() as server:
        ask(
            server,
            query=Query("", "Which?", Stimulus(), 2**40 + 9, Discrete("two", ("GO", "STOP"), (), (), ()).schema()),
            token_field="max_completion_tokens",  # noqa: S106 - the name of a field
            temperature=None,
            seed=True,
            structured="json_schema",
            headers={"X-Team": "$TEAM_TOKEN", "X-Title": "eyechart"},
            body={"max_completion_tokens": 9, "provider": {"only": ["x"]}},
        )
        ask(server, structured="json_object")
        ask(server, query=Query("", "Which scene?", Stimulus(), 1, schema=SCHEMA), structured="json_schema")
    first, second, third = server.asked
    assert third["response_format"]["json_schema"]["schema"] == SCHEMA  # type: ignore[index]
    schema = first.pop("response_format")
    assert first == {
        "model": "m",
        "messages": [{"role": "user", "content": [{"type": "text", "text": "Which?"}]}],
        "max_completion_tokens": 9,
        "seed": 9,
        "provider": {"only": ["x"]},
    }
    assert schema == {
        "type": "json_schema",
        "json_schema": {
            "name": "decision",
            "strict": True,
            "schema": {
                "type": "object",
                "properties": {"action": {"type": "string", "enum": ["GO", "STOP"]}},
                "required": ["action"],
                "additionalProperties": False,
            },
        },
    }
    assert second["response_format"] == {"type": "json_object"}
    assert (server.headers[0]["X-Team"], server.headers[0]["X-Title"]) == ("team-token-1234", "eyechart")


def test_a_jpeg_is_sent_as_a_jpeg() -> None:
    """The media type is that of the bytes."""
    with FaultServer() as server:
        ask(server, query=Query("", "?", Stimulus.of(b"\xff\xd8\xff\xe0"), 1))
    assert "data:image/jpeg;base64," in str(server.asked[0])


def test_a_body_with_pictures_in_their_places_is_that_of_the_whole_json() -> None:
    """To the byte, as the ledger holds its digest; also beside words with the sign of a place."""
    turns = (
        Turn("system", ('Mind \0 and "this".',)),
        Turn("user", (PICTURE, "first \0", JPEG, "second")),
        Turn("assistant", ("SLOW",)),
        Turn("user", ("And now? ü", PICTURE)),
    )
    query = Query('Mind \0 and "this".', "And now? ü", Stimulus.of(PICTURE), 5, DRIVING.schema(), turns)
    with FaultServer() as server:
        reply = ask(server, query, structured="json_schema", body={"note": "\0"})
        (sent,) = server.asked
    content = [_plain(part) for part in turns[1].parts]
    assert [one["content"] for one in sent["messages"]] == [
        turns[0].words,
        content,
        "SLOW",
        [_plain(part) for part in turns[3].parts],
    ]
    assert sent["note"] == "\0"
    whole = orjson.dumps(sent)
    assert (len(whole), hashlib.sha256(whole).hexdigest()) == (reply.payload_bytes, reply.payload_sha256)


def _plain(part: str | bytes) -> dict[str, object]:
    """Return a part of a message as the API has it."""
    if isinstance(part, str):
        return {"type": "text", "text": part}
    kind = "image/jpeg" if part == JPEG else "image/png"
    return {"type": "image_url", "image_url": {"url": f"data:{kind};base64,{base64.b64encode(part).decode()}"}}


def test_several_cameras_are_sent_in_their_order_before_the_words() -> None:
    """As parts of one message."""
    two = Stimulus({"wrist": b"\xff\xd8\xff\xe0", "front": PICTURE})
    with FaultServer() as server:
        ask(server, query=Query("", "Which?", two, 1))
    parts = server.asked[0]["messages"][0]["content"]  # type: ignore[index]
    assert [part["type"] for part in parts] == ["image_url", "image_url", "text"]
    kinds = [part["image_url"]["url"].partition(";")[0] for part in parts[:2]]
    assert kinds == ["data:image/jpeg", "data:image/png"]


def test_what_is_thought_stands_apart_from_what_is_said() -> None:
    """Under both names that servers give it, in parts too; with the tokens, the upstream and the cost reported."""
    usage = {
        "prompt_tokens": 900,
        "completion_tokens": 60,
        "completion_tokens_details": {"reasoning_tokens": 58},
        "cost": 0.00042,
    }
    for name in ("reasoning_content", "reasoning"):
        body = completion("STOP", usage=usage, provider="Upstream B")
        body["choices"][0]["message"][name] = "A car is near."  # type: ignore[index]
        reply = reads(body)
        assert (reply.text, reply.reasoning) == ("STOP", "A car is near.")
        assert (reply.prompt_tokens, reply.completion_tokens, reply.reasoning_tokens) == (900, 60, 58)
        assert (reply.provider, reply.cost_usd) == ("Upstream B", 0.00042)
    parts = [{"type": "text", "text": "ST"}, {"type": "image", "x": 1}, {"type": "text", "text": "OP"}]
    assert reads(completion(parts)).text == "STOP"  # type: ignore[arg-type]


def test_a_budget_used_up_by_thinking_is_an_empty_reply_with_its_reason() -> None:
    """The paper's lost calls: no content, finish reason length, and no error."""
    reply = reads(completion(None, "length"))
    assert (reply.text, reply.finish_reason, reply.error) == ("", "length", None)


def test_a_refusal_in_its_own_field_is_a_refusal() -> None:
    """OpenAI's structured outputs put it there; the words are kept."""
    body = completion(None)
    body["choices"][0]["message"]["refusal"] = "I will not decide this."  # type: ignore[index]
    reply = reads(body)
    assert (reply.text, reply.finish_reason, reply.error) == ("I will not decide this.", "refusal", None)


@pytest.mark.parametrize(
    "body",
    [
        [],
        "SLOW",
        7,
        None,
        {},
        {"choices": []},
        {"choices": "SLOW"},
        {"choices": [7]},
        {"choices": [{"message": None}]},
        {"choices": [{"text": "SLOW"}]},
    ],
)
def test_json_of_another_shape_is_unreadable(body: object) -> None:
    """Never an exception, never an answer."""
    reply = reads(body)
    assert (reply.error, reply.text, reply.status) == ("unreadable", "", 200)


@pytest.mark.parametrize("said", ["Fri, 31 Dec 9999 23:59:59 GMT", "1000000000000"])
def test_a_wait_beyond_every_bound_is_a_long_wait(said: str) -> None:
    """And not one that was never asked for: the model is set aside."""
    with says(lambda: refuse(429, "busy", {"Retry-After": said})) as server:
        assert is_asking_too_much(bounded(ask(server)))


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (gzip.compress(json.dumps(completion("SLOW")).encode()), "compressed (gzip), against the request"),
        (b" <!DOCTYPE html><p>Welcome", "a page (HTML): another program may answer at this address"),
        (b"SLOW", "the body is no JSON: "),
    ],
)
def test_a_body_that_is_no_json_is_said_to_be_what_it_is(body: bytes, said: str) -> None:
    """As far as its first bytes tell."""
    with says(lambda: web.Response(body=body, content_type="application/json")) as server:
        reply = ask(server)
    assert reply.error == "unreadable"
    assert said in reply.error_detail


def test_a_redirect_without_an_address_is_none_to_give() -> None:
    """As a 304 to a question that nobody kept."""
    with says(lambda: web.Response(status=304)) as server:
        assert ask(server).error_detail == "HTTP 304: no answer, and no other address is given"


def content(*parts: object) -> dict[str, object]:
    """Return a body whose message comes in parts."""
    return {"choices": [{"message": {"content": list(parts)}, "finish_reason": "stop"}]}


@pytest.mark.parametrize("kind", ["text", "output_text", None])
def test_every_part_of_a_text_is_read(kind: str | None) -> None:
    """Also where a server gives parts another type, or none; what was thought is no answer."""
    typed = {"text": "Do not "} if kind is None else {"type": kind, "text": "Do not "}
    thought = {"type": "thinking", "thinking": "LEFT?"}, {"type": "reasoning", "text": "LEFT is free."}
    assert reads(content(*thought, typed, "SLOW, ", {"type": "text", "text": "STOP."})).text == "Do not SLOW, STOP."


@pytest.mark.parametrize("part", [{"type": "markdown", "text": "Do not"}, {"type": "text", "text": {"a": 1}}, ["not"]])
def test_a_text_of_which_a_part_cannot_be_read_is_not_read_without_it(part: object) -> None:
    """The rest may say the opposite; the same holds in a stream."""
    reply = reads(content(part, {"type": "text", "text": "STOP"}))
    assert (reply.error, reply.text) == ("unreadable", "")


def test_numbers_that_are_none_are_not_taken_for_numbers() -> None:
    """Of any type and size; the answer itself stands."""
    for wrong in (True, -1, 2**70, "7", 1.5, [], None):
        usage = {"prompt_tokens": wrong, "completion_tokens": wrong, "cost": -1.0, "completion_tokens_details": wrong}
        reply = reads(completion("STOP", usage=usage))
        assert (reply.text, reply.prompt_tokens, reply.completion_tokens) == ("STOP", None, None)
        assert (reply.cost_usd, reply.reasoning_tokens) == (None, None)
    assert reads(completion("STOP", usage="many", system_fingerprint=7, model=7)).served is None


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        ({"code": 429, "message": "busy"}, "rate_limited"),
        ({"code": 402, "message": "no credits"}, "quota"),
        ({"message": "odd"}, "server_error"),
        ("odd", "server_error"),
    ],
)
def test_an_error_inside_a_200_is_an_error_of_its_kind(error: object, kind: str) -> None:
    """On top, or in the choice, as routers report what their upstream did."""
    assert reads({"error": error}).error == kind
    body = completion("SL", "error")
    body["choices"][0]["error"] = error  # type: ignore[index]
    reply = reads(body)
    assert (reply.error, reply.text) == (kind, "")


def test_a_date_is_read_as_retry_after() -> None:
    """As RFC 9110 allows; nonsense and a past date are no wait."""
    for said, least, most in (
        (email.utils.formatdate(time.time() + 30, usegmt=True), 25, 31),
        (email.utils.formatdate(time.time() - 30, usegmt=True), 0, 0),
        ("7", 7, 7),
    ):
        with says(lambda said=said: refuse(429, "busy", {"Retry-After": said})) as server:  # type: ignore[misc]
            wait = ask(server).retry_after_s
        assert wait is not None
        assert least <= wait <= most
    for nonsense in ("soon", "-3", "nan", "inf", ""):
        with says(lambda said=nonsense: refuse(429, "busy", {"Retry-After": said})) as server:  # type: ignore[misc]
            assert ask(server).retry_after_s is None


def test_the_words_of_an_error_are_bounded_and_one_line() -> None:
    """Whatever a server sends."""
    with says(lambda: refuse(500, "a\x1b[31m\n" + "b" * 99_999)) as server:
        detail = ask(server).error_detail
    assert detail.startswith("HTTP 500: a")
    assert len(detail) <= 500
    assert detail.isprintable()


def test_a_key_comes_from_the_environment_and_does_not_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither in an answer, nor in an error, nor in the text of the model itself."""
    monkeypatch.setenv("MY_KEY", f"{KEY}\n")

    async def echo(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        del asked, attempt
        said = request.headers["Authorization"]
        if request.headers.get("X-Fail"):
            return refuse(500, f"bad header {said}")
        return answer(f"you said {said}", model=said, provider=said)

    with FaultServer([echo]) as server:
        model = open_model("openai:m", mode_of(server.base_url, key_env="MY_KEY"))
        replies = [asyncio.run(once(model)), ask(server, key_env="MY_KEY", headers={"X-Fail": "1"})]
    assert server.headers[0]["Authorization"] == f"Bearer {KEY}"
    assert replies[0].text == "you said Bearer [key removed]"
    assert replies[1].error == "server_error"
    assert KEY not in repr((model, replies))


def test_a_key_that_is_needed_and_missing_is_told_before_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the name of its variable; a server of one's own needs none."""
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    with pytest.raises(SpecError, match=r"'openai:m' needs a key\. Set the environment variable OPENAI_API_KEY"):
        open_model("openai:m")
    with pytest.raises(SpecError, match="Set the environment variable MY_KEY"):
        open_model("openai:m", mode_of("http://127.0.0.1:9/v1", key_env="MY_KEY"))
    with FaultServer() as server:
        ask(server)
    assert "Authorization" not in server.headers[0]


def test_a_router_that_may_change_its_mind_is_warned_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless the mode pins it."""
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    at = "https://openrouter.ai/api/v1"
    for pinned in ({"only": ["x"]}, {"order": ["x"], "allow_fallbacks": False}):
        assert "warning" not in open_model("openai:m", mode_of(at, body={"provider": pinned})).facts
    for loose in ({}, {"provider": {"order": ["x"]}}):
        assert "routing is not pinned" in open_model("openai:m", mode_of(at, body=loose)).facts["warning"]
    assert "without encryption" in open_model("openai:m", mode_of("http://example.org/v1")).facts["warning"]


def test_an_address_may_name_the_whole_path() -> None:
    """With a slash at its end, or the route itself."""
    with FaultServer() as server:
        for tail in ("/", "/chat/completions"):
            model = open_model("openai:m", mode_of(f"{server.base_url}{tail}"))
            assert asyncio.run(once(model)).text == "SLOW"


def test_many_calls_share_one_session_and_a_closed_model_opens_another() -> None:
    """Also in another event loop."""

    async def several(model: Model) -> set[str]:
        replies = await asyncio.gather(*(model.answer(QUERY) for _ in range(20)))
        await model.close()
        return {reply.text for reply in replies}

    with FaultServer() as server:
        model = open_model("openai:m", mode_of(server.base_url))
        assert asyncio.run(several(model)) == asyncio.run(several(model)) == {"SLOW"}
        assert server.requests == 40


@pytest.mark.parametrize(
    ("address", "proxy"),
    [
        ("https://api.example.org/v1", "http://proxy.test:3128"),
        ("https://inside.example.net/v1", None),
        ("http://127.0.0.1:8000/v1", None),
        ("http://localhost:8000/v1", None),
        ("http://[::1]:8000/v1", None),
    ],
)
def test_a_proxy_is_that_of_the_environment_but_never_for_this_machine(
    address: str, proxy: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """NO_PROXY is kept too."""
    for name in ("HTTP_PROXY", "HTTPS_PROXY", "http_proxy", "https_proxy"):
        monkeypatch.setenv(name, "http://proxy.test:3128")
    monkeypatch.setenv("NO_PROXY", ".example.net")
    monkeypatch.setenv("no_proxy", ".example.net")
    assert proxy_for(address) == proxy


@pytest.mark.parametrize(
    "proxy",
    [
        "http://user:hunter2pw@[bad",
        "http://user:hunter2pw@proxy.test:99999",
        "http://user:hunter2pw@proxy.test:0",
        "http://user:hunter2pw@proxy test:1",
        "http://user:hunter2pw#@proxy.test:1",
        "http://user:hunter2pw",
        "user:hunter2pw@proxy.test:3128",
        "hunter2pw:3128",
        "socks5://user:hunter2pw@proxy.test:1",
        "http://user:hunter2pw@proxy.test:1/path",
    ],
)
@pytest.mark.parametrize("spec", ["openai:m", "ollama:m"])
def test_a_malformed_proxy_is_refused_when_a_model_is_opened_and_is_not_quoted(
    spec: str, proxy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may hold a password."""
    for name in ("HTTP_PROXY", "http_proxy"):
        monkeypatch.setenv(name, proxy)
    monkeypatch.delenv("no_proxy", raising=False)
    monkeypatch.delenv("NO_PROXY", raising=False)
    with pytest.raises(SpecError, match="proxy that HTTP_PROXY names has a malformed address") as refused:
        open_model(spec, RequestMode(spec, base_url="http://gate.example/v1"))
    assert "hunter2pw" not in str(refused.value)
    assert "proxy.test" not in str(refused.value)


def test_the_password_of_a_proxy_and_a_malformed_address_are_never_quoted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither where the proxy does not answer, nor where there can be no such host."""
    for name in ("HTTP_PROXY", "http_proxy"):
        monkeypatch.setenv(name, "http://user:hunter2pw@127.0.0.1:9")
    monkeypatch.delenv("no_proxy", raising=False)
    monkeypatch.delenv("NO_PROXY", raising=False)
    model = open_model("openai:m", RequestMode("openai:m", base_url="http://gate.example/v1"))
    reply = asyncio.run(once(model))
    assert reply.error == "connection"
    assert "hunter2pw" not in repr(reply)
    for odd in ("http://gate hunter2pw/v1", "http://gate\\hunter2pw/v1", "http://gate<hunter2pw>/v1"):
        with pytest.raises(SpecError, match="base_url must be a URL") as refused:
            RequestMode("openai:m", base_url=odd)
        assert "hunter2pw" not in str(refused.value)


def test_no_field_that_a_server_fills_brings_a_key_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every text of a reply, the reason of its end too."""
    monkeypatch.setenv("MY_KEY", KEY)
    body = completion(f"a {KEY}", f"b {KEY}", model=f"c {KEY}", provider=f"d {KEY}", system_fingerprint=f"e {KEY}")
    body["choices"][0]["message"]["reasoning"] = f"f {KEY}"  # type: ignore[index]
    with says(lambda: web.json_response(body)) as server:
        reply = ask(server, key_env="MY_KEY")
    assert reply.finish_reason == "b [key removed]"
    assert repr(reply).count("[key removed]") == 7
    assert KEY not in repr(reply)


@pytest.mark.parametrize("before", [480, 495, 1995])
def test_no_part_of_a_key_is_left_where_a_text_is_cut(monkeypatch: pytest.MonkeyPatch, before: int) -> None:
    """A text is cut after the key is out of it, in an error as in a name."""
    monkeypatch.setenv("MY_KEY", KEY)
    body = completion("GO", "s" * 190 + KEY, model="m" * 190 + KEY)
    with says(lambda: web.json_response(body)) as server:
        named = ask(server, key_env="MY_KEY")
    with says(lambda: refuse(500, "x" * (before - 10) + KEY)) as server:
        failed = ask(server, key_env="MY_KEY")
    with says(lambda: web.Response(status=500, text="x" * (before - 10) + KEY)) as server:
        plain = ask(server, key_env="MY_KEY")
    with says(lambda: web.json_response({"error": "x" * before + KEY})) as server:
        inside = ask(server, key_env="MY_KEY")
    with says(lambda: web.json_response(content({"type": "x" * (before % 40) + KEY, "text": "GO"}))) as server:
        unread = ask(server, key_env="MY_KEY")
    assert "sk-" not in repr((named, failed, plain, inside, unread))
    assert len(named.finish_reason or "") == len(named.served or "") == 200


@pytest.mark.parametrize("lead", ["", "a", "ab"])
def test_a_key_in_another_writing_does_not_come_back(monkeypatch: pytest.MonkeyPatch, lead: str) -> None:
    """In base64 at any alignment, percent-encoded, or escaped as JSON."""
    key = 'sk+test/0123456789?abc"def'
    monkeypatch.setenv("MY_KEY", key)
    whole = (lead + key + "tail").encode()
    forms = [base64.b64encode(whole), base64.urlsafe_b64encode(whole), quote(key, safe="").encode()]
    forms += [json.dumps(key).encode(), quote(key, safe="").lower().encode()]
    for form in forms:
        reply = reads_with_key(form.decode())
        assert "[key removed]" in reply.text, form


def reads_with_key(said: str) -> Reply:
    """Return how a server's words are read by a mode with a key."""
    with says(lambda: answer(said)) as server:
        return ask(server, key_env="MY_KEY")


@pytest.mark.parametrize("said", ["Mon, 01 Jan 99999999999999999999 00:00:00 GMT", "Fri, 31 Dec 9999 23:59:59 -2359"])
def test_a_date_beyond_every_calendar_is_no_wait(said: str) -> None:
    """And the 429 stays what it is."""
    with says(lambda: refuse(429, "busy", {"Retry-After": said})) as server:
        reply = ask(server)
    assert (reply.error, reply.status) == ("rate_limited", 429)


@pytest.mark.parametrize("depth", [300, 1000, 20_000])
@pytest.mark.parametrize(("start", "end"), [('{"error":', "}"), ("[", "]"), ('{"x":', "}")])
def test_an_error_that_is_nested_deeply_is_still_the_server_s(depth: int, start: str, end: str) -> None:
    """It may pass, so the call is made again."""
    body = start * depth + "1" + end * depth
    with says(lambda: web.Response(status=500, text=body)) as server:
        reply = ask(server)
    assert (reply.error, reply.status) == ("server_error", 500)
    with says(lambda: web.Response(text='{"error":' + body + "}")) as server:
        assert ask(server).error in {"server_error", "unreadable"}


def test_half_a_surrogate_pair_does_not_lose_the_answer() -> None:
    """JSON can write it, and some servers cut an emoji in two."""
    body = json.dumps(completion("STOP @")).replace("@", "\\ud83d")
    with says(lambda: web.Response(text=body, content_type="application/json")) as server:
        reply = ask(server)
    assert (reply.error, reply.text) == (None, "STOP \ud83d")


@pytest.mark.parametrize(
    ("status", "message", "kind"),
    [
        (403, "your input was flagged", "bad_request"),
        (403, "Moderation refused this request", "bad_request"),
        (403, "your country is not supported", "auth"),
    ],
)
def test_a_request_that_is_moderated_away_is_no_wrong_key(status: int, message: str, kind: str) -> None:
    """The next frame may well be answered."""
    with says(lambda: refuse(status, message)) as server:
        assert ask(server).error == kind
