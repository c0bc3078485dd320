"""How reading grows: processor time and memory of verdict and costs over frames, models and calls, with exponents.

    make long-growth
    python benchmarks/growth.py --most 1000000

Ledgers are filled by a script. The exponent is the slope of the logarithm of the seconds above those of a run of 12
frames, with the interval of least squares (t, 95 %). Writes ``benchmarks/results/growth.json``.
"""

import argparse
import datetime as dt
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy import special

from bench_score import make_run
from eyechart import __version__

RESULT = Path(__file__).parent / "results" / "growth.json"
STEPS, CONDITIONS = 12, 8
FRAMES = (144, 576, 2304, 9216, 36864, 100_008)
MODELS = (1, 4, 16, 64, 100)
COMMANDS = ("verdict", "costs")


_WITH_MEMORY = """
import re, sys
from pathlib import Path
from eyechart.__main__ import main
try:
    main()
finally:
    print(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text()).group(1), file=sys.stderr)
"""
"""A command that ends with the most memory it held, in kB: what its parent held is not in it, as it is in rusage."""


def measured(command: str, run: Path) -> tuple[float, float]:
    """Return the processor seconds and the peak memory in MB of one command in a child."""
    words = [sys.executable, "-c", _WITH_MEMORY, command, str(run), "--json"]
    with tempfile.TemporaryFile("w+") as said:
        env = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
        child = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=said, env=env)
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        lines = said.read().split()
    if child.returncode:
        raise SystemExit(f"{command} {run} exits {child.returncode}")
    return used.ru_utime + used.ru_stime, int(lines[-1]) / 1024


def exponent(sizes: Sequence[int], took: Sequence[float], start: float) -> dict[str, float | int] | None:
    """Return the slope of log seconds above ``start`` on log size, with its interval; None below three sizes.

    Sizes that take less than 1.2 times the start are left out.
    """
    pairs = [
        (math.log(size), math.log(one - start)) for size, one in zip(sizes, took, strict=True) if one > 1.2 * start
    ]
    if len(pairs) < 3:
        return None
    x, y = np.array(pairs).T
    slope, intercept = np.polyfit(x, y, 1)
    left = float(((y - slope * x - intercept) ** 2).sum() / (len(x) - 2) / ((x - x.mean()) ** 2).sum())
    half = float(special.stdtrit(len(x) - 2, 0.975)) * math.sqrt(left)
    return {"exponent": round(slope, 3), "low": round(slope - half, 3), "high": round(slope + half, 3), "n": len(x)}


def start_of(command: str) -> float:
    """Return the least processor seconds of a command on 12 frames of one model, out of three."""
    with tempfile.TemporaryDirectory() as folder:
        make_run(Path(folder), models=1, episodes=2, steps=6)
        return min(measured(command, Path(folder) / "run")[0] for _ in range(3))


def axis(name: str, sizes: Sequence[tuple[int, int]], most: int, starts: Mapping[str, float]) -> dict[str, object]:
    """Measure both commands at some numbers of (frames, models), up to so many calls."""
    found: dict[str, list[tuple[int, float, float]]] = {command: [] for command in COMMANDS}
    for frames, models in sizes:
        calls = frames * models * CONDITIONS
        if calls > most:
            continue
        with tempfile.TemporaryDirectory() as folder:
            made = make_run(Path(folder), models=models, episodes=frames // STEPS, steps=STEPS)
            for command in COMMANDS:
                took = measured(command, Path(folder) / "run")
                found[command].append((made, round(took[0], 2), round(took[1])))
                print(
                    f"{name}: {command} of {models} × {frames} frames, {made} calls: {took[0]:.2f} s, {took[1]:.0f} MB"
                )
    result: dict[str, object] = {}
    for command, rows in found.items():
        calls, took, memory = zip(*rows, strict=True)
        result[command] = {
            "calls": calls,
            "seconds": took,
            "peak_mb": memory,
            "start_s": round(starts[command], 2),
            "grows": exponent(calls, took, starts[command]),
        }
    return result


def main() -> None:
    """Measure frames of one model, then models on 144 frames, and write the result."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--most", type=int, default=1_000_000, help="the most calls of a ledger")
    given = parser.parse_args()
    starts = {command: start_of(command) for command in COMMANDS}
    found = {
        "frames of one model": axis("frames", [(frames, 1) for frames in FRAMES], given.most, starts),
        "models on 144 frames": axis("models", [(144, models) for models in MODELS], given.most, starts),
        "version": __version__,
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "load at the end": [round(one, 1) for one in os.getloadavg()],
    }
    RESULT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
