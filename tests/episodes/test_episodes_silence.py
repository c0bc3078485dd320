"""A model that says nothing: the fail-safe is executed and logged beside the reason, and an outage is no silence."""

import asyncio
from collections import Counter
from pathlib import Path

import pytest

from eyechart import attempts
from eyechart import episodes as study
from eyechart.calls import Reply
from eyechart.episodes import Bounds, Episode, EpisodeKey, EpisodesRun, read_episodes
from eyechart.errors import LedgerError, SpecError
from eyechart.ledger import Ledger
from eyechart.limits import Limits
from eyechart.manifest import LEDGER
from eyechart.modes import RequestMode
from faults import FAULTS, FaultServer, answer
from tiny_worlds import look

SPEC = "openai:planner"
FAILED = (3, 4, 5)
"""The decisions at which the planner fails; before and after them it answers."""

KINDS = {"hang": "timeout", "500 for ever": "server_error", "connection closed": "connection", "garbage": "unparsed"}
WORLDS = {fault: seed for seed, fault in enumerate((*KINDS, "none"))}


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for nothing between attempts."""
    monkeypatch.setattr(attempts, "pause_s", lambda *_: 0.0)


def rover(out: Path, base_url: str) -> EpisodesRun:
    """Plan one drive a fault, under the controller that knows the obstacles."""
    mode = RequestMode(SPEC, base_url=base_url, timeout_s=1.0, seed=True)
    seeds = tuple(WORLDS.values())
    return study.plan(study.Setup("rover-mpc", silence="fail-safe"), [mode], out, scenarios=["single"], seeds=seeds)


def server(plan: EpisodesRun) -> FaultServer:
    """Return a planner that drives STRAIGHT, and in each world fails in another way at the same decisions."""
    dealt = {}
    for key in plan.keys:
        for step in FAILED:
            dealt[key.call(plan.manifest.prompt.key, step).seed(0) % 2**31] = key.seed
    by_seed = {seed: fault for fault, seed in WORLDS.items()}
    how = {**FAULTS, "hang": hanging, "connection closed": closed, "garbage": garbled}

    async def handle(request, asked, attempt):  # noqa: ANN001, ANN202 - a Handler
        fault = by_seed.get(dealt.get(int(asked["seed"]), -1), "none")
        return answer("STRAIGHT") if fault == "none" else await how[fault](request, asked, attempt)

    return FaultServer([handle])


async def hanging(request, asked, attempt):  # noqa: ANN001, ANN201 - a Handler
    """Say nothing for as long as anybody listens."""
    del asked, attempt
    while request.transport is not None:  # noqa: ASYNC110 - aiohttp tells no other way
        await asyncio.sleep(0.02)
    return answer()


async def closed(request, asked, attempt):  # noqa: ANN001, ANN201 - a Handler
    """Close the connection before a reply begins."""
    del asked, attempt
    request.transport.close()
    return answer()


async def garbled(request, asked, attempt):  # noqa: ANN001, ANN201 - a Handler
    """Answer what is no intent."""
    del request, asked, attempt
    return answer("⟨lane⟩ 0.73 0.11 0.02")


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Episode], Counter[str]]:
    """Return the drives by fault, and how often the calls that failed were sent."""
    out = tmp_path_factory.mktemp("silence") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(attempts, "pause_s", lambda *_: 0.0)
        serving = server(rover(out, "http://127.0.0.1:1/v1"))
        with serving:
            plan = rover(out, serving.base_url)
            study.run(plan, bounds=Bounds(processes=1, concurrency=5, attempts=2))
    with Ledger(out / LEDGER) as ledger:
        sent = [attempt.key.frame for attempt in ledger.attempts(SPEC)]
    names = {seed: fault for fault, seed in WORLDS.items()}
    found = {names[episode.key.seed]: episode for episode in read_episodes(out)}
    failed = {EpisodeKey(SPEC, "rover-mpc", "single", seed).frame(FAILED[0]): name for seed, name in names.items()}
    return found, Counter(failed[frame] for frame in sent if frame in failed)


@pytest.mark.parametrize("fault", KINDS)
def test_a_planner_that_says_nothing_stops_the_rover_and_is_heard_again(
    driven: tuple[dict[str, Episode], Counter[str]], fault: str
) -> None:
    """STOP is executed beside a decision that is none, with the reason; never the last intent again."""
    steps = driven[0][fault].steps
    for number in FAILED:
        step = steps[number]
        assert (step.decision.action, step.executed_action) == (None, "STOP")
        assert (step.error or step.decision.missing) == KINDS[fault]
    assert steps[FAILED[0] - 1].speed_mps > 4
    assert steps[FAILED[-1]].speed_mps == pytest.approx(0.0, abs=0.01)
    after = steps[FAILED[-1] + 1 :]
    assert {step.decision.action for step in after} == {step.executed_action for step in after} == {"STRAIGHT"}
    assert after[3].speed_mps > 3


def test_the_other_drives_finish_and_nothing_in_them_is_stopped(
    driven: tuple[dict[str, Episode], Counter[str]],
) -> None:
    """A planner that hangs in one world is asked on in the others."""
    assert {one.ended for one in driven[0].values()} == {"goal"}
    assert {step.executed_action for step in driven[0]["none"].steps} == {"STRAIGHT"}
    assert {step.error for step in driven[0]["none"].steps} == {""}


def test_a_hang_is_silence_at_once_and_other_failures_when_the_attempts_are_used_up(
    driven: tuple[dict[str, Episode], Counter[str]],
) -> None:
    """To ask again after the moment has passed would be another moment's question."""
    assert driven[1] == {"hang": 1, "500 for ever": 2, "connection closed": 2, "garbage": 1, "none": 1}


