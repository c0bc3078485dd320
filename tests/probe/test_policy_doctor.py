"""The doctor of policies: each fault is named in words, and a sound policy is found sound."""

import asyncio
import json
import re
from collections.abc import Mapping
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from arm_logs import arm_bank
from eyechart.api import examine_policy as examine
from eyechart.channels import flat_state
from eyechart.cli.app import app
from eyechart.cli.terminal import patience
from eyechart.errors import BankError, SpecError
from eyechart.frames import FrameBank
from eyechart.importing import Choices, import_table, read_rig
from eyechart.probe.policies import MOST_CALLS, PolicyDiagnosis, _ProbeFrames, examine_policy
from eyechart.prompts import motion_prompt
from eyechart.simulators import open_bank_simulator


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small tabletop."""
    return open_bank_simulator("tabletop").build(tmp_path_factory.mktemp("doctor") / "bank", seeds=(0,), steps=4)


def gripping(folder: Path) -> FrameBank:
    """Return a bank of an arm that closes its gripper, by a positive sign, once it is near."""
    lines = ["front,drive,step,x,ax,grip"]
    for drive, step in product(range(6), range(10)):
        x = 1 - 0.1 * step + 0.01 * drive
        Image.fromarray(np.full((6, 8, 3), 40 + 10 * step + drive, np.uint8)).save(folder / f"{drive}-{step}.png")
        lines.append(f"{drive}-{step}.png,{drive},{step},{x:.3f},{-0.1 - 0.01 * step:.3f},{1 if x < 0.6 else -1}")
    (folder / "t.csv").write_text("\n".join(lines))
    numbers = "".join(f'[[motion.number]]\ncolumn = "{name}"\n' for name in ("ax", "grip"))
    camera = '[[camera]]\nname = "front"\ncolumn = "front"\n[state]\narm = ["x"]\n'
    (folder / "rig.toml").write_text(f'{camera}[motion]\nhorizon = 2\nkind = "delta"\nrate_hz = 10\n{numbers}')
    return import_table(folder, folder / "t.csv", folder / "bank", Choices(rig=read_rig(folder / "rig.toml")))


@pytest.mark.parametrize(("sign", "fine"), [(1.0, True), (0.3, True), (-1.0, False), (-0.3, False)])
def test_a_gripper_that_closes_where_it_should_open_is_found(tmp_path: Path, sign: float, fine: bool) -> None:  # noqa: FBT001
    """By the two values of its log; one that does not reach them is on their side all the same."""

    def act(images: Mapping[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
        del images, instruction
        return np.array([[-0.1, sign if x < 0.6 else -sign] for x in (state[0], state[0] - 0.1)])

    found = {one.name: one for one in examine(gripping(tmp_path), act).findings}["unit"]
    assert ("'grip' has two values in the log, and the answers have the other one in 100%" in found.says) is not fine
    assert fine or found.fine is False


@pytest.mark.parametrize(
    ("name", "amiss", "words"),
    [
        ("not_a_number", {"motions"}, "NaN"),
        ("half", {"motions"}, "its shape is (4, 3), and that of the bank's motions (8, 3): return 8 steps"),
        ("broken", {"motions"}, "KeyError: 'left'"),
        ("raw", {"camera:wrist", "unit"}, "times as large as in the log"),
        ("middle_undeclared", {"cameras", "grey", "instruction", "camera:top", "camera:wrist"}, "changes not one bit"),
        ("deaf_undeclared", {"instruction", "camera:wrist"}, "another instruction changes not one bit"),
        ("queue", {"same"}, "answer from a queue"),
        ("liar", {"same"}, "two answers with one seed"),
        ("still", {"cameras", "grey", "instruction", "state", "camera:top", "camera:wrist", "constant"}, "same answer"),
        ("reach_undeclared", {"camera:wrist"}, "changes not one bit"),
        ("secret", {"instruction"}, "it does not declare to read this, but the answer changes with it"),
        ("nearly_still", {"constant"}, "times as much as the log: it is constant, or nearly so"),
        (
            "broken",
            {"motions"},
            "(its inputs are the pictures top: (32, 32, 3) uint8, wrist: (32, 32, 3) uint8; a state of 3 numbers",
        ),
    ],
)
def test_each_fault_is_named(bank: FrameBank, name: str, amiss: set[str], words: str) -> None:
    """In at most 24 calls; what is sound is said to be."""
    diagnosis = examine_policy(f"python:arms:{name}", bank)
    said = {finding.name: finding for finding in diagnosis.findings}
    assert amiss <= {finding.name for finding in diagnosis.findings if finding.fine is False}
    assert words in " ".join(finding.says for finding in diagnosis.findings if finding.fine is False)
    assert diagnosis.exit_code == 1
    assert diagnosis.calls <= MOST_CALLS
    if name.partition("_")[0] in {"raw", "deaf", "reach", "middle", "still"}:
        assert said["motions"].fine
        assert said["same"].fine


@pytest.mark.parametrize(
    ("name", "check", "fine", "words"),
    [
        ("blue_first", "pictures", False, "with red and blue exchanged its error to the log is"),
        ("upside_down", "pictures", False, "turned by half"),
        ("cameras_exchanged", "pictures", False, "the cameras exchanged"),
        ("reshaped", "pictures", None, "no other form"),
        ("unit_floats", "cameras", None, "divided by 255 twice"),
        ("channels_first", "motions", False, "it fails: ValueError"),
        ("masked", "motions", False, "a masked array hides 1 number"),
        ("objects", "motions", False, "an array of object"),
        ("overflown", "motions", False, "NaN, infinite"),
        ("varies", "motions", False, "its shape is (5, 3), and that of the bank's motions (8, 3)"),
        ("seventh", "motions", False, "CUDA error"),
        ("tokens", "unit", False, "times as large as in the log"),
        ("late_state", "same", False, "it keeps a memory; declare reset"),
        ("late_pictures", "same", False, "it keeps a memory; declare reset"),
        ("tiled", "same", None, "or keeps a memory; for a memory, declare reset"),
        ("cached", "cameras", False, "does the policy repeat an earlier answer?"),
        ("goes_on", "constant", None, "if it needs earlier ones, let it declare history"),
        ("unseeded", "same", False, "two answers with one seed"),
        ("jitters", "same", True, "except for rounding"),
        ("jitters_unseeing", "cameras", False, "another picture changes the answer by no more than rounding"),
        ("one_buffer", "pictures", True, "in this form its error on 2 frames is at most"),
        ("mutates", "pictures", True, "in this form its error"),
        ("limp", "unit", False, "is 'grip' meant to be the same in every answer? It varies in the log"),
        ("with_batch", "motions", False, "return the chunk alone, without the axis of the batch: [0]"),
    ],
)
def test_faults_that_people_ship_are_named(
    bank: FrameBank,
    name: str,
    check: str,
    fine: bool | None,  # noqa: FBT001 - one of the cases
    words: str,
) -> None:
    """By the check that they concern, within 24 calls; what cannot be known is not called a fault."""
    diagnosis = examine_policy(f"python:faulty_arms:{name}", bank)
    (one,) = (finding for finding in diagnosis.findings if finding.name == check)
    assert (one.fine, words in one.says) == (fine, True), one
    assert diagnosis.calls <= MOST_CALLS


def test_a_policy_that_hears_nothing_is_not_told_that_its_colours_are_exchanged(bank: FrameBank) -> None:
    """Red and blue exchanged bring its answer to the log where blue is named, and away from it where red is."""
    (one,) = (finding for finding in examine_policy("python:arms:deaf", bank).findings if finding.name == "pictures")
    assert one.fine is None


@pytest.mark.parametrize("steps", [4, 6])
def test_numbers_are_held_against_moments_of_all_parts_of_an_episode(tmp_path: Path, steps: int) -> None:
    """Were they all of one step, on which the log hardly moves, any other answer would be of another unit."""
    bank = open_bank_simulator("tabletop").build(tmp_path / "bank", steps=steps)
    assert len({frame.step for frame in _ProbeFrames(bank, motion_prompt(bank, None, in_words=False)).further}) == 4
    said = {finding.name: finding for finding in examine_policy("python:arms:deaf", bank).findings}
    assert said["unit"].fine, said["unit"].says
    assert {finding.name: finding for finding in examine_policy("python:arms:raw", bank).findings}["unit"].fine is False


def test_a_sound_policy_has_nothing_amiss(bank: FrameBank) -> None:
    """A trained one that uses all of its channels; one that draws its answers cannot be told by single calls."""
    sound = examine_policy("trained:sees", bank)
    assert {finding.name for finding in sound.findings if finding.fine is not True} == set()
    assert sound.exit_code == 0
    drawn = {finding.name: finding for finding in examine_policy("trained:sampling", bank).findings}
    assert drawn["motions"].fine
    assert drawn["unit"].fine
    assert drawn["cameras"].fine is None
    assert "drawn" in drawn["cameras"].says
    reset = {finding.name: finding.fine for finding in examine_policy("python:arms:reset", bank).findings}
    assert reset["same"]


def test_the_command_prints_it_and_exits_so(bank: FrameBank, tmp_path) -> None:  # noqa: ANN001
    """For people and as JSON; a bank without motions is refused."""
    done = CliRunner().invoke(app, ["doctor", "trained:sees", "--frames", str(bank.root)])
    assert (done.exit_code, "fine        instruction: it reaches the policy" in done.stdout) == (0, True)
    amiss = CliRunner().invoke(app, ["doctor", "python:arms:half", "--frames", str(bank.root), "--json"])
    assert amiss.exit_code == 1
    assert json.loads(amiss.stdout)["findings"][0]["outcome"] == "amiss"
    with pytest.raises(BankError, match="declares no motion"):
        examine_policy("trained:sees", open_bank_simulator("rover").build(tmp_path / "r", seeds=(0,), steps=4))


def test_a_channel_that_it_declares_not_to_read_is_not_amiss(bank: FrameBank) -> None:
    """Nor is a camera of another bank accepted, as a run does not."""
    diagnosis = examine_policy("python:arms:reach", bank)
    said = {finding.name: finding for finding in diagnosis.findings}
    assert (diagnosis.exit_code, said["camera:wrist"].fine) == (0, True)
    assert said["camera:wrist"].says == "it does not declare to read this, and the answer does not change with it"
    assert all(
        finding.fine for finding in examine_policy("python:arms:deaf", bank).findings if finding.name == "instruction"
    )
    with pytest.raises(SpecError, match="declares the channel 'camera:front', and the bank has cameras, camera:top"):
        examine_policy("python:arms:front", bank)


def test_noise_is_not_taken_for_variation(bank: FrameBank, monkeypatch: pytest.MonkeyPatch) -> None:
    """As large as the log's, and at one moment as large as between moments: nobody can say whether it is constant."""
    monkeypatch.setattr("arms.DRAWS", np.random.default_rng(1))
    said = {finding.name: finding for finding in examine_policy("python:arms:trembling", bank).findings}
    assert said["constant"].fine is None
    assert "noise hides whether it is constant" in said["constant"].says


