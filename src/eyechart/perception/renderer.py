"""A reader of highway-env's pictures by exact colours: it shows that the picture has the answer.

The stock picture has 600 x 150 pixels at 5.5 pixels a metre, seen from above. The ego is always at
column 180 in the middle of the rows. Drawing truncates to whole pixels, so half a pixel is added
when a pixel becomes a length. Rows and columns are counted in half pixels, rows from the middle
downwards. A vertical flip then only changes signs, so the readings of a picture and of its flip
agree exactly.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from eyechart.cameras import EGO_COLUMN, HEIGHT_PX, PALETTE, PX_PER_M, WIDTH_PX
from eyechart.spaces.scene import CLEAR_AHEAD_M, CLEAR_BEHIND_M, Other, Scene

_Bools = npt.NDArray[np.bool_]
_Ints = npt.NDArray[np.int64]
_Codes = npt.NDArray[np.uint32]

_NAMES = tuple(PALETTE)
_GREY, _WHITE = 0x646464, 0xFFFFFF

_BODY_LENGTH_PX, _BODY_WIDTH_PX = 25, 9  # 27 x 11 drawn, less the dark outline
_BODY_TURNED_PX = 18  # a whole taller body is turned, and may be short in columns
_LEAST_AREA_PX = 10
_HALF_LENGTH = _BODY_LENGTH_PX - 1  # in half pixels
_EGO_REACH = 14  # the ego's largest distance from its anchor, rows plus columns, in half pixels
_EGO_CENTRE = 2 * EGO_COLUMN - 2  # a body at pixel p fills the columns p - 13 to p + 11
_MIDDLE = HEIGHT_PX - 1

_LANE = 44  # 4 m in half pixels
_LANE_SLACK = 2
_LEAST_LINE_PX = 150
_LONGEST_DASH_GAP_PX = 10  # 4.33 m less 3 m, and a little
_DASH_REACH_PX = 17  # one dash
_DASH_PERIOD_PX = 4.33 * PX_PER_M
_PHASE_REACH_PX = 72
_RAMP_LEAST_PX = 8
_RAMP_LEAST_OFFSET_PX = 40

_COLUMN_ANGLES = 2 * np.pi * (EGO_COLUMN - np.arange(WIDTH_PX) - 0.5) / _DASH_PERIOD_PX
_COLUMN_COS, _COLUMN_SIN = np.cos(_COLUMN_ANGLES), np.sin(_COLUMN_ANGLES)


def _palette_tables() -> tuple[_Codes, npt.NDArray[np.int8]]:
    """Return by a colour's top four bits a channel its code and number (body 2n, lights 2n + 1)."""
    codes = np.zeros(4096, dtype=np.uint32)
    numbers = np.full(4096, -1, dtype=np.int8)
    for n, pair in enumerate(PALETTE.values()):
        for light, (r, g, b) in enumerate(pair):
            slot = (r >> 4) << 8 | (g >> 4) << 4 | b >> 4
            codes[slot] = r << 16 | g << 8 | b
            numbers[slot] = 2 * n + light
    return codes, numbers


_TABLE_CODES, _TABLE_NUMBERS = _palette_tables()


@dataclass(frozen=True, slots=True)
class HighwayReading:
    """The contents of one highway-env picture, by its pixels alone.

    ``ego_colour`` is a name in ``PALETTE`` (green drives, red has crashed). ``lanes`` counts the
    lanes that dashed lines join to the ego's at the ego's column. A fifth lane may lie beyond the
    picture's edge. ``lane_from_left`` is the ego's lane among them. ``others`` are all other
    vehicles, with the lead. ``flipped`` says whether the picture is a flip, None if that is not
    visible.

    ``stripe_phase`` in [0, 1) is the share of a stripe's period since the last stripe began. It
    changes with the ego's position only; None without a dashed line. ``ramp`` says that a line next
    to the straight road is visible, as in merge-v0 and never in highway-v0.
    """

    scene: Scene
    ego_colour: str
    lanes: int
    lane_from_left: int
    others: tuple[Other, ...]
    stripe_phase: float | None
    ramp: bool
    flipped: bool | None = False

    @property
    def vehicles(self) -> int:
        """Return how many other vehicles there are."""
        return len(self.others)

    @property
    def place(self) -> int:
        """Return the kind of road: 0 with a ramp or up to two lanes, 1 with three, 2 with more."""
        return 0 if self.ramp or self.lanes <= 2 else 1 if self.lanes == 3 else 2

    def mirrored(self) -> "HighwayReading":
        """Return the reading of the flipped picture."""
        return replace(
            self,
            scene=self.scene.mirrored(),
            lane_from_left=self.lanes - 1 - self.lane_from_left,
            others=tuple(sorted(one.mirrored() for one in self.others)),
            flipped=None if self.flipped is None else not self.flipped,
        )


