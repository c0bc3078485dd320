"""Moments of the forward worlds as an annotator would write them down, and their rendered truth."""

import csv
import json
import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import eyechart.simulators.drone as drones
import eyechart.simulators.rover as rovers
from edited_controllers import widest
from eyechart.edits import EditLimits, EditResult, EditSource, Moves, edit_photographs, read_annotations
from eyechart.edits.controls import Editor
from eyechart.frames import RGB
from eyechart.perception.forward import read_forward
from eyechart.seeds import key_seed
from eyechart.simulators.plan import make_plan
from eyechart.simulators.road import staged_moments as staged
from eyechart.simulators.road.layout import FAMILIES, TRACKS_M, Obstacle
from eyechart.simulators.road.truth import ahead, find_lead
from eyechart.simulators.road.world import AnyWorld, draw

VEHICLES = {"rover": rovers.Rover.vehicle, "drone": drones.Drone.vehicle}
LANE_M = TRACKS_M[1] - TRACKS_M[0]


@dataclass(frozen=True)
class Seen:
    """A thing of a moment: the mask of what is seen of it, and its distance to its near side."""

    mask: NDArray[np.bool_]
    gap_m: float
    obstacle: Obstacle


@dataclass(frozen=True)
class Moment:
    """A moment with its picture, its lead, what else is seen, the own hood, and the vanishing column."""

    name: str
    family: str
    episode: str
    step: int
    world: AnyWorld
    picture: RGB
    lead: Seen | None
    others: tuple[Seen, ...]
    hood: NDArray[np.bool_]
    column: float

    @property
    def file(self) -> str:
        """Return the name of its picture."""
        return f"{self.name}.png"

    @property
    def free_sides(self) -> str:
        """Return the sides on which a way is free as far as one sees."""
        world = self.world
        sides = [
            side
            for side, to_left in (("left", 1), ("right", -1))
            if 0 <= world.track + to_left < len(TRACKS_M)
            and not any(
                abs(one.obstacle.y - TRACKS_M[world.track + to_left]) < 0.9 and one.gap_m < 30 for one in self.others
            )
        ]
        return " ".join(sides)

    def rendered(self, gap_m: float | None) -> RGB | None:
        """Return the rendered picture with the lead at a gap, or away; None where it has no room."""
        assert self.lead is not None
        rest = [one for one in self.world.layout.obstacles if one is not self.lead.obstacle]
        if gap_m is None:
            return draw(staged._with(self.world, *rest))
        moved = staged._at_gap(self.world, self.lead.obstacle, gap_m)
        if any(staged._overlaps(moved, one) for one in rest):
            return None
        return draw(staged._with(self.world, moved, *rest))

    def exchanged(self, lead: tuple[float, float], beside: tuple[float, float]) -> RGB:
        """Return the rendered picture with two copies of the lead, each at (gap, metres to the left)."""
        assert self.lead is not None
        own = self.lead.obstacle
        rest = [one for one in self.world.layout.obstacles if one is not own]
        two = (replace(staged._at_gap(self.world, own, gap), y=own.y + left) for gap, left in (lead, beside))
        return draw(staged._with(self.world, *two, *rest))


def differ(one: RGB, other: RGB) -> NDArray[np.bool_]:
    """Return where two pictures differ by more than two levels."""
    return widest(np.abs(one.astype(np.int16) - other)) > 2


@cache
def moments(name: str, count: int, seeds: tuple[int, ...] = (0, 1, 2), steps: int = 12) -> tuple[Moment, ...]:
    """Return so many moments of a world that have a lead in sight, spread over its families."""
    each = [_visible(name, family, seed, steps) for family in FAMILIES for seed in seeds]
    found: list[Moment] = []
    while len(found) < count and each:
        for one in list(each):
            following = next(one, None)
            if following is None:
                each.remove(one)
            elif len(found) < count:
                found.append(following)
    return tuple(found)


def _visible(name: str, family: str, seed: int, steps: int) -> Iterator[Moment]:
    vehicle = VEHICLES[name]
    rng = np.random.default_rng(key_seed(vehicle.view, "balanced", family, seed))
    for step, wish in enumerate(make_plan(staged._LANES, staged.GAPS, steps, rng)):
        world = staged._set_up(vehicle, family, wish, rng)
        found = moment_of(f"{family}-{seed}-{step:02d}".replace(" ", "_"), family, f"{family}-{seed}", step, world)
        if found.lead is not None and found.lead.mask.sum() >= 30 and found.lead.gap_m < world.view.view_ahead_m:
            yield found


def moment_of(name: str, family: str, episode: str, step: int, world: AnyWorld) -> Moment:
    """Return a world's moment; masks are where the picture differs from the one without the thing."""
    picture, lead = draw(world), find_lead(world)

    def seen(thing: Obstacle) -> Seen:
        rest = [one for one in world.layout.obstacles if one is not thing]
        gap_m = max(thing.x - thing.radius - world.state.x, 0.05)
        return Seen(differ(picture, draw(staged._with(world, *rest))), gap_m, thing)

    others = [seen(one) for one in ahead(world) if one is not lead]
    return Moment(
        name,
        family,
        episode,
        step,
        world,
        picture,
        None if lead is None else seen(lead),
        tuple(one for one in others if one.mask.sum() > 3),
        differ(draw(world, red=True), picture),
        world.view.width / 2 + world.view.focal_px * math.tan(world.state.yaw),
    )


