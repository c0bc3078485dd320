"""A served guardian answers as the table of reply classes allows, while hostile clients ask and members misbehave."""

import asyncio
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from eyechart.calls import Reply
from eyechart.guardian import Guardian
from eyechart.serve.lifecycle import serve
from eyechart.serve.server import ServerLimits
from eyechart.spaces.scene import SCENES
from eyechart.studies.guardian import Vote, write_frozen

FOLDER = Path(__file__).parents[1] / "benchmarks"
SECONDS, RATE, DEADLINE_S = 3.0, 40, 3.0


@pytest.fixture(scope="module")
def hostile() -> Iterator[ModuleType]:
    """Return the benchmark's module, of which this is the short form."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sys, "path", list(sys.path))
        spec = importlib.util.spec_from_file_location("hostile_serve", FOLDER / "hostile_serve.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        patched.setitem(sys.modules, "hostile_serve", module)
        spec.loader.exec_module(module)
        yield module


def offered(hostile: ModuleType, folder: Path, *, seconds: float) -> dict[str, object]:
    """Serve for some seconds, and return what was judged."""

    async def run() -> dict[str, object]:
        members, address = await hostile.members()
        path = folder / "guardian.json"
        write_frozen(path, hostile.bench_serve.frozen([address, address]))
        found: list[dict[str, object]] = []
        started: asyncio.Future[str] = asyncio.get_running_loop().create_future()

        async def until() -> None:
            outcomes = await hostile.offer(await started, seconds=seconds, rate=RATE, deadline_s=DEADLINE_S)
            found.append(hostile.judged(outcomes, deadline_s=DEADLINE_S, grace_s=10.0))

        limits = ServerLimits(concurrency=16, queue=100, most_bytes=hostile.bench_serve.MOST_BYTES)
        with Guardian.load(path, deadline_s=DEADLINE_S) as guardian:
            await serve(guardian, port=0, limits=limits, started=started.set_result, until=until)
        await members.cleanup()
        return found[0]

    return asyncio.run(run())


def test_nothing_is_answered_that_the_table_does_not_allow(hostile: ModuleType, tmp_path: Path) -> None:
    """Over HTTP on both sides; all kinds of requests are refused as they should, and all three answers are given."""
    found = offered(hostile, tmp_path, seconds=SECONDS)
    assert found["wrong"] == [], found
    assert found["clear_not_allowed"] == 0
    assert set(found["answers"]) == {"clear", "hazard", "abstain"}  # type: ignore[arg-type]


def test_a_guardian_that_guesses_is_found_out(
    hostile: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that takes every estimate for a vote, as was done before, says clear where the table does not allow it."""

    def guessed(reply: Reply, close_m: float) -> Vote:
        del close_m
        found = SCENES.read(reply).action
        return Vote(None, "no estimate") if found is None else Vote(found.close)

    monkeypatch.setattr("eyechart.guardian.interface.read_vote", guessed)
    found = offered(hostile, tmp_path, seconds=1.5)
    assert int(str(found["clear_not_allowed"])) > 0
    assert any("and abstain is allowed" in line for line in found["wrong"])  # type: ignore[attr-defined]


def test_parts_are_added_to_one_result(hostile: ModuleType) -> None:
    """Counts are added, of times the worst stands, and what was wrong is kept."""
    one = hostile.judged([hostile.Outcome("good", 500, 0.1, 7), hostile.Outcome("other host", 421, 0.1)])
    two = hostile.judged([hostile.Outcome("good", 200, 9.0, 7, hostile.expected(7))])
    both = hostile.total([one, two])
    assert (both["requests"], both["answered"], both["p99_s"]) == (3, 1, 9.0)
    assert both["wrong"] == ["good got 500", "good took 9.00 s"]
    assert both["counts"] == {"good 200": 1, "good 500": 1, "other host 421": 1}
