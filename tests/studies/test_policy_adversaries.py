"""Policies that were written to get a label which is untrue of them, and what is said of them now."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_logs import arm_bank
from arms import Images, blocks
from eyechart.frames import FrameBank
from eyechart.simulators.tabletop.world import Workspace, oracle
from eyechart.studies import policy
from eyechart.studies.policy import PolicySelection
from eyechart.studies.policy.effects import Effects
from eyechart.studies.policy.scores import judge
from eyechart.verdicts.policy_verdict import PolicyVerdict
from known import table, whole_table

pytestmark = pytest.mark.slow

MIDDLE = np.full(2, 0.5)


def trace(images: Images, state: np.ndarray, instruction: str | None) -> float:
    """Return next to nothing of all that it is given, so that all of it reaches the policy."""
    seen = sum(float(image.astype(float).mean()) for image in images.values())
    return 1e-7 * (seen + 10 * float(np.sum(state)) + 7.3 * len(instruction or ""))


def going(state: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return the motion to a place."""
    return oracle(Workspace(state[:2], float(state[2]), np.stack([place, place]), "red"))


def drifting(state: np.ndarray) -> np.ndarray:
    """Return a motion by the state alone, to the middle."""
    result = np.zeros((8, 3))
    result[:, :2], result[:, 2] = 2.0 * (MIDDLE - state[:2]), 0.6 * state[2]
    return result


def named_first(images: Images, state: np.ndarray, instruction: str | None) -> tuple[np.ndarray, np.ndarray]:
    """Return where the block that is named is seen from above, and the other."""
    red, blue = blocks(images["top"], state[:2])
    return (red, blue) if "red" in (instruction or "red") else (blue, red)


