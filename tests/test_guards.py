from collections.abc import Callable
from dataclasses import replace

import pytest

from eyechart import integrity
from eyechart.calls import CallKey, Reply, read_in
from eyechart.costs import ALL, accounts_of
from eyechart.integrity import Guard, RequestChecks, guards_of
from eyechart.ledger import SentAttempt, columns_of
from eyechart.models.prices import read_prices
from eyechart.modes import ModeMeasurements, RequestMode
from eyechart.run import cells_of, lacking
from eyechart.spaces.discrete import DRIVING

KEY = CallKey("battery", "openai:m", "p", "f", "real")
MODE = RequestMode("openai:m")
CONDITIONS = ("real", "real_repeat", "text_only")
Say = Callable[[int, str], Reply]


def keys(frames: int = 10) -> list[CallKey]:
    """Return the calls about so many frames under three conditions."""
    return [KEY._replace(frame=f"f{at}", condition=name) for name in CONDITIONS for at in range(frames)]


def fine(at: int, condition: str) -> Reply:
    """Answer by frame, in half a second; a picture costs 500 tokens."""
    return Reply(
        ("STOP", "SLOW", "LEFT")[at % 3],
        "stop",
        prompt_tokens=100 if condition == "text_only" else 600,
        seconds=0.5,
    )


def sent_with(say: Say = fine, frames: int = 10) -> list[SentAttempt]:
    """Return one attempt at every call."""
    return [SentAttempt(key, 1, None, say(int(key.frame[1:]), key.condition)) for key in keys(frames)]


def guards(sent: list[SentAttempt], planned: list[CallKey], mode: RequestMode) -> tuple[Guard, ...]:
    """Return every guard of these attempts."""
    attempts = columns_of(sent, read_in(DRIVING))
    places = {frame: at for at, frame in enumerate(dict.fromkeys(key.frame for key in planned))}
    rows = attempts.of(KEY.model)
    ended = attempts.cells(rows[attempts.finishing(rows)], places, KEY.study, KEY.prompt)
    counts = len(planned), lacking(cells_of(planned, places), ended)
    said = accounts_of(attempts, KEY.model, read_prices().of(mode))[ALL].words
    return guards_of(attempts, KEY.model, mode, counts, "abcdef0123", said)


def guard(name: str, sent: list[SentAttempt], mode: RequestMode = MODE, planned: list[CallKey] | None = None) -> Guard:
    """Return one guard of these attempts."""
    found = {one.name: one for one in guards(sent, keys() if planned is None else planned, mode)}
    assert list(found) == ["picture", "outcomes", "geometry", "degeneracy", "cache"]
    return found[name]


def test_a_run_without_fault_keeps_every_guard() -> None:
    """Each says why."""
    for one in guards(sent_with(), keys(), MODE):
        assert one.holds is True, one
        assert one.because


@pytest.mark.parametrize(("sees", "holds"), [(True, True), (False, False)])
def test_a_probe_decides_whether_the_picture_arrives(sees: bool, holds: bool) -> None:  # noqa: FBT001 - parameters
    """Whatever the tokens say: a server may count a picture that its model never gets."""
    mode = replace(MODE, measured=ModeMeasurements(sees_image=sees))
    assert guard("picture", sent_with(), mode).holds is holds


def test_without_a_probe_the_prompt_s_tokens_say_whether_a_picture_was_sent_on() -> None:
    """No added token, or none counted, is no proof of either."""
    assert "adds 500 tokens" in guard("picture", sent_with()).because
    dropped = guard("picture", sent_with(lambda at, _: replace(fine(at, ""), prompt_tokens=100)))
    assert (dropped.holds, "adds no token" in dropped.because) == (None, True)
    uncounted = guard("picture", sent_with(lambda at, _: replace(fine(at, ""), prompt_tokens=None)))
    assert uncounted.holds is None


@pytest.mark.parametrize("adds", [-40, 3, 15])
def test_a_few_tokens_are_no_picture(adds: int) -> None:
    """A placeholder costs as many, and a number below zero is no picture at all."""

    def say(at: int, name: str) -> Reply:
        return replace(fine(at, name), prompt_tokens=100 + adds * (name != "text_only"))

    found = guard("picture", sent_with(say))
    assert found.holds is None
    assert f"a picture adds {adds} tokens" in found.because


def test_one_decision_in_ever_other_words_is_degenerate() -> None:
    """The reason that stands beside an action is not what is acted on."""

    def constant(at: int, name: str) -> Reply:
        return replace(fine(at, name), text=f'{{"action": "SLOW", "reason": "{name} {at}"}}')

    def found(say: Say) -> Guard:
        return {one.name: one for one in guards(sent_with(say), keys(), MODE)}["degeneracy"]

    assert (found(constant).holds, found(constant).because) == (False, "all 30 decisions are the same: SLOW")
    assert found(fine).holds is True


