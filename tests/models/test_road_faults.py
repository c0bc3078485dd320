"""Faults of the road may pass; only what shows that the request is wrong ends a call."""

import asyncio
import re
from pathlib import Path

import pytest

from broken_roads import ROADS, BrokenRoad
from eyechart.calls import KINDS, TRANSIENT, Query, Reply
from eyechart.frames import Stimulus
from eyechart.models import Model, ask, open_model
from eyechart.models.faults import is_of_the_road, kind_of_status
from eyechart.modes import RequestMode

QUERY = Query("Drive.", "Which action?", Stimulus(), 5)

WRONG = {
    "a field, by param": (400, {"error": {"message": "no", "param": "max_tokens", "code": "unsupported_parameter"}}),
    "a field, by loc": (422, {"detail": [{"type": "missing", "loc": ["body", "messages"], "msg": "Field required"}]}),
    "a field, in words": (400, {"error": {"message": "Unsupported value: 'temperature' does not support 0.5"}}),
    "a picture, in words": (400, {"message": "this model takes no images"}),
    "the system role": (400, {"error": {"message": "System role not supported"}}),
    "a limit, in words": (
        400,
        {"object": "error", "message": "This model's maximum context length is 4096", "param": None},
    ),
    "a limit on tokens": (422, {"error": "Input validation error: `inputs` tokens must be <= 4096", "error_type": "x"}),
    "a size": (413, {"error": {"message": "request too large: at most 20 MB"}}),
    "thinking": (400, {"error": '"llava" does not support thinking'}),
    "an upstream's words": (
        400,
        {"error": {"message": "Provider returned error", "metadata": {"raw": "image too large"}}},
    ),
    "moderation": (400, {"error": {"code": "content_policy_violation", "message": "rejected by our safety system"}}),
    "moderation, forbidden": (403, {"error": {"message": "your input was flagged"}}),
}
PASSING = {
    "no JSON": (400, None),
    "nothing named": (400, {"error": {"message": "Bad Request", "type": "invalid_request_error", "param": None}}),
    "a broken body": (400, {"message": "Unexpected token < in JSON at position 0"}),
    "a busy backend": (400, {"error": {"message": "image backend overloaded, try again", "param": ""}}),
    "a rate": (413, {"error": "rate limit exceeded"}),
    "a conflict": (409, {"error": {"message": "messages conflict", "param": "messages"}}),
    "an empty body": (422, {"detail": [{"loc": ["body"], "msg": "Field required"}]}),
    "not acceptable": (406, {"error": "max_tokens"}),
}


@pytest.mark.parametrize("name", WRONG)
def test_json_that_names_a_field_or_a_limit_or_a_moderation_ends_a_call(name: str) -> None:
    """The same request would be refused again."""
    assert kind_of_status(*WRONG[name]) == "bad_request"


@pytest.mark.parametrize("name", PASSING)
def test_a_refusal_that_proves_nothing_of_the_request_may_pass(name: str) -> None:
    """Whatever its status: gateways send them too."""
    assert kind_of_status(*PASSING[name]) == "gateway"


@pytest.mark.parametrize("waited_s", [0.0, 0.03])
@pytest.mark.parametrize("name", [name for name in ROADS if name not in {"nothing for long", "a drip"}])
def test_after_every_fault_of_the_road_the_next_request_gets_its_own_answer(name: str, waited_s: float) -> None:
    """No fault ends its call, none is taken for an answer, and what came too much is not read as the next reply."""
    with BrokenRoad(roads=[name]) as server:
        model = open_model("openai:m", RequestMode("openai:m", base_url=server.base_url, timeout_s=10))
        first, second = asyncio.run(_after(model, server, waited_s))
    assert first.error in TRANSIENT
    assert (first.text, first.error_detail != "") == ("", True)
    assert second.error in {None, *TRANSIENT}
    assert second.text in {"SLOW", ""}
    assert (second.error is None) == (second.text == "SLOW")


async def _after(model: Model, server: BrokenRoad, waited_s: float) -> tuple[Reply, Reply]:
    first = await ask(model, QUERY)
    await asyncio.sleep(waited_s)
    server.share = 0.0
    second = await ask(model, QUERY)
    await model.close()
    return first, second


def test_failures_of_older_runs_are_told_apart_by_what_they_say() -> None:
    """A gateway's refusal may be asked once more; one that proves the request wrong, and a reply, may not."""
    page = "HTTP 400: <html><body>maximum size</body></html>"
    moved = Reply(error="bad_request", status=301, error_detail="HTTP 301: redirected")
    long = Reply(error="bad_request", status=400, error_detail="HTTP 400: maximum context length is 4096 tokens")
    assert is_of_the_road(Reply(error="bad_request", status=400, error_detail=page))
    assert is_of_the_road(moved)
    assert is_of_the_road(Reply(error="bad_request", status=409, error_detail="HTTP 409: max_tokens"))
    assert all(is_of_the_road(Reply(error=kind)) for kind in ("wrong_json", "too_large", "exception", "timeout"))
    assert not is_of_the_road(long)
    assert not is_of_the_road(Reply(text="", finish_reason="content_filter"))
    assert not is_of_the_road(Reply(text="The vehicle", finish_reason="length"))


def test_the_documentation_has_every_kind() -> None:
    """In the table of what a run does about failures, or below it as one of older runs."""
    page = (Path(__file__).parents[2] / "docs" / "models.md").read_text()
    shown = page.partition("## What a run does about failures")[2].partition("\n## ")[0]
    assert set(KINDS) <= set(re.findall(r"`(\w+)`", shown))
