"""Queries that wait together and are answered in one call of a callable, each with its own reply."""

import asyncio
import errno
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeGuard

from eyechart.calls import Query, Reply
from eyechart.modes import in_one_line

WAIT_S = 0.01
"""A batch that is not full waits so long for a further query."""
MOST = 1024
"""The most queries in a call."""
SIZES = f"a whole number from 1 to {MOST}: it then takes and returns lists of so many or fewer"

Waiting = tuple[Query, "asyncio.Future[Reply]"]


class NotCalledError(Exception):
    """A call did not begin, because too many calls past their time limit still run."""


class NotEachError(Exception):
    """A call that several queries share failed, and does not say by which of them."""


@dataclass(slots=True)
class Batches:
    """Collects queries, at most ``most`` a call, and hands each the reply that is its own.

    ``call`` answers queries in their order. If it raises `NotEachError`, each is asked alone, so
    that a failure is the failure of the query that causes it. ``failed`` says why the last one did.
    """

    most: int
    call: Callable[[Sequence[Query]], Awaitable[Sequence[Reply]]]
    failed: str = field(default="", init=False)
    _waiting: list[Waiting] = field(default_factory=list)
    _under_way: "set[asyncio.Task[None]]" = field(default_factory=set)

    async def answer(self, query: Query) -> Reply:
        """Return the reply to one query, whichever others are in its batch."""
        reply: asyncio.Future[Reply] = asyncio.get_running_loop().create_future()
        self._waiting.append((query, reply))
        if len(self._waiting) >= self.most:
            self._begin()
        elif len(self._waiting) == 1:
            self._wait(self._waiting[0])
        return await reply

    def _wait(self, first: Waiting) -> None:
        """Begin the batch of its first query once no other joins it, unless it was full and has begun."""
        many = len(self._waiting)

        def over() -> None:
            if first in self._waiting:
                self._wait(first) if len(self._waiting) > many else self._begin()

        asyncio.get_running_loop().call_later(WAIT_S, over)

    def _begin(self) -> None:
        batch, self._waiting = self._waiting, []
        task = asyncio.get_running_loop().create_task(self._made(batch))
        self._under_way.add(task)
        task.add_done_callback(self._under_way.discard)

    async def _made(self, batch: Sequence[Waiting]) -> None:
        kept = [(query, reply) for query, reply in batch if not reply.done()]
        try:
            replies = await self._replies([query for query, _ in kept])
            answered = list(zip(kept, replies, strict=True))
        except Exception as error:  # noqa: BLE001 - each query that waits gets it
            for _, waiting in kept:
                if not waiting.done():
                    waiting.set_exception(error)
            return
        for (_, waiting), reply in answered:
            if not waiting.done():
                waiting.set_result(reply)

    async def _replies(self, queries: Sequence[Query]) -> Sequence[Reply]:
        try:
            return await self.call(queries) if queries else ()
        except NotEachError as error:
            self.failed = str(error)
            return [reply for query in queries for reply in await self.call([query])]


async def in_time(
    timeout_s: float, queries: Sequence[Query], answers: Awaitable[Sequence[Reply | Exception]]
) -> list[Reply]:
    """Return the replies of a call that several queries share, within so many times the limit.

    An exception of one query is its failed reply; so is one of the call, or its end by the limit.
    Raises NotEachError for an exception of a call of several.
    """
    most_s, count = timeout_s * len(queries), len(queries)
    try:
        async with asyncio.timeout(most_s) as limit:
            found = await answers
    except NotCalledError as error:
        return [Reply(error="not_called", error_detail=str(error))] * count
    except Exception as error:
        if isinstance(error, TimeoutError) and limit.expired():
            return [Reply(error="timeout", error_detail=f"no answer within {most_s:g} s")] * count
        if count > 1:
            raise NotEachError(in_one_line(error)) from error
        found = [error]
    return [raised(one) if isinstance(one, Exception) else one for one in found]


def raised(error: Exception, most: int = 500) -> Reply:
    """Return the failed reply of a call that raised; a lack of file descriptors here may pass."""
    passes = isinstance(error, OSError) and error.errno in {errno.EMFILE, errno.ENFILE}
    return Reply(error="connection" if passes else "exception", error_detail=in_one_line(error, most))


def is_size(declared: object) -> TypeGuard[int | None]:
    """Return whether a callable may declare this as the size of its batches; None stands for none."""
    whole = isinstance(declared, int) and not isinstance(declared, bool) and 1 <= declared <= MOST
    return declared is None or whole


def at_once(facts: Mapping[str, str], concurrency: int) -> int:
    """Return how many calls of a model are open at once, so that its batches are full."""
    return max(concurrency, int(facts.get("batch", 1)))
