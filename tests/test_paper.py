"""The paper's tables and figures from runs: by label, joined over kinds of run, and what is missing is named."""

import csv
import hashlib
import json
import shutil
from dataclasses import fields, replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eyechart.cli.app import app
from eyechart.costs import Account
from eyechart.errors import SpecError
from eyechart.paper import LABELS, WRITTEN, artefacts, write
from eyechart.report.accounts import deployment_table

MADE = Path(__file__).parent / "old" / "0.1.0" / "made"
KINDS = ("battery", "drives", "ladder", "hierarchy", "structured", "online", "prompts")


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder that the paper of a run of each kind was written to."""
    folder = tmp_path_factory.mktemp("paper") / "out"
    write(artefacts([MADE / name for name in KINDS], [MADE / "highway"], guardian=MADE / "watcher.json"), folder)
    return folder


def test_a_run_of_each_kind_writes_every_label_that_runs_determine(out: Path) -> None:
    """Each in all its forms; a table bears the paper's label."""
    for label in LABELS:
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
    assert (both["parse"], both["crash"], both["crash n"]) == ("1.0", "0.5", "2")
    assert (static["bal. acc."], static["crash"]) == ("0.5", "")


def test_what_is_missing_is_named_with_the_run_that_it_needs(tmp_path: Path) -> None:
    """And nothing is written for it; a run's own files are not written over."""
    done = CliRunner().invoke(app, ["paper", str(MADE / "prompts"), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0
    assert "missing  t:frontier: needs a run of eyechart run battery\n" in done.stdout
    assert {one.stem for one in (tmp_path / "out").glob("[!.]*")} == {"t-prompts", "costs"}


def test_what_an_earlier_call_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    """Neither what somebody changed or put there, nor a file outside of the folder that its record names."""
    words = ["--out", str(tmp_path / "out"), "--json"]
    first = CliRunner().invoke(app, ["paper", str(MADE / "prompts"), *words])
    assert "t-prompts.tex" in json.loads(first.stdout)["files"]
    mine, changed = tmp_path / "out" / "t-mine.tex", tmp_path / "out" / "t-prompts.md"
    mine.write_text("mine")
    changed.write_text("changed")
    outside = tmp_path / "outside.csv"
    outside.write_text("outside")
    record = tmp_path / "out" / WRITTEN
    listed = json.loads(record.read_text())
    listed["files"]["../outside.csv"] = hashlib.sha256(b"outside").hexdigest()
    record.write_text(json.dumps(listed))
    found = json.loads(CliRunner().invoke(app, ["paper", str(MADE / "hierarchy"), *words]).stdout)
    assert {"t-prompts.tex", "t-prompts.csv"} <= set(found["removed"])
    assert found["kept"] == ["t-prompts.md"]
    left = {one.name for one in (tmp_path / "out").iterdir()}
    assert left == {*found["files"], "t-mine.tex", "t-prompts.md", WRITTEN}
    assert outside.read_text() == "outside"
    record.write_text("[]")
    assert CliRunner().invoke(app, ["paper", str(MADE / "hierarchy"), *words]).exit_code == 0


def test_runs_of_one_kind_stand_in_one_table_and_say_whose_row_it_is(tmp_path: Path) -> None:
    """A row that two studies both hold is named with its run, and no label is there twice."""
    again = tmp_path / "again"
    shutil.copytree(MADE / "hierarchy", again)
    write(artefacts([MADE / "hierarchy", again]), tmp_path / "out")
    with (tmp_path / "out" / "t-mpc-intent.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["intent source"]: row["goal"] for row in csv.DictReader(file)}
    assert rows["hierarchy · random intent"] == rows["again · random intent"] == "1/2"
    texts = "".join(path.read_text(encoding="utf-8") for path in (tmp_path / "out").glob("*.tex"))
    assert texts.count(r"\label{t:mpc-intent}") == 1


def test_a_guardian_without_votes_says_what_to_name() -> None:
    """A run of no scene estimates holds none."""
    with pytest.raises(SpecError, match="name a run of scene estimates, or a table of votes"):
        artefacts([MADE / "prompts"], guardian=MADE / "watcher.json")


def test_a_model_that_is_billed_costs_so_much_a_thousand_decisions() -> None:
    """Dollars are of decisions and not of calls: one that was cut off costs too, and decides nothing."""
    account = Account(
        **{name.name: {} if "Mapping" in str(name.type) else None for name in fields(Account)}
        | {"calls": 10, "finished": 10, "attempts": 10, "unknown": 0, "missing": {"truncated": 2}, "seconds": 5.0}
        | {"completion_tokens": 400, "cost_usd": 0.016, "cost_from": {"priced": 10}}
        | {"energy_j": 80.0, "energy_measured": 10, "latency_median_s": 0.5}
    )
    lacking = replace(account, cost_from={"priced": 9, "unknown": 1}, energy_measured=9)
    halfway = replace(account, finished=9)
    table = deployment_table({"a": account, "b": lacking, "c": halfway})
    assert "whose endpoint the paper does not name: --prices FILE" in table.note
    assert "Price unknown" not in deployment_table({"a": account}).note
    (row, other, third) = table.rows
    assert row[2:6] == (2.0, 40.0, 0.2, 0.5)
    assert row[7] == 10.0
    assert "Energy is gross" in table.note
    assert "idle draw" in table.note
    assert "Energy" not in deployment_table({"a": replace(account, energy_j=None, energy_measured=0)}).note
    assert (other[2], other[7], third[2]) == (None, None, None)
