"""Policies from Python: callables of a notebook are asked, and what a report shows is what the command says."""

import asyncio
import json
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import banks
from arms import deaf, middle, queue, reach
from eyechart.api import PolicyReport, examine_policy, read_policies, run_battery, run_policies
from eyechart.cli.app import app
from eyechart.errors import EyechartError, LedgerError, SpecError
from eyechart.frames import FrameBank
from eyechart.manifest import LEDGER
from eyechart.testing import assert_grounded
from known import table
from test_api import Page

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of twelve episodes of two frames."""
    return table(tmp_path_factory.mktemp("policies") / "bank")


@pytest.fixture(scope="module")
def report(bank: FrameBank) -> PolicyReport:
    """Return the report on two callables with names, and one by its SPEC."""
    found = run_policies(bank, {"mine": reach, "blind": middle}, bank.root.parent / "run")
    assert list(found) == ["python:mine", "python:blind"]
    return found


def told(*words: object) -> str:
    """Return what a command prints."""
    result = CliRunner().invoke(app, list(map(str, words)))
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_report_says_what_the_command_says(report: PolicyReport) -> None:
    """By labels, by words, and by every number; it can be read again, and the page is the command's."""
    said = json.loads(told("verdict", report.path, "--json"))["policies"]
    assert {spec: json.loads(json.dumps(verdict.as_dict())) for spec, verdict in report.verdicts.items()} == said
    assert (said["python:mine"]["camera"], said["python:blind"]["camera"]) == ("object_grounded", "ignores_camera")
    words = str(report)
    for one in said.values():
        for axis in one["axes"].values():
            assert f"{axis['label']}. {axis['because']}" in words
    assert read_policies(str(report.path)).verdicts == report.verdicts
    rows = {(row["policy"], row["statistic"]): row for row in report.rows()}
    share = report["python:mine"].channels["cameras"]
    row = rows["python:mine", "T.swapped@cameras"]
    assert (row["value"], (row["low"], row["high"]), row["n"]) == (share.value, share.ci, share.n)
    page = report.to_html(report.path.with_name("page.html"))
    told("report", report.path, "--out", report.path.with_name("told.html"))
    assert page.read_text() == report.path.with_name("told.html").read_text()


def test_a_notebook_shows_cards_and_takes_nothing_for_markup(report: PolicyReport) -> None:
    """A row an axis, each with its label; a name that is markup stays text."""
    page = Page(report._repr_html_())
    assert page.tags.count("table") == 2
    assert page.tags.count("tr") == sum(len(verdict.axes) for verdict in report.verdicts.values())
    for one in report.verdicts.values():
        for name, axis in one.axes.items():
            assert name in page.words
            assert axis.because in page.text
    assert repr(report["python:blind"]) == (
        "<PolicyVerdict on python:blind: ignores_camera, state_shortcut, instruction_ignored>"
    )
    evil = PolicyReport(report.path, report.score, {"<b>": report["python:mine"]})
    assert "b" not in Page(evil._repr_html_()).tags


def test_a_run_goes_on_and_is_held_in_a_test_suite(bank: FrameBank, tmp_path: Path) -> None:
    """What is asked already is not asked again; a requirement is one of the command's."""
    asked = []

    def counts(images: object, state: np.ndarray, instruction: str | None) -> np.ndarray:
        asked.append(instruction)
        return reach(images, state, instruction)  # type: ignore[arg-type]

    counts.version = "1"  # type: ignore[attr-defined]
    some = {"mine": counts}
    first = run_policies(bank, some, tmp_path / "run", max_calls=100)
    assert len(asked) == 100
    assert "unfinished" in str(first)
    with pytest.raises(AssertionError, match=r"cannot say: \d+ calls are unfinished"):
        assert_grounded(tmp_path / "run", "camera:camera_content")
    done = run_policies(bank, some, tmp_path / "run")
    assert len(asked) == done.score.models["python:mine"].motions.planned
    assert_grounded(tmp_path / "run")
    assert_grounded(tmp_path / "run", "camera:object_grounded", "instruction:instruction_followed")
    with pytest.raises(AssertionError, match="python:mine state:ignores_state: fails: state_used"):
        assert_grounded(tmp_path / "run", "state:ignores_state")
    with pytest.raises(SpecError, match="takes one or more of camera:object_grounded"):
        assert_grounded(tmp_path / "run", "depth")
    counts.version = "2"  # type: ignore[attr-defined]
    with pytest.raises(LedgerError, match="version"):
        run_policies(bank, some, tmp_path / "run")


def test_a_callable_is_known_by_what_it_holds(bank: FrameBank, tmp_path: Path) -> None:
    """Two partials of one function are two versions; a function of a file goes on where its command began."""

    def scaled(images: object, state: np.ndarray, instruction: str | None, *, by: float) -> np.ndarray:
        return by * reach(images, state, instruction)  # type: ignore[arg-type]

    given = {f"by {by:g}": partial(scaled, by=by) for by in (0.5, 2.0)}
    found = run_policies(bank, given, tmp_path / "partials", conditions=["real"], limit=3)
    versions = {model.version for model in found.score.models.values()}
    assert len(versions) == 2
    command = ("run", "policy", "--policy", "python:arms:deaf", "--frames", bank.root, "--out", tmp_path / "run")
    told(*command, "--conditions", "real", "--limit", 6)
    ledger = (tmp_path / "run" / LEDGER).read_bytes()
    same = run_policies(bank, deaf, tmp_path / "run", conditions=["real"], limit=6)
    assert list(same) == ["python:arms:deaf"]
    assert (tmp_path / "run" / LEDGER).read_bytes() == ledger


