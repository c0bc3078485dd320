"""The paper's tables and figures from runs: by label, joined over kinds of run, and what is missing is named."""

import csv
import hashlib
import json
import re
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
from eyechart.report.table import Column, Table, stack_tables
from eyechart.studies import battery, structured
from eyechart.studies.structured import online
from eyechart.studies.structured.tables import POSITIVE, crashes_table, paper_tables

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
        assert {path.suffix for path in out.glob(f"{stem}.*")} == (
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
    assert {path.stem for path in (tmp_path / "out").glob("[!.]*")} == {"t-prompts", "costs", "corpus"}


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
    left = {path.name for path in (tmp_path / "out").iterdir()}
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
    with pytest.raises(SpecError, match="give a run of scene estimates, or a table of votes"):
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
    assert "Set a price with --prices FILE" in table.note
    assert "Price unknown" not in deployment_table({"a": account}).note
    own = deployment_table({"python:mine": lacking, "trained:sees": lacking}).note
    assert "A local callable has no price" in own
    assert "the paper does not name their endpoint" not in own
    both = deployment_table({"python:mine": lacking, "b": lacking}).note
    assert "A local callable has no price" in both
    assert "the paper does not name their endpoint" in both
    (row, other, third) = table.rows
    assert row[2:6] == (2.0, 40.0, 0.2, 0.5)
    assert row[7] == 10.0
    assert "Energy is gross" in table.note
    assert "idle draw" in table.note
    assert "Energy" not in deployment_table({"a": replace(account, energy_j=None, energy_measured=0)}).note
    assert (other[2], other[7], third[2]) == (None, None, None)


def test_every_table_says_of_how_many_it_is(out: Path) -> None:
    """In its caption, as the paper's do: frames and conditions, pairs and episodes, queries, worlds, decisions."""
    captions = {path.stem: path.read_text(encoding="utf-8").splitlines()[0] for path in out.glob("t-*.md")}
    for stem, says in {
        "t-frontier": r"\d+ frames × 8 of the paper's conditions per model",
        "t-qwenorder": r"\d+ real frames per model",
        "t-controller-local": r"\d+ pairs of original and mirror per estimator; online, \d+ episodes per estimator",
        "t-prompts": r"\d+ queries with the real picture per cell",
        "t-mpc-intent": r"\d+ paired worlds per source",
        "t-baselines": r"\d+ episodes per policy",
        "t-degeneracy": r"\d+( or | to )?\d* decisions per cell",
    }.items():
        assert re.search(says, captions[stem]), captions[stem]
    assert "the paper's rows have 32 episodes" in (out / "baselines-beside.md").read_text(encoding="utf-8")


def test_runs_of_other_sizes_say_theirs_in_a_row(tmp_path: Path) -> None:
    """A number of twelve frames does not stand beside one of two as if they were alike."""
    for limit in (2, 3):
        planned = battery.plan(
            MADE / "highway", ["scripted:depth"], tmp_path / f"of{limit}", extent=battery.BatterySelection(limit)
        )
        battery.run(planned)
    (table,) = (one for one in artefacts([tmp_path / "of2", tmp_path / "of3"]).tables if one.label == "t:frontier")
    assert "2 or 3 frames × 8 of the paper's conditions per model" in table.caption
    assert table.rows[0] == ("frames", "2", "3")
    assert table.rows[1][0] == "unparsed rate"


def test_a_column_says_n_where_rows_differ() -> None:
    """And the caption the fewest and the most; where all are alike, the caption alone."""
    table = Table("", "Some", (Column("who"),), (("a",), ("b",), ("c",)))
    assert (alike := table.counted([4, None, 4], "pairs", "each")).caption == "Some, 4 pairs each"
    assert alike.columns == table.columns
    other = table.counted([4, 2, 9], "pairs")
    assert other.caption == "Some, 2 to 9 pairs"
    assert other.rows == (("a", 4), ("b", 2), ("c", 9))


def test_sixteen_pairs_of_admission_are_not_the_papers_table() -> None:
    """Which is of 288 pairs: they stand in a table of their own, and the label is missing."""
    scored = structured.score(MADE / "structured")
    assert [paper_table.label for paper_table in paper_tables({"run": scored})] == ["t:controller-local"]
    (table,) = paper_tables({"run": replace(scored, manifest=replace(scored.manifest, study="admission"))})
    assert (table.label, table.name) == ("", "admission")


def test_what_worlds_were_vetted_by_is_the_row_of_the_positive_control() -> None:
    """One row in the table, as in the paper; of two runs none for the vetting where it drove itself."""
    scored = online.score(MADE / "online")
    assert online.CONTROL in scored.driven
    assert [row[0] for row in crashes_table({"run": scored}).rows] == [POSITIVE, *scored.manifest.models]
    assert [row[0] for row in crashes_table({"run": scored, "again": scored}).rows].count(POSITIVE) == 1
    own = replace(scored, driven={**scored.driven, POSITIVE: replace(scored.driven[online.CONTROL], errors=1)})
    both = crashes_table({"run": scored, "own": own}).rows
    assert [row[0] for row in both if POSITIVE in str(row[0])] == [POSITIVE]


def test_notes_of_stacked_tables_are_joined_in_any_order() -> None:
    """A price that only one of the runs lacks is not lost."""
    tables = {
        "a": Table("", "", (Column("who"),), (("x",),), "— unknown"),
        "b": Table("", "", (Column("who"),), (("y",),), "— unknown. Price unknown: none has it"),
    }
    for order in (("a", "b"), ("b", "a")):
        assert stack_tables({name: tables[name] for name in order}).note == "— unknown. Price unknown: none has it"


def test_entropy_against_information_is_drawn_of_models_only() -> None:
    """As Table t:degeneracy has them: a ladder of policies writes neither."""
    found = artefacts([MADE / "ladder"])
    assert "fgr-mi" not in {drawing.name for drawing in found.drawings}
    assert {"fgr:mi", "t:degeneracy"} <= found.missing.keys()
    (drawn,) = (drawing for drawing in artefacts([MADE / "drives"]).drawings if drawing.name == "fgr-mi")
    assert "constant:" not in drawn.description
    assert "oracle" not in drawn.description


def test_numbers_of_the_frontier_stand_unrounded_with_interval_and_n(out: Path) -> None:
    """A row each; so do medians of gaps and the audit's numbers in their own tables."""
    with (out / "frontier-numbers.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["statistic"] == "agree.blank"]
    assert all(int(row["n"]) and row["interval low"] for row in rows)
    for stem, name in (("t-qwenorder", "med. gap (m)"), ("t-degeneracy", "modal")):
        with (out / f"{stem}.csv").open(encoding="utf-8", newline="") as file:
            (row, *_) = csv.DictReader(file)
        assert {f"{name} low", f"{name} high", f"{name} n"} <= row.keys()
        assert int(row[f"{name} n"])


def test_rows_of_the_papers_model_stand_below_ones_own(out: Path) -> None:
    """In both ablations, with the share of STOP where the paper prints one."""
    with (out / "mpc-intent-primary-beside.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["intent source"]: row for row in csv.DictReader(file)}
    theirs = rows["VLM, mirrored (the paper's)"]
    assert (theirs["paper's goal"], theirs["paper's dist."], theirs["paper's STOP"]) == ("8/25", "47.1", "0.812")
    assert theirs["goal"] == theirs["STOP"] == ""
    assert rows["random intent"]["STOP"]
    assert rows["random intent"]["paper's STOP"] == "0.214"
    with (out / "mpc-intent-second-beside.csv").open(encoding="utf-8", newline="") as file:
        second = {row["intent source"]: row["paper's crash"] for row in csv.DictReader(file)}
    assert second["lateral VLM intent (the paper's)"] == "32/32"
    assert second["full VLM intent (the paper's)"] == "11/32"


def test_prompts_without_the_noise_floor_say_what_to_ask(out: Path) -> None:
    """Both numbers are empty where no picture was shown twice."""
    text = (out / "t-prompts.md").read_text(encoding="utf-8")
    assert "with --conditions real,real\\_repeat,blank" in text


def test_a_folder_of_runs_is_taken_for_the_runs_in_it(tmp_path: Path) -> None:
    """And what is missing is said beside the run that is given, not as if it were not."""
    shutil.copytree(MADE / "structured", tmp_path / "runs" / "structured")
    shutil.copytree(MADE / "prompts", tmp_path / "runs" / "prompts")
    words = ["paper", str(tmp_path / "runs"), "--frames", str(MADE / "highway"), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert {"t-prompts.tex", "t-controller-local.tex"} <= {path.name for path in (tmp_path / "out").iterdir()}
    says = "missing  t:positive-guardian: needs the run of eyechart run structured with --guardian, a file of eyechart"
    assert says in done.stdout


def test_the_corpus_is_counted_by_study_with_its_sum(out: Path) -> None:
    """Queries and episodes of every run, probes and replies without a decision apart; the sum is that of its rows."""
    with (out / "t-corpus.csv" if (out / "t-corpus.csv").exists() else out / "corpus.csv").open(newline="") as file:
        *rows, last = csv.DictReader(file)
    assert last["run"] == "sum"
    for name in ("scored", "unparsed", "failed", "open", "probe"):
        assert sum(int(row[name]) for row in rows) == int(last[name])
    assert {row["study"] for row in rows} >= {"battery", "structured", "drives"}
    assert int(last["episodes"]) <= sum(int(row["episodes"]) for row in rows)
    lines = (MADE / "battery" / "run.json").read_text(encoding="utf-8")
    (mine,) = (row for row in rows if row["run"] == "battery")
    assert int(mine["scored"]) + int(mine["failed"]) > 0
    assert json.loads(lines)["study"] == mine["study"]


def test_results_without_a_label_stand_beside_the_others(out: Path, tmp_path: Path) -> None:
    """Tests and nested choice of a guardian, modular replay, a run asked again, and transfer of external scores."""
    assert {"guardian-tests.tex", "nested.tex", "modular.tex"} <= {path.name for path in out.iterdir()}
    again = tmp_path / "again"
    shutil.copytree(MADE / "battery", again)
    models = list(json.loads((again / "run.json").read_text(encoding="utf-8"))["models"])
    scores = tmp_path / "scores.csv"
    scores.write_text("model,score\n" + "".join(f"{model},{place}\n" for place, model in enumerate(models)))
    runs = [str(MADE / "battery"), str(again), "--frames", str(MADE / "highway")]
    done = CliRunner().invoke(app, ["paper", *runs, "--scores", str(scores), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    with (tmp_path / "out" / "replication.csv").open(newline="") as file:
        found = {row["statistic"]: row for row in csv.DictReader(file)}
    assert float(found["idi"]["first"]) == float(found["idi"]["second"])
    with (tmp_path / "out" / "transfer.csv").open(newline="") as file:
        assert [row["correlation"] for row in csv.DictReader(file)] == ["Pearson", "Spearman"]


def test_admission_says_who_is_admitted_and_which_clauses_fail() -> None:
    """Beside the seven figures."""
    scored = structured.score(MADE / "structured")
    (table,) = paper_tables({"run": replace(scored, manifest=replace(scored.manifest, study="admission"))})
    rows = {row[0]: row[-2:] if table.columns[-1].name == "clauses" else row[-3:-1] for row in table.rows}
    assert {"admitted", "clauses"} <= set(table.names)
    for spec, model in scored.models.items():
        assert rows[spec][0] == ("yes" if model.is_admitted else "no")
        fails = [each.name for each in model.clauses if each.passes is False]
        assert all(f"{name} fails" in str(rows[spec][1]) for name in fails)
