"""A reader of forward pictures by their pixels: road edges, obstacles and their distances.

The camera is a level pinhole at a known height over a flat road of known width. The road is grey
with white marks; a coloured thing that stands on it is an obstacle. The two edges give the camera's
lateral position and yaw. With these, each pixel below the horizon is a point on the ground.

Everything is computed by column, or in the same way for both sides of the picture. So the readings
of a picture and of its flip agree exactly.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from eyechart.cameras import FORWARD, HAZE, Distances, ForwardView, haze_share
from eyechart.frames import FrameBank
from eyechart.spaces.scene import HIGHWAY, Other, Scene

_Pixels = npt.NDArray[np.uint8]
_Floats = npt.NDArray[np.float64]
_Bools = npt.NDArray[np.bool_]

_COLOURED = 24
"""A larger spread of a pixel's channels is a colour; at 30 m the dimmest obstacle has twice it."""

_GREY = 2
_LEAST_EDGE_ROWS = 5
_VERGE_SLACK = 1
_EDGE_REACH_PX = 6
_SAME_BODY_M = 0.3
_SAME_BODY_SHARE = 0.03
_PHASE_REACH_M = (2.2, 12.0)
_LEAST_MARK_PX = 12


def distances_of(camera: str) -> Distances:
    """Return the distances of a simulator with this camera; highway's for any other."""
    return FORWARD[camera].distances if camera in FORWARD else HIGHWAY


def worlds_distances(bank: FrameBank) -> Distances:
    """Return the distances of the bank's world; its closeness threshold is the bank's own."""
    distances, gap = distances_of(bank.manifest.simulator), bank.manifest.gap
    return distances if gap is None or gap.unit != "m" else replace(distances, close_m=gap.threshold)


def view_of(rgb: _Pixels) -> ForwardView | None:
    """Return the view of a picture, by its size and its sky; None for an unknown one."""
    if rgb.dtype != np.uint8 or rgb.ndim != 3:
        return None
    for view in FORWARD.values():
        if rgb.shape == (view.height, view.width, 3) and (rgb[0] == view.zenith).all(axis=1).any():
            return view
    return None


@dataclass(frozen=True, slots=True)
class ForwardReading:
    """The contents of one forward picture, by its pixels alone.

    ``ego_colour`` is a name among the view's bodies (green drives, red has crashed), ``scenery``
    one among its verges. ``y_m`` is the camera's distance from the road's middle, to the left, and
    ``yaw`` its direction. ``nearest_side`` is the side of the nearest obstacle, seen from the own
    track: left, right, centre, or None. ``stripe_phase`` in [0, 1) is the share of a dash's period
    that has passed; None without visible dashes. ``others`` are the nearest obstacles of each
    track.
    """

    scene: Scene
    ego_colour: str
    scenery: str
    place: int
    y_m: float
    yaw: float
    track: int
    nearest_side: str | None
    stripe_phase: float | None
    others: tuple[Other, ...] = ()
    lanes: int = 3

    @property
    def lane_from_left(self) -> int:
        """Return the own track among them, counted from the left."""
        return self.lanes - 1 - self.track

    @property
    def flipped(self) -> bool | None:
        """Return None: a forward view and its mirror image look the same."""
        return None

    def mirrored(self, tracks: int) -> "ForwardReading":
        """Return the reading of the flipped picture, with the view's number of tracks."""
        sides = {"left": "right", "right": "left"}
        return replace(
            self,
            scene=self.scene.mirrored(),
            y_m=-self.y_m,
            yaw=-self.yaw,
            track=tracks - 1 - self.track,
            others=tuple(sorted(one.mirrored() for one in self.others)),
            nearest_side=self.nearest_side and sides.get(self.nearest_side, self.nearest_side),
        )


