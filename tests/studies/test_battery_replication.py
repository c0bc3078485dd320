"""Two runs of one battery: equal ones do not differ, changed ones do, and chance is not taken for change."""

from dataclasses import replace

import numpy as np
import pytest

import simulated
from eyechart.errors import SpecError
from eyechart.frames import Frame
from eyechart.spaces.discrete import Discrete
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.replication import StatisticDifference, differences
from eyechart.studies.battery.scores import statistics_of

WORLD = simulated.frames(steps=6)


def by_gap(condition: str, frame: Frame, rng: np.random.Generator) -> str | None:
    """Brake near, turn where free, and decline one blank picture in four."""
    if condition in {"blank", "noise", "text_only"}:
        return "STOP" if rng.uniform() > 0.25 else None
    if simulated.gap(frame) < 18:
        return "SLOW"
    return "LEFT" if float(str(frame.truth["phase"])) < 0.5 else "STRAIGHT"


def coin(condition: str, frame: Frame, rng: np.random.Generator) -> str | None:
    """Answer at random, whatever is shown."""
    del condition, frame
    return str(rng.choice(["STOP", "SLOW", "LEFT"]))


def test_each_run_has_the_value_that_its_score_has() -> None:
    """What is compared is what ``score`` prints, for both runs and at both levels."""
    first, second = simulated.answers(by_gap, WORLD, seed=1), simulated.answers(coin, WORLD, seed=2)
    found = differences(first, second, resamples=50)
    compared = 0
    for side, answers in (("first", first), ("second", second)):
        scored = statistics_of(answers, Resampling(resamples=50, intervals=False))
        for name, difference in found.items():
            if isinstance(difference, StatisticDifference):
                assert getattr(difference, side) == pytest.approx(scored[name].value), name
                compared += 1
    assert compared > 50
    assert all(
        one.value == pytest.approx(one.second - one.first)
        for name, one in found.items()
        if isinstance(one, StatisticDifference)
    )


def test_the_same_answers_twice_differ_in_nothing() -> None:
    """Every difference is 0 with p 1, and the runs agree on every frame."""
    answers = simulated.answers(by_gap, WORLD)
    found = differences(answers, answers, resamples=50)
    assert found["across_runs"].value == 1
    assert {difference.value for name, difference in found.items() if name != "across_runs"} == {0}
    assert {difference.p for name, difference in found.items() if name != "across_runs"} == {1}


def test_a_model_that_became_blind_is_found_by_name() -> None:
    """The statistics that changed have a small p and an interval without 0; what did not change has neither."""
    seeing, blind = simulated.answers(by_gap, WORLD), simulated.answers(lambda *_: "SLOW", WORLD)
    found = differences(seeing, blind, resamples=500)
    for name in ("idi", "mutual_information", "cramers_v", "entropy", "unparsed_rate"):
        assert found[name].p == pytest.approx(1 / 501), name
    for name in ("mutual_information", "entropy", "unparsed_rate"):
        low, high = found[name].ci
        assert high < 0 or low > 0, name
    assert found["idi"].ci is None  # from 1 to 0 in every episode alike
    assert found["noise_floor"].p == 1


def test_another_constant_answer_is_a_change() -> None:
    """Most statistics do not ask which answer was given: only the shift tells always STOP from always LEFT."""
    stop, left = (simulated.answers(lambda *_, said=said: said, WORLD) for said in ("STOP", "LEFT"))
    found = differences(stop, left, resamples=500)
    assert (found["answer_shift"].value, found["across_runs"].value) == (1, 0)
    assert found["answer_shift"].p == pytest.approx(1 / 501)
    assert {difference.p for name, difference in found.items() if name not in {"answer_shift", "across_runs"}} <= {
        1,
        None,
    }


@pytest.mark.slow
def test_chance_is_not_taken_for_change() -> None:
    """Two runs of a coin toss: the test rejects at its level (P of more than 7 in 40 at .05 is .0007)."""
    rejected = 0
    for seed in range(40):
        one, other = (simulated.answers(coin, WORLD, seed=2 * seed + k) for k in (0, 1))
        rejected += differences(one, other, seed=seed, resamples=99)["answer_shift"].p <= 0.05
    assert rejected <= 7


def test_only_what_both_runs_asked_is_compared() -> None:
    """A frame that one run lacks, and a condition that it has not reached, are left out of both."""
    answers = simulated.answers(by_gap, WORLD)
    reached = {name: column[6:] for name, column in answers.decisions.items() if name != "mirrored"}
    found = differences(answers, replace(answers, frames=WORLD[6:], decisions=reached), resamples=50)
    assert (found["idi"].n, found["idi"].value) == (len(WORLD) - 6, 0)
    assert found["mirror_swap_rate"].value is None
    assert found["agree.mirrored"].note == "one of the two runs cannot say"


def test_runs_without_anything_in_common_are_refused() -> None:
    """Other frames and other actions are no replication."""
    answers = simulated.answers(coin, WORLD)
    with pytest.raises(SpecError, match="no frame in common"):
        differences(answers, simulated.answers(coin, tuple(replace(f, id=f"x{f.id}") for f in WORLD)))
    space = Discrete("two", ("GO", "HALT"), (), ("HALT",), ("GO",))
    with pytest.raises(SpecError, match="different action spaces"):
        differences(answers, replace(answers, space=space))
