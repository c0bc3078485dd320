"""The online run: worlds are vetted, then estimators drive in those that passed, and nothing is credited to silence."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

import short_worlds
from drives import always, drive, make_run
from eyechart import cli, simulators
from eyechart.cli.app import app
from eyechart.episodes import Bounds, Setup, read_episodes
from eyechart.errors import LedgerError, SpecError
from eyechart.ledger import Ledger
from eyechart.limits import Limits
from eyechart.manifest import LEDGER
from eyechart.models.prices import Prices
from eyechart.perception.view import VIEWS
from eyechart.simulators import open_simulator
from eyechart.studies import ReadOptions, open_study, study_of
from eyechart.studies.probes import spent_on
from eyechart.studies.structured import online
from eyechart.studies.structured.observed_frames import SEEN, check
from eyechart.studies.structured.online import WorldCheck, check_world
from eyechart.verdicts.admission import CLAUSES

CONTROL = "scripted:scene_positive_control"
BLIND = "scripted:scene_silent_when_free"


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Register the short worlds, whose pictures are highway's."""
    for name, place in short_worlds.SIMULATORS.items():
        monkeypatch.setitem(simulators.SIMULATORS, name, place)


@pytest.mark.slow
def test_estimators_drive_in_worlds_that_pass_and_as_they_were_vetted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A dark world is refused by name and another takes its place; the control drives as in its vetting."""
    out = tmp_path / "run"
    words = ["eyechart", "run", "online", "--simulator", "short", "--episodes", "1", "--out", str(out)]
    monkeypatch.setattr("sys.argv", [*words, "--model", CONTROL, "--model", BLIND])
    with pytest.raises(SystemExit) as left:
        cli.main()
    told = capsys.readouterr().err
    assert left.value.code == 0
    assert "refused: merge/0: frame 3: renderer integrity: the picture has one colour" in told
    assert "2 episodes in worlds that pass the checks, 2 to drive" in told
    scored = online.score(out)
    assert scored.as_dict()["worlds"] == ["merge/1"]
    vetting, control, blind = (scored.driven[name] for name in (online.CONTROL, CONTROL, BLIND))
    assert control.decisions == vetting.decisions
    assert (control.crash_rate.value, control.crash_rate.n) == (vetting.crash_rate.value, 1)
    assert control.fail_safe == 0
    assert blind.fail_safe > 0
    frames = sum(len(one.steps) for one in read_episodes(out) if one.key.policy == CONTROL)
    assert control.statistics["parse"].n == 2 * frames
    assert [control.statistics[name].value for name in EXACT] == [1.0] * len(EXACT)
    assert blind.statistics["parse"].value < 1
    assert scored.frames(CONTROL) == (
        True,
        f"renderer integrity and positive control hold on all {frames} frames that it saw",
    )
    for episode in read_episodes(out):
        silent = [step for step in episode.steps if step.decision.action is None]
        assert all((step.executed_action, step.decision.missing) == ("SLOW", "unparsed") for step in silent)
    monkeypatch.setattr("eyechart.studies.structured.online.vet_worlds", None)
    assert len(online.plan("short", [CONTROL, BLIND], out, episodes=1).episodes.left()) == 0
    with pytest.raises(LedgerError, match="has 1 worlds that passed, now 6 episodes were given"):
        online.plan("short", [CONTROL, BLIND], out, episodes=6)
    monkeypatch.setattr("sys.argv", ["eyechart", "score", str(out), "--all"])
    with pytest.raises(SystemExit) as left:
        cli.main()
    printed = capsys.readouterr().out
    assert left.value.code == 0
    for part in ("online in short: 1 of 2 worlds pass the checks", online.CONTROL, "fail-safe", "refused: merge/0"):
        assert part in printed


def test_a_world_that_tells_what_is_not_in_the_picture_fails_the_positive_control() -> None:
    """The check is of the truth against the pixels, at every frame."""
    found = check_world(open_simulator("off"), "merge", 1, VIEWS["highway"])
    assert found.why is not None
    assert "positive control: the gap is read 0.2" in found.why


def test_a_world_is_not_refused_for_what_stands_beside_a_forward_camera() -> None:
    """At three of 24 frames an obstacle beside the rover closes a side, which no picture shows; it is counted."""
    found = check_world(open_simulator("rover"), "offset", 0, None)
    assert (found.why, found.frames, found.unseen, found.ended) == (None, 24, 3, "goal")


def test_worlds_with_the_rovers_camera_have_its_distances_and_its_view(tmp_path: Path) -> None:
    """Under the controller too: an estimator is told that near is below 8 m, and drives by that."""
    passed = (WorldCheck("offset", 0, 24, "goal", {}, 0.0, None, 0),)
    plain, planned = (
        online.plan(name, [CONTROL], tmp_path / name, episodes=1, vetted=passed) for name in ("rover", "rover-mpc")
    )
    assert planned.manifest.prompt == plain.manifest.prompt
    assert "8 m" in planned.manifest.prompt.user
    assert planned.drivers.answers == plain.drivers.answers
    assert planned.manifest.view == VIEWS["rover"].key


def test_too_few_worlds_and_no_run_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the last world's fault in words, before anything is written."""
    monkeypatch.setattr("eyechart.studies.structured.online._SEEDS_TRIED", 1)
    with pytest.raises(SpecError, match=r"too few worlds of 'merge' that pass.*renderer integrity"):
        online.plan("short", [CONTROL], tmp_path / "run")
    assert not (tmp_path / "run").exists()
    with pytest.raises(LedgerError, match="holds no online run"):
        online.score(tmp_path)


