"""Models of the Transformers library, run here: any image-text-to-text checkpoint of the Hub or of a folder.

Queries that arrive together are answered together, in one call of ``generate``, in a thread of its own so that the
event loop lives on. What stands beside a query in its batch has no say in its answer: prompts are padded on the left,
answers are the likeliest tokens, or drawn from the query's own seed.
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
from eyechart.models.huggingface.generation import Speaker
from eyechart.models.huggingface.organisms import ORGANISMS
from eyechart.modes import RequestMode

_LINGER_S = 0.01
"""How long a batch that is not full waits for one more query."""

_Waiting = tuple[Query, asyncio.Future[Reply]]


class HuggingFaceModel:
    """A checkpoint behind the door of a model: one queue, one thread, as many queries at once as ``batch`` allows.

    ``version`` is the Hub's commit, or the digest of a folder's files. Weights are loaded with the first query and
    let go by ``close``.
    """

    def __init__(self, checkpoint: Checkpoint, mode: RequestMode) -> None:
        self.version = checkpoint.version
        self.facts: Mapping[str, str] = checkpoint.facts
        self._batch = checkpoint.batch
        self._speaker = Speaker(checkpoint, mode)
        self._waiting: deque[_Waiting] = deque()
        self._turn: asyncio.Task[None] | None = None
        self._thread: ThreadPoolExecutor | None = None

    async def answer(self, query: Query) -> Reply:
        """Answer one query, in a batch with those that wait beside it; a failure is a Reply."""
        return await metered(self._queue(query))

    async def _queue(self, query: Query) -> Reply:
        loop = asyncio.get_running_loop()
        future: asyncio.Future[Reply] = loop.create_future()
        self._waiting.append((query, future))
        if self._turn is None or self._turn.done() or self._turn.get_loop() is not loop:
            self._turn = loop.create_task(self._take_turns())
        return await future

    async def close(self) -> None:
        """Let the weights go; a later query loads them anew."""
        if self._turn is not None and self._turn.get_loop() is asyncio.get_running_loop():
            self._turn.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._turn
        self._turn = None
        if self._thread is not None:
            await asyncio.get_running_loop().run_in_executor(self._thread, self._speaker.forget)
            self._thread.shutdown()
            self._thread = None

    async def _take_turns(self) -> None:
        """Answer what waits, batch after batch, until nothing does."""
        loop = asyncio.get_running_loop()
        self._thread = self._thread or ThreadPoolExecutor(1, thread_name_prefix="hf")
        try:
            while self._waiting:
                await self._gather()
                batch = self._next_batch()
                if not batch:
                    continue
                replies = await loop.run_in_executor(self._thread, self._speaker.answer, [query for query, _ in batch])
                for (_, future), reply in zip(batch, replies, strict=True):
                    if not future.done():
                        future.set_result(reply)
        finally:
            for _, future in self._waiting:
                future.cancel()
            self._waiting.clear()

    async def _gather(self) -> None:
        """Wait while more queries arrive, up to a full batch."""
        seen = 0
        while seen < len(self._waiting) < self._batch:
            seen = len(self._waiting)
            await asyncio.sleep(_LINGER_S)

    def _next_batch(self) -> list[_Waiting]:
        """Take the oldest query and those like it: with a picture, or without one."""
        waiting = [one for one in self._waiting if not one[1].done()]
        batch = [one for one in waiting if (one[0].image is None) == (waiting[0][0].image is None)][: self._batch]
        taken = {id(future) for _, future in batch}
        self._waiting = deque(one for one in waiting if id(one[1]) not in taken)
        return batch


def open_model(name: str, mode: RequestMode) -> HuggingFaceModel:
    """Open a checkpoint: ``organism:NAME``, a folder, or an id of the Hub; its weights are loaded later.

    Raises SpecError where it is not there, has no image slot in its chat template, or is asked for what it cannot do.
    """
    require_options(mode, OPTIONS)
    for field, given in (("structured", mode.structured != "none"), ("body", mode.body), ("base_url", mode.base_url)):
        if given:
            raise SpecError(f"'{mode.spec}' runs here and cannot bind '{field}'; leave it out")
    return HuggingFaceModel(find(name, mode), mode)


def names() -> dict[str, str]:
    """Return what may stand after ``hf:``: the organisms, the paper's edge models, and the two other ways."""
    return {
        **{f"organism:{name}": one.says for name, one in ORGANISMS.items()},
        **list_edge(),
        "FOLDER": "any image-text-to-text checkpoint on this machine",
        "OWNER/NAME": "any image-text-to-text checkpoint of the Hub",
    }
