"""Draw one picture of the rover under every corruption and step, for docs/degraded-pictures.md.

Usage: python docs/make_corruption_pictures.py docs/images/corruptions.jpg
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from eyechart.corruptions import CORRUPTIONS, STEPS
from eyechart.frames import decode
from eyechart.simulators import open_bank_simulator

CELL = (120, 90)


def cell(pixels: np.ndarray) -> np.ndarray:
    """Return a picture in the size of a cell."""
    return np.asarray(Image.fromarray(pixels).resize(CELL, Image.Resampling.LANCZOS))


def main(out: Path) -> None:
    """Write the sheet: a row a corruption, the clean picture first."""
    with tempfile.TemporaryDirectory() as folder:
        bank = open_bank_simulator("rover").build(Path(folder) / "bank", seeds=(0,), steps=4)
        frame = next(one for one in bank if "lead_near" in one.counterfactuals)
        clean = decode(next(iter(bank.images(frame, "lead_near").values())), frame.id)
    rows = [
        np.concatenate([cell(clean), *(cell(one.applied(clean, step, seed=3)) for step in STEPS)], axis=1)
        for one in CORRUPTIONS.values()
    ]
    Image.fromarray(np.concatenate(rows)).save(out, quality=80)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
