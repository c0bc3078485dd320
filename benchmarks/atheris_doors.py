"""Coverage-guided fuzzing, by atheris, of what parses bytes of others: an answer, or an error in words, in little time.

    make long-atheris [MINUTES=10]
    python benchmarks/atheris_doors.py --minutes 10 [--target replies] [--anew]

The targets stand in `tests/matrix/targets.py`, what they begin with in `tests/corpus`, which the tests read too.
What is found on the way is kept in build/atheris, so that a measurement goes on where the one before ended. A target's
row is written as soon as it is there; ``--anew`` makes them all again. Writes ``benchmarks/results/atheris.json``; exit
1 where an input raised what is no error in words, took more than ``SLOWEST_S``, or more than ``MOST_MB`` of memory.
"""

import argparse
import datetime as dt
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "atheris.json"
FOUND = ROOT / "build" / "atheris"
CORPUS = ROOT / "tests" / "corpus"
SLOWEST_S, STUCK_S, MOST_MB, LONGEST = 5, 120, 2048, 4_096
"""Seconds of the processor that an input may take, and of the clock: beside other work these say little."""
NAMES = (
    "replies",
    "completions",
    "answers",
    "tables",
    "modes",
    "prompts",
    "robots",
    "logs",
    "ledgers",
    "rows",
    "bundles",
)
"""The targets: what is imported is measured, so that their module is imported by the fuzzer alone."""
LONG = {"ledgers": 65_536}
"""Bytes of an input, where 4096 are too few."""


def fuzz(name: str, words: list[str]) -> None:
    """Be the fuzzer of a target, in a process of its own; it ends with libFuzzer's own exit code."""
    import atheris  # noqa: PLC0415 - an extra

    with atheris.instrument_imports(include=["eyechart"]):
        from matrix import targets  # noqa: PLC0415 - what is imported here is measured

    def parse(data: bytes) -> None:
        began = time.process_time()
        targets.parse(name, data)
        if (took := time.process_time() - began) > SLOWEST_S:
            raise TimeoutError(f"{took:.1f} s of processor time")

    atheris.Setup([name, *words], parse)
    atheris.Fuzz()


def row_of(name: str, minutes: float) -> dict[str, object]:
    """Fuzz a target for so many minutes; return how often it was run, what it covered, and what was wrong."""
    kept, wrong = FOUND / name, FOUND / f"{name}-wrong"
    for folder in (kept, wrong):
        folder.mkdir(parents=True, exist_ok=True)
    words = [
        *(f"-max_total_time={round(60 * minutes)}", f"-timeout={STUCK_S}", f"-rss_limit_mb={MOST_MB}"),
        *(
            f"-max_len={LONG.get(name, LONGEST)}",
            f"-artifact_prefix={wrong}{os.sep}",
            "-print_final_stats=1",
            "-seed=1",
        ),
        *(str(kept), str(CORPUS / name)),
    ]
    paths = [str(ROOT / "src"), str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")]
    done = subprocess.run(
        [sys.executable, __file__, "--be", name, *words],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    stats = dict(re.findall(r"stat::(\w+):\s+(\d+)", done.stderr))
    covered = re.findall(r"cov: (\d+) ft: (\d+)", done.stderr)
    said = re.search(r"(?s)=== Uncaught Python exception: ===\n(.*?)\n\s*\n|ERROR: libFuzzer: ([^\n]*)", done.stderr)
    return {
        "minutes": minutes,
        "executions": int(stats.get("number_of_executed_units", 0)),
        "coverage": int(covered[-1][0]) if covered else 0,
        "features": int(covered[-1][1]) if covered else 0,
        "peak_mb": int(stats.get("peak_rss_mb", 0)),
        "exit": done.returncode,
        "wrong": [(said[1] or said[2])[-600:]] if said else [done.stderr[-600:]] if done.returncode else [],
        "inputs": sorted(path.name for path in wrong.iterdir()),
    }


def main() -> int:
    """Fuzz the targets that have no row of this version yet; return 1 where anything was wrong."""
    if sys.argv[1:2] == ["--be"]:
        fuzz(sys.argv[2], sys.argv[3:])
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--minutes", type=float, default=10.0)
    options.add_argument("--target", action="append", choices=NAMES)
    options.add_argument("--anew", action="store_true")
    asked = options.parse_args()
    rows = {} if asked.anew or not RESULT.is_file() else json.loads(RESULT.read_text(encoding="utf-8"))["targets"]
    for name in asked.target or NAMES:
        if rows.get(name, {"minutes": 0})["minutes"] < asked.minutes:
            rows[name] = row_of(name, asked.minutes)
            print(name, rows[name], flush=True)
            write(rows)
    return int(any(row["exit"] for row in rows.values()))


def write(rows: dict[str, dict[str, object]]) -> None:
    """Write the rows that there are, with version and date."""
    version = re.search(r'__version__ = "([^"]+)"', (ROOT / "src" / "eyechart" / "__init__.py").read_text("utf-8"))
    found = {
        "version": version[1] if version else "",
        "date": dt.datetime.now(tz=dt.UTC).date().isoformat(),
        "wrong": sum(bool(row["exit"]) for row in rows.values()),
        "targets": rows,
    }
    part = RESULT.with_suffix(".part")
    part.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    part.replace(RESULT)


if __name__ == "__main__":
    sys.exit(main())
