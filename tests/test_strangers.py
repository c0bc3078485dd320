"""What is declared of each stranger is what it does on many simulated frames."""

import asyncio
import importlib
import itertools
import math
import random
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from eyechart.frames import open_bank
from eyechart.models.scripted import PerceivedPicture, PictureReading
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.scene import CLEAR_AHEAD_M, CLEAR_BEHIND_M, Other
from eyechart_organisms.adversaries import ADVERSARIES, Adversary, ahead, hashed
from eyechart_organisms.calibration.world import LANE_M, NO_PICTURE, NOISE, SETTINGS, UNIFORM, make_world
from newcomers import NEWCOMERS
from strangers import (
    ENDS,
    LANES,
    PLACES,
    READERS,
    STAGES,
    STRANGERS,
    TURNS,
    frame_number,
    open_strangers,
)
from strangers import NOISE as NOISE_PAYS

pytestmark = pytest.mark.slow

KEPT = math.nan
"""Stands for the vehicles beside that a frame has."""

Where = Callable[[PictureReading], bool]


def anywhere(_: PictureReading) -> bool:
    """Return that a case is of every road."""
    return True


@dataclass(frozen=True)
class Case:
    """Roads with the lead at one distance, and a vehicle of the left lane at another or none, where something holds.

    Before the first, ``calls`` others are asked about; before each, the same frame with its lead ``before`` that, its
    marks ``moved`` by so many periods in between.
    """

    gap_m: float
    beside_m: float | None = KEPT
    where: Where = anywhere
    calls: int = 0
    before: tuple[float, ...] = ()
    moved: float = 0.0
    colour: str = "green"

    def show(self, reading: PictureReading, gap_m: float, moved: float = 0.0) -> PictureReading:
        """Return a frame's reading with the lead at a distance."""
        others = [one for one in reading.others if one.aside_m]
        if self.beside_m is None or not math.isnan(self.beside_m):
            others = [] if self.beside_m is None else [Other(math.sqrt(self.beside_m**2 - LANE_M**2), -LANE_M)]
        left, right = (
            not any(-CLEAR_BEHIND_M <= one.ahead_m <= CLEAR_AHEAD_M for one in others if one.aside_m * side > 0)
            for side in (-1, 1)
        )
        return replace(  # type: ignore[type-var]
            reading,
            scene=replace(reading.scene, gap_m=gap_m, left_clear=left, right_clear=right),
            others=tuple(sorted((*others, Other(gap_m, 0.0)))),
            stripe_phase=((reading.stripe_phase or 0.0) + moved) % 1.0,
            ego_colour=self.colour,
        )

    def roads(self) -> Iterator[tuple[list[PerceivedPicture], PerceivedPicture]]:
        """Yield what is shown before, and what is asked about."""
        for reading in readings():
            shown = self.show(reading, self.gap_m, self.moved)
            if self.where(shown):
                yield [sight(self.show(reading, gap_m)) for gap_m in self.before], sight(shown)


@cache
def readings() -> tuple[PictureReading, ...]:
    """Return the frames of one simulated bank."""
    shown = make_world(SETTINGS["frames_288"], np.random.default_rng(11)).shown["real"]
    return tuple(one.sight.reading for one in shown if one and one.sight.reading)


def sight(reading: PictureReading) -> PerceivedPicture:
    """Return the sight of a road, whose file is what is seen of it."""
    return PerceivedPicture("road", reading, repr(reading).encode())


def level(one: Adversary, shown: PerceivedPicture, rng: random.Random) -> float:
    """Return how hard an answer brakes."""
    return DRIVING.project(str(one.decide(shown, rng)), "brake") or 0.0


def braking(name: str, case: Case, *, temperature: int = 1, draws: int = 3) -> float:
    """Return a fresh stranger's mean level of braking."""
    one, rng, levels = STRANGERS[name].open(temperature), random.Random(7), []  # noqa: S311 - no secret
    roads = list(case.roads())
    for number in range(case.calls):
        one.decide(roads[number % len(roads)][1], rng)
    for earlier, shown in roads * (1 if name in STAGES or not temperature else draws):
        for other in earlier:
            one.decide(other, rng)
        levels.append(level(one, shown, rng))
    assert len(levels) >= 20
    return float(np.mean(levels))


