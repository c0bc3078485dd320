"""A simulated world: frames of autocorrelated episodes, and each condition's content.

No picture is drawn. The reading of the image-only reader is simulated, and scripted controllers
decide on it as on a picture's. A setting is a kind of bank: its episodes and what it lacks. Every
constant is in docs/calibration.md.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eyechart.conditions import ABSENT, AGAIN, RANGED
from eyechart.frames import EXCHANGE, LEAD, MAIN, Frame, Scalar, Span, alone, draws_of
from eyechart.models.scripted import PerceivedPicture
from eyechart.perception.renderer import HighwayReading
from eyechart.spaces.scene import CLEAR_AHEAD_M, CLEAR_BEHIND_M, Other, Scene

Episode = tuple[str, int]
"""An episode's scenario, and its number of frames."""


@dataclass(frozen=True, slots=True)
class ScenarioRoad:
    """The content of a scenario's pictures: lanes, a ramp, and the median gap in metres."""

    lanes: int
    ramp: bool
    median_gap_m: float


ROADS: Mapping[str, ScenarioRoad] = {
    "light": ScenarioRoad(4, False, 26.0),
    "dense": ScenarioRoad(3, False, 19.0),
    "merge": ScenarioRoad(3, True, 15.0),
    "blocked": ScenarioRoad(2, False, 12.0),
}
"""The scenarios; their gaps differ, so knowing the scenario looks like reading the distance."""

FEWEST_FRAMES, MOST_FRAMES = 8, 40
"""The lengths of episodes in the setting ``unequal``."""


@dataclass(frozen=True, slots=True)
class Setting:
    """A kind of bank, with ``episodes`` per scenario and ``frames`` per episode.

    With 0 episodes there are one to three in all. ``exchanges`` says whether the episodes suffice
    to test the gap without counterfactuals. ``lowest`` says whether ``lead_near`` shows the nearest
    possible lead.
    """

    name: str
    says: str
    scenarios: int = 4
    episodes: int = 3
    frames: int = 12
    gaps: bool = True
    ordered: bool = False
    exchanges: bool = True
    lowest: bool = False

    def draw(self, rng: np.random.Generator) -> list[Episode]:
        """Return the episodes of one bank."""
        names = tuple(ROADS)[: self.scenarios]
        if self.episodes:
            return [(name, self.frames) for name in names for _ in range(self.episodes)]
        count = int(rng.integers(1, 4))
        lengths = rng.choice(np.arange(FEWEST_FRAMES, MOST_FRAMES + 1), size=count, replace=False)
        return [(names[int(rng.integers(len(names)))], int(length)) for length in lengths]


SETTINGS: Mapping[str, Setting] = {
    setting.name: setting
    for setting in (
        Setting("default", "4 scenarios, 12 episodes of 12 frames"),
        Setting("unequal", "1 to 3 episodes of unequal length (8 to 40 frames)", episodes=0, exchanges=False),
        Setting("short_48", "48 episodes of 3 frames", episodes=12, frames=3),
        Setting("no_gaps", "as default, and the bank records no gap", gaps=False, exchanges=False),
        Setting("one_scenario", "12 episodes of 12 frames in one scenario", scenarios=1, episodes=12),
        Setting("ordered", "as default, and the gap closes all through every episode", ordered=True),
        Setting("small_10", "2 episodes of 5 frames", scenarios=2, episodes=1, frames=5, exchanges=False),
        Setting("small_24", "4 episodes of 6 frames", scenarios=2, episodes=2, frames=6, exchanges=False),
        Setting("frames_48", "4 episodes of 12 frames", episodes=1, exchanges=False),
        Setting("frames_96", "8 episodes of 12 frames", episodes=2, exchanges=False),
        Setting("frames_288", "24 episodes of 12 frames", episodes=6),
    )
}

POWER = ("small_10", "small_24", "frames_48", "frames_96", "default", "frames_288")
"""The settings that differ in size alone, from the smallest."""


GAP_AR = 0.85
"""Correlation of the log gap between neighbouring frames of an episode."""
GAP_LOG_SD = 0.7
EPISODE_SHARE = 0.2
"""The share of the log gap's variance that is common to an episode."""
NEAREST_M, FARTHEST_M = 5.0, 76.0
"""The smallest gap, and the largest: a lead beyond the picture's edge is no lead."""

