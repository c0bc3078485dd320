"""Workers on a Ray cluster: sets of worlds as actors, spread over the nodes (extra ``ray``)."""

import asyncio

from eyechart.clusters import actor, join
from eyechart.episodes.workers import WorkerDiedError
from eyechart.episodes.worlds import Setup, Worlds
from eyechart.errors import EyechartError
from eyechart.modes import in_one_line


class RayWorker:
    """An actor on one of the nodes in turn."""

    def __init__(self, setup: Setup) -> None:
        self.dead = False
        self._ray = join()
        self._turn = asyncio.Lock()
        self._actor = actor(_WorldActor, setup)

    async def ask(self, method: str, *given: object) -> object:
        """Call a method of the worlds; calls run one after another."""
        async with self._turn:
            try:
                kind, value = await self._actor.answer.remote(method, given)
            except self._ray.exceptions.RayActorError as error:
                self.dead = True
                raise WorkerDiedError(f"its actor died: {str(error).splitlines()[0]}") from error
        if kind == "failed":
            raise EyechartError(str(value))
        return value

    def close(self) -> None:
        """Kill the actor; its worlds can be made again."""
        self.dead = True
        self._ray.kill(self._actor)


class _WorldActor:
    """The worlds on a node, with a method that calls theirs."""

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._worlds: Worlds | None = None

    def answer(self, method: str, given: tuple[object, ...]) -> tuple[str, object]:
        """Return the result of a method of the worlds, or its error in words."""
        try:
            self._worlds = self._worlds or Worlds(self._setup)
            return "ok", getattr(self._worlds, method)(*given)
        except Exception as error:  # noqa: BLE001 - the coordinator needs every error as words
            return "failed", in_one_line(error, 2000)
