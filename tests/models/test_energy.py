import asyncio
from pathlib import Path

import pytest

from eyechart.calls import Reply
from eyechart.models.energy import Meter, metered, processor_counters


class Counter:
    """A counter of joules that a test turns."""

    def __init__(self) -> None:
        """Begin somewhere."""
        self.joules = 1000.0

    def __call__(self) -> float:
        """Return the joules so far."""
        return self.joules


def test_calls_share_what_is_drawn_while_they_are_under_way() -> None:
    """Alone a call gets all of it, two get half each; the shares add up to the whole."""
    gpu, cpu = Counter(), Counter()
    meter = Meter((gpu, cpu))
    first = meter.begin()
    gpu.joules += 10
    second = meter.begin()
    gpu.joules += 4
    cpu.joules += 2
    assert meter.end(first) == pytest.approx(10 + 3)
    cpu.joules += 5
    assert meter.end(second) == pytest.approx(3 + 5)


def test_what_cannot_be_measured_throughout_is_not_measured() -> None:
    """No counter, a counter that fails meanwhile, and one that runs backwards."""
    nothing = Meter(())
    assert nothing.end(nothing.begin()) is None

    gone = Counter()
    meter = Meter((gone,))
    ticket = meter.begin()
    meter.counters = (lambda: 1 / 0,)
    assert meter.end(ticket) is None
    meter = Meter((gone,))
    ticket = meter.begin()
    gone.joules -= 500
    assert meter.end(ticket) is None


def test_a_metered_call_is_its_reply_with_the_energy() -> None:
    """A call that raises leaves the meter whole."""
    counter = Counter()
    meter = Meter((counter,))

    async def answer() -> Reply:
        counter.joules += 7
        return Reply("SLOW")

    async def fail() -> Reply:
        raise RuntimeError("no")

    assert asyncio.run(metered(answer(), meter)) == Reply("SLOW", energy_j=7.0)
    with pytest.raises(RuntimeError):
        asyncio.run(metered(fail(), meter))
    assert asyncio.run(metered(answer(), meter)).energy_j == 7.0


def test_the_processor_s_counter_goes_on_where_it_wraps(tmp_path: Path) -> None:
    """Packages only, not their parts; a zone that cannot be read is none."""
    for zone, name in (("intel-rapl:0", "package-0"), ("intel-rapl:0:0", "core"), ("intel-rapl:1", "psys")):
        (tmp_path / zone).mkdir()
        (tmp_path / zone / "name").write_text(f"{name}\n")
        (tmp_path / zone / "energy_uj").write_text("9000000\n")
        (tmp_path / zone / "max_energy_range_uj").write_text("10000000\n")
    (tmp_path / "intel-rapl:2").mkdir()
    (tmp_path / "intel-rapl:2" / "name").write_text("package-1\n")
    (counter,) = processor_counters(tmp_path)
    before = counter()
    (tmp_path / "intel-rapl:0" / "energy_uj").write_text("500000\n")
    assert counter() - before == pytest.approx(1.5)
    assert processor_counters(tmp_path / "none") == ()
