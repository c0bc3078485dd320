"""A reader of the photographs here: it brakes by the row on which the lead's paint ends."""

import io

import numpy as np
from PIL import Image

HORIZON, EYE_M, HALF_M = 80, 1.65, 0.8
PAINT, MOST = 26, 0.2
"""A pixel is paint if its colours differ by so many levels; a row shows the lead if so much of the way is paint."""


def foot(picture: bytes) -> int:
    """Return how many rows below the horizon the paint on the own way begins, 0 without any."""
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)
    rows, columns = pixels.shape[:2]
    paint = pixels.max(axis=2) - pixels.min(axis=2) > PAINT
    for row in range(rows - 1, HORIZON + 2, -1):
        half = (row - HORIZON) / EYE_M * HALF_M
        if paint[row, max(int(columns / 2 - half), 0) : int(columns / 2 + half) + 1].mean() > MOST:
            return row - HORIZON
    return 0


def brakes(prompt: str, picture: bytes | None) -> str:
    """Answer with an action."""
    del prompt
    if picture is None:
        return "STOP"
    below = foot(picture)
    return "STOP" if below >= 28 else "SLOW" if below >= 15 else "STRAIGHT"
