"""A look at a LeRobotDataset: a policy's steps are found out by asking it, and a model sees its one camera."""

import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from data_sets import arm, lerobot, reach
from eyechart.cli.app import app
from eyechart.frames import open_bank
from faults import FaultServer
from readme import ANSWERS, README, door, run
from steering import Driver, rover_set

pytestmark = pytest.mark.models


def test_a_policy_is_asked_with_as_many_steps_as_it_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And once more nothing is asked, nor is it tried again."""
    monkeypatch.chdir(tmp_path)
    reach(tmp_path / "set", {}, changes=True)
    words = ["look", "brakers:four_steps", "--dataset", "set"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code in {0, 1, 2}, done.output
    assert done.stdout.startswith(("Yes. ", "In part. ", "No. ", "Inconclusive. "))
    assert "another episode's pictures" in done.stdout
    bank = open_bank(tmp_path / "looks/python-brakers-four_steps/bank")
    assert bank.manifest.motion is not None
    assert bank.manifest.motion.shape == (4, 2)
    again = CliRunner().invoke(app, words)
    assert again.stdout == done.stdout
    assert "at most 0 calls" in again.stderr


def test_the_door_of_the_readme_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its first command as it stands, with a function of the name and the arguments that it gives."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "my_robot", raising=False)
    reach(tmp_path / "so100", {}, changes=True)
    words, trained = door("robot policy")
    assert trained == ["look", "trained:sees"]  # tests/test_look.py looks at it
    assert "def act(images, state, instruction)" in README
    (tmp_path / "my_robot.py").write_text(
        "from brakers import four_steps\n\n\ndef act(images, state, instruction):\n"
        "    return four_steps(images, state, instruction)\n"
    )
    assert run(words).startswith(ANSWERS)


def test_a_policy_that_needs_earlier_instants_gets_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The look's bank holds as many as the policy declares."""
    monkeypatch.chdir(tmp_path)
    reach(tmp_path / "set", {}, changes=True)
    words = ["look", "brakers:goes_on", "--dataset", "set"]
    done = CliRunner().invoke(app, words)
    assert done.stdout.startswith("No. "), done.output
    bank = open_bank(tmp_path / "looks/python-brakers-goes_on/bank")
    assert (bank.manifest.history, min(frame.step for frame in bank)) == (1, 1)
    assert CliRunner().invoke(app, words).stdout == done.stdout


def test_a_kind_of_motions_that_is_not_told_leads_to_the_long_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The import says which option it needs, and the look where that is given."""
    monkeypatch.chdir(tmp_path)
    arm(tmp_path / "set", inside=False)
    done = CliRunner().invoke(app, ["look", "brakers:four_steps", "--dataset", "set"])
    assert "give it with --kind delta" in str(done.exception)
    assert "make the bank with 'eyechart frames import'" in str(done.exception)


def test_a_model_is_asked_about_the_camera_of_a_data_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A SPEC of a served model or a scripted one is a controller, with or without a data set."""
    monkeypatch.chdir(tmp_path)
    lerobot(tmp_path / "set")
    done = CliRunner().invoke(app, ["look", "scripted:constant", "--dataset", "set"])
    assert done.stdout.startswith("No. The camera changes its decision on less than"), done.output
    assert len(open_bank(tmp_path / "looks/scripted-constant/bank")) == 80


STATED = """
name = "drive"
user = '''
You drive a rover by its camera. Heading and pace: {state}. Your task: {task}.
Reply as JSON: {"steer": <heading to take>, "speed": <pace to take>}.
'''
[answer]
fields = [{name = "steer", kind = "number", key = "steer"}, {name = "speed", kind = "number", key = "speed"}]
"""


def test_a_model_that_states_its_motions_in_words_is_looked_at_on_a_data_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that reads the picture, and one that does not: opposite answers, and the same command asks nothing again."""
    monkeypatch.chdir(tmp_path)
    rover_set(tmp_path / "set")
    (tmp_path / "drive.toml").write_text(STATED)
    for looks, says in (
        (True, "Yes. What the picture shows changes its motion"),
        (False, "No. The picture could be another"),
    ):
        with FaultServer([Driver(looks=looks)]) as server:
            asked = ["look", "openai:m", "--dataset", "set", "--prompt", "drive.toml", "--base-url", server.base_url]
            done = CliRunner().invoke(app, [*asked, "--out", str(looks)])
            known = server.requests
            again = CliRunner().invoke(app, [*asked, "--out", str(looks)])
        assert done.stdout.startswith(says), done.output
        assert (again.stdout, server.requests) == (done.stdout, known)
        assert open_bank(tmp_path / str(looks) / "bank").manifest.motion is not None


def test_a_prompt_that_does_not_fit_a_data_set_says_what_it_may_ask_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before any call: a column that is none, and an answer of other numbers than the motion has."""
    monkeypatch.chdir(tmp_path)
    rover_set(tmp_path / "set")
    asked = ["look", "openai:m", "--dataset", "set", "--base-url", "http://127.0.0.1:9", "--prompt", "drive.toml"]
    for before, after, says in (
        ("{state}", "{pace}", "a prompt of this bank may say: task, state, actions"),
        (', {name = "speed", kind = "number", key = "speed"}', "", "the numbers steer, speed"),
    ):
        (tmp_path / "drive.toml").write_text(STATED.replace(before, after))
        assert says in str(CliRunner().invoke(app, asked).exception)
