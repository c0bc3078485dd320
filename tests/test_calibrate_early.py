"""What calibration says of stopping early: that it compares with the full battery, and that a broken bet is caught."""

import json
import random

import numpy as np
import pytest

from eyechart.conditions import CONDITIONS
from eyechart.seeds import key_seed
from eyechart.spaces.discrete import DRIVING
from eyechart.stats import evalues
from eyechart.studies.battery.early_stop import StoppingState
from eyechart.studies.battery.evidence import claims
from eyechart_organisms.adversaries import ADVERSARIES
from eyechart_organisms.calibration import SETTINGS, Calibration, calibrate, replication
from eyechart_organisms.calibration import early_stops as stopping
from eyechart_organisms.calibration.early_stops import (
    DRAWS,
    EMPTY,
    NULLS,
    SAVERS,
    EarlyStopOutcome,
    add,
    has_rejected,
    mean_saved,
    misses,
    stop_early,
)
from eyechart_organisms.calibration.known_answers import KNOWN, KnownController, by_sight
from eyechart_organisms.calibration.replication import answers_of
from eyechart_organisms.calibration.table import tables
from eyechart_organisms.calibration.tally import VARIANTS, read_calibration
from eyechart_organisms.calibration.world import World, make_world

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def world() -> World:
    """Return one bank of the default setting."""
    return make_world(SETTINGS["default"], np.random.default_rng(1))


def test_every_controller_is_followed_with_and_without_counterfactuals(calibration: Calibration) -> None:
    """Those that are wanted to save calls do, none has another verdict, and the gap by observation stops nobody."""
    for variant in VARIANTS:
        assert set(calibration.early["default"][variant]) == set(KNOWN)
        assert all(one["equal"] == 1 and one["false"] == 0 for one in calibration.early["default"][variant].values())
    for name, share in SAVERS.items():
        assert mean_saved(calibration.early["default"][VARIANTS[0]][name])[0] > share
    assert calibration.early["default"][VARIANTS[1]]["depth"]["stopped"] == 0
    assert len(calibration.ever) == len(NULLS)
    assert not [one for one in calibration.misses() if "early" in one]


def test_early_stopping_stands_in_the_tables_and_comes_back_from_json(calibration: Calibration) -> None:
    """Every null has its row, and the JSON loses nothing."""
    printed = tables(calibration)
    assert "Stopping early, setting default, with counterfactuals" in printed
    assert all(f"| {null.claim}" in printed and null.says in printed for null in NULLS)
    assert f"of {DRAWS}" in printed
    assert read_calibration(json.loads(json.dumps(calibration.as_dict()))) == calibration


def test_every_claim_has_a_null() -> None:
    """Nothing settles a verdict whose error was not measured."""
    assert {null.claim for null in NULLS} == set(claims(144, DRIVING, CONDITIONS, mirrored=True))


def test_the_nulls_are_rejected_where_they_are_false(world: World) -> None:
    """The same claims are settled by answers that speak for them, so that silence under a null means something."""
    wrong = {
        "bound_shuffled": lambda frames, _: {"shuffled": ["SLOW"] * len(frames)},
        "near_far": lambda frames, _: {"lead_near": ["STOP"] * len(frames), "lead_far": ["STRAIGHT"] * len(frames)},
        "few_turns": lambda frames, _: {"real": ["SLOW"] * len(frames)},
    }
    for claim, draw in wrong.items():
        null = next(one for one in NULLS if one.claim == claim)
        false = type(null)(claim, "not a null", draw)
        assert has_rejected(false, world.frames, random.Random(0))  # noqa: S311 - no secret


