"""The page of edited pictures cannot rot: its bank leads to its gate, and refusals have the reasons that it prints."""

import json
import os
import re
import shlex
import shutil
import sys
from itertools import takewhile
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eyechart.cli.app import app
from eyechart.edits import EditSource, Moves, edit_photographs, read_format
from eyechart.frames import check, open_bank
from eyechart.frames.plain_pictures import require_plain

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "edited-pictures.md").read_text(encoding="utf-8")
BANK = DOCS / "photographs"
(TEN,) = re.findall(r"^```sh\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
MOST_BYTES = 1_000_000
"""Of photographs, labels and sheets together."""


def table(title: str) -> dict[str, list[str]]:
    """Return the cells of a part's rows by the photograph that they are about."""
    part = PAGE.partition(f"\n## {title}\n")[2]
    lines = part[part.index("\n| photograph") :].strip().splitlines()
    rows = takewhile(lambda line: line.startswith("|"), lines[2:])
    cells = ([cell.strip() for cell in row.strip("|").split("|")] for row in rows)
    return {name.strip("`"): rest for name, *rest in cells}


@pytest.fixture(scope="module")
def refused(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, str]]:
    """Return why each picture of each odd photograph is refused, by photograph and picture."""
    out = tmp_path_factory.mktemp("odd") / "edited"
    found = read_format("kitti", BANK / "image_2", BANK / "label_2", BANK / "odd.csv")
    source = EditSource(BANK / "image_2", found, BANK / "label_2", cut="box", finds_leads=True)
    edit_photographs(source, Moves((5, 8), (30, 45), lane_m=3.5, eye_m=1.65, shadow=0.4), out)
    reasons: dict[str, dict[str, str]] = {}
    for one in json.loads((out / "edit.json").read_text())["refused"]:
        reasons.setdefault(one["file"].partition(".")[0], {}).setdefault(one["picture"], one["reason"])
    return reasons


def test_six_are_refused_for_the_reasons_that_it_prints(refused: dict[str, dict[str, str]]) -> None:
    """Five whole, and of one the far picture alone."""
    said = {name: cells[-1] for name, cells in table("Six that are refused").items()}
    whole = {name: pictures["all"] for name, pictures in refused.items() if "all" in pictures}
    assert len(said) == 6
    assert whole == {name: said[name] for name in whole}
    (part,) = said.keys() - whole.keys()
    assert f"its far picture alone: {refused[part]['lead_far']}" == said[part]
    assert not refused[part].keys() & {"lead_near", "lead_drawn", "lead_absent", "patched"}


def test_three_pass_every_check_and_are_thrown_out_by_a_person(refused: dict[str, dict[str, str]]) -> None:
    """No check finds what is wrong with their nearer pictures, and no drive has them."""
    thrown = table("Three that you must throw out")
    assert len(thrown) == 3
    assert not any({"all", "lead_near", "lead_absent"} & refused.get(name, {}).keys() for name in thrown)
    assert not any(name in (BANK / "photos.csv").read_text() for name in thrown)


def test_its_photographs_are_small_and_plain() -> None:
    """Each program shows them alike, and the checkout stays small."""
    files = [one for one in BANK.rglob("*") if one.is_file() and "__pycache__" not in one.parts]
    sheets = [DOCS / name for name in re.findall(r"!\[[^]]+\]\((images/[\w-]+\.jpg)\)", PAGE)]
    assert len(sheets) == 3
    assert sum(one.stat().st_size for one in (*files, *sheets)) < MOST_BYTES
    pictures = sorted((BANK / "image_2").iterdir())
    assert len(pictures) == 68
    for one in pictures:
        require_plain(one.read_bytes(), one.name)


@pytest.mark.slow
def test_its_ten_commands_lead_from_its_photographs_to_a_gate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first gate fails, for edited pictures were not accepted; the second holds."""
    shutil.copytree(BANK, tmp_path / "docs" / "photographs")
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.chdir(tmp_path)
    lines = TEN.splitlines()
    assert len(lines) == 10
    assert lines[0] == "pip install ."
    exits = []
    for line in lines[1:]:
        words = shlex.split(line)
        if words[0] == "cd":
            os.chdir(words[1])
            monkeypatch.syspath_prepend(str(Path.cwd()))
            continue
        done = CliRunner().invoke(app, words[1:])
        exits.append(done.exit_code)
        assert done.exit_code == (1 if line.endswith("--require depth") else 0), (line, done.output, done.exception)
        if words[1] == "verdict":
            assert "depth (edited)" in done.output
    assert exits[-2:] == [1, 0]
    bank = open_bank(Path("bank"))
    assert (len(bank), bank.manifest.provenance, check(Path("bank"))) == (60, "edited", [])
    worked = {frame.file.partition("taken/")[2].partition(".")[0] for frame in bank if frame.counterfactuals}
    assert table("Six that work").keys() <= worked
