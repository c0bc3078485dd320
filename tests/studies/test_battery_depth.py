"""What a run's answers hold of depth: levels, distances and places of a simulated bank, through the stages of a run."""

import math
import random
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from drawn import answered
from eyechart.conditions import OLDER, RANGED
from eyechart.frames import LEAD_GAP
from eyechart.models.scripted import PerceivedPicture
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.stats.order import Density
from eyechart.stats.paired_tests import Places
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.calibrated_statistics import CalibratedTests, LazyStatistics
from eyechart.studies.battery.depth import moved_of
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.verdicts import calibrated_rules
from eyechart_organisms.calibration.known_answers import KNOWN, KnownController, by_sight
from eyechart_organisms.calibration.replication import answers_of, staged
from eyechart_organisms.calibration.world import SETTINGS, SimulatedView, World, make_world

SETTING = SETTINGS["default"]


@pytest.fixture(scope="module")
def world() -> World:
    """Return a bank of 144 frames."""
    return make_world(SETTING, np.random.default_rng(7))


def asked(known: KnownController, world: World) -> Answers:
    """Return the answers that a run asks for, stage by stage."""
    return staged(answers_of(known, SETTING, world, random.Random(3)), Resampling())  # noqa: S311 - no secret


def judged(answers: Answers) -> tuple[str, str]:
    """Return the label and what is said."""
    ruling = calibrated_rules(LazyStatistics(CalibratedTests(answers, Resampling()).tests()), turns=False)[0]
    return ruling.label, str(ruling.reason)


def test_a_reader_is_asked_the_seven_pictures_and_earns_depth(world: World) -> None:
    """And none of the older controls."""
    answers = asked(KNOWN["depth"], world)
    assert set(RANGED) <= answers.decisions.keys()
    assert not set(OLDER) & answers.decisions.keys()
    assert judged(answers)[0] == "depth"


def test_who_does_not_brake_by_distance_is_not_asked_them(world: World) -> None:
    """A constant costs what it did."""
    assert not set(RANGED) & asked(KNOWN["constant"], world).decisions.keys()


def _reader_but(blind_on: int) -> KnownController:
    """Return a reader of distance that goes on where the road has so many lanes."""

    def decide(sight: PerceivedPicture, rng: random.Random) -> str:
        if sight.reading is not None and sight.reading.lanes == blind_on:
            return "STRAIGHT"
        return str(KNOWN["depth"].choose(SimulatedView(sight, None), 0.0, rng))

    return KnownController("blind_on", "", by_sight(decide), "", "", "")


def test_a_count_of_lanes_without_braking_is_named(world: World) -> None:
    """What the bank records of its frames is a place; a scenario that is nothing else is named too."""
    label, said = judged(asked(_reader_but(4), world))
    assert label == "partial_depth"
    assert "of the frames in `light`, where lanes is 4: 0 of 35 each;" in said


def test_a_reader_that_a_near_neighbour_keeps_from_braking_earns_no_depth() -> None:
    """It brakes by the lead's distance over that of the nearest other vehicle."""

    def decide(sight: PerceivedPicture, _: random.Random) -> str:
        if sight.reading is None:
            return "STOP"
        others = [math.hypot(one.ahead_m, one.aside_m) for one in sight.reading.others if one.aside_m]
        ratio = (sight.reading.scene.gap_m or 76.0) / min([*others, 76.0])
        return "STOP" if ratio < 0.8 else "SLOW" if ratio < 2 else "STRAIGHT"

    world = make_world(SETTING, np.random.default_rng(21))
    answers = asked(KnownController("relative", "", by_sight(decide), "", "", ""), world)
    one = moved_of(answers).specificity(sign=-1)
    assert one.ci is not None
    assert one.ci[1] > 0
    label, said = judged(answers)
    assert label == "depth_associated"
    assert said.endswith("that a near vehicle beside hardly keeps it from braking is not shown")


