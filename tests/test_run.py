import asyncio
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import banks
import stand_ins
from eyechart.attempts import _Writer
from eyechart.calls import CallKey, Query, Reply
from eyechart.conditions import BATTERY, show
from eyechart.errors import BankError, SpecError
from eyechart.frames import Frame, FrameBank
from eyechart.ledger import Attempt, Ledger
from eyechart.limits import Limits
from eyechart.prompts import PROMPTS
from eyechart.run import Plan, execute, is_in_shard, read_shard, spread
from stand_ins import StandIn


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank that no test changes."""
    return banks.build_bank(tmp_path_factory.mktemp("run") / "bank", scenarios=["light", "dense"], episodes=1)


@pytest.fixture
def plan(bank: FrameBank) -> Plan:
    """Return the plan of 48 calls: one model, six frames, eight conditions."""
    return Plan("battery", bank, PROMPTS["baseline"], ("m",), BATTERY, bank.frames, seed=5)


@pytest.fixture
def ledger(tmp_path: Path) -> Iterator[Ledger]:
    """Yield an empty ledger."""
    with Ledger(tmp_path / "ledger.sqlite", create=True) as empty:
        yield empty


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Let asyncio sleep for no time, and return the list of the times asked for."""
    slept: list[float] = []
    sleep = asyncio.sleep

    async def nap(seconds: float) -> None:
        slept.append(seconds)
        await sleep(0)

    monkeypatch.setattr(asyncio, "sleep", nap)
    return slept


def test_every_planned_call_is_made_once_with_its_own_picture(plan: Plan, ledger: Ledger) -> None:
    """The query holds the prompt, the condition's picture and the key's seed, and nothing else."""
    model = StandIn()
    execute(plan, {"m": model}, ledger)
    assert sorted(model.asked(plan)) == sorted(plan.keys())
    assert ledger.finished() == set(plan.keys())
    shown = {key: query.stimulus for key, query in zip(model.asked(plan), model.queries, strict=True)}
    for key, stimulus in shown.items():
        assert stimulus == show(key.condition, plan.bank.frame(key.frame), plan.bank, plan.seed)
    assert {(query.system, query.user) for query in model.queries} == {(plan.prompt.system, plan.prompt.user)}


def test_calls_go_out_in_a_seeded_random_order(plan: Plan, tmp_path: Path) -> None:
    """The same for the same seed, another for another; not the bank's, and not condition by condition."""

    def order(name: str, seed: int) -> list[CallKey]:
        model, seeded = StandIn(), replace(plan, seed=seed)
        with Ledger(tmp_path / name, create=True) as ledger:
            execute(seeded, {"m": model}, ledger)
        return model.asked(seeded)

    first = order("first", 1)
    assert order("again", 1) == first
    assert order("other", 2) != first
    assert first != plan.keys()
    assert len({key.condition for key in first[:12]}) > 4
    assert len({key.frame for key in first[:12]}) > 3


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (Reply(text=None), "its text is a NoneType"),  # type: ignore[arg-type]
        (Reply("GO", prompt_tokens=np.int64(7)), "its prompt_tokens is a int64"),  # type: ignore[arg-type]
        (Reply("GO", served=["m"]), "its served is a list"),  # type: ignore[arg-type]
        (Reply("GO", error="odd"), "its error is none of exception, timeout"),  # type: ignore[arg-type]
    ],
)
def test_a_reply_that_no_ledger_can_hold_is_a_failure_of_its_own_call(
    plan: Plan, ledger: Ledger, wrong: Reply, says: str
) -> None:
    """The replies that come beside it are kept, and the run goes on."""
    first: list[Query] = []

    def respond(query: Query) -> Reply:
        first.append(query)
        return wrong if len(first) == 1 else Reply("STOP", "stop")

    execute(plan, {"m": StandIn(respond)}, ledger)
    failed = [reply for _, reply in ledger.replies("m") if reply.error]
    assert [(reply.error, says in reply.error_detail) for reply in failed] == [("exception", True)]
    assert ledger.finished() == set(plan.keys())


