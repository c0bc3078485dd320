"""Makes calls in attempts: recorded before they go out, paced, and repeated if a failure may pass.

Batteries and episodes make their calls here, so both cost, fail and resume in the same way.
"""

import asyncio
import contextlib
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from eyechart.calls import BLOCKED, TRANSIENT, UNFINISHED, CallKey, Query, Reply
from eyechart.event_loops import require_no_loop
from eyechart.ledger import Attempt, Ledger
from eyechart.limits import Budget, Limits, Pace, is_asking_too_much, pause_s
from eyechart.models import Model, ask

_CLOSING_S = 10.0
_NOT_SENT = Reply(error="exception")

T = TypeVar("T")


def budget_of(limits: Limits | None, models: Sequence[str], ledger: Ledger) -> Budget:
    """Return the budget of a run; with a limit, it counts the calls in the run's ledger."""
    budget = Budget(limits or Limits(), models)
    if (budget.limits.calls, budget.limits.cost_usd) != (None, None):
        for spec in ledger.models():  # also models without calls now: the limit is the whole run's
            for attempt in ledger.attempts(spec):
                budget.made_before(spec, attempt.reply)
    return budget


@dataclass(frozen=True, slots=True)
class CallOutcome:
    """A call's last reply, and whether it finishes the call; if not, a resumed run repeats it."""

    reply: Reply
    finished: bool


class Caller:
    """Makes the calls of a run in parallel, in one event loop and with one writer to its ledger.

    ``silent`` are kinds of transient failures that finish a call as the model's silence: a timeout
    at once, the others after the last attempt. Only a model with an answer in this ledger can be
    silent, and only while it is not set aside. ``again`` repeats finished calls. ``lacks`` returns
    what an unusable reply lacks, and "" for any other reply. Unusable replies finish their calls,
    and count as failures of the model.
    """

    def __init__(
        self,
        ledger: Ledger,
        budget: Budget,
        *,
        attempts: int = 5,
        silent: frozenset[str] = frozenset(),
        again: bool = False,
        lacks: Callable[[Reply], str] = lambda _: "",
    ) -> None:
        self._writer = _Writer(ledger, again=again)
        self._budget = budget
        self._attempts = attempts
        self._silent = silent
        self._lacks = lacks
        answered = (spec for spec in ledger.models() if any(one.error is None for _, one in ledger.replies(spec)))
        self._heard = set(answered)

    async def call(self, key: CallKey, query: Query, model: Model, pace: Pace) -> CallOutcome | None:
        """Make a call; return its result, or None where a limit prevents it.

        A transient error is retried with backoff. If the last reply is still such an error, the
        call is unfinished.
        """
        outcome = await self._attempt(key, query, model, pace)
        if outcome is not None:
            self._budget.ended(key.model, outcome.reply, self._lacks(outcome.reply))
        return outcome

    async def _attempt(self, key: CallKey, query: Query, model: Model, pace: Pace) -> CallOutcome | None:
        digest, made = query.sha256(), None
        for number in range(1, self._attempts + 1):
            entered = await pace.enter()
            if not await self._budget.turn(key.model):
                pace.leave(entered, _NOT_SENT)
                return made
            attempt = await self._writer.begin(key, digest)
            reply = self._settled(key.model, await ask(model, replace(query)), last=number == self._attempts)
            silence = self._is_silence(key.model, reply, last=number == self._attempts)
            await self._writer.close(attempt, reply, silence=silence)
            made = CallOutcome(reply, silence or reply.error not in UNFINISHED)
            pace.leave(entered, reply)
            self._budget.came(key.model, reply)
            if silence or reply.error not in TRANSIENT or key.model in self._budget.set_aside:
                break
            if number < self._attempts:
                await asyncio.sleep(pause_s(number, reply))
        return made

    def _settled(self, spec: str, reply: Reply, *, last: bool) -> Reply:
        """Return a reply; a filter's last one is a refusal by a model that has answered before."""
        if last and reply.error == "unreadable" and reply.finish_reason == BLOCKED and spec in self._heard:
            return replace(reply, error=None)
        return reply

    def _is_silence(self, spec: str, reply: Reply, *, last: bool) -> bool:
        if reply.error is None:
            self._heard.add(spec)
        if reply.error not in self._silent or spec not in self._heard or spec in self._budget.set_aside:
            return False
        return (last or reply.error == "timeout") and not is_asking_too_much(reply)


async def close(model: Model) -> None:
    """Close a model; a failure to close it does not affect the run."""
    with contextlib.suppress(Exception):
        async with asyncio.timeout(_CLOSING_S):
            await model.close()


def to_the_end(run: Coroutine[Any, Any, T]) -> T:
    """Return the result of a coroutine in an event loop of its own.

    Raises the first error inside exception groups, and SpecError where a loop is running already.
    """
    try:
        with contextlib.closing(run):
            require_no_loop()
            return asyncio.run(run)
    except asyncio.CancelledError:
        raise KeyboardInterrupt from None
    except BaseExceptionGroup as group:
        error: BaseException = group
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        raise error from None


class _Writer:
    """Writes the rows of a few turns of the event loop to the ledger, in one commit.

    A row is durable when its ``begin`` or ``close`` returns, as in the ledger itself.
    """

    _TURNS = 2
    """How many turns a commit waits for the rows of other calls: it halves the commits."""

    def __init__(self, ledger: Ledger, *, again: bool) -> None:
        self._ledger, self._again = ledger, again
        self._waiting: list[tuple[Callable[[], Attempt | None], asyncio.Future[Attempt | None]]] = []

    async def begin(self, key: CallKey, digest: str) -> Attempt:
        attempt = await self._soon(lambda: self._ledger.begin(key, digest, again=self._again))
        assert attempt is not None
        return attempt

    async def close(self, attempt: Attempt, reply: Reply, *, silence: bool) -> None:
        await self._soon(lambda: self._ledger.close(attempt, reply, silence=silence))

    def _soon(self, write: Callable[[], Attempt | None]) -> "asyncio.Future[Attempt | None]":
        loop = asyncio.get_running_loop()
        if not self._waiting:
            loop.call_soon(self._wait, loop, self._TURNS)
        written = loop.create_future()
        self._waiting.append((write, written))
        return written

    def _wait(self, loop: "asyncio.AbstractEventLoop", turns: int) -> None:
        """Write after so many turns of the event loop."""
        if turns:
            loop.call_soon(self._wait, loop, turns - 1)
        else:
            self._write()

    def _write(self) -> None:
        waiting, self._waiting = self._waiting, []
        try:
            with self._ledger.together():
                done = [write() for write, _ in waiting]
        except Exception as error:  # noqa: BLE001 - each waiting call must get it
            for _, written in waiting:
                if not written.done():
                    written.set_exception(error)
            return
        for (_, written), value in zip(waiting, done, strict=True):
            if not written.done():
                written.set_result(value)
