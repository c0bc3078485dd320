"""Runs the tests that hold the falls of an older version: each must fail on that version's source, and pass on today's.

    make long-falls
    python benchmarks/falls.py --old build/0.2.0.dev0/src

`tests/falls.toml` names what fell when the older version was tried from outside, and the tests that hold it now. A test
is run twice, with either source before all others; on the old one an import that is not there counts as a failure, and
is named. A test of ``pages`` reads those of the old tree. Each row is kept in the result as soon as it is there, so
that an interrupted run goes on; ``--fresh`` begins anew. Writes ``benchmarks/results/falls.json``; exit 1 where a test
passes on the old source or fails on today's.
"""

import argparse
import datetime as dt
import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import eyechart

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "falls.json"
FALLS = ROOT / "tests" / "falls.toml"
LONGEST_S = 300
_LEFT_OUT = ("cacheprovider", "randomly")
_FELL = {"failed", "cannot be imported", "cannot be collected"}


def run_on(source: Path, test: str, root: Path = ROOT) -> str:
    """Return what became of a test on a source: passed, failed, or could not be imported; ``root`` holds the tests."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(source), str(root / "tests")])}
    words = [sys.executable, "-m", "pytest", "-q", "-x", "-W", "ignore", *(f"-pno:{name}" for name in _LEFT_OUT), test]
    try:
        done = subprocess.run(
            words, cwd=root, env=environment, capture_output=True, text=True, timeout=LONGEST_S, check=False
        )
    except subprocess.TimeoutExpired:  # as where a test hangs on what the older version waits for
        return "failed"
    if done.returncode == 0 and " passed" in done.stdout:
        return "passed"
    if done.returncode in {1, 2, 4} and ("ImportError" in done.stdout or "ModuleNotFoundError" in done.stdout):
        return "cannot be imported"
    if done.returncode in {2, 4} and "ERROR tests/" in done.stdout:
        return "cannot be collected"
    return "failed" if done.returncode in {1, 2} else f"not run: exit {done.returncode}: {done.stdout[-300:]}"


def tests_of(fall: dict[str, object]) -> list[str]:
    """Return the tests of a fall, which names one or several."""
    named = fall["test"]
    return [str(one) for one in named] if isinstance(named, list) else [str(named)]


def with_tests(tree: Path) -> Path:
    """Return the older version's whole tree, pages and results too, with the tests of today in the place of its own."""
    shutil.rmtree(tree / "tests", ignore_errors=True)
    shutil.copytree(ROOT / "tests", tree / "tests", ignore=shutil.ignore_patterns("__pycache__"))
    return tree


def main() -> int:
    """Run every test that has no row yet; return 1 where one says what it should not."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--old", type=Path, required=True, help="the src folder of the older version")
    options.add_argument("--fresh", action="store_true", help="run again what has a row")
    given = options.parse_args()
    if not (given.old / "eyechart" / "__init__.py").is_file():
        options.error(f"{given.old} holds no eyechart: give the src folder of the older version")
    falls = tomllib.loads(FALLS.read_text(encoding="utf-8"))["fall"]
    kept = json.loads(RESULT.read_text(encoding="utf-8"))["rows"] if RESULT.is_file() and not given.fresh else {}
    wanted = [(fall, test) for fall in falls for test in tests_of(fall)]
    rows = {test: kept[test] for _, test in wanted if test in kept}
    for fall, test in wanted:
        if test not in rows:
            root = with_tests(given.old.resolve().parent) if fall.get("pages") else ROOT
            old, now = run_on(given.old.resolve(), test, root), run_on(ROOT / "src", test)
            rows[test] = {"found": fall["found"], "before": old, "now": now}
            print(f"{fall['found']}: {test}: before {old}, now {now}", flush=True)
            write(rows, falls)
    write(rows, falls)
    odd = [test for test, row in rows.items() if row["now"] != "passed" or row["before"] not in _FELL]
    print(f"{len(falls)} falls, {len(rows)} tests, {len(odd)} that are not as they should be", *odd, sep="\n")
    return bool(odd)


def write(rows: dict[str, dict[str, str]], falls: list[dict[str, object]]) -> None:
    """Write the rows that there are, with version and date."""
    found = {
        "version": eyechart.__version__,
        "before": "0.2.0.dev0 at 066353c3",
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "falls": len(falls),
        "rows": rows,
    }
    RESULT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