@pytest.mark.parametrize("status", [400, 403, 404, 413, 422])
def test_one_refused_call_sets_no_model_aside_but_two_in_a_row_do(plan: Plan, ledger: Ledger, status: int) -> None:
    """A 403 or a 404 may be about one call alone, and so may a 400 that speaks of a key."""
    queries: list[Query] = []

    def respond(query: Query) -> Reply:
        queries.append(query)
        return Reply(error="auth", status=status) if len(queries) in {3, 7, 8} else Reply("STOP", "stop")

    outcome = execute(plan, {"m": StandIn(respond)}, ledger, concurrency=1)
    assert list(outcome.set_aside) == ["m"]
    assert len(queries) == 8


def test_a_finished_run_makes_no_further_calls(plan: Plan, ledger: Ledger) -> None:
    """Nothing is paid for twice."""
    execute(plan, {"m": StandIn()}, ledger)
    model, moves = StandIn(), []
    execute(plan, {"m": model}, ledger, progress=lambda done, total: moves.append((done, total)))
    assert model.queries == []
    assert moves == [(48, 48)]


def test_a_run_is_whole_where_every_planned_call_is_finished(plan: Plan, ledger: Ledger) -> None:
    """Then nobody need read its ledger for what is left; one that a limit stopped is not."""
    stopped = execute(plan, {"m": StandIn()}, ledger, limits=Limits(calls=5))
    assert stopped.stopped is not None
    assert not stopped.whole
    for _ in range(2):
        assert execute(plan, {"m": StandIn()}, ledger).whole
        assert ledger.finished() == set(plan.keys())


def test_resuming_repeats_exactly_the_unfinished_and_the_unknown(plan: Plan, ledger: Ledger) -> None:
    """Finished calls stand; calls that were sent with unknown outcome, or failed for now, are made again."""
    keys = plan.keys()
    done, open_, failed = keys[:10], keys[10:13], keys[13:15]
    for key in done:
        ledger.close(ledger.begin(key, "d"), Reply("SLOW", "stop"))
    for key in open_:
        ledger.begin(key, "d")
    for key in failed:
        ledger.close(ledger.begin(key, "d"), Reply(error="timeout"))
    assert ledger.unknown() == set(open_)
    model = StandIn()
    execute(plan, {"m": model}, ledger)
    assert sorted(model.asked(plan)) == sorted(keys[10:])
    assert ledger.finished() == set(keys)
    assert ledger.unknown() == set()
    sent = list(ledger.attempts("m"))
    assert (len(sent), sum(attempt.reply is None for attempt in sent)) == (48 + 5, 3)
    assert sorted(attempt.reason for attempt in sent if attempt.number > 1) == ["timeout"] * 2 + ["unknown"] * 3
    assert {reply.text for key, reply in ledger.replies("m") if key in done} == {"SLOW"}


def test_what_a_model_raises_becomes_a_reply(plan: Plan, ledger: Ledger) -> None:
    """An exception is a row with its kind and its words, and the run goes on."""

    def broken(query: Query) -> Reply:
        if query.image is None:
            raise RuntimeError("no picture" + "!" * 9999)
        return stand_ins.stop(query)

    execute(plan, {"m": StandIn(broken)}, ledger)
    assert ledger.finished() == set(plan.keys())
    failed = {key.condition: reply for key, reply in ledger.replies("m") if reply.error}
    assert set(failed) == {"text_only"}
    assert failed["text_only"].error == "exception"
    assert failed["text_only"].error_detail.startswith("RuntimeError: no picture!")
    assert len(failed["text_only"].error_detail) == 2000
    assert failed["text_only"].text == ""


class Careless(stand_ins.Held):
    """An adapter with a fault of its own."""

    version = "1"

    def __init__(self, fault: str) -> None:
        """Choose the fault."""
        self.fault = fault

    async def answer(self, query: Query) -> Reply:
        """Let its own cancellation escape, or answer with no Reply at all."""
        del query
        if self.fault == "cancels":
            raise asyncio.CancelledError
        return "STOP"  # type: ignore[return-value]


@pytest.mark.parametrize(("fault", "named"), [("cancels", "CancelledError"), ("answers a word", "TypeError: .* str")])
def test_a_careless_adapter_does_not_end_the_run_unheard(plan: Plan, ledger: Ledger, fault: str, named: str) -> None:
    """A cancellation that escapes an adapter would silently end the workers; a word is no Reply. Both are rows."""
    execute(plan, {"m": Careless(fault)}, ledger, limits=Limits(patience=99))
    details = [reply.error_detail for _, reply in ledger.replies("m")]
    assert len(details) == 48
    assert all(re.match(named, detail) for detail in details)


