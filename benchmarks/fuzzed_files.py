"""Files of every kind that a user may be sent, broken by mutation, each read: an error in words, and bounded memory.

    make long-fuzz
    python benchmarks/fuzzed_files.py --files 100000 --wholes 300

Ledgers, modes, prompts, tables and frozen guardians, so many of each; whole bundles, banks and data sets. A mutation
follows from its number. An interrupted measurement goes on where its result stands, and one of this version that is
committed too; ``--anew`` begins with the first mutation. Writes ``benchmarks/results/fuzz.json``; exit 1 where anything
was wrong. The process may take no more than ``MOST_BYTES`` of addresses: what needs more is wrong.
"""

import argparse
import datetime as dt
import json
import resource
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests")]

import eyechart  # noqa: E402
from mutated_files import data_set, subjects, wholes  # noqa: E402 - of the tests, whose short form reads the same

RESULT = ROOT / "benchmarks" / "results" / "fuzz.json"
PART, WHOLE_PART = 2_000, 10
MOST_BYTES = 4_000_000_000
MOST_KB = 1_000_000
"""What the process may hold in memory at any time, in kB."""


def main() -> int:
    """Read as many files as were asked for, or the rest of them; return 1 where anything was wrong."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--files", type=int, default=100_000)
    options.add_argument("--wholes", type=int, default=300)
    options.add_argument("--anew", action="store_true")
    asked = options.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    kept = {} if asked.anew else stands()
    with tempfile.TemporaryDirectory(prefix="eyechart-fuzz-") as work:
        home, single = Path(work), Path(work) / "single"
        single.mkdir()
        (home / "whole").mkdir()
        kinds = {name: (subject.wrong, asked.files, PART) for name, subject in subjects(single).items()}
        if asked.wholes:
            every = {**wholes(home / "whole"), "data sets": data_set(home / "sets")}
            kinds |= {name: (one, asked.wholes, WHOLE_PART) for name, one in every.items()}
        while left := [name for name, (_, most, _) in kinds.items() if kept.get(name, {"read": 0})["read"] < most]:
            for name in left:  # in turn, so that a measurement that is cut has some of every kind
                wrong, most, part = kinds[name]
                one = kept.setdefault(name, {"read": 0, "processor_seconds": 0.0, "wrong": []})
                began, end = time.process_time(), min(most, one["read"] + part)
                for number in range(one["read"], end):
                    with tempfile.TemporaryDirectory(dir=home) as folder:
                        one["wrong"] += filter(None, [wrong(number, Path(folder))])
                one["read"], spent = end, time.process_time() - began
                one["processor_seconds"] = round(one["processor_seconds"] + spent, 1)
                kept["peak_kb"] = max(kept.get("peak_kb", 0), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
                write(kept)
    failed = wrong_in(kept)
    print(f"{RESULT}: {failed} wrong, at most {kept['peak_kb']} kB held")
    return int(bool(failed) or kept["peak_kb"] > MOST_KB)


def stands() -> dict:
    """Return what the result of this version holds; a measurement of another version begins anew."""
    found = json.loads(RESULT.read_text()) if RESULT.is_file() else {}
    return {**found["kinds"], "peak_kb": found["peak_kb"]} if found.get("version") == eyechart.__version__ else {}


def wrong_in(kept: dict) -> int:
    """Return how many readings were wrong."""
    return sum(len(one["wrong"]) for name, one in kept.items() if name != "peak_kb")


def write(kept: dict) -> None:
    """Write what was found so far, whole or not at all."""
    about = {"date": dt.datetime.now(tz=dt.UTC).date().isoformat(), "version": eyechart.__version__}
    told = {name: one for name, one in kept.items() if name != "peak_kb"}
    memory = {"peak_kb": kept["peak_kb"], "most_kb": MOST_KB, "most_addresses": MOST_BYTES}
    part = RESULT.with_suffix(".part")
    part.write_text(json.dumps({**about, "wrong": wrong_in(kept), **memory, "kinds": told}, indent=1) + "\n")
    part.replace(RESULT)


if __name__ == "__main__":
    sys.exit(main())