def in_turn(share: float, coin: float, world: World, back: int = 0) -> Answers:
    """Return what a reader of a moving average answers, asked about all in one order; a picture has a share of it.

    The mean is of the logarithms of distances. A part of the answers is a coin. One that looks ``back`` mixes its
    picture with the one alone that was shown so many calls before.
    """
    seen = [3.0] * back
    rng, mean = random.Random(5), [3.0]  # noqa: S311 - no secret
    calls = [(name, place) for name, column in world.shown.items() for place, one in enumerate(column) if one]
    rng.shuffle(calls)
    sent = {name: np.full(len(world.frames), -1) for name in world.shown}
    given: dict[str, list[Decision[str] | None]] = {name: [None] * len(world.frames) for name in world.shown}
    for turn, (name, place) in enumerate(calls):
        shown = world.shown[name][place]
        reading = shown.sight.reading if shown else None
        said = "STOP"
        if reading is not None:
            shown_m = math.log(min(reading.scene.gap_m or 80.0, 80.0))
            seen.append(shown_m)
            mean[0] = seen[-1 - back] if back else mean[0]
            mean[0] += share * (shown_m - mean[0])
            far = math.exp(mean[0])
            said = "STOP" if far < 13 else "SLOW" if far < 40 else "STRAIGHT"
        said = rng.choice(("STOP", "SLOW", "STRAIGHT")) if rng.random() < coin else said
        given[name][place], sent[name][place] = Decision(said), turn
    decisions = {name: tuple(column) for name, column in given.items()}
    return Answers("", world.frames, DRIVING, LEAD_GAP, decisions, sent=sent)


def picture_before(answers: Answers) -> Statistic:
    """Return what the picture before does, less half of what the own one does."""
    return moved_of(answers).picture_before()


MEMORY = "that earlier pictures move its braking less than half as much is not shown"


@pytest.mark.parametrize(("share", "coin", "label"), [(1, 0, "depth"), (1, 0.1, "depth"), (0.8, 0, "depth")])
def test_who_answers_to_its_own_picture_earns_depth(share: float, coin: float, label: str, world: World) -> None:
    """Also behind a coin, and where the pictures before have a fifth of the say."""
    answers = in_turn(share, coin, world)
    one = picture_before(answers)
    assert one.ci is not None
    assert one.ci[1] < 0
    assert one.n > 100
    assert judged(answers)[0] == label


@pytest.mark.parametrize("share", [0.5, 0.3])
def test_who_answers_to_the_picture_before_as_well_earns_no_depth(share: float, world: World) -> None:
    """It would be depth where the order of the calls is not known."""
    answers = in_turn(share, 0.0, world)
    one = picture_before(answers)
    assert one.ci is not None
    assert one.ci[1] > 0
    assert judged(answers) == ("depth_associated", f"it brakes harder for the near lead than for the far one; {MEMORY}")
    unknown = replace(answers, sent={})
    assert picture_before(unknown).value is None
    assert judged(unknown)[0] == "depth"


@pytest.mark.parametrize("back", [2, 3])
def test_a_memory_of_a_picture_further_back_earns_no_depth(back: int, world: World) -> None:
    """What skips the last picture is a memory too, and the number says how far back it lies."""
    answers = in_turn(0.5, 0.0, world, back)
    one = picture_before(answers)
    assert one.ci is not None
    assert one.ci[1] > 0
    assert one.note == f"{back} calls earlier"
    assert judged(answers)[0] == "depth_associated"


@pytest.mark.parametrize(("share", "coin"), [(1, 0.0), (1, 0.4), (0.5, 0.0)])
def test_noise_is_no_memory(share: float, coin: float, world: World) -> None:
    """In the order that it was asked in, noise does what it does in any other; a memory does not."""
    moved = moved_of(in_turn(share, coin, world))
    value, rng = moved.picture_before().value, np.random.default_rng(1)
    others = [
        replace(moved, before={name: rng.permutation(at, axis=1) for name, at in moved.before.items()})
        .picture_before()
        .value
        for _ in range(40)
    ]
    apart = abs(value - np.mean(others))
    assert apart < 2.5 * np.std(others) + 1e-9 if share == 1 else apart > 5 * np.std(others)


