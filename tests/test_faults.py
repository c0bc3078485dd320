"""Whatever an endpoint does, every planned call ends in one recorded outcome, and the run ends by itself."""

import asyncio
import sqlite3
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

import banks
from eyechart.conditions import BATTERY
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger, SentAttempt
from eyechart.limits import Limits, RunOutcome
from eyechart.models import open_model
from eyechart.modes import RequestMode
from eyechart.prompts import PROMPTS
from eyechart.run import Plan, execute
from faults import FAULTS, HANGS_S, FaultServer, answer, refuse

SPEC = "openai:m"
PASSING = {  # the error of the first attempt; the second one answers
    "429": "rate_limited",
    "429 with Retry-After": "rate_limited",
    "500 once": "server_error",
    "body cut": "cut_short",
    "chunks cut": "cut_short",
    "connection reset": "connection",
    "upstream fails inside a 200": "server_error",
}
LASTING = {
    "500 for ever": "server_error",
    "hang": "timeout",
    "slow drip": "timeout",
    "50 MB reply": "unreadable",
    "no JSON": "unreadable",
    "JSON of another shape": "unreadable",
    "redirect": "gateway",
}
FINAL = {"400": "bad_request"}
READ = {
    "fine": None,
    "truncated": "truncated",
    "empty": "empty",
    "refusal": "refused",
    "filtered": "refused",
}


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank that no test changes."""
    return banks.build_bank(tmp_path_factory.mktemp("faults") / "bank", scenarios=["light", "dense"], episodes=1)


@pytest.fixture
def ledger(tmp_path: Path) -> Iterator[Ledger]:
    """Yield an empty ledger."""
    with Ledger(tmp_path / "ledger.sqlite", create=True) as empty:
        yield empty


def plan_of(bank: FrameBank, *specs: str, frames: int = 6) -> Plan:
    """Return the plan of eight calls a frame and model."""
    return Plan("battery", bank, PROMPTS["baseline"], specs or (SPEC,), BATTERY, bank.frames[:frames], seed=5)


def ask(server: FaultServer, plan: Plan, ledger: Ledger, timeout_s: float = 20.0, **how: object) -> RunOutcome:
    """Run a plan against a server."""
    models = {
        spec: open_model(spec, RequestMode(spec, base_url=server.base_url, seed=True, timeout_s=timeout_s))
        for spec in plan.models
    }
    return execute(plan, models, ledger, **how)  # type: ignore[arg-type]


def sent_by_fault(server: FaultServer, plan: Plan, ledger: Ledger) -> dict[str, list[list[SentAttempt]]]:
    """Return the attempts of every call, in order, by the fault that its call was dealt."""
    calls: dict[int, list[SentAttempt]] = {}
    for sent in ledger.attempts(SPEC):
        calls.setdefault(sent.key.seed(plan.seed) % 2**31, []).append(sent)
    by_fault: dict[str, list[list[SentAttempt]]] = {}
    for seed, attempts in calls.items():
        by_fault.setdefault(str(server.dealt[seed]), []).append(attempts)
    return by_fault


def test_every_fault_becomes_its_own_kind_and_every_call_one_outcome(bank: FrameBank, ledger: Ledger) -> None:
    """Attempts in the ledger are requests at the server, to the last one; nothing is made up, and the run ends."""
    plan = plan_of(bank, frames=3)
    with FaultServer(tuple(FAULTS)) as server:
        outcome = ask(server, plan, ledger, timeout_s=2.5, concurrency=16, attempts=2, limits=Limits(patience=1000))
        by_fault = sent_by_fault(server, plan, ledger)
    assert replace(outcome, failed={}) == RunOutcome({})
    assert set(outcome.failed) == set(plan.models)
    assert set(by_fault) == set(FAULTS)
    attempts = [one for calls in by_fault.values() for call in calls for one in call]
    assert len(attempts) == server.requests == len(server.asked)
    assert all(attempt.reply is not None for attempt in attempts)
    assert {attempt.key for attempt in attempts} == set(plan.keys())

    for fault, calls in by_fault.items():
        for call in calls:
            kinds = [one.reply.error for one in call if one.reply]
            last = call[-1].reply
            assert last is not None
            assert [one.number for one in call] == list(range(1, len(call) + 1))
            assert [one.reason for one in call] == [None, *kinds[:-1]]
            if fault in PASSING:
                assert kinds == [PASSING[fault], None]
                assert last.text == "SLOW"
            elif fault in LASTING:
                assert kinds == [LASTING[fault]] * 2
            elif fault in FINAL:
                assert kinds == [FINAL[fault]]
            else:
                assert kinds == [None]
                decision = bank.manifest.action_space.read(last)
                assert decision.missing == READ[fault]
            assert last.error is None or (last.text == "" and last.error_detail)
    unfinished = {call[0].key for fault in LASTING for call in by_fault[fault]}
    assert ledger.finished() == set(plan.keys()) - unfinished
    with closing(sqlite3.connect(ledger.path)) as sql:
        finals = sql.execute("SELECT count(*) FROM replies WHERE final = 1 GROUP BY call").fetchall()
    assert set(finals) == {(1,)}


def test_what_was_measured_stands_beside_every_attempt(bank: FrameBank, ledger: Ledger) -> None:
    """Status, times, tokens, what served, and what the server asked for; nothing where nothing came."""
    plan = plan_of(bank, frames=1)
    with FaultServer(("fine", "429 with Retry-After", "truncated", "hang")) as server:
        ask(server, plan, ledger, timeout_s=1.5, concurrency=16, attempts=2)
        by_fault = sent_by_fault(server, plan, ledger)
    reply = by_fault["fine"][0][0].reply
    assert reply is not None
    assert (reply.status, reply.prompt_tokens, reply.completion_tokens) == (200, 100, 2)
    assert (reply.served, reply.finish_reason) == ("fault-model-2026-01-01 fp_1", "stop")
    assert reply.first_byte_s is not None
    assert reply.seconds is not None
    assert 0 < reply.first_byte_s <= reply.seconds < 1.5
    limited = by_fault["429 with Retry-After"][0][0].reply
    assert limited is not None
    assert (limited.status, limited.retry_after_s) == (429, 1.0)
    assert limited.error_detail == "HTTP 429: slow down"
    hung = by_fault["hang"][0][0].reply
    assert hung is not None
    assert (hung.status, hung.first_byte_s, hung.prompt_tokens) == (None, None, None)
    assert hung.seconds is not None
    assert 1.4 < hung.seconds < HANGS_S / 2


def test_a_retry_after_is_waited_for(bank: FrameBank, ledger: Ledger) -> None:
    """By the call that met it, and by the others of its model."""
    plan = plan_of(bank)
    when: list[float] = []

    async def busy(request: object, asked: object, attempt: int) -> object:
        del request, asked, attempt
        when.append(time.monotonic())
        return refuse(429, "slow down", {"Retry-After": "2"}) if len(when) == 1 else answer()

    with FaultServer([busy]) as server:  # type: ignore[list-item]
        ask(server, plan, ledger, concurrency=1)
    assert ledger.finished() == set(plan.keys())
    assert when[1] - when[0] >= 2.0


def test_a_server_that_asks_for_a_long_rest_gets_it(bank: FrameBank, ledger: Ledger) -> None:
    """Its model is set aside, with the time it asked for, and is not asked again; the others go on."""
    plan = plan_of(bank, SPEC, "openai:other")

    async def resting(request: object, asked: dict[str, object], attempt: int) -> object:
        del request, attempt
        return refuse(429, "come back later", {"Retry-After": "3600"}) if asked["model"] == "m" else answer()

    with FaultServer([resting]) as server:  # type: ignore[list-item]
        outcome = ask(server, plan, ledger, concurrency=4)
        asked = [one["model"] for one in server.asked]
    assert list(outcome.set_aside) == [SPEC]
    assert outcome.set_aside[SPEC] == (
        "rate_limited: its server asks for a pause of 3600 s (Retry-After), and a run waits at most 120 s; "
        "the same command goes on later"
    )
    assert asked.count("m") <= 4
    assert all(
        attempt.number == 1 and attempt.reply and attempt.reply.retry_after_s == 3600
        for attempt in ledger.attempts(SPEC)
    )
    assert ledger.finished() == set(plan.keys_of("openai:other"))


@pytest.mark.parametrize(
    ("status", "error", "kind", "says"),
    [
        (401, {"message": "Incorrect API key provided"}, "auth", "auth: HTTP 401: Incorrect API key provided"),
        (403, {"message": "your country is not supported"}, "auth", "auth: HTTP 403"),
        (404, {"message": "The model `m` does not exist", "code": "model_not_found"}, "missing_model", "not exist"),
        (402, {"message": "Insufficient credits"}, "quota", "quota: HTTP 402: Insufficient credits"),
        (429, {"message": "You exceeded your current quota", "code": "insufficient_quota"}, "quota", "quota"),
        (
            400,
            {"message": "Billing hard limit has been reached", "code": "billing_hard_limit_reached"},
            "quota",
            "quota",
        ),
        (400, {"message": "API key not valid. Please pass a valid API key."}, "auth", "auth: HTTP 400"),
        (422, {"message": "Model m does not exist"}, "missing_model", "missing_model: HTTP 422"),
    ],
)
def test_a_model_that_cannot_answer_is_set_aside_at_once_and_the_others_go_on(
    bank: FrameBank, ledger: Ledger, status: int, error: dict[str, str], kind: str, says: str
) -> None:
    """Its calls stay unfinished: once somebody has mended what is wrong, the same plan makes them."""
    plan = plan_of(bank, SPEC, "openai:other")

    async def picky(request: object, asked: dict[str, object], attempt: int) -> object:
        del request, attempt
        return refuse(status, **error) if asked["model"] == "m" else answer()  # type: ignore[arg-type]

    with FaultServer([picky]) as server:  # type: ignore[list-item]
        outcome = ask(server, plan, ledger, concurrency=4)
        assert list(outcome.set_aside) == [SPEC]
        assert says in outcome.set_aside[SPEC]
        attempts = list(ledger.attempts(SPEC))
        assert 1 <= len(attempts) <= 5  # a 403 or a 404 may be about one call: the next one tells
        assert {attempt.reply.error for attempt in attempts if attempt.reply} == {kind}
        assert ledger.finished() == set(plan.keys_of("openai:other"))
    with FaultServer() as mended:
        assert ask(mended, plan, ledger) == RunOutcome({})
        assert mended.requests == 48
    assert ledger.finished() == set(plan.keys())


@pytest.mark.parametrize("fault", ["500 for ever", "no JSON"])
def test_a_model_that_keeps_failing_is_set_aside_with_its_reason(bank: FrameBank, ledger: Ledger, fault: str) -> None:
    """After so many calls in a row, not after the first; what is under way is let finish."""
    plan = plan_of(bank)
    with FaultServer((fault,)) as server:
        outcome = ask(server, plan, ledger, concurrency=2, attempts=1, limits=Limits(patience=5))
        assert server.requests == len(list(ledger.attempts(SPEC)))
        assert 5 <= server.requests <= 6
    assert outcome.set_aside[SPEC].startswith("5 calls in a row failed, the last one with ")


def test_a_server_that_is_not_there_sets_its_model_aside(bank: FrameBank, ledger: Ledger) -> None:
    """Nothing hangs; the reason names the connection."""
    server = FaultServer()
    with server:
        pass
    outcome = ask(server, plan_of(bank), ledger, concurrency=2, attempts=1, limits=Limits(patience=3))
    assert "connection" in outcome.set_aside[SPEC]


def test_fewer_calls_are_under_way_after_a_429_and_more_again_later(bank: FrameBank, ledger: Ledger) -> None:
    """A server that takes three at once gets its answers out, with fewer refusals than calls."""
    plan, now = plan_of(bank), Counter[str]()

    async def three_at_once(request: object, asked: object, attempt: int) -> object:
        del request, asked, attempt
        now["all"] += 1
        try:
            if now["all"] > 3:
                now["refused"] += 1
                return refuse(429, "at most three at once")
            await __import__("asyncio").sleep(0.01)
            return answer()
        finally:
            now["all"] -= 1

    with FaultServer([three_at_once]) as server:  # type: ignore[list-item]
        outcome = ask(server, plan, ledger, concurrency=16, attempts=8)
        assert outcome == RunOutcome({})
        assert ledger.finished() == set(plan.keys())
        assert server.requests == 48 + now["refused"]
        assert 0 < now["refused"] < 30


def test_a_run_stops_at_so_many_calls_and_goes_on_with_more(bank: FrameBank, ledger: Ledger) -> None:
    """Exactly so many requests, those of the run before included, and the words say so."""
    plan = plan_of(bank)
    with FaultServer() as server:
        outcome = ask(server, plan, ledger, concurrency=4, limits=Limits(calls=10))
        assert server.requests == 10
        assert outcome.stopped == "10 calls were sent, and --max-calls is 10"
        assert ask(server, plan, ledger, limits=Limits(calls=10)).stopped == outcome.stopped
        assert server.requests == 10
        assert ask(server, plan, ledger, limits=Limits(calls=30)).stopped is not None
        assert server.requests == 30
        assert ask(server, plan, ledger) == RunOutcome({})
    assert ledger.finished() == set(plan.keys())


def test_a_run_stops_before_its_cost_is_exceeded_by_more_than_one_round(bank: FrameBank, ledger: Ledger) -> None:
    """The endpoint reports a cent a call; calls under way are counted as the dearest so far."""
    plan = plan_of(bank)

    async def dear(request: object, asked: object, attempt: int) -> object:
        del request, asked, attempt
        return answer(usage={"cost": 0.01})

    with FaultServer([dear]) as server:  # type: ignore[list-item]
        outcome = ask(server, plan, ledger, concurrency=4, limits=Limits(cost_usd=0.095))
        assert 10 <= server.requests <= 13
        assert outcome.stopped is not None
        assert "--max-cost is 0.095" in outcome.stopped
        before = server.requests
        ask(server, plan, ledger, limits=Limits(cost_usd=0.095))
        assert server.requests == before


def test_a_run_begins_with_one_call_until_a_cost_is_known(bank: FrameBank, ledger: Ledger) -> None:
    """However many may be under way: one call is the most that a cost is exceeded by; the end says the sum."""
    plan = plan_of(bank)

    async def dear(request: object, asked: object, attempt: int) -> object:
        del request, asked, attempt
        await asyncio.sleep(0.05)
        return answer(usage={"cost": 1.0})

    with FaultServer([dear]) as server:  # type: ignore[list-item]
        outcome = ask(server, plan, ledger, concurrency=16, limits=Limits(cost_usd=2.5))
        assert server.requests == 3
    assert outcome.stopped == "$3.0000 were spent, and --max-cost is 2.5"


def test_a_cost_that_nobody_knows_stops_a_run_that_must_not_cost_more(bank: FrameBank, ledger: Ledger) -> None:
    """Rather than spend what cannot be counted."""
    with FaultServer() as server:
        outcome = ask(server, plan_of(bank), ledger, concurrency=1, limits=Limits(cost_usd=1.0))
        assert server.requests == 1
    assert outcome.stopped is not None
    assert "give its price with --prices" in outcome.stopped
