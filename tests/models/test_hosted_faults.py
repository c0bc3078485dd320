"""What hosted endpoints do that is spelled like something else: a passing limit, a filter's silence, an address."""

import asyncio
import json
from pathlib import Path

import pytest
from aiohttp import web

import banks
from eyechart.calls import Query, Reply
from eyechart.errors import SecretError, SpecError
from eyechart.frames import Stimulus
from eyechart.ledger import Ledger
from eyechart.models import open_model
from eyechart.models.faults import delay_s, kind_of_status
from eyechart.modes import RequestMode, mode_text, read_mode
from eyechart.prompts import PROMPTS
from eyechart.run import Plan, execute
from eyechart.spaces.space import ending, why_unanswered
from faults import SPENT, FaultServer, answer, completion, gemini

QUERY = Query("Drive.", "Which action?", Stimulus(), 7)


@pytest.mark.parametrize("body", [gemini(), [gemini()], gemini("1s"), gemini(2)])
def test_a_limit_a_minute_passes_however_it_speaks_of_billing(body: object) -> None:
    """Where a delay stands beside it; the body may be a list."""
    assert kind_of_status(429, body) == "rate_limited"
    assert delay_s(body) is not None


@pytest.mark.parametrize(
    ("said", "wait"),
    [
        ("Please retry in 45.8s.", 45.8),
        ("Please retry after 9 seconds.", 9.0),
        ("Please try again in 7m12s.", 432.0),
        ("Please try again in 260ms.", 0.26),
        ("wait for 2 min", 120.0),
        ("Please try again in 24 hours.", 86400.0),
        ("Please retry in 30 milliseconds", 0.03),
        ("Please try again in 1h2m3s", 3723.0),
        ("Please try again in 5m", 300.0),
    ],
)
def test_a_delay_that_stands_in_the_words_alone_passes_too(said: str, wait: float) -> None:
    """As a server writes it that wraps another one, and drops what stood beside its message."""
    body = {"error": {"message": f"{SPENT} {said}", "code": 429}}
    assert kind_of_status(429, body) == "rate_limited"
    assert delay_s(body) == pytest.approx(wait)


@pytest.mark.parametrize(
    "said", ["API rate limit exceeded for user", "Too many requests, slow down", "Quota exceeded: requests per minute"]
)
def test_a_403_that_speaks_of_a_rate_is_no_fault_of_the_key(said: str) -> None:
    """Some gateways send it in place of a 429; the model is not set aside for it."""
    assert kind_of_status(403, {"message": said}) == "rate_limited"
    assert kind_of_status(403, {"message": "this key may not use this model"}) == "auth"


def test_a_404_while_a_model_is_loaded_is_no_unknown_model() -> None:
    """The model is asked again; one that does not exist is set aside."""
    assert kind_of_status(404, {"message": "The model is currently being loaded"}) == "gateway"
    assert kind_of_status(404, {"message": "model 'x' not found, try pulling it first"}) == "missing_model"
    assert kind_of_status(404, {"message": "The model `x` does not exist"}) == "missing_model"


@pytest.mark.parametrize("body", [gemini("1s", "PerDay"), gemini(delayed=False), [gemini("1s", "PerDay")]])
def test_a_limit_a_day_and_one_without_a_delay_are_spent(body: object) -> None:
    """No waiting helps within a run."""
    assert kind_of_status(429, body) == "quota"


def replied(handle: object, **fields: object) -> Reply:
    """Return how one reply of a server is read."""

    async def once(model: object) -> Reply:
        try:
            return await model.answer(QUERY)  # type: ignore[attr-defined]
        finally:
            await model.close()  # type: ignore[attr-defined]

    with FaultServer([handle]) as server:
        mode = RequestMode("openai:m", base_url=server.base_url, **fields)
        return asyncio.run(once(open_model("openai:m", mode)))


@pytest.mark.parametrize(
    ("body", "headers", "wait"),
    [
        (gemini(), {}, 45.837906927),
        ({}, {"retry-after-ms": "250"}, 0.25),
        ({}, {"retry-after-ms": "250", "Retry-After": "9"}, 0.25),
        ({}, {"x-ratelimit-reset-requests": "1s", "x-ratelimit-reset-tokens": "6m0s"}, 1.0),
        (
            {},
            {
                "x-ratelimit-reset-requests": "2s",
                "x-ratelimit-remaining-requests": "9",
                "x-ratelimit-reset-tokens": "1m1s",
                "x-ratelimit-remaining-tokens": "0",
            },
            None,
        ),
        ({}, {"x-ratelimit-reset-tokens": "80ms"}, 0.08),
        ({}, {"x-ratelimit-reset-tokens": "soon"}, None),
        ({}, {}, None),
    ],
)
def test_the_time_to_wait_is_read_wherever_it_stands(body: object, headers: dict[str, str], wait: float | None) -> None:
    """In the body, in milliseconds, as the reset of the limit that is used up; never a long one of a whole window."""

    async def busy(request: web.Request, asked: object, attempt: int) -> web.Response:
        del request, asked, attempt
        return web.json_response(body, status=429, headers=headers)

    reply = replied(busy)
    assert reply.error == "rate_limited"
    assert reply.retry_after_s == (None if wait is None else pytest.approx(wait))


