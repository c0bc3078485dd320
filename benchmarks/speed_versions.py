"""What commands cost in an older eyechart and in today's: processor time of the child, in pairs that alternate.

    make long-speed
    python benchmarks/speed_versions.py --old build/0.1.0/.venv/bin/python

Each side makes its own run and bundle of the older one's bank, and reads those; the hierarchy is that of `tests/old/`.
Both ask and drive the same: what today's version does beside it by default is left out (`SAME`). Every pair is kept on
disk, so an interrupted measurement goes on; a change of the source begins anew. Writes
``benchmarks/results/speed.json``; exit 1 where a command's least time is more than 1.05 of the older one's.
"""

import argparse
import datetime as dt
import json
import os
import shutil
import statistics
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from compare_versions import ROOT, digest_of, said

RESULT = ROOT / "benchmarks" / "results" / "speed.json"
BOUND = 1.05
MODELS = ("scripted:depth_lateral", "scripted:self_inconsistent", "scripted:truncating")

COMMANDS: Mapping[str, tuple[str, ...]] = {
    "run battery": ("run", "battery", "--frames", "bank", "--out", "fresh", *(f"--model={model}" for model in MODELS)),
    "run closed-loop": (
        *("run", "closed-loop", "--out", "fresh", "--policy=scripted:depth_lateral", "--scenarios=light", "--seeds=1"),
        *("--condition=real", "--condition=blank", "--processes=1"),
    ),
    "verdict": ("verdict", "run", "--json"),
    "score battery": ("score", "run", "--json"),
    "score hierarchy": ("score", "hierarchy", "--json"),
    "gate": ("gate", "run", "--json"),
    "costs battery": ("costs", "run", "--json"),
    "costs hierarchy": ("costs", "hierarchy", "--json"),
    "report": ("report", "run", "--out", "page.html"),
    "validate": ("validate", "run.zip", "--json"),
}
"""What is measured, by its name in the result."""

SLOW = {"run battery", "run closed-loop", "report", "validate"}
MOST_SLOW = 3
"""So many pairs of these are enough: their start is a small part of them."""

FAILS = {"gate": 1}
"""The exit code of a command that does what it should where that is not 0: some of the models do not pass."""

SAME: Mapping[str, tuple[str, ...]] = {"battery": ("--controls=none",), "closed-loop": ("--no-marginal",)}
"""Options of a run that 0.1.0 has not, under which today's version asks what 0.1.0 does."""

MADE_ANEW = ("fresh", "page.html")


@dataclass(frozen=True)
class Side:
    """A version with its Python and the folder in which it works."""

    version: str
    python: Path
    folder: Path

    def __call__(self, words: Sequence[str]) -> float:
        """Run a command; returns the processor seconds that it and its children took."""
        if self.version != "0.1.0" and words[0] == "run":
            words = (*words, *SAME[words[1]])
        for name in MADE_ANEW:
            path = self.folder / name
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        child = subprocess.Popen(
            [self.python.with_name("eyechart"), *words],
            cwd=self.folder,
            env={**os.environ, "PYTHONDONTWRITEBYTECODE": ""},  # compiled once, as wherever they are installed
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode != FAILS.get(words[0], 0):
            raise SystemExit(f"eyechart {self.version}: '{' '.join(words)}' exits {child.returncode}, in {self.folder}")
        return used.ru_utime + used.ru_stime

    def prepare(self, bank: Path | None) -> None:
        """Make what the commands read, once: a run and a bundle of this bank, or of one that it makes first."""
        done = self.folder / "prepared"
        if done.exists():
            return
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)
        shutil.copytree(ROOT / "tests" / "old" / "0.1.0" / "made" / "hierarchy", self.folder / "hierarchy")
        if bank is None:
            self(("frames", "build", "highway", "--out", "bank"))
        else:
            shutil.copytree(bank, self.folder / "bank")
        self(("run", "battery", "--frames", "bank", "--out", "run", *(f"--model={model}" for model in MODELS)))
        self(("bundle", "run", "--out", "run.zip"))
        done.touch()


def main() -> int:
    """Measure what is not measured yet, and write the result."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--old", type=Path, required=True, help="the Python in which the older eyechart is installed")
    options.add_argument("--out", type=Path, default=ROOT / "build" / "speed", help="folder of what both make")
    options.add_argument("--pairs", type=int, default=5, help="pairs of runs of each command")
    given = options.parse_args()
    sides = []
    for python in (given.old.absolute(), Path(sys.executable)):
        version, place = said(python, "import eyechart as e; print(e.__version__, e.__path__[0])").split(" ", 1)
        sides.append(Side(version, python, given.out.resolve() / f"{version}-{digest_of(Path(place))}"))
        sides[-1].prepare(sides[0].folder / "bank" if len(sides) > 1 else None)
    old, new = sides
    kept = new.folder / "pairs.json"
    pairs: dict[str, list[list[float]]] = json.loads(kept.read_text()) if kept.is_file() else {}
    for number in range(given.pairs):
        for name, words in COMMANDS.items():
            if len(pairs.setdefault(name, [])) <= number and not (number >= MOST_SLOW and name in SLOW):
                order = sides if number % 2 == 0 else sides[::-1]
                took = {side.version: side(words) for side in order}
                pairs[name].append([took[old.version], took[new.version]])
                kept.write_text(json.dumps(pairs))
    return write(old, new, pairs)


def write(old: Side, new: Side, pairs: Mapping[str, list[list[float]]]) -> int:
    """Write and print what each command took; returns the exit code."""
    rows = {
        name: {
            "pairs": len(both),
            "least_s": [round(min(column), 3) for column in zip(*both, strict=True)],
            "median_s": [round(statistics.median(column), 3) for column in zip(*both, strict=True)],
            "ratio_of_least": round(min(b for _, b in both) / min(a for a, _ in both), 3),
            "median_ratio": round(statistics.median(b / a for a, b in both), 3),
        }
        for name, both in pairs.items()
    }
    slower = [name for name, row in rows.items() if row["ratio_of_least"] > BOUND]
    commit = ["git", "rev-parse", "HEAD"]
    found = {
        "old": old.version,
        "new": new.version,
        "commit": subprocess.run(commit, check=True, capture_output=True, text=True, cwd=ROOT).stdout.strip(),
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "processor seconds": rows,
        "load at the end": [round(one, 1) for one in os.getloadavg()],
        "slower": slower,
    }
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    for name, row in rows.items():
        print(f"{name:16} {row['least_s']} s, least {row['ratio_of_least']}×, median {row['median_ratio']}×")
    return int(bool(slower))


if __name__ == "__main__":
    sys.exit(main())
