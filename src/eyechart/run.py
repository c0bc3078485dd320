"""A run: it turns a plan into calls and appends them to the ledger."""

import asyncio
import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from eyechart.attempts import Caller, budget_of, close, to_the_end
from eyechart.calls import CallKey, Query, Reply
from eyechart.channels import reflected
from eyechart.conditions import SAMPLED, is_available, sample, seed_of, show, sources, text_source_frame
from eyechart.errors import SpecError, counted
from eyechart.frames import Frame, FrameBank, Stimulus
from eyechart.ledger import Ledger
from eyechart.limits import Limits, Pace, RunOutcome
from eyechart.models import Model
from eyechart.models.batches import at_once
from eyechart.models.faults import is_of_the_road
from eyechart.perception.view import View, through
from eyechart.prompts import Prompt
from eyechart.seeds import key_seed
from eyechart.spaces.motion import MotionSpace, require_motions
from eyechart.spaces.space import AnySpace, Decision
from eyechart.stimuli import Stimuli

Mask = NDArray[np.bool_]
Progress = Callable[[int, int], None]
"""Called with (calls finished, calls planned) whenever a call ends."""


class Stages(Protocol):
    """The order of calls in a run: which remaining ones are made, and which follow them."""

    def queue(self, model: str, todo: Sequence[CallKey]) -> Iterator[CallKey]:
        """Yield a model's calls out of ``todo``; the next one is taken when a worker is free."""
        del model
        return iter(todo)

    def finished(self, key: CallKey, reply: Reply) -> None:
        """Record a finished call."""
        del key, reply

    def more(self, model: str) -> Sequence[CallKey]:
        """Return a model's next stage of calls, when none is under way; none ends its run."""


@dataclass(frozen=True)
class Plan:
    """Every call of a run: models × frames × conditions, or those of one shard.

    ``controls`` are a model's further conditions, in the order of its stages; those in `SAMPLED`
    for some frames only. Models in one of the ``turns`` are asked one after another, with one open
    at a time. Without turns all are asked at once.
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
    _available: dict[str, tuple[tuple[Frame, ...], Mask]] = field(default_factory=dict, compare=False, repr=False)
    """Of each condition which of these frames can be shown under it; plans with the same frames share it."""

    @cached_property
    def space(self) -> AnySpace:
        """Return the space of answers: the prompt's own, or the bank's actions."""
        return self.prompt.asks(self.bank.manifest.action_space)

    @property
    def size(self) -> str:
        """Return in words the size per model; it says so if the product exceeds the calls."""
        every = all(self.shows(condition, frame) for condition in self.conditions for frame in self.frames)
        unshown = "" if every else " (not every frame can be shown every condition)"
        return f"{counted(len(self.frames), 'frame')} × {counted(len(self.conditions), 'condition')}{unshown}"

    def keys(self) -> list[CallKey]:
        """Return the planned calls, in the bank's order."""
        return [key for model in self.models for key in self.keys_of(model)]

    @cached_property
    def _sampled(self) -> Mapping[str, frozenset[str]]:
        """Return the frames of each sampled control; a control among the conditions has all."""
        calls = sum(int(self._shown(name).sum()) for name in self.conditions)
        shown = {name: [self.frames[place].id for place in np.flatnonzero(self._shown(name))] for name in SAMPLED}
        return {name: sample(name, ids, calls, self.seed) for name, ids in shown.items() if name not in self.conditions}

    def stimuli(self, *, kept: bool = True) -> Stimuli:
        """Return the stimuli, each made once as long as they are ``kept``."""
        return Stimuli(self.bank, self.seed, self.view, kept=kept)

    @property
    def shows_once(self) -> bool:
        """Return whether no two calls of a run have the same stimulus, but for its repeats."""
        return len(self.models) == 1

    def shows(self, condition: str, frame: Frame) -> bool:
        """Return whether a frame can be shown under a condition."""
        return is_available(condition, frame, self.bank)

    def seen(self, condition: str, frame: Frame) -> Stimulus:
        """Return a condition's stimulus for a frame, through the view if there is one."""
        return through(self.view, show(condition, frame, self.bank, self.seed), frame.id)

    def sources(self, condition: str, frame: Frame) -> tuple[str, ...]:
        """Return the bank's files behind a condition's pictures of a frame."""
        return sources(condition, frame, self.bank, self.seed)

    def query(self, key: CallKey, seen: Stimulus) -> Query:
        """Return the query of a call with this stimulus."""
        return self.prompt.query(seen, key.seed(self.seed), self.space_of(key))

    def space_of(self, key: CallKey) -> AnySpace:
        """Return the space of a call's answers, with the names that its frame's words allow."""
        if not self.space.columns:
            return self.space
        frame = self.bank.frame(key.frame)
        fields = frame.fields
        if key.condition == "text_swapped":
            other = text_source_frame(frame, self.bank, seed_of(key.condition, frame, self.seed)).fields
            fields = {name: (other if name in self.bank.said else fields)[name] for name in fields}
        return self.space.given(fields)

    def read(self, key: CallKey, reply: Reply) -> Decision[Any]:
        """Return the decision in a call's reply."""
        return self.space_of(key).read(reply)

    def lacks(self, reply: Reply) -> str:
        """Return a reply's fault that makes further calls useless; here none does."""
        del reply
        return ""

    def conditions_of(self, model: str) -> tuple[str, ...]:
        """Return the conditions of a model."""
        return (*self.conditions, *self.controls.get(model, ()))

    def beyond(self, model: str, todo: Sequence[CallKey]) -> int:
        """Return how many calls of a later stage are not yet counted as planned."""
        conditions = self.conditions_of(model)
        return sum(key.condition not in conditions for key in todo)

    def cells(self, model: str) -> dict[tuple[str, int], Mask]:
        """Return a model's planned calls: of each condition and repeat, which frames."""
        if self.shard is not None or type(self) is not Plan:
            return cells_of(self.keys_of(model), self.places)
        few = {name: self._in_sample[name] for name in self.controls.get(model, ()) if name in self._in_sample}
        shown = {name: self._shown(name) for name in self.conditions_of(model)}
        return {(name, 0): cells & few[name] if name in few else cells for name, cells in shown.items()}

    @cached_property
    def places(self) -> dict[str, int]:
        """Return the place of each frame."""
        return {frame.id: place for place, frame in enumerate(self.frames)}

    def _shown(self, condition: str) -> Mask:
        """Return which frames can be shown under a condition."""
        frames, known = self._available.get(condition, ((), np.zeros(0, np.bool_)))
        if frames is not self.frames:
            known = np.fromiter((is_available(condition, frame) for frame in self.frames), np.bool_, len(self.frames))
            self._available[condition] = self.frames, known
        return known

    @cached_property
    def _in_sample(self) -> dict[str, Mask]:
        return {
            name: np.fromiter((frame.id in few for frame in self.frames), np.bool_, len(self.frames))
            for name, few in self._sampled.items()
        }

    def keys_of(self, model: str) -> Iterator[CallKey]:
        """Yield the planned calls of one model, in the bank's order."""
        prompt, conditions = self.prompt.key, self.conditions_of(model)
        few = {name: self._sampled[name] for name in self.controls.get(model, ()) if name in self._sampled}
        shown = [(condition, self._shown(condition).tolist()) for condition in conditions]
        for place, frame in enumerate(self.frames):
            for condition, can in shown:
                if can[place] and (condition not in few or frame.id in few[condition]):
                    key = CallKey(self.study, model, prompt, frame.id, condition)
                    if self.shard is None or is_in_shard(key, *self.shard):
                        yield key


