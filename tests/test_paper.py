"""The paper's tables and figures from runs: by label, joined over kinds of run, and what is missing is named."""

import csv
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eyechart.cli.app import app
from eyechart.paper import ELSEWHERE, LABELS, artefacts, write

MADE = Path(__file__).parent / "old" / "0.1.0" / "made"
KINDS = ("battery", "drives", "ladder", "hierarchy", "structured", "online", "prompts")


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder that the paper of a run of each kind was written to."""
    folder = tmp_path_factory.mktemp("paper") / "out"
    write(artefacts([MADE / name for name in KINDS]), folder)
    return folder


def test_a_run_of_each_kind_writes_every_label_that_runs_determine(out: Path) -> None:
    """Each in all its forms; a table bears the paper's label."""
    for label in LABELS.keys() - ELSEWHERE.keys():
        stem = label.replace(":", "-")
        assert {one.suffix for one in out.glob(f"{stem}.*")} == (
            {".svg", ".pdf"} if label.startswith("fgr") else {".csv", ".md", ".tex"}
        )
        if label.startswith("t:"):
            assert f"\\label{{{label}}}" in (out / f"{stem}.tex").read_text(encoding="utf-8")


def test_crashes_of_the_online_run_stand_beside_the_static_figures(out: Path) -> None:
    """An estimator that both runs asked has one row; one that only one of them asked has empty cells."""
    with (out / "t-controller-local.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["estimator"]: row for row in csv.DictReader(file)}
    both, static = rows["scripted:scene_side_blind"], rows["scripted:scene_over_calling"]
    assert (both["parse"], both["crash"], both["episodes"]) == ("1.0", "0.5", "2")
    assert (static["bal. acc."], static["crash"]) == ("0.5", "")


def test_what_is_missing_is_named_with_the_run_that_it_needs(tmp_path: Path) -> None:
    """And nothing is written for it; a run's own files are not written over."""
    done = CliRunner().invoke(app, ["paper", str(MADE / "prompts"), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0
    assert "missing  t:frontier: needs a run of eyechart run\n" in done.stdout
    assert {one.stem for one in (tmp_path / "out").iterdir()} == {"t-prompts"}


def test_the_page_of_the_paper_names_every_label() -> None:
    """docs/paper.md says which run determines each."""
    page = (Path(__file__).parents[1] / "docs" / "paper.md").read_text(encoding="utf-8")
    assert set(re.findall(r"(?:t|fgr):[a-z-]+", page)) >= LABELS.keys()
