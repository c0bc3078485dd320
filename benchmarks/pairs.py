"""What the scripts of `make bench` share: two ways in pairs that alternate, and a result with version and load.

Other work on the machine comes and goes, and makes either way dearer. So of ten pairs the least ratio counts for an
upper bound, and the greatest for a lower one.
"""

import datetime as dt
import json
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from eyechart import __version__

PAIRS = 10
RESULTS = Path(__file__).parent / "results"


def cpu_s(way: Callable[[], object]) -> float:
    """Return the processor seconds of this process that a way takes."""
    start = time.process_time()
    way()
    return time.process_time() - start


def alternating(
    one: Callable[[], object],
    other: Callable[[], object],
    pairs: int = PAIRS,
    clock: Callable[[Callable[[], object]], float] = cpu_s,
) -> tuple[list[float], list[float]]:
    """Return what both ways take in each pair, by the clock; every second pair begins with the other way."""
    taken: tuple[list[float], list[float]] = ([], [])
    for number in range(pairs):
        for which in (0, 1) if number % 2 == 0 else (1, 0):
            taken[which].append(clock((one, other)[which]))
    return taken


def ratios(ours: list[float], theirs: list[float]) -> list[float]:
    """Return how many times as long as ours the other way took in each pair."""
    return [other / own for own, other in zip(ours, theirs, strict=True)]


RUNS_BEFORE = 2
"""So many runs before stand in a result, each with its load: a bound is to hold in three."""


def keep(name: str, found: Mapping[str, Any]) -> None:
    """Write a result with version, date and load, and the single numbers of the runs before."""
    file = RESULTS / f"{name}.json"
    old = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    before = [*old.get("before", []), *([{**_single(old), "load": old["load"]}] if old else [])][-RUNS_BEFORE:]
    told = {"version": __version__, "date": dt.datetime.now(dt.UTC).date().isoformat()}
    load = [round(one, 1) for one in os.getloadavg()]
    text = json.dumps({**found, **told, "load": load, "before": before}, indent=1, ensure_ascii=False)
    file.write_text(f"{text}\n", encoding="utf-8")


def _single(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return the single numbers and words of a result, without its lists."""
    return {
        name: _single(one) if isinstance(one, dict) else one
        for name, one in found.items()
        if isinstance(one, dict | int | float | str)
    }
