"""Drawn photographs of a road with a box on it, and tables of what an annotator would write down."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from eyechart.frames import RGB

WIDTH, HEIGHT, HORIZON, SLOPE, EYE_M = 200, 150, 50, 240.0, 1.5
"""A box at d metres stands at row HORIZON + SLOPE / d."""

LANE_M = 3.0
_WIDE_M, _HIGH_M = 1.5, 1.2


@dataclass(frozen=True)
class Drawn:
    """A photograph: its file, and its boxes as (metres ahead, metres to the left, colour)."""

    file: str
    boxes: tuple[tuple[float, float, tuple[int, int, int]], ...]

    def corners(self, number: int = 0) -> tuple[int, int, int, int]:
        """Return a box's pixels, half open."""
        ahead, left, _ = self.boxes[number]
        per_m = SLOPE / EYE_M / ahead
        foot, middle = HORIZON + SLOPE / ahead, WIDTH / 2 - left * per_m
        half = _WIDE_M / 2 * per_m
        return round(middle - half), round(foot - _HIGH_M * per_m), round(middle + half), round(foot)

    def pixels(self) -> RGB:
        """Return its picture (h, w, 3): sky, a grey road with two lines, and its boxes, the farthest first."""
        rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
        across = np.abs((columns - WIDTH / 2) / np.maximum(rows - HORIZON, 0.5)) * EYE_M
        grey = np.where(np.abs(across - LANE_M / 2) < 0.1, 210, 96)
        made = np.repeat(np.where(rows > HORIZON, grey, 190)[..., None], 3, axis=2).astype(np.uint8)
        for number in sorted(range(len(self.boxes)), key=lambda one: -self.boxes[one][0]):
            x0, y0, x1, y1 = self.corners(number)
            made[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] = self.boxes[number][2]
        return made


RED, BLUE = (200, 40, 30), (40, 60, 200)


def some(count: int = 6, seed: int = 0) -> list[Drawn]:
    """Return photographs with a red lead at 4.5 to 7.5 m, and a blue box on the left way behind it."""
    rng = np.random.default_rng(seed)
    return [
        Drawn(
            f"{number:06d}.png",
            ((round(float(rng.uniform(4.5, 7.5)), 2), 0.0, RED), (round(float(rng.uniform(14, 24)), 2), LANE_M, BLUE)),
        )
        for number in range(count)
    ]


def write_pictures(folder: Path, drawn: Sequence[Drawn]) -> None:
    """Write the pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    for one in drawn:
        Image.fromarray(one.pixels()).save(folder / one.file)


def write_tables(photos: Path, objects: Path, drawn: Sequence[Drawn]) -> None:
    """Write the two tables of photographs."""
    with photos.open("w", newline="") as one, objects.open("w", newline="") as other:
        table, boxes = csv.writer(one), csv.writer(other)
        table.writerow(["file", "episode", "step", "scenario", "horizon", "beside"])
        boxes.writerow(["file", "role", "x0", "y0", "x1", "y1", "distance_m"])
        for step, photo in enumerate(drawn):
            table.writerow([photo.file, "drive 1", step, "road", HORIZON, "right"])
            for number, (ahead, _, _) in enumerate(photo.boxes):
                boxes.writerow([photo.file, "" if number else "lead", *photo.corners(number), ahead])