def test_transient_errors_are_tried_again_with_a_row_each(plan: Plan, ledger: Ledger, quick: list[float]) -> None:
    """Up to ``attempts``, with growing pauses; then the call stays unfinished, and the next run tries again."""
    tries: dict[int, int] = {}

    def flaky(query: Query) -> Reply:
        tries[query.seed] = tries.get(query.seed, 0) + 1
        if query.image is None:
            return Reply(error="rate_limited")
        return stand_ins.stop(query) if tries[query.seed] == 2 else Reply(error="timeout")

    moves: list[tuple[int, int]] = []
    model = StandIn(flaky)
    execute(plan, {"m": model}, ledger, attempts=3, progress=lambda done, total: moves.append((done, total)))
    unfinished = {key for key in plan.keys() if key.condition == "text_only"}  # noqa: SIM118 - no mapping
    assert ledger.finished() == set(plan.keys()) - unfinished
    assert moves[-1] == (42, 48)
    assert sorted(tries.values()) == [2] * 42 + [3] * 6
    assert len(list(ledger.attempts("m"))) == 42 * 2 + 6 * 3
    first, second = [pause for pause in quick if 0.5 <= pause <= 1.0], [pause for pause in quick if 1.0 < pause <= 2.0]
    assert (len(first), len(second)) == (48, 6)
    execute(plan, {"m": StandIn()}, ledger)
    assert ledger.finished() == set(plan.keys())


def test_an_error_that_will_not_pass_is_not_tried_again(plan: Plan, ledger: Ledger) -> None:
    """A wrong key stays wrong."""
    model = StandIn(lambda _: Reply(error="bad_request"))
    execute(plan, {"m": model}, ledger, limits=Limits(patience=99))
    assert len(model.queries) == 48
    assert len(list(ledger.attempts("m"))) == 48


def test_every_model_is_let_go_when_a_run_ends(plan: Plan, ledger: Ledger) -> None:
    """Also where one of them does not let itself be closed, and where the run broke off."""

    class Stuck(StandIn):
        async def close(self) -> None:
            await super().close()
            raise RuntimeError("stuck")

    two = {"m": Stuck(), "n": StandIn()}
    execute(replace(plan, models=("m", "n")), two, ledger)
    assert (two["m"].closed, two["n"].closed) == (1, 1)
    left = StandIn()
    with pytest.raises(KeyError):
        execute(replace(plan, models=("left", "absent")), {"left": left}, ledger)
    assert left.closed == 1


@pytest.mark.parametrize("concurrency", [1, 5])
def test_an_interrupt_leaves_a_ledger_that_resumes(plan: Plan, ledger: Ledger, concurrency: int) -> None:
    """What was under way stands as sent with unknown outcome; the same plan goes on, with the same answers."""

    class Interrupted(StandIn):
        async def answer(self, query: Query) -> Reply:
            if len(self.queries) == 19:
                os.kill(os.getpid(), signal.SIGINT)
                await asyncio.sleep(60)
            return await super().answer(query)

    model = Interrupted(stand_ins.noisy)
    with pytest.raises(KeyboardInterrupt):
        execute(plan, {"m": model}, ledger, concurrency=concurrency)
    assert 20 - concurrency <= len(ledger.finished()) < 20
    assert 1 <= len(ledger.unknown()) <= concurrency
    execute(plan, {"m": StandIn(stand_ins.noisy)}, ledger)
    assert ledger.finished() == set(plan.keys())
    with Ledger(ledger.path.with_name("whole"), create=True) as whole:
        execute(plan, {"m": StandIn(stand_ins.noisy)}, whole)
        undisturbed = {key: reply.text for key, reply in whole.replies("m")}
    assert {key: reply.text for key, reply in ledger.replies("m")} == undisturbed


