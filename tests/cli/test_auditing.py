"""Runs of episodes from the command line: the ladder, the audit, films, and the commands that are for batteries."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import banks
import tiny_worlds
from drives import add_replies, always, drive, make_run, tossing
from eyechart.calls import Reply
from eyechart.cli.app import app
from eyechart.episodes import write_episodes
from eyechart.errors import LedgerError, SpecError
from eyechart.simulators import SIMULATORS
from eyechart.studies import battery
from eyechart.studies.closed_loop.ladder import plan_ladder

pytestmark = pytest.mark.slow

LOOK = "python:tiny_worlds:look"


def say(*words: object) -> Result:
    """Run a command."""
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture
def constants(tmp_path: Path) -> Path:
    """Return a run of two constants and a coin."""
    made = [*drive("constant:STOP", always("STOP")), *drive("constant:SLOW", always("SLOW"))]
    return make_run(tmp_path / "run", [*made, *drive("random", tossing("c"))])


def test_a_finished_ladder_drives_nothing_and_stands_beside_the_papers(tmp_path: Path) -> None:
    """Seven policies × four scenarios × eight seeds: planned, found driven, scored, and the aliases explained."""
    planned = plan_ladder(tmp_path / "ladder")
    assert len(planned.keys) == 224
    (tmp_path / "ladder").mkdir()
    planned.manifest.write(tmp_path / "ladder")
    for policy in planned.manifest.policies:
        action = policy.partition(":")[2]
        write_episodes(tmp_path / "ladder", drive(policy, always(action) if action else tossing(policy)))
    told = say("ladder", "--out", tmp_path / "ladder")
    assert told.exit_code == 0
    assert "224 episodes, 224 driven already" in told.stderr
    assert "Table t:baselines" in told.stdout
    assert "400.0 | 514.4 (-22.2)" in told.stdout
    assert "aliased commands: constant:STOP, constant:SLOW" in told.stdout.replace("\n", " ")
    found = json.loads(say("ladder", "--out", tmp_path / "ladder", "--json").stdout)
    assert {row["statistics"]["reward"]["n"] for row in found["ladder"]} == {32}
    assert len(found["beside_paper"]) == 6
    assert found["references"] == {"highway": "constant:STRAIGHT"}


def test_what_a_ladder_is_held_against_is_checked_before_anything_is_driven(tmp_path: Path) -> None:
    """The error names who drives; no folder is begun."""
    told = say("ladder", "--out", tmp_path / "ladder", "--against", "oracel")
    assert isinstance(told.exception, SpecError)
    assert "--against oracel: no such policy drives here; there are constant:STOP, constant:SLOW" in str(told.exception)
    assert not (tmp_path / "ladder").exists()


def test_a_model_on_the_ladder_is_estimated_and_bounded_as_in_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A dry run says what it will take and writes nothing; a limit ends it with exit 3, and says what is left."""
    monkeypatch.setitem(SIMULATORS, "tiny", tiny_worlds.SIMULATORS["tiny"])
    declared = replace(tiny_worlds.Tiny.declared, scenarios={"whole": "Ten cells."})
    monkeypatch.setattr(tiny_worlds.Tiny, "declared", declared)
    words = ("ladder", "--simulator", "tiny", "--seeds", 1, "--out", tmp_path / "ladder", "--policy", LOOK)
    assert "8 episodes, 0 driven already" in say(*words, "--no-marginal", "--dry-run").stderr
    dry = say(*words, "--dry-run")
    assert "9 episodes, 0 driven already" in dry.stderr
    assert (dry.exit_code, (tmp_path / "ladder").exists()) == (0, False)
    assert f"{LOOK}: about 12 calls, tokens unknown" in dry.stderr
    cut = say(*words, "--max-calls", 5)
    assert cut.exit_code == 3
    assert f"{LOOK}: 1 episode is unfinished, 1 of them begun" in cut.stderr
    assert f"marginal:{LOOK}: 1 episode is not driven yet" in cut.stderr
    assert "5 calls were sent, and --max-calls is 5; 2 episodes are left; a higher limit resumes" in cut.stderr
    whole = say(*words, "--json", "--against", "oracle")
    assert whole.exit_code == 0
    found = json.loads(whole.stdout)
    assert (found["references"], found["references_chosen_on_these_data"]) == ({"tiny": "oracle"}, False)
    named, chosen = (" ".join(say(*words, *more).stdout.split()) for more in (("--against", "oracle"), ()))
    assert "tiny: policy less oracle" in named
    assert "the p are not exact" not in named
    assert "so the differences lean to its side and the p are not exact" in chosen


def test_a_ladder_of_more_worlds_than_a_machine_holds_is_refused() -> None:
    """In words, before anything is planned."""
    told = say("ladder", "--simulator", "tiny", "--seeds", 200_000_000, "--dry-run")
    assert (told.exit_code, "100000" in told.stderr) == (2, True)