def test_a_vetting_without_a_world_is_refused(tmp_path: Path) -> None:
    """An empty record would be a run of no episodes."""
    (tmp_path / "vetting.json").write_text("[]")
    for use in (lambda: online.plan("short", [CONTROL], tmp_path, episodes=1), lambda: online.score(tmp_path)):
        with pytest.raises(LedgerError, match="no world in it passed"):
            use()


EXACT = ("parse", "close_accuracy", "scene_equivariance", "action_equivariance")


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drive the control and a silent estimator in a short world, and check what they saw."""
    out = tmp_path_factory.mktemp("online") / "run"
    with pytest.MonkeyPatch.context() as patch:
        for name, place in short_worlds.SIMULATORS.items():
            patch.setitem(simulators.SIMULATORS, name, place)
        online.run(online.plan("short", [CONTROL, BLIND], out, episodes=1))
        online.check_seen(out)
    return out


def gate(run: Path, *words: object) -> tuple[int, dict[tuple[str, str], tuple[str, str]]]:
    """Return a gate's exit code, and by model and requirement its outcome and why."""
    done = CliRunner().invoke(app, ["gate", str(run), *map(str, words), "--json"])
    checks = json.loads(done.stdout)["checks"]
    return done.exit_code, {(one["model"], one["requirement"]): (one["outcome"], one["because"]) for one in checks}


def test_a_gate_holds_an_online_run_to_the_clauses_over_the_frames_that_were_met(driven: Path) -> None:
    """The control parses all and is equivariant; a silent estimator fails by name; the frames are one check more."""
    code, checks = gate(driven)
    assert code == 1
    assert {name for _, name in checks} == {*CLAUSES, "frames"}
    assert all(checks[CONTROL, name][0] == "holds" for name in (*EXACT, "frames"))
    assert checks[BLIND, "parse"][0] == "fails"
    assert gate(driven, "--require", "frames")[0] == 0
    held = gate(driven, "--require", "parse", "--max-unparsed", "0.0")[1]
    assert held[CONTROL, "max_unparsed"][0] == "holds"
    refused = CliRunner().invoke(app, ["gate", str(driven), "--require", "depth"])
    assert (refused.exit_code, "admission, parse" in f"{refused.exception}") == (1, True)