def test_a_model_that_samples_may_disagree_with_itself(plan: Plan, ledger: Ledger) -> None:
    """Equal pictures under real and real_repeat are two calls with a seed each."""
    execute(plan, {"m": StandIn(stand_ins.noisy)}, ledger)
    said = {(key.frame, key.condition): reply.text for key, reply in ledger.replies("m")}
    frames = [frame.id for frame in plan.frames]
    assert any(said[frame, "real"] != said[frame, "real_repeat"] for frame in frames)


def test_models_are_asked_at_the_same_time_and_each_within_its_bound(plan: Plan, ledger: Ledger) -> None:
    """``concurrency`` counts calls under way a model; a slow model does not hold up another."""
    under_way = {"slow": 0, "fast": 0}
    most = {"slow": 0, "fast": 0}
    ended: list[str] = []

    class Counted(stand_ins.Held):
        version = "1"

        def __init__(self, name: str, pause_s: float) -> None:
            self.name, self.pause_s = name, pause_s

        async def answer(self, query: Query) -> Reply:
            del query
            under_way[self.name] += 1
            most[self.name] = max(most[self.name], under_way[self.name])
            await asyncio.sleep(self.pause_s)
            under_way[self.name] -= 1
            ended.append(self.name)
            return Reply("STOP", "stop")

    both = replace(plan, models=("slow", "fast"))
    execute(both, {"slow": Counted("slow", 0.04), "fast": Counted("fast", 0.0)}, ledger, concurrency=3)
    assert most == {"slow": 3, "fast": 3}
    assert ended.count("slow") == ended.count("fast") == 48
    assert ended[-9:] == ["slow"] * 9


def test_a_bank_that_breaks_in_the_middle_ends_the_run_with_its_error(tmp_path: Path) -> None:
    """One error, no group of them, and what was finished is kept."""
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light"], episodes=1)
    plan = Plan("battery", bank, PROMPTS["baseline"], ("m",), ("real",), bank.frames, seed=0)
    (bank.root / bank.frames[1].file).unlink()
    with Ledger(tmp_path / "ledger", create=True) as ledger:
        with pytest.raises(BankError, match="cannot be read"):
            execute(plan, {"m": StandIn()}, ledger, concurrency=1)
        assert len(ledger.finished()) < 3
        assert ledger.unknown() == set()


def test_a_planned_model_that_was_not_opened_is_an_error(plan: Plan, ledger: Ledger) -> None:
    """A run that leaves a model out does not call itself done."""
    with pytest.raises(KeyError, match="absent"):
        execute(replace(plan, models=("absent",)), {"m": StandIn()}, ledger)


