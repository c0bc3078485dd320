"""Staged moments of the balanced banks: a lead and sides placed by a plan on three tracks.

Beyond them stand obstacles as the family has them. Each moment is a world of its own, so no gap
closes with time.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from eyechart.cameras import FORWARD
from eyechart.errors import BankError
from eyechart.frames import EXCHANGE, LEAD, RGB, Draws, Gap
from eyechart.seeds import key_seed
from eyechart.simulators.banks import (
    BOXED,
    BankMaker,
    ControlPictures,
    Moment,
    Preset,
    by_dozens,
    first_shown,
    versions_of,
)
from eyechart.simulators.plan import Bands, Lanes, MomentSpec, make_plan, other_gap
from eyechart.simulators.road.layout import FAMILIES, GOAL_M, TRACKS_M, Layout, Obstacle, new_obstacle
from eyechart.simulators.road.truth import ahead, blocks, find_lead, gap_to, read_scene, read_truth
from eyechart.simulators.road.world import PAINT_NAMES, SCENERY, AnyWorld, draw, eye_of, lowest_m

GAPS = Bands(near=(2.6, 2.0), close=(5.4, 2.2), middle=(8.4, 6.2), far=(15.6, 11.0), beyond=(33.0, 12.0))
"""Around 5, 8 and 15 m, and the limit of sight at 30 m."""

NEAR_M = (2.6, 4.4)
FAR_M = (18.0, 27.0)
"""The lead's distance in ``lead_near`` and ``lead_far``, from the vehicle's middle to the lead's
near side."""

EXCHANGED_FAR_M = (22.5, FAR_M[1])
"""The range of far places in the exchange: farther than any distance that the exchange draws."""

_LANES = Lanes(count=len(TRACKS_M), ego=tuple(range(len(TRACKS_M))))
_OFF_TRACK_M = 0.2
_LEAN_M = 0.35
_BESIDE_M = (3.0, 14.0)
_OFF_SIDE_M = 0.2
_AWAY_M = 0.6
_BEYOND_M = (17.5, 45.0)
_CLEARANCE_M = 0.05
_LEAST_SEEN = 0.5
_LEAST_SPEED_MPS = 1.0
_TRIES = 200
_PLACES = 30
"""Number of pairs of far places for one distance of the exchange. In the first fifth of them the
lead does not lean."""
_SURROUNDINGS = {"offset": 1, "single": 0, "slalom": 2, "gate": 4, "clutter": 6}
"""Number of obstacles farther away than anything that matters; those of a gate stand in pairs."""


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The properties of a vehicle that staging needs.

    ``place(layout, pose, speed, track)`` puts it into a layout, at a pose (x, y, yaw). It may be
    turned by ``most_yaw`` rad to either side, and be as fast as ``most_mps``. ``view`` names its
    view, and with it the seeds of its moments.
    """

    view: str
    place: Callable[[Layout, tuple[float, float, float], float, int], AnyWorld]
    most_yaw: float
    most_mps: float


def stage(vehicle: Vehicle, scenario: str, seed: int, steps: int, *, boxed: bool = False) -> Iterator[Moment]:
    """Yield the moments of one episode; with ``boxed``, those of the staging version `BOXED`."""
    rng = np.random.default_rng(key_seed(vehicle.view, "balanced", scenario, seed))
    for wish in make_plan(_LANES, GAPS, steps, rng, boxed=boxed):
        yield record(_set_up(vehicle, scenario, wish, rng), rng, lowest=boxed)


def record(world: AnyWorld, rng: np.random.Generator, *, lowest: bool = False) -> Moment:
    """Return a world's moment with the lead near, the lead far, and the own hood repainted.

    With ``lowest``, near is as near as can be shown.
    """
    lead = find_lead(world)
    gap_m = None if lead is None else gap_to(world, lead)
    near_m = lowest_m(world.vehicle) if lowest else other_gap(gap_m, NEAR_M, rng)
    far_m = other_gap(gap_m, FAR_M, rng)
    pictures = {
        "lead_near": _draw_with_lead_at(world, near_m),
        "lead_far": _draw_with_lead_at(world, far_m),
        "recoloured": draw(world, red=True),
    }
    drawn = {name: picture for name, picture in pictures.items() if picture is not None}
    return Moment(
        read_truth(world),
        draw(world),
        drawn,
        ranged=partial(draw_ranged, world),
        distances={f"{name}_m": m for name, m in (("lead_near", near_m), ("lead_far", far_m)) if name in drawn},
        strata={"lead_colour": None if lead is None else PAINT_NAMES[lead.paint]},
    )


