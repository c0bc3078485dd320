"""A run turns a plan into calls and calls into rows of the ledger; it spends money, and only appends."""

import asyncio
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from eyechart.attempts import Caller, budget_of, close, first_error
from eyechart.calls import CallKey, Query, Reply
from eyechart.conditions import available
from eyechart.errors import SpecError
from eyechart.frames import Frame, FrameBank, Stimulus
from eyechart.ledger import Ledger
from eyechart.limits import Limits, Outcome, Pace
from eyechart.models import Model
from eyechart.perception.view import View
from eyechart.prompts import Prompt
from eyechart.seeds import key_seed
from eyechart.spaces.space import AnySpace
from eyechart.stimuli import Stimuli

Progress = Callable[[int, int], None]
"""Called with (calls finished, calls planned) whenever a call ends."""


class EarlyStopping(Protocol):
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

    @property
    def space(self) -> AnySpace:
        """Return what the answers are: actions of the bank, or what the prompt asks for instead."""
        return self.prompt.asks(self.bank.manifest.action_space)

    def keys(self) -> list[CallKey]:
        """Return the planned calls, in the bank's order."""
        return [key for model in self.models for key in self.keys_of(model)]

    def query(self, key: CallKey, seen: Stimulus) -> Query:
        """Return what a model is asked in a call, of this stimulus."""
        return self.prompt.query(seen, key.seed(self.seed), self.space)

    def keys_of(self, model: str) -> Iterator[CallKey]:
        """Yield the planned calls of one model, in the bank's order."""
        prompt = self.prompt.key
        for frame in self.frames:
            for condition in self.conditions:
                if available(condition, frame):
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
    early: EarlyStopping | None = None,
) -> Outcome:
    """Make every planned call that the ledger does not hold finished, in seeded random order.

    ``early`` may choose another order and leave calls out.

    A call whose error is transient is tried up to ``attempts`` times, with backoff. An interrupt leaves the
    ledger whole: what was under way stands as sent with its outcome unknown, and the same plan resumes it.
    """
    keys = plan.keys()
    finished = ledger.finished()
    todo = [key for key in sorted(keys) if key not in finished]
    random.Random(plan.seed).shuffle(todo)  # noqa: S311 - an order of calls, no secret
    budget = budget_of(limits, plan.models, ledger)
    caller = Caller(ledger, budget, attempts=attempts)
    execution = _Execution(plan, models, caller, progress=progress, early=early)
    try:
        asyncio.run(execution.run(todo, len(keys), concurrency))
    except BaseExceptionGroup as group:
        raise first_error(group) from None
    return Outcome(dict(budget.set_aside), budget.stopped, budget.uncounted)


class _Execution:
    """One event loop over the calls that remain: a few workers a model, one writer."""

    def __init__(
        self,
        plan: Plan,
        models: Mapping[str, Model],
        caller: Caller,
        *,
        progress: Progress | None,
        early: EarlyStopping | None,
    ) -> None:
        self._early = early
        self._plan = plan
        self._models = models
        self._caller = caller
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
                    queue = iter(mine) if self._early is None else self._early.queue(spec, mine)
                    for _ in range(concurrency):
                        group.create_task(self._work(queue, self._models[spec], pace))
        finally:
            for model in self._models.values():
                await close(model)

    async def _work(self, queue: Iterator[CallKey], model: Model, pace: Pace) -> None:
        for key in queue:
            made = await self._caller.call(key, self._query(key), model, pace)
            if made is None:
                return
            if self._early is not None and made.finished:
                self._early.finished(key, made.reply)
            self._done += made.finished  # after the await: other workers count meanwhile
            self._report()
            await asyncio.sleep(0)  # lets the other models' calls, and an interrupt, come in between

    def _query(self, key: CallKey) -> Query:
        """Return what is asked in a call."""
        return self._plan.query(key, self._stimuli.show(key.condition, key.frame))

    def _report(self) -> None:
        if self._progress is not None:
            self._progress(self._done, self._planned)
