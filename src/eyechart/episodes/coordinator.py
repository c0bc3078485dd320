"""The coordinator of a run: it holds models, ledger and bounds, and lets workers drive."""

import asyncio
import random
import signal
import threading
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from eyechart.attempts import Caller, budget_of, close, to_the_end
from eyechart.calls import CallKey, Query, Reply
from eyechart.conditions import flip
from eyechart.episodes.records import REFLECTED, Episode, EpisodeKey
from eyechart.episodes.workers import Worker, WorkerDiedError
from eyechart.episodes.worlds import EpisodeView
from eyechart.errors import EyechartError
from eyechart.frames import Stimulus, decode, encode
from eyechart.ledger import Ledger
from eyechart.limits import Limits, Pace, RunOutcome
from eyechart.models import Model
from eyechart.perception.view import View, through
from eyechart.policies import Policy
from eyechart.prompts import Prompt
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.space import AnySpace, Decision

Progress = Callable[[int, int], None]
"""Called with (episodes finished, episodes planned) after each episode."""


@dataclass(frozen=True)
class Drivers:
    """The drivers of a run: policies that go to the worlds, and models that get the pictures.

    Models are called with ``prompt`` and see pictures through ``view``, if any. ``space`` is the
    space of actions, ``answers`` that of replies, and ``seed`` the run's. ``silent`` are the kinds
    of failure that execute the fail-safe; any other passing failure leaves the episode unfinished.
    The models of one of the ``turns`` drive one after another, and each is closed before the next
    call; without turns all drive at once. ``mirror_axis`` is the world's if models also get each
    picture's reflection, which decides nothing; else None.
    """

    policies: Mapping[str, Policy]
    models: Mapping[str, Model]
    prompt: Prompt
    space: Discrete
    seed: int
    answers: AnySpace
    view: View | None = None
    silent: frozenset[str] = frozenset()
    turns: tuple[tuple[str, ...], ...] = ()
    mirror_axis: str | None = None


@dataclass(frozen=True, slots=True)
class Bounds:
    """The bounds of a run.

    ``processes`` hold the worlds, ``concurrency`` episodes of a model run at once, a call is tried
    ``attempts`` times, and ``limits`` end the run. With ``sequential``, models drive one after
    another, and each is closed before the next; by default this applies to those of one machine.
    """

    processes: int = 1
    concurrency: int = 8
    attempts: int = 5
    limits: Limits | None = None
    sequential: bool | None = None


USUAL = Bounds()


def drive(
    todo: Sequence[EpisodeKey],
    drivers: Drivers,
    open_worker: Callable[[], Worker],
    keep: Callable[[Episode], None],
    *,
    ledger: Ledger | None = None,
    bounds: Bounds = USUAL,
) -> RunOutcome:
    """Drive episodes in seeded random order, and ``keep`` each at its end.

    ``open_worker`` starts a worker; models need a ``ledger``. A finished call in it is not
    repeated. An episode that a limit or a passing error cuts is not kept. When it is driven again,
    its finished calls are replayed.
    """
    todo = sorted(todo)
    random.Random(drivers.seed).shuffle(todo)  # noqa: S311 - an order, no secret
    coordinator = _Coordinator(drivers, open_worker, keep, calls_of(todo, drivers, ledger))
    return to_the_end(coordinator.run(todo, ledger, bounds))


def calls_of(
    todo: Sequence[EpisodeKey], drivers: Drivers, ledger: Ledger | None
) -> dict[EpisodeKey, dict[CallKey, tuple[Reply, str]]]:
    """Return the finished calls of cut episodes, with reply and request digest, by episode."""
    by_frame = {(key.policy, key.world, key.condition): key for key in todo if key.policy in drivers.models}
    calls: dict[EpisodeKey, dict[CallKey, tuple[Reply, str]]] = {}
    if ledger is None:
        return calls
    for spec in drivers.models:
        for sent in ledger.attempts(spec):
            world = sent.key.frame.rpartition("/")[0]
            real = drivers.mirror_axis is not None and sent.key.condition == REFLECTED
            episode = by_frame.get((spec, world, "real" if real else sent.key.condition))
            if episode is not None and sent.reply is not None and sent.final:
                calls.setdefault(episode, {})[sent.key] = sent.reply, sent.request_sha256
    return calls


class RecordedModel:
    """A stand-in for a model whose replies are all in the record."""

    version: str = ""
    facts: Mapping[str, str] = {}

    async def answer(self, query: Query) -> Reply:
        """Return an error; without a reply in the record an episode ends before this is called."""
        del query
        return Reply(error="exception", error_detail="only the record answers")

    async def close(self) -> None:
        """Do nothing: there are no resources."""