def test_a_camera_whose_pictures_are_all_alike_is_not_amiss(tmp_path: Path) -> None:
    """What cannot be exchanged is said to be so."""
    still = arm_bank(tmp_path / "arm", side="still")
    said = {finding.name: finding for finding in examine_policy("python:arm_logs:by_front", still).findings}
    assert said["camera:front"].fine
    assert (said["camera:side"].fine, "the same in every other episode" in said["camera:side"].says) == (None, True)


def test_it_is_asked_where_an_event_loop_runs_already(bank: FrameBank) -> None:
    """As in a notebook."""

    async def cell() -> PolicyDiagnosis:
        return examine_policy("trained:sees", bank)

    assert asyncio.run(cell()) == examine_policy("trained:sees", bank)


@pytest.mark.parametrize(
    ("name", "calls"), [("arms:broken", 3), ("faulty_arms:with_batch", 3), ("arms:not_a_number", 3)]
)
def test_calls_that_fail_alike_end_it(bank: FrameBank, name: str, calls: int) -> None:
    """Each may load a network for half a minute; how many were made is said."""
    told: list[int] = []
    diagnosis = examine_policy(f"python:{name}", bank, tell=told.append)
    assert (diagnosis.calls, told) == (calls, [1, 2, 3])
    (one,) = diagnosis.findings
    assert one.says.startswith("3 of 3 calls hold no motion: ")
    assert one.says.endswith("No more were made: the last 3 failed in the same way")
    assert str(diagnosis).endswith("asked: 3 calls")