def test_every_planned_call_needs_exactly_one_outcome() -> None:
    """Open, failed for now, never made, and finished twice all fail; retries are counted in words."""
    whole = sent_with()
    retried = [SentAttempt(whole[0].key, 1, None, Reply(error="timeout")), whole[0]._replace(number=2), *whole[1:]]
    assert guard("outcomes", retried).holds is True
    assert "31 attempts, 1 of them repeated" in guard("outcomes", retried).because
    for wrong in (
        whole[1:],
        [whole[0]._replace(reply=None), *whole[1:]],
        [whole[0]._replace(reply=Reply(error="timeout")), *whole[1:]],
        [whole[0]._replace(reply=Reply(error="auth")), *whole[1:]],
    ):
        assert guard("outcomes", wrong).holds is False
        assert guard("outcomes", wrong).because.startswith("1 planned calls have no outcome, 0 have two")
    assert "0 planned calls have no outcome, 1 have two" in guard("outcomes", [whole[0], *whole]).because


def test_a_call_that_failed_for_good_has_an_outcome() -> None:
    """It is counted as failed."""
    sent = [one._replace(reply=Reply(error="wrong_json")) if at == 0 else one for at, one in enumerate(sent_with())]
    assert guard("outcomes", sent).holds is True
    assert "1 calls failed (1 attempts ended in an error: 1 wrong_json)" in guard("outcomes", sent).because


def test_one_reply_to_everything_is_degenerate() -> None:
    """A few replies are too few to say so."""
    same = sent_with(lambda at, name: replace(fine(at, name), text=" SLOW\n"))
    assert guard("degeneracy", same).holds is False
    assert "all 30 replies are the same: 'SLOW'" in guard("degeneracy", same).because
    assert guard("degeneracy", same[:5]).holds is None


@pytest.mark.parametrize(("signs", "quoted"), [(40, f"{'x' * 40!r}"), (41, f"{'x' * 40!r} …")])
def test_of_a_long_reply_its_beginning_is_quoted(signs: int, quoted: str) -> None:
    """With a sign that there is more, where there is."""
    same = sent_with(lambda at, name: replace(fine(at, name), text="x" * signs))
    assert guard("degeneracy", same).because.endswith(f"replies are the same: {quoted}")


def test_repeats_that_come_at_once_are_suspected_of_a_cache() -> None:
    """Equal to the byte, in under a tenth of the time of the first; slow ones, or different ones, are not."""

    def cached(seconds: float, text: str = "") -> Say:
        def say(at: int, name: str) -> Reply:
            if name != "real_repeat":
                return fine(at, name)
            return replace(fine(at, name), seconds=seconds, text=text or fine(at, name).text)

        return say

    assert guard("cache", sent_with(cached(0.01))).holds is False
    assert "came in under 10%" in guard("cache", sent_with(cached(0.01))).because
    assert guard("cache", sent_with(cached(0.2))).holds is True
    assert guard("cache", sent_with(cached(0.01, "RIGHT"))).holds is True
    assert guard("cache", sent_with(cached(0.01), frames=5)).holds is None
    scripted = guards(sent_with(cached(0.01)), keys(), RequestMode("scripted:depth"))
    assert scripted[-1].holds is True


def test_repeats_that_never_differ_at_a_temperature_alone_convict_nobody_of_a_cache() -> None:
    """A model may be sure of one word; at temperature 0 repeats must not differ, and at an unknown one may not."""
    for temperature, holds in ((0.7, None), (0.0, True), (None, True)):
        assert guard("cache", sent_with(), replace(MODE, temperature=temperature)).holds is holds
    thinks = sent_with(lambda at, name: replace(fine(at, name), reasoning=name))
    assert guard("cache", thinks, replace(MODE, temperature=0.7)).holds is True


def test_another_model_than_the_probe_saw_is_no_evidence_of_it() -> None:
    """However steady it is; and that the probe's pictures arrived says nothing of this one's."""

    def named(served: str, provider: str | None = None) -> Say:
        return lambda at, name: replace(fine(at, name), served=served, provider=provider, prompt_tokens=None)

    def found(say: Say, **facts: str) -> dict[str, Guard]:
        mode = replace(MODE, measured=ModeMeasurements(sees_image=True, facts=facts))
        return {one.name: one for one in guards(sent_with(say), keys(), mode)}

    same = found(named("m-2026 fp_2"), served="m-2026 fp_1", picture="14 of 14")
    assert same["served"].holds is True
    assert same["picture"].holds is True
    other = found(named("m-2027"), served="m-2026 fp_1", picture="14 of 14")
    assert other["served"].holds is False
    assert "the probe saw m-2026 fp_1, and m-2027 answered" in other["served"].because
    assert other["picture"].holds is None
    longer = found(named("m-2026-mini"), served="m-2026")
    assert longer["served"].holds is False
    elsewhere = found(named("m", "cheap"), served="m", provider="good")
    assert elsewhere["served"].holds is False
    assert "the probe saw good, and cheap answered" in elsewhere["served"].because
    assert found(named("m", "cheap"), served="m")["served"].holds is True


