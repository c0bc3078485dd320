"""The page on calibration sums up tables that stand in files, and says no number that is not theirs."""

import csv
import re

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
