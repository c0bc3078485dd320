"""A clock that goes back, stands at 1970 or jumps while a run is on loses no call and changes no result."""

import itertools
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from banks import build_bank
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.ledger.counter import NOTHING
from eyechart.studies import battery

MODEL = "scripted:depth"
_HOUR = 3_600_000_000_000


def backwards(now: int) -> Iterator[int]:
    """Yield an hour less each time, in nanoseconds."""
    return itertools.count(now, -_HOUR)


def jumping(now: int) -> Iterator[int]:
    """Yield a day more and a day less in turn."""
    return (now + (24 if turn % 2 else -24) * _HOUR for turn in itertools.count())


def dead(now: int) -> Iterator[int]:
    """Yield the first second of 1970: a machine whose clock has no battery."""
    del now
    return itertools.repeat(0)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small bank."""
    return build_bank(tmp_path_factory.mktemp("bank") / "bank", drawn=False)


@pytest.mark.parametrize("clock", [backwards, jumping, dead])
def test_a_clock_that_is_wrong_changes_no_result(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: Callable[[int], Iterator[int]]
) -> None:
    """A run that is begun, stopped and resumed under it answers, and is scored, as under a clock that goes right."""
    battery.run(battery.plan(bank.root, [MODEL], tmp_path / "right"))
    with monkeypatch.context() as wrong:
        looks = clock(time.time_ns())
        wrong.setattr(time, "time_ns", lambda: next(looks))
        wrong.setattr(time, "time", lambda: next(looks) / 1e9)
        few = battery.plan(bank.root, [MODEL], tmp_path / "wrong", extent=battery.BatterySelection(limit=6))
        battery.run(few)
        outcome = battery.run(battery.plan(bank.root, [MODEL], tmp_path / "wrong"))
        assert (outcome.stopped, dict(outcome.set_aside)) == (None, {})
    right, found = (battery.score(tmp_path / name).as_dict() for name in ("right", "wrong"))
    assert {**found, "accounting": None, "guards": None} == {**right, "accounting": None, "guards": None}
    with Ledger(tmp_path / "right" / "ledger.sqlite") as one, Ledger(tmp_path / "wrong" / "ledger.sqlite") as other:
        assert one.finished() == other.finished()
        assert other.missing == NOTHING
    guards = {guard.name: guard.holds for guard in battery.score(tmp_path / "wrong").guards[MODEL]}
    assert guards["outcomes"] is True
