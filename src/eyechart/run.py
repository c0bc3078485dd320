"""A run turns a plan into calls and calls into rows of the ledger; it spends money, and only appends."""

import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol, TypedDict, Unpack

from eyechart.attempts import Caller, budget_of, close, to_the_end
from eyechart.calls import CallKey, Query, Reply
from eyechart.channels import reflected
from eyechart.conditions import SAMPLED, available, sample, show, sources
from eyechart.errors import SpecError, counted
from eyechart.frames import Frame, FrameBank, Stimulus
from eyechart.ledger import Ledger
from eyechart.limits import Limits, Outcome, Pace
from eyechart.loops import asyncio
from eyechart.models import Model
from eyechart.models.faults import is_of_the_road
from eyechart.perception.view import View, through
from eyechart.prompts import Prompt
from eyechart.seeds import key_seed
from eyechart.spaces.motion import MotionSpace, require_motions
from eyechart.spaces.space import AnySpace
from eyechart.stimuli import Stimuli

Progress = Callable[[int, int], None]
"""Called with (calls finished, calls planned) whenever a call ends."""


class Stages(Protocol):
    """Decides, as calls finish, which of those that remain are made, in which order, and which come after them."""

    def queue(self, model: str, todo: Sequence[CallKey]) -> Iterator[CallKey]:
        """Yield the calls of a model to make, out of ``todo``; asked for the next one only when a worker is free."""
        del model
        return iter(todo)

    def finished(self, key: CallKey, reply: Reply) -> None:
        """Take note of a finished call."""
        del key, reply

    def more(self, model: str) -> Sequence[CallKey]:
        """Return the calls of a model's next stage, in their order, once no call is under way; none ends its run."""


@dataclass(frozen=True)
class Plan:
    """Every call of a run: models × frames × conditions, those of one shard if it is sharded.

    ``controls`` are the conditions that a model is asked beside ``conditions``, in the order of its stages; those in
    `SAMPLED` of some frames only. Models of one of the ``turns`` are asked one after another, each closed before the
    next is asked; without turns all are asked at once.
    """

    study: str
    bank: FrameBank
    prompt: Prompt
    models: tuple[str, ...]
    conditions: tuple[str, ...]
    frames: tuple[Frame, ...]
    seed: int
    shard: tuple[int, int] | None = None
    view: View | None = None
    controls: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    turns: tuple[tuple[str, ...], ...] = ()

    @property
    def space(self) -> AnySpace:
        """Return what the answers are: actions of the bank, or what the prompt asks for instead."""
        return self.prompt.asks(self.bank.manifest.action_space)

    @property
    def size(self) -> str:
        """Return in words on what each model is asked; where a product is more than the calls, it says so."""
        every = all(self.shows(condition, frame) for condition in self.conditions for frame in self.frames)
        unshown = "" if every else " (not every frame can be shown every condition)"
        return f"{counted(len(self.frames), 'frame')} × {counted(len(self.conditions), 'condition')}{unshown}"

    def keys(self) -> list[CallKey]:
        """Return the planned calls, in the bank's order."""
        return [key for model in self.models for key in self.keys_of(model)]

    @cached_property
    def _sampled(self) -> Mapping[str, frozenset[str]]:
        """Return which frames each sampled control is asked of; one that is a condition of the run of all."""
        calls = sum(available(name, frame) for name in self.conditions for frame in self.frames)
        shown = {name: [frame.id for frame in self.frames if available(name, frame)] for name in SAMPLED}
        return {name: sample(name, ids, calls, self.seed) for name, ids in shown.items() if name not in self.conditions}

    def stimuli(self) -> Stimuli:
        """Return what shows the conditions, each once."""
        return Stimuli(self.bank, self.seed, self.view)

    def shows(self, condition: str, frame: Frame) -> bool:
        """Return whether a frame can be shown under a condition."""
        return available(condition, frame, self.bank)

    def seen(self, condition: str, frame: Frame) -> Stimulus:
        """Return what a condition shows of a frame, through the view if there is one."""
        return through(self.view, show(condition, frame, self.bank, self.seed), frame.id)

    def sources(self, condition: str, frame: Frame) -> tuple[str, ...]:
        """Return the files of the bank of which a condition's pictures of a frame are made."""
        return sources(condition, frame, self.bank, self.seed)

    def query(self, key: CallKey, seen: Stimulus) -> Query:
        """Return what a model is asked in a call, of this stimulus."""
        return self.prompt.query(seen, key.seed(self.seed), self.space)

    def lacks(self, reply: Reply) -> str:
        """Return what a reply lacks without which asking on is no use; nothing: what cannot be read is data too."""
        del reply
        return ""

    def asked(self, model: str) -> tuple[str, ...]:
        """Return the conditions that a model is asked."""
        return (*self.conditions, *self.controls.get(model, ()))

    def beyond(self, model: str, todo: Sequence[CallKey]) -> int:
        """Return how many of the calls of a later stage are not planned yet."""
        asked = self.asked(model)
        return sum(key.condition not in asked for key in todo)

    def keys_of(self, model: str) -> Iterator[CallKey]:
        """Yield the planned calls of one model, in the bank's order."""
        prompt, asked = self.prompt.key, self.asked(model)
        few = {name: self._sampled[name] for name in self.controls.get(model, ()) if name in self._sampled}
        for frame in self.frames:
            for condition in asked:
                if available(condition, frame) and (condition not in few or frame.id in few[condition]):
                    key = CallKey(self.study, model, prompt, frame.id, condition)
                    if self.shard is None or in_shard(key, *self.shard):
                        yield key