def gap_in(picture: RGB, moment: Moment) -> float | None:
    """Return the gap that the independent reader sees."""
    found = read_forward(picture, moment.world.view)
    return None if found is None else found.scene.gap_m


def box_of(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """Return the box of a mask, half open."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def write(folder: Path, found: tuple[Moment, ...], *, horizon: bool = True) -> tuple[Path, Path, Path]:
    """Write the pictures, masks, photos.csv and objects.csv of moments; return folder and tables."""
    photos, objects = folder / "photos.csv", folder / "objects.csv"
    (folder / "photos").mkdir(parents=True)
    with photos.open("w", newline="") as one, objects.open("w", newline="") as other:
        table, things = csv.writer(one), csv.writer(other)
        table.writerow(["file", "episode", "step", "scenario", "horizon", "vanishing", "beside"])
        things.writerow(["file", "role", "x0", "y0", "x1", "y1", "distance_m", "mask"])
        for moment in found:
            Image.fromarray(moment.picture).save(folder / "photos" / moment.file, compress_level=1)
            row = moment.world.view.horizon if horizon else ""
            table.writerow(
                [moment.file, moment.episode, moment.step, moment.family, row, moment.column, moment.free_sides]
            )
            assert moment.lead is not None
            listed = [("lead", moment.lead.mask, moment.lead.gap_m), ("own", moment.hood, "")]
            listed += [("", one.mask, one.gap_m) for one in moment.others]
            for number, (role, mask, gap_m) in enumerate(listed):
                name = f"{moment.name}-{number}.mask.png"
                Image.fromarray(mask.astype(np.uint8) * 255).save(folder / name)
                things.writerow([moment.file, role, *box_of(mask), gap_m, name])
    return folder / "photos", photos, objects


LIMITS = EditLimits(least_px=5, above=0.6)
"""The worlds are plain: a small cut-out and the sky behind one lose nothing."""

LEADS = {"lead_near": "lead_near_m", "lead_far": "lead_far_m", "lead_drawn": "lead_drawn_m"}
EXCHANGES = ("exchange_own", "exchange_beside", "exchange_apart")


@dataclass(frozen=True)
class Pair:
    """An edited folder, the rendered one with equal cells, and the moments by file."""

    edited: Path
    rendered: Path
    moments: dict[str, Moment]

    @property
    def tables(self) -> tuple[Path, Path]:
        """Return the table of the edited and of the rendered folder."""
        return self.edited / "table.csv", self.rendered.with_suffix(".csv")

    def rows(self) -> list[dict[str, str]]:
        """Return the rows of the edited table."""
        with self.tables[0].open() as file:
            return list(csv.DictReader(file))

    def moment(self, row: dict[str, str]) -> Moment:
        """Return a row's moment."""
        return self.moments[row["file"].removeprefix("taken/")]


def pixels(path: Path) -> RGB:
    """Return a picture's pixels."""
    return np.asarray(Image.open(path).convert("RGB"))


def rendered_of(moment: Moment, name: str, copies: Sequence[dict[str, float]]) -> RGB | None:
    """Return the rendered picture of what an edit made; None where the world has no room."""
    if name == "lead_absent":
        return moment.rendered(None)
    if name == "patched":  # nothing is edited
        return None
    if name == "file":
        return moment.picture
    if name in LEADS:
        return moment.rendered(copies[0]["distance_m"])
    one, other = ((copy["distance_m"], copy["left_m"]) for copy in copies)
    return moment.exchanged(one, other)


def edit(source: EditSource, moves: Moves, out: Path, *, of_lead: bool = False) -> EditResult:
    """Edit photographs without drawing the sheets that people look at, which takes a fifth of the time.

    ``of_lead`` leaves out the exchanged and patched pictures, where a test reads those of the moved lead alone.
    """
    with ExitStack() as stack:
        stack.enter_context(patch("eyechart.edits.edit.draw_sheet", lambda _, file, **__: file.touch()))
        for name in ("_exchange", "_patch") if of_lead else ():
            stack.enter_context(patch.object(Editor, name))
        return edit_photographs(source, moves, out)


def write_pair(folder: Path, found: tuple[Moment, ...]) -> Pair:
    """Write moments edited, and rendered with the lead at the same places, with equal tables."""
    photos, table, objects = write(folder, found)
    source = EditSource(photos, read_annotations(photos, table, objects), folder)
    moves = Moves((2.6, 4.4), (18, 27), LANE_M, found[0].world.view.eye_m, limits=LIMITS)
    edit(source, moves, folder / "edited")
    pair = Pair(folder / "edited", folder / "rendered", {one.file: one for one in found})
    copies = json.loads((folder / "edited" / "edit.json").read_text())["copies"]
    rows = pair.rows()
    for row in rows:
        moment = pair.moment(row)
        for name in ("file", *LEADS, *EXCHANGES, "lead_absent", "patched"):
            if row[name]:
                drawn = rendered_of(moment, name, copies.get(moment.file, {}).get(name, ()))
                if drawn is None:
                    row[name] = ""
                    continue
                (pair.rendered / row[name]).parent.mkdir(parents=True, exist_ok=True)
                Image.fromarray(drawn).save(pair.rendered / row[name], compress_level=1)
    with pair.tables[1].open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return pair
