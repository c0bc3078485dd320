"""The index of a folder of runs: nothing in it is left out, models stand side by side, and each over time."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import banks
import stand_ins
from eyechart import models
from eyechart.cli.app import app
from eyechart.errors import SpecError
from eyechart.limits import Limits
from eyechart.overview import find_runs, history_table, holds_runs, make_index, models_table, read_index, runs_table
from eyechart.studies import Reading, battery, prompts
from report_runs import HOSTILE

READING = Reading(independent=False, reread=False)
NOISY, STEADY = stand_ins.SPECS


def silent(_: str) -> None:
    """Tell nobody."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of runs: one model twice on one bank, once on another and half done; a ledger that is none."""
    root = tmp_path_factory.mktemp("index")
    small, other = (banks.build_bank(root / f"steps-{steps}", drawn=False, steps=steps) for steps in (3, 4))
    runs = root / "runs"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(models.ADAPTERS, "standin", "stand_ins")
        battery.run(battery.plan(small.root, [STEADY], runs / "a"))
        battery.run(battery.plan(small.root, [STEADY, NOISY], runs / "later" / "b"))
        battery.run(battery.plan(other.root, [STEADY], runs / "later" / "c"), concurrency=1, limits=Limits(calls=20))
        battery.run(battery.plan(small.root, [NOISY], runs / "lost"))
    (runs / "lost" / "ledger.sqlite").write_text("<b>no ledger</b>")
    (runs / "notes").mkdir()
    return runs


def test_every_run_has_a_row_however_deep_and_whatever_came_of_it(folder: Path) -> None:
    """What is not finished and what cannot be scored is said to be so, with the reason."""
    entries = read_index(folder, READING, silent)
    assert sorted((one.run, one.model) for one in entries) == [
        ("a", STEADY),
        ("later/b", NOISY),
        ("later/b", STEADY),
        ("later/c", STEADY),
        ("lost", ""),
    ]
    found = {one.run: one.found for one in entries}
    assert found["lost"].label == "cannot be scored"
    assert "is no ledger" in found["lost"].marks[0]
    assert found["later/c"].state == "unfinished: 20 of 192 calls"
    rows = runs_table(entries).texts()
    assert {row[2] for row in rows} == {"a", "later/b", "later/c", "lost"}
    of_a = next(one for one in entries if one.run == "a")
    score = battery.score(folder / "a")
    (verdict,) = battery_verdicts(score)
    assert (of_a.found.label, of_a.found.decided_by) == verdict


def battery_verdicts(score: battery.BatteryScore) -> list[tuple[str, str]]:
    """Return what ``verdict`` says of each model."""
    from eyechart.verdicts import judge  # noqa: PLC0415 - beside what the index says

    return [(one.calibrated.label, one.calibrated.decided_by) for one in judge(score).values()]


def test_a_model_over_time_is_held_against_the_run_before(folder: Path) -> None:
    """It says whether the verdict is the same, and what was asked otherwise; a model asked once has no history."""
    entries = read_index(folder, READING, silent)
    rows = [row for row in history_table(entries).texts() if row[0] == STEADY]
    assert [row[3] for row in rows] == ["a", "later/b", "later/c"]
    assert rows[0][2] == "the first"
    assert rows[1][2] == "the same verdict, asked the same"
    assert rows[2][2].endswith("not the same bank")
    assert NOISY not in {row[0] for row in history_table(entries).texts()}


def test_models_stand_side_by_side_by_bank(folder: Path) -> None:
    """A bank a column; who was not asked there has a dash."""
    found = models_table(read_index(folder, READING, silent))
    assert found.names == ["model", "steps-3", "steps-4"]
    assert next(row for row in found.texts() if row[0] == NOISY)[2] == "—"


def test_a_prompt_study_is_one_run_and_runs_of_one_prompt_are_several(tmp_path: Path, folder: Path) -> None:
    """The cells of a study are the same models and frames, each asked otherwise: its own report is about them."""
    bank = banks.build_bank(tmp_path / "bank", drawn=False)
    prompts.run(prompts.plan(bank.root, ["scripted:constant"], tmp_path / "study", limit=4))
    assert not holds_runs(tmp_path / "study")
    assert find_runs(tmp_path / "study") == [tmp_path / "study"]
    assert holds_runs(folder)
    assert [path.name for path in find_runs(folder)] == ["a", "b", "c", "lost"]
    assert not holds_runs(folder / "a")
    with pytest.raises(SpecError, match="is no run and holds none"):
        make_index(folder / "notes", READING, silent)


def test_nothing_in_an_index_is_markup_and_links_are_not_followed(folder: Path, tmp_path: Path) -> None:
    """Names of folders come from anywhere; a link may lead anywhere."""
    (tmp_path / HOSTILE[1].replace("/", "∕")).mkdir()
    (tmp_path / HOSTILE[1].replace("/", "∕") / "run.json").write_text("{}")
    (tmp_path / "link").symlink_to(folder)
    html = make_index(tmp_path, READING, silent).page.html.decode()
    assert "<script>window" not in html
    assert html.count("<script") == 2
    assert "later" not in html


def report(*words: object) -> Result:
    """Run ``eyechart report``."""
    return CliRunner().invoke(app, ["report", *map(str, words)])


def test_report_of_a_folder_writes_the_index_with_its_tables(folder: Path, tmp_path: Path) -> None:
    """What is only about runs themselves is refused by name."""
    said = report(folder, "--out", tmp_path / "index.html", "--tables", tmp_path / "tables")
    assert said.exit_code == 0, said.output
    assert "What do these runs say of each model?" in (tmp_path / "index.html").read_text()
    assert {path.name for path in (tmp_path / "tables").glob("*.csv")} == {"runs.csv", "models.csv", "history.csv"}
    refused = report(folder, "--out", tmp_path / "other.html", "--figures", tmp_path / "figures")
    assert isinstance(refused.exception, SpecError)
    assert str(refused.exception) == "an index of runs takes no --figures: give the runs themselves"
    assert not (tmp_path / "other.html").exists()


def test_a_model_whose_runs_have_no_verdict_has_a_row_and_no_history(tmp_path: Path) -> None:
    """As drives have none, beside a battery of others."""
    made = Path(__file__).parent / "old" / "0.1.0" / "made"
    for name in ("drives", "battery"):
        shutil.copytree(made / name, tmp_path / name)
    entries = read_index(tmp_path, READING, silent)
    assert {one.found.label for one in entries if one.run == "drives"} == {"no verdict"}
    assert not history_table(entries).rows
    assert {row[2] for row in runs_table(entries).texts()} == {"drives", "battery"}


def test_an_index_says_whether_an_estimator_is_admitted_and_by_which_clause(tmp_path: Path) -> None:
    """Of pairs, and of what it met while it drove; a run that is older than the checks of its frames cannot say."""
    made = Path(__file__).parent / "old" / "0.1.0" / "made"
    for name in ("structured", "online"):
        shutil.copytree(made / name, tmp_path / name)
    found = {(one.study, one.model): one.found for one in read_index(tmp_path, READING, silent)}
    over = found["estimates", "scripted:scene_over_calling"]
    assert (over.label, over.tone, over.decided_by) == ("not admitted", "bad", "close_accuracy")
    assert over.estimate is not None
    assert over.estimate.n > 0
    drove = {one.label for (study, _), one in found.items() if study == "drives"}
    assert drove == {"admission cannot be said"}