def test_a_gate_cannot_say_where_frames_fail_were_not_checked_or_are_missing(driven: Path, tmp_path: Path) -> None:
    """What fails still fails; what would hold cannot be said."""
    unchecked, faulty, cut = (Path(shutil.copytree(driven, tmp_path / name)) for name in ("a", "b", "c"))
    (unchecked / SEEN).unlink()
    _, checks = gate(unchecked, "--require", "parse,frames")
    assert checks[CONTROL, "parse"][0] == checks[CONTROL, "frames"][0] == "cannot say"
    assert checks[BLIND, "parse"][0] == "fails"
    assert "were not checked: the same command checks them" in checks[CONTROL, "frames"][1]
    found = json.loads((faulty / SEEN).read_text())
    (faulty / SEEN).write_text(json.dumps([{**one, "why": "frame 3: renderer integrity: black"} for one in found]))
    assert gate(faulty)[1][CONTROL, "frames"][0] == "fails"
    assert gate(faulty, "--require", "parse")[1][CONTROL, "parse"][0] == "cannot say"
    lines = [line for line in (cut / "episodes.jsonl").read_text().splitlines() if CONTROL not in line]
    (cut / "episodes.jsonl").write_text("".join(f"{line}\n" for line in lines))
    code, checks = gate(cut)
    assert checks[CONTROL, "parse"] == ("cannot say", "the run is unfinished: 0 of 1 episodes")
    assert code == 1


def test_every_frame_that_an_estimator_saw_is_checked_in_the_world_again(driven: Path) -> None:
    """A world that turned dark, and one that tells another gap now, are named with the frame."""
    episode = next(one for one in read_episodes(driven) if one.key.policy == CONTROL)
    view = VIEWS["highway"]
    assert check(open_simulator("short"), episode, view).why is None
    dark = check(open_simulator("short"), replace(episode, key=replace(episode.key, seed=0)), view)
    assert "renderer integrity" in str(dark.why) or "repeat itself" in str(dark.why)
    assert check(open_simulator("off"), episode, view).why == (
        "frame 0: the world does not repeat itself: its gap is another one now"
    )


@pytest.mark.slow
def test_a_limit_counts_the_estimators_that_do_not_drive_today(driven: Path, tmp_path: Path) -> None:
    """What another one took in the same run is spent."""
    vetted, out = online.read_vetting(driven), tmp_path / "run"
    online.run(online.plan("short", [CONTROL], out, episodes=1, vetted=vetted))
    before = spent_on([out], Prices(())).calls
    most = before + 4
    today, bounds = online.plan("short", [BLIND], out, episodes=1), Bounds(limits=Limits(calls=most))
    assert online.run(today, bounds=bounds).stopped == f"{most} calls were sent, and --max-calls is {most}"
    assert spent_on([out], Prices(())).calls == most


def test_reflections_may_be_left_out_and_a_run_goes_on_as_it_was_begun(tmp_path: Path) -> None:
    """Then equivariance cannot be said, and half of the calls are made; what is resumed asks as before."""
    out = tmp_path / "run"
    online.run(online.plan(Setup("short"), [CONTROL], out, episodes=1))
    figures = online.score(out).driven[CONTROL].statistics
    assert (figures["scene_equivariance"].value, figures["parse"].value) == (None, 1.0)
    with Ledger(out / LEDGER) as ledger:
        assert {key.condition for key, _ in ledger.replies(CONTROL)} == {"real"}
    assert online.plan("short", [CONTROL], out, episodes=1).episodes.drivers.mirror_axis is None


def test_the_page_says_first_who_is_admitted_on_what_it_met_and_who_crashes(driven: Path) -> None:
    """And nothing of who drives by sight, which nobody was asked, nor of options that the command has not."""
    html = (
        open_study("online")
        .report([driven], [], ReadOptions(independent=False, reread=False), lambda _: None)
        .page.html
    )
    page = html.decode()
    opening = page[page.index('class="sentence"') : page.index("</section>", page.index('class="sentence"'))]
    assert f"not admitted 2 ({CONTROL}, {BLIND})" in opening
    assert re.search(r"It fails \w+, [^:]+: [0-9.]+, at least [0-9.]+ \(n = \d+\)", opening)
    assert "Crashes beside the positive control" in opening
    assert page.index('id="first"') < page.index('id="ladder"')
    assert 'id="blind"' not in page
    assert "--condition" not in page


def test_a_report_with_other_drives_beside_is_one_of_drives_whichever_is_named_first(
    driven: Path, tmp_path: Path
) -> None:
    """It was refused where the online run came first: the other was said to hold none."""
    other = make_run(tmp_path / "other", drive("constant:SLOW", always("SLOW"), seeds=[0]))
    for runs in ([driven, other], [other, driven]):
        made = study_of(runs[0], "report").report(runs, [], ReadOptions(driven=False), lambda _: None)
        assert "Which policies drive well, and which by sight?" in made.page.html.decode()
