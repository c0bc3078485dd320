"""How reading grows: processor time and memory of verdict and costs over frames, models and calls, with exponents.

    make long-growth
    python benchmarks/growth.py --axis both --command verdict --most 16000000 --folder FOLDER

Ledgers are filled by a script, and each is read for the first time. The exponent is the slope of the logarithm of the
seconds above those of a run of 12 frames, with the interval of least squares (t, 95 %). Writes
``benchmarks/results/growth.json`` after each row, and goes on where it was interrupted; ``--again`` begins anew. Exits
1 where an exponent may be above 1.2, or 15 million calls take more than 3 minutes of processor time or 2 GB.
"""

import argparse
import datetime as dt
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import special

from bench_score import make_run
from eyechart import __version__

RESULT = Path(__file__).parent / "results" / "growth.json"
STEPS, CONDITIONS = 12, 8
AXES = {
    "frames of one model": tuple((frames, 1) for frames in (144, 576, 2304, 9216, 36_864, 100_008)),
    "models on 144 frames": tuple((144, models) for models in (1, 4, 16, 64, 100)),
    "both": ((2304, 4), (10_008, 12), (100_008, 19)),
}
"""Along each the numbers of frames and models."""
COMMANDS = ("verdict", "costs")
LARGE, MOST_S, MOST_MB, MOST_EXPONENT = 15_000_000, 180, 2000, 1.2
"""Calls of a ledger that is read and judged within so many seconds and MB, and the bound of exponents' upper ends."""


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
    words = [sys.executable, "-c", _WITH_MEMORY, command, str(run), "--json", "--fresh"]
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


def filled(folder: Path, frames: int, models: int) -> Path:
    """Return a run of so many frames and models in a folder; one that is whole there is not filled again."""
    out = folder / f"{frames}-{models}"
    if not (out / "whole").is_file():
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        make_run(out, models=models, episodes=frames // STEPS, steps=STEPS)
        (out / "whole").touch()
    return out / "run"


def measure(found: dict[str, Any], axis: str, size: tuple[int, int], command: str, folder: Path) -> None:
    """Add a row, unless it is there."""
    frames, models = size
    rows: list[dict[str, Any]] = found.setdefault(axis, {}).setdefault(command, {}).setdefault("rows", [])
    if any((row["frames"], row["models"]) == size for row in rows):
        return
    took, memory = measured(command, filled(folder, frames, models))
    calls = frames * models * CONDITIONS
    load = [round(one, 1) for one in os.getloadavg()]
    row = {"frames": frames, "models": models, "calls": calls, "cpu_s": round(took, 2), "peak_mb": round(memory)}
    rows.append({**row, "load": load})
    print(f"{axis}: {command} of {models} × {frames} frames, {calls} calls: {took:.2f} s, {memory:.0f} MB", flush=True)


def write(found: dict[str, Any]) -> None:
    """Write the rows so far, with the exponents that they give."""
    for axis in AXES:
        for command, one in found.get(axis, {}).items():
            rows = sorted(one["rows"], key=lambda row: row["calls"])
            calls, took = [row["calls"] for row in rows], [row["cpu_s"] for row in rows]
            one |= {"rows": rows, "grows": exponent(calls, took, found["start_s"][command])}
    found |= {"version": __version__, "date": dt.datetime.now(dt.UTC).date().isoformat()}
    RESULT.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def main() -> int:
    """Measure frames of one model, models on 144 frames, and both; write each row; 1 where a bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--most", type=int, default=1_000_000, help="the most calls of a ledger")
    parser.add_argument("--axis", choices=AXES, action="append", help="measure along this alone")
    parser.add_argument("--command", choices=COMMANDS, action="append", help="measure this alone")
    parser.add_argument("--again", action="store_true", help="begin anew, whatever was measured before")
    parser.add_argument("--folder", type=Path, help="keep the filled runs here")
    given = parser.parse_args()
    found: dict[str, Any] = {} if given.again or not RESULT.is_file() else json.loads(RESULT.read_text("utf-8"))
    if "start_s" not in found:
        found = {"start_s": {command: start_of(command) for command in COMMANDS}}
    for axis in given.axis or AXES:
        for size in AXES[axis]:
            with tempfile.TemporaryDirectory() as own:
                for command in given.command or COMMANDS:
                    if size[0] * size[1] * CONDITIONS <= given.most:
                        measure(found, axis, size, command, given.folder or Path(own))
                        write(found)
    rows = [row for axis in AXES for one in found.get(axis, {}).values() for row in one["rows"]]
    ends = [one["grows"]["high"] for axis in AXES for one in found.get(axis, {}).values() if one.get("grows")]
    large = [row for row in rows if row["calls"] >= LARGE and (row["cpu_s"] > MOST_S or row["peak_mb"] > MOST_MB)]
    return int(bool(large) or any(end > MOST_EXPONENT for end in ends))


if __name__ == "__main__":
    sys.exit(main())
