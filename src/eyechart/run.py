"""A run turns a plan into calls and calls into rows of the ledger; it spends money, and only appends."""

import asyncio
import contextlib
import random
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from eyechart import conditions as stimuli
from eyechart.calls import TRANSIENT, UNFINISHED, CallKey, Query, Reply, misfit
from eyechart.errors import SpecError
from eyechart.frames import Frame, FrameBank
from eyechart.ledger import Attempt, Ledger
from eyechart.limits import Budget, Limits, Outcome, Pace, pause_s
from eyechart.models import Model
from eyechart.modes import without_secrets
from eyechart.perception.view import View
from eyechart.prompts import Prompt
from eyechart.seeds import key_seed
from eyechart.stimuli import Stimuli

Progress = Callable[[int, int], None]
"""Called with (calls finished, calls planned) whenever a call ends."""

_CLOSING_S = 10.0
_NOT_SENT = Reply(error="exception")


class Watch(Protocol):
    """Decides, as calls finish, which of those that remain are made at all, and in which order."""

    def queue(self, model: str, todo: Sequence[CallKey]) -> Iterator[CallKey]:
        """Yield the calls of a model to make, out of ``todo``; asked for the next one only when a worker is free."""
        ...

    def finished(self, key: CallKey, reply: Reply) -> None:
        """Take note of a finished call."""
        ...


@dataclass(frozen=True)
class Plan:
    """Every call of a run: models × frames × conditions, those of one shard if it is sharded."""

    study: str
    bank: FrameBank
    prompt: Prompt
    models: tuple[str, ...]
    conditions: tuple[str, ...]
    frames: tuple[Frame, ...]
    seed: int
    shard: tuple[int, int] | None = None
    view: View | None = None

    def keys(self) -> list[CallKey]:
        """Return the planned calls, in the bank's order."""
        return [key for model in self.models for key in self.keys_of(model)]

    def words(self, key: CallKey) -> tuple[str, str]:
        """Return the system and the user message of a call; those of a built-in prompt are the same for every frame."""
        frame = self.bank.frame(key.frame)
        told = stimuli.speaker(key.condition, frame, self.bank, self.seed, self.prompt.fields)
        return self.prompt.render(told.fields, self.bank.manifest.action_space)

    def query(self, key: CallKey, picture: bytes | None) -> Query:
        """Return what a model is asked in a call, of this picture."""
        seed, form = key.seed(self.seed), self.prompt.form
        actions = self.bank.manifest.action_space.actions if form is None else ()
        return Query(*self.words(key), picture, seed, actions, form)

    def keys_of(self, model: str) -> Iterator[CallKey]:
        """Yield the planned calls of one model, in the bank's order."""
        prompt = self.prompt.key
        for frame in self.frames:
            for condition in self.conditions:
                if stimuli.available(condition, frame):
                    key = CallKey(self.study, model, prompt, frame.id, condition)
                    if self.shard is None or in_shard(key, *self.shard):
                        yield key


def in_shard(key: CallKey, index: int, count: int) -> bool:
    """Return whether a call belongs to shard ``index`` of ``count``, counted from 1; every call is in one."""
    parts = (key.study, key.model, key.prompt, key.frame, key.condition, key.repeat)
    return key_seed("shard", *parts) % count == index - 1


def read_shard(text: str) -> tuple[int, int]:
    """Read ``i/n``; raises SpecError unless 1 <= i <= n."""
    index, slash, count = text.partition("/")
    if slash and index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count):
        return int(index), int(count)
    raise SpecError(f"a shard is given as i/n with 1 <= i <= n, for example 2/4; got '{text}'")


def spread(frames: Sequence[Frame], limit: int | None) -> tuple[Frame, ...]:
    """Return ``limit`` frames in order, taken in turn from every episode; all of them for None."""
    if limit is None or limit >= len(frames):
        return tuple(frames)
    if limit < 1:
        raise SpecError(f"--limit needs at least 1 frame, got {limit}")
    turn: dict[str, int] = {}
    ranked = []
    for place, frame in enumerate(frames):
        turn[frame.episode] = turn.get(frame.episode, -1) + 1
        ranked.append((turn[frame.episode], place))
    return tuple(frames[place] for place in sorted(place for _, place in sorted(ranked)[:limit]))


def execute(
    plan: Plan,
    models: Mapping[str, Model],
    ledger: Ledger,
    *,
    concurrency: int = 8,
    attempts: int = 5,
    limits: Limits | None = None,
    progress: Progress | None = None,
    watch: Watch | None = None,
) -> Outcome:
    """Make every planned call that the ledger does not hold finished, in seeded random order.

    A ``watch`` may choose another order and leave calls out.

    A call whose error is transient is tried up to ``attempts`` times, with backoff. An interrupt leaves the
    ledger whole: what was under way stands as sent with its outcome unknown, and the same plan resumes it.
    """
    keys = plan.keys()
    finished = ledger.finished()
    todo = [key for key in sorted(keys) if key not in finished]
    random.Random(plan.seed).shuffle(todo)  # noqa: S311 - an order of calls, no secret
    budget = Budget(limits or Limits(), plan.models)
    if budget.counts_all:
        for spec in plan.models:
            for attempt in ledger.attempts(spec):
                budget.made_before(spec, attempt.reply)
    execution = _Execution(plan, models, ledger, budget, attempts=attempts, progress=progress, watch=watch)
    try:
        asyncio.run(execution.run(todo, len(keys), concurrency))
    except BaseExceptionGroup as group:
        raise _first(group) from None
    return Outcome(dict(budget.set_aside), budget.stopped)