class _Body(NamedTuple):
    """A drawn vehicle: its colour's number, twice its middle column, and its row in half pixels.

    ``lost`` is what truncation took from its row, in half pixels.
    """

    colour: int
    column: int
    row: int
    lost: int


class _Road(NamedTuple):
    """Lanes at the ego's column; ``upper`` and ``lower`` are its lane's lines in half pixels."""

    upper: int
    lower: int
    lanes_left: int
    lanes_right: int
    stripe_phase: float | None
    ramp: bool


def read_picture(rgb: npt.NDArray[np.uint8]) -> HighwayReading | None:
    """Return the reading of a picture (150, 600, 3); None if it is no such picture with an ego."""
    if rgb.shape != (HEIGHT_PX, WIDTH_PX, 3) or rgb.dtype != np.uint8:
        return None
    codes = _pack(rgb)
    road = _read_road(codes)
    if road is None:
        return None
    bodies = _find_bodies(codes)
    egos = _find_ego(bodies)
    if not egos:
        return None
    others, upright = [body for body in bodies if body not in egos], _upright(egos)
    return HighwayReading(
        scene=_read_scene(road, others, upright=upright),
        ego_colour=_NAMES[min(ego.colour for ego in egos)],
        lanes=road.lanes_left + 1 + road.lanes_right,
        lane_from_left=road.lanes_left,
        others=tuple(sorted(Other(*_place_of(body, upright)) for body in others)),
        stripe_phase=road.stripe_phase,
        ramp=road.ramp,
        flipped=upright < 0 if upright else None,
    )


def _pack(rgb: npt.NDArray[np.uint8]) -> _Codes:
    """Return one 24-bit number a pixel, shape (150, 600), row by row in memory."""
    codes = rgb[:, :, 0].astype(np.uint32, order="C")
    for channel in (1, 2):
        codes <<= 8
        codes |= rgb[:, :, channel]
    return codes


# ---- the vehicles


