"""Where an event loop is running already, as in a notebook: what works there, and what says that it does not."""

import asyncio
from pathlib import Path

import pytest

from eyechart.attempts import to_the_end
from eyechart.errors import SpecError
from eyechart.event_loops import has_running_loop, in_own_loop
from eyechart.limits import RunOutcome
from eyechart.simulators import open_bank_simulator
from eyechart.studies import policy


async def seven() -> int:
    """Return what a run comes to."""
    return 7


def test_a_run_of_policies_works_inside_of_a_loop(tmp_path: Path) -> None:
    """With the same answers as outside, and the progress is told."""
    bank = open_bank_simulator("tabletop").build(tmp_path / "bank", seeds=(0,), steps=4)
    asked, moves = ("real", "swapped@cameras"), list[tuple[int, int]]()

    def planned(name: str) -> policy.PolicyRun:
        return policy.plan(bank.root, ["trained:sees"], tmp_path / name, conditions=asked)

    async def cell() -> RunOutcome:
        return policy.run(planned("inside"), progress=lambda *move: moves.append(move))

    assert asyncio.run(cell()).set_aside == {}
    policy.run(planned("outside"))
    inside, outside = (policy.score(tmp_path / name).as_dict()["policies"] for name in ("inside", "outside"))
    assert inside == outside
    assert moves[-1] == (32, 32)


def test_what_needs_a_loop_of_its_own_says_so() -> None:
    """In words that name what works, and no traceback of asyncio; outside it runs."""

    async def cell() -> int:
        assert has_running_loop()
        return to_the_end(seven())

    with pytest.raises(SpecError, match=r"as in a notebook.*asyncio.to_thread.*run_battery.*studies.policy.run"):
        asyncio.run(cell())
    assert to_the_end(seven()) == 7
    assert not has_running_loop()


def test_a_call_with_a_loop_of_its_own_works_inside_of_another() -> None:
    """In a thread."""

    async def cell() -> int:
        return in_own_loop(seven())

    assert asyncio.run(cell()) == in_own_loop(seven()) == 7
