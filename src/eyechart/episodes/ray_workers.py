"""Workers on a Ray cluster: sets of worlds as actors, spread over the nodes (extra ``ray``)."""

import logging
import os

from eyechart.episodes.workers import WorkerDiedError
from eyechart.episodes.worlds import Setup, Worlds
from eyechart.errors import EyechartError, SpecError, raising
from eyechart.event_loops import asyncio


class RayWorker:
    """An actor on one of the nodes in turn.

    It claims no processor, because an actor that waits for a free one would hang the run. The user
    chooses the number of actors.
    """

    def __init__(self, setup: Setup) -> None:
        import ray  # noqa: PLC0415 - an extra

        self.dead = False
        self._ray = ray
        self._turn = asyncio.Lock()
        self._actor = ray.remote(num_cpus=0, max_restarts=0, scheduling_strategy="SPREAD")(_WorldActor).remote(setup)

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
            return "failed", f"{type(error).__name__}: {error}"


def join() -> None:
    """Join the cluster of ``RAY_ADDRESS``.

    eyechart starts no cluster: Ray's servers listen on every address of a machine, which is its
    owner's decision. Raises SpecError if Ray is not installed, no cluster is named, or none
    answers.
    """
    try:
        import ray  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise SpecError("--engine ray needs Ray: pip install 'eyechart[ray]'") from error
    if not ray.is_initialized():
        address = os.environ.get("RAY_ADDRESS")
        if not address:
            raise SpecError(
                "--engine ray joins a Ray cluster: name it in RAY_ADDRESS, as HOST:PORT, or 'auto' on a node"
            )
        with raising(SpecError, f"no Ray cluster answers at {address}", of=(ConnectionError, ValueError, RuntimeError)):
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
