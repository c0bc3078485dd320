"""Pictures in which one thing alone is moved: the lead over the whole range, or a vehicle beside in its place.

Those of the simulated world are its readings. Those of a simulator are rendered anew, from seeds that no bank of a run
has, and read from their pixels as the known-answer controllers read.
"""

import math
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from adversary_door import looks
from eyechart.frames import RGB, encode
from eyechart.models.scripted import PerceivedPicture, see
from eyechart.perception.renderer import HighwayReading
from eyechart.simulators import open_bank_simulator
from eyechart.simulators.banks import BOXED, BankMaker, Moment
from eyechart.simulators.road import staged_moments
from eyechart.spaces.scene import CLEAR_AHEAD_M, CLEAR_BEHIND_M, Other
from eyechart_organisms.calibration.world import LANE_M, SETTINGS, SPAN, make_world
from newcomers import Painted, paint

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Seen = tuple[PerceivedPicture, Mapping[str, str]]
"""What is seen in a picture, and what rules of its pixels answer."""
Draw = Callable[[float], Seen | None]
"""What is seen with the lead at a distance, None where it cannot stand there."""
Exchange = Callable[[float], Sequence[Seen | None]]
"""What is seen with the lead at a distance, a vehicle beside as far away, and neither; None where there is no room."""

SIMULATED = "simulated"
DISTANCES, CURVE = 17, 81
EXCHANGED = (0.19, 0.44, 0.65, 0.78)
"""Where in the range, by its logarithm, the exchange is: at 8, 15, 25 and 35 m of 5 to 60."""
IN_SCENARIO, IN_CURVE = 18, 7
"""Frames of each scenario, and of how many of them the curve is."""
SEEDS = (990_001, 990_002, 990_003)


@dataclass
class Pictures:
    """What is seen, and where among it stand the pictures of each frame: -1 where there is none.

    ``grid`` has shape (frames, 17), ``curve`` (some frames, 81), ``exchange`` (4, frames, 3) with lead, beside and
    neither. ``places`` says of each frame what it belongs to, and ``looked`` what rules of the pixels answer to each.
    """

    sights: list[PerceivedPicture] = field(default_factory=list)
    places: list[Mapping[str, str]] = field(default_factory=list)
    rows: list[list[int]] = field(default_factory=list)
    curves: list[list[int]] = field(default_factory=list)
    of_curve: list[int] = field(default_factory=list)
    pairs: list[list[list[int]]] = field(default_factory=list)
    looked: list[Mapping[str, str]] = field(default_factory=list)

    @property
    def grid(self) -> Ints:
        """Return the pictures over the range by frame."""
        return np.array(self.rows)

    @property
    def curve(self) -> Ints:
        """Return those of a finer range."""
        return np.array(self.curves)

    @property
    def exchange(self) -> Ints:
        """Return those of the exchange, by place in the range and frame."""
        return np.array(self.pairs).transpose(1, 0, 2)

    def add(self, seen: Seen | None) -> int:
        """Take a picture in; returns its number."""
        if seen is None:
            return -1
        self.sights.append(seen[0])
        self.looked.append(seen[1])
        return len(self.sights) - 1

    def frame(self, span: tuple[float, float], place: Mapping[str, str], draw: Draw, exchange: Exchange) -> bool:
        """Take a frame in, if its lead can stand all over the range; returns whether it did."""
        row = [draw(one) for one in spread(span, DISTANCES)]
        if any(one is None for one in row):
            return False
        self.rows.append([self.add(one) for one in row])
        self.places.append(place)
        if sum(self.places[number]["scenario"] == place["scenario"] for number in self.of_curve) < IN_CURVE:
            self.of_curve.append(len(self.places) - 1)
            self.curves.append([self.add(draw(one)) for one in spread(span, CURVE)])
        low, high = span
        found = [exchange(low * (high / low) ** share) for share in EXCHANGED]
        self.pairs.append([[self.add(one) for one in three] for three in found])
        return True


def spread(span: tuple[float, float], count: int) -> list[float]:
    """Return distances of equal ratio over a range, a little within its ends."""
    return [float(one) for one in np.geomspace(1.04 * span[0], 0.977 * span[1], count)]


def pictures_of(world: str, folder: Path) -> Pictures:
    """Return the pictures of a world; those that are rendered are made once and kept in a folder."""
    if world == SIMULATED:
        return simulated()
    file = folder / f"pictures-{world}.pickle"
    if file.is_file():
        pictures: Pictures = pickle.loads(file.read_bytes())  # noqa: S301 - written below
        return pictures
    result = rendered(world)
    file.write_bytes(pickle.dumps(result))
    return result