SAID: Counter[bytes] = Counter()
DOWN: set[str] = set()


def fading(prompt: str, image: bytes) -> str | Reply:
    """Hang the first time that a picture without a block is shown, and answer it from then on."""
    SAID[image] += 1
    said = look(prompt, image)
    return Reply(error="timeout") if SAID[image] == 1 and said == "STRAIGHT" and len(SAID) > 1 else said


def falling(prompt: str, image: bytes) -> str | Reply:
    """Answer five times, and then no more while DOWN says why."""
    SAID[b""] += 1
    if DOWN and SAID[b""] > 5:
        return Reply(error=min(DOWN))  # type: ignore[arg-type]
    return look(prompt, image)


async def parting(prompt: str, image: bytes) -> str | Reply:
    """Answer twice, have the key refused while another call is under way, and let that one hang."""
    SAID[b""] += 1
    number = SAID[b""]
    while number == 3 and SAID[b""] < 4:  # noqa: ASYNC110 - the counter is all there is
        await asyncio.sleep(0.01)
    if number == 4:
        await asyncio.sleep(0.3)
    return look(prompt, image) if number < 3 else Reply(error="auth" if number == 3 else "timeout")


def absent(prompt: str, image: bytes) -> Reply:
    """Never answer."""
    del prompt, image
    return Reply(error="connection")


def tiny(out: Path, model: str, silence: str = "fail-safe", seeds: int = 1) -> EpisodesRun:
    """Plan drives in tiny worlds."""
    SAID.clear()
    worlds = study.Setup("tiny", silence=silence)
    return study.plan(worlds, [f"python:{__name__}:{model}"], out, scenarios=["whole"], seeds=range(seeds))


def test_a_cut_run_that_is_resumed_gives_the_same_records(tmp_path: Path) -> None:
    """A call that ended in silence is a finished fact: the model, which would answer now, is not asked it again."""
    model = f"python:{__name__}:fading"
    study.run(tiny(tmp_path / "whole", "fading"))
    (whole,) = read_episodes(tmp_path / "whole")
    silent = next(step.step for step in whole.steps if step.error)
    plan = tiny(tmp_path / "cut", "fading")
    for calls in (silent + 1, silent + 2, None):
        study.run(plan, bounds=Bounds(limits=Limits(calls=calls)))
    assert list(read_episodes(tmp_path / "cut")) == [whole]
    with Ledger(tmp_path / "cut" / LEDGER) as ledger:
        sent = [attempt.key for attempt in ledger.attempts(model)]
    assert len(sent) == len(set(sent)) == len(whole.steps)


