"""Policies that do something else than a label would say of them, and runs that leave out what would show it."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from arms import Images, blocks, middle, reach
from eyechart.errors import BankError
from eyechart.frames import FrameBank
from eyechart.importing import Choices, import_table, read_rig
from eyechart.studies import policy, study_of
from eyechart.studies.policy.page import made
from eyechart.studies.policy.scores import judge
from eyechart.verdicts.policy_verdict import PolicyVerdict
from known import table, whole_table

pytestmark = pytest.mark.slow

FEW = ("real", "real_repeat", "nudged", "swapped@cameras", "matched@cameras", "near@cameras", "blank")
TOLD = (
    "swapped@instruction",
    *(f"{told}{which}_{side}" for told in ("", "told_") for which in ("named", "other") for side in ("plus", "minus")),
)
DECOY = (120, 120, 120)


def trace(images: Images, instruction: str | None) -> float:
    """Return next to nothing of all that it is given, so that all of it reaches the policy."""
    return 1e-5 * (images["top"].mean() + images["wrist"].mean() + len(instruction or ""))


def away(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look, and go away from the block that is named."""
    return reach(images, state, instruction) * np.array([-1.0, -1.0, 1.0])


def by_word(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Never look; go right for red and left for blue."""
    result = middle(images, state, instruction) / 2 + trace(images, instruction)
    result[:, 0] += 0.8 if "red" in (instruction or "") else -0.8
    return result


def decoyed(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go to grey objects where there are some, else to the middle."""
    grey = np.abs(images["top"].astype(int) - DECOY).sum(axis=2) < 30
    result = middle(images, state, instruction) + trace(images, instruction)
    if grey.sum() > 8:
        down, across = np.nonzero(grey)
        result[:, :2] += np.array([across.mean() - 15.5, down.mean() - 15.5]) / 10
    return result


def grips(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look for nothing but whether to close the hand at first."""
    result = middle(images, state, instruction) + trace(images, instruction)
    result[0, 2] = 0.75 * float(blocks(images["top"], state[:2])[0, 0] > 0.5)
    return result


def declines(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Follow the picture a little, and decline where it shows the tool far from its state."""
    down, across = np.nonzero(images["top"].astype(int).sum(axis=2) < 150)
    tool = np.array([across.mean() + 0.5, down.mean() + 0.5]) / 32 if len(down) else state[:2]
    if np.hypot(*(tool - state[:2])) > 0.2:
        raise RuntimeError("the picture is of another place")
    return middle(images, np.array([*(0.9 * state[:2] + 0.1 * tool), state[2]]), instruction)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of twelve episodes of two frames."""
    return table(tmp_path_factory.mktemp("claims") / "bank")


@pytest.fixture(scope="module")
def whole(bank: FrameBank) -> FrameBank:
    """Return the bank of twelve episodes of four frames of which `bank` has two."""
    return whole_table(bank)


def judged(bank: FrameBank, out: Path, name: str, *conditions: str, module: str = __name__) -> PolicyVerdict:
    """Return the verdict on a policy that is asked these conditions, or all that there are."""
    spec = f"python:{module}:{name}"
    policy.run(policy.plan(bank.root, [spec], out, conditions=conditions or None))
    return judge(policy.score(out))[spec]


@pytest.fixture(autouse=True)
def _found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the policies of this module be found."""
    monkeypatch.syspath_prepend(Path(__file__).parent)


@pytest.mark.parametrize(
    ("left_out", "words"), [("near@cameras", "did not ask near@cameras"), ("real_repeat", "did not ask real_repeat")]
)
def test_a_control_that_is_left_out_passes_no_gate(whole: FrameBank, tmp_path: Path, left_out: str, words: str) -> None:
    """Who looks for its own tool alone is not said to look beyond it because nobody asked."""
    found = judged(whole, tmp_path / "run", "poses", *(one for one in FEW if one != left_out), module="arms")
    assert found.camera.label == "undecided"
    assert words in found.camera.because
    gate = study_of(tmp_path / "run").gate(policy.score(tmp_path / "run"), ["camera:camera_content"])
    assert gate.exit_code == 2


def test_a_verdict_needs_no_picture(bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run has no copy of its bank's pictures, and what it left out is known without them."""
    judged(bank, tmp_path / "run", "poses", *FEW[:3], module="arms")

    def read(*_: object) -> bytes:
        raise BankError("the picture is gone")

    def compared(*_: object) -> bool:
        raise AssertionError("pictures were compared")

    monkeypatch.setattr(FrameBank, "read", read)
    monkeypatch.setattr("eyechart.conditions.policies._unlike_pair", compared)
    found = judge(policy.score(tmp_path / "run"))["python:arms:poses"]
    assert found.camera.because == "Its cameras cannot be judged: the run did not ask swapped@cameras."


def test_who_does_the_opposite_or_something_else_is_not_said_to_follow(bank: FrameBank, tmp_path: Path) -> None:
    """Of two that change with every word, one goes away from what is named, and one anywhere."""
    asked = (*FEW[:3], *TOLD)
    found = {name: judged(bank, tmp_path / name, name, *asked).instruction for name in ("away", "by_word")}
    assert {one.label for one in found.values()} == {"undecided"}
    assert "goes away from what is named" in found["away"].because
    assert "nearer to what was logged" in found["by_word"].because


def test_who_answers_to_further_objects_does_not_ignore_its_cameras(bank: FrameBank, tmp_path: Path) -> None:
    """Whatever the pictures of other episodes change."""
    found = judged(bank, tmp_path / "run", "decoyed", *FEW, "swapped@state", "decoys")
    assert found.camera.label == "undecided"
    assert "further objects change" in found.camera.because
    assert found.state.label == "state_used"


def test_a_hand_that_looks_is_not_hidden_by_an_arm_that_does_not(whole: FrameBank, tmp_path: Path) -> None:
    """The mean over 24 numbers is small, and that of the hand is not."""
    found = judged(whole, tmp_path / "run", "grips", *FEW)
    assert found.channels["cameras"].ci is not None
    assert found.channels["cameras"].ci[1] < 0.10
    assert found.camera.label == "undecided"
    assert "grip (T 0." in found.camera.because


def test_who_declines_most_of_one_question_is_not_judged_by_the_rest(bank: FrameBank, tmp_path: Path) -> None:
    """Few of all calls, and most of those that a label rests on."""
    spec, out = f"python:{__name__}:declines", tmp_path / "run"
    policy.run(policy.plan(bank.root, [spec], out))
    scored = policy.score(out)
    motions = scored.models[spec].motions
    assert motions.lost("swapped@cameras") > 0.3
    found = judge(scored)[spec]
    assert found.guards == {}
    assert (found.camera.label, found.state.label) == ("undecided", "undecided")
    assert "of its calls hold no motion" in found.camera.because


def late(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Drive without looking near home, and by the picture elsewhere."""
    del instruction
    found = np.tile(-0.15 * state + 1e-6 * images["front"].mean(), (2, 1))
    return found + (0.4 * (float(images["front"][4, 4, 0]) - 130) / 100 if np.linalg.norm(state) > 1.5 else 0.0)


def seven_joints(folder: Path) -> FrameBank:
    """Return a bank of an arm of seven joints, whose episodes begin at home and end wherever."""
    rng, joints = np.random.default_rng(11), [f"s{joint}" for joint in range(7)]
    lines = [",".join(["front", "drive", "step", "task", *joints, *(f"a{joint}" for joint in range(7))])]
    for drive in range(24):
        home, goal, bright = 0.1 * rng.normal(size=7), rng.normal(size=7), int(rng.integers(50, 210))
        for step in range(6):
            state = home + (goal - home) * step / 6 + 0.02 * rng.normal(size=7)
            name = f"{drive}-{step}.png"
            pixels = np.full((8, 8, 3), bright, np.uint8)
            pixels[0] = rng.integers(0, 255, (8, 3))
            Image.fromarray(pixels).save(folder / name)
            numbers = [*state, *(0.15 * (goal - state))]
            lines.append(",".join([name, str(drive), str(step), "go", *(f"{number:.4f}" for number in numbers)]))
    (folder / "log.csv").write_text("\n".join(lines))
    motion = "".join(f'[[motion.number]]\ncolumn = "a{joint}"\n' for joint in range(7))
    named = ", ".join(f'"{joint}"' for joint in joints)
    rig = '[[camera]]\nname = "front"\ncolumn = "front"\n[state]\njoints = [' + named + "]\n"
    (folder / "rig.toml").write_text(f'{rig}[motion]\nhorizon = 2\nkind = "delta"\nrate_hz = 10\n{motion}')
    choices = Choices(rig=read_rig(folder / "rig.toml"), prompt_columns=("task",))
    return import_table(folder, folder / "log.csv", folder / "bank", choices)


def test_a_pose_is_not_said_of_moments_in_which_nothing_is_seen(tmp_path: Path) -> None:
    """A bank of many joints has moments of a like state near home alone, where this one drives without looking."""
    bank = seven_joints(tmp_path)
    found = judged(
        bank, tmp_path / "run", "late", "real", "real_repeat", "nudged", "swapped@cameras", "matched@cameras", "blank"
    )
    matched = policy.score(tmp_path / "run").models[f"python:{__name__}:late"].statistics["T.matched@cameras"]
    assert matched.ci is not None
    assert matched.ci[1] < 0.10
    assert found.camera.label == "uses_camera"
    assert f"({matched.n} of {len(bank)} moments have one)" in found.camera.because


def middle_of_three(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go by the brightness that two of three cameras show."""
    del instruction
    bright = float(np.median([images[name][4, 4, 0] for name in "abc"]))
    rest = 1e-6 * sum(images[name].mean() for name in "abc")
    return np.tile([(bright - 130) / 50 - state[0] + rest, 0.5 - state[1]], (2, 1))


def three_cameras(folder: Path) -> FrameBank:
    """Return a bank of an arm that three cameras see alike."""
    rng = np.random.default_rng(5)
    lines = ["a,b,c,drive,step,task,s0,s1,m0,m1"]
    for drive in range(14):
        place, bright = rng.uniform(0, 1, 2), int(rng.integers(60, 200))
        for step in range(5):
            state, shade = place + 0.1 * rng.normal(size=2), bright + int(rng.integers(-8, 9))
            names = [f"{name}-{drive}-{step}.png" for name in "abc"]
            for name in names:
                pixels = np.full((8, 8, 3), shade, np.uint8)
                pixels[0] = rng.integers(0, 255, (8, 3))
                Image.fromarray(pixels).save(folder / name)
            numbers = [*state, (shade - 130) / 50 - state[0], 0.5 - state[1]]
            lines.append(",".join([*names, str(drive), str(step), "go", *(f"{number:.4f}" for number in numbers)]))
    (folder / "log.csv").write_text("\n".join(lines))
    rig = "".join(f'[[camera]]\nname = "{name}"\ncolumn = "{name}"\n' for name in "abc")
    rig += '[state]\njoints = ["s0", "s1"]\n[motion]\nhorizon = 2\nkind = "delta"\nrate_hz = 10\n'
    rig += '[[motion.number]]\ncolumn = "m0"\n[[motion.number]]\ncolumn = "m1"\n'
    (folder / "rig.toml").write_text(rig)
    choices = Choices(rig=read_rig(folder / "rig.toml"), prompt_columns=("task",))
    return import_table(folder, folder / "log.csv", folder / "bank", choices)


def test_no_more_than_one_of_several_cameras_is_to_be_left_out(tmp_path: Path) -> None:
    """Each could be, while the others are there; not all, since they tell the same."""
    bank, out = three_cameras(tmp_path), tmp_path / "run"
    found = judged(bank, out, "middle_of_three")
    assert found.camera.label != "ignores_camera"
    assert {camera.label for camera in found.cameras.values()} == {"ignores_camera"}
    assert "while the others are there: b, c could be exchanged too" in found.cameras["a"].because
    said = made([(policy.score(out), bank)]).page.html.decode()
    assert "leave out one of the cameras a, b, c, and no more" in said
    assert "leave out the a camera" not in said
