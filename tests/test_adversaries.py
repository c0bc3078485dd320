"""What is declared of each adversary is what its rule does, on many simulated frames."""

import importlib
import math
import random
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from eyechart.frames import EXCHANGE
from eyechart.models.scripted import PerceivedPicture
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.scene import Other
from eyechart_organisms.adversaries import ADVERSARIES, Adversary
from eyechart_organisms.calibration.tally import LIMITS, WEAK
from eyechart_organisms.calibration.world import SETTINGS, SimulatedView, World, make_world

pytestmark = pytest.mark.slow

DOSES_M = (7.5, 8.5, 9.5, 10.5, 11.5, 13.0, 15.5, 18.0, 19.5, 21.5, 24.0, 27.0, 31.0, 36.0, 41.0, 46.0, 52.0, 58.0)
DRAWS = 24
EXCHANGED = ("exchange_own", "exchange_beside")
NEAR_M = 9.0


@cache
def world() -> World:
    """Return one simulated bank of 288 frames."""
    return make_world(SETTINGS["frames_288"], np.random.default_rng(11))


def braking(one: Adversary, sight: PerceivedPicture) -> float:
    """Return the mean braking level that a rule gives to a sight."""
    rng = random.Random(3)  # noqa: S311 - no secret
    levels = [DRIVING.project(str(one.decide(sight, rng)), "brake") for _ in range(DRAWS)]
    return float(np.mean([0.0 if level is None else level for level in levels]))


Pairs = list[tuple[SimulatedView, SimulatedView]]


def pairs_of(first: str, second: str, *, within_m: float = math.inf) -> Pairs:
    """Return what two conditions show of each frame that has both, with the exchange at this distance or nearer."""
    columns = zip(world().frames, world().shown[first], world().shown[second], strict=True)
    found = [(one, other, frame.truth.get(EXCHANGE)) for frame, one, other in columns if one and other]
    return [(one, other) for one, other, m in found if within_m == math.inf or float(str(m)) <= within_m]


def net(one: Adversary, pairs: Pairs) -> float:
    """Return the share of frames on which a rule brakes harder under the first condition, less the reverse."""
    rng, signs = random.Random(5), []  # noqa: S311 - no secret
    for near, far in pairs:
        levels = [DRIVING.project(str(one.decide(shown.sight, rng)), "brake") for shown in (near, far)]
        signs.append(np.sign((levels[0] or 0) - (levels[1] or 0)))
    return float(np.mean(signs))


def at(shown: SimulatedView, gap_m: float) -> PerceivedPicture:
    """Return a frame's sight with its lead at another distance."""
    reading = shown.sight.reading
    assert reading is not None
    others = tuple(sorted((*(other for other in reading.others if other.aside_m), Other(gap_m, 0.0))))
    return replace(shown.sight, reading=replace(reading, scene=replace(reading.scene, gap_m=gap_m), others=others))


def wrong_order(one: Adversary) -> float:
    """Return the share of frames on which a rule brakes clearly harder at some greater distance of the lead."""
    wrong = []
    for shown in world().shown["real"][::2]:
        assert shown is not None
        levels = np.array([braking(one, at(shown, gap_m)) for gap_m in DOSES_M])
        least = np.minimum.accumulate(levels)
        wrong.append(float((levels - least).max()) > 0.6)
    return float(np.mean(wrong))


def lost(one: Adversary) -> float:
    """Return the share of frames on which a rule brakes clearly harder for a near neighbour than for a near lead."""
    pairs = pairs_of(*EXCHANGED, within_m=NEAR_M)
    return float(np.mean([braking(one, b.sight) - braking(one, a.sight) > 0.6 for a, b in pairs]))


@pytest.mark.parametrize("name", ADVERSARIES)
def test_an_adversary_follows_the_lead_as_declared(name: str) -> None:
    """By both true effects, and by the order of its braking over the distances."""
    one = ADVERSARIES[name]
    effects = [net(one, pairs_of("lead_near", "lead_far")), net(one, pairs_of(*EXCHANGED, within_m=NEAR_M))]
    wrong = max(wrong_order(one), lost(one))
    if one.follows is False:
        assert min(effects) < 0.10 or wrong >= 0.10, (effects, wrong)
    elif one.follows:
        assert min(effects) >= 0.30, effects
        assert wrong < 0.05, wrong


NAMED = {
    "between_reversed_20": "no",
    "patched_25": "none",
    "exchange_reversed_35": "none",
    "half_blind": "depth",
    "grades_noise_50": "depth",
    "emergency": "depth",
}


def test_the_measure_of_the_newcomers_agrees_of_what_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is declared of it is measured by moving one thing; who brakes near alone is depth in no other third."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "benchmarks")
    truth, pictures = (importlib.import_module(name) for name in ("adversary_truth", "adversary_pictures"))
    for name, draws in {"DRAWS": 16, "CURVE_DRAWS": 8, "WARM": 0}.items():
        monkeypatch.setattr(truth, name, draws)
    seen = pictures.simulated()
    found = {name: truth.find_truth(lambda name=name: ADVERSARIES[name], seen) for name in NAMED}
    assert {name: one.says for name, one in found.items()} == NAMED
    assert {*LIMITS, *WEAK, "emergency"} == NAMED.keys()
    for name, says in NAMED.items():
        assert ADVERSARIES[name].follows is {"depth": True, "no": False, "none": None}[says]
    assert {found["emergency"].places[f"third {one}"] for one in ("middle", "far")} == {"none"}


@pytest.mark.parametrize("name", ADVERSARIES)
def test_an_adversary_looks_as_declared(name: str) -> None:
    """A rule that looks answers otherwise to some picture; one that does not answers as often so to any."""
    one, rng = ADVERSARIES[name], random.Random(1)  # noqa: S311 - no secret
    shares = {
        condition: np.mean(
            [[one.decide(shown.sight, rng) == action for action in DRIVING.actions] for shown in column if shown],
            axis=0,
        )
        for condition, column in world().shown.items()
    }
    apart = max(float(np.abs(share - shares["real"]).max()) for share in shares.values())
    few = {"left_at_8", "goes_when_near", "coin_of_picture", "coin_and_picture"}
    assert one.looks is None or name in few or (apart > 0.05) == one.looks, apart
