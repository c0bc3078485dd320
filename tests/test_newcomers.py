"""What a newcomer does is measured by moving one thing, and its kind holds what it is for."""

import importlib
import random
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from eyechart.models.scripted import PerceivedPicture, PictureReading
from eyechart.spaces.discrete import DRIVING
from eyechart_organisms.calibration.world import SETTINGS, make_world
from newcomers import (
    ADVERSARIES_BY_KIND,
    NEWCOMERS,
    PARTS,
    READERS,
    WORST,
    of_picture,
    paint,
)
from strangers import STRANGERS

pytestmark = pytest.mark.slow

Truths = Mapping[tuple[str, int], dict[str, object]]


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


@pytest.fixture(scope="module")
def truths(benchmarks: ModuleType) -> Truths:
    """Return the truth of every newcomer in the simulated world, of readers at both temperatures."""
    pictures = importlib.import_module("adversary_pictures").simulated()
    return {
        (name, temperature): benchmarks.find_truth(partial(one.open, temperature, 3), pictures).plain()
        for kind, ones in NEWCOMERS.items()
        for name, one in ones.items()
        for temperature in ((0, 1) if kind in {"readers", "worst"} else (1,))
    }


@pytest.mark.parametrize("kind", ADVERSARIES_BY_KIND)
def test_five_of_each_kind_deserve_no_depth_or_turn_without_looking(kind: str, truths: Truths) -> None:
    """Some are wrong on so few pairs that nothing is asked, or that depth is true of them."""
    said = [truths[name, 1] for name in ADVERSARIES_BY_KIND[kind]]
    wrong = [one["turns" if kind == "turns" else "says"] for one in said].count("no")
    assert wrong >= 5, said
    assert len(said) >= 5


@pytest.mark.parametrize("name", [*READERS, *WORST])
@pytest.mark.parametrize("temperature", [0, 1])
def test_a_reader_deserves_depth_at_both_temperatures(name: str, temperature: int, truths: Truths) -> None:
    """Its errors are small, whether they repeat or not."""
    assert truths[name, temperature]["says"] == "depth", truths[name, temperature]


@pytest.mark.parametrize("name", [name for name in PARTS if not name.startswith("mostly")])
def test_a_blind_spot_is_a_place_that_the_truth_names(name: str, truths: Truths) -> None:
    """Each is none of it in some place, or in all; of who reads a fifth of the frames there nothing is asked."""
    places = truths[name, 1]["places"]
    assert isinstance(places, dict)
    assert "no" in (truths[name, 1]["says"], *places.values())


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


def test_a_place_that_is_named_wrongly_or_left_out_is_untrue(benchmarks: ModuleType) -> None:
    """Named where it follows distance, left out where it does not, unless its frames are in one that is named."""
    del benchmarks
    counts = importlib.import_module("adversarial_counts")
    row = counts.Row("highway-0", "x", "parts", 144, "partial_depth", "no_power", "holes", ("lanes 3",), 1, 0.1)
    truth = {
        "places": {"lanes 3": "no", "scenario dense": "no", "scenario light": "depth", "third near": "no"},
        "inside": {"scenario dense": ("lanes 3",)},
    }
    assert counts.wrong_holes(row, truth) == ["leaves out third near"]
    named = counts.Row(**{**vars(row), "holes": ("lanes 3", "scenario light", "third near")})
    assert counts.wrong_holes(named, truth) == ["names scenario light"]
    ranged = counts.Row(**{**vars(row), "holes": ("lanes 3", "range 5.6 to 11.0 m")})
    assert counts.wrong_holes(ranged, truth) == []
