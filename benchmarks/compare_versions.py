"""Makes the same studies with an older eyechart and with today's, and compares what came out by key and row by row.

    make long-compare
    python benchmarks/compare_versions.py --old build/0.1.0/.venv/bin/python

What both make and answer are the lines of `tests/old/make.py` and those below. Statistics, labels, exit codes and JSON
are compared by key, numbers to the last bit; ledgers and episodes row by row; pictures and banks by their bytes. What
is a clock's or a place's is left out by the exact names in `CLOCKS` and `TIMES`; what differs on purpose stands by key
in `benchmarks/differences.toml`. Each answer is kept on disk, so an interrupted comparison goes on where it stopped; a
change of the source begins anew. Writes ``benchmarks/results/compare.json``; exit 1 where something else differs.
"""

import argparse
import contextlib
import csv
import datetime as dt
import hashlib
import importlib.util
import json
import os
import sqlite3
import subprocess
import sys
import tomllib
import traceback
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks" / "results" / "compare.json"

CLOCKS = frozenset(
    {
        "seconds",
        "seconds_min",
        "first_byte_median_s",
        "latency_median_s",
        "latency_p95_s",
        "latency_ratio",
        "created",
        "date",
        "bank_path",
    }
)
"""Keys whose values are a clock's, a calendar's or a folder's."""

TIMES = frozenset({"sent_at", "closed_at", "seconds", "first_byte_s", "energy_j"})
"""Columns of a ledger that are a clock's or a meter's."""

MAKES: Mapping[str, str] = {
    "demo": "demo --out demo",
    "hierarchy": "run hierarchy --out hierarchy",
    "ladder": "ladder --out ladder --seeds 3",
    "drone": "frames build drone --seeds 0 --steps 4 --out drone",
    "flown": "run closed-loop --out flown --simulator drone --policy oracle --policy scripted:distance --seeds 1 "
    "--condition real",
    "planned": "run closed-loop --out planned --simulator rover-mpc --policy scripted:clear_side --policy route "
    "--scenarios offset,slalom --seeds 2 --condition real --condition mirrored --condition frozen",
    "six": "run prompts --frames highway --out six --model scripted:self_inconsistent --model scripted:depth_left "
    "--conditions all --limit 16",
    "forward": "run structured --frames rover --out forward --model scripted:scene_positive_control "
    "--model scripted:scene_one_sided",
}
"""What is made beside the lines of make.py, or in the place of one."""

ANSWERS: Mapping[str, str] = {
    "demo-verdict": "verdict demo/run-0 --json",
    "demo-score": "score demo/run-0 --json",
    "demo-gate": "gate demo/run-0 --json",
    "demo-costs": "costs demo/run-0 --json",
    "flown-score": "score flown --json",
    "planned-score": "score planned --json",
    "planned-audit": "audit planned --json",
    "six-score": "score six --json",
    "forward-score": "score forward --json",
    "forward-gate": "gate forward --json",
    "forward-nested": "guardian nested forward --frames rover --size 1 --json",
    "calibrate": "calibrate --replications 2 --processes 1 --json",
    "list-models": "list models --json",
    "list-conditions": "list conditions --json",
    "list-prompts": "list prompts --json",
    "list-simulators": "list simulators --json",
    "report": "report battery --out battery.html --tables battery-tables",
    "report-drives": "report drives --out drives.html --tables drives-tables",
}


