"""How many small faults, put into the code one at a time, the tests notice: mutmut over the rooms that decide.

    make mutants
    python benchmarks/mutants.py --rooms stats,mpc --minutes 60 --sample 150

Rooms are tested in the order given. All mutants of ``verdicts/``, and a seeded sample of 300 of ``stats/``, of the
guardian's fitting and of the controller; with ``--sample`` at most so many of these, a seeded sample again, and the
result says how many. The work lies in ``build/mutants``: results stay there, so that an interrupted run goes on where
it stopped; of a function that changed, mutmut forgets them. A mutant that no test can tell apart is listed in
``benchmarks/equivalent_mutants.toml`` by its module, the line it takes out and the line it puts in, with the reason; it
counts nowhere. Writes ``benchmarks/results/mutants.json``; exit 1 where a room that was tested whole is below its
share.
"""

import argparse
import ast
import datetime as dt
import difflib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from eyechart import __version__
from eyechart.stats.agreement import clopper_pearson

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks" / "results" / "mutants.json"
EQUIVALENT = ROOT / "benchmarks" / "equivalent_mutants.toml"
WORK = ROOT / "build" / "mutants"
MUTMUT = Path(sys.executable).parent / "mutmut"
COPIED = ("src", "tests", "docs", "README.md", "CHANGELOG.md", "pyproject.toml")
FEW = "eyechart.verdicts.admission.*"
SEED, SAMPLE = 13, 300
SURVIVED, NO_TESTS, KILLED, TIMEOUTS = 0, (5, 33), (1, 3), (24, -24, 36, 152, 255, -9, -11)


class Room(NamedTuple):
    """Mutants whose names begin so; ``whole`` rooms are tested whole, of others a sample is."""

    name: str
    prefixes: tuple[str, ...]
    share: float
    whole: bool = False


ROOMS = (
    Room("verdicts", ("eyechart.verdicts.",), 0.90, whole=True),
    Room("stats", ("eyechart.stats.",), 0.90),
    Room("guardian", ("eyechart.studies.guardian.",), 0.80),
    Room("mpc", ("eyechart.mpc.",), 0.80),
)


def copy() -> None:
    """Bring the work's copy of the code and the tests up to date; files that stay the same keep their time."""
    for name in COPIED:
        source = ROOT / name
        files = [source] if source.is_file() else [path for path in source.rglob("*") if path.is_file()]
        wanted = {WORK / file.relative_to(ROOT): file for file in files if "__pycache__" not in file.parts}
        for place, one in wanted.items():
            if not place.exists() or place.read_bytes() != one.read_bytes():
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(one, place)
        there = [] if source.is_file() else [path for path in (WORK / name).rglob("*") if path.is_file()]
        for place in there:
            if place not in wanted and "__pycache__" not in place.parts:
                place.unlink()
                (WORK / "mutants" / place.relative_to(WORK)).unlink(missing_ok=True)


def outcomes() -> dict[str, int | None]:
    """Return what came of each mutant, by its name: an exit code of the tests, None where they were not run."""
    result: dict[str, int | None] = {}
    for path in sorted((WORK / "mutants" / "src").rglob("*.meta")):
        if (WORK / path.relative_to(WORK / "mutants").with_suffix("")).exists():
            result |= json.loads(path.read_text())["exit_code_by_key"]
    return result


def chosen(names: Sequence[str], room: Room, most: int | None = None) -> list[str]:
    """Return the mutants of a room that are tested, at most so many: a seeded sample of those that would be."""
    own = sorted(name for name in names if name.startswith(room.prefixes))
    if not room.whole and len(own) > SAMPLE:
        own = sorted(random.Random(SEED).sample(own, SAMPLE))  # noqa: S311
    return own if most is None or len(own) <= most else sorted(random.Random(SEED).sample(own, most))  # noqa: S311


def run(names: Sequence[str], children: int, seconds: float) -> int:
    """Let mutmut test some mutants for so long; what it has found then stays. Returns its exit code."""
    with (WORK / "log.txt").open("w") as log:
        command = [str(MUTMUT), "run", "--max-children", str(children), *names]
        process = subprocess.Popen(command, cwd=WORK, stdout=log, stderr=log, start_new_session=True)
        try:
            return process.wait(max(seconds, 1))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGTERM)  # and those that it started
            process.wait()
            return 0


@lru_cache(maxsize=64)
def functions_of(module: str) -> Mapping[str, Sequence[str]]:
    """Return the lines of each function of a mutated module by its name there, stripped, without its `def`."""
    path = WORK / "mutants" / "src" / Path(*module.split("."))
    path = path.with_suffix(".py") if path.with_suffix(".py").exists() else path / "__init__.py"
    text = path.read_text(encoding="utf-8")
    lines = [line.strip() for line in text.splitlines()]
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    return {
        node.name: lines[node.lineno : node.end_lineno] for node in ast.walk(ast.parse(text)) if isinstance(node, kinds)
    }


