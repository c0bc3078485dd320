"""Policies that are no models: what each decides, and on what its decision may depend."""

import pickle
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NoReturn

import pytest

from eyechart.errors import SpecError
from eyechart.frames import RGB, Scalar
from eyechart.policies import REFERENCES, Observation, is_policy, open_policy
from eyechart.simulators import open_simulator
from eyechart.spaces.discrete import DRIVING, Discrete

GO = Discrete("go", ("STOP", "GO"), (), ("STOP",), ("GO",))
SEEN: Mapping[str, Scalar] = {"demand": "STRAIGHT", "left_clear": True, "right_clear": True}


def recorded(run: Path) -> Mapping[str, int]:
    """Stand for the reader of runs: three decisions in four are LEFT."""
    return {"crazy": {"JUMP": 1}, "empty": {}}.get(run.name, {"LEFT": 300, "STOP": 100})


def unseen() -> NoReturn:
    """Fail where a policy that must not look asks for the picture."""
    raise AssertionError("this policy looked")


def decide(
    spec: str, *, seed: int = 1, truth: Mapping[str, Scalar] = SEEN, picture: Callable[[], RGB | None] = unseen
) -> str | None:
    """Return what a policy that went to another process decides."""
    policy = pickle.loads(pickle.dumps(open_policy(spec, DRIVING, recorded)))  # noqa: S301 - our own bytes
    action: str | None = policy.decide(Observation("w/0/000", 0, picture, truth, DRIVING, seed)).action
    return action


@pytest.mark.parametrize("spec", ["constant:RIGHT", "random", "marginal:run", "oracle"])
def test_a_policy_without_eyes_asks_for_no_picture_and_repeats_itself(spec: str) -> None:
    """Its decision is a function of the moment."""
    assert decide(spec) == decide(spec) in DRIVING.actions


def test_random_draws_alike_and_a_marginal_draws_like_the_run() -> None:
    """400 moments, each with a seed of its own."""
    uniform = Counter(decide("random", seed=seed) for seed in range(400))
    marginal = Counter(decide("marginal:run", seed=seed) for seed in range(400))
    assert set(uniform) == set(DRIVING.actions)
    assert min(uniform.values()) > 50
    assert set(marginal) == {"LEFT", "STOP"}
    assert marginal["LEFT"] == pytest.approx(300, abs=30)


@pytest.mark.parametrize(
    ("demand", "left", "right", "action"),
    [
        ("STRAIGHT", False, False, "STRAIGHT"),
        ("SLOW", True, True, "LEFT"),
        ("STOP", False, True, "RIGHT"),
        ("STOP", False, False, "SLOW"),
    ],
)
def test_the_oracle_goes_on_or_passes_or_slows(demand: str, left: bool, right: bool, action: str) -> None:  # noqa: FBT001
    """Table t:baselines: STRAIGHT where the road is free, else LEFT or RIGHT if clear, else SLOW."""
    assert decide("oracle", truth={"demand": demand, "left_clear": left, "right_clear": right}) == action


def test_the_positive_control_does_by_its_eyes_what_the_truth_demands() -> None:
    """On a drive, moment by moment; where it is shown nothing it decides nothing."""
    drive = open_simulator("highway").drive("blocked", 0)
    agree = []
    for _ in range(8):
        agree.append(decide("positive_control", picture=drive.picture) == drive.truth()["demand"])
        drive.step("SLOW")
    assert agree.count(True) >= 7
    assert decide("positive_control", picture=lambda: None) is None


@pytest.mark.parametrize(
    ("spec", "space", "words"),
    [
        ("pilot", DRIVING, "unknown policy 'pilot'; known are constant, random, marginal, oracle"),
        ("constant:JUMP", DRIVING, "one of STOP, SLOW, STRAIGHT, LEFT, RIGHT"),
        ("random:2", DRIVING, "takes nothing after its name"),
        ("marginal:", DRIVING, "the folder of a run"),
        ("marginal:crazy", DRIVING, "other than STOP, SLOW, STRAIGHT, LEFT, RIGHT: JUMP"),
        ("marginal:empty", DRIVING, "no decision"),
        ("oracle", GO, "drives with SLOW, STRAIGHT, LEFT, RIGHT"),
    ],
)
def test_a_spec_that_cannot_be_is_refused_in_words(spec: str, space: Discrete, words: str) -> None:
    """Before anything drives."""
    with pytest.raises(SpecError, match=words):
        open_policy(spec, space, recorded)


def test_an_oracle_without_a_scene_says_what_is_missing() -> None:
    """As in an environment of somebody else's."""
    with pytest.raises(SpecError, match="needs a simulator that tells demand"):
        decide("oracle", truth={"reward": 1.0})
    with pytest.raises(SpecError, match="needs a simulator that tells demand"):
        decide("oracle", truth={"demand": None, "left_clear": None, "right_clear": None})


def test_every_other_spec_is_a_models() -> None:
    """A policy is known by its first word."""
    assert all(is_policy(kind) for kind in REFERENCES)
    assert not is_policy("scripted:constant")
    assert not is_policy("openai:oracle")