def load(path: Path) -> ModuleType:
    """Return a file's module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def lines() -> tuple[ModuleType, dict[str, str]]:
    """Return the module of make.py, and every command by the name of its answer, in their order."""
    make = load(ROOT / "tests" / "old" / "make.py")
    made = {f"make-{name}": line for name, line in {**make.MAKES, **MAKES}.items()}
    return make, {**made, **make.ANSWERS, **ANSWERS}


def work(folder: Path) -> None:
    """Make and ask everything that ``folder`` lacks, with the eyechart of this Python."""
    make, steps = lines()
    answers, made = folder / "answers", folder / "made"
    answers.mkdir(parents=True, exist_ok=True)
    made.mkdir(exist_ok=True)
    os.chdir(made)
    sys.path.insert(0, ".")
    if not (made / "photos").is_dir():
        make.inputs()
    for name, line in steps.items():
        kept = answers / f"{name}.json"
        if kept.is_file():
            continue
        try:
            code, out, err = make.command(line)
        except Exception:  # noqa: BLE001 - a crash is an answer too
            code, out, err = -1, "", traceback.format_exc()
        found = {"command": line, "exit": code, "json": json.loads(out) if "--json" in line and out.strip() else None}
        partial = kept.with_suffix(".partial")
        partial.write_text(json.dumps(found, sort_keys=True), encoding="utf-8")
        partial.rename(kept)
        print(f"{code} {line}" + (f"\n{err}" if code < 0 else ""), flush=True)


def without(value: object, names: frozenset[str]) -> object:
    """Return a JSON value without the keys of these names, wherever they stand."""
    if isinstance(value, dict):
        return {key: without(one, names) for key, one in value.items() if key not in names}
    return [without(one, names) for one in value] if isinstance(value, list) else value


def unversioned(value: object, version: str) -> object:
    """Return a JSON value in which the version that wrote it is called VERSION, in words too."""
    if isinstance(value, dict):
        return {key: unversioned(one, version) for key, one in value.items()}
    if isinstance(value, list):
        return [unversioned(one, version) for one in value]
    return value.replace(version, "VERSION") if isinstance(value, str) else value


def ledger_rows(path: Path, columns: Mapping[str, list[str]]) -> dict[str, object]:
    """Return a ledger's attempts by the key of their call and their number, with the columns that are named."""
    named = [f"a.{name}" for name in columns["attempts"]] + [f"r.{name}" for name in columns["replies"]]
    key = ("c.study", "c.model", "c.prompt", "c.frame", "c.condition", "c.repeat", "a.number")
    sql = (
        f"SELECT {', '.join((*key, *named))} FROM calls c JOIN attempts a ON a.call = c.id "  # noqa: S608 - our own names
        "LEFT JOIN replies r ON r.attempt = a.id"
    )
    with contextlib.closing(sqlite3.connect(path)) as opened:
        rows = opened.execute(sql).fetchall()
    return {
        " ".join(map(str, row[: len(key)])): dict(zip(named, row[len(key) :], strict=True))
        for row in sorted(rows, key=str)
    }


def columns_of(path: Path) -> dict[str, list[str]]:
    """Return the columns of a ledger that are compared, by table: its own, but for its numbering and its clocks."""
    skipped = TIMES | {"id", "call", "attempt", "number"}
    with contextlib.closing(sqlite3.connect(path)) as opened:
        return {
            table: [row[1] for row in opened.execute(f"PRAGMA table_info({table})") if row[1] not in skipped]
            for table in ("attempts", "replies")
        }


def contents(path: Path, old: Path) -> object:
    """Return what of a file is compared; ``old`` is the older version's, whose columns a ledger is held to."""
    if path.name == "ledger.sqlite":
        return ledger_rows(path, columns_of(old))
    if path.suffix == ".jsonl":
        lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        if path.name == "episodes.jsonl":  # in the order in which they ended
            lines.sort(key=lambda line: json.dumps(line.get("key"), sort_keys=True))
        return without(lines, CLOCKS)
    if path.suffix == ".csv":
        with path.open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))
    if path.suffix == ".toml":
        return without(tomllib.loads(path.read_text(encoding="utf-8")), CLOCKS)
    if path.suffix == ".json":
        return without(json.loads(path.read_text(encoding="utf-8")), CLOCKS)
    return hashlib.sha256(path.read_bytes()).hexdigest()


KEPT = ("ledger.sqlite", ".jsonl", ".json", ".png", ".csv", ".toml")
"""Endings of the files that are compared. A bundle and a page are compared by what validate and the tables say, and a
table by its CSV, whose rows the other forms hold too."""


