"""The gate: what passes, what fails, and what cannot say."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from typer.testing import CliRunner

import stand_ins
from banks import build_bank
from eyechart import models
from eyechart.calls import Query, Reply
from eyechart.cli.app import app
from eyechart.errors import SpecError
from eyechart.gate import REQUIREMENTS, Check, Gate, hold, read_requirements
from eyechart.limits import Limits
from eyechart.stats.paired_tests import SignTest
from eyechart.studies import battery
from eyechart.testing import assert_grounded
from eyechart.verdicts import LABELS, LATERAL, judge
from known import Demo


class Locked(stand_ins.Held):
    """A model whose every call is refused by its endpoint for good."""

    version = "0"

    async def answer(self, query: Query) -> Reply:
        """Fail as an endpoint does that takes no picture."""
        del query
        return Reply(error="bad_request", error_detail="400 <script>\x00")


def run_of(spec: str, folder: Path, **options: object) -> Path:
    """Run a battery of one model on the tiny bank and return its folder."""
    bank = build_bank(folder / "bank")
    planned = battery.plan(bank.root, [spec], folder / "run", **options)
    battery.run(planned, limits=Limits(patience=1000))
    return folder / "run"


@pytest.fixture(scope="module")
def alone(demo: Demo, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return a function that gives a complete run of one controller, made once."""
    folder = tmp_path_factory.mktemp("alone")
    return cache(lambda controller: demo.alone(controller, folder / controller))


SCORED = cache(battery.score)
"""Scores a run once, however many gates are asked of it."""


@pytest.mark.parametrize(
    ("require", "controller", "code"),
    [
        ("depth", "depth", 0),
        ("depth", "depth_lateral", 0),
        ("depth,swaps", "depth_lateral", 0),
        ("depth_lateral", "depth_lateral", 0),
        ("depth", "presence", 1),
        ("depth_lateral", "one_sided", 1),
        ("swaps", "one_sided", 1),
        ("swaps", "depth", 2),
        ("depth", "truncating", 1),
        ("depth", "nuisance", 1),
    ],
)
def test_the_exit_code_is_the_answer(
    alone: Callable[[str], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    require: str,
    controller: str,
    code: int,
) -> None:
    """0 holds, 1 fails, 2 cannot say, on a complete run of one controller."""
    monkeypatch.setattr("eyechart.studies.battery.study.score", SCORED)
    run = alone(controller)
    result = CliRunner().invoke(app, ["gate", str(run), "--require", require, "--junit", str(tmp_path / "gate.xml")])
    assert result.exit_code == code, result.output
    suite = ET.parse(tmp_path / "gate.xml").getroot()[0]  # noqa: S314 - our own file
    assert int(suite.get("failures")) == (code == 1)
    assert int(suite.get("errors")) == (code == 2)
    if code:
        with pytest.raises(AssertionError, match="fails" if code == 1 else "cannot say"):
            assert_grounded(run, *require.split(","))
    else:
        assert_grounded(run, *require.split(","))


def test_an_unfinished_run_cannot_say(demo: Demo, tmp_path: Path) -> None:
    """A grounded controller with half of its calls does not pass."""
    run = tmp_path / "run"
    planned = battery.plan(demo.bank, ["scripted:depth"], run, extent=battery.BatterySelection(48, (1, 2)))
    battery.run(planned)
    battery.merge([run], tmp_path / "merged")
    result = CliRunner().invoke(app, ["gate", str(tmp_path / "merged")])
    assert result.exit_code == 2
    assert "unfinished" in result.output


def test_a_null_that_nothing_bounds_cannot_say(demo: Demo, tmp_path: Path) -> None:
    """Where distance was tested by observation only, content without depth is no failure: nothing bounds the effect."""
    scored = battery.score(demo.alone("nuisance", tmp_path / "run"))
    spec = "scripted:nuisance"
    few = SignTest(None, 0, p=1.0, wins=0, losses=0, ties=12)
    model = scored.models[spec]
    weaker = replace(model, statistics={**model.statistics, "depth_interventional": few})
    held = [hold(replace(scored, models={spec: one}), ["depth"]).checks[0] for one in (model, weaker)]
    assert [one.holds for one in held] == [False, None]
    assert "ignores distance (no bound below 0.1)" in held[1].because


def test_calls_that_failed_are_no_replies_of_the_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run of failed requests is undecided: nothing that the model said was unreadable."""
    monkeypatch.setitem(models.ADAPTERS, "standin", "stand_ins")
    monkeypatch.setattr(stand_ins, "open_model", lambda *_: Locked())
    verdict = judge(battery.score(run_of("standin:locked", tmp_path)))["standin:locked"]
    assert (verdict.calibrated.label, verdict.calibrated.decided_by) == ("undecided", "unparsed_reference")


def test_a_run_whose_calls_failed_cannot_say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A refused request says nothing of the model, and its words cannot break the JUnit file."""
    monkeypatch.setitem(models.ADAPTERS, "standin", "stand_ins")
    monkeypatch.setattr(stand_ins, "open_model", lambda *_: Locked())
    run = run_of("standin:locked", tmp_path)
    result = CliRunner().invoke(app, ["gate", str(run), "--junit", str(tmp_path / "gate.xml")])
    assert result.exit_code == 2
    assert "ended in an error" in result.output
    ET.parse(tmp_path / "gate.xml")  # noqa: S314 - our own file


def test_an_empty_gate_never_passes() -> None:
    """No checks at all are "cannot say", and one failure outweighs what cannot be said."""
    assert Gate(()).exit_code == 2
    assert Gate((Check("m", "depth", None, ""), Check("m", "swaps", False, ""))).exit_code == 1
    assert Gate((Check("m", "depth", True, ""), Check("m", "swaps", None, ""))).exit_code == 2


def test_a_run_without_calls_cannot_say(demo: Demo, tmp_path: Path) -> None:
    """A run that was planned and cut before its first call does not pass."""
    run = tmp_path / "run"
    planned = battery.plan(demo.bank, ["scripted:depth"], run)
    with pytest.raises(KeyboardInterrupt):
        battery.run(planned, progress=_interrupt)
    assert CliRunner().invoke(app, ["gate", str(run)]).exit_code == 2


def _interrupt(done: int, total: int) -> None:
    del done, total
    raise KeyboardInterrupt


def test_too_many_unparsed_calls_fail(demo: Demo, tmp_path: Path) -> None:
    """``--max-unparsed`` is a check of its own: one whose replies are cut fails it."""
    run = demo.alone("truncating", tmp_path / "run")
    result = CliRunner().invoke(app, ["gate", str(run), "--max-unparsed", "0.1", "--json"])
    assert result.exit_code == 1
    assert '"max_unparsed"' in result.output


@pytest.mark.parametrize("text", ["", "deph", "depth,,left"])
def test_an_unknown_requirement_lists_the_known(text: str) -> None:
    """A wrong name is told what there is."""
    with pytest.raises(SpecError, match="depth_lateral, depth, looks, partial_depth"):
        read_requirements(text)
    assert set(REQUIREMENTS) == {*LABELS, *LATERAL, "looks"}
