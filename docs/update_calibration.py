"""Write the tables of a calibration into benchmarks/results/calibration, and their summary into docs/calibration.md.

Usage: eyechart calibrate --replications 200 --json > found.json; python docs/update_calibration.py found.json
"""

import csv
import datetime as dt
import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path

from eyechart import __version__
from eyechart_organisms.calibration.table import tables
from eyechart_organisms.calibration.tally import read_calibration

PAGE = Path(__file__).with_name("calibration.md")
FOLDER = Path(__file__).parents[1] / "benchmarks" / "results" / "calibration"
BLOCK = re.compile(r"(<!-- calibration: .*? -->\n).*?(<!-- end of calibration -->)", re.DOTALL)
HEAD = ("setting", "bank", "right, with", "undecided, with", "right, without", "undecided, without", "false, most")

Rows = list[list[str]]


def parts(text: str) -> tuple[str, dict[str, Rows]]:
    """Return what a calibration says beside its tables, and each table's rows, its head first, by title."""
    said, *rest = re.split(r"^### ", text, flags=re.MULTILINE)
    found = {}
    for part in rest:
        title, *lines = part.splitlines()
        rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines if line.startswith("|")]
        found[title] = [row for row in rows if not row[0].startswith("---")]
    after = [line for line in rest[-1].splitlines()[1:] if line and not line.startswith("|")]
    return "\n\n".join([said.strip(), *after]), found


def file_of(title: str) -> str:
    """Return the name of the file of a table: the first six words of its title."""
    return "-".join(re.findall(r"\w+", title.lower())[:6]) + ".csv"


def summary(found: Mapping[str, Rows]) -> str:
    """Return a table by setting, of the tables by the names of their files.

    Shares of right labels are means over the controllers; the last column is the largest share of an untrue claim.
    """
    lines = ["| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
    claims = found["false-claims-share-over-the-controllers.csv"]
    for setting, bank in found["settings.csv"][1:]:
        cells = [setting, bank]
        for variant in ("with", "without"):
            rows = found[f"share-of-right-labels-{variant}-counterfactuals.csv"]
            column = [float(row[rows[0].index(setting)]) for row in rows[1:]]
            cells += [f"{sum(column[:-1]) / len(column[:-1]):.3f}", f"{column[-1]:.3f}"]
        untrue = [float(cell.split(" ")[0]) for row in claims[1:] if row[0] == setting for cell in row[2:]]
        lines.append("| " + " | ".join([*cells, f"{max(untrue):.4f}"]) + " |")
    return "\n".join(lines)


def block(command: str, said: str, found: Mapping[str, Rows]) -> str:
    """Return what stands between the marks of the page."""
    listed = "\n".join(f"- [{title}](../benchmarks/results/calibration/{file_of(title)})" for title in found)
    by_file = {file_of(title): rows for title, rows in found.items()}
    return f"{command}\n\n{said}\n\n{summary(by_file)}\n\n{listed}\n"


def write(command: str, text: str) -> None:
    """Write each table of a calibration to its file, and the summary into the page."""
    said, found = parts(text)
    FOLDER.mkdir(parents=True, exist_ok=True)
    for title, rows in found.items():
        with (FOLDER / file_of(title)).open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(BLOCK.sub(lambda match: match[1] + block(command, said, found) + match[2], page), encoding="utf-8")


def main() -> None:
    """Write what a calibration found, with its command, version and date."""
    calibration = read_calibration(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
    command = f"`eyechart calibrate --replications {calibration.replications} --seed {calibration.seed}`"
    day = dt.datetime.now(dt.UTC).date()
    write(f"Written by {command}, version {__version__}, on {day}.", tables(calibration))


if __name__ == "__main__":
    main()