def _first(error: BaseException) -> BaseException:
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error


class _Writer:
    """Writes to the ledger what the calls of one turn of the event loop have to write, in one commit for all.

    A row is durable when its ``begin`` or ``close`` returns, as the ledger's own are.
    """

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._waiting: list[tuple[Callable[[], Attempt | None], asyncio.Future[Attempt | None]]] = []

    async def begin(self, key: CallKey, digest: str) -> Attempt:
        attempt = await self._soon(lambda: self._ledger.begin(key, digest))
        assert attempt is not None
        return attempt

    async def close(self, attempt: Attempt, reply: Reply) -> None:
        await self._soon(lambda: self._ledger.close(attempt, reply))

    def _soon(self, write: Callable[[], Attempt | None]) -> "asyncio.Future[Attempt | None]":
        loop = asyncio.get_running_loop()
        if not self._waiting:
            loop.call_soon(self._write)
        written = loop.create_future()
        self._waiting.append((write, written))
        return written

    def _write(self) -> None:
        waiting, self._waiting = self._waiting, []
        try:
            with self._ledger.together():
                done = [write() for write, _ in waiting]
        except Exception as error:  # noqa: BLE001 - each of them must hear of it, or they wait for ever
            for _, written in waiting:
                if not written.done():
                    written.set_exception(error)
            return
        for (_, written), value in zip(waiting, done, strict=True):
            if not written.done():
                written.set_result(value)


class _Execution:
    """One event loop over the calls that remain: a few workers a model, one writer."""

    def __init__(
        self,
        plan: Plan,
        models: Mapping[str, Model],
        ledger: Ledger,
        budget: Budget,
        *,
        attempts: int,
        progress: Progress | None,
        watch: Watch | None,
    ) -> None:
        self._watch = watch
        self._plan = plan
        self._models = models
        self._writer = _Writer(ledger)
        self._budget = budget
        self._attempts = attempts
        self._progress = progress
        self._done = self._planned = 0
        self._stimuli = Stimuli(plan.bank, plan.seed, plan.view)

    async def run(self, todo: list[CallKey], planned: int, concurrency: int) -> None:
        self._planned, self._done = planned, planned - len(todo)
        self._report()
        try:
            async with asyncio.TaskGroup() as group:
                for spec in self._plan.models:
                    mine, pace = [key for key in todo if key.model == spec], Pace(concurrency)
                    queue = iter(mine) if self._watch is None else self._watch.queue(spec, mine)
                    for _ in range(concurrency):
                        group.create_task(self._work(queue, self._models[spec], pace))
        finally:
            for model in self._models.values():
                await _close(model)

    async def _work(self, queue: Iterator[CallKey], model: Model, pace: Pace) -> None:
        for key in queue:
            last = await self._call(key, model, pace)
            if last is None:
                return
            self._budget.ended(key.model, last)
            if self._watch is not None and last.error not in UNFINISHED:
                self._watch.finished(key, last)
            self._done += last.error not in UNFINISHED  # after the await: other workers count meanwhile
            self._report()
            await asyncio.sleep(0)  # lets the other models' calls, and an interrupt, come in between

    async def _call(self, key: CallKey, model: Model, pace: Pace) -> Reply | None:
        """Make a call; return its last reply, or None where a limit kept it from being made."""
        picture = self._stimuli.show(key.condition, key.frame)
        query = self._plan.query(key, picture)
        digest, reply = query.sha256(), None
        for number in range(1, self._attempts + 1):
            entered = await pace.enter()
            if not await self._budget.turn(key.model):
                pace.leave(entered, _NOT_SENT)
                return reply
            attempt = await self._writer.begin(key, digest)
            reply = await _ask(model, query)
            await self._writer.close(attempt, reply)
            pace.leave(entered, reply)
            self._budget.came(key.model, reply)
            if reply.error not in TRANSIENT:
                break
            if number < self._attempts:
                await asyncio.sleep(pause_s(number, reply))
        return reply

    def _report(self) -> None:
        if self._progress is not None:
            self._progress(self._done, self._planned)


async def _close(model: Model) -> None:
    """Let a model go; one that does not let itself be closed cannot undo the run."""
    with contextlib.suppress(Exception):
        async with asyncio.timeout(_CLOSING_S):
            await model.close()


async def _ask(model: Model, query: Query) -> Reply:
    start = time.perf_counter()
    try:
        reply = await model.answer(query)
        if not isinstance(reply, Reply):
            raise TypeError(f"the model answered with a {type(reply).__name__}, not with a Reply")  # noqa: TRY301
        if wrong := misfit(reply):
            raise TypeError(f"the model's Reply cannot be kept: {wrong}")  # noqa: TRY301
    except asyncio.CancelledError:
        task = asyncio.current_task()
        if task is None or task.cancelling():
            raise
        # An adapter's own cancelled request; let through, it would end a worker of the run without a word.
        reply = Reply(error="exception", error_detail="CancelledError: the adapter cancelled its own request")
    except Exception as error:  # noqa: BLE001 - whatever an adapter raises is a row, not the end of the run
        reply = Reply(error="exception", error_detail=without_secrets(f"{type(error).__name__}: {error}")[:2000])
    seconds = time.perf_counter() - start
    return reply if reply.seconds is not None else replace(reply, seconds=seconds)