def draw_ranged(world: AnyWorld, draws: Draws, rng: np.random.Generator) -> ControlPictures:
    """Return the control pictures: without the lead, and at gaps of the whole range.

    Without a lead there are none. In ``exchange_own`` the lead stands at a gap, and an obstacle of
    a neighbouring track stands far. In ``exchange_beside`` the lead stands far, and that obstacle
    stands at the distance, between the middles, at which the lead stood. It has the lead's size and
    paint in both, and at least half of it is visible in either. In ``exchange_apart`` both are far.
    """
    lead = find_lead(world)
    if lead is None:
        return ControlPictures()
    moved_m, pictures, distances = None, dict[str, RGB](), dict[str, float]()
    if (absent := _draw_without(world, lead)) is not None:
        pictures["lead_absent"] = absent
    if alone := first_shown(partial(_draw_with_lead_at, world), draws.lead()):
        moved_m, pictures["lead_drawn"] = alone
        distances[LEAD] = moved_m
    if both := first_shown(partial(_exchange_at, world, lead, rng), draws.exchange(moved_m)):
        distances[EXCHANGE] = both[0]
        pictures |= both[1]
    return ControlPictures(pictures, distances)


def _draw_without(world: AnyWorld, lead: Obstacle) -> RGB | None:
    """Return the picture without the lead; None if it was not visible or another obstacle leads."""
    if gap_to(world, lead) >= world.view.view_ahead_m:
        return None
    absent = _with(world, *(obstacle for obstacle in world.layout.obstacles if obstacle is not lead))
    return draw(absent) if read_scene(absent).gap_m is None else None


def _exchange_at(world: AnyWorld, lead: Obstacle, rng: np.random.Generator, own_m: float) -> dict[str, RGB] | None:
    """Return the exchange's pictures at this gap, or None if no obstacle beside has room for it."""
    for number in range(_PLACES):
        far_m, its_far_m = (float(rng.uniform(*EXCHANGED_FAR_M)) for _ in range(2))
        for taken, y in _beside(world, lead, rng):
            leaning = lead if number < _PLACES / 5 else _lean_from(world, lead, y, rng)
            own, far, its_far = (_at_gap(world, leaning, gap_m) for gap_m in (own_m, far_m, its_far_m))
            beside = _abreast(world, own, y)
            if beside is None:
                continue
            shown = {
                "exchange_own": (own, replace(its_far, y=y)),
                "exchange_beside": (far, beside),
                "exchange_apart": (far, replace(its_far, y=y)),
            }
            if pictures := _draw_exchanged(world, shown, [lead, *([] if taken is None else [taken])]):
                return pictures
    return None


def _abreast(world: AnyWorld, lead: Obstacle, y: float) -> Obstacle | None:
    """Return the lead at ``y`` and the same distance, or None if that distance is too short."""
    square = _away(world, lead) ** 2 - (y - world.state.y) ** 2
    return replace(lead, x=world.state.x + math.sqrt(square), y=y) if square > 0 else None


def _draw_exchanged(
    world: AnyWorld, shown: Mapping[str, tuple[Obstacle, Obstacle]], instead: Sequence[Obstacle]
) -> dict[str, RGB]:
    """Return pictures with these pairs of lead and other ``instead`` of some; none if one fails."""
    others = [obstacle for obstacle in world.layout.obstacles if not any(obstacle is gone for gone in instead)]
    worlds = {name: _with(world, *pair, *others) for name, pair in shown.items()}
    if not all(_is_exchanged(made, *shown[name]) for name, made in worlds.items()):
        return {}
    return {name: draw(made) for name, made in worlds.items()}


