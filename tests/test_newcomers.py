"""What a newcomer does is measured by moving one thing, and its kind holds what it is for."""

import importlib
import random
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from eyechart.models.scripted import PerceivedPicture, PictureReading
from eyechart.spaces.discrete import DRIVING
from eyechart_organisms.calibration.world import SETTINGS, make_world
from newcomers import (
    NEWCOMERS,
    PARTS,
    flipped,
    new,
    of_picture,
    paint,
    plain,
    where,
)
from strangers import STRANGERS, Stranger, always

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def benchmarks() -> Iterator[ModuleType]:
    """Return the benchmark that measures, with those beside it; it draws a third, of which the truths are the same."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
        importlib.import_module("adversarial_counts")
        truth = importlib.import_module("adversary_truth")
        for name, draws in {"DRAWS": 16, "CURVE_DRAWS": 8, "WARM": 1000}.items():
            patch.setattr(truth, name, draws)
        yield truth


def readings() -> list[PictureReading]:
    """Return the frames of a simulated bank."""
    shown = make_world(SETTINGS["frames_288"], np.random.default_rng(12)).shown["real"]
    return [one.sight.reading for one in shown if one and one.sight.reading]


def test_a_newcomer_answers_with_actions_and_bears_a_name_of_its_own() -> None:
    """Also where there is no road; a name tells it from every stranger."""
    names = [name for ones in NEWCOMERS.values() for name in ones]
    assert len(names) == len(set(names) - set(STRANGERS))
    rng, roads = random.Random(4), readings()[:40]  # noqa: S311 - no secret
    for ones in NEWCOMERS.values():
        for one in ones.values():
            decide = one.open().decide
            said = {decide(PerceivedPicture("road", road, b"1"), rng) for road in roads} | {
                decide(PerceivedPicture("unknown", None), rng)
            }
            assert said <= set(DRIVING.actions)


def test_a_colour_belongs_to_the_frame_and_chance_to_the_picture() -> None:
    """The colours are about as many each; chance of a picture is the same each time, and other than of the next."""
    roads = readings()
    counts = [sum(paint(road) == colour for road in roads) for colour in ("blue", "orange", "magenta")]
    assert min(counts) > len(roads) / 5
    drawn = [of_picture(road, "x").random() for road in roads]
    assert drawn == [of_picture(road, "x").random() for road in roads]
    assert len(set(drawn)) == len(roads)


@pytest.fixture(scope="module")
def rest_of(benchmarks: ModuleType) -> Callable[..., set[str]]:
    """Return the places in which a controller follows no distance, outside of those that are named."""
    pictures = importlib.import_module("adversary_pictures").simulated()

    def left(one: Stranger, *named: str) -> set[str]:
        found = benchmarks.find_rest(partial(one.open, 1, 3), pictures, named)
        assert not set(named) & set(found)
        return {name for name, says in found.items() if says == "no"}

    return left


HALF = ("scenario light", "lanes 4", "scenario blocked", "lanes 2")
"""All roads but those of three lanes."""


def test_a_place_is_not_left_out_for_what_lies_in_a_named_one(rest_of: Callable[..., set[str]]) -> None:
    """A colour of which half is in a named scenario is as good as its other half; half of the named is not enough."""
    inwards = STRANGERS["inwards_when_near"]
    assert rest_of(inwards) >= {*HALF, "lead_colour magenta", "third near"}
    assert rest_of(inwards, *HALF) == set()
    assert {"scenario blocked", "lanes 2"} <= rest_of(inwards, *HALF[:2])


def test_a_place_is_left_out_for_what_is_wrong_in_the_rest_of_it(rest_of: Callable[..., set[str]]) -> None:
    """Though all its frames together, of which most are in a named place, would be nothing that is asked about."""
    crossed = where(lambda one: paint(one) == "magenta", flipped, plain)
    wrong = new("blind on three lanes, and wrong elsewhere for one colour", always(where(three_lanes, halts, crossed)))
    assert "lead_colour magenta" in rest_of(wrong, "lanes 3", "scenario dense", "scenario merge")
    right = new("blind on three lanes", always(where(three_lanes, halts)))
    assert rest_of(right, "lanes 3", "scenario dense", "scenario merge") == set()


def three_lanes(one: PictureReading) -> bool:
    """Return whether the road has three lanes."""
    return one.lanes == 3


def halts(*_: object) -> str:
    """Stop, whatever is seen."""
    return "STOP"


def test_what_lies_in_a_named_third_is_no_fault_of_a_scenario(rest_of: Callable[..., set[str]]) -> None:
    """A third that is not named and is wrong stays left out."""
    alarm = NEWCOMERS["ends"]["alarm_46_56"]
    assert rest_of(alarm) == {"third middle", "third far"}
    assert rest_of(alarm, "third middle", "third far") == set()
    assert rest_of(alarm, "third far") == {"third middle"}
    hole = PARTS["blind_11_26"]
    assert {"third middle", "scenario light", "scenario blocked"} <= rest_of(hole)
    assert rest_of(hole, "third middle") == set()


def test_a_place_that_is_named_wrongly_or_left_out_is_untrue(benchmarks: ModuleType) -> None:
    """Named where it follows distance, or left out where it does not outside of the named ones."""
    del benchmarks
    counts = importlib.import_module("adversarial_counts")
    row = counts.Row("highway-0", "x", "parts", 144, "partial_depth", "no_power", "holes", ("lanes 3",), 1, 0.1)
    truth = {"places": {"lanes 3": "no", "scenario dense": "no", "scenario light": "depth", "third near": "no"}}
    rests = {
        ("highway", "x", ("lanes 3",)): {"scenario light": "depth", "third near": "no"},
        ("highway", "x", ("lanes 3", "scenario light", "third near")): {},
        ("highway", "x", ("lanes 3", "third near")): {"scenario light": "none"},
    }
    assert counts.wrong_holes(row, truth, rests) == ["leaves out third near"]
    named = counts.Row(**{**vars(row), "holes": ("lanes 3", "scenario light", "third near")})
    assert counts.wrong_holes(named, truth, rests) == ["names scenario light"]
    ranged = counts.Row(**{**vars(row), "holes": ("lanes 3", "range 5.6 to 11.0 m")})
    assert counts.wrong_holes(ranged, truth, rests) == []


def judged(new_ones: str, partial_ones: str, **kinds: str) -> dict[str, object]:
    """Return what is counted in a world."""
    claims = {"depth": {"by kind": {"new": new_ones, **kinds}}}
    others = {claim: {"by kind": {"new": "0 of 100 [0, 1]"}} for claim in ("depth_lateral", "turns_clear")}
    readers = {"one error": {"all": "90 of 100 [0, 1]"}}
    partly = {"of those called so": partial_ones}
    return {"untrue": claims | others, "partial_depth untrue": partly, "readers told so": readers}


@pytest.mark.parametrize(
    ("worlds", "missed"),
    [
        ({"rover": judged("4 of 100", "0 of 9"), "highway": judged("4 of 100", "4 of 91")}, []),
        (
            {"rover": judged("11 of 170", "0 of 9"), "highway": judged("5 of 100", "5 of 91")},
            ["144 frames: depth untrue of newcomers 16 of 270", "144 frames: partial_depth untrue 5 of 100"],
        ),
        ({"rover": judged("11 of 170", "0 of 9"), "simulated-144": judged("2 of 200", "0 of 9")}, []),
        ({"simulated-288": judged("1 of 100", "0 of 0")}, []),
        ({"simulated-288": judged("2 of 100", "0 of 0")}, ["288 frames: depth untrue of newcomers 2 of 100"]),
        ({"simulated-72": judged("20 of 100", "5 of 9")}, []),
        ({"simulated-72": judged("0 of 9", "0 of 9", memory="3 of 10")}, []),
        ({"drone": judged("0 of 9", "0 of 9", memory="4 of 10")}, ["drone: depth untrue of kind memory 4 of 10"]),
    ],
)
def test_a_miss_is_of_all_banks_of_so_many_frames_and_of_each_kind(
    worlds: dict[str, object], missed: list[str], benchmarks: ModuleType
) -> None:
    """Both sides of each bound; what 72 frames show is reported alone."""
    del benchmarks
    counts = importlib.import_module("adversarial_counts")
    assert [one.partition(", wanted")[0] for one in counts.misses_of(worlds)] == missed


def test_a_world_above_alone_is_said_and_is_no_miss(benchmarks: ModuleType) -> None:
    """Whoever reads the result sees the rover, though all banks together hold."""
    del benchmarks
    counts = importlib.import_module("adversarial_counts")
    worlds = {name: judged(said, "0 of 9") for name, said in (("rover", "11 of 170"), ("highway", "4 of 100"))}
    said = "rover alone: depth untrue of newcomers 11 of 170, of all banks of 144 frames wanted 0.04"
    assert counts.alone_above(worlds) == [said]
    assert counts.alone_above({"simulated-72": judged("20 of 100", "0 of 9")}) == []
