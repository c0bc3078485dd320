"""The doctor of policies: each fault is named in words, and a sound policy is found sound."""

import asyncio
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from arm_logs import arm_bank
from eyechart.cli.app import app
from eyechart.errors import BankError, SpecError
from eyechart.frames import FrameBank
from eyechart.probe.policies import MOST_CALLS, PolicyDiagnosis, _Asked, examine_policy
from eyechart.simulators import open_bank_simulator
from eyechart.spaces.motion import MotionSpace


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small tabletop."""
    return open_bank_simulator("tabletop").build(tmp_path_factory.mktemp("doctor") / "bank", seeds=(0,), steps=4)


@pytest.mark.parametrize(
    ("name", "amiss", "words"),
    [
        ("not_a_number", {"motions"}, "NaN"),
        ("half", {"motions"}, "(4, 3), and the bank's motions (8, 3)"),
        ("broken", {"motions"}, "KeyError: 'left'"),
        ("raw", {"camera:wrist", "unit"}, "times as large as in the log"),
        ("middle_undeclared", {"cameras", "grey", "instruction", "camera:top", "camera:wrist"}, "changes not one bit"),
        ("deaf_undeclared", {"instruction", "camera:wrist"}, "another instruction changes not one bit"),
        ("queue", {"same"}, "answer from a queue"),
        ("liar", {"same"}, "two answers to one seed"),
        ("still", {"cameras", "grey", "instruction", "state", "camera:top", "camera:wrist", "constant"}, "same answer"),
        ("reach_undeclared", {"camera:wrist"}, "changes not one bit"),
        ("secret", {"instruction"}, "it declares that it does not read this, and the answer changes with it"),
        ("nearly_still", {"constant"}, "times as much as the log: it is constant, or nearly so"),
        (
            "broken",
            {"motions"},
            "(it is given the cameras top, wrist, a state of 3 numbers (state) and an instruction)",
        ),
    ],
)
def test_each_fault_is_named(bank: FrameBank, name: str, amiss: set[str], words: str) -> None:
    """In at most twenty calls; what is sound is said to be."""
    found = examine_policy(f"python:arms:{name}", bank)
    said = {one.name: one for one in found.findings}
    assert amiss <= {one.name for one in found.findings if one.fine is False}
    assert words in " ".join(one.says for one in found.findings if one.fine is False)
    assert found.exit_code == 1
    assert found.calls <= MOST_CALLS
    if name.partition("_")[0] in {"raw", "deaf", "reach", "middle", "still"}:
        assert said["motions"].fine
        assert said["same"].fine


@pytest.mark.parametrize(
    ("name", "check", "fine", "words"),
    [
        ("blue_first", "pictures", False, "with red and blue exchanged its error to the log is"),
        ("upside_down", "pictures", False, "turned by half"),
        ("cameras_exchanged", "pictures", False, "the cameras exchanged"),
        ("reshaped", "pictures", None, "none of the forms"),
        ("unit_floats", "cameras", None, "divided by 255 twice"),
        ("channels_first", "motions", False, "it fails: ValueError"),
        ("masked", "motions", False, "1 numbers of a masked array are masked"),
        ("objects", "motions", False, "an array of object"),
        ("overflown", "motions", False, "NaN or infinite"),
        ("varies", "motions", False, "(5, 3), (8, 3), and the bank's motions (8, 3)"),
        ("seventh", "motions", False, "CUDA error"),
        ("tokens", "unit", False, "times as large as in the log"),
        ("late_state", "same", False, "it keeps something; declare reset"),
        ("late_pictures", "same", False, "it keeps something; declare reset"),
        ("cached", "cameras", False, "is an earlier answer kept?"),
        ("unseeded", "same", False, "two answers to one seed"),
        ("jitters", "same", True, "but for rounding"),
        ("jitters_unseeing", "cameras", False, "another picture changes the answer by no more than rounding"),
        ("one_buffer", "pictures", True, "as they are given"),
        ("mutates", "pictures", True, "as they are given"),
    ],
)
def test_faults_that_people_ship_are_named(
    bank: FrameBank,
    name: str,
    check: str,
    fine: bool | None,  # noqa: FBT001 - one of the cases
    words: str,
) -> None:
    """By the check that they concern, within twenty calls; what cannot be known is not called a fault."""
    found = examine_policy(f"python:faulty_arms:{name}", bank)
    (one,) = (one for one in found.findings if one.name == check)
    assert (one.fine, words in one.says) == (fine, True), one
    assert found.calls <= MOST_CALLS


def test_a_policy_that_hears_nothing_is_not_told_that_its_colours_are_exchanged(bank: FrameBank) -> None:
    """Red and blue exchanged bring its answer to the log where blue is named, and away from it where red is."""
    (one,) = (one for one in examine_policy("python:arms:deaf", bank).findings if one.name == "pictures")
    assert one.fine is None


@pytest.mark.parametrize("steps", [4, 6])
def test_numbers_are_held_against_moments_of_all_parts_of_an_episode(tmp_path: Path, steps: int) -> None:
    """Were they all of one step, on which the log hardly moves, any other answer would be of another unit."""
    bank = open_bank_simulator("tabletop").build(tmp_path / "bank", steps=steps)
    assert len({frame.step for frame in _Asked(bank, _motion(bank)).further}) == 4
    said = {one.name: one for one in examine_policy("python:arms:deaf", bank).findings}
    assert said["unit"].fine, said["unit"].says
    assert {one.name: one for one in examine_policy("python:arms:raw", bank).findings}["unit"].fine is False


def _motion(bank: FrameBank) -> MotionSpace:
    assert bank.manifest.motion is not None
    return bank.manifest.motion


def test_a_sound_policy_has_nothing_amiss(bank: FrameBank) -> None:
    """A trained one that uses all of its channels; one that draws its answers cannot be told by single calls."""
    sound = examine_policy("trained:sees", bank)
    assert {one.name for one in sound.findings if one.fine is not True} == set()
    assert sound.exit_code == 0
    drawn = {one.name: one for one in examine_policy("trained:sampling", bank).findings}
    assert drawn["motions"].fine
    assert drawn["unit"].fine
    assert drawn["cameras"].fine is None
    assert "drawn" in drawn["cameras"].says
    reset = {one.name: one.fine for one in examine_policy("python:arms:reset", bank).findings}
    assert reset["same"]


def test_the_command_prints_it_and_exits_so(bank: FrameBank, tmp_path) -> None:  # noqa: ANN001
    """For people and as JSON; a bank without motions is refused."""
    done = CliRunner().invoke(app, ["doctor", "trained:sees", "--frames", str(bank.root)])
    assert (done.exit_code, "fine        instruction: it reaches the policy" in done.stdout) == (0, True)
    amiss = CliRunner().invoke(app, ["doctor", "python:arms:half", "--frames", str(bank.root), "--json"])
    assert amiss.exit_code == 1
    assert json.loads(amiss.stdout)["findings"][0]["outcome"] == "amiss"
    with pytest.raises(BankError, match="does not say what a motion is"):
        examine_policy("trained:sees", open_bank_simulator("rover").build(tmp_path / "r", seeds=(0,), steps=4))


def test_a_channel_that_it_declares_not_to_read_is_not_amiss(bank: FrameBank) -> None:
    """Nor is a camera of another bank accepted, as a run does not."""
    found = examine_policy("python:arms:reach", bank)
    said = {one.name: one for one in found.findings}
    assert (found.exit_code, said["camera:wrist"].fine) == (0, True)
    assert said["camera:wrist"].says == "it declares that it does not read this, and nothing changes with it"
    assert all(one.fine for one in examine_policy("python:arms:deaf", bank).findings if one.name == "instruction")
    with pytest.raises(SpecError, match="declares the channel 'camera:front', and the bank has cameras, camera:top"):
        examine_policy("python:arms:front", bank)


def test_noise_is_not_taken_for_variation(bank: FrameBank) -> None:
    """As large as the log's, and at one moment as large as between moments: nobody can say whether it is constant."""
    said = {one.name: one for one in examine_policy("python:arms:trembling", bank).findings}
    assert said["constant"].fine is None
    assert "noise hides whether it is constant" in said["constant"].says


def test_a_camera_whose_pictures_are_all_alike_is_not_amiss(tmp_path: Path) -> None:
    """What cannot be exchanged is said to be so."""
    still = arm_bank(tmp_path / "arm", side="still")
    said = {one.name: one for one in examine_policy("python:arm_logs:by_front", still).findings}
    assert said["camera:front"].fine
    assert (said["camera:side"].fine, "the same in every other episode" in said["camera:side"].says) == (None, True)


def test_it_is_asked_where_an_event_loop_runs_already(bank: FrameBank) -> None:
    """As in a notebook."""

    async def cell() -> PolicyDiagnosis:
        return examine_policy("trained:sees", bank)

    assert asyncio.run(cell()) == examine_policy("trained:sees", bank)