def test_a_callable_beside_its_own_spec_is_refused_in_either_order(bank: FrameBank, tmp_path: Path) -> None:
    """It would be asked once, and one of the two would be left out in silence."""
    for both in ([reach, "python:arms:reach"], ["python:arms:reach", reach]):
        with pytest.raises(SpecError, match="policies hold 'python:arms:reach' as a callable and by its SPEC: keep"):
            run_policies(bank, both, tmp_path / "twice")
    assert not (tmp_path / "twice").exists()


def test_the_doctor_takes_a_callable(bank: FrameBank) -> None:
    """In words, a line a check; one with a queue is found."""
    fine, amiss = examine_policy(bank, reach), examine_policy(bank.root, {"queued": queue})
    assert fine.exit_code == 0
    assert str(fine).splitlines()[-1] == f"asked: {fine.calls} calls"
    assert amiss.exit_code == 1
    assert amiss.spec == "python:queued"
    assert "AMISS       same: " in str(amiss)


def test_it_works_where_a_loop_is_running(bank: FrameBank, tmp_path: Path) -> None:
    """As in a notebook."""

    async def cell() -> PolicyReport:
        examine_policy(bank, reach)
        return run_policies(bank, reach, tmp_path / "run", limit=3, conditions=["real", "swapped@cameras"])

    found = asyncio.run(cell())
    assert found.score.models["python:arms:reach"].motions.missing == {}


def test_an_unknown_option_is_named(bank: FrameBank, tmp_path: Path) -> None:
    """As Python does; and a policy that is not in a report is told which are."""
    with pytest.raises(TypeError, match="'answering'"):
        run_policies(bank, reach, tmp_path / "run", answering=3)  # type: ignore[call-arg]
    found = run_policies(bank, reach, tmp_path / "run", limit=3, conditions=["real"])
    with pytest.raises(EyechartError, match="no policy 'reach'; it holds python:arms:reach"):
        found["reach"]
    assert (
        repr(found) == f"<PolicyReport on {tmp_path / 'run'}: python:arms:reach: {found['python:arms:reach'].headline}>"
    )


def test_who_never_answers_with_a_motion_is_set_aside_with_a_warning(bank: FrameBank, tmp_path: Path) -> None:
    """Which says what came, what the bank has, and what to do."""

    def batched(images: object, state: np.ndarray, instruction: str | None) -> np.ndarray:
        return reach(images, state, instruction)[None]  # type: ignore[arg-type]

    with pytest.warns(UserWarning, match=r"python:batched was set aside.*\(1, 8, 3\).*\[0\]"):
        found = run_policies(bank, {"batched": batched}, tmp_path / "run")
    assert "not_scorable" in found["python:batched"].guards
    assert found.score.models["python:batched"].answered == 10


def test_a_warning_quotes_an_exception_without_what_steers_a_terminal(bank: FrameBank, tmp_path: Path) -> None:
    """The text of an exception is the policy's own; its escapes and lines reach no terminal."""

    def failing(images: object, state: np.ndarray, instruction: str | None) -> np.ndarray:
        del images, state, instruction
        raise ValueError("\x1b[2J\x1b]0;owned\x07no\nblock \x9b31m")

    with pytest.warns(UserWarning, match=r"python:failing was set aside") as warned:
        run_policies(bank, {"failing": failing}, tmp_path / "run")
    said = [str(one.message) for one in warned if "set aside" in str(one.message)]
    assert said
    assert all(one.isprintable() and "no block" in one for one in said)


def test_a_run_whose_folder_is_moved_under_it_says_so_and_is_whole_at_its_new_place(
    bank: FrameBank, tmp_path: Path
) -> None:
    """Of policies as of a battery: no finished call is asked again there, and a removed one is not said to be done."""
    calls: list[str] = []

    def moving(name: str) -> None:
        calls.append(name)
        if len(calls) == 3:
            (tmp_path / "run").rename(tmp_path / "elsewhere")

    def act(images: dict[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
        moving("policy")
        return reach(images, state, instruction)

    def say(prompt: str, image: bytes | None) -> str:
        del prompt, image
        moving("controller")
        return "STOP"

    roads, shown = banks.build_bank(tmp_path / "roads"), {"conditions": ["real", "blank"]}
    for ask, frames, who in ((run_policies, bank, act), (partial(run_battery, controls="none"), roads, say)):
        with pytest.raises(LedgerError, match=r"was moved or removed while it was written\..* as out to resume it"):
            ask(frames, {"mine": who}, tmp_path / "run", **shown)  # type: ignore[operator]
        known = len(calls)
        ask(frames, {"mine": who}, tmp_path / "elsewhere", **shown)  # type: ignore[operator]
        assert len(calls) == known > 3
        shutil.rmtree(tmp_path / "elsewhere")
        calls.clear()