def simulated() -> Pictures:
    """Return the pictures of a simulated world."""
    world, result = make_world(SETTINGS["frames_288"], np.random.default_rng(95)), Pictures()
    rng = np.random.default_rng(96)
    shown = [
        (frame, one.sight.reading)
        for frame, one in zip(world.frames, world.shown["real"], strict=True)
        if one is not None
        and isinstance(one.sight.reading, HighwayReading)
        and one.sight.reading.scene.gap_m is not None
    ]
    for frame, reading in shown[::3]:
        place = {"scenario": frame.scenario, "lanes": str(frame.strata["lanes"]), "lead_colour": paint(reading)}
        far = float(rng.uniform(50, 60)), float(rng.uniform(50, 60)), float(rng.choice([-LANE_M, LANE_M]))
        result.frame(SPAN, place, partial(_put, reading), partial(_exchange, reading, far))
    return result


def _put(one: HighwayReading, lead_m: float, beside: Other | None = None) -> Seen:
    """Return a frame with its lead at a distance, and a vehicle beside in the place of those that there are."""
    others = [other for other in one.others if other.aside_m and (beside is None or other.aside_m != beside.aside_m)]
    others += [Other(lead_m, 0.0), *([] if beside is None else [beside])]
    left, right = (
        not any(-CLEAR_BEHIND_M <= it.ahead_m <= CLEAR_AHEAD_M for it in others if it.aside_m * side > 0)
        for side in (-1, 1)
    )
    scene = replace(one.scene, gap_m=lead_m, left_clear=left, right_clear=right)
    return PerceivedPicture("road", replace(one, scene=scene, others=tuple(sorted(others)))), {}


def _exchange(one: HighwayReading, far: tuple[float, float, float], at_m: float) -> list[Seen | None]:
    lead_m, beside_m, aside_m = far
    away = Other(beside_m, aside_m)
    abreast = Other(math.sqrt(at_m**2 - aside_m**2), aside_m)
    return [_put(one, at_m, away), _put(one, lead_m, abreast), _put(one, lead_m, away)]


def rendered(simulator: str) -> Pictures:
    """Return the pictures of a simulator, rendered anew and read from their pixels."""
    maker, result = open_bank_simulator(simulator), Pictures()
    assert isinstance(maker, BankMaker)
    preset = maker.open_preset("balanced")
    assert preset.span is not None
    stage = preset.staging(BOXED)[1]
    for number, scenario in enumerate(preset.scenarios):
        taken, moments = 0, (moment for seed in SEEDS for moment in stage(scenario, seed, 12))
        for step, moment in enumerate(moments):
            colour = moment.strata.get("lead_colour")
            if colour is None or taken >= IN_SCENARIO:
                continue
            place = {"scenario": scenario, **{name: str(value) for name, value in moment.strata.items()}}
            rng, of = np.random.default_rng([number, step]), partial(_read, 1000.0 * number + step + 1, str(colour))
            draw, exchange = (_on_highway if simulator == "highway" else _on_road)(moment, rng)
            taken += result.frame(preset.span, place, partial(_one, draw, of), partial(_three, exchange, of))
    return result


Drawing = Callable[[float], RGB | None]
Drawings = Callable[[float], dict[str, RGB] | None]


def _on_highway(moment: Moment, rng: np.random.Generator) -> tuple[Drawing, Drawings]:
    """Return how a moment of the highway is drawn with its lead elsewhere, and with the exchange."""
    from eyechart.simulators.highway import counterfactuals as way  # noqa: PLC0415 - highway-env is slow to import

    assert isinstance(moment.ranged, partial)
    world, camera = moment.ranged.args
    draw = partial(way._draw_with_lead_at, world, camera)  # noqa: SLF001 - as the bank's pictures are drawn
    return draw, partial(way._exchange_at, world, camera, way.find_lead(world), rng)  # noqa: SLF001 - as above


def _on_road(moment: Moment, rng: np.random.Generator) -> tuple[Drawing, Drawings]:
    """Return the same of a moment of the rover or the drone."""
    assert isinstance(moment.ranged, partial)
    (world,) = moment.ranged.args
    draw = partial(staged_moments._draw_with_lead_at, world)  # noqa: SLF001 - as the bank's pictures are drawn
    return draw, partial(staged_moments._exchange_at, world, staged_moments.find_lead(world), rng)  # noqa: SLF001 - as above


def _read(number: float, colour: str, pixels: RGB) -> Seen | None:
    """Return what is seen in a rendered picture; None where its reader sees no road."""
    picture = encode(pixels)
    sight = see(picture)
    if sight.reading is None:
        return None
    return replace(sight, reading=Painted.of(sight.reading, number, colour)), looks(picture)


def _one(draw: Drawing, of: Callable[[RGB], Seen | None], at_m: float) -> Seen | None:
    return None if (pixels := draw(at_m)) is None else of(pixels)


def _three(exchange: Drawings, of: Callable[[RGB], Seen | None], at_m: float) -> list[Seen | None]:
    drawn = exchange(at_m) or {}
    return [
        of(drawn[name]) if name in drawn else None for name in ("exchange_own", "exchange_beside", "exchange_apart")
    ]
