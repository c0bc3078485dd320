"""Models held by actors on a Ray cluster: the coordinator plans and records, the actors answer."""

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from eyechart.calls import Query, Reply
from eyechart.clusters import actor, join, require_gpus
from eyechart.errors import SpecError
from eyechart.models import Model, ask, open_model
from eyechart.models.batches import Batches
from eyechart.modes import RequestMode, in_one_line

if TYPE_CHECKING:
    from concurrent.futures import Future

OPENING_S = 600.0
"""The longest time in seconds in which the actors of a model must have opened it."""


@dataclass(frozen=True, slots=True)
class ActorPool:
    """The actors of each model: their number, and the GPUs that each claims."""

    count: int = 1
    gpus: float = 0.0

    def __post_init__(self) -> None:
        if self.count < 1 or self.gpus < 0:
            raise SpecError(f"give 1 or more --workers and 0 or more --gpus, not {self.count} and {self.gpus:g}")

    def hold(
        self, models: Mapping[str, Model], modes: Mapping[str, RequestMode], answering: str
    ) -> dict[str, "PooledModel"]:
        """Return the models as actors hold them, each opened there with the version that it has here.

        Raises SpecError where the cluster lacks GPUs, or an actor cannot open the same model.
        """
        require_gpus(self.count * self.gpus * len(models))
        held = {
            spec: PooledModel(modes[spec], answering, model.version, dict(model.facts), self)
            for spec, model in models.items()
        }
        try:
            for one in held.values():
                one.open()
        except BaseException:
            for one in held.values():
                one.end()
            raise
        return held


class PooledModel:
    """A model that actors hold; a query goes to the one with the fewest under way.

    Queries of a model with a ``batch`` are collected here, and each batch goes to one actor whole.
    The ``batch`` in its facts is that of all actors, so that a run opens enough calls. An actor
    that dies costs the calls that it had under way: they are attempts that failed, and the run
    makes them again on a new actor. Until that one has opened the model, calls go to the others.
    If no actor has opened it in `OPENING_S`, as where the GPUs went with a node, the model counts
    as missing.
    """

    def __init__(
        self, mode: RequestMode, answering: str, version: str, facts: dict[str, str], workers: ActorPool
    ) -> None:
        batch = int(facts.get("batch", 0))
        self.version = version
        self.facts: Mapping[str, str] = facts | ({"batch": str(batch * workers.count)} if batch else {})
        self._batches = Batches(batch, self._replies) if batch else None
        self._mode, self._answering, self._workers = mode, answering, workers
        self._actors: list[_PooledActor] = []

    def open(self) -> None:
        """Open the model in every actor; raises SpecError where that fails, or it is another version."""
        ray = join()
        self._start()
        for one in self._actors:
            try:
                found = one.version.result(timeout=OPENING_S)
            except TimeoutError as error:
                raise SpecError(f"{self._unopened}: do other jobs hold its GPUs?") from error
            except ray.exceptions.RayError as error:
                raise SpecError(f"a worker of the cluster did not open {self._mode.spec}: {_first(error)}") from error
            if found != self.version:
                raise SpecError(
                    f"a worker of the cluster has {self._mode.spec} as {found}, and this machine as {self.version}: "
                    "all nodes need the same files and the same eyechart"
                )

    @property
    def _unopened(self) -> str:
        return f"no node of the cluster opened {self._mode.spec} in a worker within {OPENING_S:g} s"

    async def answer(self, query: Query) -> Reply:
        """Answer one query by an actor; an actor's death is a failure that may pass."""
        return (await self._replies([query]))[0] if self._batches is None else await self._batches.answer(query)

    async def _replies(self, queries: Sequence[Query]) -> Sequence[Reply]:
        """Answer queries by one actor, as a batch of its model."""
        self._start()
        one = min(self._actors, key=lambda each: (not each.is_open, each.under_way))
        one.under_way += len(queries)
        ray = join()
        try:
            if not one.is_open:
                await asyncio.wait_for(asyncio.shield(asyncio.wrap_future(one.version)), OPENING_S)
            replies: Sequence[Reply] = await one.handle.answer.remote(queries)
        except TimeoutError:
            return [Reply(error="missing_model", error_detail=self._unopened)] * len(queries)
        except ray.exceptions.RayError as error:
            if one in self._actors:  # the first call that it fails replaces it
                self._actors[self._actors.index(one)] = self._new()
            return [Reply(error="server_error", error_detail=f"its worker was lost: {_first(error)}")] * len(queries)
        finally:
            one.under_way -= len(queries)
        return replies

    async def close(self) -> None:
        """End the actors; the next call starts new ones."""
        self.end()

    def _start(self) -> None:
        while len(self._actors) < self._workers.count:
            self._actors.append(self._new())

    def _new(self) -> "_PooledActor":
        given = (self._mode, self._answering, self.version)
        made = actor(_ModelActor, *given, gpus=self._workers.gpus)
        return _PooledActor(made, made.version.remote().future())

    def end(self) -> None:
        """End the actors."""
        ray = join()
        while self._actors:
            ray.kill(self._actors.pop().handle)


@dataclass(eq=False, slots=True)
class _PooledActor:
    """An actor, the version that it will say once it has opened its model, and its calls under way."""

    handle: Any
    version: "Future[str]"
    under_way: int = field(default=0)

    @property
    def is_open(self) -> bool:
        """Return whether it has opened its model, or died."""
        return self.version.done()


class _ModelActor:
    """A model on a node; its calls run in one event loop, so that those of a batch are one."""

    def __init__(self, mode: RequestMode, answering: str, version: str) -> None:
        self._mode, self._answering, self._version = mode, answering, version
        self._model: Model | None = None

    def _opened(self) -> Model:
        if self._model is None:
            self._model = open_model(self._mode.spec, self._mode, answering=self._answering)
        return self._model

    async def version(self) -> str:
        """Return the version of the model on this node, or why it cannot be opened."""
        try:
            return self._opened().version
        except Exception as error:  # noqa: BLE001 - it is told where the run was started
            return in_one_line(error)

    async def answer(self, queries: Sequence[Query]) -> Sequence[Reply]:
        """Answer queries at once."""
        try:
            model = self._opened()
        except Exception as error:  # noqa: BLE001 - it is a row, not the end of the run
            failed = Reply(error="missing_model", error_detail=in_one_line(error))
            return [failed] * len(queries)
        if model.version != self._version:
            failed = Reply(error="missing_model", error_detail=f"this node has version {model.version}")
            return [failed] * len(queries)
        return await asyncio.gather(*(ask(model, query) for query in queries))


def _first(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
