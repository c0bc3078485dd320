"""A bank is a Hugging Face imagefolder: ``datasets`` itself loads it, counterfactual pictures included."""

from pathlib import Path

import numpy as np
import pytest

from eyechart.frames import decode, open_bank
from eyechart.simulators import open_simulator

pytestmark = pytest.mark.models


@pytest.fixture(scope="module", params=["balanced", "paper"])
def bank(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a small bank of each preset; ``paper`` has frames without counterfactual pictures."""
    out = tmp_path_factory.mktemp(request.param) / "bank"
    open_simulator("highway").build(out, preset=request.param, seeds=(0,), steps=12)
    return out


@pytest.mark.filterwarnings("ignore")
def test_datasets_loads_a_bank(bank: Path, tmp_path: Path) -> None:
    """Every frame is a row with its picture, its ground truth, and its counterfactual pictures or None."""
    from datasets import load_dataset  # noqa: PLC0415 - an extra

    rows = load_dataset("imagefolder", data_dir=str(bank), split="train", cache_dir=str(tmp_path))
    opened = open_bank(bank)
    assert len(rows) == len(opened)
    absent = 0
    for row, frame in zip(rows, opened, strict=True):
        assert row["frame_id"] == frame.id
        assert row["lead_gap_m"] == frame.truth["lead_gap_m"]
        assert np.array_equal(np.asarray(row["image"].convert("RGB")), decode(opened.image(frame), frame.file))
        for name in ("lead_near", "lead_far", "recoloured"):
            if name in frame.counterfactuals:
                expected = decode(opened.image(frame, name), name)
                assert np.array_equal(np.asarray(row[name].convert("RGB")), expected)
            else:
                assert row[name] is None
                absent += 1
    assert (absent > 0) == (opened.manifest.preset == "paper")
