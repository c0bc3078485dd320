"""A policy whose actions are mixed with those of one that uses less gets no label that says that it uses more."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from test_policy_adversaries import drifting

import known
from arms import Images, deaf, middle, reach
from eyechart.frames import FrameBank
from eyechart.studies import policy
from eyechart.studies.policy.scores import judge
from eyechart.verdicts.policy_verdict import AXES, PolicyVerdict

pytestmark = pytest.mark.slow

Policy = Callable[[Images, np.ndarray, str | None], np.ndarray]
GREY = 128
SHARES = (1.0, 0.6, 0.3, 0.1, 0.0)
"""How much of a mixture is the policy itself."""


def by_its_tool(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Look for nothing but the own tool, and come to the middle from there."""
    del instruction
    down, across = np.nonzero(images["top"].astype(int).sum(axis=2) < 200)
    seen = np.array([across.mean() + 0.5, down.mean() + 0.5]) / 32 if len(down) > 1 else np.full(2, 0.5)
    result = drifting(state)
    result[:, :2] += 2.0 * (np.full(2, 0.5) - seen)
    return result


def in_the_light(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Drift wherever there is a picture, and stand still where there is none."""
    del instruction
    return drifting(state) * float(np.ptp(images["top"]) > 0)


def blindly(plain: Policy, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer as a policy does that is shown grey."""
    return plain({name: np.full_like(image, GREY) for name, image in images.items()}, state, instruction)


def without_looking(plain: Policy, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer as a policy does that never looks, and goes to the middle."""
    del plain
    return middle(images, state, instruction)


def without_state(plain: Policy, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer as a policy does that is given the same state at every moment."""
    return plain(images, np.full_like(state, 0.5), instruction)


def without_words(plain: Policy, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer as a policy does that is told the same at every moment."""
    return plain(images, state, None if instruction is None else "reach the red block")


def still(plain: Policy, images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Answer always the same."""
    del plain, images, state, instruction
    return np.full((8, 3), 0.01)


def mixed(plain: Policy, less: Callable[..., np.ndarray], share: float) -> Policy:
    """Return a policy so much of whose action is a policy's, and the rest that of its lesser copy."""

    def act(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        rest = less(plain, images, state, instruction)
        return rest if share == 0 else share * plain(images, state, instruction) + (1 - share) * rest

    return act


MIXTURES: Mapping[str, tuple[Policy, Callable[..., np.ndarray], str]] = {
    "reach_blindly": (reach, without_looking, "camera"),
    "deaf_blindly": (deaf, without_looking, "camera"),
    "tool_blindly": (by_its_tool, blindly, "camera"),
    "light_blindly": (in_the_light, without_looking, "camera"),
    "reach_stateless": (reach, without_state, "state"),
    "reach_untold": (reach, without_words, "instruction"),
    "reach_still": (reach, still, "camera"),
}
for _name, (_plain, _less, _axis) in MIXTURES.items():
    for _share in SHARES:
        globals()[f"{_name}_{100 * _share:.0f}"] = mixed(_plain, _less, _share)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of twelve episodes of two frames."""
    return known.table(tmp_path_factory.mktemp("mixtures") / "bank")


def on_the_way_down(bank: FrameBank, out: Path, name: str) -> list[PolicyVerdict]:
    """Return the verdicts on the mixtures of a policy, the least mixed first."""
    specs = [f"python:{__name__}:{name}_{100 * share:.0f}" for share in SHARES]
    policy.run(policy.plan(bank.root, specs, out))
    found = judge(policy.score(out))
    return [found[spec] for spec in specs]


@pytest.mark.parametrize("name", MIXTURES)
def test_who_uses_less_gets_no_stronger_label(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """From all of a policy to none of it; whoever uses nothing at all is told so, unless it never moves."""
    monkeypatch.syspath_prepend(Path(__file__).parent)
    *_, axis = MIXTURES[name]
    verdicts = on_the_way_down(bank, tmp_path / "run", name)
    order, labels = list(AXES[axis]), [verdict.axes[axis].label for verdict in verdicts]
    least = next(label for label in reversed(order) if label not in {"undecided", "no_power"})
    said = [order.index(label) for label in labels if label not in {"undecided", "no_power"}]
    assert said == sorted(said), labels
    assert labels[0] in {"object_grounded", "camera_content", "pose_only", "camera_presence", *order[:2]}
    if name == "reach_still":
        assert set(verdicts[-1].guards) == {"constant"}
    else:
        assert labels[-1] == least
        assert least not in labels[: labels.index(least)]
        assert set(labels[labels.index(least) :]) == {least}
