"""What a bank can say of a policy is simulated before a call is made."""

import json
import re
from functools import partial
from pathlib import Path

import pytest
from typer.testing import CliRunner

from arm_logs import arm_bank
from eyechart.calibrate.policies import power
from eyechart.calibrate.reach import matches, reachable, unmoved, unreachable
from eyechart.cli.app import app
from eyechart.frames import FrameBank
from eyechart.simulators import open_bank_simulator
from eyechart.studies import policy
from eyechart.studies.policy.scores import judge


def policy_verdicts(bank: FrameBank, out: Path) -> list[str]:
    """Return what the camera of who does as the log does is called."""
    policy.run(policy.plan(bank.root, ["python:arm_logs:by_front"], out))
    return [one.camera.label for one in judge(policy.score(out)).values()]


@pytest.mark.slow
def test_more_episodes_settle_more_and_too_few_settle_nothing() -> None:
    """By the share that the camera carries; what draws its answers is settled less often."""
    few, some, many = (power(count, 6 * count, 1, {}, draws=12).said for count in (4, 12, 36))
    assert {pair for shares in few.values() for pair in shares.values()} == {(0.0, 0.0)}
    assert some["same"]["0"][0] > 0.9
    assert some["same"]["0.4"][1] > 0.9
    assert many["same"]["0.05"][0] > some["same"]["0.05"][0]


@pytest.mark.slow
def test_the_command_says_it_and_what_cannot_be_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In calls, channels and shares, and as JSON."""
    monkeypatch.setattr("eyechart.calibrate.policies.power", partial(power, draws=6))
    bank = open_bank_simulator("tabletop").build(tmp_path / "bank", steps=4, seeds=(0, 1))
    result = CliRunner().invoke(app, ["plan", str(bank.root)])
    assert result.exit_code == 0, result.output
    assert " cameras, camera:top, camera:wrist, state, instruction " in result.stdout
    assert "how often 8 episodes (32 frames) settle it" in result.stdout
    assert re.search(r"--shapley +64 more calls", result.stdout)
    words = " ".join(result.stdout.split())
    assert "claimed for these episodes, not of the data set: if none of 8 responds, up to 43.8% may" in words
    said = json.loads(CliRunner().invoke(app, ["plan", str(bank.root), "--json"]).stdout)
    assert (said["episodes"], said["frames"]) == (8, 32)
    assert said["calls"] == policy.plan(bank.root, ["trained:sees"], tmp_path / "run").counts()[0]
    assert said["said"]["same"]["0"][0] > 0.5


def test_what_no_policy_can_get_is_said_before_a_call_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of fourteen joints no frame has a match: what a camera is used for is open there, and the table promises none."""
    monkeypatch.setattr("eyechart.calibrate.policies.power", partial(power, draws=1))
    bank = arm_bank(tmp_path / "arm", joints=14, side="still")
    result = CliRunner().invoke(app, ["plan", str(bank.root), "--json"])
    said = json.loads(result.stdout)
    assert said["matches"] == {"cameras": 0, "camera:front": 0, "camera:side": 0}
    assert said["matched"] == 0
    assert {one for shares in said["apart"].values() for one in shares.values()} == {0.0}
    assert said["said"]["same"]["0.4"][1] == 1.0
    assert {"camera_content", "pose_only", "object_grounded"} <= set(said["unreachable"])
    assert said["unreachable"]["pose_only"].endswith("frames have no frame of another episode at a similar state")
    assert "differs in the side camera" in said["unreachable"]["ignores_camera of camera:side"]
    assert {"uses_camera", "ignores_camera", "camera_presence", "state_shortcut", "instruction_ignored"} <= set(
        said["reachable"]
    )
    printed = " ".join(CliRunner().invoke(app, ["plan", str(bank.root)]).stdout.split())
    assert "frames with a match at a similar state of 48: cameras 0, camera:front 0, camera:side 0" in printed
    assert "labels that a policy may get uses_camera, camera_presence, ignores_camera, state_shortcut" in printed
    assert "not reachable object_grounded, camera_content, pose_only, " in printed