Unlike = Callable[[EpisodeKey, CallKey, str, str], None]
"""Called with an episode, a call, and the digests of the request as sent and as it is now."""


def drive_again(
    todo: Sequence[EpisodeKey],
    drivers: Drivers,
    open_worker: Callable[[], Worker],
    keep: Callable[[Episode], None],
    *,
    calls: dict[EpisodeKey, dict[CallKey, tuple[Reply, str]]],
    unlike: Unlike,
    bounds: Bounds = USUAL,
) -> None:
    """Drive episodes again, in order, with models answered from their finished ``calls`` alone.

    There are no calls and no files. If a world shows another picture than a call had, ``unlike`` is
    called and the drive goes on. Without a reply, the episode ends in an error that says so.
    """
    coordinator = _Coordinator(drivers, open_worker, keep, calls, unlike=unlike)
    to_the_end(coordinator.run(todo, None, bounds))


class _EpisodeCutError(Exception):
    """An episode cannot go on now: the last error of its call may pass."""


class _StoppedError(Exception):
    """No further calls of the model are made: a limit was met, or the model was set aside."""


class _NotRepeatedError(EyechartError):
    """A world that is driven again shows other pictures than before."""


@dataclass
class _Slot:
    """The place of one worker, and of its successor after its death."""

    worker: Worker
    worlds: int = 0