def test_the_audit_prints_the_papers_table_and_names_a_cache(constants: Path, tmp_path: Path) -> None:
    """Exit 1 where one is suspected, 0 where drives converge or alias for good reason."""
    told = say("audit", constants)
    assert told.exit_code == 0
    for words in ("degeneracy audit (Table t:degeneracy)", "gap in quartiles", "Decision-level replay", "constant"):
        assert words in told.stdout
    episodes = [*drive("a", tossing("x")), *drive("b", tossing("x"))]
    run = make_run(tmp_path / "cached", episodes, models=["a", "b"])
    add_replies(
        run, episodes, lambda _step, n: Reply(f"thought {n % 640}", "stop", seconds=1.0), lambda step: step.frame
    )
    assert say("audit", run).exit_code == 1
    found = json.loads(say("audit", run, "--json").stdout)
    assert [one["kind"] for one in found["identical"]] == ["suspect caching"]


def test_score_reads_a_run_of_episodes(constants: Path) -> None:
    """Every number as JSON, tables and sentences for people."""
    found = json.loads(say("score", constants, "--json").stdout)
    assert found["study"] == "closed_loop"
    assert [row["policy"] for row in found["audit"]] == ["constant:STOP", "constant:SLOW", "random"]
    told = " ".join(say("score", constants).stdout.split())
    assert "Table t:degeneracy" in told
    assert "the p are not exact" in told
    named = json.loads(say("score", constants, "--json", "--against", "random").stdout)
    assert (named["references"], named["references_chosen_on_these_data"]) == ({"highway": "random"}, False)


@pytest.mark.parametrize("command", ["verdict", "gate"])
def test_what_is_for_batteries_names_what_is_for_episodes(constants: Path, command: str) -> None:
    """No traceback, and no verdict on what was not asked."""
    told = say(command, constants)
    assert isinstance(told.exception, SpecError)
    assert "holds drives, which are compared world by world: use 'eyechart score'" in str(told.exception)


def test_a_battery_is_no_run_of_episodes(tmp_path: Path, constants: Path) -> None:
    """The audit says so, and one report is about one of the two."""
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light"], episodes=1)
    battery.run(battery.plan(bank.root, ["scripted:constant"], tmp_path / "battery", conditions=["real"]))
    assert isinstance(say("audit", tmp_path / "battery").exception, LedgerError)
    assert isinstance(say("score", tmp_path / "battery", "--against", "oracle").exception, SpecError)
    both = say("report", tmp_path / "battery", constants, "--out", tmp_path / "page.html")
    assert isinstance(both.exception, SpecError)
    assert not (tmp_path / "page.html").exists()


def test_the_report_of_drives_is_written_with_figures_and_tables(constants: Path, tmp_path: Path) -> None:
    """Drives that do not repeat here are shown without pictures, and said to be."""
    told = say(
        "report", constants, "--out", tmp_path / "p.html", "--figures", tmp_path / "f", "--tables", tmp_path / "t"
    )
    assert told.exit_code == 0
    assert "does not drive again here" in told.stderr
    page = (tmp_path / "p.html").read_text()
    assert "Which policies drive well, and which by sight?" in page
    assert "Beware: the reference is the best constant of these same episodes" in page
    assert {file.name for file in (tmp_path / "f").iterdir()} >= {"ladder-distance_m.svg", "drives-information.pdf"}
    assert (tmp_path / "t" / "degeneracy.csv").exists()


def test_a_film_of_a_drive_that_does_not_repeat_is_refused(constants: Path, tmp_path: Path) -> None:
    """The synthetic drives are not highway-env's, so that their states differ."""
    told = say("film", constants, "--episode", "random highway/light/0 real", "--out", tmp_path / "film.gif")
    assert isinstance(told.exception, LedgerError)
    assert "does not drive again here" in str(told.exception)


@pytest.mark.parametrize(
    ("was", "now", "told"),
    [
        ('"executed_action":"SLOW"', '"executed_action":"FLY"', "the action 'FLY' at step 0"),
        ('"condition":"real"', '"condition":"party"', "the condition 'party'"),
        ('"policy":"random"', '"policy":"nobody"', "the policy 'nobody'"),
    ],
)
def test_a_record_of_what_the_run_does_not_have_is_named(constants: Path, was: str, now: str, told: str) -> None:
    """However well it is formed: another action, condition or policy than the run's."""
    file = constants / "episodes.jsonl"
    assert was in file.read_text(encoding="utf-8")
    file.write_text(file.read_text(encoding="utf-8").replace(was, now), encoding="utf-8")
    found = say("score", constants)
    assert isinstance(found.exception, LedgerError)
    assert told in str(found.exception)


def test_a_film_of_an_episode_that_ended_inside_a_step_says_so(constants: Path, tmp_path: Path) -> None:
    """Its last state is of no recorded step."""
    file = constants / "episodes.jsonl"
    kept = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    for one in kept:
        one.update(ended="error", detail="RuntimeError: the wheel came off", steps=one["steps"][:2])
    file.write_text("".join(json.dumps(one) + "\n" for one in kept), encoding="utf-8")
    told = say("film", constants, "--episode", "random highway/light/0 real", "--out", tmp_path / "film.gif")
    assert isinstance(told.exception, LedgerError)
    assert "ended in an error inside step 2" in str(told.exception)
    assert "the wheel came off" in str(told.exception)