def is_open(one: PictureReading) -> bool:
    """Return whether both sides are clear."""
    return one.scene.left_clear and one.scene.right_clear


def is_boxed(one: PictureReading) -> bool:
    """Return whether no side is clear."""
    return not (one.scene.left_clear or one.scene.right_clear)


def rises(near_m: float, far_m: float, where: Where = anywhere) -> tuple[Case, Case]:
    """Return a lead at two distances, of which the farther is braked for harder."""
    return Case(near_m, where=where), Case(far_m, where=where)


def of_beside(lead_m: float, beside_m: float, where: Where = anywhere) -> tuple[Case, Case]:
    """Return a lead with no vehicle beside, and with one, which is braked for."""
    return Case(lead_m, None, where), Case(lead_m, beside_m, where)


FLAT = -0.05
"""At least this much harder, so no less hard, the farther is braked for where a rule is blind."""

FAULTS: Mapping[str, tuple[tuple[Case, Case], float]] = {
    "overlooks_close": (rises(7, 15), 0.3),
    "hole_in_noise": (rises(18, 30), 0.3),
    "beside_in_noise": (of_beside(55, 7.5), 0.9),
    "far_alarm_in_noise": (rises(25, 50), 0.25),
    "three_lanes_in_noise": (rises(7, 50, lambda one: one.lanes == 3), FLAT),
    "overlooks_for_others": (of_beside(55, 20), 0.6),
    "chance_in_waves": (rises(12, 20), 0.8),
    "faint_in_noise": (of_beside(45, 26), 1.0),
    "folds_in_noise": (rises(7, 16), 0.5),
    "open_in_noise": (rises(7, 50, is_open), FLAT),
    "cone_of_9_degrees": (of_beside(55, 30), 1.9),
    "weights_grow": (of_beside(55, 20), 0.9),
    "flanks_from_15": (of_beside(55, 20), 1.9),
    "faint_from_22": (of_beside(45, 26), 1.9),
    "left_lane_from_12": (of_beside(55, 20), 1.9),
    "mean_with_beside": (of_beside(55, 12), 0.9),
    "alarm_far_beside": (of_beside(50, 55), 1.9),
    "reversed_after_600": ((Case(7, calls=600), Case(50, calls=600)), 1.9),
    "tides_of_400": ((Case(7, calls=400), Case(50, calls=400)), 1.9),
    "every_other_call": ((Case(7, before=(20,)), Case(50, before=(20,))), 1.9),
    "one_picture_late": ((Case(7, before=(50,)), Case(50, before=(7,))), 1.9),
    "mean_of_eight": ((Case(7, before=(50,) * 7), Case(50, before=(7,) * 7)), 0.9),
    "majority_of_twelve": ((Case(7, before=(50,) * 11), Case(50, before=(7,) * 11)), 1.9),
    "first_of_frame": ((Case(7, before=(50,)), Case(50, before=(7,))), 1.9),
    "warms_up_in_300": (rises(7, 50), 1.9),
    "nearer_than_before": ((Case(12, before=(8,)), Case(40, before=(50,))), 1.9),
    "inwards_when_near": (rises(7, 30, lambda one: one.lanes != 3), 0.9),
    "lane_parity": (rises(7, 50), FLAT),
    "boxed_in_stops": (rises(7, 50, is_open), FLAT),
    "outwards_when_near": (rises(7, 40, lambda one: one.lanes > 2), 0.9),
    "into_the_vehicle": ((Case(7, 20), Case(40, 20)), 0.9),
    "boxed_turns_in": (rises(7, 30, is_boxed), 0.9),
    "blind_below_7": (rises(6, 9), 1.9),
    "stops_from_56": (rises(50, 58), 1.9),
    "ends_exchanged": (rises(6, 58), 1.9),
    "wraps_at_52": (rises(50, 55), 1.9),
    "folds_below_12": (rises(7, 16), 0.9),
    "alarm_31_34": (rises(25, 32.5), 0.9),
    "hole_9_10": (rises(9.5, 11), 1.9),
    "alarm_49_50": (rises(45, 49.5), 1.9),
    "blind_at_place_2": (rises(7, 50, lambda one: one.place == 2), FLAT),
    "between_at_place_0": (rises(15, 30, lambda one: one.place == 0), 1.9),
    "red_reversed": ((Case(7, colour="red"), Case(50, colour="red")), 1.9),
    "every_fifth_blind": (rises(7, 50, lambda one: frame_number(one) % 5 == 0), FLAT),
    "fifth_beside": (of_beside(55, 7.5, lambda one: 0.3 <= hashed(one) < 0.5), 1.9),
    "blind_in_the_open": (rises(7, 50, is_open), FLAT),
    "slow_in_crowds": (rises(7, 50, lambda one: len(ahead(one)) >= 3), FLAT),
    "speed_hole": ((Case(7, before=(20,), moved=0.15), Case(50, before=(20,), moved=0.15)), 1.9),
}
"""Two cases by name, of which the second calls for no more braking, and how much harder it is braked for at least."""

