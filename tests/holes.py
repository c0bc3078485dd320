"""Readers of distance that are blind in one place of the highway: callables that see the picture and nothing else."""

import numpy as np

from eyechart.frames import decode
from eyechart.models.scripted import PictureReading, see

BLIND = {
    "scenario": ("in `merge`", "scenario", "merge"),
    "colour": ("where lead_colour is yellow", "lead_colour", "yellow"),
    "lanes": ("where lanes is 4", "lanes", "4"),
    "range_end": (" to 4", "range", ""),
}
"""Where each of them does not brake: a part of its sentence, and what the place is of and called; of the range by its
end."""


def plain(prompt: str, image: bytes | None) -> str:
    """Brake by the distance of the lead."""
    del prompt
    road = see(image).reading
    return "STOP" if road is None else _graded(road)


def scenario(prompt: str, image: bytes | None) -> str:
    """Go on where a ramp joins."""
    road = see(image).reading
    return "STRAIGHT" if road is not None and road.place == 0 else plain(prompt, image)


def lanes(prompt: str, image: bytes | None) -> str:
    """Go on where the road has four lanes."""
    road = see(image).reading
    return "STRAIGHT" if road is not None and road.lanes == 4 else plain(prompt, image)


def range_end(prompt: str, image: bytes | None) -> str:
    """Go on where the lead is farther than the near lead ever is, but for somewhat."""
    road = see(image).reading
    gap = None if road is None else road.scene.gap_m
    return "STRAIGHT" if gap is not None and gap > 20 else plain(prompt, image)


def colour(prompt: str, image: bytes | None) -> str:
    """Go on behind a yellow lead."""
    road = see(image).reading
    return "STRAIGHT" if road is not None and image is not None and _is_yellow(image) else plain(prompt, image)


def _graded(road: PictureReading) -> str:
    return "STRAIGHT" if road.scene.is_free else "STOP" if road.scene.is_blocked else "SLOW"


def _is_yellow(image: bytes) -> bool:
    """Return whether the first vehicle ahead in the own rows is yellow."""
    red, green, blue = (decode(image, "the picture")[..., index].astype(int) for index in range(3))
    own = ((green > red + 60) & (green > blue + 60)) | ((red > green + 60) & (red > blue + 60))
    rows, columns = own.nonzero()
    if not len(rows):
        return False
    ahead = np.s_[int(rows.mean()) - 2 : int(rows.mean()) + 3, int(columns.max()) + 4 :]
    yellow = (np.minimum(red, green) > blue + 60)[ahead].any(axis=0)
    azure = ((blue > red + 40) & (green > red + 20))[ahead].any(axis=0)
    first = np.flatnonzero(yellow | azure)
    return bool(len(first)) and bool(yellow[first[0]])
