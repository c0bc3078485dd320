"""The page on calibration sums up tables that stand in files, and says no number that is not theirs."""

import csv
import json
import re
from collections.abc import Iterable, Mapping

from test_site import program

from eyechart_organisms.calibration.tally import LIMITS, WEAK
from pages import ROOT

PAGE = (ROOT / "docs" / "calibration.md").read_text(encoding="utf-8")
FOLDER = ROOT / "benchmarks" / "results" / "calibration"


def test_the_summary_is_that_of_the_tables() -> None:
    """A row a setting, and each file of a table in a list."""
    made = program("update_calibration")
    found = {}
    for path in FOLDER.glob("*.csv"):
        with path.open(encoding="utf-8", newline="") as file:
            found[path.name] = list(csv.reader(file))
    assert made.summary(found) in PAGE
    assert set(re.findall(r"\(\.\./benchmarks/results/calibration/([\w.-]+)\)", PAGE)) == set(found)


def test_a_table_is_read_with_what_is_said_beside_it() -> None:
    """What stands before the first table and behind the last is on the page, the tables are in files."""
    made = program("update_calibration")
    text = "Two runs.\n\n### A, b: share\n\n| one | two |\n|-----|-----|\n| x   |     |\n\nAll targets hold.\n"
    assert made.parts(text) == ("Two runs.\n\nAll targets hold.", {"A, b: share": [["one", "two"], ["x", ""]]})
    assert made.file_of("Stopping early: mean share of calls saved") == "stopping-early-mean-share-of-calls.csv"


def test_what_is_named_has_its_numbers_in_the_table() -> None:
    """A row each, with the share, the interval and the bound that `calibrate` printed, which are today's bounds."""
    said = r"^named: (\w+) gets depth (\d+) of (\d+) times \[0(\.\d+), 0(\.\d+)\], (at \w+) 0(\.\d+): "
    named = re.findall(said, PAGE, re.MULTILINE)
    assert {name: float(bound) for name, *_, bound in named} == {
        name: bound for one in (LIMITS, WEAK) for name, (bound, _) in one.items()
    }
    for name, wrong, n, low, high, at, bound in named:
        row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{name}` |"))
        assert row.endswith(f"| {wrong} of {n} [{low}, {high}] | {bound} {at} |")


ADVERSARIES = json.loads((ROOT / "benchmarks" / "results" / "adversaries.json").read_text(encoding="utf-8"))
WORLD = re.compile(r"^\| \d+ (?:of the (\w+), real pictures|(simulated)), (\d+) \| (.*) \|$", re.MULTILINE)
ELSEWHERE = ("shipped", "files")


def counted(shares: Iterable[str]) -> str:
    """Return shares with intervals added up, without one."""
    each = [one.partition(" [")[0].split(" of ") for one in shares]
    return f"{sum(int(hits) for hits, _ in each)} of {sum(int(of) for _, of in each)}"


def in_the_result(world: str) -> list[str]:
    """Return the cells of a world: those of the newcomers and readers, and those of strangers and shipped ones."""
    found = ADVERSARIES[world]
    by: Mapping[str, Mapping[str, str]] = {claim: one["by kind"] for claim, one in found["untrue"].items()}
    strangers, shipped = (
        {claim: [said for kind, said in kinds.items() if is_one(kind)] for claim, kinds in by.items()}
        for is_one in (lambda kind: kind.startswith("stranger "), lambda kind: kind in ELSEWHERE)
    )
    new = [counted([kinds["new"]]) for kinds in by.values()]
    readers = [counted([one["all"]]) for one in found["readers told so"].values()]
    turns = [counted([*strangers[claim], *shipped[claim]]) for claim in ("depth_lateral", "turns_clear")]
    both = [counted(strangers["depth"]), counted(shipped["depth"]), *turns]
    return [
        " | ".join([*new, counted([found["partial_depth untrue"]["of those called so"]]), *readers]),
        " | ".join(both),
    ]


def test_the_tables_of_the_adversaries_are_those_of_the_result() -> None:
    """Each world that was tried has its row, and those of strangers and shipped adversaries have theirs."""
    rows: dict[str, list[str]] = {}
    for named, simulated, frames, cells in WORLD.findall(PAGE):
        rows.setdefault(named or f"{simulated}-{frames}", []).append(cells)
    assert rows.keys() == {
        world for world, found in ADVERSARIES.items() if isinstance(found, dict) and "untrue" in found
    }
    for world, mine in rows.items():
        new, others = in_the_result(world)
        assert mine == ([new] if others.startswith("0 of 0 | 0 of 0") else [new, others]), world
