"""How eyechart grows: processor time and memory of its commands over frames, models and calls, with exponents.

    make long-growth
    python benchmarks/growth.py --axis both --command verdict --most 16000000 --folder FOLDER

``run`` makes its calls, ``resume`` is the same command on a whole run, and every reading is a first one; their ledgers
are filled by a script. The exponent is the slope of the logarithm of the seconds above those on 12 frames, with the
interval of least squares (t, 95 %). What takes less than 2 s is measured three times, and the least counts. Writes
``benchmarks/results/growth.json`` after each row, and goes on where it was interrupted; ``--again`` begins anew. Exits
1 where an exponent may be above 1.2, or 15 million calls are not judged in 3 minutes of processor time and 2 GB.
"""

import argparse
import datetime as dt
import json
import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from bench_score import cells, digests, fill, write_bank
from eyechart import __version__
from eyechart.conditions import BATTERY
from eyechart.manifest import LEDGER, write_run
from eyechart.studies.battery import Battery, plan
from eyechart.studies.battery.questions import Keys

RESULT = Path(__file__).parent / "results" / "growth.json"
STEPS = 12
SMALLEST = (12, 1)
AXES = {
    "frames of one model": tuple((n, 1) for n in (144, 1152, 2304, 4608, 9216, 14_400, 36_864, 100_008)),
    "models on 144 frames": tuple((144, models) for models in (1, 8, 16, 24, 32, 48, 64, 80, 100)),
    "both": ((1152, 2), (1728, 3), (2304, 4), (2880, 5), (4608, 8), (9216, 16), (100_008, 19)),
}
"""Along each the numbers of frames and models."""


class Command(NamedTuple):
    """A command's words, where braces name what it is given, and how far it is measured.

    ``most`` is the most calls of a row. One that is ``alone`` sees one model, or only the bank.
    """

    words: str
    most: int = 16_000_000
    alone: bool = False


_RUN = f"run battery --frames {{bank}} --out {{out}} --conditions {','.join(BATTERY)} {{models}}"
COMMANDS = {
    "run": Command(_RUN.replace("{out}", "{new}"), most=120_000),
    "resume": Command(_RUN),
    "score": Command("score {out} --json --fresh"),
    "verdict": Command("verdict {out} --json --fresh"),
    "costs": Command("costs {out} --json --fresh"),
    "report": Command("report {out} --out {new} --fresh"),
    "import": Command(
        f"run import {{answers}} --frames {{bank}} --out {{new}} --conditions {','.join(BATTERY)}", alone=True
    ),
    "open": Command("frames check {bank}", alone=True),
}
LARGE, MOST_S, MOST_MB, MOST_EXPONENT = 15_000_000, 180, 2000, 1.2
"""Calls of a ledger that is read and judged within so many seconds and MB, and the bound of exponents' upper ends."""
SHORT_S, GROWN = 2.0, 1.5
"""What takes fewer seconds is measured three times; a size counts if it takes so many times the start."""
ANSWERS = "growth_answers"
"""The module of the models."""


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


