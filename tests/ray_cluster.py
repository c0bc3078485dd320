"""A Ray cluster of two local nodes, as a user has one: named in RAY_ADDRESS."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

MARK = "EYECHART_TEST_CLUSTER"
"""The variable by which the processes of this cluster are known among those of others."""
WORKERS = (b"_ModelActor", b"_WorldActor", b"attempted")
"""How Ray names the processes that hold models and worlds, and those at a task of ours."""


def workers_there() -> list[int]:
    """Return the processes of this cluster that work for a command of ours."""
    found, mark = [], f"{MARK}={os.getpid()}".encode()
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended
            said = (folder / "cmdline").read_bytes()
            named = said.startswith(b"ray::") and any(one in said for one in WORKERS)
            if named and mark in (folder / "environ").read_bytes().split(b"\0"):
                found.append(int(folder.name))
    return found


def workers_after(seconds: float) -> list[int]:
    """Return those that still live after so many seconds; it waits no longer than needed."""
    deadline = time.monotonic() + seconds
    while (left := workers_there()) and time.monotonic() < deadline:
        time.sleep(0.1)
    return left


@contextmanager
def two_nodes() -> Iterator[None]:
    """Start two nodes of one processor each on this machine; they import what stands beside this file."""
    import ray  # noqa: PLC0415 - an extra
    from ray.cluster_utils import Cluster  # noqa: PLC0415

    with pytest.MonkeyPatch.context() as patch:
        here = (str(Path(__file__).parent), os.environ.get("PYTHONPATH", ""))
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, here)))
        patch.setenv("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        patch.setenv("RAY_worker_niceness", "0")  # else they wait for everybody on a busy machine
        patch.setenv(MARK, str(os.getpid()))
        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
        cluster.add_node(num_cpus=1)
        cluster.wait_for_nodes()
        patch.setenv("RAY_ADDRESS", cluster.address)
        yield
        ray.shutdown()
        cluster.shutdown()