def test_errors_alike_are_so_but_for_numbers_and_those_between_motions_end_nothing(bank: FrameBank) -> None:
    """An address or a count stands in many a text; what fails now and then is asked to the end."""
    assert examine_policy("python:faulty_arms:counts_failures", bank).calls == 3
    assert examine_policy("python:faulty_arms:seventh", bank).calls > 10


def test_a_policy_that_fails_in_the_middle_is_judged_by_what_came(bank: FrameBank) -> None:
    """And what was not asked is said to be so."""
    diagnosis = examine_policy("python:faulty_arms:sixth_on", bank)
    said = {finding.name: finding for finding in diagnosis.findings}
    assert (diagnosis.calls, said["cameras"].fine, said["motions"].fine) == (8, True, False)
    assert (said["camera:wrist"].fine, said["camera:wrist"].says) == (None, "the call was not made")


@pytest.mark.parametrize(
    ("name", "fine", "words"),
    [
        ("arms:reach_undeclared", False, "If the policy is not meant to read it, declare its channels"),
        ("arms:reach_all_cameras", None, "is it meant to be read? It declares 'cameras', which means all"),
        ("arms:reach_wrist_too", False, "another picture changes not one bit of the answer"),
        ("arms:reach", True, "it does not declare to read this, and the answer does not change with it"),
    ],
)
def test_cameras_stand_for_all_of_them_together(
    bank: FrameBank,
    name: str,
    fine: bool | None,  # noqa: FBT001 - one of the cases
    words: str,
) -> None:
    """A camera that does not reach it is no fault of who declares all, as in the verdict; of who names it, it is."""
    said = {finding.name: finding for finding in examine_policy(f"python:{name}", bank).findings}
    assert (said["camera:wrist"].fine, words in said["camera:wrist"].says) == (fine, True), said["camera:wrist"]
    assert said["cameras"].fine