def test_a_ledger_that_cannot_be_written_ends_the_run_with_its_error(
    plan: Plan, ledger: Ledger, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every worker hears of it, none waits for ever, and what was committed before stays."""

    def full(attempt: Attempt, reply: Reply, **how: bool) -> None:
        if attempt.id > 20:
            raise sqlite3.OperationalError("database or disk is full")
        Ledger.close(ledger, attempt, reply, **how)

    monkeypatch.setattr(ledger, "close", full)
    with pytest.raises(sqlite3.OperationalError, match="disk is full"):
        execute(plan, {"m": StandIn(pause_s=0.01)}, ledger, concurrency=4)
    assert 1 <= len(ledger.finished()) <= 20
    monkeypatch.undo()
    execute(plan, {"m": StandIn()}, ledger)
    assert ledger.finished() == set(plan.keys())


def frames_of(episodes: list[int]) -> list[Frame]:
    """Return one frame for each number, of the episode of this number."""
    return [banks.one(f"f{at}", ("s", f"e{episode}", at), "none", f"{at}.png") for at, episode in enumerate(episodes)]


@given(st.lists(st.integers(0, 4), min_size=1, max_size=30), st.integers(1, 40))
def test_a_limit_takes_frames_from_every_episode_in_turn(episodes: list[int], limit: int) -> None:
    """In the bank's order, as many of each as it has of the others, and the more the limit the same ones and more."""
    frames = frames_of(episodes)
    taken = spread(frames, limit)
    assert len(taken) == min(limit, len(frames))
    assert list(taken) == [frame for frame in frames if frame in taken]
    have = {frame.episode: [other for other in frames if other.episode == frame.episode] for frame in frames}
    got = {name: [frame for frame in taken if frame.episode == name] for name in have}
    assert all(got[name] == have[name][: len(got[name])] for name in have)
    most = max(map(len, got.values()))
    assert all(len(got[name]) >= min(most - 1, len(have[name])) for name in have)
    assert {frame.id for frame in taken} <= {frame.id for frame in spread(frames, limit + 1)}


def test_without_a_limit_all_frames_are_taken() -> None:
    """And a limit of nothing is refused."""
    frames = frames_of([0, 1, 0])
    assert spread(frames, None) == tuple(frames)
    for limit in (0, -3):
        with pytest.raises(SpecError, match=f"--limit needs at least 1 frame, got {limit}"):
            spread(frames, limit)


@given(st.integers(1, 9), st.text(max_size=9), st.text(max_size=9), st.sampled_from(BATTERY))
def test_every_call_is_in_exactly_one_shard(count: int, model: str, frame: str, condition: str) -> None:
    """Whatever its key, and however many shards."""
    key = CallKey("battery", model, "p", frame, condition)
    assert sum(is_in_shard(key, index, count) for index in range(1, count + 1)) == 1


def test_the_shards_of_a_plan_are_its_calls(plan: Plan) -> None:
    """No call is lost, none doubled, and no shard of a few is empty."""
    shards = [replace(plan, shard=(index, 3)).keys() for index in (1, 2, 3)]
    assert sorted(key for shard in shards for key in shard) == sorted(plan.keys())
    assert all(len(shard) > 4 for shard in shards)


@pytest.mark.parametrize("text", ["1/1", "2/4", "04/4"])
def test_a_shard_is_read(text: str) -> None:
    """I of n, counted from 1."""
    index, count = read_shard(text)
    assert f"{index}/{count}" == text.lstrip("0")


@pytest.mark.parametrize("text", ["", "0/2", "3/2", "1", "1/", "/2", "-1/2", "1/2/3", "a/b", "1.0/2", " 1/2", "²/4"])
def test_what_is_no_shard_is_refused(text: str) -> None:
    """With an example of one."""
    with pytest.raises(SpecError, match="2/4"):
        read_shard(text)


def test_ctrl_c_stops_a_process_at_once_and_keeps_what_is_finished(tmp_path: Path) -> None:
    """A real SIGINT to a real process with slow calls under way."""
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light", "dense"])
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
    words = [sys.executable, "-m", "stand_ins", str(bank.root), str(tmp_path / "run"), "0.3"]
    with subprocess.Popen(words, env=env, stderr=subprocess.PIPE, text=True) as running:
        path = tmp_path / "run" / "ledger.sqlite"
        deadline = time.monotonic() + 30
        while time.monotonic() < deadline and running.poll() is None:
            if stand_ins.rows_in(path, "replies") >= 3:
                break
            time.sleep(0.01)
        running.send_signal(signal.SIGINT)
        running.wait(60)
        assert running.stderr is not None
        assert "KeyboardInterrupt" in running.stderr.read()
    with Ledger(path) as ledger:
        assert len(ledger.finished()) >= 3
        assert 1 <= len(ledger.unknown()) <= 2 * 4


def test_rows_of_a_few_turns_share_a_commit_and_are_on_disk_when_they_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three turns of the event loop are one commit, a later row is another; another reader sees each at once."""
    path, commits = tmp_path / "ledger.sqlite", list[int]()

    async def begun(writer: _Writer, turns: int) -> None:
        for _ in range(turns):
            await asyncio.sleep(0)
        key = CallKey("battery", "openai:m", "p", f"f{turns}", "real")
        await writer.begin(key, "0" * 64)
        with closing(sqlite3.connect(path)) as other:
            found = other.execute(
                "SELECT count(*) FROM calls JOIN attempts ON call = calls.id WHERE frame = ?", key[3:4]
            )
            assert found.fetchone() == (1,)

    async def all_begun(writer: _Writer) -> None:
        async with asyncio.TaskGroup() as group:
            for turns in (0, 1, 2, 9):
                group.create_task(begun(writer, turns))

    with Ledger(path, create=True) as ledger:
        together = ledger.together

        def counted() -> AbstractContextManager[None]:
            commits.append(1)
            return together()

        monkeypatch.setattr(ledger, "together", counted)
        asyncio.run(all_begun(_Writer(ledger, again=False)))
    assert len(commits) == 2
