"""What `eyechart demo` costs in an older eyechart and in today's, in pairs that alternate, one seed a pair.

    make long-demo
    python benchmarks/demo_versions.py --old build/0.1.0/.venv/bin/python

Every finished demo is kept on disk, so an interrupted measurement goes on; a change of the source begins anew. Writes
``benchmarks/results/demo.json`` after every pair; exit 1 where the median of the pairs' ratios is above 1.5, or a
verdict of today's is not the one that its controller declares.
"""

import argparse
import datetime as dt
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from compare_versions import ROOT, digest_of, said

RESULT = ROOT / "benchmarks" / "results" / "demo.json"
BOUND = 1.5
"""The most of the older version's processor time that today's may take: it asks more conditions."""

RIGHT = re.compile(r"(\d+) of (\d+) verdicts are as the controllers declared")

Took = dict[str, float | list[int]]


def demo(python: Path, folder: Path, seed: int) -> Took:
    """Make one demo anew: the processor seconds of it and its children, and how many verdicts of how many are right."""
    shutil.rmtree(folder, ignore_errors=True)
    printed = folder.with_suffix(".txt")
    with printed.open("w", encoding="utf-8") as out:
        words = [python.with_name("eyechart"), "demo", "--out", folder, "--seed", str(seed)]
        child = subprocess.Popen(words, stdout=out, stderr=subprocess.DEVNULL)
        _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    shutil.rmtree(folder, ignore_errors=True)
    match = RIGHT.search(" ".join(printed.read_text(encoding="utf-8").split()))
    if match is None:
        raise SystemExit(f"{python}: demo --seed {seed} exits {child.returncode} without its last line; see {printed}")
    return {"cpu_s": round(used.ru_utime + used.ru_stime, 2), "right": [int(group) for group in match.groups()]}


def write(versions: tuple[str, str], pairs: Mapping[str, Mapping[str, Took]]) -> int:
    """Write and print what the pairs took; returns the exit code."""
    old, new = versions
    ratios = {seed: round(pair[new]["cpu_s"] / pair[old]["cpu_s"], 3) for seed, pair in pairs.items()}
    right, verdicts = (sum(pair[new]["right"][place] for pair in pairs.values()) for place in (0, 1))
    commit = subprocess.run(["git", "rev-parse", "HEAD"], check=True, capture_output=True, text=True, cwd=ROOT)
    found = {
        "old": old,
        "new": new,
        "commit": commit.stdout.strip(),
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "seeds": pairs,
        "ratios": ratios,
        "n": len(ratios),
        "median_ratio": round(statistics.median(ratios.values()), 3),
        "range": [min(ratios.values()), max(ratios.values())],
        "bound": BOUND,
        "right": [right, verdicts],
        "load at the end": [round(one, 1) for one in os.getloadavg()],
    }
    RESULT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    told = f"median {found['median_ratio']}× of {found['n']} pairs (range {found['range'][0]} to {found['range'][1]})"
    print(f"{told}; {right} of {verdicts} verdicts right", flush=True)
    return int(found["median_ratio"] > BOUND or right < verdicts)


def main() -> int:
    """Measure the pairs that are not measured yet, and write the result."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--old", type=Path, required=True, help="the Python in which the older eyechart is installed")
    options.add_argument("--out", type=Path, default=ROOT / "build" / "demo", help="folder of what both make")
    options.add_argument("--seeds", type=int, default=5, help="pairs of demos, each of its own seed")
    given = options.parse_args()
    sides, digests = {}, []
    for python in (given.old.absolute(), Path(sys.executable)):
        version, place = said(python, "import eyechart as e; print(e.__version__, e.__path__[0])").split(" ", 1)
        sides[version] = python
        digests.append(digest_of(Path(place)))
    old, new = sides
    folder = given.out.resolve() / "-".join(digests)
    folder.mkdir(parents=True, exist_ok=True)
    kept = folder / "pairs.json"
    pairs: dict[str, dict[str, Took]] = json.loads(kept.read_text()) if kept.is_file() else {}
    code = 0
    for seed in range(given.seeds):
        if str(seed) not in pairs:
            order = list(sides.items())[:: 1 if seed % 2 == 0 else -1]
            pairs[str(seed)] = {version: demo(python, folder / version, seed) for version, python in order}
            kept.write_text(json.dumps(pairs))
        code = write((old, new), pairs)
    return code


if __name__ == "__main__":
    sys.exit(main())