SIDE_STAYS = 0.7
"""Chance that a side stays as it is; half of the sides are clear."""
PHASE_DRIFT, PHASE_SD = 0.06, 0.03
"""Drift and deviation of the lane markings' phase, in periods per frame."""

NEAR_M, FAR_M = (7.0, 9.0), (50.0, 60.0)
"""The distances of ``lead_near`` and ``lead_far`` in metres."""

SPAN: Span = (NEAREST_M, FAR_M[1])
"""The range of ``lead_drawn`` in metres, uniform in the logarithm."""

LANE_M = 4.0
"""A lane's width in metres."""

NO_PICTURE, UNIFORM, NOISE = (
    PerceivedPicture("no_picture", None),
    PerceivedPicture("uniform", None),
    PerceivedPicture("unknown", None),
)


@dataclass(frozen=True, slots=True)
class SimulatedView:
    """The stimulus of one frame: the sight, and the passed share of its episode; None: no road."""

    sight: PerceivedPicture
    passed: float | None


@dataclass(frozen=True)
class World:
    """Frames with ground truth, and each condition's content; None where it shows nothing."""

    frames: tuple[Frame, ...]
    passed: tuple[float, ...]
    shown: Mapping[str, tuple[SimulatedView | None, ...]]


def make_world(setting: Setting, rng: np.random.Generator) -> World:
    """Draw one bank of a setting and all its content, equal for all controllers."""
    episodes = setting.draw(rng)
    frames: list[Frame] = []
    passed: list[float] = []
    readings: list[HighwayReading] = []
    apart, anew = rng.spawn(2)  # separate streams for later additions keep older draws as they were
    for number, episode in enumerate(episodes):
        scenario, length = episode
        gaps = _gaps(episode, rng, ordered=setting.ordered)
        phases = _phases(length, rng)
        left, right = _side(length, rng), _side(length, rng)
        for step in range(length):
            gap_m = None if gaps[step] > FARTHEST_M else round(float(gaps[step]), 3)
            name = f"{scenario}-{number}"
            road, scene = ROADS[scenario], Scene(gap_m, bool(left[step]), bool(right[step]))
            lane, _ = road.lanes // 2, apart.random(2)  # two older distances
            truth: dict[str, Scalar] = {
                "lead_gap_m": gap_m,
                "left_clear": scene.left_clear,
                "right_clear": scene.right_clear,
                "ego_lane": lane,
                "lanes": road.lanes,
            }
            place, strata = (f"{name}-{step:02d}", scenario, name, step), {"lanes": road.lanes}
            frames.append(Frame(*place, alone("vertical"), {MAIN: "-"}, truth, strata=strata))
            passed.append(step / length)
            others = _others(scene, apart)
            readings.append(HighwayReading(scene, "green", road.lanes, lane, others, float(phases[step]), road.ramp))
    shown = _shown(frames, passed, readings, rng)
    if setting.lowest:
        shown["lead_near"] = _on_road([_moved(reading, NEAREST_M) for reading in readings], passed)
    frames, more = _ranged(frames, shown, readings, anew)
    shown |= {name: _on_road(column, passed) for name, column in more.items()}
    filed = {name: _filed(name, column, frames) for name, column in shown.items()}
    beside = zip(filed["real"], filed[ABSENT], strict=True)
    filed[AGAIN] = tuple(one if absent is not None else None for one, absent in beside)
    return World(tuple(frames), tuple(passed), filed)


def _others(scene: Scene, rng: np.random.Generator) -> tuple[Other, ...]:
    """Return the vehicles on the road: the lead, those that block a side, and some farther away."""
    found = [] if scene.gap_m is None else [Other(scene.gap_m, 0.0)]
    for clear, aside in ((scene.left_clear, -LANE_M), (scene.right_clear, LANE_M)):
        place, far, seen = rng.uniform(-10.0, 38.0), rng.uniform(43.0, 76.0), rng.uniform() < 1 / 2
        if not clear:
            found.append(Other(float(place), aside))
        elif seen:
            found.append(Other(float(far), aside))
    return tuple(sorted(found))


