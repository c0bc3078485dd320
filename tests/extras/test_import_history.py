"""Earlier instants from a LeRobotDataset and from HDF5: the log's rows before a moment, or the moment is left out."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import photographs
from data_sets import CAMERA, arm, first_rows, rewrite
from demonstrations import EPISODES, LENGTH, robomimic, shots
from eyechart.cli.app import app
from eyechart.errors import SourceError
from eyechart.frames import FrameBank, check, decode, open_bank
from eyechart.importing import Choices, Horizon, import_hdf5, import_lerobot

pytestmark = pytest.mark.models


def bank_of(root: Path, out: str = "bank", *, history: int = 2, every: int = 1) -> FrameBank:
    """Import a data set for policies of two steps, with instants before each frame."""
    chosen = Choices(every=every, history=history)
    return import_lerobot(root, root.parent / out, chosen, ahead=Horizon(2, "absolute"))


def is_of_its_state(bank: FrameBank) -> bool:
    """Return whether the box in each instant's picture is as high as the gap in its state says."""
    return all(
        abs(
            photographs.height(decode(bank.images(one)["front"], one.id))
            - photographs.height(photographs.draw(one.state["state"][0]))
        )
        <= 2
        for frame in bank
        for one in frame.window
    )


@pytest.mark.parametrize("inside", [True, False])
def test_each_frame_has_the_rows_before_it(tmp_path: Path, inside: bool) -> None:  # noqa: FBT001 - a parameter
    """With the pictures of videos as with those in the data files; a picture is decoded and stored once."""
    arm(tmp_path / "set", inside=inside)
    bank = bank_of(tmp_path / "set", every=3)
    assert [frame.step for frame in bank] == [2, 5, 8] * 8
    assert all([one.step for one in frame.window] == [*range(frame.step - 2, frame.step + 1)] for frame in bank)
    assert is_of_its_state(bank)
    assert check(bank.root) == []
    assert len(bank.manifest.images) == 2 * 8 * 9  # of every step but the last, in two cameras
    alone = bank_of(tmp_path / "set", "alone", history=0)
    for frame in bank:
        own = alone.frame(frame.id)
        assert (frame.motion, frame.state, frame.fields) == (own.motion, own.state, own.fields)
        assert bank.images(frame) == alone.images(own)
    assert bank.manifest.motion == alone.manifest.motion


def test_a_row_that_is_left_out_takes_the_moments_behind_it_along(tmp_path: Path) -> None:
    """A row of no numbers is no instant, and so is one without a picture; both are said."""
    arm(tmp_path / "set", inside=True)

    def spoil(rows: list[dict[str, Any]]) -> None:
        rows[4]["observation.state"] = [float("nan"), 1.0]
        rows[16][CAMERA] = {"bytes": None, "path": "x.png"}

    rewrite(first_rows(tmp_path / "set"), spoil)
    bank = bank_of(tmp_path / "set")
    there = {(frame.episode, frame.step) for frame in bank}
    assert {(e, s) for e in ("0", "1") for s in range(2, 10)} - there == {
        ("0", 4),
        ("0", 5),
        ("0", 6),
        ("1", 6),
        ("1", 7),
        ("1", 8),
    }
    said = "\n".join(map(str, bank.manifest.settings["said"]))  # type: ignore[call-overload]
    assert "2 moments left out, with a gap in the rows before: step 5 of episode 0 (no step 4), step 6 of " in said
    assert (
        "2 moments left out, without a picture of an instant before: step 7 of episode 1, step 8 of episode 1" in said
    )
    assert "1 of 79 instants are left out: 'front' has no picture of them" in said
    assert is_of_its_state(bank)


def test_demonstrations_have_their_rows_before(tmp_path: Path) -> None:
    """Pictures to the bit."""
    bank = import_hdf5(
        robomimic(tmp_path / "low.hdf5"), tmp_path / "bank", Choices(history=1), ahead=Horizon(2, "delta")
    )
    assert len(bank) == EPISODES * (LENGTH - 1)
    for frame in bank:
        for one in frame.window:
            written = shots(int(frame.episode), 0)[one.step]
            assert np.array_equal(decode(bank.images(one)["agentview_image"], one.id), written)


def test_the_command_takes_a_history_and_says_what_is_left_out(tmp_path: Path) -> None:
    """Also of a bank for models."""
    arm(tmp_path / "set", inside=True)
    how = ["frames", "import", str(tmp_path / "set"), "--format", "lerobot", "--camera", CAMERA, "--every", "3"]
    made = CliRunner().invoke(app, [*how, "--history", "1", "--out", str(tmp_path / "bank")])
    assert made.exit_code == 0, made.output
    assert "8 moments at the start of episodes left out" in " ".join(made.output.split())
    bank = open_bank(tmp_path / "bank")
    assert (bank.manifest.history, bank.manifest.motion, len(bank)) == (1, None, 24)
    refused = CliRunner().invoke(app, [*how, "--history", "10", "--out", str(tmp_path / "none")])
    assert isinstance(refused.exception, SourceError)
    assert str(refused.exception).startswith("--history 10: set has no moment with so many rows before it: 80 moments")
    assert not (tmp_path / "none").exists()


@pytest.mark.filterwarnings("ignore")
def test_datasets_loads_such_a_bank(tmp_path: Path) -> None:
    """A row for each frame with its own picture, and a list of its instants with theirs."""
    from datasets import load_dataset  # noqa: PLC0415 - an extra

    arm(tmp_path / "set", inside=True)
    bank = bank_of(tmp_path / "set", every=3)
    rows = load_dataset("imagefolder", data_dir=str(bank.root), split="train", cache_dir=str(tmp_path / "cache"))
    assert [row["frame_id"] for row in rows] == [frame.id for frame in bank]
    for row, frame in zip(rows, bank, strict=True):
        assert np.array_equal(np.asarray(row["image"].convert("RGB")), decode(bank.image(frame), frame.file))
        for told, one in zip(row["past"], frame.past, strict=True):
            assert np.array_equal(np.asarray(told["image"].convert("RGB")), decode(bank.image(one), one.file))
            assert np.array_equal(np.asarray(told["rear"].convert("RGB")), decode(bank.images(one)["rear"], "rear"))
            assert (told["step"], told["state"]) == (one.step, pytest.approx(one.state["state"]))