def _draw_with_lead_at(world: AnyWorld, gap_m: float) -> RGB | None:
    """Return the picture with the lead at this gap; None without a lead or a free place."""
    lead = find_lead(world)
    if lead is None:
        return None
    moved = _at_gap(world, lead, gap_m)
    others = [obstacle for obstacle in world.layout.obstacles if obstacle is not lead]
    if any(_overlaps(moved, obstacle) for obstacle in others):
        return None
    return draw(_with(world, moved, *others))


def _at_gap(world: AnyWorld, obstacle: Obstacle, gap_m: float) -> Obstacle:
    return replace(obstacle, x=world.state.x + gap_m + obstacle.radius)


def _with(world: AnyWorld, *obstacles: Obstacle) -> AnyWorld:
    """Return the same moment among these obstacles."""
    return replace(world, layout=replace(world.layout, obstacles=obstacles))


def _beside(world: AnyWorld, lead: Obstacle, rng: np.random.Generator) -> Iterator[tuple[Obstacle | None, float]]:
    """Yield each neighbouring track's nearest obstacle ahead, if any, and a place across.

    The place lies rather away from the own track, where the lead hides less of it.
    """
    for side in rng.permutation([-1, 1]).tolist():
        if 0 <= world.track + side < len(TRACKS_M):
            middle = TRACKS_M[world.track + side]
            there = (one for one in ahead(world) if one is not lead and abs(one.y - middle) <= _OFF_SIDE_M)
            taken = min(there, key=partial(gap_to, world), default=None)
            yield taken, middle + side * float(rng.uniform(-_OFF_SIDE_M, _AWAY_M))


def _lean_from(world: AnyWorld, lead: Obstacle, y: float, rng: np.random.Generator) -> Obstacle:
    """Return the lead on its track, a little away from a place beside it."""
    middle = TRACKS_M[world.track]
    return replace(lead, y=middle - math.copysign(float(rng.uniform(0.0, _LEAN_M)), y - middle))


def _is_exchanged(world: AnyWorld, lead: Obstacle, beside: Obstacle) -> bool:
    """Return whether the lead leads, the other is off the own track, and both are visible."""
    column = world.view.project(eye_of(world), (beside.x, beside.y))[0, 0]
    apart = not blocks(world, beside, world.track) and _are_apart(world.layout.obstacles)
    in_picture = 0 < column < world.view.width and _are_seen(world, (lead, beside))
    return bool(apart and in_picture and find_lead(world) is lead)


def _set_up(vehicle: Vehicle, scenario: str, wish: MomentSpec, rng: np.random.Generator) -> AnyWorld:
    """Return a world that fulfils the plan."""
    track = len(TRACKS_M) - 1 - wish.lane
    for _ in range(_TRIES):
        x, y = float(rng.uniform(0.0, GOAL_M)), TRACKS_M[track] + float(rng.uniform(-_OFF_TRACK_M, _OFF_TRACK_M))
        yaw = float(rng.uniform(-vehicle.most_yaw, vehicle.most_yaw))
        speed = float(rng.uniform(_LEAST_SPEED_MPS, vehicle.most_mps))
        needed = [_lead(x, track, wish, rng), *_sides(x, track, wish, rng)]
        layout = Layout(scenario, (*needed, *_surroundings(scenario, x, track, rng)))
        world = vehicle.place(layout, (x, y, yaw), speed, track)
        if _holds(world, wish) and _are_apart(world.layout.obstacles) and _are_seen(world, needed):
            return world
    raise BankError(f"no moment with a gap of {wish.gap_m:.1f} m could be staged; use another seed")


def _holds(world: AnyWorld, wish: MomentSpec) -> bool:
    """Return whether a world fulfils the plan, as far as its picture reaches."""
    scene = read_scene(world)
    seen = wish.gap_m < world.view.view_ahead_m
    as_wished = scene.gap_m is not None and math.isclose(scene.gap_m, wish.gap_m, abs_tol=1e-6)
    return (scene.left_clear, scene.right_clear) == wish.sides and (as_wished if seen else scene.gap_m is None)


def _lead(x: float, track: int, wish: MomentSpec, rng: np.random.Generator) -> Obstacle:
    """Return the lead, a little beside the middle of the own track."""
    across = TRACKS_M[track] + float(rng.uniform(-_LEAN_M, _LEAN_M))
    lead = new_obstacle(0.0, across, rng)
    return replace(lead, x=x + wish.gap_m + lead.radius)