@pytest.mark.parametrize(
    "word",
    [
        "IMAGE_PROHIBITED_CONTENT",
        "PROHIBITED_CONTENT",
        "sensitive",
        "content_filter: PROHIBITED_CONTENT",
        "image_safety",
    ],
)
def test_the_words_of_filters_are_refusals(word: str) -> None:
    """With what stands behind them."""
    assert ending(word) == "filtered"
    assert why_unanswered(word, None) == "refused"


def test_what_stands_behind_another_word_makes_it_no_filters() -> None:
    """Only a filter gives its reason."""
    assert ending("pause: content_filter") is None
    assert ending("stop: the end") is None


def test_a_picture_of_a_shape_that_never_passes_is_final() -> None:
    """Qwen's processor refuses a panorama, whenever it is asked."""
    said = {"error": {"message": "absolute aspect ratio must be smaller than 200, got 250.0", "code": 400}}
    assert kind_of_status(400, said) == "bad_request"


def run_on(tmp_path: Path, handle: object, attempts: int = 3) -> tuple[list[Reply], int]:
    """Return the last replies of a small run, and how many calls are left."""
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light"], episodes=1)
    with FaultServer([handle]) as server:
        mode = RequestMode("openai:m", base_url=server.base_url, seed=True)
        frames = bank.frames[:3]
        plan = Plan("endpoint", bank, PROMPTS["baseline"], ("openai:m",), ("real", "text_only"), frames, 3)
        with Ledger(tmp_path / "ledger.sqlite", create=True) as ledger:
            models = {"openai:m": open_model("openai:m", mode)}
            execute(plan, models, ledger, concurrency=1, attempts=attempts)
            return [reply for _, reply in ledger.replies("openai:m")], len(plan.keys()) - len(ledger.finished())


def nothing(**more: object) -> web.Response:
    """Return a reply without a choice, as a filter has it."""
    return web.json_response({**completion(""), "choices": [], **more})


def test_a_frame_that_a_filter_always_blocks_ends_as_a_refusal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After its attempts, from a server that answers other calls; the run is finished."""
    monkeypatch.setattr("eyechart.attempts.pause_s", lambda *_: 0.0)

    async def blocks(request: web.Request, asked: dict[str, object], attempt: int) -> web.Response:
        del request, attempt
        return nothing() if "image_url" in json.dumps(asked) else answer("SLOW")

    replies, left = run_on(tmp_path, blocks)
    assert left <= 3  # frames that came before any answer: nobody was there yet
    blocked = [reply for reply in replies if reply.finish_reason == "blocked" and reply.error is None]
    assert blocked
    assert all(why_unanswered(reply.finish_reason, reply.error) == "refused" for reply in blocked)


def test_a_server_that_never_answers_blocks_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its calls stay unfinished: no choices at all are a broken server's."""
    monkeypatch.setattr("eyechart.attempts.pause_s", lambda *_: 0.0)

    async def empty(request: web.Request, asked: object, attempt: int) -> web.Response:
        del request, asked, attempt
        return nothing()

    replies, left = run_on(tmp_path, empty, attempts=2)
    assert left == 6
    assert all(reply.error == "unreadable" for reply in replies)


AZURE = "https://r.openai.azure.com/openai/deployments/d?api-version=2024-10-21"


def test_an_address_may_carry_a_query(tmp_path: Path) -> None:
    """It goes behind the route, stands in the mode's file, and makes another request."""
    mode = RequestMode("openai:m", base_url=AZURE)
    assert (mode.base_url, mode.query) == (AZURE.partition("?")[0], {"api-version": "2024-10-21"})
    (tmp_path / "mode.toml").write_text(mode_text(mode), encoding="utf-8")
    assert read_mode(tmp_path / "mode.toml") == mode
    assert not mode.is_same_request(RequestMode("openai:m", base_url=mode.base_url))
    asked = []

    async def note(request: web.Request, body: object, attempt: int) -> web.Response:
        del body, attempt
        asked.append(str(request.rel_url))
        return answer("SLOW")

    assert replied(note, query={"api-version": "2024-10-21"}).text == "SLOW"
    assert asked == ["/v1/chat/completions?api-version=2024-10-21"]


@pytest.mark.parametrize(
    "query", ["api-key=abcdefgh", "code=abcdefgh", "key=x", "sig=abc", "subscription-key=12", "v=sk-0123456789abcdef01"]
)
def test_no_key_stands_in_a_query(query: str) -> None:
    """By its name or its looks; the value is never quoted."""
    with pytest.raises(SecretError) as refused:
        RequestMode("openai:m", base_url=f"http://127.0.0.1/v1?{query}")
    assert query.partition("=")[2] not in str(refused.value) or len(query.partition("=")[2]) < 3


def test_a_name_stands_once_in_a_query() -> None:
    """Nobody can say which of two values counts."""
    with pytest.raises(SpecError, match="occurs twice"):
        RequestMode("openai:m", base_url="http://127.0.0.1/v1?a=1&a=2")