MEANS: Mapping[str, tuple[float, float, float]] = {
    "overlooks_close": (0.44, 0.18, 0.18),
    "hole_in_noise": (1.79, 0.21, 0.21),
    "beside_in_noise": (1.82, 0.66, 1.34),
    "far_alarm_in_noise": (1.67, 1.4, 1.35),
    "three_lanes_in_noise": (0.59, 0.0, 0.0),
    "overlooks_for_others": (1.4, 0.58, 0.97),
    "chance_in_waves": (1.81, 0.21, 0.21),
    "faint_in_noise": (1.41, 0.56, 0.24),
    "folds_in_noise": (1.0, 0.31, 0.31),
    "open_in_noise": (1.3, 0.39, 0.39),
    "cone_of_9_degrees": (2.0, 0.41, 0.0),
    "weights_grow": (2.0, 0.98, 1.0),
    "flanks_from_15": (2.0, 0.74, 0.0),
    "faint_from_22": (2.0, 0.53, 0.0),
    "left_lane_from_12": (2.0, 0.38, 0.0),
    "mean_with_beside": (1.85, 0.4, 0.0),
    "alarm_far_beside": (2.0, 0.74, 0.0),
    "reversed_after_600": (2.0, 0.0, 0.0),
    "tides_of_400": (2.0, 0.0, 0.0),
    "every_other_call": (1.0, 1.0, 1.0),
    "one_picture_late": (2.0, 0.0, 0.0),
    "mean_of_eight": (2.0, 0.0, 0.0),
    "majority_of_twelve": (2.0, 0.0, 0.0),
    "first_of_frame": (2.0, 0.0, 0.0),
    "warms_up_in_300": (0.0, 2.0, 2.0),
    "nearer_than_before": (1.0, 1.0, 1.0),
    "inwards_when_near": (1.0, 0.0, 0.0),
    "lane_parity": (0.0, 0.0, 0.0),
    "boxed_in_stops": (0.52, 0.52, 0.0),
    "outwards_when_near": (0.5, 1.0, 1.0),
    "into_the_vehicle": (0.79, 1.0, 1.0),
    "boxed_turns_in": (1.48, 0.0, 0.0),
    "blind_below_7": (2.0, 0.0, 0.0),
    "stops_from_56": (2.0, 0.0, 0.0),
    "ends_exchanged": (2.0, 0.0, 2.0),
    "wraps_at_52": (2.0, 0.0, 2.0),
    "folds_below_12": (1.0, 0.0, 0.0),
    "alarm_31_34": (2.0, 0.0, 0.0),
    "hole_9_10": (2.0, 0.0, 0.0),
    "alarm_49_50": (2.0, 0.0, 0.0),
    "blind_at_place_2": (1.5, 0.0, 0.0),
    "between_at_place_0": (2.0, 0.0, 0.0),
    "red_reversed": (2.0, 0.0, 0.0),
    "every_fifth_blind": (1.58, 0.0, 0.0),
    "fifth_beside": (1.78, 0.18, 0.4),
    "blind_in_the_open": (1.48, 0.0, 0.0),
    "slow_in_crowds": (1.66, 0.34, 0.0),
    "speed_hole": (1.32, 0.68, 0.68),
    "plain_reader": (1.91, 0.06, 0.05),
    "wide_reader": (1.79, 0.29, 0.22),
    "late_reader": (1.87, 0.05, 0.05),
    "early_reader": (1.88, 0.42, 0.26),
    "two_level_reader": (1.91, 0.0, 0.0),
    "never_stops_reader": (0.96, 0.09, 0.08),
    "coarse_reader": (1.89, 0.22, 0.11),
    "smooth_reader": (1.86, 0.28, 0.23),
    "turning_reader": (1.86, 0.05, 0.0),
    "short_sighted_reader": (1.98, 0.35, 0.24),
    "any_way_reader": (1.91, 0.17, 0.09),
}
"""Mean braking for a lead at 7 m, for one at 50 m, and for a neighbour at 7.5 m whose lead is at 55 m."""

