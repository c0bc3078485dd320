"""What the commands of a guardian say of the runs that its votes come from, and which runs and frames they refuse."""

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import published_votes
import voters
from banks import build_bank
from eyechart import cli
from eyechart.errors import GuardianError
from eyechart.frames import open_bank
from eyechart.models import ADAPTERS
from eyechart.spaces.scene import Scene
from eyechart.studies import guardian as study

Say = Callable[..., tuple[object, str, str]]
MODELS = ("prose", "sees", "torn")


@pytest.fixture
def say(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Say:
    """Return the command line as a function: exit code, standard output, standard error."""
    monkeypatch.setitem(ADAPTERS, "voter", "voters")

    def run(*words: object) -> tuple[object, str, str]:
        monkeypatch.setattr(sys, "argv", ["eyechart", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        out, err = capsys.readouterr()
        return left.value.code, out, " ".join(err.split())

    return run


@pytest.fixture
def bank(tmp_path: Path) -> Path:
    """Return a bank of boxes."""
    return build_bank(tmp_path / "bank", scenarios=("merge",), episodes=3, steps=6, drawn=False).root


@pytest.fixture
def run(bank: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a run of one model that sees, one that says no scene, and one that tells 5 m and says that it is clear."""
    monkeypatch.setitem(ADAPTERS, "voter", "voters")
    voters.ask_all(bank, MODELS, tmp_path / "run")
    return tmp_path / "run"


@pytest.fixture
def ids(bank: Path, tmp_path: Path) -> Path:
    """Return a file of the frames of the first episode."""
    path = tmp_path / "ids.txt"
    path.write_text("\n".join(frame.id for frame in open_bank(bank) if frame.episode.endswith("-0")))
    return path


def test_what_speaks_against_each_member_is_said_where_it_is_chosen_and_where_it_is_scored(
    say: Say, run: Path, ids: Path, tmp_path: Path
) -> None:
    """Missing votes with why they are, clauses and guards by name; nobody is refused for them."""
    guardian, page = tmp_path / "guardian.json", tmp_path / "guardian.html"
    fit = ("guardian", "fit", run, "--calibration", ids, "--out", guardian, "--size", 3)
    code, _, chosen = say(*fit)
    assert code == 0
    assert (
        "warning: voter:prose: 12 of 12 votes are missing (12 no_object); clauses of admission not met: parse, close"
        in chosen
    )
    assert "warning: voter:torn: 12 of 12 votes are missing (12 contradicts_itself); clauses" in chosen
    assert "guards failed: degeneracy" in chosen
    members = {one["model"]: one for one in json.loads(say(*fit, "--json")[1])["members"]}
    assert {name: (member["missing"], member["contradicting"]) for name, member in members.items()} == {
        "voter:prose": (12, 0),
        "voter:sees": (0, 0),
        "voter:torn": (12, 12),
    }
    assert "parse" in members["voter:prose"]["clauses"]
    code, _, told = say("guardian", "score", guardian, run, "--unseen", "--html", page)
    assert code == 0
    assert "warning: voter:prose: 24 of 24 votes are missing (24 no_object)" in told
    assert "voter:torn: 24 of 24 votes are missing (24 contradicts_itself)" in page.read_text(encoding="utf-8")
    scored = json.loads(say("guardian", "score", guardian, run, "--unseen", "--json")[1])
    assert [one["missing"] for one in scored["members"]] == [24, 0, 24]
    assert sum("votes are missing" in line for line in scored["warnings"]) == 2
    assert (
        sum(": none of 24 votes is missing; clauses of admission not met" in line for line in scored["warnings"]) == 1
    )


def test_why_replies_were_no_votes_is_known_in_runs_that_are_joined(
    run: Path, bank: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With another run of the same frames, and with a table that knows of none."""
    monkeypatch.setitem(ADAPTERS, "voter", "voters")
    other = voters.ask_all(bank, ("never",), tmp_path / "other")
    for one in (other, replace(other, why=None)):
        joined = study.join([one, study.votes_of_run(run)])
        assert joined.models[0] == "voter:never"
        assert [joined.reasons(model) for model in joined.models] == [
            {},
            {"no_object": 36},
            {},
            {"contradicts_itself": 36},
        ]
    assert study.join([replace(other, why=None)]).why is None


def test_frames_that_are_scored_give_no_bound_by_any_name(say: Say, tmp_path: Path) -> None:
    """Renamed episodes, another spelling, and the same picture: as for frames that chose the guardian."""
    table = published_votes.published()
    frozen = study.fit(table.of_episodes(("e00", "e01", "e02")))
    scored, fresh = table.of_episodes(("e03", "e04")), table.of_episodes(("e05", "e06"))
    pictured = replace(scored, pictures=tuple(f"p{number}" for number in range(len(scored.frames))))
    renamed = tuple(f"new-{episode}" for episode in scored.episodes)
    for bad, why in (
        (replace(scored, episodes=renamed), f"frame '{scored.frames[0]}' in votes.csv is '{scored.frames[0]}', which"),
        (replace(fresh, frames=(f"./{scored.frames[3].upper()}.png", *fresh.frames[1:])), "has the name of"),
        (replace(fresh, pictures=("p7", *fresh.frames[1:])), f"shows the very picture of '{scored.frames[7]}'"),
    ):
        with pytest.raises(GuardianError, match=f"{why}.* is scored, so no bound can come from it"):
            study.bound(frozen, bad, scored=pictured)
    assert study.bound(frozen, fresh, scored=pictured).episodes == 2
    files = []
    for name, part in (("score", scored), ("bound", replace(scored, episodes=renamed))):
        (tmp_path / name).mkdir()
        files.append(published_votes.write(replace(part, split=(name,) * len(part.frames)), tmp_path / name))
    study.write_frozen(tmp_path / "guardian.json", frozen)
    (votes, about), (bound, _) = files
    words = ("guardian", "score", tmp_path / "guardian.json", votes, "--about", about, "--bound", bound)
    code, _, told = say(*words)
    assert (code, "which is scored, so no bound can come from it" in told) == (2, True), told


def test_a_run_of_an_older_reader_is_read_anew_where_that_is_said(
    say: Say, run: Path, bank: Path, ids: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each command refuses it, and names the option that reads it."""
    guardian = tmp_path / "guardian.json"
    manifest = json.loads((run / "run.json").read_text(encoding="utf-8"))
    (run / "run.json").write_text(json.dumps({**manifest, "reader": 1}), encoding="utf-8")
    scene = Scene(30.0, left_clear=True, right_clear=True)
    monkeypatch.setattr(study, "reader_of", lambda _: lambda _: (scene, scene))
    for words in (
        ("fit", run, "--calibration", ids, "--out", guardian),
        ("score", guardian, run, "--unseen"),
        ("nested", run),
        ("modular", guardian, run, "--unseen", "--frames", bank),
    ):
        code, _, told = say("guardian", *words)
        assert (code, "read its replies anew with --reread" in told) == (2, True), told
        assert say("guardian", *words, "--reread")[0] == 0


def test_frames_that_chose_it_folders_without_votes_and_other_banks_are_refused_in_words(
    say: Say, run: Path, bank: Path, tmp_path: Path
) -> None:
    """Each says what it is and what to do."""
    guardian, other = tmp_path / "guardian.json", tmp_path / "other"
    build_bank(other, scenarios=("merge",), episodes=2, steps=6, drawn=False)
    assert say("guardian", "fit", run, "--out", guardian, "--frames", bank)[0] == 0
    fit = ("guardian", "fit", "--out", tmp_path / "new.json")
    for words, why in (
        (("guardian", "score", guardian, run, "--unseen"), "all 18 frames of run chose this guardian, so none is left"),
        ((*fit, run, "--frames", other), "other is another one: the bank differs"),
        (("guardian", "score", guardian, run, "--frames", other), "the bank differs"),
        ((*fit, tmp_path / "nowhere"), "nowhere does not exist: give the folder of a run"),
        (
            (*fit, bank),
            f"holds no votes: ask models with 'eyechart run admission --model SPEC --frames {bank} --out RUN'",
        ),
        ((*fit, tmp_path), "run.json"),
    ):
        code, _, told = say(*words)
        assert (code, why in told) == (2, True), told
