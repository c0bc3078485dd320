"""A committee's answer, and the choice of the best one, against definitions written out as loops."""

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eyechart.stats.committee_votes import (
    ABSTAIN,
    CLEAR,
    HAZARD,
    MISSING,
    POINTS,
    CommitteeChoice,
    Costs,
    Point,
    answers,
    risk_coverage,
    select,
    select_without_each,
    tally,
)

Votes = np.ndarray


def one(h: int, m: int, voters: int, threshold: int, point: Point) -> int:
    """Return the answer to so many votes."""
    return int(answers(h, m, voters=voters, threshold=threshold, point=point))


@pytest.mark.parametrize("voters", range(1, 9))
def test_a_missing_vote_never_counts_as_clear_nor_makes_a_hazard_of_what_could_be_none(voters: int) -> None:
    """Every committee, threshold, point and way of filling in the missing votes: the rule, exhaustively."""
    for threshold, point, h in product(range(1, voters + 1), POINTS, range(voters + 1)):
        for m in range(voters - h + 1):
            said = one(h, m, voters, threshold, point)
            filled = {one(h + j, 0, voters, threshold, point) for j in range(m + 1)}
            if m and said != ABSTAIN:
                assert said == HAZARD
                assert filled == {HAZARD}
            if HAZARD in filled and filled != {HAZARD}:
                assert said == ABSTAIN, "a missing vote could have made it a hazard"
            if not m and point == "two_way":
                assert said == (HAZARD if h >= threshold else CLEAR)
            assert one(0, voters, voters, threshold, point) == ABSTAIN


@pytest.mark.parametrize("voters", range(1, 9))
def test_one_more_hazard_vote_never_speaks_for_clear(voters: int) -> None:
    """Every threshold, point and number of missing votes: from clear over nothing to hazard, and never back."""
    order = {CLEAR: 0, ABSTAIN: 1, HAZARD: 2}
    for threshold, point, m in product(range(1, voters + 1), POINTS, range(voters + 1)):
        said = [order[one(h, m, voters, threshold, point)] for h in range(voters - m + 1)]
        assert said == sorted(said), (threshold, point, m)
        assert not m or order[CLEAR] not in said


def test_the_operating_points_of_four_votes() -> None:
    """Hazard from two votes on; nothing on two against two; only four or none alike."""
    at = {point: [one(h, 0, 4, 2, point) for h in range(5)] for point in POINTS}
    assert at["two_way"] == [CLEAR, CLEAR, HAZARD, HAZARD, HAZARD]
    assert at["abstain"] == [CLEAR, CLEAR, ABSTAIN, HAZARD, HAZARD]
    assert at["unanimous"] == [CLEAR, ABSTAIN, ABSTAIN, ABSTAIN, HAZARD]
    without = {threshold: [one(h, 0, 4, threshold, "abstain") for h in range(5)] for threshold in (1, 3, 4)}
    assert without[1] == [CLEAR, ABSTAIN, ABSTAIN, HAZARD, HAZARD]
    assert without[3] == at["abstain"]
    assert without[4] == [CLEAR, CLEAR, ABSTAIN, ABSTAIN, HAZARD]


@pytest.mark.parametrize(("h", "m", "threshold"), [(3, 2, 2), (-1, 0, 2), (0, 0, 0), (0, 0, 5)])
def test_what_no_committee_of_four_can_say_is_refused(h: int, m: int, threshold: int) -> None:
    """Too many votes, fewer than none, and a threshold that no vote reaches."""
    with pytest.raises(ValueError, match=r"votes"):
        one(h, m, 4, threshold, "two_way")


def drawn(seed: int, models: int, frames: int, missing: float) -> tuple[Votes, Votes, Votes]:
    """Return votes, truth and the episode of each frame."""
    dice = np.random.default_rng(seed)
    truth = dice.random(frames) < 0.6
    truth[:2], truth[2:4] = True, False
    group = dice.integers(0, 4, frames)
    group[:8] = [0, 1, 0, 1, 2, 3, 2, 3]
    votes = (dice.random((models, frames, 2)) < np.where(truth, 0.7, 0.3)[None, :, None]).astype(np.int8)
    votes[dice.random(votes.shape) < missing] = MISSING
    return votes, truth, group


