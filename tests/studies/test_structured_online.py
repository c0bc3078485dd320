"""The online run: worlds are vetted, then estimators drive in those that passed, and nothing is credited to silence."""

from pathlib import Path

import pytest

import short_worlds
from eyechart import cli, simulators
from eyechart.episodes import read_episodes
from eyechart.errors import LedgerError, SpecError
from eyechart.perception.view import VIEWS
from eyechart.simulators import open_simulator
from eyechart.studies.structured import online
from eyechart.studies.structured.online import Vetted, vet

CONTROL = "scripted:scene_positive_control"
BLIND = "scripted:scene_silent_when_free"


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Register the short worlds, whose pictures are highway's."""
    for name, place in short_worlds.SIMULATORS.items():
        monkeypatch.setitem(simulators.SIMULATORS, name, place)


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
    for episode in read_episodes(out):
        silent = [step for step in episode.steps if step.decision.action is None]
        assert all((step.executed_action, step.decision.missing) == ("SLOW", "unparsed") for step in silent)
    monkeypatch.setattr("eyechart.studies.structured.online.vet_worlds", None)
    assert len(online.plan("short", [CONTROL, BLIND], out, episodes=1).episodes.left()) == 0
    with pytest.raises(LedgerError, match="has 1 worlds that passed, now 6 episodes were asked for"):
        online.plan("short", [CONTROL, BLIND], out, episodes=6)
    monkeypatch.setattr("sys.argv", ["eyechart", "score", str(out)])
    with pytest.raises(SystemExit) as left:
        cli.main()
    printed = capsys.readouterr().out
    assert left.value.code == 0
    for part in ("online in short: 1 of 2 worlds pass the checks", online.CONTROL, "fail-safe", "refused: merge/0"):
        assert part in printed


def test_a_world_that_tells_what_is_not_in_the_picture_fails_the_positive_control() -> None:
    """The check is of the truth against the pixels, at every frame."""
    found = vet(open_simulator("off"), "merge", 1, VIEWS["highway"])
    assert found.why is not None
    assert "positive control: the gap is read 0.2" in found.why


def test_a_world_is_not_refused_for_what_stands_beside_a_forward_camera() -> None:
    """At three of 24 frames an obstacle beside the rover closes a side, which no picture shows; it is counted."""
    found = vet(open_simulator("rover"), "offset", 0, None)
    assert (found.why, found.frames, found.unseen, found.ended) == (None, 24, 3, "goal")


def test_worlds_with_the_rovers_camera_have_its_distances_and_its_view(tmp_path: Path) -> None:
    """Under the controller too: an estimator is told that near is below 8 m, and drives by that."""
    passed = (Vetted("offset", 0, 24, "goal", {}, 0.0, None, 0),)
    plain, planned = (
        online.plan(name, [CONTROL], tmp_path / name, episodes=1, vetted=passed).episodes
        for name in ("rover", "rover-mpc")
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
        with pytest.raises(LedgerError, match="it has none that passed"):
            use()