def _find_bodies(codes: _Codes) -> list[_Body]:
    """Return every vehicle: an area of one colour with its lights, inside a dark outline."""
    flat = codes.ravel()
    # Grey, white and dark have equal channels.
    places = np.flatnonzero((flat >> 16) != (flat & 255))
    found = flat[places]
    slots = (found >> 12 & 0xF00) | (found >> 8 & 0xF0) | (found >> 4 & 0xF)
    known = _TABLE_CODES[slots] == found
    places, numbers = places[known], _TABLE_NUMBERS[slots[known]]
    if not places.size:
        return []
    colours, lights = numbers >> 1, numbers & 1
    breaks = (np.diff(places) != 1) | (np.diff(colours) != 0) | (places[1:] % WIDTH_PX == 0)
    first = np.concatenate(([0], np.flatnonzero(breaks) + 1))
    last = np.concatenate((first[1:], [places.size])) - 1
    starts, ends, shades = places[first], places[last], colours[first]
    light_ends = np.maximum.reduceat(np.where(lights == 1, places % WIDTH_PX, -1), first)
    columns = zip(
        *(a.tolist() for a in (shades, starts % WIDTH_PX, ends % WIDTH_PX, starts // WIDTH_PX, light_ends)),
        strict=True,
    )
    groups: dict[int, list[int]] = {}
    for root, (shade, x0, x1, y, light) in zip(_join_runs(starts, ends, shades), columns, strict=True):
        box = groups.setdefault(root, [shade, x0, x1, y, y, light, 0])
        box[1], box[2] = min(box[1], x0), max(box[2], x1)
        box[4], box[5] = y, max(box[5], light)
        box[6] += x1 - x0 + 1
    bodies = [_place_body(*box[:6]) for box in groups.values() if box[6] >= _LEAST_AREA_PX]
    return [body for body in bodies if body is not None]


def _join_runs(starts: _Ints, ends: _Ints, shades: npt.NDArray[np.int8]) -> list[int]:
    """Return, for each run of pixels, the first run of the area that it belongs to."""
    low = np.searchsorted(ends, starts + WIDTH_PX).tolist()
    high = np.searchsorted(starts, ends + WIDTH_PX, side="right").tolist()
    colours = shades.tolist()
    parent = list(range(len(colours)))

    def root_of(run: int) -> int:
        while parent[run] != run:
            parent[run] = parent[parent[run]]
            run = parent[run]
        return run

    for run, colour in enumerate(colours):
        for below in range(low[run], high[run]):
            if colours[below] == colour:
                one, other = root_of(run), root_of(below)
                parent[max(one, other)] = min(one, other)
    return [root_of(run) for run in range(len(colours))]


def _place_body(colour: int, x0: int, x1: int, y0: int, y1: int, light: int) -> _Body | None:
    """Return a vehicle from the box of its colour, or None if the box is a road obstacle.

    A vehicle cut by the picture's edge, or half hidden by another, is placed by its visible end.
    Lights are the front; without them the first column is the rear.
    """
    wide, high = x1 - x0 + 1, y1 - y0 + 1
    inside = x1 < WIDTH_PX - 1
    if light < 0 and inside and wide <= _BODY_WIDTH_PX and high <= _BODY_WIDTH_PX and _NAMES[colour] == "yellow":
        return None
    if wide >= _BODY_LENGTH_PX or high > _BODY_TURNED_PX:
        column = x0 + x1
    elif light >= 0 and inside:
        column = 2 * light - _HALF_LENGTH
    else:
        column = 2 * x0 + _HALF_LENGTH
    turned = high > _BODY_WIDTH_PX  # pasting a turned drawing truncates once more
    return _Body(colour, column + turned, y0 + y1 - _MIDDLE, 2 + turned)


def _find_ego(bodies: list[_Body]) -> list[_Body]:
    """Return the vehicle at the anchor, if any; several that a mirror image cannot tell apart."""

    def rank(body: _Body) -> tuple[int, int]:
        return body.colour, abs(body.column - _EGO_CENTRE) + abs(body.row)

    near = [body for body in bodies if rank(body)[1] <= _EGO_REACH]
    nearest = min(near, key=rank, default=None)
    return [] if nearest is None else [body for body in near if rank(body) == rank(nearest)]


def _upright(egos: list[_Body]) -> int:
    """Return 1 for a picture as drawn, -1 for its flip, 0 if it is not visible.

    Truncation moves drawn things towards the first row. The ego, in the middle of the rows, shows
    which side that was.
    """
    side = sum(ego.row for ego in egos)
    return (side < 0) - (side > 0)


def _place_of(body: _Body, upright: int) -> tuple[float, float]:
    """Return how far ahead of the ego a vehicle is and how far to its right, in metres."""
    half_pixels_per_m = 2 * PX_PER_M
    aside = body.row + upright * body.lost
    return (body.column - _EGO_CENTRE + 1) / half_pixels_per_m, aside / half_pixels_per_m


def _read_scene(road: _Road, others: list[_Body], *, upright: int) -> Scene:
    """Return the scene from the own lane's lines and the other vehicles."""
    half_pixels_per_m = 2 * PX_PER_M
    gap_m: float | None = None
    left_clear, right_clear = road.lanes_left > 0, road.lanes_right > 0
    for body in others:
        ahead = (body.column - _EGO_CENTRE + 1) / half_pixels_per_m
        aside = body.row + upright * body.lost
        if abs(aside) < _LANE // 2 and ahead > 0 and body.column + 2 < 2 * WIDTH_PX:
            gap_m = ahead if gap_m is None else min(gap_m, ahead)
        if -CLEAR_BEHIND_M <= ahead <= CLEAR_AHEAD_M:
            left_clear &= not road.upper - _LANE < aside <= road.upper
            right_clear &= not road.lower <= aside < road.lower + _LANE
    return Scene(gap_m, left_clear, right_clear)


# ---- the road


def _read_road(codes: _Codes) -> _Road | None:
    """Return the lanes around the ego, or None without a grey lane between white lines."""
    grey, white = codes == _GREY, codes == _WHITE
    if 2 * np.count_nonzero(grey) < grey.size:
        return None
    drawn = np.count_nonzero(white, axis=1)
    rows = np.flatnonzero(drawn >= _LEAST_LINE_PX)
    lines = (2 * rows - _MIDDLE).tolist()
    own = _own_lane(lines)
    if own is None:
        return None
    dashed = [_is_dashed(white[row], grey[row]) for row in rows]
    up = _walk([-line for line in reversed(lines[: own + 1])], dashed[own::-1])
    down = _walk(lines[own + 1 :], dashed[own + 1 :])
    joining = rows[own + 1 - up : own + 1 + down]
    return _Road(
        upper=lines[own],
        lower=lines[own + 1],
        lanes_left=up,
        lanes_right=down,
        stripe_phase=_read_phase(white[joining], grey[joining]),
        ramp=_sees_ramp(white, rows, own=lines[own] + lines[own + 1]),
    )


def _is_lane(upper: int, lower: int) -> bool:
    """Return whether two lines lie a lane's width apart."""
    return abs(lower - upper - _LANE) <= _LANE_SLACK


def _own_lane(lines: list[int]) -> int | None:
    """Return the upper line's place in the list for the lane that the ego is in, or nearest to."""
    lanes = [n for n in range(len(lines) - 1) if _is_lane(lines[n], lines[n + 1])]
    distances = [abs(lines[n] + lines[n + 1]) for n in lanes]
    if not lanes or distances.count(min(distances)) > 1:
        return None
    return lanes[distances.index(min(distances))]


def _walk(lines: list[int], dashed: list[bool]) -> int:
    """Return the number of lanes outwards from the own lane's line, each behind a dashed line."""
    count = 0
    for n, crossable in enumerate(dashed):
        if not crossable or (n and not _is_lane(lines[n - 1], lines[n])):
            break
        count += 1
    return count


def _is_dashed(white: _Bools, grey: _Bools) -> bool:
    """Return whether a line (600,) has a gap between two dashes close to the ego's column.

    Close is within a dash. Parts hidden by a vehicle do not count in that distance, since the ego
    itself may stand on the line.
    """
    edges = np.flatnonzero(np.diff(grey, prepend=False, append=False))
    starts, ends = edges[0::2], edges[1::2]
    gaps = (ends - starts <= _LONGEST_DASH_GAP_PX) & (starts > 0) & (ends < WIDTH_PX)
    seen = np.concatenate(([0], np.cumsum(white | grey)))
    before = seen[EGO_COLUMN] - seen[ends[gaps]]
    after = seen[starts[gaps]] - seen[EGO_COLUMN]
    return bool(np.any(np.maximum(before, after) <= _DASH_REACH_PX))


def _read_phase(white: _Bools, grey: _Bools) -> float | None:
    """Return the circular mean of the dashes' starts near the ego, on the given lines (n, 600)."""
    near = slice(EGO_COLUMN - _PHASE_REACH_PX, EGO_COLUMN + _PHASE_REACH_PX)
    begun = np.count_nonzero(white[:, 1:] & grey[:, :-1], axis=0)[near]
    if not begun.any():
        return None
    columns = slice(near.start + 1, near.stop + 1)
    turns = np.arctan2(begun @ _COLUMN_SIN[columns], begun @ _COLUMN_COS[columns]) / (2 * np.pi)
    return float(turns % 1.0) % 1.0


def _sees_ramp(white: _Bools, rows: _Ints, *, own: int) -> bool:
    """Return whether white lies off the straight road's lines, or a line begins or ends in sight.

    ``own`` is twice the middle of the own lane: the lines of a straight road lie odd half lanes
    from it.
    """
    from_own = (2 * (2 * rows - _MIDDLE) - own) % (2 * _LANE)
    straight = rows[np.abs(from_own - _LANE) <= 2 * _LANE_SLACK]
    lines = white[straight]
    begins = np.argmax(lines, axis=1)
    ends = np.argmax(lines[:, ::-1], axis=1)
    return bool(
        np.count_nonzero(white) - np.count_nonzero(lines) >= _RAMP_LEAST_PX
        or np.ptp(begins) >= _RAMP_LEAST_OFFSET_PX
        or np.ptp(ends) >= _RAMP_LEAST_OFFSET_PX
    )