def test_a_picture_that_matters_in_some_frames_only_is_found_by_further_ones(bank: FrameBank) -> None:
    """The first frame may be one of those where it does not; and what is silent says in how many it was tried."""
    first = np.array(flat_state(bank.frames[0].state))

    def act(images: Mapping[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
        del instruction
        seen = 0.0 if np.allclose(state, first) else float(images["top"].astype(float).sum()) % 7.0
        return np.full((8, 3), seen) + state.mean()

    said = {finding.name: finding for finding in examine(bank, act).findings}
    assert said["cameras"].fine, said["cameras"]
    assert said["camera:top"].fine
    reach = {finding.name: finding for finding in examine_policy("python:arms:reach_undeclared", bank).findings}
    tried = re.search(r"not one bit of the answer, in (\d) frames that were tried", reach["camera:wrist"].says)
    assert tried is not None
    assert int(tried[1]) > 1


def test_a_camera_that_reaches_nobody_is_amiss_though_all_are_declared(bank: FrameBank) -> None:
    """Where no other one reaches the policy either."""
    said = {finding.name: finding for finding in examine_policy("python:arms:middle_all_cameras", bank).findings}
    assert not any(said[name].fine for name in ("cameras", "camera:top", "camera:wrist"))


def test_what_takes_long_says_how_far_it_is(bank: FrameBank, monkeypatch: pytest.MonkeyPatch) -> None:
    """On standard error; what is quick says nothing."""
    monkeypatch.setattr("eyechart.cli.probe.patience", partial(patience, every_s=0.2))
    slow = CliRunner().invoke(app, ["doctor", "python:faulty_arms:slow_failure", "--frames", str(bank.root), "--json"])
    assert re.search(rf"doctor: call \d of at most {MOST_CALLS}", slow.stderr)
    assert json.loads(slow.stdout)["calls"] == 3
    monkeypatch.setattr("eyechart.cli.probe.patience", partial(patience, every_s=600))
    quick = CliRunner().invoke(app, ["doctor", "python:arms:broken", "--frames", str(bank.root)])
    assert quick.stderr == ""
