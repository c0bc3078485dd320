"""The index of a folder of runs: nothing in it is left out, models stand side by side, and each over time."""

import re
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner, Result

import banks
import stand_ins
from eyechart import models, overview
from eyechart.cli.app import app
from eyechart.errors import SpecError
from eyechart.limits import Limits
from eyechart.overview import (
    Entry,
    find_runs,
    history_table,
    holds_runs,
    make_index,
    models_table,
    read_index,
    runs_table,
)
from eyechart.studies import ModelSummary, ReadOptions, battery, prompts
from eyechart.studies.battery.study import BatteryStudy
from eyechart.studies.policy.study import Policies
from eyechart.verdicts.labels import CAMERA, LABELS
from eyechart.verdicts.policy_rules import AxisVerdict
from eyechart.verdicts.policy_verdict import PolicyVerdict
from eyechart.verdicts.ruling import Ruling
from report_runs import HOSTILE

READING = ReadOptions(independent=False, reread=False)
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
    assert rows[1][2] == "the same verdict, with the same question"
    assert rows[2][2].endswith("not the same bank")
    assert NOISY not in {row[0] for row in history_table(entries).texts()}


def test_models_stand_side_by_side_by_bank(folder: Path) -> None:
    """A bank a column; who was not asked there has a dash."""
    table = models_table(read_index(folder, READING, silent))
    assert table.names == ["model", "steps-3", "steps-4"]
    assert next(row for row in table.texts() if row[0] == NOISY)[2] == "—"


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


def test_runs_of_one_day_stand_in_the_order_of_their_first_calls(tmp_path: Path) -> None:
    """Whatever their folders are called: a before and after of one day is no after and before."""
    small = banks.build_bank(tmp_path / "bank", drawn=False)
    for name in ("z-before", "a-after"):
        battery.run(battery.plan(small.root, ["scripted:constant"], tmp_path / "runs" / name))
    entries = read_index(tmp_path / "runs", READING, silent)
    assert [one.run for one in entries] == ["z-before", "a-after"]
    assert entries[0].begun < entries[1].begun
    rows = history_table(entries).texts()
    assert [(row[3], row[2]) for row in rows] == [
        ("z-before", "the first"),
        ("a-after", "the same verdict, with the same question"),
    ]
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d", row[4]) for row in rows)
    assert runs_table(entries).texts()[0][2] == "a-after"


def entry(model: str, label: str, tone: str, counted: tuple[str, str], run: str = "run") -> Entry:
    """Return what a run says of a model."""
    return Entry(
        run, "batteries", f"2026-11-26T10:00:0{len(run)}", model, "bank", (), ModelSummary(label, tone), counted
    )


def test_the_headline_counts_verdicts_of_one_kind_together_and_says_who_has_none() -> None:
    """An estimator that is not admitted is none that does not look; who has no verdict is not left out."""
    look, admitted = ("look", "model"), ("admitted", "estimator")
    entries = [
        *(entry(f"sees-{number}", "depth", "sees", look) for number in range(3)),
        entry("blind", "image_invariant", "blind", look),
        entry("turned", "depth", "sees", look),
        entry("turned", "undecided", "open", look, run="later"),
        entry("good", "admitted", "sees", admitted),
        *(entry(f"bad-{number}", "not_admitted", "blind", admitted) for number in range(2)),
        entry("drove", "no verdict", "", ("drive by sight", "driver")),
    ]
    said = overview._counted(entries)
    assert said == (
        "By the newest verdicts, look: 3 yes, 1 no, 1 cannot be said, of 5 models; admitted: 1 yes, 2 no, of 3 "
        "estimators. 1 of 9 models has no verdict."
    )
    assert overview._counted(entries[-1:]) == ("No run here has a verdict on a model. 1 of 1 model has no verdict.")


def test_a_headline_denies_nothing_that_its_rows_say() -> None:
    """Of one that looks in part the sentence says so, and counts nobody who does."""
    said = overview._counted([entry("one", "depth_associated", "partly", ("look", "model"))])
    assert said == "By the newest verdicts, look: 1 in part, of 1 model."


def counted_as(found: Mapping[str, ModelSummary]) -> dict[str, str]:
    """Return by model what an index counts it under where it stands alone."""
    alone = {spec: Entry("run", "runs", "2026-11-26", spec, "bank", (), summary) for spec, summary in found.items()}
    said = {spec: re.search(r": 1 (.+), of 1", overview._counted([one])) for spec, one in alone.items()}
    return {spec: one[1] for spec, one in said.items() if one}


WORDS = {"Yes": "yes", "In part": "in part", "No": "no", "Inconclusive": "cannot be said"}


