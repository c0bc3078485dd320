"""Shapley shares of a run of policies: every subset of the channels with one partner, by their own option."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import arms
from eyechart.cli.app import app
from eyechart.conditions import policies
from eyechart.conditions.policies import subset_conditions
from eyechart.errors import BankError
from eyechart.frames import FrameBank
from eyechart.simulators import open_bank_simulator
from eyechart.studies import policy

FEW = "real,real_repeat,swapped@cameras"
HERE = "python:test_policy_shapley"


def seen(images: arms.Images) -> float:
    """Return how far to the right of the middle the red block is seen."""
    return float(arms.blocks(images["top"], np.full(2, 0.5))[0, 0] - 0.5)


def added(images: arms.Images, state: np.ndarray, instruction: str | None) -> np.ndarray:  # noqa: ARG001 - not read
    """Move by the picture in one dimension and by the state in another; the instruction is not read."""
    return np.tile([seen(images), state[0], 0.0], (8, 1))


def multiplied(images: arms.Images, state: np.ndarray, instruction: str | None) -> np.ndarray:  # noqa: ARG001 - not read
    """Move by the picture, one way or the other as it is told."""
    way = 1.0 if "red" in (instruction or "") else -1.0
    return np.tile([way * seen(images), 0.0, 0.0], (8, 1))


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of twelve episodes of four frames."""
    return open_bank_simulator("tabletop").build(tmp_path_factory.mktemp("shapley") / "bank", steps=4)


def told(*words: object, code: int = 0) -> str:
    """Return what a command prints, which exits so."""
    result = CliRunner().invoke(app, list(map(str, words)))
    assert result.exit_code == code, result.output
    return result.output


def test_shares_add_up_and_who_is_not_read_has_none(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Additive channels have what each carries alone; an interaction is shared; the cost is said before the calls."""
    monkeypatch.syspath_prepend(Path(__file__).parent)
    specs = [f"{HERE}:added", f"{HERE}:multiplied"]
    words = ["run", "policy", "--frames", bank.root, "--out", tmp_path / "run", "--conditions", FEW, "--shapley"]
    said = told(*words, *(word for spec in specs for word in ("--policy", spec)))
    assert "480 calls are for Shapley shares alone" in " ".join(said.split())  # 2 policies, 48 frames, 5 conditions
    found = {spec: model.statistics for spec, model in policy.score(tmp_path / "run").models.items()}
    for statistics in found.values():
        parts = [statistics[f"shapley.{name}"] for name in ("cameras", "state", "instruction")]
        assert sum(part.value for part in parts) == pytest.approx(1.0)
        assert all(part.ci[0] <= part.value <= part.ci[1] for part in parts)
    plain = found[specs[0]]
    assert plain["shapley.cameras"].value == pytest.approx(plain["T.swapped@cameras"].value)
    assert plain["shapley.state"].value == pytest.approx(plain["T.alone@state"].value)
    assert plain["shapley.instruction"].value == pytest.approx(0.0, abs=1e-12)
    assert plain["shapley.instruction"].ci == pytest.approx((0.0, 0.0), abs=1e-12)
    woven = found[specs[1]]
    assert woven["shapley.state"].value == pytest.approx(0.0, abs=1e-12)
    assert min(woven[f"shapley.{name}"].value for name in ("cameras", "instruction")) > 0.02
    assert "shapley.cameras" in told("score", tmp_path / "run", "--all")


def test_every_subset_has_the_same_partner_and_nobody_pays_unasked(bank: FrameBank, tmp_path: Path) -> None:
    """Seven conditions for three channels; a run without the option asks for none of those two that it needs more."""
    assert len(subset_conditions(bank)) == 7
    usual = policy.plan(bank.root, ["python:arms:reach"], tmp_path / "run")
    whole = policy.plan(
        bank.root, ["python:arms:reach"], tmp_path / "run", extent=policy.PolicySelection(limit=None, shapley=True)
    )
    assert set(whole.plan.conditions) - set(usual.plan.conditions) == {"alone@state", "alone@instruction"}
    assert (usual.of_shapley, whole.of_shapley) == (0, 2 * len(bank))


def test_a_bank_of_pictures_alone_has_nothing_to_divide(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line, and nothing is written; with two channels three conditions are enough, which are all asked anyway."""
    monkeypatch.setattr(policies, "channels_of", lambda _: ("cameras", "state"))
    assert set(subset_conditions(bank).values()) == {"real", "swapped@cameras", "kept@cameras"}
    monkeypatch.setattr(policies, "channels_of", lambda _: ("cameras", "camera:top", "camera:wrist"))
    with pytest.raises(BankError, match="no channel but its cameras"):
        policy.plan(
            bank.root, ["python:arms:reach_undeclared"], tmp_path / "run", extent=policy.PolicySelection(shapley=True)
        )
    assert not (tmp_path / "run").exists()
