"""The page on edited photographs cannot rot: its commands run, and its tables are those of the code."""

import csv
import re
import shlex
from dataclasses import asdict
from itertools import takewhile
from pathlib import Path

import pytest
from typer.testing import CliRunner

import annotation_forms
import drawn_roads
from eyechart.cli.app import app
from eyechart.edits import ANNOTATION_FORMATS, PICTURES, EditLimits
from eyechart.edits.annotations import OF_OBJECTS, OF_PHOTOS, ROLES
from eyechart.edits.horizon import LEAST_BOXES

PAGE = (Path(__file__).parents[2] / "docs/edit-photographs.md").read_text(encoding="utf-8")
(TEN,) = re.findall(r"^```sh\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def table(head: str, *, last: bool = False) -> list[list[str]]:
    """Return the cells of the rows below a table's head."""
    lines = PAGE.splitlines()
    start = [number for number, line in enumerate(lines) if line.startswith(head)][-1 if last else 0] + 2
    rows = takewhile(lambda line: line.startswith("|"), lines[start:])
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]


def names(cells: list[str]) -> list[str]:
    """Return what stands in code in a row's first cell."""
    return re.findall(r"`([^`]+)`", cells[0])


def test_its_ten_commands_lead_to_a_gate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each as it stands, with ranges that fit small drawn pictures, and a model whose label is known."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "kitti").mkdir()
    annotation_forms.kitti(tmp_path / "kitti", drawn_roads.some(30))
    lines = TEN.splitlines()
    assert len(lines) == 10
    assert lines[0] == "pip install 'eyechart[edit]'"
    for told in lines[1:]:
        line = told
        words = shlex.split(
            line.replace("5:9", "4:5.5").replace("40:60", "16:20").replace("MODEL", "scripted:constant")
        )
        if words[0] == "cp":
            with Path(words[1]).open() as file:
                rows = [{**row, "beside": "right", "clear_to_m": "60"} for row in csv.DictReader(file)]
            with Path(words[2]).open("w", newline="") as file:
                writer = csv.DictWriter(file, list(rows[0]))
                writer.writeheader()
                writer.writerows(rows)
            continue
        done = CliRunner().invoke(app, [*words[1:], *(("--cut", "box") if words[2] == "edit" else ())])
        assert done.exit_code == (2 if words[1] == "gate" else 0), (line, done.output, done.exception)
    with Path("edited/table.csv").open() as file:
        made = list(csv.DictReader(file))
    assert sum(bool(row["exchange_own"]) for row in made) > 10
    assert sum(bool(row["lead_near"]) for row in made) > 10


def test_its_tables_name_what_there_is() -> None:
    """Columns, roles, forms and pictures, each once."""
    photos = {name for row in table("| column | what it is | without it |") for name in names(row)}
    objects = {name for row in table("| column | what it is |", last=True) for name in names(row)}
    assert photos >= {"file", "episode", "step", "scenario", *OF_PHOTOS}
    assert objects >= set(OF_OBJECTS)
    assert all(f"`{role}`" in PAGE for role in ROLES if role)
    assert [names(row)[0] for row in table("| `--format` |")] == list(ANNOTATION_FORMATS)
    assert [name for row in table("| picture |") for name in names(row)] == list(PICTURES)


def test_its_limits_are_those_of_the_code() -> None:
    """To the number that it prints."""
    limits = asdict(EditLimits())
    rows = "\n".join(" | ".join(row) for row in table("| refused |"))
    for name, said in (
        ("before", "last 3 % of the rows"),
        ("unfilled", "2 % of the hole"),
        ("least_px", "24 rows"),
        ("least_pasted_px", "5 rows"),
        ("above", "25 %"),
        ("covered", "10 %"),
        ("foot_off", "20 %"),
        ("place_off", "35 %"),
        ("largest", "above 4"),
    ):
        number = float(re.findall(r"[\d.]+", said)[0])
        assert said in rows, said
        assert limits[name] == pytest.approx(number / 100 if "%" in said else number)
    assert "below 1/9" in rows
    assert limits["smallest"] == pytest.approx(1 / 9)
    assert f"it comes from {LEAST_BOXES} boxes" in PAGE