class Folder(NamedTuple):
    """Where banks, their digests and filled runs stand; what is whole there is not made again."""

    root: Path

    def bank(self, frames: int) -> Path:
        """Return a bank of so many frames."""
        found = self.root / f"bank-{frames}"
        if self._begins(found):
            steps = min(STEPS, frames // 2)
            write_bank(found, random.Random(0), episodes=frames // steps, steps=steps)  # noqa: S311
            self._ends(found)
        return found

    def run(self, frames: int, models: int) -> Path:
        """Return a whole run of so many frames and models."""
        found = self.root / f"run-{frames}-{models}"
        if self._begins(found):
            found.mkdir(parents=True)
            battery = self._battery(frames, models, found)
            write_run(found, battery.manifest, battery.plan.bank)
            asked = self.root / f"asked-{frames}"
            if self._begins(asked):
                asked.write_text("\n".join(digests(battery.plan)), encoding="ascii")
                self._ends(asked)
            fill(found / LEDGER, battery.plan, random.Random(0), asked.read_text("ascii").split("\n"))  # noqa: S311
            self._ends(found)
        return found

    def answers(self, frames: int) -> Path:
        """Return a table of one answer to each call of a bank."""
        found = self.root / f"answers-{frames}.jsonl"
        if self._begins(found):
            battery = self._battery(frames, 1, found)
            keys = Keys.of(battery.manifest, battery.plan)
            rows = (
                {"call": keys.call(condition, frame.id), "text": "SLOW"} for frame, condition in cells(battery.plan)
            )
            found.write_text("".join(f"{json.dumps(row)}\n" for row in rows), encoding="ascii")
            self._ends(found)
        return found

    def specs(self, models: int) -> list[str]:
        """Return callables that answer SLOW."""
        sys.path[:0] = [] if str(self.root) in sys.path else [str(self.root)]
        lines = (f"async def m{at}(prompt, image):\n    return 'SLOW'\n" for at in range(100))
        (self.root / f"{ANSWERS}.py").write_text("\n\n".join(lines), encoding="ascii")
        return [f"python:{ANSWERS}:m{at}" for at in range(models)]

    def _battery(self, frames: int, models: int, out: Path) -> Battery:
        return plan(self.bank(frames), self.specs(models), out, conditions=BATTERY)

    def _begins(self, made: Path) -> bool:
        """Return whether something is to be made, after what is left of an earlier try was deleted."""
        if self._whole(made).is_file():
            return False
        self.delete(made)
        return True

    def _ends(self, made: Path) -> None:
        self._whole(made).touch()

    def _whole(self, made: Path) -> Path:
        return made.with_name(f"{made.name}.whole")

    def delete(self, made: Path) -> None:
        """Delete what was made."""
        self._whole(made).unlink(missing_ok=True)
        shutil.rmtree(made) if made.is_dir() else made.unlink(missing_ok=True)


def measured(words: Sequence[str], root: Path) -> tuple[float, float]:
    """Return the processor seconds and the peak memory in MB of a command in a child; modules in ``root`` are found."""
    with tempfile.TemporaryFile("w+") as said:
        paths = os.pathsep.join([str(root), *filter(None, [os.environ.get("PYTHONPATH")])])
        env = {**os.environ, "PYTHONDONTWRITEBYTECODE": "", "PYTHONPATH": paths}
        child = subprocess.Popen(
            [sys.executable, "-c", _WITH_MEMORY, *words], stdout=subprocess.DEVNULL, stderr=said, env=env
        )
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        lines = said.read().split()
    if child.returncode:
        raise SystemExit(f"{' '.join(words[:4])} exits {child.returncode}: {' '.join(lines[-60:])}")
    return used.ru_utime + used.ru_stime, int(lines[-1]) / 1024


def least(command: str, size: tuple[int, int], folder: Folder, start: float = 0.0) -> tuple[float, float]:
    """Return the seconds and the memory of a command on so many frames and models.

    They are the least of three where the command is short, unless it takes little more than its ``start``.
    """
    words, (frames, models) = COMMANDS[command].words, size
    given = {"bank": str(folder.bank(frames))}
    if "{out}" in words:
        given["out"] = str(folder.run(frames, models))
    if "{answers}" in words:
        given["answers"] = str(folder.answers(frames))
    asked = [word for spec in folder.specs(models) for word in ("--model", spec)]
    found: list[tuple[float, float]] = []
    while len(found) < 3 and (not found or GROWN * start < found[0][0] < SHORT_S):
        with tempfile.TemporaryDirectory(dir=folder.root) as own:
            split = (
                asked if word == "{models}" else [word.format(**given, new=f"{own}/new")] for word in words.split()
            )
            found.append(measured([word for some in split for word in some], folder.root))
    return min(found)


def exponent(sizes: Sequence[int], took: Sequence[float], start: float) -> dict[str, float | int] | None:
    """Return the slope of log seconds above ``start`` on log size, with its interval; None below three sizes.

    Sizes that take less than `GROWN` times the start are left out.
    """
    pairs = [
        (math.log(size), math.log(one - start)) for size, one in zip(sizes, took, strict=True) if one > GROWN * start
    ]
    if len(pairs) < 3:
        return None
    x, y = np.array(pairs).T
    slope, intercept = np.polyfit(x, y, 1)
    left = float(((y - slope * x - intercept) ** 2).sum() / (len(x) - 2) / ((x - x.mean()) ** 2).sum())
    half = float(special.stdtrit(len(x) - 2, 0.975)) * math.sqrt(left)
    return {"exponent": round(slope, 3), "low": round(slope - half, 3), "high": round(slope + half, 3), "n": len(x)}


def measure(found: dict[str, Any], axis: str, size: tuple[int, int], command: str, folder: Folder) -> bool:
    """Add a row, unless it is there; return whether it was added."""
    frames, models = size
    rows: list[dict[str, Any]] = found.setdefault(axis, {}).setdefault(command, {}).setdefault("rows", [])
    if any((row["frames"], row["models"]) == size for row in rows):
        return False
    took, memory = least(command, size, folder, found["start_s"][command])
    calls = calls_of(size)
    load = [round(one, 1) for one in os.getloadavg()]
    row = {"frames": frames, "models": models, "calls": calls, "cpu_s": round(took, 2), "peak_mb": round(memory)}
    rows.append({**row, "load": load})
    print(f"{axis}: {command} of {models} × {frames} frames, {calls} calls: {took:.2f} s, {memory:.0f} MB", flush=True)
    return True


def calls_of(size: tuple[int, int]) -> int:
    """Return the calls about so many frames by so many models."""
    return math.prod(size) * len(BATTERY)


def write(found: dict[str, Any]) -> None:
    """Write the rows so far, with the exponents that they give."""
    for axis in AXES:
        for command, one in found.get(axis, {}).items():
            rows = sorted(one["rows"], key=lambda row: row["calls"])
            calls, took = [row["calls"] for row in rows], [row["cpu_s"] for row in rows]
            one |= {"rows": rows, "grows": exponent(calls, took, found["start_s"][command])}
    for row in found.get("both", {}).get("verdict", {}).get("rows", []):
        found |= {"large": row} if row["calls"] >= LARGE else {}
    found |= {"version": __version__, "date": dt.datetime.now(dt.UTC).date().isoformat()}
    RESULT.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def sizes_of(axis: str, command: str, most: int) -> Iterator[tuple[int, int]]:
    """Yield the sizes along an axis at which a command is measured, of at most so many calls."""
    one = COMMANDS[command]
    if not one.alone or axis == next(iter(AXES)):
        yield from (size for size in AXES[axis] if calls_of(size) <= min(most, one.most))


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
    with tempfile.TemporaryDirectory() as own:
        root = given.folder or Path(own)
        root.mkdir(parents=True, exist_ok=True)
        folder, wanted = Folder(root.resolve()), given.command or [*COMMANDS]
        for command in wanted:
            if command not in (starts := found.setdefault("start_s", {})):
                starts[command] = round(least(command, SMALLEST, folder)[0], 3)
        for axis in given.axis or AXES:
            for size in AXES[axis]:
                for command in wanted:
                    if size in sizes_of(axis, command, given.most) and measure(found, axis, size, command, folder):
                        write(found)
                if given.folder is None:
                    folder.delete(folder.root / f"run-{size[0]}-{size[1]}")
    grown = [one["grows"]["high"] for axis in AXES for one in found.get(axis, {}).values() if one.get("grows")]
    large = found.get("large", {"cpu_s": 0, "peak_mb": 0})
    return int(large["cpu_s"] > MOST_S or large["peak_mb"] > MOST_MB or any(end > MOST_EXPONENT for end in grown))


if __name__ == "__main__":
    sys.exit(main())
