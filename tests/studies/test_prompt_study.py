"""The prompt study: cells are batteries, diversity is told from scene dependence, and every prompt tried is counted."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import banks
import stand_ins
from eyechart import models
from eyechart.calls import Query, Reply, read_in
from eyechart.cli.app import app
from eyechart.costs import accounts_of
from eyechart.errors import LedgerError, SpecError
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger, columns_of
from eyechart.manifest import LEDGER, read_run
from eyechart.modes import RequestMode
from eyechart.prompts import PROMPTS
from eyechart.spaces.discrete import DRIVING
from eyechart.stats.statistic import Statistic
from eyechart.studies import ReadOptions, open_study, prompts
from eyechart.transfer import transfer

SPEC = "suggestible:one"


def respond(query: Query) -> Reply:
    """Answer STOP, but by chance where told to vary, and look at the picture where told to look first."""
    if "Earlier controllers failed" in query.user:
        said = np.random.default_rng(query.seed).choice(["STOP", "SLOW", "LEFT", "RIGHT", "STRAIGHT", "no idea"])
        return Reply(str(said), "stop")
    if "First describe" in query.user:
        return Reply("ACTION: " + ("STOP" if len(query.image or b"") % 2 else "LEFT"), "stop")
    return Reply("STOP", "stop")


def open_model(name: str, mode: RequestMode) -> stand_ins.StandIn:
    """Open the model that does as the prompt suggests."""
    del name, mode
    return stand_ins.StandIn(respond)


@pytest.fixture
def bank(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FrameBank:
    """Return a bank of 36 frames, with the suggestible model at hand."""
    monkeypatch.setitem(models.ADAPTERS, "suggestible", __name__)
    return banks.build_bank(tmp_path / "bank", episodes=4, steps=3)


def run(bank: FrameBank, out: Path, **how: object) -> tuple[prompts.CellScore, ...]:
    """Run a study and score it."""
    prompts.run(prompts.plan(bank.root, [SPEC], out, **how))  # type: ignore[arg-type]
    return prompts.score(out, resamples=199)


def test_every_prompt_is_a_cell_and_only_its_words_differ(bank: FrameBank, tmp_path: Path) -> None:
    """The six built-in prompts in their order, on the same frames, real and blank."""
    cells = run(bank, tmp_path / "study")
    assert [cell.name for cell in cells] == list(PROMPTS)
    assert {(cell.planned, cell.answered) for cell in cells} == {(2 * len(bank), 2 * len(bank))}
    found = {cell.name: cell.statistics for cell in cells}
    assert {name: one["modal_share"].value for name, one in found.items() if name in {"baseline", "minimal"}} == {
        "baseline": 1.0,
        "minimal": 1.0,
    }
    assert found["baseline"]["distinct_outputs"].value == 1
    assert found["baseline"]["idi"].value == 0


def test_scores_from_elsewhere_are_set_beside_every_cell(bank: FrameBank, tmp_path: Path) -> None:
    """A model under two prompts is two cells of ``transfer``, each with the statistics of its battery."""
    run(bank, tmp_path / "study", prompts=["baseline", "anti_degeneracy"])
    scored = open_study("prompts").score(tmp_path / "study", ReadOptions(resamples=199))
    found = transfer([scored], {SPEC: 0.5})
    assert [(cell.model, cell.bank) for cell in found.cells] == [
        (SPEC, f"{bank.name} under baseline"),
        (SPEC, f"{bank.name} under anti_degeneracy"),
    ]
    assert [cell.measured for cell in found.cells] == [
        battery.models[SPEC].statistics["mutual_information.decision"].value for battery in scored.batteries.values()
    ]
    assert found.pearson.value is None, "all scores are the same"


def test_diversity_is_not_scene_dependence(bank: FrameBank, tmp_path: Path) -> None:
    """Six outputs by chance, UNPARSED among them, show no dependence; each p is corrected over the prompts tried."""
    cells = {cell.name: cell for cell in run(bank, tmp_path / "study")}
    varied = cells["anti_degeneracy"]
    assert varied.statistics["distinct_outputs"].value == 6
    assert varied.statistics["unparsed_rate"].value > 0
    assert varied.statistics["idi"].value > 0.5
    assert varied.holm["mutual_information"] > 0.05
    for cell in cells.values():
        p = cell.statistics["mutual_information"].p
        assert cell.holm["mutual_information"] >= p


def test_budgets_and_formats_are_crossed_with_the_prompts(bank: FrameBank, tmp_path: Path) -> None:
    """Each setting is a cell with a mode of its own; the frames stay the same."""
    factors = [prompts.Factor(tokens, form) for tokens in (64, 128) for form in ("none", "json_object")]
    cells = run(bank, tmp_path / "study", prompts=["baseline"], factors=factors, limit=6)
    assert {(cell.name, cell.max_tokens, cell.structured) for cell in cells} == {
        ("baseline--64--none", 64, "none"),
        ("baseline--64--json_object", 64, "json_object"),
        ("baseline--128--none", 128, "none"),
        ("baseline--128--json_object", 128, "json_object"),
    }
    assert {cell.planned for cell in cells} == {12}
    assert read_run(tmp_path / "study" / "baseline--64--json_object")[0].mode(SPEC).structured == "json_object"


def test_a_study_is_resumed_cell_by_cell(bank: FrameBank, tmp_path: Path) -> None:
    """What is finished is not asked again, and another prompt may be added later."""
    run(bank, tmp_path / "study", prompts=["baseline"], limit=6)
    again = prompts.plan(bank.root, [SPEC], tmp_path / "study", prompts=["baseline", "minimal"], limit=6)
    assert again.counts() == (24, 12, 0)
    seen: list[tuple[int, int]] = []
    prompts.run(again, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (24, 24)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    assert [cell.name for cell in prompts.score(tmp_path / "study", resamples=99)] == ["baseline", "minimal"]


def test_a_cell_in_which_nobody_was_asked_yet_is_no_part_of_the_score(bank: FrameBank, tmp_path: Path) -> None:
    """A probe that was interrupted begins a cell; what it took still counts among the cells of the study."""
    out = tmp_path / "study"
    asked = [one.name for one in run(bank, out)]
    begun = out / "begun"
    begun.mkdir()
    told = json.loads((next(cell for cell in prompts.cells_in(out)) / "run.json").read_text(encoding="utf-8"))
    (begun / "run.json").write_text(json.dumps({**told, "models": {}}), encoding="utf-8")
    assert [one.name for one in prompts.score(out, resamples=99)] == asked
    assert begun in prompts.cells_in(out)


def test_limits_bound_all_cells_together(bank: FrameBank, tmp_path: Path) -> None:
    """No cell has the whole budget to itself, and a higher limit resumes."""
    study = prompts.plan(bank.root, [SPEC], tmp_path / "study", prompts=["baseline", "minimal", "few_shot"], limit=6)
    stopped = prompts.run(study, calls=18)
    assert stopped.stopped == "in cell minimal, within --max-calls 18 for all cells"
    assert study.counts()[:2] == (36, 18)
    assert prompts.run(study, calls=36).stopped is None
    assert study.counts()[:2] == (36, 36)


def dear(query: Query) -> Reply:
    """Answer STOP, for a cent."""
    del query
    return Reply("STOP", "stop", cost_usd=0.01)


@pytest.mark.parametrize("limits", [{"calls": 18}, {"cost_usd": 0.175}])
def test_limits_count_the_cells_that_are_no_part_of_todays_plan(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limits: dict[str, float]
) -> None:
    """What another prompt took on another day is spent, whoever is asked today; what was never sent is not."""
    monkeypatch.setitem(globals(), "respond", dear)
    out = tmp_path / "study"
    prompts.run(prompts.plan(bank.root, [SPEC], out, prompts=["minimal"], limit=6))
    with Ledger(out / "minimal" / LEDGER, create=True) as ledger:
        first, *_ = ledger.replies(SPEC)
        ledger.close(ledger.begin(first[0], "d", again=True), Reply(error="not_called"))
    today = prompts.plan(bank.root, [SPEC], out, prompts=["baseline"], limit=6)
    stopped = prompts.run(today, **limits).stopped  # type: ignore[arg-type]
    assert stopped is not None
    assert stopped.startswith("in cell baseline, within --max-")
    assert today.counts()[:2] == (12, 6)


def test_what_cannot_be_a_study_is_refused(bank: FrameBank, tmp_path: Path) -> None:
    """Twice the same cell, no prompt, a folder without cells, and cells of two banks."""
    with pytest.raises(SpecError, match="the cell 'baseline' is given twice"):
        prompts.plan(bank.root, [SPEC], tmp_path / "study", prompts=["baseline", "baseline"])
    with pytest.raises(SpecError, match="at least one prompt"):
        prompts.plan(bank.root, [SPEC], tmp_path / "study", prompts=[])
    with pytest.raises(LedgerError, match="holds no prompt study; 'eyechart run prompts' makes one"):
        prompts.score(tmp_path)
    run(bank, tmp_path / "study", prompts=["baseline"], limit=6)
    other = banks.build_bank(tmp_path / "other", scenarios=["light"])
    with pytest.raises(LedgerError, match="cells on several banks"):
        run(other, tmp_path / "study", prompts=["minimal"], limit=6)


def test_a_cell_says_what_it_took_and_whether_it_may_be_believed(bank: FrameBank, tmp_path: Path) -> None:
    """A constant cell is marked, an unfinished one says so, and the calls of each are accounted for."""
    study = prompts.plan(bank.root, [SPEC], tmp_path / "study", prompts=["baseline", "anti_degeneracy"], limit=6)
    prompts.run(study, calls=20)
    constant, varied = prompts.score(tmp_path / "study", resamples=99)
    assert constant.marks == ("guard 'degeneracy' failed: all 12 replies are the same: 'STOP'",)
    assert (constant.state, varied.state) == ("", "unfinished: 8 of 12 calls")
    assert (constant.took.attempts, varied.took.attempts) == (12, 8)
    told = CliRunner().invoke(app, ["score", str(tmp_path / "study")]).stdout
    assert "! suggestible:one in baseline: guard 'degeneracy' failed: all 12 replies are the same: 'STOP'" in told
    assert "unfinished: 8 of 12 calls" in told
    assert "what the calls took" in told
    costs = json.loads(CliRunner().invoke(app, ["costs", str(tmp_path / "study"), "--json"]).stdout)
    assert costs["accounting"]["suggestible:one in anti_degeneracy"]["all"]["attempts"] == 8
    assert {one["name"] for one in costs["guards"]["suggestible:one in baseline"]} >= {"outcomes", "degeneracy"}


def test_a_score_is_plain_json(bank: FrameBank, tmp_path: Path) -> None:
    """Every number with its n; nothing that JSON cannot hold."""
    cells = run(bank, tmp_path / "study", prompts=["baseline"], limit=6)
    again = json.loads(json.dumps([cell.as_dict() for cell in cells], allow_nan=False))
    assert again[0]["statistics"]["modal_share"]["n"] == 6
    assert set(again[0]["holm"]) == {"mutual_information", "obstacle", "cramers_v_real_blank"}


def cells_of(model: str, **p: float | None) -> list[prompts.CellScore]:
    """Return the cells of a model, by prompt the corrected p; None where it says one thing alone."""
    gap, one, several = (Statistic(value, 48) for value in (0.25, 1.0, 3.0))
    return [
        prompts.CellScore(
            name=name,
            model=model,
            prompt=name,
            max_tokens=64,
            structured="none",
            planned=96,
            answered=96,
            statistics={
                **dict.fromkeys(("mutual_information", "obstacle", "cramers_v_real_blank", "modal_share"), gap),
                "distinct_outputs": one if found is None else several,
            },
            holm={"mutual_information": found, "obstacle": None, "cramers_v_real_blank": 0.9},
            took=accounts_of(columns_of((), read_in(DRIVING)), model, None)["all"],
            guards=(),
        )
        for name, found in p.items()
    ]


def test_the_page_names_the_prompts_under_which_each_model_looks() -> None:
    """A line a model, a grid of all models and prompts, and why one is not shown to look under the others."""
    cells = [
        *cells_of("one", baseline=0.001, minimal=0.002),
        *cells_of("two", baseline=0.001, minimal=0.31),
        *cells_of("three", baseline=None, minimal=None),
    ]
    score = prompts.PromptsScore(tuple(cells), {})
    study = prompts.Prompts()
    said = study.answer({"run": score})
    assert said.sentence == "one: all two; two: baseline only; three: under none."
    assert [(one.who, one.label, one.tone) for one in said.said] == [
        ("one", "all two", "sees"),
        ("two", "baseline only", "partly"),
        ("three", "under none", "blind"),
    ]
    assert said.said[0].why_not == ""
    assert said.said[1].why_not == (
        "Under minimal no link to its pictures is shown (smallest p 0.310 after Holm, n 48). "
        "More than 48 frames may show a weaker link."
    )
    assert said.said[2].why_not == "Under baseline and minimal it gives one answer to every picture."
    assert said.grid is not None
    assert said.grid.columns == ["one", "two", "three"]
    assert [(name, [one and one[0] for one in row]) for name, row in said.grid.rows] == [
        ("baseline", ["sees", "sees", "blind"]),
        ("minimal", ["sees", "open", "blind"]),
    ]
    found = study.findings(score)
    assert {spec: finding.label for spec, finding in found.items()} == {
        "one": "looks under all two",
        "two": "looks under baseline only",
        "three": "looks under none",
    }


def test_a_report_holds_what_score_prints(bank: FrameBank, tmp_path: Path) -> None:
    """As a page and as files, the table of each model in a file of its own."""
    run(bank, tmp_path / "run")
    result = CliRunner().invoke(
        app, ["report", str(tmp_path / "run"), "--out", str(tmp_path / "p.html"), "--tables", str(tmp_path / "t")]
    )
    assert result.exit_code == 0, result.output
    html = (tmp_path / "p.html").read_text()
    assert re.findall(r'<table class="(\w+)', html) == ["tones", "prompts", "costs", "deployment"]
    assert [name for name in PROMPTS if f"<bdi>{name}" not in html] == []
    assert "default-src &#39;none&#39;" in html
    assert {path.name for path in (tmp_path / "t").iterdir()} == {
        f"{name}.{kind}" for name in ("prompts", "costs", "deployment") for kind in ("csv", "md", "tex")
    }