@dataclass
class _Coordinator:
    """One event loop over the remaining episodes; workers drive worlds, models are called here."""

    drivers: Drivers
    open_worker: Callable[[], Worker]
    keep: Callable[[Episode], None]
    finished: dict[EpisodeKey, dict[CallKey, tuple[Reply, str]]]
    unlike: Unlike | None = None
    slots: list[_Slot] = field(default_factory=list)
    alone: "asyncio.Lock" = field(default_factory=lambda: asyncio.Lock())  # noqa: PLW0108 - imported at its first use
    paces: dict[str, Pace] = field(default_factory=dict)
    caller: Caller | None = None

    async def run(self, todo: Sequence[EpisodeKey], ledger: Ledger | None, bounds: Bounds) -> RunOutcome:
        models = self.drivers.models
        budget = None if ledger is None else budget_of(bounds.limits, tuple(models), ledger)
        if ledger is not None and budget is not None:
            self.caller = Caller(ledger, budget, attempts=bounds.attempts, silent=self.drivers.silent)
        own = [key for key in todo if key.policy not in models]
        by_model = {spec: [key for key in todo if key.policy == spec] for spec in models}
        with _terminated_as_interrupted():
            try:
                for _ in range(min(bounds.processes, len(todo))):
                    self.slots.append(_Slot(self.open_worker()))
                async with asyncio.TaskGroup() as group:
                    queue = iter(own)
                    for slot in self.slots:
                        group.create_task(self._policies(queue, slot))
                    for turn in self.drivers.turns or [(spec,) for spec in models]:
                        group.create_task(self._take_turn(turn, by_model, bounds.concurrency))
            finally:
                for slot in self.slots:
                    slot.worker.close()
                for model in models.values():
                    await close(model)
        return (
            RunOutcome({}) if budget is None else RunOutcome(dict(budget.set_aside), budget.stopped, budget.uncounted)
        )

    async def _take_turn(
        self, turn: Sequence[str], by_model: Mapping[str, Sequence[EpisodeKey]], concurrency: int
    ) -> None:
        """Let models drive one after another, and close each before the next call."""
        for spec in turn:
            self.paces[spec] = Pace(concurrency)
            waiting = iter(by_model[spec])
            async with asyncio.TaskGroup() as group:
                for _ in range(min(concurrency, len(by_model[spec]))):
                    group.create_task(self._model(waiting))
            if spec != turn[-1]:
                await close(self.drivers.models[spec])

    async def _policies(self, queue: Iterator[EpisodeKey], slot: _Slot) -> None:
        """Let one worker drive its episodes one after another, without the coordinator."""
        for key in queue:
            self.keep(await self._survive(key, slot, partial(self._drive_alone, key)))

    async def _drive_alone(self, key: EpisodeKey, worker: Worker) -> Episode:
        episode = await worker.ask("drive", key, self.drivers.policies[key.policy])
        assert isinstance(episode, Episode)
        return episode

    async def _model(self, queue: Iterator[EpisodeKey]) -> None:
        """Drive a model's episodes one after another, each in the worker with the fewest."""
        for key in queue:
            slot = min(self.slots, key=lambda one: one.worlds)
            slot.worlds += 1
            try:
                self.keep(await self._survive(key, slot, partial(self._ask_through, key)))
            except _EpisodeCutError:
                continue
            except _StoppedError:
                return
            finally:
                slot.worlds -= 1
            self.finished.pop(key, None)

    async def _survive(self, key: EpisodeKey, slot: _Slot, drive: Callable[[Worker], Awaitable[Episode]]) -> Episode:
        """Drive an episode; after a worker's death once more alone, and then as an error."""
        try:
            return await drive(slot.worker)
        except WorkerDiedError:
            if slot.worker.dead:
                slot.worker.close()
                slot.worker = self.open_worker()
        async with self.alone:
            worker = self.open_worker()
            try:
                return await drive(worker)
            except WorkerDiedError as error:
                return Episode(key, (), "error", "", f"its world took its process down, twice: {error}")
            finally:
                worker.close()

    async def _ask_through(self, key: EpisodeKey, worker: Worker) -> Episode:
        """Drive an episode of a model: each picture makes a call, and the decision goes back."""
        shown = await worker.ask("open", key)
        while isinstance(shown, EpisodeView):
            try:
                reply = await self._reply(key, key.call(self.drivers.prompt.key, shown.step), shown)
                if self.drivers.mirror_axis is not None:
                    mirrored = replace(shown, stimulus=_reflected(shown, self.drivers.mirror_axis))
                    await self._reply(key, key.reflection(self.drivers.prompt.key, shown.step), mirrored)
            except _NotRepeatedError as error:
                shown = await worker.ask("fail", key, str(error))
            except (_EpisodeCutError, _StoppedError):
                await worker.ask("close", key)
                raise
            else:
                shown = await worker.ask("act", key, decide(reply, self.drivers), reply.error or "")
        assert isinstance(shown, Episode)
        return shown

    async def _reply(self, key: EpisodeKey, call: CallKey, shown: EpisodeView) -> Reply:
        """Return the reply of a finished call, or make the call."""
        drivers = self.drivers
        stimulus = through(drivers.view, shown.stimulus, shown.frame)
        query = drivers.prompt.query(stimulus, call.seed(drivers.seed), drivers.answers)
        known = self.finished.setdefault(key, {})
        if call in known:
            reply, digest = known[call]
            if digest != (now := query.sha256()):
                self._tell_unlike(key, call, digest, now)
            return reply
        if self.caller is None:
            raise _NotRepeatedError(f"the ledger holds no reply at step {shown.step}")
        made = await self.caller.call(call, query, drivers.models[key.policy], self.paces[key.policy])
        if made is None:
            raise _StoppedError
        if not made.finished:
            raise _EpisodeCutError
        known[call] = made.reply, query.sha256()
        return made.reply

    def _tell_unlike(self, key: EpisodeKey, call: CallKey, sent: str, shown: str) -> None:
        if self.unlike is None:
            step = int(call.frame.rpartition("/")[2])
            raise _NotRepeatedError(
                f"at step {step} the world shows another picture than in the model's call: it does not repeat itself"
            )
        self.unlike(key, call, sent, shown)


def _reflected(view: EpisodeView, axis: str) -> Stimulus:
    """Return the stimulus, flipped across the lane axis."""
    flipped = {
        name: encode(np.ascontiguousarray(flip(decode(image, view.frame), axis)))
        for name, image in view.stimulus.images.items()
    }
    return replace(view.stimulus, images=flipped)


def decide(reply: Reply, drivers: Drivers) -> Decision[str]:
    """Return the decision of a reply: its action, or the safe action of a scene."""
    found = drivers.answers.read(reply)
    action = None if found.action is None else drivers.answers.symbol(found.action)
    return Decision(action, found.missing, found.why)


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """Let SIGTERM end the run as SIGINT does: workers are closed, and finished work is kept.

    A program with its own handler of SIGTERM, such as the command line, uses that one.
    """
    loop, here = asyncio.get_running_loop(), threading.current_thread() is threading.main_thread()
    task, usual = asyncio.current_task(), here and signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    if usual and task is not None:
        loop.add_signal_handler(signal.SIGTERM, task.cancel)  # SIGINT itself may be ignored: a shell's background job
    try:
        yield
    finally:
        if usual:
            loop.remove_signal_handler(signal.SIGTERM)