def _filed(
    name: str, column: Sequence[SimulatedView | None], frames: Sequence[Frame]
) -> tuple[SimulatedView | None, ...]:
    """Return the content with stand-ins for files: one per picture, one for all blank ones."""

    def file(view: SimulatedView, frame: Frame) -> bytes:
        if view.sight.kind in {"uniform", "no_picture"}:
            return view.sight.kind.encode()
        return f"{frame.id}/{name}".encode()

    return tuple(
        None if view is None else replace(view, sight=replace(view.sight, file=view.sight.file or file(view, frame)))
        for view, frame in zip(column, frames, strict=True)
    )


def _ranged(
    frames: Sequence[Frame],
    shown: Mapping[str, Sequence[SimulatedView | None]],
    readings: Sequence[HighwayReading],
    rng: np.random.Generator,
) -> tuple[list[Frame], dict[str, list[HighwayReading | None]]]:
    """Return the frames with distances over the whole range, and their control pictures."""
    there = [frame.id for frame, one in zip(frames, readings, strict=True) if one.scene.gap_m is not None]
    draws = draws_of(int(rng.integers(2**63)), SPAN, there)
    found, columns = [], {name: list[HighwayReading | None]() for name in RANGED}
    ends = {name: _gaps_shown(shown[name]) for name in ("lead_near", "lead_far")}
    for number, (frame, one) in enumerate(zip(frames, readings, strict=True)):
        if frame.id not in draws:
            for column in columns.values():
                column.append(None)
            found.append(frame)
            continue
        lead_m = next(iter(draws[frame.id].lead()))
        exchange_m = next(iter(draws[frame.id].exchange(lead_m)))
        for name, reading in _at(one, lead_m, exchange_m, rng).items():
            columns[name].append(reading)
        columns["lead_near_nudged"].append(_moved(one, ends["lead_near"][number]))
        placed = {LEAD: lead_m, EXCHANGE: exchange_m} | {f"{name}_m": ends[name][number] for name in ends}
        found.append(replace(frame, truth={**frame.truth, **placed}, placed=frozenset(placed)))
    return found, columns


def _at(
    reading: HighwayReading, lead_m: float, exchange_m: float, rng: np.random.Generator
) -> dict[str, HighwayReading | None]:
    """Return the control pictures of a frame with a lead, at its two distances of the range."""
    beside = [other for other in reading.others if other.aside_m] or [
        Other(FAR_M[1], float(rng.choice([-LANE_M, LANE_M])))
    ]
    other, far, its_far = beside[int(rng.integers(len(beside)))], rng.uniform(*FAR_M), rng.uniform(*FAR_M)
    alone, own = _moved(reading, lead_m), _exchanged(reading, other, exchange_m, its_far)
    return {
        "lead_drawn": alone,
        "lead_drawn_nudged": alone,
        "exchange_own": own,
        "exchange_own_nudged": own,
        "exchange_beside": _exchanged(reading, other, far, math.sqrt(exchange_m**2 - LANE_M**2)),
        "exchange_apart": _exchanged(reading, other, far, its_far),
    }


def _gaps_shown(column: Sequence[SimulatedView | None]) -> list[float | None]:
    """Return the gap in each picture of a road; None without a lead or road."""
    readings = [None if view is None else view.sight.reading for view in column]
    return [None if reading is None else reading.scene.gap_m for reading in readings]


def _on_road(readings: Sequence[HighwayReading | None], passed: Sequence[float]) -> tuple[SimulatedView | None, ...]:
    """Return pictures of roads with the passed share of the episode; None without a road."""
    pairs = zip(readings, passed, strict=True)
    return tuple(None if one is None else SimulatedView(PerceivedPicture("road", one), time) for one, time in pairs)


def _gaps(episode: Episode, rng: np.random.Generator, *, ordered: bool) -> NDArray[np.float64]:
    """Return an episode's gaps in metres: a stationary AR(1) process of their logarithm."""
    scenario, length = episode
    noise = rng.standard_normal(length)
    path = np.empty(length)
    path[0] = noise[0]
    for step in range(1, length):
        path[step] = GAP_AR * path[step - 1] + math.sqrt(1 - GAP_AR**2) * noise[step]
    own = math.sqrt(EPISODE_SHARE) * rng.standard_normal() + math.sqrt(1 - EPISODE_SHARE) * path
    gaps = np.maximum(ROADS[scenario].median_gap_m * np.exp(GAP_LOG_SD * own), NEAREST_M)
    return np.asarray(np.sort(gaps)[::-1] if ordered else gaps)