def worth(votes: Votes, truth: Votes, choice: tuple[tuple[int, ...], int, Point], costs: Costs | None) -> float:
    """Return what a choice is worth, frame by frame."""
    committee, threshold, point = choice
    own = votes[list(committee)]
    h, m = (own == 1).sum(axis=(0, 2)), (own == MISSING).sum(axis=(0, 2))
    answered = answers(h, m, voters=2 * len(committee), threshold=threshold, point=point).tolist()
    per_class: dict[bool, list[float]] = {True: [], False: []}
    for frame, said in enumerate(answered):
        if costs is None:
            per_class[bool(truth[frame])].append(float(said == (HAZARD if truth[frame] else CLEAR)))
        elif said == ABSTAIN:
            per_class[bool(truth[frame])].append(costs.false_alarm if costs.abstention is None else costs.abstention)
        elif truth[frame]:
            per_class[True].append(costs.miss if said == CLEAR else 0.0)
        else:
            per_class[False].append(costs.false_alarm if said == HAZARD else 0.0)
    means = {kind: float(np.mean(values)) for kind, values in per_class.items()}
    if costs is None:
        return (means[True] + means[False]) / 2
    rate = costs.hazard_rate or float(np.mean(truth))
    return -(rate * means[True] + (1 - rate) * means[False])


def slowly(votes: Votes, truth: Votes, size: int, costs: Costs | None) -> CommitteeChoice:
    """Return the best choice by trying each in the declared order."""
    points: tuple[Point, ...] = POINTS if costs is not None and costs.abstention is not None else ("two_way",)
    best: tuple[float, CommitteeChoice] | None = None
    every = list(combinations(range(len(votes)), size))
    able = [combination for combination in every if all((votes[model] == 1).any() for model in combination)]
    for committee in [*able, *(combination for combination in every if combination not in able)]:
        for threshold, point in product(range(1, 2 * size + 1), points):
            found = worth(votes, truth, (committee, threshold, point), costs)
            if best is None or found > best[0] + 1e-10:
                best = (found, CommitteeChoice(committee, threshold, point, found))
    assert best is not None
    return best[1]


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10_000),
    size=st.integers(1, 3),
    missing=st.sampled_from([0.0, 0.15]),
    mute=st.sets(st.integers(0, 3), max_size=3),
    costs=st.sampled_from([None, Costs(5, 1), Costs(5, 1, 0.5), Costs(1, 1, 0.1, hazard_rate=0.05)]),
)
def test_the_choice_is_that_of_trying_each_in_order(
    seed: int, size: int, missing: float, mute: set[int], costs: Costs | None
) -> None:
    """On all frames, and without each episode; ties in the declared order, also where some models never say hazard."""
    votes, truth, group = drawn(seed, 4, 24, missing)
    votes[sorted(mute)] = np.minimum(votes[sorted(mute)], 0)
    found = tally(votes, truth, group, size=size)
    choices = [select(found, costs), *select_without_each(found, costs)]
    kept = [np.ones(len(truth), dtype=bool), *(group != fold for fold in range(4))]
    for choice, mask in zip(choices, kept, strict=True):
        wanted = slowly(votes[:, mask], truth[mask], size, costs)
        assert (choice.committee, choice.threshold, choice.point) == (wanted.committee, wanted.threshold, wanted.point)
        assert choice.worth == pytest.approx(wanted.worth)


def test_a_tie_goes_to_the_first_committee_and_then_to_the_lowest_threshold() -> None:
    """Six models that all say the same: every pair and each threshold is as good."""
    truth = np.array([True, True, False, False])
    votes = np.broadcast_to(truth.astype(np.int8)[None, :, None], (6, 4, 2)).copy()
    choice = select(tally(votes, truth, np.zeros(4, dtype=np.int64), size=2))
    assert (choice.committee, choice.threshold, choice.worth) == ((0, 1), 1, 1.0)


