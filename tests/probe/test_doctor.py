"""The doctor tells endpoints apart whose fault is known, with the evidence and the cause in words."""

import base64
import io
import random
from collections.abc import Callable
from functools import cache

import pytest
from aiohttp import web
from PIL import Image

from eyechart.calls import Reply
from eyechart.errors import SpecError
from eyechart.models.prices import Price, Prices
from eyechart.modes import RequestMode
from eyechart.probe import Diagnosis, doctor
from eyechart.probe.causes import likely_causes
from eyechart.probe.doctor import MOST_CALLS
from eyechart.probe.picture_proof import AnsweredQuestion, SightAnswers, said
from eyechart.probe.pictures import CHOICES, NONE, questions
from faults import FaultServer, answer, completion, refuse
from seeing import Endpoint, read, served

PRICED = Prices((Price("openai:m", 1000.0, 1000.0, "2026-01-01", "a test"),))


def examined(seed: int = 0, **what: object) -> Diagnosis:
    """Return what the doctor finds of an endpoint; it makes no more calls than it says, and tells them all."""
    with served(**what) as server:
        result = doctor(RequestMode("openai:m", base_url=server.base_url), seed=seed)
        assert result.spent.calls == server.requests <= MOST_CALLS
        return result


def test_one_that_looks_is_told_to_see() -> None:
    """All right, against what guessing gives; it repeats itself, a schema binds, and no cause is made up."""
    diagnosis = examined()
    assert (diagnosis.outcome, diagnosis.exit_code, diagnosis.causes) == ("sees", 0, ())
    assert diagnosis.sight.because == "14 of 14 right, where guessing gives 2.4 (p <10⁻⁴)"
    assert (diagnosis.sight.same, diagnosis.sight.image_tokens) == ((3, 3), 85)
    assert (diagnosis.schema_binds, diagnosis.budget_enough) == (True, True)


def test_one_that_drops_pictures_is_told_to_be_blind() -> None:
    """prompt_tokens do not change, and its own words say so."""
    diagnosis = examined(sees=False, counts_pictures=False)
    assert (diagnosis.outcome, diagnosis.exit_code) == ("blind", 1)
    assert "the picture is dropped on the way" in diagnosis.causes[0]
    assert "prompt_tokens do not change with a picture" in diagnosis.causes[0]
    assert "14 of 14 replies say themselves that there is no picture" in diagnosis.causes[1]


def test_one_that_counts_the_picture_and_does_not_use_it_is_told_from_a_proxy() -> None:
    """Another cause, for the same outcome."""
    diagnosis = examined(sees=False)
    assert (diagnosis.outcome, diagnosis.exit_code) == ("blind", 1)
    assert "the server counts the picture (85 tokens), and the replies do not follow it" in diagnosis.causes[0]


@pytest.mark.parametrize("seed", range(4))
def test_a_cache_by_words_is_told_from_a_blind_model_and_from_one_that_sees(seed: int) -> None:
    """Different pictures got one reply where the words were the same, and the right ones where they were new."""
    diagnosis = examined(seed, cache="words")
    assert (diagnosis.outcome, diagnosis.exit_code) == ("blind", 1)
    assert diagnosis.causes[0].startswith("a cache between here and the model finds replies by their words")
    assert diagnosis.scores()["words never sent before"].value == 1.0
    assert "identical reply whenever the words were the same" in diagnosis.sight.because


def test_one_that_sees_and_is_noisy_is_told_to_see() -> None:
    """Half of its answers are drawn."""
    diagnosis = examined(noise=0.5)
    assert (diagnosis.outcome, diagnosis.exit_code) == ("sees", 0)
    assert diagnosis.sight.score().value < 0.8


def test_a_text_only_backend_is_told_by_its_refusals() -> None:
    """It answers words and refuses pictures; three calls suffice."""
    diagnosis = examined(takes_pictures=False)
    assert (diagnosis.outcome, diagnosis.exit_code, diagnosis.spent.calls) == ("blind", 1, 3)
    assert diagnosis.causes[0].startswith(
        "text-only backend: it answers text, and refuses pictures (HTTP 400: this model"
    )