@dataclass(frozen=True)
class MotionPlan(Plan):
    """Every call of a run of policies: policies × frames × conditions of channels.

    All calls of a seeded policy get one seed, so that only the stimulus differs; ``real_repeat``
    gets another. A policy in ``drawn`` samples its answers, and gets every call ``answers`` times;
    ``real_repeat``, which only detects sampling, is not repeated. A policy in ``seeded`` gets
    ``real_repeat`` twice, the second time with the common seed.
    """

    answers: int = 1
    drawn: frozenset[str] = frozenset()
    seeded: frozenset[str] = frozenset()

    @property
    def motions(self) -> MotionSpace:
        """Return the space of motions."""
        return require_motions(self.space)

    @property
    def shows_once(self) -> bool:
        """Return whether no two calls have the same stimulus: a policy may answer one several times."""
        return False

    def query(self, key: CallKey, seen: Stimulus) -> Query:
        """Return a policy's query in a call."""
        given = reflected(seen, self.motions) if key.condition == "mirrored" else seen
        again = key.condition == "real_repeat"
        repeat, other = (0, False) if again and key.repeat else (key.repeat, again)
        seed = key_seed("policy", self.seed, repeat, other)
        return self.prompt.query(given, seed, self.space)

    def lacks(self, reply: Reply) -> str:
        """Return why an answer holds no motion; a policy that never gives one is stopped."""
        words = self.motions.lacks(reply)
        return f"no motion: {words}" if words else ""

    def beyond(self, model: str, todo: Sequence[CallKey]) -> int:
        """Return how many calls of a later stage are not yet counted as planned."""
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
                        if self.shard is None or is_in_shard(key, *self.shard):
                            yield key


