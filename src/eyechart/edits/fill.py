"""The ground behind what is cut out: the road itself, moved along its own vanishing lines.

Below the horizon a pixel of the hole takes the colour that the same road has nearer to the camera,
which is the same scaling that moves an object. The light of the hole's rim is then added. Colours
that are carried over the rim instead (Telea, rows) leave marks that readers of pictures brake for.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import zoom
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import spsolve

from eyechart.edits.geometry import Box, Lines, Mask, Planes, box_of, grown, scaled, smoothing

STEP = 1.25
"""Each try takes the road from nearer by this factor; half steps are for what whole ones miss, as
close to the own vehicle."""

_MOST_SMOOTHING = 12.0
_SEEN = 0.98
_MOST_LIGHT = 60.0
_EXACT = 30_000
"""A hole of more pixels is solved at half its size first."""


@dataclass(frozen=True, slots=True)
class Plate:
    """A picture (h, w, 3) whose ``hole`` is filled, and the share of it that the road filled."""

    picture: Planes
    hole: Mask
    filled: float


def membrane(picture: Planes, hole: Mask, source: Mask) -> Planes:
    """Return the picture with its hole filled by the smooth surface through the rim.

    Only pixels of the rim that are a ``source`` count (a Laplace equation). Without any the hole
    becomes black.
    """
    if not hole.any():
        return picture
    x0, y0, x1, y1 = box_of(grown(hole, 1))
    part = np.s_[y0:y1, x0:x1]
    made = picture.copy()
    made[part] = _membrane(picture[part], hole[part], source[part] & ~hole[part])
    return made


def _membrane(picture: Planes, hole: Mask, source: Mask) -> Planes:
    if hole.sum() > _EXACT:
        return _coarsely(picture, hole, source)
    height, width = hole.shape
    rows, columns = np.nonzero(hole)
    count = len(rows)
    number = np.full((height, width), -1)
    number[rows, columns] = np.arange(count)
    degree, known = np.full(count, 1e-6), np.zeros((count, picture.shape[2]))
    ends: list[tuple[np.ndarray, np.ndarray]] = []
    for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        y, x = rows + down, columns + right
        within = np.flatnonzero((y >= 0) & (y < height) & (x >= 0) & (x < width))
        beside = number[y[within], x[within]]
        inner = within[beside >= 0]
        ends.append((inner, beside[beside >= 0]))
        np.add.at(degree, inner, 1)
        rim = within[beside < 0]
        rim = rim[source[y[rim], x[rim]]]
        known[rim] += picture[y[rim], x[rim]]
        np.add.at(degree, rim, 1)
    one, other = (np.concatenate(parts) for parts in zip(*ends, strict=True))
    matrix = (diags(degree) - coo_matrix((np.ones(len(one)), (one, other)), shape=(count, count))).tocsc()
    made = picture.copy()
    made[rows, columns] = np.asarray(spsolve(matrix, known)).reshape(count, -1)
    return made


def _coarsely(picture: Planes, hole: Mask, source: Mask) -> Planes:
    """Return the surface of a large hole, solved at half the size and enlarged."""
    pad = [(0, one % 2) for one in hole.shape]
    holes, sources = np.pad(hole, pad), np.pad(source, pad)
    weight = sources.astype(np.float32)[..., None]
    colours = np.pad(picture, [*pad, (0, 0)]) * weight
    quarter = (holes.shape[0] // 2, 2, holes.shape[1] // 2, 2)
    counts = weight.reshape(*quarter, 1).sum(axis=(1, 3))
    small = colours.reshape(*quarter, -1).sum(axis=(1, 3)) / np.maximum(counts, 1e-6)
    known = counts[..., 0] > 0
    solved = _membrane(small.astype(np.float32), holes.reshape(quarter).any(axis=(1, 3)) & ~known, known)
    large = zoom(solved, (2, 2, 1), order=1, grid_mode=True, mode="nearest")[: hole.shape[0], : hole.shape[1]]
    made = picture.copy()
    made[hole] = large[hole]
    return made


def filled(picture: Planes, cut_out: Mask, lines: Lines, *, kept: Mask, margin: int = 2) -> Plate:
    """Return the picture without what was cut out.

    The hole is ``cut_out`` grown by ``margin`` pixels against soft edges. ``kept`` are other
    things, and the own vehicle: they are never a source, and stay as they are outside of the hole.
    """
    hole = grown(cut_out, margin)
    seen = ~(hole | grown(kept, margin + 1))
    made, road = _road(picture, hole, seen, lines)
    ground = hole.copy()
    ground[: max(math.ceil(lines.horizon) + 1, 0)] = False
    if road.any():
        made = _lit(picture, made, road, seen)
    made = membrane(made, hole & ~road, seen | road)
    return Plate(made, hole, float(road[ground].mean()) if ground.any() else 1.0)


def _road(picture: Planes, hole: Mask, seen: Mask, lines: Lines) -> tuple[Planes, Mask]:
    """Return the picture with road moved into the hole, and where that was possible."""
    todo = hole.copy()
    todo[: max(math.ceil(lines.horizon) + 1, 0)] = False
    made, road = picture.copy(), np.zeros_like(hole)
    planes = np.dstack([picture * seen[..., None], seen]).astype(np.float32)
    steps = (STEP ** (number - part) for part in (0, 0.5) for number in range(1, 40))
    for scale in (1 / step for step in steps if smoothing(1 / step) <= _MOST_SMOOTHING):
        if not todo.any():
            break
        x0, y0, x1, y1 = box_of(todo)
        window = np.s_[y0:y1, x0:x1]
        box = Box(x0, y0, x1, y1)
        share = scaled(planes[..., 3:], scale, lines, window=box)
        take = todo[window] & (share[..., 0] > _SEEN)
        if not take.any():  # nor are its colours needed
            continue
        made[window][take] = scaled(planes[..., :3], scale, lines, window=box)[take] / share[take]
        road[window] |= take
        todo[window] &= ~take
    return made, road


def _lit(picture: Planes, made: Planes, road: Mask, seen: Mask) -> Planes:
    """Return the moved road with the light of its rim: the smooth field of the differences."""
    rim = grown(road, 1) & ~road & seen
    guessed = membrane(made, rim, road)
    difference = np.zeros_like(picture)
    difference[rim] = np.clip(picture[rim] - guessed[rim], -_MOST_LIGHT, _MOST_LIGHT)
    light = membrane(difference, road, rim)
    result = made.copy()
    result[road] += light[road]
    return result
