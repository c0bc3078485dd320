"""Prompts compared from Python: one call, the study that the command makes, and what differs from the first prompt."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import banks
import eyechart
from eyechart.api import PromptsReport, compare_prompts
from eyechart.cli.app import app
from eyechart.errors import LedgerError, SpecError
from eyechart.frames import FrameBank
from eyechart.studies import prompts as study
from faults import FaultServer
from seeing import Endpoint


def suggestible(prompt: str, image: bytes | None) -> str:
    """Look at the picture where it is told to describe it first, and else always brake."""
    if "First describe" not in prompt or image is None:
        return "STOP"
    return "STOP" if len(image) % 2 else "LEFT"


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of 36 frames."""
    return banks.build_bank(tmp_path_factory.mktemp("prompts") / "bank", episodes=4, steps=3)


@pytest.fixture(scope="module")
def report(bank: FrameBank, tmp_path_factory: pytest.TempPathFactory) -> PromptsReport:
    """Return three prompts compared, of which one makes a callable look, and one changes nothing."""
    out = tmp_path_factory.mktemp("compared") / "study"
    prompts = ["minimal", "chain_of_thought", "baseline"]
    return eyechart.compare_prompts(bank, {"mine": suggestible}, prompts, out)


def test_a_prompt_that_makes_it_look_differs_from_the_first_and_one_that_does_nothing_does_not(
    report: PromptsReport,
) -> None:
    """By the statistics of pairs, corrected; what is first is the first that was given."""
    assert (report.first, [*report.against]) == ("minimal", ["chain_of_thought", "baseline"])
    one, other = (found.models["python:mine"] for found in report.against.values())
    assert {"across_runs", "answer_shift"} & {*one.changed}
    assert other.changed == ()
    assert other.differences["across_runs"].value == 1.0
    assert report["python:mine"].cells[0].name in {"minimal", "baseline"}
    assert [*report.models] == ["python:mine"]


def test_it_says_what_differs_in_words_tables_rows_and_json(report: PromptsReport) -> None:
    """A sentence a prompt; a row a model, prompt and statistic; the cells are those of the command."""
    assert "python:mine, chain_of_thought against minimal: differs in " in str(report)
    assert "python:mine, baseline against minimal: no statistic differs (Holm)." in str(report)
    assert repr(report).startswith(f"<PromptsReport on {report.path}: python:mine: ")
    assert len(report.table().rows) == 3
    assert [difference.caption for difference in report.differences()] == [
        "python:mine: chain_of_thought against minimal",
        "python:mine: baseline against minimal",
    ]
    assert len(report.differences(every=True)[0].rows) > len(report.differences()[1].rows)
    rows = report.rows()
    assert {row["prompt"] for row in rows} == {"minimal", "chain_of_thought", "baseline"}
    assert {"model", "statistic", "value", "p_holm", "note"} <= rows[0].keys()
    plain = json.loads(json.dumps(report.as_dict()))
    assert plain["first"] == "minimal"
    assert not plain["against"]["chain_of_thought"]["replicated"]
    printed = CliRunner().invoke(app, ["score", str(report.path), "--json"])
    assert plain["cells"] == json.loads(printed.stdout)["cells"]


def test_it_makes_the_study_of_the_command_and_goes_on_with_it(bank: FrameBank, tmp_path: Path) -> None:
    """The same cells by key and answer; nothing is asked twice."""
    prompts = ("minimal", "baseline")
    study.run(study.plan(bank.root, ["scripted:depth"], tmp_path / "steps", prompts=prompts, limit=12, seed=3))
    moves: list[tuple[int, int]] = []
    reports = [
        compare_prompts(
            bank.root,
            "scripted:depth",
            prompts,
            tmp_path / "one",
            limit=12,
            seed=3,
            progress=lambda *at: moves.append(at),
        )
        for _ in range(2)
    ]
    assert moves[-1] == (48, 48)
    steps = study.score(tmp_path / "steps")
    for found in reports:
        assert [(cell.name, cell.prompt, cell.statistics) for cell in found.score.cells] == [
            (cell.name, cell.prompt, cell.statistics) for cell in steps
        ]
        assert found.score.cells[0].took.calls == 24


def test_a_server_that_has_moved_is_gone_on_with_where_that_is_said(bank: FrameBank, tmp_path: Path) -> None:
    """And losses of a ledger are accepted: what an error names as an argument is one."""
    asked: dict[str, Any] = {"prompts": ("minimal", "baseline"), "out": tmp_path / "run", "probe": False, "limit": 1}
    with FaultServer([Endpoint()]) as server:
        compare_prompts(bank, "openai:m", base_url=server.base_url, **asked)
    with FaultServer([Endpoint()]) as server:
        with pytest.raises(LedgerError, match="or continue a run with moved=True, which records it"):
            compare_prompts(bank, "openai:m", base_url=server.base_url, **asked)
        found = compare_prompts(bank, "openai:m", base_url=server.base_url, moved=True, accept_loss=True, **asked)
        assert server.requests == 0
    for cell in found.score.batteries.values():
        assert cell.manifest.mode("openai:m").base_url == server.base_url


def test_a_page_of_it_is_written(report: PromptsReport, tmp_path: Path) -> None:
    """As of every report."""
    page = report.to_html(tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Under which prompt does a model look?" in page
    assert "chain_of_thought" in page


def test_what_cannot_be_compared_is_refused(bank: FrameBank, report: PromptsReport, tmp_path: Path) -> None:
    """One prompt, one twice, none that there is; a model that is not in the study."""
    for prompts, why in (
        (["baseline"], "two prompts or more"),
        ("baseline", "two prompts or more"),
        (["baseline", "baseline"], "given twice"),
        (["baseline", "shouting"], "shouting"),
    ):
        with pytest.raises(SpecError, match=why):
            compare_prompts(bank, "scripted:depth", prompts, tmp_path / "none")
    for asking, why in (
        ({"conditions": "real,blank"}, "conditions takes several values, for example"),
        ({"promt": "baseline"}, "unexpected keyword argument 'promt'.* it takes .*limit"),
        ({"limt": 3}, "did you mean 'limit'"),
    ):
        with pytest.raises(SpecError, match=why):
            compare_prompts(bank, "scripted:depth", ["baseline", "minimal"], tmp_path / "none", **asking)
    with pytest.raises(SpecError, match="it holds python:mine"):
        report["scripted:depth"]
    assert not (tmp_path / "none").exists()


def test_it_is_imported_when_somebody_asks_for_it() -> None:
    """The package alone stays quick to import."""
    code = "import sys, eyechart; quick = 'numpy' not in sys.modules; print(quick, eyechart.compare_prompts.__name__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "compare_prompts"]