def read_forward(rgb: _Pixels, view: ForwardView) -> ForwardReading | None:
    """Return the reading of a picture (h, w, 3) of this view; None without road and own vehicle."""
    ground = np.ascontiguousarray(rgb[view.horizon :].transpose(2, 0, 1)).astype(np.int16)
    # The own vehicle is in the middle of the lowest row.
    middle = rgb[-1, view.width // 2 - 1 : view.width // 2 + 1]
    body = next((name for name, colour in view.bodies.items() if (middle == colour).all()), None)
    if body is None:
        return None
    # The scenery is the one whose verge colour, faded by distance, most pixels have.
    rows = slice(view.sought, view.sought + view.width // 6, 2)
    scenery = int(
        np.argmax([np.count_nonzero(_is_like(ground[:, rows], verge_row[rows])) for verge_row in view.verge_rows])
    )
    red, green, blue = ground
    own = (red == view.bodies[body][0]) & (green == view.bodies[body][1]) & (blue == view.bodies[body][2])
    chroma = np.maximum(np.maximum(red, green), blue) - np.minimum(np.minimum(red, green), blue)
    verge = _is_like(ground, view.verge_rows[scenery])
    pose = _find_pose(chroma, verge, view)
    if pose is None:
        return None
    track = view.track_at(pose.y + view.preview_m * pose.sin)
    points = _find_contacts(chroma, own, pose, view)
    lead, left, right = (_nearest_in(points, track + step, view) for step in (0, 1, -1))
    gap_m = None if lead is None or lead >= view.view_ahead_m else lead
    apart = view.tracks_m[1] - view.tracks_m[0]
    beside = ((lead, 0.0), (left, -apart), (right, apart))
    reach = view.distances.ahead_m
    return ForwardReading(
        scene=Scene(
            gap_m=gap_m,
            left_clear=track + 1 < len(view.tracks_m) and (left is None or left > reach),
            right_clear=track > 0 and (right is None or right > reach),
            distances=view.distances,
        ),
        ego_colour=body,
        scenery=list(view.verges)[scenery],
        place=scenery,
        y_m=pose.y,
        yaw=math.atan2(pose.sin, pose.cos),
        track=track,
        nearest_side=_side_of_nearest(points, track, view),
        stripe_phase=_read_phase(ground, chroma, points, pose, view),
        lanes=len(view.tracks_m),
        others=tuple(sorted(Other(ahead, aside) for ahead, aside in beside if ahead is not None)),
    )


@dataclass(frozen=True, slots=True)
class _Pose:
    """The camera's position across the road, and the sine and cosine of its yaw."""

    y: float
    sin: float
    cos: float


@dataclass(frozen=True, slots=True)
class _Contacts:
    """Where obstacles meet the ground, by column, shape (width,); nan for a column without one.

    ``x`` is the distance along the road and ``y`` across it, from its middle. ``front`` is the
    smallest x of the column's body. ``row`` is the ground row of the contact, -1 without one.
    """

    x: _Floats
    y: _Floats
    front: _Floats
    row: npt.NDArray[np.intp]


def _is_like(ground: npt.NDArray[np.int16], colours: npt.NDArray[np.int16]) -> _Bools:
    """Return which pixels of planes (3, rows, width) have their row's colour, (rows, 3)."""
    like = np.ones(ground.shape[1:], np.bool_)
    for plane, shade in zip(ground, colours.T, strict=True):
        like &= np.abs(plane - shade[:, None]) <= _VERGE_SLACK
    return like


# ---- the road's edges


@dataclass(frozen=True, slots=True)
class _Edge:
    """An edge of the road seen from its side: tangents ``u`` outwards, at inverse depths ``q``."""

    u: _Floats
    q: _Floats

    @property
    def spread(self) -> float:
        """Return the sum of squares about the mean of the inverse depths, 0 for too few rows."""
        return float(((self.q - self.q.mean()) ** 2).sum()) if self.q.size >= _LEAST_EDGE_ROWS else 0.0

    def vanishing(self) -> float:
        """Return the tangent of the edge's vanishing point."""
        from_mean = self.q - self.q.mean()
        slope = float((from_mean * self.u).sum()) / self.spread
        return float(self.u.mean()) - slope * float(self.q.mean())

    def without_outliers(self, pixel: float) -> "_Edge":
        """Return the edge without rows that lie farther than this from its own line."""
        if not self.spread:
            return self
        start = self.vanishing()
        slope = float((self.q * (self.u - start)).sum()) / float((self.q * self.q).sum())
        keep = np.abs(self.u - start - slope * self.q) <= pixel
        return _Edge(self.u[keep], self.q[keep])


def _find_pose(chroma: npt.NDArray[np.int16], verge: _Bools, view: ForwardView) -> _Pose | None:
    """Return the camera's position and yaw from the road's visible edges; None without any."""
    right = _find_edge(chroma, verge, view)
    left = _find_edge(chroma[:, ::-1], verge[:, ::-1], view)
    weight = left.spread + right.spread
    if not weight:
        return None
    # Outwards is to the right on the one side and to the left on the other.
    turned = [side.spread * side.vanishing() if side.spread else 0.0 for side in (left, right)]
    tangent = (turned[1] - turned[0]) / weight
    cos = 1.0 / math.sqrt(1.0 + tangent * tangent)
    offsets = []
    for side, start in ((left, -tangent), (right, tangent)):
        square = float((side.q * side.q).sum()) if side.spread else 0.0
        slope = float((side.q * (side.u - start)).sum()) / square if square else 0.0
        offsets.append((square, square * (slope * cos)))
    edge = view.half_width_m + view.mark_m / 2
    (square_left, to_left), (square_right, to_right) = offsets
    both = square_left + square_right
    y = ((edge * square_left - to_left) - (edge * square_right - to_right)) / both
    return _Pose(y=y, sin=tangent * cos, cos=cos)


def _find_edge(chroma: npt.NDArray[np.int16], verge: _Bools, view: ForwardView) -> _Edge:
    """Return the road's edge on the side of the last columns, where grey meets the verge, by row.

    An obstacle hides an edge. So a row counts only if verge follows grey within a few pixels, and
    the pixels between have a share of the verge's colour.
    """
    width = view.width
    grey = chroma <= _GREY
    last = width - 1 - np.argmax(grey[:, ::-1], axis=1)
    u, q = [], []
    rows = np.flatnonzero(grey.any(axis=1) & (last < width - 1) & (view.depth < view.view_ahead_m))
    for row in rows.tolist():
        start = int(last[row]) + 1
        ahead = verge[row, start : start + _EDGE_REACH_PX]
        if not ahead.any():
            continue
        first = start + int(np.argmax(ahead))
        whole = max(int(chroma[row, first]), 1)
        share = sum(min(int(one), whole) / whole for one in chroma[row, start:first].tolist())
        u.append((first - share - width / 2) / view.focal_px)
        q.append(1.0 / float(view.depth[row]))
    edge = _Edge(np.array(u, np.float64), np.array(q, np.float64))
    return edge.without_outliers(2.0 / view.focal_px)


# ---- the obstacles


def _find_contacts(chroma: npt.NDArray[np.int16], own: _Bools, pose: _Pose, view: ForwardView) -> _Contacts:
    """Return where each column's nearest obstacle meets the ground."""
    ahead, aside = pose.cos - view.aside * pose.sin, pose.sin + view.aside * pose.cos
    to_left = view.depth[:, None] * aside
    blurred = np.maximum(view.depth[:, None] / view.focal_px, np.abs(to_left) / view.below[:, None])
    inside = np.abs(pose.y + to_left) < view.half_width_m - view.mark_m - blurred
    inside[: view.sought] = False
    body = (chroma > _COLOURED) & inside & ~own
    rows = body.shape[0]
    row = rows - 1 - np.argmax(body[::-1], axis=0)
    seen = body.any(axis=0)
    row = np.where(seen, row, rows - 1)
    columns = np.arange(view.width)
    whole = np.maximum(chroma[np.maximum(row - 1, 0), columns], 1).astype(np.float64)
    at = np.minimum(chroma[row, columns] / whole, 1.0)
    following = np.minimum(row + 1, rows - 1)
    under = np.where(own[following, columns], 0, chroma[following, columns])
    foot = row + at + np.where(under <= _COLOURED, np.minimum(under / whole, 1.0), 0.0)
    depth = np.where(seen, view.focal_px * view.eye_m / np.maximum(foot, 0.5), np.nan)
    x = depth * ahead
    return _Contacts(x=x, y=pose.y + depth * aside, front=_fronts(x, depth), row=np.where(seen, row, -1))


def _fronts(x: _Floats, depth: _Floats) -> _Floats:
    """Return for each column the smallest x of its body; bodies end where the depth jumps."""
    jump = np.abs(np.diff(depth))
    room = _SAME_BODY_M + _SAME_BODY_SHARE * np.minimum(depth[1:], depth[:-1])
    starts = np.concatenate(([0], np.flatnonzero(~(jump <= room)) + 1))
    fronts = np.minimum.reduceat(np.where(np.isnan(x), np.inf, x), starts)
    sizes = np.diff(np.concatenate((starts, [x.size])))
    return np.where(np.isnan(x), np.nan, np.repeat(fronts, sizes))


def _nearest_in(points: _Contacts, track: int, view: ForwardView) -> float | None:
    """Return the distance of the nearest body in a track's corridor, in metres, or None."""
    if not 0 <= track < len(view.tracks_m):
        return None
    fronts = points.front[np.abs(points.y - view.tracks_m[track]) < view.beside_m]
    return float(fronts.min()) if fronts.size else None


def _side_of_nearest(points: _Contacts, track: int, view: ForwardView) -> str | None:
    """Return the side of the own corridor on which the nearest body stands."""
    if np.isnan(points.front).all():
        return None
    nearest = points.front == np.nanmin(points.front)
    aside = points.y[nearest] - view.tracks_m[track]
    if float(np.abs(aside).min()) < view.beside_m:
        return "centre"
    return "left" if float(aside.min()) > 0 else "right"


# ---- the marks


def _read_phase(
    ground: npt.NDArray[np.int16], chroma: npt.NDArray[np.int16], points: _Contacts, pose: _Pose, view: ForwardView
) -> float | None:
    """Return the phase of the dashes: the circular mean of the white on their lines."""
    rows = np.flatnonzero((view.depth > _PHASE_REACH_M[0]) & (view.depth < _PHASE_REACH_M[1]))
    depth = view.depth[rows, None]
    plain = (view.surface + 255) / 2
    middle = plain + haze_share(depth) * (HAZE[0] - plain)
    ahead, aside = pose.cos - view.aside * pose.sin, pose.sin + view.aside * pose.cos
    from_middle = np.abs(pose.y + depth * aside)
    on_line = np.zeros(from_middle.shape, np.bool_)
    for offset in view.dashed_m:
        on_line |= np.abs(from_middle - offset) < view.mark_m
    open_road = (chroma[rows] <= _GREY) & (rows[:, None] > points.row)
    white = on_line & open_road & (ground[0, rows] > middle)
    if np.count_nonzero(white) < _LEAST_MARK_PX:
        return None
    along = depth * ahead
    # Both halves are summed in one order, from the picture's edge, so that a flip rounds equally.
    half = view.width // 2
    parts = [_circular(white[:, :half], along[:, :half], depth, view.period_m)]
    parts.append(_circular(white[:, : -half - 1 : -1], along[:, : -half - 1 : -1], depth, view.period_m))
    (cos_left, sin_left), (cos_right, sin_right) = parts
    return (-math.atan2(sin_left + sin_right, cos_left + cos_right) / (2 * math.pi)) % 1.0 % 1.0


def _circular(white: _Bools, along: _Floats, depth: _Floats, period: float) -> tuple[float, float]:
    """Return the sums of cosine and sine of the white pixels' phases, weighted by ground area."""
    area = np.broadcast_to(depth * depth * depth, white.shape)[white]
    angle = along[white] * (2 * math.pi / period)
    return float((area * np.cos(angle)).sum()), float((area * np.sin(angle)).sum())
