"""What reading a run costs: commands against a hello-world of the same Python with numpy, and against SQL's own count.

Runs of 1 and 16 models × 198 frames × 8 conditions are written by a script. Commands alternate with the hello-world,
and a bound holds for the median ratio of processor time. The first reading of a ledger and the following ones are
apart. The bounds are goals. Exits 1 where one is missed; ``--json`` writes the numbers.
"""

import argparse
import datetime as dt
import json
import os
import shutil
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from bench_score import make_run
from eyechart import __version__
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER

HELLO = ("-c", "import numpy; print('hello')")
EPISODES, STEPS = 18, 11
"""198 frames under the eight conditions of a bank without drawn pictures: 1584 calls of a model."""
COMMANDS: tuple[tuple[str, int, float, float], ...] = (
    ("--help", 1, 2.0, 2.0),
    ("verdict", 1, 6.0, 3.0),
    ("score", 1, 6.0, 6.0),
    ("gate", 1, 6.0, 6.0),
    ("costs", 1, 6.0, 6.0),
    ("verdict", 16, 14.0, 4.0),
    ("costs", 16, 7.0, 7.0),
)
"""Command, models, and the bounds of the first reading and of those that follow, in hello-worlds."""
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


def paired(command: str, run: Path, scratch: Path, pairs: int) -> dict[str, float]:
    """Return the median ratios of a first and a following reading to the hello-world beside them."""
    first, again, hello = [], [], []
    for number in range(pairs):
        words = ["-m", "eyechart", command]
        if command != "--help":
            words.append(str(fresh(run, scratch / f"{number}")))
        hello.append(seconds(HELLO))
        first.append(seconds(words))
        hello.append(seconds(HELLO))
        again.append(seconds(words))
    middle = statistics.median(hello)
    return {
        "hello_s": round(middle, 3),
        "first_s": round(statistics.median(first), 3),
        "again_s": round(statistics.median(again), 3),
        "first": round(statistics.median(a / b for a, b in zip(first, hello[::2], strict=True)), 2),
        "again": round(statistics.median(a / b for a, b in zip(again, hello[1::2], strict=True)), 2),
    }


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


def main() -> int:
    """Measure, print, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--json", type=Path, help="write the numbers here")
    given = parser.parse_args()
    found, missed = dict[str, object](), []
    with tempfile.TemporaryDirectory() as folder:
        runs = {}
        for models in (1, 16):
            (out := Path(folder) / f"{models}").mkdir()
            make_run(out, models=models, episodes=EPISODES, steps=STEPS)
            runs[models] = out / "run"
        seconds(["-m", "eyechart", "verdict", str(fresh(runs[1], Path(folder) / "compiled"))])
        for command, models, at_first, later in COMMANDS:
            took = paired(command, runs[models], Path(folder) / "copies", given.pairs)
            name = f"{command} of {models} × 1584 calls" if command != "--help" else command
            found[name] = {**took, "bound_first": at_first, "bound_again": later}
            missed += [f"{name}: {when}" for when, most in (("first", at_first), ("again", later)) if took[when] > most]
            print(f"{name}: {took['first']}× a hello-world (at most {at_first:g}), again {took['again']}× ({later:g})")
        found["replies of 16 × 1584 calls against GROUP BY"] = took = against_sql(runs[16] / LEDGER, given.pairs)
        print(f"all replies of 16 × 1584 calls: {took['ratio']}× SQL's own GROUP BY")
    dated = {"version": __version__, "date": dt.datetime.now(dt.UTC).date().isoformat()}
    found |= dated | {"missed": missed, "load at the end": [round(one, 1) for one in os.getloadavg()]}
    if given.json is not None:
        given.json.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    for one in missed:
        print(f"missed: {one}", file=sys.stderr)
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