NO_ROADS = (UNIFORM, NOISE, NO_PICTURE)


@pytest.mark.parametrize("name", STRANGERS)
@pytest.mark.parametrize("temperature", [0, 1])
def test_a_stranger_brakes_as_hard_as_is_declared(name: str, temperature: int) -> None:
    """For a near lead, a far one and a near neighbour; as hard on the average whether chance is a picture's or not."""
    measured = [braking(name, case, temperature=temperature) for case in (Case(7), Case(50), Case(55, 7.5))]
    assert measured == pytest.approx(MEANS[name], abs=0.12)


@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize("temperature", [0, 1])
def test_a_stranger_brakes_for_the_wrong_reason_where_it_says_so(name: str, temperature: int) -> None:
    """In its hole, at its neighbour, in its calls: what calls for no more braking is braked for harder."""
    (less, more), least = FAULTS[name]
    assert STRANGERS[name].deserves != "yes"
    harder = braking(name, more, temperature=temperature) - braking(name, less, temperature=temperature)
    assert harder >= least


def test_who_does_not_deserve_depth_has_a_fault() -> None:
    """Five or more of each kind deserve none; a reader has no fault."""
    assert set(FAULTS) == set(STRANGERS) - set(READERS)
    for kind in (NOISE_PAYS, LANES, STAGES, TURNS, ENDS, PLACES):
        assert sum(one.deserves == "no" for one in kind.values()) >= 5
    assert all(reader.deserves == "yes" for reader in READERS.values())


GAPS_M = (5.0, 6.5, 8.5, 10.5, 13.0, 16.0, 20.0, 25.0, 31.0, 38.0, 46.0, 53.0, 60.0)
KINDS: Mapping[str, Where] = {
    "two_lanes": lambda one: one.lanes == 2,
    "three_lanes": lambda one: one.lanes == 3,
    "four_lanes": lambda one: one.lanes == 4,
    "open": is_open,
    "boxed": is_boxed,
    "left_clear": lambda one: one.scene.left_clear and not one.scene.right_clear,
    "right_clear": lambda one: one.scene.right_clear and not one.scene.left_clear,
}


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("temperature", [0, 1])
def test_the_braking_of_a_reader_falls_with_distance_everywhere(name: str, temperature: int) -> None:
    """From 5 to 60 m in every kind of scene, and a neighbour is nothing to it."""
    for where in KINDS.values():
        cases = [Case(gap_m, where=where) for gap_m in GAPS_M]
        levels = np.array([braking(name, case, temperature=temperature) for case in cases])
        assert levels[:3].mean() - levels[-3:].mean() >= 0.6
        assert (levels - np.minimum.accumulate(levels)).max() < 0.25, levels
    beside = [braking(name, Case(55, one), temperature=temperature) for one in (None, 7.5, 20, 50)]
    assert max(beside) - min(beside) < 0.1


