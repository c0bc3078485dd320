"""What reading a run costs: commands against a hello-world of the same Python with numpy, and against SQL's own count.

    make long-reading

Runs of 1 and 16 models × 198 frames × 8 conditions, and of 20 × 288 × 11 for a report, are written by a script.
Commands alternate with the hello-world. The first reading of a ledger and the following ones are apart. A bound holds
for the least ratio of processor time of ten pairs, or of fewer where a command takes long. Exits 1 where one is missed.
Writes ``results/reading.json`` after each command; ``--only`` measures some of them again.
"""

import argparse
import datetime as dt
import json
import os
import random
import shutil
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests")]

from bench_score import answer_all, make_run  # noqa: E402 - the tests lie beside
from eyechart import __version__  # noqa: E402
from eyechart.ledger import Ledger  # noqa: E402
from eyechart.manifest import LEDGER  # noqa: E402
from large_runs import ASKED, build_bank  # noqa: E402 - of the tests, which make it too
from pairs import PAIRS, RESULTS, alternating, ratios  # noqa: E402

HELLO = ("-c", "import numpy; print('hello')")
EPISODES, STEPS = 18, 11
"""198 frames under the eight conditions of a bank without drawn pictures: 1584 calls of a model."""
REPORTED, CONDITIONS = 20, ASKED[:11]


@dataclass(frozen=True)
class Row:
    """A command, the models of its run, and the most hello-worlds of a first reading and of the next ones."""

    command: str
    models: int
    first: float
    again: float | None = None
    pairs: int = PAIRS

    @property
    def name(self) -> str:
        """Return the row's name in the result."""
        of = {0: "", REPORTED: f" of {REPORTED} × 288 × {len(CONDITIONS)}"}
        return self.command + of.get(self.models, f" of {self.models} × 1584 calls")


ROWS = (
    Row("--help", 0, 2.0),
    Row("verdict", 1, 6.0, 3.0),
    Row("score", 1, 6.0, 6.0),
    Row("gate", 1, 6.0, 6.0),
    Row("costs", 1, 6.0, 6.0),
    Row("verdict", 16, 14.0, 4.0),
    Row("costs", 16, 7.0, 7.0),
    Row("report", REPORTED, 70.0, pairs=3),
    Row("demo", 0, 150.0, pairs=3),  # 32,442 calls: 70 left each a quarter of a millisecond and the bank nothing
)
COUNTED = "SELECT model, condition, count(*) FROM calls JOIN replies ON call = calls.id WHERE final = 1 GROUP BY 1, 2"