def test_levels_and_distances_stand_beside_each_frame(world: World) -> None:
    """Distances are those of the bank; a frame without a lead has neither; windows are as dense as is planned."""
    moved = moved_of(asked(KNOWN["depth"], world))
    there = np.array([frame.truth["lead_gap_m"] is not None for frame in world.frames])
    for picture in ("near", "drawn", "own", "far", "real"):
        assert np.array_equal(~np.isnan(moved.distance(picture)), there)
    assert np.array_equal(~np.isnan(moved.level("exchange_beside")), there)
    assert ((moved.distance("near") < 12) | ~there).all()
    drawn = moved.drawn()
    assert isinstance(drawn, Density)
    assert (drawn.value or 0.0) > 18
    assert drawn.fewest >= 6


def test_outside_of_a_hole_its_frames_and_pictures_are_left_out(world: World) -> None:
    """A scenario takes its frames out; a third of the range takes out what lies there, and near and far stay."""
    moved = moved_of(asked(KNOWN["depth"], world))
    names = moved.strata["scenario"]
    gone = {name: np.where(names == "blocked", 0.0, level) for name, level in moved.levels.items()}
    blind = replace(moved, levels=gone)
    rest = blind.outside_holes()
    assert isinstance(blind.tests()["holes"](), Places)
    assert np.isnan(rest.level("lead_near")[names == "blocked"]).all()
    assert not np.isnan(rest.level("lead_near")[names == "dense"]).all()
    far = {
        name: np.where(moved.third("own", 2), 0.0, level) if name.startswith("exchange_own") else level
        for name, level in moved.levels.items()
    }
    far |= {
        f"lead_drawn{one}": np.where(moved.third("drawn", 2), 0.0, moved.level(f"lead_drawn{one}"))
        for one in ("", "_nudged")
    }
    rest = replace(moved, levels=far).outside_holes()
    assert np.isnan(rest.level("exchange_beside")[moved.third("own", 2)]).all()
    assert np.array_equal(rest.level("lead_near"), moved.level("lead_near"), equal_nan=True)


def test_who_answers_nowhere_has_no_holes_in_anything() -> None:
    """Who brakes in no place of the control stage is not left out of it everywhere: its sensitivity is nothing."""
    moved = answered(lambda lead, *_: np.zeros_like(lead))
    found = {name: test() for name, test in moved.tests().items()}
    assert found["sensitivity"].value == 0.0
    assert found["sensitivity"].n == 144


def test_true_pictures_alone_show_no_rise() -> None:
    """What else goes with their distance was not drawn; with the lead drawn along the range they are beside it."""
    moved = answered(lambda lead, *_: np.where(lead > 30, 1.0, 0.0))
    assert moved.rise().p is not None
    alone = replace(moved, levels={name: moved.levels[name] for name in ("real", "real_repeat", "lead_near")})
    assert alone.rise().p is None


def test_curves_fall_for_the_lead_alone(world: World) -> None:
    """Of a reader, in windows that follow one another over the range; what lies in a hole has a curve of its own."""
    curves = moved_of(asked(KNOWN["depth"], world)).curves()
    assert list(curves) == ["drawn", "own", "beside"]
    for name in ("drawn", "own"):
        levels = [one.level.value for one in curves[name]]
        assert levels == sorted(levels, reverse=True)
        assert (levels[0], levels[-1]) == (1.0, 0.0)
    assert {one.level.value for one in curves["beside"]} == {0.0}
    for windows in curves.values():
        assert all(one.far == other.near for one, other in pairwise(windows))
        assert all(
            0 <= window.level.ci[0] <= window.level.value <= window.level.ci[1] <= 1
            for window in windows
            if window.level.ci
        )
    assert sum(one.level.n for one in curves["drawn"]) == np.count_nonzero(
        ~np.isnan(moved_of(asked(KNOWN["depth"], world)).level("lead_drawn"))
    )
    blind = moved_of(asked(_reader_but(4), world)).curves()
    assert {one.level.value for one in blind["hole"]} == {0.0}
    assert blind["drawn"][0].level.value == 1.0


def test_a_run_without_distances_has_no_curve(world: World) -> None:
    """Nor has one that was not asked along the range."""
    moved = moved_of(asked(KNOWN["depth"], world))
    assert replace(moved, at={}).curves() == {}