def between(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go between both blocks, a little nearer to the one that is named, and reach neither."""
    named, other = named_first(images, state, instruction)
    return going(state, 0.52 * named + 0.48 * other) + trace(images, state, instruction)


def beside(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go 65 degrees beside the way to the block that is named."""
    found = going(state, named_first(images, state, instruction)[0])
    cos, sin = np.cos(np.radians(65)), np.sin(np.radians(65))
    found[:, :2] = found[:, :2] @ np.array([[cos, sin], [-sin, cos]])
    return found + trace(images, state, instruction)


def one_of_two(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go to the red block if told so, and between both if told to go to the blue one."""
    named, other = named_first(images, state, instruction)
    place = named if "red" in (instruction or "") else (named + other) / 2
    return going(state, place) + trace(images, state, instruction)


def on_the_left(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go to the red block if told so, and to the blue one where it lies on the left; else between both."""
    named, other = named_first(images, state, instruction)
    goes = "red" in (instruction or "") or named[0] < MIDDLE[0]
    return going(state, named if goes else (named + other) / 2) + trace(images, state, instruction)


def along_y(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go to the block that is named along y, and a fifth of the way along x."""
    named = named_first(images, state, instruction)[0]
    place = np.array([MIDDLE[0] + 0.2 * (named[0] - MIDDLE[0]), named[1]])
    return going(state, place) + trace(images, state, instruction)


def swings(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Swing to a side by the word, and go next to nothing of the way to what is named."""
    found = drifting(state)
    found[:, 1] += 0.45 if "red" in (instruction or "") else -0.45
    toward = going(state, named_first(images, state, instruction)[0])
    return found + 0.03 * toward + trace(images, state, instruction)


def half_of_its_seeds(images: Images, state: np.ndarray, instruction: str | None, *, seed: int) -> np.ndarray:
    """Look, or not, as the seed says."""
    found = drifting(state)
    if seed % 2:
        found[:, :2] += 1.2 * (named_first(images, state, instruction)[0] - MIDDLE)
    return found + trace(images, state, instruction)


half_of_its_seeds.seedable = True  # type: ignore[attr-defined]
DRAWN = np.random.default_rng(1)


def trembles(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Do the same on average, and tremble where the picture does not fit the state."""
    down, across = np.nonzero(images["top"].astype(int).sum(axis=2) < 200)
    tool = np.array([across.mean() + 0.5, down.mean() + 0.5]) / 32 if len(down) > 1 else MIDDLE
    found = drifting(state) + trace(images, state, instruction)
    return found + 0.5 * DRAWN.normal(size=(8, 3)) * float(np.hypot(*(tool - state[:2])) > 0.03)


BEFORE = [0.0]
WAVE = np.array([1, -1] * 4)


def late_wave(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Act on the picture of the call before, in a wave whose mean over the horizon is 0."""
    found = drifting(state)
    found[:, 1] += 0.55 * BEFORE[0] * WAVE
    BEFORE[0] = float(np.sign(blocks(images["top"], state[:2])[0, 0] - 0.5))
    return found + trace(images, state, instruction)


KEPT: dict[Any, np.ndarray] = {}


def by_its_bytes(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Draw an answer without looking, and keep it for the same input."""
    key = (*(image.tobytes() for image in images.values()), state.tobytes(), instruction)
    if key not in KEPT:
        KEPT[key] = drifting(state) + np.array([1, 1, 0]) * 0.6 * DRAWN.normal(size=3)
    return KEPT[key]


def places(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer with places that the picture alone tells."""
    del state
    shown = float(images["front"].mean()) / 255
    return np.tile([shown, 1 - shown], (2, 1)) + 1e-7 * len(instruction or "")


def unplugged(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Do so, and declare that the state is not read."""
    return places(images, state, instruction)


unplugged.channels = ("cameras", "instruction")  # type: ignore[attr-defined]


def carried(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer with its own place, and a step by the word."""
    step = 0.5 if instruction == "go" else -0.5
    return np.tile(state[:2] + step, (2, 1)) + 1e-7 * float(images["front"].mean())


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of twelve episodes of two frames."""
    return table(tmp_path_factory.mktemp("adversaries") / "bank")


@pytest.fixture(scope="module")
def whole(bank: FrameBank) -> FrameBank:
    """Return the bank of twelve episodes of four frames of which `bank` has two."""
    return whole_table(bank)


@pytest.fixture(autouse=True)
def _found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the policies of this module be found."""
    monkeypatch.syspath_prepend(Path(__file__).parent)


def judged(bank: FrameBank, out: Path, name: str, seed: int = 0, answers: int = 2) -> PolicyVerdict:
    """Return the verdict on a policy that is asked all that there is, twice where it draws its answers."""
    spec = f"python:{__name__}:{name}"
    policy.run(policy.plan(bank.root, [spec], out, seed=seed, extent=PolicySelection(answers=answers)))
    return judge(policy.score(out))[spec]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("between", "because it is named is not shown"),
        ("beside", "degrees off that of the moved object"),
        ("one_of_two", "told 'reach the blue block' it is followed only"),
        ("on_the_left", "told 'reach the blue block' it is followed only"),
        ("along_y", "along x it is followed only"),
    ],
)
def test_who_does_not_go_to_what_is_named_is_not_grounded(
    bank: FrameBank, tmp_path: Path, name: str, words: str
) -> None:
    """Between both, or past it: the picture decides, and no more is said."""
    found = judged(bank, tmp_path / "run", name)
    assert found.camera.label == "camera_content"
    assert words in found.camera.why_not


def test_a_word_that_swings_the_arm_is_not_followed(bank: FrameBank, tmp_path: Path) -> None:
    """It goes 3 % of the way to what is named, and its cameras are ignored."""
    found = judged(bank, tmp_path / "run", "swings")
    assert (found.camera.label, found.instruction.label) == ("ignores_camera", "undecided")
    assert "(most often 'reach the " in found.instruction.because
    assert "only 3.0 %" in found.instruction.because


def test_nothing_is_absent_at_one_seed_that_another_changes(bank: FrameBank, tmp_path: Path) -> None:
    """Whichever seed a run has; the remark says that all is of one seed."""
    labels = set()
    for seed in range(3):
        found = judged(bank, tmp_path / f"run-{seed}", "half_of_its_seeds", seed)
        labels.add(found.camera.label)
        if found.camera.label == "undecided":
            assert "that is at one seed, and another seed changes" in found.camera.because
        differ = any("All is said of its answers at one seed" in remark for remark in found.remarks)
        assert differ == (policy.score(tmp_path / f"run-{seed}").models[found.model].statistics["noise"].value > 0.02)
    assert "undecided" in labels


def test_a_camera_that_decides_how_answers_scatter_is_not_ignored(whole: FrameBank, tmp_path: Path) -> None:
    """Though no mean changes with it."""
    found = judged(whole, tmp_path / "run", "trembles", answers=4)
    assert (found.camera.label, found.state.label) == ("undecided", "state_used")
    assert "how its answers scatter changes" in found.camera.because


@pytest.mark.parametrize(
    ("name", "words"), [("late_wave", "goes with the call before"), ("by_its_bytes", "one value of its pictures")]
)
def test_who_remembers_or_answers_by_bytes_is_inconsistent(
    whole: FrameBank, tmp_path: Path, name: str, words: str
) -> None:
    """A wave along the horizon, and a cache of whole inputs."""
    assert words in judged(whole, tmp_path / "run", name).guards["self_inconsistent"]


def test_places_are_said_of_the_state_as_they_are(tmp_path: Path) -> None:
    """One that never gets its state ignores it, declared or not, and one that goes along with it does not."""
    bank = arm_bank(tmp_path / "arm", episodes=12, kind="absolute")
    names = ("places", "unplugged", "carried")
    free, declared, along = (judged(bank, tmp_path / name, name).state for name in names)
    assert (free.label, along.label) == ("ignores_state", "undecided")
    assert (declared.label, declared.by) == ("ignores_state", "reads@state")
    assert declared.responds is not None
    assert declared.responds.value == 0
    assert "changes not one bit" in free.because
    assert "changes not one bit" not in declared.because
    assert "places that go along with it" in along.because


def test_an_instruction_that_changes_anything_is_held_against_the_log(tmp_path: Path) -> None:
    """Where nothing is moved."""
    bank = arm_bank(tmp_path / "arm", episodes=12, kind="absolute")
    found = judged(bank, tmp_path / "run", "carried").instruction
    assert found.label in {"undecided", "instruction_followed"}
    assert "what was logged" in found.because


def test_a_part_of_few_episodes_is_held_to_what_it_may_be_at_most(bank: FrameBank, tmp_path: Path) -> None:
    """Of six episodes to what it is; wordings that differ in signs alone are one part."""
    spec = f"python:{__name__}:on_the_left"
    policy.run(policy.plan(bank.root, [spec], tmp_path / "run"))
    motions = policy.score(tmp_path / "run").models[spec].motions
    effects = Effects(motions, drawn=False)
    gains, full, episodes = np.array([1.0, 1, 1, 0, 0, 0, 1, 1]), np.ones(8), np.array([0, 0, 1, 1, 2, 2, 2, 2])
    few, many = effects._part(gains, full, episodes), effects._part(gains, full, np.arange(8))
    assert few["value"] == many["value"] == many["at_most"] == 5 / 8
    assert few["at_most"] > 1.5
    assert effects._part(gains, full, np.zeros(8, dtype=int)) is None
    frames = tuple(
        replace(frame, fields={name: f"{text.upper()}!" if number % 2 else text for name, text in frame.fields.items()})
        for number, frame in enumerate(motions.plan.frames)
    )
    effects = Effects(replace(motions, plan=replace(motions.plan, frames=frames)), drawn=False)
    parts = effects.follow(("named", "other")).parts
    assert {name.casefold().replace("!", "") for name in parts} == {
        "told 'reach the blue block'",
        "told 'reach the red block'",
        "along x",
        "along y",
    }
    assert len(parts) == 4
    assert all(part["episodes"] >= 6 for part in parts.values())