def test_a_tie_never_takes_a_model_that_votes_no_hazard_where_it_may_take_another() -> None:
    """The first says clear always and the second votes on nothing: each is as good a partner, and each is passed by."""
    truth = np.array([True, True, False, False])
    votes = np.broadcast_to(truth.astype(np.int8)[None, :, None], (4, 4, 2)).copy()
    votes[0], votes[1] = CLEAR, MISSING
    one_episode, size = np.zeros(4, dtype=np.int64), 2
    assert select(tally(votes, truth, one_episode, size=size)).committee == (2, 3)
    assert select(tally(votes, truth, one_episode, size=1)).committee == (2,)
    alone = select(tally(votes[[0, 1, 2]], truth, one_episode, size=size))
    assert (alone.committee, alone.threshold, alone.worth) == ((0, 2), 1, 1.0), "with one that sees there is no other"
    worst = select(tally(np.stack([votes[0], votes[0], 1 - votes[2], 1 - votes[2]]), truth, one_episode, size=size))
    assert worst.worth == 0.5, "nobody is better than chance here"
    assert worst.committee == (0, 1), "and the others are worse than that"


def test_who_votes_hazard_is_asked_of_the_frames_that_choose() -> None:
    """A model that votes hazard in one episode alone cannot be told from a mute one by the others."""
    truth = np.array([True, False, True, False, True, False])
    group = np.array([0, 0, 1, 1, 2, 2])
    votes = np.broadcast_to(truth.astype(np.int8)[None, :, None], (3, 6, 2)).copy()
    votes[0, group != 1] = CLEAR
    chosen = select_without_each(tally(votes, truth, group, size=2))
    assert [choice.committee for choice in chosen] == [(0, 1), (1, 2), (0, 1)]


def test_frames_of_one_class_choose_nothing() -> None:
    """There is no balanced accuracy of hazards alone."""
    votes, truth, group = drawn(1, 3, 24, 0.0)
    with pytest.raises(ValueError, match="at least one hazardous and one clear"):
        select(tally(votes[:, truth], truth[truth], group[truth], size=2))
    with pytest.raises(ValueError, match="committee of 4 cannot be chosen from 3"):
        tally(votes, truth, group, size=4)


@pytest.mark.parametrize(
    "bad", [(-1, 1, None, None), (0, 0, None, None), (1, 1, -1, None), (1, 1, None, 1.0), (1e308, 1, None, None)]
)
def test_costs_that_cannot_be_are_refused(bad: tuple[float, float, float | None, float | None]) -> None:
    """Negative, all zero, and a rate of hazards that leaves no clear frame."""
    with pytest.raises(ValueError, match=r"costs|hazard_rate"):
        Costs(*bad)


def test_the_curve_ends_with_all_that_was_answered() -> None:
    """From unanimous frames to all: coverage grows, and the last point holds every error."""
    truth = np.array([True, True, True, False, False, False])
    votes = np.array([4, 3, 2, 0, 2, 1])
    said = answers(votes, 0, voters=4, threshold=2, point="two_way")
    curve = list(risk_coverage(votes, said, truth, voters=4))
    assert [(point.margin, point.answered, point.wrong) for point in curve] == [(4, 2, 0), (2, 4, 0), (0, 6, 1)]


def test_no_frames_are_counted_as_nothing() -> None:
    """Of three models without a frame every committee of two has its row, and no vote in it."""
    found = tally(np.zeros((3, 0, 2), np.int8), np.zeros(0, np.bool_), np.zeros(0, np.int64), size=2)
    assert found.committees.tolist() == [[0, 1], [0, 2], [1, 2]]
    assert (found.voters, found.counts.shape, int(found.counts.sum())) == (4, (3, 1, 2, 5), 0)
    assert found.hazard_votes.tolist() == [[0], [0], [0]]


def test_no_frames_have_no_answers() -> None:
    """An empty list of counts, which is none of floats."""
    assert answers([], [], voters=4, threshold=2, point="two_way").tolist() == []
