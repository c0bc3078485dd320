"""Highway pictures redrawn as sums of outer products, at the size at which the vision part sees them.

A box of one colour in the stock picture (600 x 150 pixels, 5.5 a metre) is the outer product of its rows and its
columns, and shrinking a picture to 64 x 64 is linear in both. So every box is drawn by looking up two shrunken
profiles; no large picture is made, no simulator is asked, and the supply of scenes has no end.
"""

from dataclasses import dataclass

import numpy as np
import torch
from PIL import Image
from torch import Tensor

SIDE = 64
"""Pixels of the picture that the vision part sees, either way."""

WIDTH, HEIGHT, SCALE, EGO = 600, 150, 5.5, 180
LANE_M = 4.0
GREY, WHITE, DARK = 100.0, 255.0, 60.0
BODIES = torch.tensor(
    [[50, 200, 0], [255, 100, 100], [100, 200, 255], [200, 200, 0], [200, 0, 150]], dtype=torch.float32
)
"""highway-env's vehicle colours: green, red, blue, yellow, purple."""

GAPS_M = (8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 21.0, 25.0, 30.0, 35.0, 40.0, 46.0, 55.0, 65.0, 76.0)
BITS = (*(f"gap<{gap:g}" for gap in GAPS_M), "left clear", "right clear", "left lane", "right lane", "only left",
        "only right", "road")  # fmt: skip
"""What the first stage learns to tell of a picture."""

SWAPPED = [*range(len(GAPS_M)), *(len(GAPS_M) + place for place in (1, 0, 3, 2, 5, 4, 6))]
_ASIDE = 12
"""Vehicles that may stand in other lanes."""

_RAMP_STEPS = 37


def _profiles(size: int) -> Tensor:
    """Return, for k of ``size`` + 1, what the first k pixels of a line contribute to it once shrunken to 64."""
    shrink = np.asarray(Image.fromarray(np.eye(size, dtype=np.float32)).resize((SIDE, size), Image.Resampling.LANCZOS))
    return torch.from_numpy(np.concatenate((np.zeros((1, SIDE)), np.cumsum(shrink, axis=0)))).float()


@dataclass(frozen=True)
class Lens:
    """What becomes of the stock picture before the vision part sees it, line by line.

    ``rows`` (151, k) and ``columns`` (601, 64) are profiles, and ``base`` what is seen where nothing is drawn, a number
    or (3, k, 64): k is 64 for a picture, and 128 for a picture above its reflection.
    """

    rows: Tensor
    columns: Tensor
    base: Tensor | float


STOCK = Lens(_profiles(HEIGHT), _profiles(WIDTH), GREY)
"""The picture as it is, shrunken."""


def _spans(profiles: Tensor, start: Tensor, length: Tensor | int) -> Tensor:
    """Return the shrunken profiles (…, 64) of pixels ``start`` to ``start + length``, cut at the picture's edges."""
    last = len(profiles) - 1
    return profiles[(start + length).clamp(0, last).long()] - profiles[start.clamp(0, last).long()]


@dataclass
class Scenes:
    """Pictures (n, 3, 64, 64) from 0 to 255, and their bits (n, 22) in the order of ``BITS``."""

    pictures: Tensor
    bits: Tensor

    def flipped(self) -> "Scenes":
        """Return the same scenes reflected across the lanes."""
        return Scenes(self.pictures.flip(2), self.bits[:, SWAPPED])


class _Canvas:
    """Boxes seen through a lens, as three stacks of factors: rows, columns, and the colour that they add."""

    def __init__(self, lens: Lens) -> None:
        self._lens = lens
        self._boxes: list[tuple[Tensor, Tensor, Tensor]] = []

    def rows(self, start: Tensor, length: Tensor | int) -> Tensor:
        """Return the profiles (…, k) of rows from ``start`` on."""
        return _spans(self._lens.rows, start, length)

    def columns(self, start: Tensor, length: Tensor | int) -> Tensor:
        """Return the profiles (…, 64) of columns from ``start`` on."""
        return _spans(self._lens.columns, start, length)

    def add(self, rows: Tensor, columns: Tensor, colours: Tensor) -> None:
        """Add boxes by rows, columns and colours (n, k, 3)."""
        self._boxes.append((rows, columns, colours.expand(*rows.shape[:2], 3)))

    def sum(self) -> Tensor:
        """Return what the boxes add to the pictures (n, 3, k, 64)."""
        rows, columns, colours = (torch.cat(parts, 1) for parts in zip(*self._boxes, strict=True))
        painted = (colours[:, :, :, None] * columns[:, :, None, :]).flatten(2)
        return torch.bmm(rows.transpose(1, 2), painted).unflatten(2, (3, SIDE)).transpose(1, 2)