def test_a_model_that_never_answers_is_no_silent_one(tmp_path: Path) -> None:
    """Not one STOP is recorded of a server that was never there; the model is set aside, and the drives are left."""
    plan = tiny(tmp_path / "run", "absent", seeds=12)
    outcome = study.run(plan, bounds=Bounds(concurrency=2, attempts=1))
    assert "10 calls in a row failed, the last one with connection" in " ".join(outcome.set_aside.values())
    assert list(read_episodes(tmp_path / "run")) == []
    assert len(plan.left()) == 12
    with Ledger(tmp_path / "run" / LEDGER) as ledger:
        assert ledger.finished() == set()


def test_a_model_that_is_set_aside_is_not_silent_in_what_was_under_way(tmp_path: Path) -> None:
    """Its key was refused while another of its calls hung: the drive waits for a key that is none."""
    plan = tiny(tmp_path / "run", "parting", seeds=2)
    outcome = study.run(plan, bounds=Bounds(concurrency=2, attempts=1))
    assert "auth" in " ".join(outcome.set_aside.values())
    with Ledger(tmp_path / "run" / LEDGER) as ledger:
        sent = list(ledger.attempts(f"python:{__name__}:parting"))
    assert [attempt.reply.error for attempt in sent if attempt.reply is not None and attempt.reply.error] == [
        "auth",
        "timeout",
    ]
    assert not any(attempt.final for attempt in sent if attempt.reply is not None and attempt.reply.error)


def test_an_outage_costs_so_many_stops_and_then_the_model_is_set_aside(tmp_path: Path) -> None:
    """Those that were executed stay on record when it is back; the other drives are made then."""
    DOWN.add("connection")
    plan = tiny(tmp_path / "run", "falling", seeds=12)
    outcome = study.run(plan, bounds=Bounds(concurrency=1, attempts=1))
    assert outcome.set_aside
    DOWN.clear()
    assert plan.left()
    study.run(plan)
    assert plan.left() == ()
    silent = [step for episode in read_episodes(tmp_path / "run") for step in episode.steps if step.error]
    assert len(silent) == Limits().patience


@pytest.mark.slow
@pytest.mark.parametrize(
    ("silence", "error", "left"),
    [
        ("fail-safe", "cut_short", 0),
        ("fail-safe", "rate_limited", 1),
        ("fail-safe", "quota", 1),
        ("unfinished", "timeout", 1),
    ],
)
def test_what_is_no_silence_leaves_the_drive_unfinished(tmp_path: Path, silence: str, error: str, left: int) -> None:
    """A server that says "too fast" or "pay" has spoken; and a run may choose to wait for its model."""
    DOWN.add(error)
    plan = tiny(tmp_path / "run", "falling", silence)
    study.run(plan, bounds=Bounds(concurrency=1, attempts=1))
    DOWN.clear()
    assert len(plan.left()) == left


def test_a_run_is_resumed_under_the_rule_that_it_was_begun_with(tmp_path: Path) -> None:
    """Half a run of waiting and half a run of stopping would be none of both."""
    study.run(tiny(tmp_path / "run", "fading", "unfinished"), bounds=Bounds(limits=Limits(calls=1)))
    with pytest.raises(LedgerError, match="this run has silence unfinished, now silence fail-safe was asked for"):
        tiny(tmp_path / "run", "fading", "fail-safe")
    with pytest.raises(SpecError, match="unknown silence 'stop'; known are unfinished and fail-safe"):
        tiny(tmp_path / "other", "fading", "stop")
