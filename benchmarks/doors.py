"""Every door under every fault, on this version's source and on an older one's: which falls the matrix finds by itself.

    make long-doors
    python benchmarks/doors.py --old build/0.2.0.dev0/src [--most 3] [--jobs 2]

The doors of a source are found from its syntax (`tests/matrix/finder.py`); the cells follow from what its commands do.
The rows of each source are kept in build/doors as they are made, so that an interrupted run goes on. Writes
``benchmarks/results/doors.json``: per source how many doors and cells there are, and what each wrong cell says; and of
each fall that was known of the older version the cells that find it. Exit 1 where a cell of today's source is wrong, or
fewer than ``LEAST`` of the falls are found on the older one.
"""

import argparse
import datetime as dt
import json
import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import eyechart

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests")]

from matrix.finder import doors  # noqa: E402 - of the tests, whose short form does the same

RESULT = ROOT / "benchmarks" / "results" / "doors.json"
ROWS = ROOT / "build" / "doors"
LEAST = 9
SHOWN = 4
"""So many cells are named of each fall."""
LONGEST = 240
FALLS = {
    "1 one callable changes what another is shown": r"battery \| guest \| (changes|clears) its arguments",
    "2 an episode that stands twice with other places": r"import of LeRobot \| contradiction \| set/meta/episodes",
    "3 a crash without steps validates": r"drives validated \| emptied record",
    "4 idle connections end a watched run": r"watch \| idle connections",
    "5 a template of another's is run": r"import of LeRobot \| templates",
    "6 a snapshot of the Hub's cache is refused": r"import of LeRobot \| cache of the Hub",
    "7 workers outlive a killed parent": r"calibrate (in processes|policies) \| killed parent",
    "8 values of a data set end in tracebacks": r"import of LeRobot \| (cells|numbers|values)",
    "9 calls that were never made are final failures": r"battery \| guest \| hangs",
    "10 a key comes back in an encoding": r"endpoint \| echoed key",
    "11 what a callable prints below Python is in the output": r"doctor \| guest \| (writes below|begins a process)",
    "12 a callable changes the folder": r"battery \| guest \| changes the folder",
    "13 a small log takes much memory": r"log( in JSON)? \| wide and deep",
}
"""The falls of 0.2.0.dev0 that were found by hand, and the cells in which each shows."""


def rows_of(name: str, source: Path, most: int, jobs: int) -> dict[str, list[str]]:
    """Run the cells of a source that have no row yet, in so many processes; return all rows."""
    ROWS.mkdir(parents=True, exist_ok=True)
    parts = [ROWS / f"{name}-{part}-of-{jobs}.json" for part in range(jobs)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tests")}
    running = [
        subprocess.Popen(
            [
                *(sys.executable, "-m", "matrix", "--src", str(source), "--most", str(most)),
                *("--part", f"{number}/{jobs}", "--out", str(file)),
            ],
            env=environment,
        )
        for number, file in enumerate(parts)
    ]
    if any(one.wait() > 1 for one in running):
        raise SystemExit(f"the matrix of {name} did not come to its end; the same command goes on")
    return {cell: wrong for file in parts for cell, wrong in json.loads(file.read_text(encoding="utf-8")).items()}


def told(words: str) -> str:
    """Return what a cell said on one line, shortened, without the folders of this machine."""
    return re.sub(r"\s+", " ", re.sub(r"/[^\s\"']*/(src|tests|lib|cell)/", r"\1/", words))[-LONGEST:]


def summary(source: Path, rows: dict[str, list[str]]) -> dict[str, object]:
    """Return the numbers of a source, and what each of its wrong cells says, shortened."""
    found = doors(source)
    wrong = {cell: [told(one) for one in said] for cell, said in rows.items() if said}
    return {
        "doors": dict(sorted(Counter(door.kind for door in found).items())),
        "cells": dict(sorted(Counter(cell.split(" | ")[1] for cell in rows).items())),
        "wrong": dict(sorted(Counter(cell.split(" | ")[1] for cell in wrong).items())),
        "said": wrong,
    }


def main() -> int:
    """Run both sources; return 1 where today's is wrong, or too few falls of the older one are found."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--old", type=Path, required=True, help="the src folder of the older version")
    options.add_argument("--most", type=int, default=3)
    options.add_argument("--jobs", type=int, default=2)
    given = options.parse_args()
    old = rows_of("before", given.old.resolve(), given.most, given.jobs)
    now = rows_of("now", ROOT / "src", given.most, given.jobs)
    falls = {
        name: [cell for cell, said in old.items() if said and re.match(text, cell)] for name, text in FALLS.items()
    }
    found = {
        "version": eyechart.__version__,
        "date": dt.datetime.now(tz=dt.UTC).date().isoformat(),
        "most of a kind without an end": given.most,
        "falls found before": sum(map(bool, falls.values())),
        "wrong now": sum(map(bool, now.values())),
        "falls": {name: {"cells": len(cells), "such as": cells[:SHOWN]} for name, cells in falls.items()},
        "before": summary(given.old.resolve(), old),
        "now": summary(ROOT / "src", now),
    }
    part = RESULT.with_suffix(".part")
    part.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    part.replace(RESULT)
    print(f"{RESULT}: {found['falls found before']} of {len(FALLS)} falls, {found['wrong now']} cells wrong now")
    return int(found["falls found before"] < LEAST or bool(found["wrong now"]))


if __name__ == "__main__":
    sys.exit(main())