@dataclass(frozen=True)
class MotionPlan(Plan):
    """Every call of a run of policies, which answer with motions: policies × frames × conditions of channels.

    What is seeded is given one seed for all calls, so that only what is shown can differ; ``real_repeat`` has another.
    A policy that is known to be ``drawn``, to draw its answers, gets every call ``answers`` times, but ``real_repeat``,
    whose only use is to tell that it does. One that says that it is ``seeded`` gets that twice, the second time with
    the seed of all calls.
    """

    answers: int = 1
    drawn: frozenset[str] = frozenset()
    seeded: frozenset[str] = frozenset()

    @property
    def motions(self) -> MotionSpace:
        """Return what a motion is."""
        return require_motions(self.space)

    def query(self, key: CallKey, seen: Stimulus) -> Query:
        """Return what a policy is given in a call."""
        given = reflected(seen, self.motions) if key.condition == "mirrored" else seen
        again = key.condition == "real_repeat"
        repeat, other = (0, False) if again and key.repeat else (key.repeat, again)
        seed = key_seed("policy", self.seed, repeat, other)
        return self.prompt.query(given, seed, self.space)

    def lacks(self, reply: Reply) -> str:
        """Return why an answer holds no motion; a policy that never answers with one is not asked to the end."""
        words = self.motions.lacks(reply)
        return f"no motion: {words}" if words else ""

    def beyond(self, model: str, todo: Sequence[CallKey]) -> int:
        """Return how many of the calls of a later stage are not planned yet."""
        return 0 if model in self.drawn else sum(key.repeat > 0 and key.condition != "real_repeat" for key in todo)

    def keys_of(self, model: str) -> Iterator[CallKey]:
        """Yield the calls of one policy, in the bank's order."""
        prompt = self.prompt.key
        times = self.answers if model in self.drawn else 1
        for repeat in range(max(times, 2) if model in self.seeded else times):
            for frame in self.frames:
                for condition in self.conditions:
                    most = (2 if model in self.seeded else 1) if condition == "real_repeat" else times
                    if repeat < most and self.shows(condition, frame):
                        key = CallKey(self.study, model, prompt, frame.id, condition, repeat)
                        if self.shard is None or in_shard(key, *self.shard):
                            yield key


def in_order(keys: Iterable[CallKey], seed: int) -> list[CallKey]:
    """Return calls in the random order in which a run makes them, whatever order they come in."""
    found = sorted(keys)
    random.Random(seed).shuffle(found)  # noqa: S311 - an order of calls, no secret
    return found


def in_shard(key: CallKey, index: int, count: int) -> bool:
    """Return whether a call belongs to shard ``index`` of ``count``, counted from 1; every call is in one."""
    return key_seed("shard", *key) % count == index - 1


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


class Calling(TypedDict, total=False):
    """How calls are made: so many at once a model (8), each tried so often (5), within limits; who is told of them."""

    concurrency: int
    attempts: int
    limits: Limits | None
    progress: Progress | None


