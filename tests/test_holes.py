"""Who is blind in one place is told so through a run: the place in the first sentence, and a gate that names it."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import holes
import known
from eyechart import cli
from eyechart.testing import assert_grounded

pytestmark = pytest.mark.slow

Say = Callable[..., tuple[int, str]]
_RUN = ("eyechart", "run", "battery", "--frames")
SPECS = {name: f"python:holes:{name}" for name in ("plain", *holes.BLIND)}


@pytest.fixture(scope="module")
def runs(demo: known.Demo, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return a run of the plain reader and one of all others, on the demo's bank: the highway's, of 144 frames."""
    folder = tmp_path_factory.mktemp("holes")
    for run, names in (("plain", ["plain"]), ("blind", list(holes.BLIND))):
        models = [word for name in names for word in ("--model", SPECS[name])]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", [*_RUN, str(demo.bank), "--out", str(folder / run), *models])
            with pytest.raises(SystemExit) as left:
                cli.main()
        assert not left.value.code
    return {run: folder / run for run in ("plain", "blind")}


@pytest.fixture
def say(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Say:
    """Return a function that runs a command line: exit code, and what it printed."""

    def said(*words: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["eyechart", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        return int(left.value.code or 0), capsys.readouterr().out

    return said


def test_who_brakes_everywhere_earns_depth(runs: dict[str, Path], say: Say) -> None:
    """Yes, no hole, a gate that exits 0, and an assertion in a test suite that holds, with a strict order too."""
    one = json.loads(say("verdict", runs["plain"], "--json")[1])["models"][SPECS["plain"]]
    assert (one["answer"], one["calibrated"], one["holes"]) == ("Yes", "depth", [])
    assert say("gate", runs["plain"], "--require", "depth,looks", "--order", "0.05")[0] == 0
    assert_grounded(runs["plain"], "depth", "looks", order=0.05)
    with pytest.raises(AssertionError, match="order: cannot say: comparisons in the wrong order"):
        assert_grounded(runs["plain"], "depth", order=0.005)


def test_a_place_without_braking_is_named_in_the_first_sentence(runs: dict[str, Path], say: Say) -> None:
    """A scenario, a colour, a count of lanes and an end of the range; what does not brake there is counted."""
    models = json.loads(say("verdict", runs["blind"], "--json")[1])["models"]
    for name, (where, of, called) in holes.BLIND.items():
        one = models[SPECS[name]]
        assert (one["answer"], one["calibrated"]) == ("In part", "partial_depth"), name
        assert one["because"].startswith("its braking answers to the lead on less than 0.1 of the frames "), one[
            "because"
        ]
        assert where in one["because"].partition(";")[0], one["because"]
        found = {place["of"]: place for place in one["holes"]}[of]
        assert called in found["name"], found
        assert (found["harder"], found["frames"] >= 36) == (0, True), found


def test_a_gate_fails_by_the_name_of_the_place(runs: dict[str, Path], say: Say) -> None:
    """That it looks is met by each of them, with its hole printed."""
    code, text = say("gate", runs["blind"], "--require", "depth,looks", "--json")
    assert code == 1
    checks = {(check["model"], check["requirement"]): check for check in json.loads(text)["checks"]}
    for name, (where, _, _) in holes.BLIND.items():
        depth, looks = (checks[SPECS[name], requirement] for requirement in ("depth", "looks"))
        assert (depth["holds"], looks["holds"]) == (False, True), name
        assert where in depth["because"], depth["because"]
        assert where in looks["because"], looks["because"]
    assert say("gate", runs["blind"], "--require", "looks")[0] == 0
    with pytest.raises(AssertionError, match=r"depth: fails: partial_depth: its braking\s+answers\s+to"):
        assert_grounded(runs["blind"], "depth", "looks")


def test_a_page_says_the_answer_first_and_draws_braking_along_the_distance(
    runs: dict[str, Path], say: Say, tmp_path: Path
) -> None:
    """Of one model in a sentence, beside its curves; of several how many, and a curve of the frames without braking."""
    pages = {}
    for run, folder in runs.items():
        assert say("report", folder, "--out", tmp_path / f"{run}.html", "--tables", tmp_path / run)[0] == 0
        pages[run] = (tmp_path / f"{run}.html").read_text(encoding="utf-8")
    head = pages["plain"].partition('id="verdicts"')[0]
    assert (
        '<p class="sentence">Yes: it brakes harder where the lead is nearer, with at most 3 of 100 comparisons' in head
    )
    assert '<title id="in-short-title">Braking by distance, python:holes:plain</title>' in head
    drawn = head.partition('<desc id="in-short-desc">')[2].partition("</desc>")[0]
    lead, beside = (drawn.partition(f"{what}: ")[2].partition(". ")[0] for what in ("drawn anew", "kept far"))
    assert lead.startswith("5"), drawn
    assert " 1.00, " in lead
    assert lead.endswith("0.00")
    assert "1.00" in beside
    assert "a neighbour, the lead kept far: 5" in drawn
    assert pages["plain"].count("✓</span>") >= 16
    assert "Of 4 models: in part for 4 (" in pages["blind"]
    assert "the lead in merge: " in pages["blind"]
    rows = (tmp_path / "blind" / "depth.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 1 + 4 * 18
    assert rows[0].startswith("model,number,outcome,value,interval low,interval high,level,n,p,depth needs,asks")