def _sides(x: float, track: int, wish: MomentSpec, rng: np.random.Generator) -> list[Obstacle]:
    """Return the obstacles that block the sides that must not be clear."""
    sides = []
    for beside, clear in zip((track + 1, track - 1), wish.sides, strict=True):
        if not clear and 0 <= beside < len(TRACKS_M):
            across = TRACKS_M[beside] + float(rng.uniform(-_OFF_SIDE_M, _OFF_SIDE_M))
            sides.append(new_obstacle(x + float(rng.uniform(*_BESIDE_M)), across, rng))
    return sides


def _surroundings(scenario: str, x: float, track: int, rng: np.random.Generator) -> list[Obstacle]:
    """Return obstacles on the other tracks, too far away to matter."""
    others = [index for index in range(len(TRACKS_M)) if index != track]
    obstacles: list[Obstacle] = []
    for number in range(_SURROUNDINGS[scenario]):
        beside = others[number % 2] if scenario in {"slalom", "gate"} else others[int(rng.integers(2))]
        pair = scenario == "gate" and number % 2
        there = obstacles[-1].x if pair else x + float(rng.uniform(*_BEYOND_M))
        across = TRACKS_M[beside] + float(rng.uniform(-_OFF_SIDE_M, _OFF_SIDE_M))
        obstacles.append(new_obstacle(there, across, rng))
    return obstacles


def _overlaps(obstacle: Obstacle, other: Obstacle) -> bool:
    return math.hypot(obstacle.x - other.x, obstacle.y - other.y) < obstacle.radius + other.radius + _CLEARANCE_M


def _are_apart(obstacles: Sequence[Obstacle]) -> bool:
    """Return whether no two obstacles touch."""
    return not any(_overlaps(obstacle, other) for n, obstacle in enumerate(obstacles) for other in obstacles[:n])


def _are_seen(world: AnyWorld, needed: Sequence[Obstacle]) -> bool:
    """Return whether at least half of the width of each of these obstacles is visible."""
    spans = [(_away(world, obstacle), *_span(world, obstacle)) for obstacle in world.layout.obstacles]
    for away, low, high in spans[: len(needed)]:
        hidden = sum(max(min(high, top) - max(low, bottom), 0.0) for nearer, bottom, top in spans if nearer < away)
        if hidden > (1 - _LEAST_SEEN) * (high - low):
            return False
    return True


def _away(world: AnyWorld, obstacle: Obstacle) -> float:
    return math.hypot(obstacle.x - world.state.x, obstacle.y - world.state.y)


def _span(world: AnyWorld, obstacle: Obstacle) -> tuple[float, float]:
    """Return the lowest and the highest bearing of an obstacle."""
    bearing = math.atan2(obstacle.y - world.state.y, obstacle.x - world.state.x)
    half = math.asin(min(obstacle.radius / _away(world, obstacle), 1.0))
    return bearing - half, bearing + half


class RoadBanks(BankMaker):
    """The part of a road simulator that makes banks of the staged moments of ``vehicle``."""

    vehicle: Vehicle

    def open_preset(self, name: str) -> Preset:
        """Return the only preset.

        Near is below the view's ``close_m``, from the vehicle's middle to the obstacle's near side.
        The highway's 18 m would be more than four seconds for a slow vehicle.
        """
        del name
        distances = FORWARD[self.vehicle.view].distances
        return Preset(
            scenarios={family: {"beside": SCENERY[family]} for family in FAMILIES},
            moments=by_dozens(partial(stage, self.vehicle)),
            staged={BOXED: by_dozens(partial(stage, self.vehicle, boxed=True))},
            span=(lowest_m(self.vehicle.view), FAR_M[1]),
            gap=Gap(column="lead_gap_m", threshold=distances.close_m, unit="m"),
            settings={
                "stop_m": distances.stop_m,
                "close_m": distances.close_m,
                "free_m": distances.free_m,
                "side_clear_m": [-distances.behind_m, distances.ahead_m],
            },
        )

    def versions(self) -> dict[str, str]:
        """Return the version of numpy; the rest of this world is part of eyechart."""
        return versions_of(("numpy",))