def test_an_arm_that_never_comes_back_to_a_pose_shows_that_it_looks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Look, gate and page say that it uses its camera, that for what is open, and what would settle it."""
    monkeypatch.chdir(tmp_path)
    bank = arm_bank(tmp_path / "arm", joints=14, side="still")

    def told(*words: object, code: int) -> str:
        result = CliRunner().invoke(app, list(map(str, words)))
        assert result.exit_code == code, result.output
        return " ".join(result.stdout.split())

    looked = told("look", "python:arm_logs:by_front", "--frames", bank.root, "--yes", code=1)
    assert looked.startswith("In part. It uses the camera; whether for more than its own pose is open. ")
    assert "to settle it: add frames with the same robot pose in several episodes" in looked
    run, why = tmp_path / "looks" / "python-arm_logs-by_front" / "run", "48 of 48 frames have no frame of another"
    assert why in told("gate", run, "--require", "looks", code=0)
    assert why in told("gate", run, "--require", "camera:camera_content", code=2)
    told("report", run, "--out", "page.html", code=0)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "uses camera; " in page
    assert "Next: add frames with the same robot pose in several episodes" in page


def test_a_run_makes_as_many_calls_as_were_planned_and_says_why_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where frames have no match, fewer than frames times conditions; reasons that several have are one line."""
    monkeypatch.setattr("eyechart.calibrate.policies.power", partial(power, draws=1))
    bank = arm_bank(tmp_path / "arm", tasks=("go", "leave"), length=10, episodes=16)
    said = json.loads(CliRunner().invoke(app, ["plan", str(bank.root), "--json"]).stdout)
    words = ["run", "policy", "--policy", "python:arm_logs:by_front", "--frames", str(bank.root)]
    for shapley in (False, True):
        asked = [*words, "--out", str(tmp_path / "run"), *(["--shapley"] if shapley else []), "--dry-run"]
        result = CliRunner().invoke(app, asked)
        assert result.exit_code == 0, result.output
        (line,) = (line for line in result.stderr.splitlines() if "frames ×" in line)
        number = int(line.partition("): ")[2].split()[0])
        assert "conditions (not every frame can be shown every condition): " in line
        printed = CliRunner().invoke(app, ["plan", str(bank.root)]).stdout
        more = int(printed.partition("--shapley ")[2].split()[0]) if shapley else 0
        assert number == said["calls"] + more
    reasons = [line.rpartition(", because ")[2] for line in result.stderr.splitlines() if line.startswith("left out: ")]
    assert len(reasons) == len({*reasons}) > 0
    assert any("named_plus, " in line for line in result.stderr.splitlines())


def test_labels_are_reachable_where_the_bank_can_show_them(tmp_path: Path) -> None:
    """All of them on the tabletop; of two joints those of pictures, but no object is moved; of five episodes none."""
    table = open_bank_simulator("tabletop").build(tmp_path / "table", steps=4)
    assert unreachable(table) == {}
    assert "object_grounded" in reachable(table)
    few = arm_bank(tmp_path / "few", episodes=5)
    assert reachable(few) == ()
    assert "at least 6 are needed" in unreachable(few)["camera_content"]
    arm = arm_bank(tmp_path / "arm", tasks=("go",), length=10, episodes=16)
    assert set(unreachable(arm)) == {"object_grounded", "instruction_followed", "instruction_ignored"}
    assert 0 < matches(arm)["cameras"] <= len(arm)


def test_an_arm_that_hardly_moves_in_an_episode_is_told_before_a_call_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No picture of the own episode is as far off as the matched one: content is not told from a pose there."""
    monkeypatch.setattr("eyechart.calibrate.policies.power", partial(power, draws=1))
    slow = arm_bank(tmp_path / "slow", tasks=("go",), length=8, episodes=12, pace=0.05)
    never = unreachable(slow)
    assert "object_grounded" in never
    assert "pose_only" not in never
    assert never["camera_content"].startswith(
        "pictures of the same episode differ less in number 1 of the state ('j0')"
    )
    assert policy_verdicts(slow, tmp_path / "run") == ["uses_camera"]
    stays = arm_bank(tmp_path / "stays", tasks=("go",), length=8, episodes=12, stays=1)
    assert "camera_content" in reachable(stays)
    assert unmoved(stays) == ["number 2 ('j1')"]
    printed = " ".join(CliRunner().invoke(app, ["plan", str(stays.root)]).stdout.split())
    assert "number 2 ('j1') of the state, which never changes within an episode" in printed
    assert json.loads(CliRunner().invoke(app, ["plan", str(stays.root), "--json"]).stdout)["unmoved"] == unmoved(stays)
    assert policy_verdicts(stays, tmp_path / "other") == ["camera_content"]


def test_fewer_matches_settle_less() -> None:
    """What a camera is used for is shown by the frames that have one alone; that it is used or ignored, by all."""
    every, few, none = (power(12, 72, 1, {}, draws=6, matched=one) for one in (None, (20, 8), (0, 0)))
    assert every.said == few.said == none.said
    apart = [one.apart["same"]["0.2"] for one in (every, few, none)]
    assert apart[0] >= apart[1] > apart[2] == 0
