"""``run admission`` and ``run structured`` from the command line, to the table of the paper."""

import json
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

import banks
import roads
from eyechart import cli
from eyechart.frames import FrameBank

CONTROL = "scripted:scene_positive_control"
DECLINES = "scripted:scene_positive_control"
"""On pictures of boxes, which are no road, it declines to answer."""


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of 36 frames with no calibrated view."""
    return banks.build_bank(tmp_path_factory.mktemp("scenes") / "bank", episodes=4)


def say(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: object) -> tuple[object, str, str]:
    """Return the exit code, standard output and standard error of a command."""
    monkeypatch.setattr(sys, "argv", ["eyechart", *map(str, words)])
    with pytest.raises(SystemExit) as left:
        cli.main()
    return left.value.code, *capsys.readouterr()


def test_admission_from_the_plan_to_the_clauses(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, bank: FrameBank, tmp_path: Path
) -> None:
    """The plan says what is asked through which view; the score holds every clause, also as JSON."""
    words = ("run", "admission", "--model", DECLINES, "--frames", bank.root, "--out", tmp_path / "run")
    code, _, planned = say(capsys, monkeypatch, *words, "--dry-run")
    assert code == 0
    assert "view: none" in planned
    assert "1 model × 16 frames × 2 conditions: 32 calls" in planned
    assert not (tmp_path / "run").exists()
    code, _, ran = say(capsys, monkeypatch, *words)
    assert (code, "eyechart score" in ran) == (0, True)
    code, printed, _ = say(capsys, monkeypatch, "score", tmp_path / "run")
    assert code == 0
    for part in ("renderer positive (paper)", "0.090", "not admitted", "refused 32", "guard 'degeneracy' fails"):
        assert part in printed
    code, printed, _ = say(capsys, monkeypatch, "score", tmp_path / "run", "--json")
    found = json.loads(printed)["models"][DECLINES]
    assert [one["outcome"] for one in found["clauses"]] == ["fail"] * 5 + ["cannot say"] * 2
    assert found["unread"] == {"refused": 32}
    code, _, why = say(capsys, monkeypatch, "verdict", tmp_path / "run")
    assert (code, why.count("\n")) == (2, 1)


def test_limits_and_wrong_words_end_in_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, bank: FrameBank, tmp_path: Path
) -> None:
    """A budget stops a run with exit 3; a view that there is not is named."""
    words = ("run", "structured", "--model", DECLINES, "--frames", bank.root, "--out", tmp_path / "run", "--limit", 6)
    code, _, why = say(capsys, monkeypatch, *words, "--max-calls", 5)
    assert code == 3
    assert "7 calls are left" in why
    code, _, why = say(capsys, monkeypatch, *words, "--view", "calibrated")
    assert (code, why.count("\n")) == (2, 1)
    assert "no calibrated view of pictures from 'boxes'" in why
    for extra, message in (
        (("--view",), "--view and --mirrored are for one frame"),
        (("light-9-9",), "has no frame 'light-9-9'"),
        (("light-0-0", "--view"), "no calibrated view"),
    ):
        code, _, why = say(capsys, monkeypatch, "frames", "show", bank.root, *extra, "--out", tmp_path / "x.png")
        assert (code, message in why) == (2, True)
    code, _, _ = say(
        capsys, monkeypatch, "frames", "show", bank.root, "light-0-0", "--mirrored", "--out", tmp_path / "x.png"
    )
    assert (code, (tmp_path / "x.png").is_file()) == (0, True)


def test_what_a_researcher_does_with_a_run_of_estimates(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A gate with JUnit and a report with tables; what cannot be required is said in a line."""
    road, run = roads.build_bank(tmp_path / "bank", roads.GAPS_M[2:6]), tmp_path / "run"
    models = ("--model", CONTROL, "--model", "scripted:scene_one_sided")
    words = ("run", "structured", *models, "--frames", road.root, "--out", run)
    assert say(capsys, monkeypatch, *words, "--max-calls", 3)[0] == 3
    code, printed, _ = say(capsys, monkeypatch, "gate", run)
    assert (code, "FAILS" in printed, "the run is unfinished: 3 of 8 calls" in printed) == (2, False, True)
    assert say(capsys, monkeypatch, *words)[0] == 0
    code, printed, _ = say(capsys, monkeypatch, "gate", run, "--junit", tmp_path / "gate.xml")
    assert code == 1
    assert f"holds       {CONTROL}  close_accuracy: 1.000, at least 0.75 (n = 4)" in printed
    assert "FAILS       scripted:scene_one_sided  scene_equivariance: 0." in printed
    suite = ET.fromstring((tmp_path / "gate.xml").read_text())  # noqa: S314 - our own file
    assert {name: suite.get(name) for name in ("tests", "failures", "errors")} == {
        "tests": "14",
        "failures": str(printed.count("FAILS")),
        "errors": "0",
    }
    asked = ("--require", "parse,gap", "--max-unparsed", 0)
    code, _, why = say(capsys, monkeypatch, "gate", run, *asked)
    assert (code, "--require takes one or more of admission, parse, close_accuracy" in why) == (2, True)
    code, printed, _ = say(capsys, monkeypatch, "gate", run, "--require", "parse,directional", "--max-unparsed", 0)
    assert (code, printed.count("holds ")) == (0, 6)
    code, _, told = say(
        capsys, monkeypatch, "report", run, "--out", tmp_path / "r.html", "--tables", tmp_path / "tables"
    )
    assert (code, "12 tables in" in told) == (0, True)
    assert "Worst frames" in (tmp_path / "r.html").read_text()


def test_an_online_run_is_refused_where_it_proves_nothing(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """By name, in one line, with what to do instead."""
    (tmp_path / "vetting.json").write_text("[]")
    (tmp_path / "run.json").write_text('{"simulator": "rover", "policies": {}}')
    code, _, why = say(capsys, monkeypatch, "gate", tmp_path)
    assert (code, why.count("\n"), "no world in it passed" in why) == (2, 1, True)