def cells_of(keys: Iterable[CallKey], places: Mapping[str, int]) -> dict[tuple[str, int], Mask]:
    """Return of each condition and repeat which frames, by their places, the calls are about."""
    found: dict[tuple[str, int], Mask] = {}
    for key in keys:
        if key.frame in places:
            cell = (key.condition, key.repeat)
            found.setdefault(cell, np.zeros(len(places), dtype=np.bool_))[places[key.frame]] = True
    return found


def lacking(wanted: Mapping[tuple[str, int], Mask], have: Mapping[tuple[str, int], Mask]) -> int:
    """Return how many of the wanted cells are not among others."""
    return sum(int((cells & ~have[at] if at in have else cells).sum()) for at, cells in wanted.items())


def in_order(keys: Iterable[CallKey], seed: int) -> list[CallKey]:
    """Return calls in a run's random order, whatever their order before."""
    found = sorted(keys)
    random.Random(seed).shuffle(found)  # noqa: S311 - an order of calls, no secret
    return found


def is_in_shard(key: CallKey, index: int, count: int) -> bool:
    """Return whether a call is in shard ``index`` of ``count``, from 1; each is in one."""
    return key_seed("shard", *key) % count == index - 1


def read_shard(text: str) -> tuple[int, int]:
    """Read ``i/n``; raises SpecError unless 1 <= i <= n."""
    index, slash, count = text.partition("/")
    if slash and index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count):
        return int(index), int(count)
    raise SpecError(f"a shard is i/n with 1 <= i <= n, for example 2/4; got '{text}'")


def spread(frames: Sequence[Frame], limit: int | None) -> tuple[Frame, ...]:
    """Return ``limit`` frames in order, spread over the episodes; all for None."""
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


class RunOptions(TypedDict, total=False):
    """How calls are made: concurrency per model (8), attempts (5), limits, and progress."""

    concurrency: int
    attempts: int
    limits: Limits | None
    progress: Progress | None


def execute(
    plan: Plan, models: Mapping[str, Model], ledger: Ledger, stages: Stages | None = None, **how: Unpack[RunOptions]
) -> RunOutcome:
    """Make every planned call that the ledger lacks, in seeded random order.

    ``stages`` may choose another order, skip calls, and add some when a model's are made. A
    transient error is retried, with backoff, up to ``attempts`` times in all. An interrupt leaves
    the ledger whole: open calls are recorded as sent with an unknown outcome, and the same plan
    resumes.
    """
    keys, finished = plan.keys(), ledger.finished()
    todo = in_order((key for key in keys if key not in finished), plan.seed)
    return _Execution(plan, models, ledger, stages, planned=len(keys), done=len(keys) - len(todo), **how).made(todo)


def failed_on_the_road(ledger: Ledger, models: Iterable[str]) -> list[CallKey]:
    """Return models' finished calls that failed in transport, not by their request."""
    finished = ledger.finished()
    return [key for spec in models for key, one in ledger.replies(spec) if key in finished and is_of_the_road(one)]


def ask_again(plan: Plan, models: Mapping[str, Model], ledger: Ledger, **how: Unpack[RunOptions]) -> RunOutcome:
    """Repeat the calls that failed in transport, but no call with a reply or a wrong request.

    The last final reply of a call counts, and earlier ones stay.
    """
    todo = in_order(failed_on_the_road(ledger, plan.models), plan.seed)
    return _Execution(plan, models, ledger, planned=len(todo), again=True, **how).made(todo)


@dataclass
class _Execution:
    """One event loop over the remaining calls: a few workers per model, one writer."""

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

    def made(self, todo: list[CallKey]) -> RunOutcome:
        """Make these calls, and those that the stages add."""
        budget = budget_of(self.limits, self.plan.models, self.ledger)
        self.caller = Caller(self.ledger, budget, attempts=self.attempts, again=self.again, lacks=self.plan.lacks)
        self.stimuli = self.plan.stimuli(kept=not self.plan.shows_once)
        to_the_end(self._run(todo))
        outcome = RunOutcome(
            dict(budget.set_aside), budget.stopped, budget.uncounted, budget.failures(), budget.lasting()
        )
        return replace(outcome, whole=self.done == self.planned and not self.again)

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
        """Ask models one after another, and close each before the next."""
        for spec in turn:
            await self._ask(spec, by_model.get(spec, ()))
            if spec != turn[-1]:
                await close(self.models[spec])

    async def _ask(self, spec: str, todo: Sequence[CallKey]) -> None:
        """Make a model's calls, stage by stage."""
        workers = at_once(self.models[spec].facts, self.concurrency)
        pace = Pace(workers)
        while True:
            queue = iter(todo) if self.stages is None else self.stages.queue(spec, todo)
            async with asyncio.TaskGroup() as group:
                for _ in range(workers if todo else 0):
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
            self.done += made.finished  # after the await, because other workers count too
            self._report()

    def _report(self) -> None:
        if self.progress is not None:
            self.progress(self.done, self.planned)