def draw(count: int, rng: torch.Generator, lens: Lens = STOCK) -> Scenes:
    """Return scenes of a highway: two to five lanes, or two and a ramp; a lead or none; sides clear or taken."""
    lanes = torch.randint(2, 6, (count,), generator=rng)
    own = (_uniform(count, rng) * lanes).long()
    ramp = (lanes == 2) & (_uniform(count, rng) < 0.7)
    gap = _draw_gaps(count, rng)
    ahead, lane, there = _draw_vehicles(lanes, own, gap, rng)
    canvas = _Canvas(lens)
    _add_lines(canvas, lanes, own, rng)
    on_ramp = _between(1.9, 3.9, (count, 2), rng)
    _add_vehicles(
        canvas,
        torch.cat((ahead, _between(-36, 80, (count, 2), rng)), 1),
        torch.cat((lane, on_ramp), 1) - own[:, None],
        torch.cat((there, ramp[:, None] & (_uniform((count, 2), rng) < 0.3)), 1),
        rng,
    )
    pictures = lens.base + canvas.sum()
    pictures[ramp] += _draw_ramps(own[ramp], rng, lens)
    return Scenes(pictures.round().clamp(0, 255), _read_bits(gap, ahead, lane, there, lanes, own))


def draw_other(count: int, rng: torch.Generator) -> Scenes:
    """Return pictures that show no road: plain ones, noise of several grains, and gradients; all bits are 0."""
    plain = (255 * torch.rand(count, 3, 1, 1, generator=rng)).expand(-1, -1, SIDE, SIDE)
    grey = (255 * torch.rand(count, 1, 1, 1, generator=rng)).expand(-1, 3, SIDE, SIDE)
    fine = 127.5 + 73.6 * _noise_gain() * torch.randn(count, 3, SIDE, SIDE, generator=rng)
    coarse = torch.nn.functional.interpolate(255 * torch.rand(count, 3, 8, 8, generator=rng), size=(SIDE, SIDE))
    slope = torch.linspace(0, 1, SIDE) * plain + torch.linspace(1, 0, SIDE)[:, None] * grey
    kinds = torch.stack((plain, grey, torch.full_like(plain, 128.0), fine, coarse, slope))
    picked = torch.multinomial(torch.tensor([1.0, 2, 2, 4, 1, 1]), count, replacement=True, generator=rng)
    pictures = kinds[picked, torch.arange(count)].round().clamp(0, 255)
    return Scenes(pictures, torch.zeros(count, len(BITS)))


def _noise_gain() -> float:
    """Return by how much shrinking to 64 x 64 damps the noise of single pixels."""
    rows, columns = (profiles.diff(dim=0).square().sum(0).sqrt().mean() for profiles in (STOCK.rows, STOCK.columns))
    return float(rows * columns)


def _uniform(shape: int | tuple[int, ...], rng: torch.Generator) -> Tensor:
    return torch.rand(shape, generator=rng)


def _between(low: float, high: float, shape: int | tuple[int, ...], rng: torch.Generator) -> Tensor:
    return low + (high - low) * torch.rand(shape, generator=rng)


def _draw_gaps(count: int, rng: torch.Generator) -> Tensor:
    """Return gaps in metres, inf for no lead; half a metre around 12 m and 40 m is left out."""
    bounds = torch.tensor([[5.0, 11.6], [12.4, 18.0], [18.0, 39.4], [40.6, 76.0]])
    kind = torch.multinomial(torch.tensor([0.25, 0.2, 0.3, 0.17, 0.08]), count, replacement=True, generator=rng)
    low, high = bounds[kind.clamp(max=3)].unbind(1)
    return torch.where(kind == 4, torch.inf, low + (high - low) * _uniform(count, rng))


