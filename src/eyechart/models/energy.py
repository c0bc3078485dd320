"""Energy of calls on this machine, from the counters of its GPUs (NVML) and processors (RAPL).

Joules are gross: they include the idle draw. Calls that run at once share the draw equally. Without
a readable counter, energy is not measured; it is never estimated.
"""

import contextlib
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from importlib import import_module
from itertools import count
from pathlib import Path

from eyechart.calls import Reply

RAPL = Path("/sys/class/powercap")
Counter = Callable[[], float]
"""Returns the joules since a fixed moment; never decreases."""


@dataclass(slots=True)
class Meter:
    """Shares the counters' joules among the running calls; measures nothing without counters."""

    counters: tuple[Counter, ...]
    _last: list[float] = field(default_factory=list)
    _shares: dict[int, float | None] = field(default_factory=dict)
    _tickets: "count[int]" = field(default_factory=count)

    def begin(self) -> int:
        """Register the start of a call; return its ticket."""
        self._share()
        ticket = next(self._tickets)
        self._shares[ticket] = 0.0 if self.counters else None
        return ticket

    def end(self, ticket: int) -> float | None:
        """Register the end of a call; return its joules, None if any part was not measured."""
        self._share()
        return self._shares.pop(ticket)

    def _share(self) -> None:
        try:
            now = [counter() for counter in self.counters]
        except Exception:  # noqa: BLE001 - a failing counter leaves the running calls unmeasured
            now = []
        spent = [after - before for after, before in zip(now, self._last, strict=False)]
        whole = len(now) == len(self._last) == len(self.counters) > 0 and min(spent) >= 0
        for ticket, so_far in self._shares.items():
            known = whole and so_far is not None
            self._shares[ticket] = (so_far or 0.0) + sum(spent) / len(self._shares) if known else None
        self._last = now


_METERS: list[Meter] = []


def meter() -> Meter:
    """Return the only meter of this process: two models never count the same joule."""
    if not _METERS:
        _METERS.append(Meter((*gpu_counters(), *processor_counters())))
    return _METERS[0]


async def metered(call: Awaitable[Reply], by: Meter | None = None) -> Reply:
    """Return a call's reply with its energy."""
    by = by or meter()
    ticket, joules = by.begin(), None
    try:
        reply = await call
    finally:
        joules = by.end(ticket)
    return replace(reply, energy_j=joules)


def gpu_counters() -> tuple[Counter, ...]:
    """Return a counter for every GPU with one in its driver (NVML, package nvidia-ml-py)."""
    with contextlib.suppress(Exception):  # no package, no driver, no GPU
        nvml = import_module("pynvml")
        nvml.nvmlInit()
        handles = [nvml.nvmlDeviceGetHandleByIndex(place) for place in range(nvml.nvmlDeviceGetCount())]
        for handle in handles:
            nvml.nvmlDeviceGetTotalEnergyConsumption(handle)
        return tuple(lambda one=one: nvml.nvmlDeviceGetTotalEnergyConsumption(one) / 1000.0 for one in handles)
    return ()


def processor_counters(root: Path = RAPL) -> tuple[Counter, ...]:
    """Return a counter for every processor package with readable energy (RAPL)."""
    found = []
    for zone in sorted(root.glob("intel-rapl:*")):
        with contextlib.suppress(OSError, ValueError):
            if zone.name.count(":") == 1 and (zone / "name").read_text().startswith("package"):
                package = _Package(zone / "energy_uj", float((zone / "max_energy_range_uj").read_text()))
                package()
                found.append(package)
    return tuple(found)


@dataclass(slots=True)
class _Package:
    """A RAPL counter that only grows: it corrects the return to 0 at the end of its range."""

    file: Path
    range_uj: float
    last_uj: float | None = None
    total_uj: float = 0.0

    def __call__(self) -> float:
        now = float(self.file.read_text())
        if self.last_uj is not None:
            self.total_uj += now - self.last_uj + (self.range_uj if now < self.last_uj else 0.0)
        self.last_uj = now
        return self.total_uj / 1e6
