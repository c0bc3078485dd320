"""Failures that belong to pictures that no camera took are said by their name, and count against nothing else."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from arm_logs import arm_bank, by_front
from eyechart.frames import FrameBank
from eyechart.probe.policies import examine_policy
from eyechart.studies import policy
from eyechart.studies.policy.advice import settling
from eyechart.studies.policy.scores import PolicyScore, judge, judged_json
from eyechart.verdicts.policy_verdict import PolicyVerdict

Images = Mapping[str, np.ndarray]


def detector(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Do as the log does, behind a detector that finds nothing in a picture of one colour."""
    if np.ptp(images["front"].reshape(-1, 3), axis=0).max() == 0:
        raise ValueError("no object found")
    return by_front(images, state, instruction)


def of_known_scenes(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Do as the log does, and find nothing in noise either."""
    if np.ptp(images["front"][:, :4].reshape(-1, 3), axis=0).max() > 9:
        raise ValueError("no object found")
    return detector(images, state, instruction)


def sleepy(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Do as the log does, but at every seventh state, whatever it is shown."""
    if int(abs(state[0]) * 1000) % 7 == 0:
        raise ValueError("asleep")
    return by_front(images, state, instruction)


def blind(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go by the state alone, behind the detector."""
    detector(images, state, instruction)
    return np.stack([-0.3 * state] * 2)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of sixteen episodes of an arm."""
    return arm_bank(tmp_path_factory.mktemp("failures") / "arm", tasks=("go",), length=8, episodes=16)


def scored(bank: FrameBank, out: Path, name: str) -> tuple[PolicyScore, PolicyVerdict]:
    """Return the score of a run of a policy of this file, and the verdict."""
    spec = f"python:{__name__}:{name}"
    policy.run(policy.plan(bank.root, [spec], out))
    score = policy.score(out)
    return score, judge(score)[spec]


@pytest.mark.parametrize(
    ("name", "failing"), [("detector", ("blank",)), ("of_known_scenes", ("blank", "noise"))], ids=["grey", "both"]
)
def test_who_fails_on_computed_pictures_alone_is_judged_by_its_other_answers(
    bank: FrameBank, tmp_path: Path, name: str, failing: tuple[str, ...]
) -> None:
    """It plainly looks: no guard fails, the failures are said by their name, and their shares are unknown."""
    score, found = scored(bank, tmp_path / "run", name)
    assert found.guards == {}
    assert found.answer == "Yes"
    remark = next(one for one in found.remarks if one.startswith("It fails on "))
    (one,) = score.models.values()
    for condition in ("blank", "noise"):
        statistic, words = (
            one.statistics[f"T.{condition}"],
            f"it fails on {len(bank)} of {len(bank)} {condition} pictures",
        )
        assert (statistic.value is None) is (condition in failing)
        assert (statistic.note == words) is (condition in failing)
        assert (words[len("it fails ") :] in remark) is (condition == "blank")
    assert ("on 2 kinds of computed pictures" in remark) is (len(failing) == 2)
    assert one.statistics["motions"].value == 1.0
    assert one.statistics["motions"].n == one.motions.finished - len(failing) * len(bank)
    assert one.motions.missing == {"error": len(failing) * len(bank)}
    assert any(remark in said["remarks"] for said in json.loads(json.dumps(judged_json(score))).values())


def test_failures_over_all_conditions_are_those_of_the_policy(bank: FrameBank, tmp_path: Path) -> None:
    """More than a tenth of the calls on pictures of a camera hold no motion: nothing else is said."""
    score, found = scored(bank, tmp_path / "run", "sleepy")
    (one,) = score.models.values()
    motions = one.statistics["motions"].value
    assert motions is not None
    assert 0.5 < motions < 0.9
    assert list(found.guards) == ["not_scorable"]
    assert "error" in found.guards["not_scorable"]
    assert one.motions.fails_on
    assert not any("computed pictures" in remark for remark in found.remarks)


def test_no_absence_rests_on_pictures_that_it_fails_on(bank: FrameBank, tmp_path: Path) -> None:
    """Another episode's pictures change nothing, and grey ones make it fail: that it ignores them is not said."""
    score, found = scored(bank, tmp_path / "run", "blind")
    advice = str(settling(score, found.model, "cameras"))
    assert advice == "let it return a motion on blank pictures too: what it does where it finds nothing."
    assert found.guards == {}
    assert found.camera.label == "undecided"
    words = f"whether a picture must be there is open: it fails on {len(bank)} of {len(bank)} blank pictures"
    assert words in found.camera.because
    assert found.state.label == "state_used"


def test_the_doctor_finds_no_fault_in_a_policy_that_fails_on_grey_alone(bank: FrameBank) -> None:
    """All other calls return a motion; of the grey one it says that there is none."""
    found = {one.name: one for one in examine_policy(f"python:{__name__}:detector", bank).findings}
    assert found["motions"].fine is True
    assert found["grey"].fine is None
    assert found["grey"].says == "no motion: error. A run judges it by its other answers"
    sleeping = {one.name: one for one in examine_policy(f"python:{__name__}:sleepy", bank).findings}
    assert sleeping["motions"].fine is False