def test_an_end_that_is_not_known_is_said() -> None:
    """Whether the reply was cut off cannot be said; of ends that are known nothing is said."""
    sent = sent_with(lambda at, name: replace(fine(at, name), finish_reason="pause" if at < 2 else "eos"))
    found = {one.name: one for one in guards(sent, keys(), MODE)}
    assert found["truncation"].holds is None
    assert found["truncation"].because.startswith("6 of 30 answers end with 'pause', an unknown finish reason")


@pytest.mark.parametrize("lost", [1, 4, 10])
def test_pictures_that_were_dropped_in_the_run_fail_the_guard_whatever_the_probe_saw(lost: int) -> None:
    """The server counts pictures, as the probe found: a prompt with one that has the tokens of its words lost it."""
    mode = replace(MODE, measured=ModeMeasurements(sees_image=True, image_tokens=500))

    def say(at: int, condition: str) -> Reply:
        return replace(fine(at, condition), prompt_tokens=100) if at < lost else fine(at, condition)

    found = guard("picture", sent_with(say), mode)
    assert found.holds is False
    assert f"{lost} of 10 prompts with a picture have exactly the tokens of the words alone" in found.because


@pytest.mark.parametrize(("condition", "holds"), [("noise", False), ("lead_near", False), ("real_repeat", True)])
def test_pictures_of_one_condition_that_were_dropped_fail_the_guard(condition: str, holds: bool) -> None:  # noqa: FBT001
    """As those of noise, which are large; a repeat may be counted without its picture, where a cache holds that."""
    mode = replace(MODE, measured=ModeMeasurements(sees_image=True, image_tokens=500))
    more = [
        SentAttempt(KEY._replace(frame=f"f{at}", condition=condition), 1, None, fine(at, "text_only"))
        for at in range(10)
    ]
    sent = [one for one in sent_with() if one.key.condition != condition]
    found = guard("picture", [*sent, *more], mode)
    assert found.holds is holds
    if not holds:
        assert f"10 of 10 prompts with a picture, under {condition}, have exactly the tokens" in found.because


@pytest.mark.parametrize("counted", [None, 0, 3])
def test_a_server_that_counts_no_pictures_drops_none_by_its_tokens(counted: int | None) -> None:
    """Its tokens say nothing: the probe saw that pictures arrive."""
    mode = replace(MODE, measured=ModeMeasurements(sees_image=True, image_tokens=counted))
    same = sent_with(lambda at, _: replace(fine(at, ""), prompt_tokens=100))
    assert guard("picture", same, mode).holds is True


def test_a_server_that_counts_only_what_no_cache_held_drops_nothing_by_its_tokens() -> None:
    """A picture that was asked before, and words that were, both count one token."""
    mode = replace(MODE, measured=ModeMeasurements(sees_image=True, image_tokens=500))

    def say(at: int, condition: str) -> Reply:
        known = at % 2 == 0 or condition == "real_repeat"
        return replace(fine(at, condition), prompt_tokens=1) if known else fine(at, condition)

    assert guard("picture", sent_with(say), mode).holds is True


@pytest.mark.parametrize(
    ("unlike", "alone", "holds"), [(30, "5 of 5", False), (10, "5 of 5", True), (30, "1 of 5", True)]
)
def test_repeats_that_differ_in_the_run_and_not_alone_fail_a_guard(unlike: int, alone: str, holds: bool) -> None:  # noqa: FBT001
    """At temperature 0: pictures of calls under way may be mixed up, which is no finding about the model."""
    mode = replace(MODE, measured=ModeMeasurements(sees_image=True, facts={"repeats alone": alone}))

    def say(at: int, condition: str) -> Reply:
        moved = at + 1 if condition == "real_repeat" and at < unlike else at
        return fine(moved, condition)

    found = {one.name: one for one in guards(sent_with(say, 40), keys(40), mode)}
    assert found["load"].holds is holds
    assert ("--concurrency 1" in found["load"].because) is not holds
    warm = replace(mode, temperature=0.7)
    assert "load" not in {one.name for one in guards(sent_with(say, 40), keys(40), warm)}


@pytest.mark.parametrize("prompts", [1, 40])
def test_a_request_that_differs_for_one_model_is_found_whatever_the_calls(
    prompts: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where each frame has a prompt of its own, a place for every pair of them would take too much memory."""
    monkeypatch.setattr(integrity, "_DENSE", 0)
    sent = [
        SentAttempt(
            CallKey("battery", model, f"p{at % prompts}", f"f{at}", "real"), 1, None, Reply("STOP", "stop"), digest
        )
        for model in ("openai:a", "openai:b", "openai:c")
        for at in range(40)
        for digest in [f"{at:02x}{'f' if at == 7 and model == 'openai:b' else '0'}".ljust(64, "0")]
    ]
    checks = RequestChecks(columns_of(sent, read_in(DRIVING)), ["openai:a", "openai:b", "openai:c"])
    assert checks.guards("openai:c") == ()
    for model in ("openai:a", "openai:b"):
        (guard,) = checks.guards(model)
        assert (guard.name, guard.holds) == ("shown", False)
        assert "1 calls have two digests of their request, first of frame 'f7' under real" in guard.because
