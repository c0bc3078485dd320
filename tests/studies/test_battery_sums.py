"""What scoring adds up, beside the definitions, frame by frame."""

import itertools

import numpy as np
import pytest

import banks
from eyechart.frames import LEAD_GAP
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.studies.battery import published
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.published import Published, Resampling

GAPS_M = (5.0, 30.0, 12.0, None, 8.0, 40.0, 22.0, 9.0, 31.0, 6.0)
REAL = ("STOP", "LEFT", "SLOW", "STRAIGHT", None, "STRAIGHT", "SLOW", "RIGHT", "LEFT", "STOP")


def answers() -> Answers:
    """Return ten answers over three episodes of unequal length, one of them unparsed and one frame without a lead."""
    frames = tuple(
        banks.one(f"f{place}", ("merge", f"e{place % 4 % 3}", place), "vertical", "-", truth={"lead_gap_m": gap})
        for place, gap in enumerate(GAPS_M)
    )
    decisions = tuple(Decision(action, None if action else "unparsed") for action in REAL)
    return Answers("m", frames, DRIVING, LEAD_GAP, {"real": decisions, "blank": (*decisions[:5], *(None,) * 5)})


def test_symbols_are_made_once_and_cannot_be_written_to() -> None:
    """The second call returns the same array, which no statistic can spoil for the next."""
    given = answers()
    assert given.responses("real").tolist() == [action or "UNPARSED" for action in REAL]
    assert given.actions("real").tolist() == [action or "" for action in REAL]
    assert given.responses("blank").tolist() == [*(action or "UNPARSED" for action in REAL[:5]), *[""] * 5]
    assert given.actions("noise").tolist() == [""] * 10
    assert given.actions("real") is given.actions("real")
    with pytest.raises(ValueError, match="read-only"):
        given.actions("real")[0] = "SLOW"


def test_braking_levels_are_those_of_the_action_space() -> None:
    """One by one; what is no decision is -1."""
    given = answers()
    expected = [DRIVING.project(action, "brake") if action else -1 for action in REAL]
    along = given.projection("real", "brake")
    assert along is not None
    assert np.nan_to_num(along, nan=-1).tolist() == expected


def test_sums_by_episode_are_loops_over_frames() -> None:
    """Both kinds of sum; an episode of which no frame is left has no row."""
    episodes, rows, columns = np.array([4, 0, 4, 2]), np.array([1, 1, 0, 1]), np.array([7, 5, 7, 7])
    values = np.array([[1.0, 2], [3, 4], [5, 6], [7, 8]])
    assert published._sums_by_episode(values, episodes).tolist() == [[3, 4], [7, 8], [6, 8]]
    tables = np.zeros((3, 2, 2))
    for frame in range(4):
        tables[episodes[frame] // 2, rows[frame], int(columns[frame] == 7)] += 1
    assert np.array_equal(published._counts_by_episode(rows, columns, episodes), tables.reshape(3, 4))


def test_the_interval_of_the_median_gaps_is_that_of_all_draws_of_episodes() -> None:
    """The 27 ordered draws of three episodes, their frames written out; frames without a lead count as the farthest."""
    found = Published(answers(), Resampling(resamples=99))._gap_order()
    gaps = np.array([40.0 if gap is None else gap for gap in GAPS_M])
    episode = np.array([place % 4 % 3 for place in range(10)])
    braking = np.isin(np.array(REAL, dtype=str), DRIVING.brake)
    going = np.isin(np.array(REAL, dtype=str), DRIVING.proceed)
    differences = []
    for draw in itertools.product(range(3), repeat=3):
        times = np.bincount(draw, minlength=3)[episode]
        far, near = np.repeat(gaps[going], times[going]), np.repeat(gaps[braking], times[braking])
        if len(far) and len(near):
            differences.append(np.median(far) - np.median(near))
    assert found.value == np.median(gaps[going]) - np.median(gaps[braking])
    assert found.ci == pytest.approx(tuple(np.quantile(differences, [0.025, 0.975], method="inverted_cdf")))
