"""Local models of the Transformers library: image-text-to-text checkpoints of the Hub or a folder.

Queries that arrive together share one call of ``generate``, in a thread of its own, which leaves
the event loop free. The other queries of a batch do not change an answer. Prompts are padded on the
left, and tokens are the likeliest ones, or drawn from the query's own seed.
"""

import asyncio
import contextlib
from collections import deque
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

from eyechart.calls import Query, Reply
from eyechart.errors import SpecError
from eyechart.models import require_options
from eyechart.models.energy import metered
from eyechart.models.huggingface.checkpoint import OPTIONS, Checkpoint, find, list_edge
from eyechart.models.huggingface.generation import TextGenerator
from eyechart.models.huggingface.organisms import ORGANISMS, SAYS
from eyechart.modes import RequestMode

_LINGER_S = 0.01
"""The wait for another query while a batch is not full, in seconds."""

_NOT_HERE = ("structured", "body", "base_url", "headers", "key_env")
"""Fields of a mode that have no effect on a local checkpoint."""

_HOW = ", with temperature default"

_Waiting = tuple[Query, asyncio.Future[Reply]]


class HuggingFaceModel:
    """A checkpoint as a model, with one queue and batches of up to ``batch`` queries.

    While one thread generates a batch, another prepares the next batch's pictures and text.
    ``version`` is the Hub's commit, or the digest of a folder's files. The first query loads the
    weights, and ``close`` frees them.
    """

    def __init__(self, checkpoint: Checkpoint, mode: RequestMode) -> None:
        self.version = checkpoint.version
        self.facts: Mapping[str, str] = checkpoint.facts
        self._batch = checkpoint.batch
        self._speaker = TextGenerator(checkpoint, mode)
        self._waiting: deque[_Waiting] = deque()
        self._open: set[asyncio.Future[Reply]] = set()
        self._turns: asyncio.Task[None] | None = None
        self._threads: tuple[ThreadPoolExecutor, ThreadPoolExecutor] | None = None

    async def answer(self, query: Query) -> Reply:
        """Answer one query, in a batch with others that wait; a failure is a Reply."""
        return await metered(self._queue(query))

    async def close(self) -> None:
        """Free the weights; a later query loads them again."""
        loop = asyncio.get_running_loop()
        if self._turns is not None and self._turns.get_loop() is loop:
            self._turns.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._turns
        self._turns = None
        if self._threads is not None:
            preparing, generating = self._threads
            await loop.run_in_executor(generating, self._speaker.forget)
            preparing.shutdown()
            generating.shutdown()
            self._threads = None

    async def _queue(self, query: Query) -> Reply:
        loop = asyncio.get_running_loop()
        future: asyncio.Future[Reply] = loop.create_future()
        self._open.add(future)
        future.add_done_callback(self._open.discard)
        self._waiting.append((query, future))
        if self._turns is None or self._turns.done() or self._turns.get_loop() is not loop:
            self._turns = loop.create_task(self._take_turns())
        return await future

    async def _take_turns(self) -> None:
        """Answer the waiting queries, batch after batch, until none is left."""
        loop = asyncio.get_running_loop()
        if self._threads is None:
            self._threads = (ThreadPoolExecutor(1, "hf-prepares"), ThreadPoolExecutor(1, "hf-generates"))
        preparing, generating = self._threads
        busy: asyncio.Task[None] | None = None
        try:
            while self._waiting or not _is_over(busy):
                await self._gather(busy)
                batch = self._next_batch()
                if batch:
                    queries = [query for query, _ in batch]
                    inputs = await loop.run_in_executor(preparing, self._speaker.prepare, queries)
                    if busy is not None:
                        await busy
                    busy = loop.create_task(self._speak(batch, inputs, generating))
        finally:
            if busy is not None:
                busy.cancel()
            self._waiting.clear()
            for future in tuple(self._open):
                future.cancel()

    async def _speak(self, batch: list[_Waiting], inputs: object, thread: ThreadPoolExecutor) -> None:
        loop, queries = asyncio.get_running_loop(), [query for query, _ in batch]
        replies = await loop.run_in_executor(thread, self._speaker.answer, queries, inputs)
        for (_, future), reply in zip(batch, replies, strict=True):
            if not future.done():
                future.set_result(reply)

    async def _gather(self, busy: asyncio.Task[None] | None) -> None:
        """Wait for a full batch while another one is generated, then while queries arrive."""
        seen = 0
        while len(self._waiting) < self._batch and (not _is_over(busy) or seen < len(self._waiting)):
            seen = len(self._waiting)
            await asyncio.sleep(_LINGER_S)

    def _next_batch(self) -> list[_Waiting]:
        """Take the oldest query and those with the same count of pictures."""
        waiting = [one for one in self._waiting if not one[1].done()]
        batch = [one for one in waiting if len(one[0].pictures) == len(waiting[0][0].pictures)][: self._batch]
        taken = {id(future) for _, future in batch}
        self._waiting = deque(one for one in waiting if id(one[1]) not in taken)
        return batch


def _is_over(task: asyncio.Task[None] | None) -> bool:
    return task is None or task.done()


def open_model(name: str, mode: RequestMode) -> HuggingFaceModel:
    """Open a checkpoint: ``organism:NAME``, a folder, or an id of the Hub; its weights load later.

    Raises SpecError where it is missing, has no image slot, or does not fit the mode.
    """
    require_options(mode, OPTIONS)
    for field in _NOT_HERE:
        if getattr(mode, field) != getattr(RequestMode(mode.spec), field):
            raise SpecError(f"'{mode.spec}' runs on this machine, where '{field}' has no effect: leave it out")
    return HuggingFaceModel(find(name, mode), mode)


def names() -> dict[str, str]:
    """Return the names after ``hf:``: organisms, the paper's edge models, a folder, a Hub id."""
    return {
        **{f"organism:{name}": says for name, says in SAYS.items()},
        **{
            f"organism:{name}": SAYS[name] + _HOW
            for name, organism in ORGANISMS.items()
            if organism.sampled and name in SAYS
        },
        **list_edge(),
        "FOLDER": "any image-text-to-text checkpoint on this machine",
        "OWNER/NAME": "any image-text-to-text checkpoint of the Hub",
    }
