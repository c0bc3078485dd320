"""What is cut out of a photograph: a mask from a file, from corners, from GrabCut, or the box alone."""

import math
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw
from scipy.ndimage import binary_closing, label

from eyechart.edits.annotations import OWN, ObjectBox
from eyechart.edits.geometry import Box, Mask
from eyechart.errors import BankError, SourceError, raising
from eyechart.frames import RGB, decode, inside, media_type, read_bounded

FILE, POLYGON, GRABCUT, BOX = "file", "polygon", "grabcut", "box"
CUTS = (GRABCUT, BOX)
"""How an object without a mask is cut out."""

PRICE = (
    "cut out by the box alone: a rectangle of road and of what stands beside travels along; a mask is better, or "
    "pip install 'eyechart[edit]'"
)
"""What a box costs that stands for a mask."""

MOST_CORNERS = 10_000
_AROUND_PX = 60
_ROUNDS = 6
_AGREES = 0.5
_LEAST_OF_BOX = 0.3
"""An outline of less of its box is not the object."""
_LEAST_OF_MASK = 0.1
"""The same for a mask that was given."""


def usual_cut() -> str:
    """Return how objects without a mask are cut out: by GrabCut where OpenCV is installed."""
    return GRABCUT if find_spec("cv2") is not None else BOX


def mask_of(thing: ObjectBox, pixels: RGB, folders: Sequence[Path], cut: str) -> tuple[Mask, str]:
    """Return a thing's mask (h, w) and where it is from.

    A file is sought in the folders. Raises SourceError if a mask cannot be read, or is not the
    box's.
    """
    height, width = pixels.shape[:2]
    with raising(SourceError, f"{thing.where}: the mask", of=(BankError, SourceError)):
        if thing.cut_out is not None:
            return _of_box(thing.cut_out, thing, width, height), FILE
        if thing.mask.lower().endswith(".png"):
            return _of_box(_from_file(thing.mask, folders), thing, width, height), FILE
        if thing.mask:
            return _of_box(from_corners(thing.mask, width, height), thing, width, height), POLYGON
    box = from_box(thing.box, width, height)
    if cut == GRABCUT and thing.role != OWN:
        found = _grabcut(pixels, thing.box)
        if found is not None and found.sum() >= _LEAST_OF_BOX * box.sum():
            return found, GRABCUT
    return box, BOX


def from_box(box: Box, width: int, height: int) -> Mask:
    """Return the mask (h, w) of a box: the pixels whose middles are in it."""
    made = np.zeros((height, width), np.bool_)
    x0, y0, x1, y1 = (max(round(one), 0) for one in box)
    made[y0:y1, x0:x1] = True
    return made


def _from_file(name: str, folders: Sequence[Path]) -> Mask:
    places = [folder for folder in folders if inside(folder, name).is_file()]
    if not places:
        raise SourceError(f"there is no file '{name}' in {' or in '.join(map(str, folders))}")
    stored = read_bounded(places[0], name)
    if media_type(stored) != "image/png":
        raise SourceError(f"'{name}' is no PNG; others do not keep the values of a mask")
    return np.asarray((decode(stored, name) > 0).any(axis=2), np.bool_)


def from_corners(text: str, width: int, height: int) -> Mask:
    """Return the mask of polygons ``x,y x,y …``, several with ';'; raises SourceError."""
    canvas = Image.new("1", (width, height))
    draw = ImageDraw.Draw(canvas)
    for part in filter(None, map(str.strip, text.split(";"))):
        numbers = [[_corner(one) for one in pair.split(",")] for pair in part.split()[: MOST_CORNERS + 1]]
        if not 3 <= len(numbers) <= MOST_CORNERS or any(len(pair) != 2 for pair in numbers):
            raise SourceError(f"'{text[:40]}' is neither a .png file nor corners 'x,y x,y x,y' of a polygon")
        draw.polygon([(x - 0.5, y - 0.5) for x, y in numbers], fill=1)
    return np.asarray(canvas, np.bool_)


def _corner(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) < 1e6:
        raise SourceError(f"'{text[:40]}' is no coordinate; a mask is a .png file, or corners 'x,y x,y x,y'")
    return value


def _of_box(mask: Mask, thing: ObjectBox, width: int, height: int) -> Mask:
    """Return a mask that agrees with its box; raises SourceError for one that does not."""
    if mask.shape != (height, width):
        raise SourceError(f"it has {mask.shape[1]}×{mask.shape[0]} pixels, and its picture {width}×{height}")
    if not mask.any():
        raise SourceError("it is empty")
    box = from_box(thing.box, width, height)
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    around = from_box(Box(columns[0], rows[0], columns[-1] + 1, rows[-1] + 1), width, height)
    if (around & box).sum() < _AGREES * (around | box).sum():
        raise SourceError("it and its box are not of one object; do both fit the picture?")
    if mask.sum() < _LEAST_OF_MASK * box.sum():
        raise SourceError(f"it is less than {_LEAST_OF_MASK:.0%} of its box; do its corners go round the object?")
    return mask


def _grabcut(pixels: RGB, box: Box) -> Mask | None:
    """Return what GrabCut finds in a box (Rother et al. 2004), by OpenCV; None if it finds nothing.

    The middle of the box is taken for the object. The largest part is kept.
    """
    import cv2  # noqa: PLC0415 - an extra

    height, width = pixels.shape[:2]
    x0, y0, x1, y1 = max(round(box.x0), 0), max(round(box.y0), 0), min(round(box.x1), width), min(round(box.y1), height)
    if x1 - x0 < 8 or y1 - y0 < 8:
        return None
    left, top = max(x0 - _AROUND_PX, 0), max(y0 - _AROUND_PX, 0)
    part = np.ascontiguousarray(pixels[top : y1 + _AROUND_PX, left : x1 + _AROUND_PX, ::-1])
    guess = np.full(part.shape[:2], cv2.GC_BGD, np.uint8)
    guess[y0 - top : y1 - top, x0 - left : x1 - left] = cv2.GC_PR_FGD
    middle_x, middle_y = (x1 - x0) // 4, (y1 - y0) // 4
    guess[y0 - top + middle_y : y1 - top - middle_y // 2, x0 - left + middle_x : x1 - left - middle_x] = cv2.GC_FGD
    cv2.setRNGSeed(0)
    try:
        cv2.grabCut(part, guess, None, np.zeros((1, 65)), np.zeros((1, 65)), _ROUNDS, cv2.GC_INIT_WITH_MASK)
    except cv2.error:
        return None
    parts, count = label((guess == cv2.GC_FGD) | (guess == cv2.GC_PR_FGD))
    if not count:
        return None
    largest = parts == 1 + int(np.argmax(np.bincount(parts.ravel())[1:]))
    made = np.zeros((height, width), np.bool_)
    made[top : y1 + _AROUND_PX, left : x1 + _AROUND_PX] = binary_closing(largest, np.ones((5, 5))) | largest
    return made
