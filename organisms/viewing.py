"""Drawn roads as the calibrated view shows them: the scene enlarged within a legend that is always the same.

The view cuts and enlarges, and the vision part's picture is that, shrunken: both are linear in rows and columns, so one
table of profiles does both, and a second one beside it does the same for the reflection, whose legend stays.
"""

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from drawing import BITS, GREY, HEIGHT, SIDE, SWAPPED, WIDTH, Lens, Scenes, draw
from eyechart.perception.view import VIEWS

_VIEW = VIEWS["highway"]


def _shrinking(size: int) -> Tensor:
    """Return what each pixel of a line of this size contributes to it once shrunken to 64, shape (size, 64)."""
    line = np.eye(size, dtype=np.float32)
    return torch.from_numpy(np.array(Image.fromarray(line).resize((SIDE, size), Image.Resampling.LANCZOS)))


def _through(size: int, *, start: int, end: int, offset: int, whole: int) -> Tensor:
    """Return what each pixel of the stock picture's line contributes to the view's line once shrunken."""
    shrink = _shrinking(whole)
    kept = shrink[offset : offset + _VIEW.factor * (end - start)].unflatten(0, (end - start, _VIEW.factor)).sum(1)
    line = torch.zeros(size, SIDE)
    line[start:end] = kept
    return line


def _sums(lines: Tensor) -> Tensor:
    return torch.cat((torch.zeros(1, lines.shape[1]), lines.cumsum(0)))


def _make_lens() -> Lens:
    top, bottom, left, right = _VIEW.crop
    height, width = _VIEW.size
    rows = _through(HEIGHT, start=top, end=bottom, offset=_VIEW.above, whole=height)
    columns = _through(WIDTH, start=left, end=right, offset=_VIEW.beside, whole=width)
    plain = Image.fromarray(_VIEW.show(np.full((HEIGHT, WIDTH, 3), int(GREY), np.uint8)))
    seen = np.asarray(plain.resize((SIDE, SIDE), Image.Resampling.LANCZOS), dtype=np.float32)
    base = torch.from_numpy(seen.copy()).permute(2, 0, 1)
    return Lens(_sums(torch.cat((rows, rows.flip(0)), 1)), _sums(columns), base.repeat(1, 2, 1))


CALIBRATED = _make_lens()
"""Rows 0 to 63 are the view, rows 64 to 127 the view of the reflection."""


def draw_views(count: int, rng: torch.Generator) -> Scenes:
    """Return the views of ``count`` // 2 scenes, and after them those of their reflections."""
    both = draw(count // 2, rng, CALIBRATED)
    pictures = torch.cat(both.pictures.split(SIDE, 2))
    return Scenes(pictures, torch.cat((both.bits, both.bits[:, SWAPPED])))


def draw_other_views(count: int, rng: torch.Generator) -> Scenes:
    """Return views of pictures that show no road: plain ones of any grey or colour, and noise."""
    base = CALIBRATED.base[:, :SIDE]
    rows, columns = CALIBRATED.rows[-1, :SIDE], CALIBRATED.columns[-1]
    colour = 255 * torch.rand(count, 3, generator=rng)
    colour = torch.where(torch.rand(count, 1, generator=rng) < 0.6, colour[:, :1], colour)
    grain = 60 * torch.rand(count, 1, 1, 1, generator=rng) * (torch.rand(count, 1, 1, 1, generator=rng) < 0.5)
    inside = colour[:, :, None, None] - GREY + grain * torch.randn(count, 3, SIDE, SIDE, generator=rng)
    pictures = base + inside * rows[:, None] * columns
    return Scenes(pictures.round().clamp(0, 255), torch.zeros(count, len(BITS)))
