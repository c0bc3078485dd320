"""A Ray cluster of the user's (extra ``ray``): joined, never started; actors and tasks on its nodes."""

import logging
import os
import socket
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from eyechart.errors import EyechartError, SpecError, printable, raising, suggestion
from eyechart.processes import open_pool

ENGINES = ("local", "ray")
"""Where a run's work is done: on this machine, or on a cluster."""

_REACHED_S = 10.0
"""The longest time in seconds in which a cluster's address must take a connection."""

T = TypeVar("T")


def require_engine(engine: str) -> None:
    """Raise SpecError for an unknown engine, or a cluster that does not answer."""
    if engine not in ENGINES:
        raise SpecError(f"unknown engine '{engine}'; known are {', '.join(ENGINES)}{suggestion(engine, ENGINES)}")
    if engine == "ray":
        join()


def join() -> Any:  # noqa: ANN401 - the module of an extra
    """Join the cluster of ``RAY_ADDRESS``, and return the module ``ray``.

    eyechart starts no cluster: Ray's servers listen on every address of a machine, which is its
    owner's decision. Raises SpecError if Ray is not installed, no cluster is named, or none
    answers.
    """
    os.environ.setdefault(
        "RAY_NUM_REDIS_GET_RETRIES", "1"
    )  # of 20, it asks what is no cluster for a quarter of an hour
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
        _require_there(address)
        with raising(SpecError, f"no Ray cluster answers at {address}", of=(ConnectionError, ValueError, RuntimeError)):
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    return ray


def _require_there(address: str) -> None:
    """Raise SpecError for an address that begins a cluster, or at which nothing answers.

    Ray itself tries a dead address for minutes.
    """
    if address == "local":
        raise SpecError(
            "RAY_ADDRESS=local begins a cluster, and eyechart begins none: name one as HOST:PORT, or 'auto' on a node"
        )
    host, _, port = address.rpartition(":")
    if host and "/" not in address and port.isdigit():
        with raising(SpecError, f"no Ray cluster answers at {address}"):
            socket.create_connection((host.strip("[]"), int(port)), timeout=_REACHED_S).close()


def actor(kind: type[Any], *given: object, gpus: float = 0.0) -> Any:  # noqa: ANN401 - a handle of Ray
    """Return a new actor of a class, on one of the nodes in turn.

    It claims no processor, because an actor that waits for a free one would hang the run. The user
    chooses the number of actors. It claims ``gpus``, a share of one or several.
    """
    ray = join()
    how = {"num_cpus": 0, "max_restarts": 0, "scheduling_strategy": "SPREAD"}
    return ray.remote(**how, **({"num_gpus": gpus} if gpus else {}))(kind).remote(*given)


def require_gpus(wanted: float) -> None:
    """Raise SpecError if the nodes together have fewer GPUs; actors would wait for them for ever."""
    there = float(join().cluster_resources().get("GPU", 0.0))
    if wanted > there:
        raise SpecError(
            f"the workers claim {wanted:g} GPUs, and the cluster has {there:g}: give fewer --workers or a smaller "
            "share as --gpus"
        )


@dataclass(frozen=True, slots=True)
class Workers:
    """So many processes of this machine, or as many tasks at a time on a cluster."""

    count: int
    engine: str = "local"

    @contextmanager
    def mapped(self, work: Callable[[Any], T], tasks: Sequence[object]) -> Iterator[Iterator[T]]:
        """Yield the results of tasks in their order."""
        if self.engine == "ray":
            yield _on_nodes(work, tasks, self.count)
        elif self.count == 1:
            yield map(work, tasks)
        else:
            with open_pool(self.count) as pool:
                yield pool.map(work, tasks)


def _on_nodes(work: Callable[[Any], T], tasks: Iterable[object], workers: int) -> Iterator[T]:
    """Yield the results of tasks in their order, with twice ``workers`` of them under way.

    A task that loses its worker is made again on another. Raises EyechartError with the words of a
    task's own error, or of its worker's loss.
    """
    ray = join()

    def attempted(task: object) -> tuple[str, object]:
        try:
            return "ok", work(task)
        except Exception as error:  # noqa: BLE001 - the caller needs every error as words
            return "failed", printable(f"{type(error).__name__}: {error}")

    remote = ray.remote(num_cpus=1, max_retries=5, scheduling_strategy="SPREAD")(attempted)
    under_way: deque[Any] = deque()
    left = iter(tasks)
    try:
        while True:
            while len(under_way) < 2 * workers and (task := next(left, None)) is not None:
                under_way.append(remote.remote(task))
            if not under_way:
                return
            with raising(EyechartError, "a task on the cluster was lost", of=ray.exceptions.RayError):
                kind, value = ray.get(under_way.popleft())
            if kind == "failed":
                raise EyechartError(str(value))
            yield value
    finally:
        for one in under_way:
            ray.cancel(one, force=True)