def seconds(words: Sequence[str]) -> float:
    """Return the processor time of a Python child; a command of eyechart may exit 1, as a gate does."""
    child = subprocess.Popen(
        [sys.executable, *words],
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": ""},  # compiled once, as wherever it is installed
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode > 2:
        raise SystemExit(f"{' '.join(words)} exits {child.returncode}")
    return used.ru_utime + used.ru_stime


def fresh(run: Path, copy: Path) -> Path:
    """Copy a run to a folder where no command has read it."""
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(run, copy)
    return copy


def _itself(way: Callable[[], Any]) -> float:
    """Return the seconds that a child took, which it says itself."""
    return float(way())


def measured(row: Row, run: Path, scratch: Path) -> dict[str, object]:
    """Return the ratios of a first reading, and of the next one, to the hello-worlds beside them."""
    words, found = ["-m", "eyechart", row.command], dict[str, object]()
    if row.command == "demo":
        words += ["--out", str(scratch)]
    elif row.command != "--help":
        words.append(str(scratch))
    if row.command == "report":
        words += ["--out", f"{scratch}.html"]

    def first() -> float:
        if row.models:
            fresh(run, scratch)
        else:
            shutil.rmtree(scratch, ignore_errors=True)
        Path(f"{scratch}.html").unlink(missing_ok=True)
        return seconds(words)

    ways: dict[str, Callable[[], object]] = {"first": first}
    if row.again is not None:
        ways["again"] = lambda: seconds(words)
    for name, way in ways.items():
        greeted, took = alternating(lambda: seconds(HELLO), way, row.pairs, _itself)
        every = ratios(greeted, took)
        found |= {
            name: round(min(every), 2),
            f"{name}_median": round(statistics.median(every), 2),
            f"{name}_s": round(min(took), 3),
            f"{name}_hello_s": round(min(greeted), 3),
            f"bound_{name}": row.first if name == "first" else row.again,
        }
    return found | {"pairs": row.pairs}


def against_sql(ledger: Path, rounds: int) -> dict[str, float]:
    """Return processor seconds of opening and walking all replies, and of SQL's own count of them."""
    ours, own = [], []
    for _ in range(rounds):
        with sqlite3.connect(ledger) as sql:
            start = time.process_time()
            counts = {(model, condition): count for model, condition, count in sql.execute(COUNTED)}
            own.append(time.process_time() - start)
        start, found = time.process_time(), dict[tuple[str, str], int]()
        with Ledger(ledger) as opened:
            for model in opened.models():
                for key, _ in opened.replies(model):
                    found[model, key.condition] = found.get((model, key.condition), 0) + 1
        ours.append(time.process_time() - start)
        assert found == counts
    ratio = statistics.median(a / b for a, b in zip(ours, own, strict=True))
    return {"replies_s": round(min(ours), 3), "group_by_s": round(min(own), 4), "ratio": round(ratio, 1)}


def make(models: int, out: Path) -> Path:
    """Write a run of so many models, of no pictures that matter; the report's are textured, and are drawn otherwise."""
    out.mkdir()
    if models == REPORTED:
        build_bank(out / "source", times=4)
        answer_all(out, models=models, rng=random.Random(0), conditions=CONDITIONS)  # noqa: S311 - no secret
    else:
        make_run(out, models=models, episodes=EPISODES, steps=STEPS)
    return out / "run"


def write(file: Path, found: dict[str, Any]) -> list[str]:
    """Write the rows so far, with what they miss, and return that."""
    missed = [
        f"{name}: {when}"
        for name, row in found.items()
        for when in ("first", "again")
        if when in row and row[when] > row[f"bound_{when}"]
    ]
    dated = {"version": __version__, "date": dt.datetime.now(dt.UTC).date().isoformat()}
    load = [round(one, 1) for one in os.getloadavg()]
    text = json.dumps({"rows": found, "missed": missed, **dated, "load": load}, indent=1, ensure_ascii=False)
    file.write_text(f"{text}\n", encoding="utf-8")
    return missed


def main() -> int:
    """Measure, print, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", default=[], help="commands to measure; the other rows stay")
    parser.add_argument("--json", type=Path, default=RESULTS / "reading.json", help="write the numbers here")
    given = parser.parse_args()
    found: dict[str, Any] = json.loads(given.json.read_text(encoding="utf-8"))["rows"] if given.only else {}
    missed = list[str]()
    with tempfile.TemporaryDirectory() as folder:
        runs = dict[int, Path]()
        for row in ROWS:
            if given.only and row.command not in given.only:
                continue
            if row.models and row.models not in runs:
                runs[row.models] = make(row.models, Path(folder) / f"{row.models}")
            seconds(["-m", "eyechart", row.command, "--help"])  # compiles what it imports
            found[row.name] = took = measured(row, runs.get(row.models, Path()), Path(folder) / "copy")
            again = "" if row.again is None else f", again {took['again']}× ({row.again:g})"
            print(f"{row.name}: {took['first']}× a hello-world (at most {row.first:g}){again}", flush=True)
            missed = write(given.json, found)
        if not given.only:
            found["replies of 16 × 1584 calls against GROUP BY"] = took = against_sql(runs[16] / LEDGER, PAIRS)
            print(f"all replies of 16 × 1584 calls: {took['ratio']}× SQL's own GROUP BY")
            missed = write(given.json, found)
    for one in missed:
        print(f"missed: {one}", file=sys.stderr)
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