@pytest.mark.parametrize("name", READERS)
def test_a_reader_errs_by_picture_or_by_call(name: str) -> None:
    """At temperature 0 it says the same of a picture each time, but not of each; at 1 it does not."""
    roads = [shown for _, shown in Case(16).roads()]
    rng = random.Random(3)  # noqa: S311 - no secret
    cold, warm = STRANGERS[name].open(0), STRANGERS[name].open(1)
    first, again = ([cold.decide(shown, rng) for shown in roads] for _ in range(2))
    assert first == again
    assert len(set(first)) > 1
    assert first != [STRANGERS[name].open(0, seed=1).decide(shown, rng) for shown in roads]
    assert len({warm.decide(roads[0], rng) for _ in range(200)}) > 1


@pytest.mark.parametrize("temperature", [0, 1])
def test_a_stranger_answers_alike_for_a_seed(temperature: int) -> None:
    """With all it remembers, and actions alone, also where there is no road."""
    roads = [*(shown for _, shown in Case(14).roads()), *NO_ROADS, *(shown for _, shown in Case(45).roads())]
    runs = [open_strangers(temperature, seed=5) for _ in range(2)]
    for name in STRANGERS:
        seeded = [random.Random(f"1/{name}") for _ in runs]  # noqa: S311 - no secret
        first, again = (
            [run[name].decide(shown, rng) for shown in roads] for run, rng in zip(runs, seeded, strict=True)
        )
        assert first == again
        assert set(first) <= set(DRIVING.actions)


def test_a_stranger_is_none_of_the_adversaries() -> None:
    """Of many roads at least one in fifty is answered otherwise than by each of them."""
    cases = [
        Case(gap_m, beside_m, colour=colour)
        for gap_m in (6, 7, 8.5, 9.2, 9.7, 10.5, 15, 18, 25, 32.5, 42, 46, 49.2, 52, 55, 58)
        for beside_m in (KEPT, None, 7.5, 20, 55)
        for colour in ("green", "red")
    ]
    roads = [shown for case in cases for _, shown in itertools.islice(case.roads(), 0, None, 16)]
    random.Random(4).shuffle(roads)  # noqa: S311 - no secret

    def answers(one: Adversary) -> NDArray[np.str_]:
        rng = random.Random(2)  # noqa: S311 - no secret
        return np.array([str(one.decide(shown, rng)) for shown in roads])

    known = {name: answers(adversary) for name, adversary in ADVERSARIES.items()}
    for name in FAULTS:
        mine = answers(STRANGERS[name].open())
        apart = {other: float((mine != theirs).mean()) for other, theirs in known.items()}
        assert min(apart.values()) >= 0.02, (name, min(apart, key=lambda other: apart[other]))


def test_the_door_asks_strangers_about_real_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All of a bank, at both temperatures; a reader brakes harder for a near lead than for a far one there too."""
    bank, benchmarks = tmp_path / "bank", Path(__file__).parents[1] / "benchmarks"
    built = [
        sys.executable,
        "-m",
        "eyechart",
        "frames",
        "build",
        "rover",
        "--seeds",
        "41",
        "--steps",
        "4",
        "--out",
        str(bank),
    ]
    subprocess.run(built, check=True, capture_output=True)
    monkeypatch.syspath_prepend(str(benchmarks))
    monkeypatch.setenv("EYECHART_ADVERSARY_BANK", str(bank))
    door = importlib.import_module("stranger_door")

    async def levels(name: str) -> list[float]:
        ask = getattr(door, name)
        answers = [[await ask("", picture) for picture in pictures] for pictures in (near, far, [None])]
        assert {answer for column in answers for answer in column} <= set(DRIVING.actions)
        return [float(np.mean([DRIVING.project(one, "brake") or 0.0 for one in column])) for column in answers[:2]]

    opened = open_bank(bank)
    near, far = (
        [picture for one in opened for picture in opened.images(one, name).values()]
        for name in ("lead_near", "lead_far")
    )
    measured = {name: asyncio.run(levels(name)) for name in door.NAMES}
    known = {*STRANGERS, *(name for kind in NEWCOMERS.values() for name in kind)}
    assert set(measured) == {name + cold for name in known for cold in ("", "_t0")}
    for name in READERS:
        assert min(measured[one][0] - measured[one][1] for one in (name, name + "_t0")) > 0.4
