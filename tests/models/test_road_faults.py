"""Faults of the road may pass; only what shows that the request is wrong ends a call."""

import asyncio
import gc
import re
import socket
from pathlib import Path

import pytest

from broken_roads import ROADS, TROUBLE, BrokenRoad
from eyechart.calls import KINDS, TRANSIENT, Query, Reply
from eyechart.frames import Stimulus
from eyechart.models import Model, ask, open_model
from eyechart.models.faults import is_of_the_road, kind_of_status, with_proof
from eyechart.models.http import Endpoint, words_of
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
    "moderation, as Azure says it": (
        400,
        {
            "error": {
                "message": "The response was filtered due to the prompt triggering content management policy. Please "
                "modify your prompt and retry. See https://example.org/rate-limits",
                "code": "content_filter",
                "param": "prompt",
                "innererror": {"code": "ResponsibleAIPolicyViolation"},
            }
        },
    ),
    "moderation, with advice": (
        400,
        {
            "error": {
                "message": "your prompt was flagged. Please try again with a different prompt: https://x.org/retry"
            }
        },
    ),
    "moderation, as DashScope says it": (400, {"message": "Input data may contain inappropriate content."}),
    "a size, with advice": (400, {"error": "Image is too large, please resize the image and try again"}),
    "a size, as Anthropic says it": (413, {"error": {"message": "Request exceeds the maximum size"}}),
    "a context, as SGLang says it": (
        400,
        {"message": "The input (5000 tokens) is longer than the model's context length (4096 tokens).", "code": 400},
    ),
    "a context, as llama.cpp says it": (
        400,
        {"error": {"message": "the request exceeds the available context size. try increasing the context size"}},
    ),
    "a context, through LiteLLM": (
        400,
        {
            "error": {
                "message": "litellm.ContextWindowExceededError: This model's maximum context length is 4096 tokens.\n"
                "LiteLLM Retried: 2 times, LiteLLM Max Retries: 3"
            }
        },
    ),
    "a field, as Bedrock says it": (
        400,
        {"message": "Malformed input request: #: extraneous key [x] is not permitted, please reformat and try again."},
    ),
    "a field, in JSON inside a text": (
        400,
        {"error": {"message": "Provider returned error", "metadata": {"raw": '{"error": {"param": "max_tokens"}}'}}},
    ),
    "a field, by its path": (400, {"error": '[{"code": "invalid_type", "path": ["messages", 0]}]'}),
    "a field, beside what was sent": (
        422,
        {"detail": [{"loc": ["body", "messages"], "msg": "no list", "input": "overloaded, try again"}]},
    ),
    "a field that is no number": (422, {"detail": [{"loc": ["body", "seed"], "msg": "unable to parse string"}]}),
    "a field, with an empty param": (400, {"error": {"message": "max_tokens is too large: 5000", "param": ""}}),
}
ASIDE = {
    "what is billed": ("quota", 400, {"error": {"message": "x", "code": "billing_hard_limit_reached", "param": None}}),
    "credit": ("quota", 400, {"error": {"message": "Your credit balance is too low to access the API"}}),
    "a budget": ("quota", 400, {"error": {"message": "Budget has been exceeded! Max budget: 0.05"}}),
    "a day's tokens": ("quota", 400, {"error": {"message": "Daily token limit exceeded"}}),
    "a key's month": ("quota", 403, {"error": {"message": "Key limit exceeded (monthly)"}}),
    "funds": ("quota", 429, {"error": {"message": "You have run out of credits", "code": "insufficient_funds"}}),
    "a minute's quota": ("rate_limited", 429, {"error": {"message": "Quota exceeded: requests per minute"}}),
    "a key": ("auth", 400, {"error": {"message": "API key not valid. Please pass a valid API key."}}),
    "a header of the key": ("auth", 422, {"detail": [{"loc": ["header", "authorization"], "msg": "Field required"}]}),
    "a place": ("auth", 400, {"error": {"message": "User location is not supported for the API use."}}),
    "an account": ("auth", 403, {"error": {"message": "your account was flagged"}}),
    "a model": ("missing_model", 422, {"detail": "Model x does not exist"}),
    "a model of the past": ("missing_model", 400, {"error": {"message": "The model `x` has been deprecated"}}),
    "a model that is decommissioned": ("missing_model", 400, {"error": "The model `x` has been decommissioned"}),
    "a model's identifier": ("missing_model", 400, {"message": "The provided model identifier is invalid."}),
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
    **TROUBLE,
}


@pytest.mark.parametrize("name", WRONG)
def test_json_that_names_a_field_or_a_limit_or_a_moderation_ends_a_call(name: str) -> None:
    """The same request would be refused again."""
    assert kind_of_status(*WRONG[name]) == "bad_request"


@pytest.mark.parametrize("name", PASSING)
def test_a_refusal_that_proves_nothing_of_the_request_may_pass(name: str) -> None:
    """Whatever its status: gateways send them too."""
    assert kind_of_status(*PASSING[name]) == "gateway"


@pytest.mark.parametrize("name", ASIDE)
def test_what_is_said_of_the_key_the_account_or_the_model_s_name_is_of_no_request(name: str) -> None:
    """Whatever its status; a model with such a failure is set aside, and its calls stay to be made."""
    kind, *said = ASIDE[name]
    assert kind_of_status(*said) == kind


@pytest.mark.parametrize("name", [*PASSING, *ASIDE])
def test_what_ended_a_call_before_and_proves_nothing_is_asked_again(name: str) -> None:
    """In a run in which it had been taken for a wrong request."""
    *_, status, said = PASSING[name] if name in PASSING else ASIDE[name]
    assert is_of_the_road(Reply(error="bad_request", status=status, error_detail=f"HTTP {status}: {words_of(said)}"))


@pytest.mark.parametrize("name", WRONG)
def test_what_proves_the_request_wrong_stays_so_when_it_is_read_again(name: str) -> None:
    """What proves it stands behind the words, where it does not stand in them."""
    status, said = WRONG[name]
    detail = with_proof(f"HTTP {status}: {words_of(said)}", status, said)
    assert not is_of_the_road(Reply(error="bad_request", status=status, error_detail=detail))


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


def test_a_server_that_is_gone_leaves_no_request_in_memory() -> None:
    """Failures held their frames in circles, and a served guardian grew by a third once a model had ended."""

    async def failed() -> tuple[set[str | None], int]:
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = taken.getsockname()[1]
        endpoint = Endpoint(f"http://127.0.0.1:{port}/v1", 5.0)
        kinds = {(await endpoint.post("/chat/completions", b"x")).error for _ in range(3)}
        gc.collect()
        gc.disable()
        try:
            for _ in range(30):
                kinds.add((await endpoint.post("/chat/completions", bytes(1000))).error)
            return kinds, gc.collect()
        finally:
            gc.enable()
            await endpoint.close()

    kinds, left = asyncio.run(failed())
    assert kinds == {"connection"}
    assert left < 30


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