def pairs(old: Path, new: Path) -> Iterator[tuple[str, object, object]]:
    """Yield the name of everything that either side has, with what each has; nothing in braces where it lacks it."""
    for side, pattern in (("answers", "*.json"), ("made", "**/*")):
        names = {
            path.relative_to(root / side)
            for root in (old, new)
            for path in (root / side).glob(pattern)
            if path.is_file() and path.name.endswith(KEPT)
        }
        for name in sorted(names):
            first, second = old / side / name, new / side / name
            if first.is_file() and second.is_file():
                yield f"{side}/{name.as_posix()}", contents(first, first), contents(second, first)
            else:
                here = [{"file": path.parent.name} if path.is_file() else {} for path in (first, second)]
                yield f"{side}/{name.as_posix()}", *here


def digest_of(folder: Path) -> str:
    """Return the head of the digest of a package's files: what decides what a side makes."""
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            found.update(path.name.encode() + path.read_bytes())
    return found.hexdigest()[:12]


def said(python: Path, code: str) -> str:
    """Return what a line of Python prints."""
    return subprocess.run([python, "-c", code], check=True, capture_output=True, text=True).stdout.strip()


def main() -> int:
    """Make both sides, compare them, write the result."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--old", type=Path, help="the Python in which the older eyechart is installed")
    options.add_argument("--out", type=Path, default=ROOT / "build" / "compare", help="folder of what both make")
    options.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    given = options.parse_args()
    if given.work is not None:
        work(given.work.resolve())
        return 0
    if given.old is None:
        options.error("--old is needed: the Python in which the older eyechart is installed")
    steps = hashlib.sha256(json.dumps(lines()[1]).encode()).hexdigest()[:12]
    sides = []
    for python in (given.old.absolute(), Path(sys.executable)):
        version, place = said(python, "import eyechart as e; print(e.__version__, e.__path__[0])").split(" ", 1)
        folder = given.out.resolve() / f"{version}-{digest_of(Path(place))}-{steps}"
        sides.append((version, folder))
        env = {**os.environ, "PYTHONHASHSEED": "0", "COLUMNS": "200"}
        subprocess.run([python, __file__, "--work", folder], check=True, cwd=given.out.parent, env=env)
    return compare(*sides)


def compare(old: tuple[str, Path], new: tuple[str, Path]) -> int:
    """Compare two sides, each a version and its folder; write and print what was found."""
    sys.path.insert(0, str(ROOT / "tests"))
    import by_key  # noqa: PLC0415 - it lies with the tests

    listed = by_key.read_expected(ROOT / "benchmarks" / "differences.toml")
    compared: Counter[str] = Counter()
    on_purpose: Counter[str] = Counter()
    unexpected: list[str] = []
    unseen = set(listed)
    for name, *both in pairs(old[1], new[1]):
        first, second = (unversioned(one, side[0]) for one, side in zip(both, (old, new), strict=True))
        kind = name.split("/")[0] if name.startswith("answers") else Path(name).suffix
        compared[kind] += 1
        compared["rows of ledgers"] += len(first) if name.endswith("ledger.sqlite") and isinstance(first, dict) else 0
        for difference in by_key.differences(first, second):
            covering = [entry for entry in listed if entry.covers(name, difference)]
            if covering:
                on_purpose[covering[0].reason] += 1
                unseen.difference_update(covering)
            else:
                unexpected.append(f"{name}: {difference}")
    found = {
        "old": old[0],
        "new": new[0],
        "commit": subprocess.run(
            ["git", "rev-parse", "HEAD"], check=True, capture_output=True, text=True, cwd=ROOT
        ).stdout.strip(),
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "python": sys.version.split()[0],
        "compared": dict(sorted(compared.items())),
        "left out": {"keys": sorted(CLOCKS), "columns": sorted(TIMES), "in words": "the version itself"},
        "on purpose": dict(sorted(on_purpose.items())),
        "listed, and not seen": sorted(f"{one.answer}: {' > '.join(one.key)}" for one in unseen),
        "unexpected": unexpected,
    }
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print("\n".join(unexpected[:200]) or "nothing differs but what is listed")
    print({key: value for key, value in found.items() if key != "unexpected"}, f"unexpected: {len(unexpected)}")
    return int(bool(unexpected))


if __name__ == "__main__":
    sys.exit(main())
