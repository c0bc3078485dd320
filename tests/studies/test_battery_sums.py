"""What scoring adds up, beside the definitions, frame by frame."""

import numpy as np
import pytest

import banks
from eyechart.frames import LEAD_GAP
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import UNPARSED, Decision
from eyechart.studies.battery import answers as answers_of
from eyechart.studies.battery import paper_statistics
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.paper_statistics import PaperStatistics, Resampling

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


def test_symbols_of_many_frames_are_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are made anew, and are the same: those of many models on a large bank would fill the memory."""
    monkeypatch.setattr(answers_of, "_SYMBOLS_KEPT", 100)
    given = answers()
    first, second = given.actions("real"), given.actions("real")
    assert first is not second
    assert first.tolist() == second.tolist() == [action or "" for action in REAL]
    with pytest.raises(ValueError, match="read-only"):
        first[0] = "SLOW"


@pytest.mark.parametrize("level", ["response", "decision"])
@pytest.mark.parametrize("condition", ["real", "blank", "noise"])
def test_codes_are_the_places_of_symbols(condition: str, level: str) -> None:
    """A call without a reply has -1, and at the level of decisions a reply without one too."""
    given, names = answers(), tuple(sorted({*DRIVING.actions, UNPARSED}))
    symbols = given.symbols(condition, level).tolist()
    expected = [names.index(symbol) if symbol else -1 for symbol in symbols]
    assert given.codes(condition, level, names).tolist() == expected


def test_braking_levels_are_those_of_the_action_space() -> None:
    """One by one; what is no decision is -1."""
    given = answers()
    expected = [DRIVING.project(action, "brake") if action else -1 for action in REAL]
    along = given.projection("real", "brake")
    assert along is not None
    assert np.nan_to_num(along, nan=-1).tolist() == expected


def test_sums_by_episode_are_loops_over_frames() -> None:
    """An episode of which no frame is left has no row."""
    episodes = np.array([4, 0, 4, 2])
    values = np.array([[1.0, 2], [3, 4], [5, 6], [7, 8]])
    assert paper_statistics._sums_by_episode(values, episodes).tolist() == [[3, 4], [7, 8], [6, 8]]


def test_the_median_gaps_of_three_episodes_have_a_value_and_no_interval() -> None:
    """Frames without a lead count as the farthest; so few episodes say too little of the medians."""
    statistic = PaperStatistics(answers(), Resampling(resamples=99))._gap_order()
    gaps = np.array([40.0 if gap is None else gap for gap in GAPS_M])
    braking = np.isin(np.array(REAL, dtype=str), DRIVING.brake)
    going = np.isin(np.array(REAL, dtype=str), DRIVING.proceed)
    assert statistic.value == np.median(gaps[going]) - np.median(gaps[braking])
    assert statistic.ci is None
    assert statistic.note