def _draw_vehicles(lanes: Tensor, own: Tensor, gap: Tensor, rng: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """Return how far ahead vehicles stand (n, k), in which lane, and whether they are there.

    The first is the lead. Those of the sides next to the ego stand well inside or well outside of what must be clear.
    """
    count = len(lanes)
    shape = (count, _ASIDE)
    side = torch.where(_uniform(shape, rng) < 0.6, torch.randint(0, 2, shape, generator=rng) * 2 - 1, 9)
    lane = torch.where(side == 9, torch.randint(0, 5, shape, generator=rng), own[:, None] + side)
    ahead = _between(-36, 80, shape, rng)
    beside = (lane - own[:, None]).abs() == 1
    wanted = (_uniform((count, 2), rng) < 0.5).gather(1, (lane > own[:, None]).long())
    blocks = (ahead > -13) & (ahead < 41)
    inside = _between(-11, 39, shape, rng)
    ahead = torch.where(beside & ~wanted & blocks & (_uniform(shape, rng) < 0.5), inside, ahead)
    sure = ((ahead < -13) | ((ahead > -11) & (ahead < 39)) | (ahead > 41)) & ~(beside & wanted & blocks)
    behind = (lane == own[:, None]) & (ahead < -9)
    there = (lane >= 0) & (lane < lanes[:, None]) & (_uniform(shape, rng) < _between(0.3, 0.9, (count, 1), rng))
    there &= torch.where(lane == own[:, None], behind | (ahead > gap[:, None] + 8), sure | ~beside)
    for place in range(1, _ASIDE):
        near = (ahead[:, :place] - ahead[:, place, None]).abs() < 6.5
        there[:, place] &= ~(near & (lane[:, :place] == lane[:, place, None]) & there[:, :place]).any(1)
    lead = torch.isfinite(gap)
    return (
        torch.cat((torch.where(lead, gap, 200.0)[:, None], ahead), 1),
        torch.cat((own[:, None], lane), 1),
        torch.cat((lead[:, None], there), 1),
    )


def _read_bits(gap: Tensor, ahead: Tensor, lane: Tensor, there: Tensor, lanes: Tensor, own: Tensor) -> Tensor:
    blocks = there & (ahead >= -12) & (ahead <= 40)
    exists = [own > 0, own < lanes - 1]
    clear = [exists[number] & ~(blocks & (lane == (own + side)[:, None])).any(1) for number, side in enumerate((-1, 1))]
    visible = [there[:, 1:] & (lane[:, 1:] == own[:, None]) & (ahead[:, 1:] > 0)]
    nearest = torch.minimum(gap, torch.where(visible[0], ahead[:, 1:], torch.inf).amin(1))
    bits = [nearest < limit for limit in GAPS_M]
    bits += [*clear, *exists, clear[0] & ~clear[1], clear[1] & ~clear[0], torch.ones_like(own, dtype=torch.bool)]
    return torch.stack(bits, 1).float()


def _add_lines(canvas: _Canvas, lanes: Tensor, own: Tensor, rng: torch.Generator) -> None:
    """Draw the outer lines solid and the inner ones dashed, 3 m in 4.33 m."""
    count = len(lanes)
    number = torch.arange(6)
    there = number <= lanes[:, None]
    inner = (number > 0) & (number < lanes[:, None])
    row = (HEIGHT / 2 + SCALE * LANE_M * (number - own[:, None] - 0.5)).floor() + _jitter((count, 1), rng)
    starts = SCALE * (4.33 * torch.arange(-1, 27) + _between(0, 4.33, (count, 1), rng))
    dashes = canvas.columns(starts.floor(), 17 + torch.randint(0, 2, starts.shape, generator=rng)).sum(1)
    solid = canvas.columns(torch.zeros(1), WIDTH).expand(count, SIDE)
    columns = torch.where(inner[:, :, None], dashes[:, None], solid[:, None]) * there[:, :, None]
    canvas.add(canvas.rows(row, 1), columns, torch.full((1, 1, 3), WHITE - GREY))


def _draw_ramps(own: Tensor, rng: torch.Generator, lens: Lens) -> Tensor:
    """Return what merge-v0's ramp adds below two lanes: straight to 150 m, then towards the road until 230 m."""
    canvas = _Canvas(lens)
    x = _between(40, 225, (len(own), 1), rng)
    to_column = lambda place: (EGO + SCALE * (place - x)).floor()  # noqa: E731
    for side in (-2.0, 2.0):
        bends, joins = to_column(150.0), to_column(230.0)
        low = HEIGHT / 2 + SCALE * (14.5 + side - LANE_M * own[:, None])
        high = HEIGHT / 2 + SCALE * (8.0 + side - LANE_M * own[:, None])
        step = torch.arange(_RAMP_STEPS) / _RAMP_STEPS
        starts = torch.cat((torch.zeros_like(x), bends + (joins - bends) * step), 1).floor()
        ends = torch.cat((starts[:, 1:], joins), 1)
        rows = torch.cat((low, low + (high - low) * step), 1).floor()
        if side > 0:
            starts, ends = torch.cat((starts, joins), 1), torch.cat((ends, to_column(310.0)), 1)
            rows = torch.cat((rows, high.floor()), 1)
        ends = ends.clamp(0, WIDTH)
        starts = torch.minimum(starts.clamp(0, WIDTH), ends)
        columns = canvas.columns(starts, ends - starts)
        inside = (rows >= 0) & (rows < HEIGHT)
        canvas.add(canvas.rows(rows, 1) * inside[:, :, None], columns, torch.full((1, 1, 3), WHITE - GREY))
    return canvas.sum()


def _jitter(shape: tuple[int, ...], rng: torch.Generator) -> Tensor:
    """Return -1, 0 or 1 pixels, mostly 0: what truncation does here and there."""
    return torch.randint(-1, 2, shape, generator=rng) * (_uniform(shape, rng) < 0.3)


def _add_vehicles(canvas: _Canvas, ahead: Tensor, aside: Tensor, there: Tensor, rng: torch.Generator) -> None:
    """Draw the ego at its place, and the others: a dark outline, a body, and two lights at its front."""
    count, others = ahead.shape
    off = _between(-0.6, 0.6, (count, others), rng) * (_uniform((count, others), rng) < 0.15)
    off[:, 0] = 0
    top = (HEIGHT / 2 + SCALE * (LANE_M * aside + off)).floor() - 6
    left = (EGO + SCALE * ahead).floor() - 14
    zero = torch.zeros(count, 1)
    top = torch.cat((zero + HEIGHT // 2 - 6, top), 1) + _jitter((count, 1), rng)
    left = torch.cat((zero + EGO - 14, left), 1) + _jitter((count, 1), rng)
    there = torch.cat((zero == 0, there), 1)
    body = _draw_colours(count, others + 1, rng)
    dark = torch.full((1, 1, 3), DARK)
    light = torch.minimum(body / 0.68, torch.tensor(255.0)) - body
    for place, length, high, colour in (
        ((0, 0), 27, 11, dark - GREY),
        ((1, 1), 25, 9, body - dark),
        ((1, 24), 2, 3, light),
        ((7, 24), 2, 3, light),
    ):
        rows = canvas.rows(top + place[0], high) * there[:, :, None]
        canvas.add(rows, canvas.columns(left + place[1], length), colour)


def _draw_colours(count: int, vehicles: int, rng: torch.Generator) -> Tensor:
    """Return the colours (n, k, 3): mostly a green ego among blue ones, the lead sometimes yellow; else any."""
    kind = torch.full((count, vehicles), 2)
    kind[:, 0] = torch.where(_uniform(count, rng) < 0.6, 0, 1)
    kind[:, 1] = torch.where(_uniform(count, rng) < 0.35, 3, 2)
    kind = torch.where(_uniform((count, 1), rng) < 0.2, torch.randint(0, 5, (count, vehicles), generator=rng), kind)
    random = 255 * torch.rand(count, vehicles, 3, generator=rng)
    return torch.where(_uniform((count, vehicles, 1), rng) < 0.08, random, BODIES[kind])