def test_a_schema_that_is_ignored_is_told() -> None:
    """The plain word comes that the schema forbids."""
    diagnosis = examined(binds_schema=False)
    assert (diagnosis.outcome, diagnosis.schema_binds) == ("sees", False)
    assert diagnosis.schema_says == "asked for YES, got 'YES'"


def test_a_model_that_refuses_fields_is_asked_without_them() -> None:
    """And what was changed is said."""
    diagnosis = examined(only_new_tokens=True, only_default_temperature=True)
    assert (diagnosis.outcome, diagnosis.mode.token_field, diagnosis.mode.temperature) == (
        "sees",
        "max_completion_tokens",
        None,
    )
    assert diagnosis.notes == (
        "max_tokens is refused: --token-field max_completion_tokens is used",
        "temperature 0 is refused: --temperature default is used",
    )


def test_a_budget_that_is_too_small_is_no_blindness() -> None:
    """Nobody can say, and the cause is the budget."""
    diagnosis = examined(thinks=3000)
    assert (diagnosis.outcome, diagnosis.exit_code, diagnosis.budget_enough) == ("cannot_say", 2, False)
    assert "14 of 14 replies were cut off at the budget of 1024 tokens" in diagnosis.causes[0]


def test_a_model_of_one_answer_is_not_called_blind() -> None:
    """It answers no question, so that its errors prove nothing; what is known of the picture is told."""
    diagnosis = examined(dumb='{"action": "STOP"}')
    assert (diagnosis.outcome, diagnosis.exit_code) == ("cannot_say", 2)
    assert "14 of 14 replies name none of the choices" in diagnosis.causes[0]
    assert "The server counts the picture (85 tokens)" in diagnosis.causes[0]