def test_a_bet_that_forgets_what_is_left_is_caught(monkeypatch: pytest.MonkeyPatch, world: World) -> None:
    """Without its correction for a bad beginning, or with a bet too large, a null is rejected too often."""

    class Broken(evalues.MeanProcess):
        def _bet(self, edge: float) -> None:
            super()._bet(edge + 0.4)

    monkeypatch.setattr("eyechart.studies.battery.evidence.MeanProcess", Broken)
    rng = random.Random(0)  # noqa: S311 - no secret
    null = next(one for one in NULLS if "noise" in one.says)
    rejected = sum(has_rejected(null, world.frames, rng) for _ in range(20))
    ever = [rejected if one is null else 0 for one in NULLS]
    assert any(null.says in one for one in misses({}, ever, 2, strict=False))


def test_another_verdict_and_too_little_saved_are_misses() -> None:
    """Each in words that name the controller; runs that did not stop count as equal and save nothing."""
    same = EarlyStopOutcome("depth", stopped=True, saved=0.8, equal=True, lateral_equal=True, false=False)
    other = EarlyStopOutcome("presence_only", stopped=True, saved=0.2, equal=False, lateral_equal=True, false=False)
    sums = EMPTY
    for one in [same] * 180 + [other] * 20:
        sums = add(sums, one)
    assert sums["equal"] == 180
    assert mean_saved(sums)[0] == pytest.approx(0.74)
    early = {"default": {VARIANTS[0]: {"depth": sums}}}
    assert misses(early, (), 200, strict=True) == [
        "stopped early, depth has the full battery's verdict in 0.900 of 200 replications, with counterfactuals"
    ]
    low = add(EMPTY, other)
    assert any(
        "saves 0.200 of the calls for depth" in one
        for one in misses({"default": {VARIANTS[0]: {"depth": low}}}, (), 1, strict=True)
    )
    assert (
        misses(
            {"default": {VARIANTS[1]: {"depth": add(EMPTY, EarlyStopOutcome("depth", False, 0.0, True, True, False))}}},
            (),
            1,
            strict=True,
        )
        == []
    )


FOOL_DEPTH = {"between_reversed_20"}
"""Wrong on a fifth of the frames or less, or in part of them: the rules of a whole run give them depth now and then."""


def test_no_adversary_gets_an_early_depth_that_is_not_its_own(world: World) -> None:
    """Reversed in part, by the layout, in bands, by the file: none is settled on depth, and true readers are.

    But for those that fool the rules of a whole run; who brakes below 12 m alone is told so of the rest of the range.
    """
    settled = set()
    for name, adversary in ADVERSARIES.items():
        rng = random.Random(key_seed("early", name))  # noqa: S311 - no secret
        known = KnownController(name, adversary.says, by_sight(adversary.decide), "", "", "")
        answers = answers_of(known, SETTINGS["default"], world, rng)
        early = stop_early(answers, "", "", counterfactuals=True, varied=True, seed=1)
        if early.label in {"depth", "depth_lateral"}:
            assert adversary.is_false("depth", "") == () or name in FOOL_DEPTH, name
            settled.add(name)
    required = {name for name, one in ADVERSARIES.items() if one.deserves == "depth"}
    assert {"nearest_any_lane", "reversed_25", "hole_25_40", "lead_present"} & settled == set()
    assert len(settled & required) >= len(required) * 0.8


def test_a_stop_with_another_verdict_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """A course that settles on the wrong label shows as an unequal verdict and as a false one."""
    before = StoppingState.stopped

    def wrong(course: StoppingState, finished: int) -> object:
        result = before(course, finished)
        if result is None or result.label != "image_invariant":
            return result
        return type(result)("depth", *(getattr(result, name) for name in result.__slots__[1:]))

    monkeypatch.setattr(stopping.StoppingState, "stopped", wrong)
    for once in ("rejections", "try_adversaries"):  # which this test is not about
        monkeypatch.setattr(replication, once, lambda _: [])
    told = calibrate(replications=1, seed=3, settings=["default"])
    sums = told.early["default"][VARIANTS[0]]["constant"]
    assert (sums["equal"], sums["false"]) == (0, 1)