def _phases(length: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the phase of the lane markings, in [0, 1): a drift with noise from a random start."""
    moves = rng.normal(PHASE_DRIFT, PHASE_SD, size=length)
    return np.asarray((rng.uniform() + np.cumsum(moves)) % 1.0)


def _side(length: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return whether one side is clear in each frame: a two-state chain."""
    changes = rng.uniform(size=length) >= SIDE_STAYS
    changes[0] = rng.uniform() < 1 / 2
    return np.asarray(np.cumsum(changes) % 2 == 1)


def _shown(
    frames: Sequence[Frame], passed: Sequence[float], readings: Sequence[HighwayReading], rng: np.random.Generator
) -> dict[str, tuple[SimulatedView | None, ...]]:
    """Return each condition's content, without conditions that the bank cannot supply."""
    roads = [
        SimulatedView(PerceivedPicture("road", reading, f"{frame.id}/real".encode()), time)
        for frame, reading, time in zip(frames, readings, passed, strict=True)
    ]

    def all_of(sight: PerceivedPicture) -> tuple[SimulatedView, ...]:
        return (SimulatedView(sight, None),) * len(roads)

    scenarios = np.array([frame.scenario for frame in frames])
    shown: dict[str, tuple[SimulatedView | None, ...]] = {
        "real": tuple(roads),
        "real_repeat": tuple(roads),
        "blank": all_of(UNIFORM),
        "noise": all_of(NOISE),
        "text_only": all_of(NO_PICTURE),
        "mirrored": _on_road([reading.mirrored() for reading in readings], passed),
        "shuffled": tuple(roads[place] for place in _partners(scenarios, rng, same=True)),
        "lead_near": _on_road([_moved(reading, rng.uniform(*NEAR_M)) for reading in readings], passed),
        "lead_far": _on_road([_moved(reading, rng.uniform(*FAR_M)) for reading in readings], passed),
        "recoloured": _on_road([replace(reading, ego_colour="red") for reading in readings], passed),
    }
    if len(set(scenarios.tolist())) > 1:
        shown["cross_scenario"] = tuple(roads[place] for place in _partners(scenarios, rng, same=False))
    without = [None if reading.scene.gap_m is None else _moved(reading, None) for reading in readings]
    return shown | {ABSENT: _on_road(without, passed), "nudged": _on_road(readings, passed)}


def _exchanged(reading: HighwayReading, moved: Other, lead_m: float, beside_m: float) -> HighwayReading:
    """Return the reading with the lead at one distance and a neighbour at another."""
    kept = [one for one in reading.others if one != moved and one.aside_m]
    others = (*kept, Other(lead_m, 0.0), Other(beside_m, moved.aside_m))
    left, right = (
        not any(-CLEAR_BEHIND_M <= one.ahead_m <= CLEAR_AHEAD_M for one in others if one.aside_m == aside)
        for aside in (-LANE_M, LANE_M)
    )
    scene = replace(reading.scene, gap_m=lead_m, left_clear=left, right_clear=right)
    return replace(reading, scene=scene, others=tuple(sorted(others)))


def _partners(scenarios: NDArray[np.str_], rng: np.random.Generator, *, same: bool) -> list[int]:
    """Return for each frame the index of another one in its scenario, or in another scenario."""
    places = np.arange(len(scenarios))
    partners = []
    for place, scenario in enumerate(scenarios):
        others = places[((scenarios == scenario) == same) & (places != place)]
        partners.append(int(others[rng.integers(len(others))]))
    return partners


def _moved(reading: HighwayReading, gap_m: float | None) -> HighwayReading | None:
    """Return the reading with the lead at another gap or gone; None if there is no lead."""
    if reading.scene.gap_m is None:
        return None
    lead = () if gap_m is None else (Other(gap_m, 0.0),)
    others = tuple(sorted((*(one for one in reading.others if one.aside_m), *lead)))
    return replace(reading, scene=replace(reading.scene, gap_m=gap_m), others=others)