@pytest.mark.parametrize(
    ("status", "message", "cause"),
    [
        (401, "no such key", "the key is missing, wrong, or may not use this model"),
        (404, "no model m", "there is no model of this name"),
        (402, "pay first", "nothing is left to spend"),
        (400, "unknown field 'tools'", "the server refuses the request"),
    ],
)
def test_an_error_is_told_with_its_kind_and_its_words(status: int, message: str, cause: str) -> None:
    """Soon, and as "cannot say"."""

    async def fail(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        del request, asked, attempt
        return refuse(status, message)

    with FaultServer([fail]) as server:
        found = doctor(RequestMode("openai:m", base_url=server.base_url))
        assert server.requests <= 4
    assert found.exit_code == 2
    assert cause in found.causes[0]
    assert message in found.causes[0]


def test_what_is_no_chat_completion_and_no_server_is_told() -> None:
    """A web page, and nobody at all."""
    with FaultServer(["no JSON"]) as server:
        web_page = doctor(RequestMode("openai:m", base_url=server.base_url))
    nobody = doctor(RequestMode("openai:m", base_url=server.base_url))
    assert "is --base-url right" in web_page.causes[0]
    assert "no server answers at this address" in nobody.causes[0]
    assert (web_page.exit_code, nobody.exit_code) == (2, 2)
    with pytest.raises(SpecError, match="unknown model"):
        doctor(RequestMode("nonsense:m"))


def test_a_bound_on_cost_ends_it_before_it_is_passed_and_an_unknown_cost_at_once() -> None:
    """What was found until then is told; nothing unknown is taken for nothing."""
    with served() as server:
        mode = RequestMode("openai:m", base_url=server.base_url)
        found = doctor(mode, prices=PRICED, max_cost=0.5)
        assert 1 < server.requests == found.spent.calls < 14
        assert found.spent.cost_usd == pytest.approx(0.5, abs=0.15)
        assert "--max-cost is 0.5" in str(found.sight.cut)
        unknown = doctor(mode, max_cost=0.5)
        assert unknown.spent.calls == 1
        assert "the cost of openai:m is not known" in str(unknown.sight.cut)


Say = Callable[[str, random.Random], str]


deal = cache(questions)
"""What is asked by a seed; its pictures are drawn once, and not while tests are collected."""


def replied(say: Say, number: int) -> SightAnswers:
    """Return a sight of replies that were made up, to one of ten deals."""
    dice = random.Random(number)  # noqa: S311
    sightanswers = SightAnswers()
    for question in deal(number % 10):
        reply = Reply(say(question.kind, dice), "stop", seconds=0.1)
        sightanswers.shots.append(AnsweredQuestion(question, reply, said(question.kind, reply)))
    return sightanswers


GUESSERS: dict[str, Say] = {
    "at random": lambda kind, dice: dice.choice(CHOICES[kind]),
    "always the first": lambda kind, _: CHOICES[kind][0],
    "none, in a sentence": lambda kind, _: f"I'm sorry, I cannot see any image of a {kind}.",
}


def looking(again_s: float, again: str = "", later_s: float = 0.5, say: str = "") -> SightAnswers:
    """Return a sight of right answers, or of one word, in half a second each; repeats took ``again_s``.

    Same words, asked again, took ``later_s``.
    """
    result, asked = SightAnswers(), set[str]()
    for question in deal(0):
        seconds = later_s if question.words in asked else 0.5
        asked.add(question.words)
        reply = Reply(say or question.answer, "stop", seconds=seconds)
        result.shots.append(AnsweredQuestion(question, reply, said(question.kind, reply)))
    first = result.shots[0].reply.text
    result.again = [Reply(again or first, "stop", seconds=again_s)] * 2
    return result


def causes(sight: SightAnswers) -> str:
    """Return the likely causes as one text."""
    return "; ".join(likely_causes(sight, RequestMode("openai:m"), {}))


def test_a_cache_by_content_is_suspected_and_does_not_make_blind() -> None:
    """It answers exact repeats at once: pictures are looked at, but real_repeat would not measure anything."""
    assert looking(0.01).outcome == "sees"
    assert "real_repeat would not measure" in causes(looking(0.01))
    assert causes(looking(0.4)) == ""
    assert causes(looking(0.01, again="WHITE or so")) == ""


def test_one_reply_at_once_to_other_pictures_in_the_same_words_is_suspected_of_a_cache() -> None:
    """Where the model behind it is too weak for the new words to prove it; slow ones are not."""
    assert "a cache is suspected: different pictures" in causes(looking(0.4, later_s=0.01, say="NONE"))
    assert "cache" not in causes(looking(0.4, later_s=0.4, say="NONE"))


@pytest.mark.parametrize("guesser", GUESSERS)
def test_a_guesser_is_never_told_to_see_and_mostly_to_be_blind(guesser: str) -> None:
    """Over 100 guesses; the chance of "sees" is .01 at most."""
    outcomes = [replied(GUESSERS[guesser], number).outcome for number in range(100)]
    assert outcomes.count("sees") <= 4
    assert outcomes.count("blind") >= 65


@pytest.mark.parametrize(
    ("kind", "text", "means"),
    [
        ("colour", "Red.", "RED"),
        ("colour", '{"color": "PURPLE"}', "PURPLE"),
        ("colour", "<think>RED?</think>BLUE", "BLUE"),
        ("colour", "The shape is RED or BLUE", None),
        ("count", "3", "THREE"),
        ("count", "There are 4 squares.", "FOUR"),
        ("count", "13", None),
        ("side", "top", "TOP"),
        ("side", "CENTER", None),
        ("side", "NONE", NONE),
        ("side", "I don't see a picture in your message.", NONE),
        ("colour", "No image was provided.", NONE),
        ("colour", '{"action": "STOP"}', None),
    ],
)
def test_replies_are_read_strictly(kind: str, text: str, means: str | None) -> None:
    """A choice, that there is no picture, or nothing."""
    assert said(kind, Reply(text, "stop")) == means


def test_an_answer_without_a_choice_is_answered_by_nobody() -> None:
    """A server of one word proves nothing."""
    with FaultServer([_hello]) as server:
        found = doctor(RequestMode("openai:m", base_url=server.base_url))
    assert found.exit_code == 2


async def _hello(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
    del request, asked, attempt
    return answer("Hello!")


VLLM_LONG = "The decoder prompt (length 16601) is longer than the maximum model length of 10000."


def doctored(handle: Callable[[bool, int], web.Response | None]) -> Diagnosis:
    """Return what the doctor finds of a server that answers rightly but where ``handle`` has a response.

    It is told whether a picture was sent, and the number of the call.
    """
    endpoint = Endpoint()

    async def answers(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        numbers.append(0)
        found = handle(read(asked)[1] is not None, len(numbers))
        return await endpoint(request, asked, attempt) if found is None else found

    numbers: list[int] = []
    with FaultServer([answers]) as server:
        return doctor(RequestMode("openai:m", base_url=server.base_url))


@pytest.mark.parametrize(
    ("status", "detail", "cause"),
    [
        (400, VLLM_LONG, "a picture takes more context than the server gives"),
        (400, "This model's maximum context length is 4096 tokens.", "a picture takes more context than the server"),
        (
            400,
            "Invalid image_url: only http:// and https:// URLs are allowed, data URLs are not supported",
            "refuses data URLs",
        ),
        (500, 'Failed to parse messages: Unsupported content part type: "image_url"', "text-only backend"),
        (500, "image input is not supported - hint: you may need to provide the mmproj", "text-only backend"),
    ],
)
def test_why_pictures_are_refused_is_told_apart(status: int, detail: str, cause: str) -> None:
    """Too long, only by http, or text-only, however it is spelled."""
    diagnosis = doctored(lambda picture, _: refuse(status, detail) if picture else None)
    assert (diagnosis.outcome, diagnosis.exit_code) == ("blind", 1)
    assert cause in diagnosis.causes[0]


TOOL = {"role": "assistant", "content": None, "tool_calls": [{"id": "x", "type": "function", "function": {}}]}
DECLINED = {"role": "assistant", "content": None, "refusal": "I'm sorry, I can't assist with that request."}


@pytest.mark.parametrize(
    ("message", "finish", "cause"),
    [
        (
            TOOL,
            "tool_calls",
            "14 of 14 replies call a tool, although none is offered, and hold the answer in tool_calls",
        ),
        (DECLINED, "stop", "14 of 14 replies refuse to answer"),
        ({"role": "assistant", "content": ""}, "content_filter", "14 of 14 pictures or replies were filtered"),
    ],
)
def test_what_came_in_place_of_an_answer_is_named_first(message: dict[str, object], finish: str, cause: str) -> None:
    """And neither called empty nor a weak model."""

    def say(*_: object) -> web.Response:
        said = completion("", finish)
        said["choices"][0]["message"] = message  # type: ignore[index]
        return web.json_response(said)

    diagnosis = doctored(say)
    assert diagnosis.outcome == "cannot_say"
    assert cause in diagnosis.causes[0]
    assert not any("too weak" in one or "are empty" in one for one in diagnosis.causes)


def test_pictures_that_a_filter_takes_are_counted_whatever_else_is_seen() -> None:
    """A part of them, by status 400 or by the end of a reply."""
    words = "The response was filtered due to the prompt triggering Azure OpenAI's content management policy."
    status = doctored(
        lambda picture, at: refuse(400, words, code="content_filter") if picture and at % 4 == 0 else None
    )
    ends = doctored(lambda picture, at: answer("", "content_filter") if picture and at % 4 == 0 else None)
    for found in (status, ends):
        assert any("of 14 pictures or replies were filtered" in cause for cause in found.causes)


@pytest.mark.parametrize(("by", "smallest"), [(1, 6), (8, 12), (24, 64), (200, None)])
def test_acuity_is_the_smallest_gap_that_arrives(by: int, smallest: int | None) -> None:
    """A server that makes pictures smaller loses it; drawn shapes of a quarter of the picture do not tell."""
    endpoint = Endpoint()

    async def shrinks(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
        picture = read(asked)[1]
        if picture is not None and "ring" in read(asked)[0]:
            whole = Image.open(io.BytesIO(picture))
            small = whole.resize((whole.width // by, whole.height // by), Image.Resampling.BOX)
            written = io.BytesIO()
            small.resize(whole.size, Image.Resampling.NEAREST).save(written, "PNG")
            url = f"data:image/png;base64,{base64.b64encode(written.getvalue()).decode()}"
            asked["messages"][-1]["content"][0]["image_url"]["url"] = url  # type: ignore[index]
        return await endpoint(request, asked, attempt)

    with FaultServer([shrinks]) as server:
        found = doctor(RequestMode("openai:m", base_url=server.base_url))
        assert server.requests <= MOST_CALLS
    assert found.outcome == "sees"
    assert found.acuity.smallest == smallest
    assert all(of == 2 for _, _, of in found.acuity.by_gap)
    assert "2 of 2 at 64" in found.acuity.words or smallest is None
