"""Replies that come in server-sent events are read as if they had come whole."""

import asyncio
import json
from collections.abc import Sequence

import pytest
from aiohttp import web

from eyechart.calls import Query, Reply
from eyechart.frames import Stimulus
from eyechart.models import open_model
from eyechart.modes import RequestMode
from faults import FaultServer

QUERY = Query("Drive.", "Which action?", Stimulus(), 5)


def asked(pieces: Sequence[bytes], *, kind: str = "text/event-stream", pause_s: float = 0.0) -> Reply:
    """Return how a body that comes in these pieces is read, each after a pause."""

    async def handle(request: web.Request, wanted: dict[str, object], attempt: int) -> web.StreamResponse:
        del wanted, attempt
        response = web.StreamResponse(headers={"Content-Type": kind})
        await response.prepare(request)
        for piece in pieces:
            await response.write(piece)
            await asyncio.sleep(pause_s)
        return response

    async def once(base_url: str) -> Reply:
        model = open_model("openai:m", RequestMode("openai:m", base_url=base_url))
        try:
            return await model.answer(QUERY)
        finally:
            await model.close()

    with FaultServer([handle]) as server:
        return asyncio.run(once(server.base_url))


def event(end: bytes = b"\n\n", finish: str | None = None, **delta: object) -> bytes:
    """Return an event with a delta."""
    choice = {"index": 0, "delta": delta, "finish_reason": finish}
    return b"data: " + json.dumps({"model": "m-1", "choices": [choice]}).encode() + end


USAGE = b'data: {"choices": [], "usage": {"prompt_tokens": 7, "completion_tokens": 2}, "system_fingerprint": "fp"}\n\n'
DONE = b"data: [DONE]\n\n"


def test_a_stream_is_put_together() -> None:
    """Words, reasoning, the reason of its end, tokens and names; comments and empty choices are no words."""
    pieces = [b": ping\n\n", event(role="assistant", content=""), event(reasoning_content="Hm. "), event(content="SL")]
    reply = asked([*pieces, event(content="OW", reasoning_content=None), event(finish="stop"), USAGE, DONE])
    assert (reply.text, reply.reasoning, reply.finish_reason, reply.error) == ("SLOW", "Hm. ", "stop", None)
    assert (reply.prompt_tokens, reply.completion_tokens) == (7, 2)
    assert (reply.served, reply.system_fingerprint) == ("m-1 fp", "fp")


@pytest.mark.parametrize("kind", ["text/event-stream; charset=utf-8", "text/plain"])
@pytest.mark.parametrize("end", [b"\r\n\r\n", b"\n\n"])
def test_any_piece_size_and_line_end_will_do(kind: str, end: bytes) -> None:
    """Byte by byte too, and where the server does not say that it streams; tokens that are not told are not told."""
    whole = b"".join([event(end, content="SLOW"), event(end, finish="stop"), b"data: [DONE]" + end])
    reply = asked([whole[place : place + 7] for place in range(0, len(whole), 7)], kind=kind)
    assert (reply.text, reply.finish_reason, reply.completion_tokens) == ("SLOW", "stop", None)


@pytest.mark.parametrize("kind", ["text/event-stream", "application/json"])
def test_a_mark_of_byte_order_before_a_stream_is_no_part_of_it(kind: str) -> None:
    """As the standard of events has it."""
    reply = asked([b"\xef\xbb\xbf" + event(content="SLOW"), event(finish="stop"), DONE], kind=kind)
    assert (reply.text, reply.error) == ("SLOW", None)


def test_the_time_to_the_first_words_is_measured() -> None:
    """Not that to a role, nor to a comment that keeps the connection open."""
    pieces = [event(role="assistant", content=""), b": wait\n\n", event(content="SL"), event(content="OW"), DONE]
    reply = asked(pieces, pause_s=0.05)
    assert reply.first_byte_s is not None
    assert reply.seconds is not None
    assert 0.1 <= reply.first_byte_s <= reply.seconds - 0.1


@pytest.mark.parametrize(
    ("pieces", "error", "says"),
    [
        ([event(content="SL")], "cut_short", "before it was done"),
        ([event(content="SL"), b'data: {"choices": [{"del'], "cut_short", "before it was done"),
        ([b"data: hello\n\n", DONE], "unreadable", "an event of the stream is no JSON"),
        ([b"data: [1]\n\n", DONE], "unreadable", "no JSON object but list"),
        ([event(content="SL"), b'data: {"error": {"message": "it broke"}}\n\n'], "server_error", "it broke"),
        ([b""], "cut_short", "before it was done"),
        ([DONE], "unreadable", "no choice with a message"),
        ([b"data: {}\n\n", USAGE, DONE], "unreadable", "no choice with a message"),
        (
            [event(content="SLOW"), b'event: error\ndata: {"message": "overloaded"}\n\n', DONE],
            "server_error",
            "overloaded",
        ),
        ([event(content="SLOW"), b"event: error\ndata: {}\n\n", DONE], "server_error", "without a word"),
    ],
)
def test_a_stream_that_is_not_whole_is_no_answer(pieces: list[bytes], error: str, says: str) -> None:
    """Half an answer is none, and its call is made again."""
    reply = asked(pieces)
    assert (reply.text, reply.error) == ("", error)
    assert says in reply.error_detail


def test_another_end_than_a_normal_one_is_not_taken_back() -> None:
    """Nor is a refusal that comes as a part of the content."""
    ended = [event(content="SLOW"), event(finish="content_filter"), event(finish="stop"), DONE]
    assert asked(ended).finish_reason == "content_filter"
    assert asked([event(content="SLOW"), event(finish="stop"), event(finish="error"), DONE]).finish_reason == "error"
    refused = asked([event(content=[{"type": "refusal", "refusal": "I can't."}]), event(finish="stop"), DONE])
    assert (refused.text, refused.finish_reason) == ("I can't.", "refusal")


def test_a_stream_needs_one_sign_of_its_end() -> None:
    """Some servers send no reason, others no last mark."""
    assert asked([event(content="SLOW"), event(finish="stop")]).text == "SLOW"
    assert asked([event(content="SLOW"), DONE]).text == "SLOW"
    silent = asked([event(finish="length"), DONE])
    assert (silent.text, silent.finish_reason, silent.error) == ("", "length", None)


def test_a_stream_that_calls_a_tool_or_has_other_choices_is_read_by_its_first_choice() -> None:
    """As a whole reply is."""
    other = b'data: {"choices": [{"index": 1, "delta": {"content": "LEFT"}}]}\n\n'
    reply = asked([event(content="SLOW"), other, event(tool_calls=[{"index": 0}]), event(finish="stop"), DONE])
    assert (reply.text, reply.finish_reason) == ("SLOW", "tool_calls")