def change_of(name: str) -> tuple[str, str]:
    """Return the lines that a mutant takes out and puts in."""
    found, own = functions_of(module_of(name)), name.rpartition(".")[2]
    before, after = found[own.rpartition("__mutmut_")[0] + "__mutmut_orig"], found[own]
    told = list(difflib.unified_diff(before, after, n=0, lineterm=""))[2:]
    parts = ("\n".join(line[1:] for line in told if line.startswith(sign)) for sign in "-+")
    return next(parts), next(parts)


def module_of(name: str) -> str:
    """Return the module of a mutant."""
    return name.rsplit(".", 1)[0]


def summary(
    room: Room,
    found: Mapping[str, int | None],
    equivalent: Mapping[tuple[str, str, str], str],
    most: int | None = None,
) -> dict[str, object]:
    """Return a room's share with its interval, and which mutants the tests did not notice."""
    asked = chosen(list(found), room, most)
    tested = {name: code for name in asked if (code := found[name]) is not None}
    alive = [name for name, code in tested.items() if code == SURVIVED or code in NO_TESTS]
    told = {name: change_of(name) for name in alive}
    same = [name for name in alive if (module_of(name), *told[name]) in equivalent]
    survivors = {
        name: {"out": told[name][0], "in": told[name][1], "tested": found[name] not in NO_TESTS}
        for name in alive
        if name not in same
    }
    n, killed = len(tested) - len(same), len(tested) - len(alive)
    return {
        "mutants": sum(name.startswith(room.prefixes) for name in found),
        "chosen": len(asked),
        "tested": len(tested),
        "killed": killed,
        "by_time": sum(code in TIMEOUTS for code in tested.values()),
        "equivalent": len(same),
        "share": round(killed / n, 4) if n else None,
        "ci": [round(end, 4) for end in clopper_pearson(killed, n)] if n else None,
        "wanted": room.share,
        "survivors": survivors,
    }


def write(
    rooms: Sequence[Room], found: Mapping[str, int | None], most: int | None = None
) -> dict[str, dict[str, object]]:
    """Write the result whole or not at all, and return it by room; rooms that were not asked for stay as they are."""
    listed = tomllib.loads(EQUIVALENT.read_text())["mutant"] if EQUIVALENT.exists() else []
    equivalent = {(one["module"], one["out"], one["in"]): one["reason"] for one in listed}
    before = json.loads(RESULT.read_text())["rooms"] if RESULT.exists() else {}
    result = {**before, **{room.name: summary(room, found, equivalent, most) for room in rooms}}
    date = dt.datetime.now(tz=dt.UTC).date().isoformat()
    tool = subprocess.run([str(MUTMUT), "--version"], capture_output=True, text=True, check=True).stdout.strip()
    part = RESULT.with_suffix(".part")
    head = {"version": __version__, "date": date, "tool": tool, "seed": SEED}
    part.write_text(json.dumps({**head, "rooms": result}, indent=1, ensure_ascii=False) + "\n")
    part.replace(RESULT)
    return result


def main() -> int:
    """Test the mutants that are not tested yet; return 1 where a room is below its share."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rooms", default=",".join(room.name for room in ROOMS), help="comma-separated (default: all)")
    parser.add_argument("--minutes", type=float, default=24 * 60, help="stop after so long (default: a day)")
    parser.add_argument("--children", type=int, default=2, help="mutants tested at once (default: 2)")
    parser.add_argument("--sample", type=int, help="at most so many mutants a room (default: those said above)")
    parser.add_argument("--again", action="store_true", help="test those once more that the tests did not notice")
    given = parser.parse_args()
    by_name = {room.name: room for room in ROOMS}
    rooms = [by_name[name] for name in given.rooms.split(",")]
    until = time.monotonic() + 60 * given.minutes
    copy()
    if run([FEW], given.children, until - time.monotonic()):  # makes all mutants, and maps tests to them
        print((WORK / "log.txt").read_text()[-3000:])
        return 2
    tests = json.loads((WORK / "mutants" / "mutmut-stats.json").read_text())["tests_by_mangled_function_name"]
    result: dict[str, dict[str, object]] = {}
    for room in rooms:
        found = outcomes()
        wanted = chosen(list(found), room, given.sample)
        left = [name for name in wanted if found[name] is None or (given.again and found[name] == SURVIVED)]
        reached = [name for name in left if tests.get(name.rpartition("__mutmut_")[0])]
        if reached:
            print(f"{room.name}: {len(reached)} mutants to test", flush=True)
            run(reached, given.children, until - time.monotonic())
        result = write([room], outcomes() | dict.fromkeys(set(left) - set(reached), NO_TESTS[0]), given.sample)
    below = False
    for room in rooms:
        one = result[room.name]
        print(room.name, {name: value for name, value in one.items() if name != "survivors"})
        below |= one["tested"] == one["chosen"] and float(str(one["share"])) < room.share
    return 1 if below else 0


if __name__ == "__main__":
    sys.exit(main())
