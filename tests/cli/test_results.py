"""What ``score`` and ``verdict`` print of a run: a label that is not final says so, and nothing is said twice."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

import banks
import stand_ins
from eyechart import models
from eyechart.cli.app import app
from eyechart.conditions import BATTERY
from eyechart.frames import open_bank
from eyechart.limits import Limits
from eyechart.run import spread
from eyechart.studies import battery
from eyechart.studies.battery.page import make_page
from eyechart.studies.battery.reach import unreachable_labels
from eyechart.studies.battery.tables import deciding_table, group_tables
from eyechart.verdicts import judge
from known import Demo
from report_runs import read_evidence


@pytest.fixture
def half(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a run of two models of which 60 of 288 calls are made."""
    monkeypatch.setitem(models.ADAPTERS, "standin", "stand_ins")
    bank = banks.build_bank(tmp_path / "bank", drawn=False)
    planned = battery.plan(bank.root, stand_ins.SPECS, tmp_path / "run")
    assert len(planned.plan.keys()) == 288
    battery.run(planned, concurrency=1, limits=Limits(calls=60))
    return tmp_path / "run"


def told(*words: str) -> str:
    """Return what a command prints, its line breaks removed."""
    result = CliRunner().invoke(app, list(words))
    assert result.exit_code == 0, result.output
    return " ".join(result.stdout.split())


@pytest.mark.slow
def test_a_label_of_an_unfinished_run_is_marked_wherever_it_stands(half: Path) -> None:
    """In both commands, in the page, and beside every model; the whole run is marked no more."""
    counts = {spec: model.answered for spec, model in battery.score(half, resamples=99).models.items()}
    marks = [f"unfinished: {count} of 144 calls" for count in counts.values()]
    page = make_page(read_evidence([half])).html.decode()
    verdict, score = told("verdict", str(half)), told("score", str(half))
    for mark, count in zip(marks, counts.values(), strict=True):
        assert f"({mark})" in verdict
        assert verdict.count(mark) >= 2
        assert f"{count} of 144 calls" in score
        assert f"<strong>Not final:</strong> {mark}." in page
    battery.run(battery.plan(half.parent / "bank", stand_ins.SPECS, half))
    assert "unfinished" not in told("verdict", str(half)) + told("score", str(half))


@pytest.mark.slow
def test_what_is_noted_of_every_model_is_printed_once(half: Path) -> None:
    """With the names of those of whom it is said, below the verdicts; in the page likewise."""
    page, verdict = make_page(read_evidence([half])).html.decode(), told("verdict", str(half))
    for said in (page, verdict):
        assert said.count("up to 6 positive claims are tested in order") == 1
    assert "Noted of several models: every model: " in verdict


def test_score_prints_each_interval_with_the_level_that_it_has(half: Path) -> None:
    """98 % beside the intervals of the calibrated tests, 95 % beside the others, as the statistic itself says."""
    battery.run(battery.plan(half.parent / "bank", stand_ins.SPECS, half))
    printed = CliRunner().invoke(app, ["score", str(half), "--all"]).stdout.splitlines()
    assert any("interval" in line and "level" in line for line in printed)
    statistics = next(iter(battery.score(half, resamples=99).models.values())).statistics
    for name in ("agree.noise", "self_disagreement", "bound_blank"):
        line = next(line for line in printed if line.split()[:1] == [name])
        assert statistics[name].ci is not None
        assert f"{100 * statistics[name].level:g} %" in line, line
    assert {statistics[name].level for name in ("agree.noise", "bound_blank")} == {0.95, 0.98}


def test_score_begins_with_the_five_that_decided_and_has_the_rest_by_groups(demo: Demo) -> None:
    """The deciding one first of each model, on 80 columns nothing but those; ``--all`` has every statistic once."""
    scored = battery.score(demo.run)
    verdicts = judge(scored)
    for spec, model in scored.models.items():
        table = deciding_table(spec, model, verdicts[spec])
        names = [str(row[0]) for row in table.rows]
        assert names[0] == verdicts[spec].calibrated.decided_by
        assert len(names) == len(set(names)) == 5
        assert verdicts[spec].lateral.decided_by in names
        assert table.short().width(stacked=True) <= 80
        grouped = [str(row[0]) for table in group_tables([(spec, model, verdicts[spec])]) for row in table.rows]
        assert sorted(grouped) == sorted(model.statistics)
    brief, every = (CliRunner().invoke(app, ["score", str(demo.run), *more]) for more in ([], ["--all"]))
    assert f"eyechart score {demo.run} --all" in brief.stderr
    assert len(brief.stdout.splitlines()) < 15 * len(verdicts)
    assert "kept it from depth_lateral" in brief.stdout
    assert "scripted:depth: distance" in every.stdout
    assert "kept it from" not in every.stdout


@pytest.mark.parametrize(
    ("more", "never"),
    [
        (["--limit", "48"], ["depth", "presence_only", "image_invariant"]),
        (["--limit", "49"], ["depth"]),
        (["--conditions", "real,real_repeat,blank"], ["depth", "content", "image_invariant"]),
        ([], []),
    ],
)
def test_a_run_says_before_a_call_what_so_few_frames_cannot_show(
    more: list[str], never: list[str], demo: Demo, tmp_path: Path
) -> None:
    """And of whoever deserves it the verdict is another one: 48 frames of who never looks are undecided."""
    words = ["run", "battery", "--model", "scripted:constant", "--frames", str(demo.bank), "--out", str(tmp_path / "r")]
    planned = CliRunner().invoke(app, [*words, *more, "--dry-run"])
    assert planned.exit_code == 0
    said = re.findall(r"no simulated controller that was tried gets: (.*); 'eyechart plan", planned.stderr)
    assert len(said) == bool(never)
    tables = ", ".join(said).split(", ")
    assert set(never) <= set(tables)
    assert not {"image_invariant", "content"} - set(never) & set(tables)
    if never:
        CliRunner().invoke(app, [*words, *more])
        (one,) = judge(battery.score(tmp_path / "r")).values()
        assert (one.calibrated.label == "image_invariant") is ("image_invariant" not in never)


def test_what_a_longer_bank_cannot_show_is_said_as_of_a_shorter_one(demo: Demo) -> None:
    """A part of the frames is tried first where they are many, and all of them where that is not enough."""
    bank = open_bank(demo.bank)
    frames = spread(bank.frames, 48)
    many = tuple(
        replace(frame, id=f"{frame.id}+{n}", episode=f"{frame.episode}+{n}") for n in range(7) for frame in frames
    )
    asked = [*BATTERY, "lead_near", "lead_far"]
    assert "image_invariant" in unreachable_labels(bank, frames, asked)
    assert not {"depth", "image_invariant"} & set(unreachable_labels(bank, many, asked))
