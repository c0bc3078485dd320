"""Drawn photographs with a table: a red box that grows as it nears, and a model that reads its height."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

import stand_ins
from eyechart.calls import Query, Reply
from eyechart.frames import RGB, decode
from eyechart.modes import RequestMode

SPACE = """
name = "rover"
actions = ["HALT", "CRAWL", "GO", "PORT", "STARBOARD"]
mirror_pairs = [["PORT", "STARBOARD"]]
brake = ["HALT", "CRAWL"]
proceed = ["GO"]
"""
COLUMNS = ("photo", "drive", "place", "tick", "lidar_m", "speed")
SIZE = (40, 56)

Row = Mapping[str, object]


def draw(gap_m: float | None) -> RGB:
    """Draw what a rover sees, shape (40, 56, 3): grey, and a red box as many pixels high as it is near."""
    pixels = np.full((*SIZE, 3), 96, dtype=np.uint8)
    if gap_m is not None:
        pixels[2 : 2 + max(2, round(36 - gap_m / 2)), 18:38] = (200, 0, 0)
    return pixels


def height(pixels: RGB) -> int:
    """Return how many rows of a picture show the box."""
    red = (pixels[:, :, 0] > 150) & (pixels[:, :, 1] < 60) & (pixels[:, :, 2] < 60)
    return int((red.sum(axis=1) > 10).sum())


def rows(*, drives: int = 8, ticks: int = 8, places: Sequence[str] = ("yard", "hall"), seed: int = 0) -> list[Row]:
    """Return the rows of a table of ``drives`` × ``ticks`` photographs; every tenth shows nothing ahead."""
    rng = np.random.default_rng(seed)
    made: list[Row] = []
    for drive in range(drives):
        for tick in range(ticks):
            gap = None if rng.random() < 0.1 else round(float(rng.uniform(3, 60)), 2)
            name, speed = f"{drive}/{tick:02d}.jpg", f"{rng.integers(5, 50)}.50 km/h"
            made.append(dict(zip(COLUMNS, (name, drive, places[drive % len(places)], tick, gap, speed), strict=True)))
    return made


def take(folder: Path, table: Sequence[Row]) -> None:
    """Write the photographs of a table."""
    for row in table:
        path, gap = folder / str(row["photo"]), row["lidar_m"]
        path.parent.mkdir(parents=True, exist_ok=True)
        assert gap is None or isinstance(gap, float)
        Image.fromarray(draw(gap)).save(path, quality=95)


def as_csv(table: Sequence[Row], *, without: Sequence[str] = (), delimiter: str = ",", end: str = "\n") -> str:
    """Return a table as the text of a CSV file."""
    names, text = [name for name in table[0] if name not in without], io.StringIO()
    writer = csv.DictWriter(text, names, extrasaction="ignore", delimiter=delimiter, lineterminator=end)
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()


@dataclass
class Driver(stand_ins.Held):
    """A model that answers from the box's height in the picture, or from the speed that it is told."""

    listens: bool = False
    version: str = "1"

    async def answer(self, query: Query) -> Reply:
        """Answer one query."""
        if self.listens:
            return Reply("HALT" if float(query.user.split("speed ")[1].split()[0]) > 25 else "GO", "stop")
        if query.image is None:
            return Reply("GO", "stop")
        near = height(decode(query.image, "the query's picture"))
        return Reply("HALT" if near > 27 else "CRAWL" if near > 15 else "GO", "stop")


def open_model(name: str, mode: RequestMode) -> Driver:
    """Open the one that looks or the one that listens."""
    del mode
    return Driver(listens={"looks": False, "listens": True}[name])