def execute(
    plan: Plan, models: Mapping[str, Model], ledger: Ledger, stages: Stages | None = None, **how: Unpack[Calling]
) -> Outcome:
    """Make every planned call that the ledger does not hold finished, in seeded random order.

    ``stages`` may choose another order, leave calls out, and add some when a model's are made.

    A call whose error is transient is tried up to ``attempts`` times, with backoff. An interrupt leaves the
    ledger whole: what was under way stands as sent with its outcome unknown, and the same plan resumes it.
    """
    keys, finished = plan.keys(), ledger.finished()
    todo = in_order((key for key in keys if key not in finished), plan.seed)
    return _Execution(plan, models, ledger, stages, planned=len(keys), done=len(keys) - len(todo), **how).made(todo)


def failed_on_the_road(ledger: Ledger, models: Iterable[str]) -> list[CallKey]:
    """Return the finished calls of models that ended in a failure which says nothing of their request."""
    finished = ledger.finished()
    return [key for spec in models for key, one in ledger.replies(spec) if key in finished and is_of_the_road(one)]


def ask_again(plan: Plan, models: Mapping[str, Model], ledger: Ledger, **how: Unpack[Calling]) -> Outcome:
    """Make the calls once more that ended in a failure of the road; never one that got a reply, or a wrong request.

    The last final reply of a call counts, and the earlier ones stay.
    """
    todo = in_order(failed_on_the_road(ledger, plan.models), plan.seed)
    return _Execution(plan, models, ledger, planned=len(todo), again=True, **how).made(todo)


@dataclass
class _Execution:
    """One event loop over the calls that remain: a few workers a model, one writer."""

    plan: Plan
    models: Mapping[str, Model]
    ledger: Ledger
    stages: Stages | None = None
    planned: int = 0
    done: int = 0
    again: bool = False
    concurrency: int = 8
    attempts: int = 5
    limits: Limits | None = None
    progress: Progress | None = None

    def made(self, todo: list[CallKey]) -> Outcome:
        """Make these calls, and what the stages add to them."""
        budget = budget_of(self.limits, self.plan.models, self.ledger)
        self.caller = Caller(self.ledger, budget, attempts=self.attempts, again=self.again, lacks=self.plan.lacks)
        self.stimuli = self.plan.stimuli()
        to_the_end(self._run(todo))
        found = Outcome(dict(budget.set_aside), budget.stopped, budget.uncounted, budget.failures(), budget.lasting())
        return replace(found, whole=self.done == self.planned and not self.again)

    async def _run(self, todo: list[CallKey]) -> None:
        self._report()
        by_model: dict[str, list[CallKey]] = {}
        for key in todo:
            by_model.setdefault(key.model, []).append(key)
        try:
            async with asyncio.TaskGroup() as group:
                for turn in self.plan.turns or [(spec,) for spec in self.plan.models]:
                    group.create_task(self._take_turn(turn, by_model))
        finally:
            for model in self.models.values():
                await close(model)

    async def _take_turn(self, turn: Sequence[str], by_model: Mapping[str, Sequence[CallKey]]) -> None:
        """Ask models one after another, and let each go before the next is asked."""
        for spec in turn:
            await self._ask(spec, by_model.get(spec, ()))
            if spec != turn[-1]:
                await close(self.models[spec])

    async def _ask(self, spec: str, todo: Sequence[CallKey]) -> None:
        """Make a model's calls, stage by stage."""
        pace = Pace(self.concurrency)
        while True:
            queue = iter(todo) if self.stages is None else self.stages.queue(spec, todo)
            async with asyncio.TaskGroup() as group:
                for _ in range(self.concurrency if todo else 0):
                    group.create_task(self._work(queue, self.models[spec], pace))
            todo = () if self.stages is None else self.stages.more(spec)
            if not todo:
                return
            self.planned += self.plan.beyond(spec, todo)

    async def _work(self, queue: Iterator[CallKey], model: Model, pace: Pace) -> None:
        for key in queue:
            query = self.plan.query(key, self.stimuli.show(key.condition, key.frame))
            made = await self.caller.call(key, query, model, pace)
            if made is None:
                return
            if self.stages is not None and made.finished:
                self.stages.finished(key, made.reply)
            self.done += made.finished  # after the await: other workers count meanwhile
            self._report()
            await asyncio.sleep(0)  # lets the other models' calls, and an interrupt, come in between

    def _report(self) -> None:
        if self.progress is not None:
            self.progress(self.done, self.planned)