def test_a_policy_is_counted_under_what_its_label_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every label of the cameras, whatever its colour: that a picture must be there is no looking."""
    none = AxisVerdict("undecided", "Open.")
    verdicts = {
        label: PolicyVerdict(label, AxisVerdict(label, "Why."), {}, none, none, {}, {}, "of these frames")
        for label in CAMERA
    }
    asked = SimpleNamespace(motions=SimpleNamespace(planned=1, finished=1), statistics={})
    monkeypatch.setattr("eyechart.studies.policy.study.judge", lambda _: verdicts)
    found = Policies().findings(SimpleNamespace(models=dict.fromkeys(CAMERA, asked)))  # type: ignore[arg-type]
    assert counted_as(found) == {label: WORDS[one.answer] for label, one in CAMERA.items()}


def test_a_model_is_counted_under_what_its_label_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every label of a battery; where a guard failed nothing is said."""
    verdicts = {
        label: SimpleNamespace(calibrated=Ruling(label, "s", "why"), state="", marks=(), answer=one.answer)
        for label, one in LABELS.items()
    }
    verdicts["guarded"] = SimpleNamespace(
        **{**vars(verdicts["depth"]), "marks": ("a guard",), "answer": "Inconclusive"}
    )
    monkeypatch.setattr("eyechart.studies.battery.study.judge", lambda _: verdicts)
    found = counted_as(BatteryStudy().findings(SimpleNamespace()))  # type: ignore[arg-type]
    assert found.pop("guarded") == "cannot be said"
    assert found == {label: WORDS[one.answer] for label, one in LABELS.items()}


@pytest.mark.parametrize("name", ["bank", "frames", "conditions", "prompt", "mode", "reader", "version"])
def test_a_verdict_changed_only_where_the_same_was_asked(name: str) -> None:
    """The answer to another question is none that a model gave up; another version of it may answer otherwise."""
    before = replace(entry("one", "content", "partly", ("look", "model")), settings=((name, 1),))
    now = replace(entry("one", "depth_associated", "partly", ("look", "model"), "later"), settings=((name, 2),))
    (said,) = overview._opening([before, now], {"run": "run-1", "later": "run-2"}).said
    words = history_table([before, now]).texts()[1][2]
    if name == "version":
        assert (said.beware, words) == ("was content", "another verdict: it was content; not the same version")
    else:
        assert (said.beware, words) == (
            "",
            f"another question, whose answer was 'content'; not the same {name}",
        )
    same = replace(now, settings=before.settings)
    assert history_table([before, same]).texts()[1][2] == "another verdict: it was content, with the same question"


def test_verdicts_of_two_kinds_are_not_held_against_each_other() -> None:
    """A battery and drives ask a model two things; without an estimate a verdict still stands in its column."""
    drove = replace(entry("one", "no difference found", "open", ("drive by sight", "driver"), "drives"), study="drives")
    entries = [entry("one", "depth", "sees", ("look", "model")), drove]
    assert not history_table(entries).rows
    assert models_table(entries).texts() == [["one", "depth", "no difference found"]]
    assert models_table(entries).names == ["model", "bank, batteries", "bank, drives"]


def test_drives_the_hierarchy_and_prompts_have_verdicts_in_an_index(tmp_path: Path) -> None:
    """As their own pages say them."""
    made = Path(__file__).parent / "old" / "0.1.0" / "made"
    for name in ("drives", "hierarchy", "prompts"):
        shutil.copytree(made / name, tmp_path / name)
    entries = read_index(tmp_path, READING, silent)
    found = {one.study: one for one in entries if one.is_judged}
    assert found.keys() == {"drives", "hierarchy", "prompts"}
    assert found["prompts"].found.label.startswith("looks under") or "under none" in found["prompts"].found.label
    assert found["hierarchy"].found.estimate is not None
    assert found["drives"].found.decided_by.endswith(("less blank", "less shuffled"))


def test_an_index_leads_to_each_run_and_to_its_page_where_one_lies_beside(folder: Path, tmp_path: Path) -> None:
    """By the name in the page's title; a page of several runs, and one of another run, is none of it."""
    beside = tmp_path / "pages"
    beside.mkdir()
    assert report(folder / "a", "--out", beside / "that of a.html").exit_code == 0
    assert report(folder / "a", folder / "later" / "b", "--out", beside / "both.html").exit_code == 0
    assert report(folder, "--out", beside / "index.html").exit_code == 0
    html = (beside / "index.html").read_text()
    assert set(re.findall(r'href="([^#"]+)"', html)) == {"that%20of%20a.html"}
    assert set(re.findall(r'<td[^>]*><a href="([^"]+)">a</a>', html)) == {"that%20of%20a.html"}
    places = set(re.findall(r'id="(run-\d+)"', html))
    assert set(re.findall(r'href="#(run-\d+)"', html)) <= places
    assert len(places) == 4


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
    assert str(refused.exception) == "an index of runs does not take --figures: give the runs themselves"
    assert not (tmp_path / "other.html").exists()


def test_a_model_whose_runs_have_no_verdict_has_a_row_and_no_history(tmp_path: Path) -> None:
    """As drives with real pictures alone have none, beside a battery of others."""
    made = Path(__file__).parent / "old" / "0.1.0" / "made"
    for name in ("drives", "battery"):
        shutil.copytree(made / name, tmp_path / name)
    records = tmp_path / "drives" / "episodes.jsonl"
    lines = records.read_text().splitlines(keepends=True)
    records.write_text("".join(line for line in lines if '"condition":"real"' in line))
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
    assert (over.label, over.tone, over.decided_by) == ("not_admitted", "blind", "close_accuracy")
    assert over.estimate is not None
    assert over.estimate.n > 0
    drove = {one.label for (study, _), one in found.items() if study == "drives"}
    assert drove == {"admission_cannot_be_said"}
