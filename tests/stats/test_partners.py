"""Partners: never of the same episode, another value always, each frame once where that can be."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eyechart.stats.partners import NOBODY, balanced_partners, matched_partners, near_partners, reaches


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(1, 9), min_size=2, max_size=9), st.integers(0, 99))
def test_a_partner_is_of_another_episode_and_each_frame_is_one_where_that_can_be(sizes: list[int], seed: int) -> None:
    """It can be where no episode has more than half of the frames."""
    episodes = [number for number, size in enumerate(sizes) for _ in range(size)]
    found = balanced_partners(episodes, list(range(len(episodes))), seed=seed)
    assert all(episodes[place] != episodes[partner] for place, partner in enumerate(found))
    if 2 * max(sizes) <= len(episodes):
        assert sorted(found) == list(range(len(episodes)))


def test_a_partner_differs_in_what_is_exchanged() -> None:
    """Two instructions in turn: each frame is told the other one, of another episode."""
    episodes, told = np.repeat(np.arange(8), 5), np.repeat(["red", "blue"] * 4, 5)
    found = balanced_partners(list(episodes), list(told), seed=3)
    assert (told[found] != told).all()
    assert (episodes[found] != episodes).all()
    assert sorted(found) == list(range(40))


def test_partners_are_spread_over_the_other_episodes() -> None:
    """The ten frames of an episode have partners of at least four others."""
    episodes = np.repeat(np.arange(12), 10)
    found = balanced_partners(list(episodes), list(range(120)), seed=1)
    assert min(len(set(episodes[found[episodes == index]])) for index in range(12)) >= 4


def test_who_has_no_partner_gets_nobody_and_others_any() -> None:
    """One value leaves nobody; a rare value is used more than once."""
    assert set(balanced_partners([0, 1, 2], ["same"] * 3, seed=0)) == {NOBODY}
    found = balanced_partners([0, 0, 1, 1, 2], ["a", "a", "a", "a", "b"], seed=0)
    assert found[:4].tolist() == [4, 4, 4, 4]
    assert found[4] in range(4)
    with pytest.raises(ValueError, match="2 episodes and 1 values"):
        balanced_partners([0, 1], ["a"], seed=0)


def test_matched_partners_are_the_nearest_of_another_episode() -> None:
    """Each number in its own spread: the second one, in another unit, counts as much as the first."""
    states = np.array([[0.0, 0], [0.1, 0], [0.2, 10], [1.0, 900], [0.9, 1000]])
    assert matched_partners([0, 0, 1, 1, 2], states).tolist() == [2, 2, 1, 4, 3]
    assert matched_partners([0, 0, 1, 1, 2], states, within=0.02).tolist() == [NOBODY, 2, 1, NOBODY, NOBODY]
    assert matched_partners([0, 1], [[5.0], [5.0]]).tolist() == [1, 0]
    assert set(matched_partners([0, 0], [[1.0], [2.0]])) == {NOBODY}
    with pytest.raises(ValueError, match="one row a frame"):
        matched_partners([0, 1], [[1.0]])


def test_a_near_partner_is_of_the_own_episode_and_as_far_off_as_the_match() -> None:
    """Where the episode has no other frame, or the frame no match, there is none."""
    episodes = ["a", "a", "a", "b", "b", "c"]
    states = [[0.0], [0.1], [1.0], [0.12], [5.0], [1.05]]
    matched = matched_partners(episodes, states)
    assert list(matched) == [3, 3, 5, 1, NOBODY, 2]
    assert list(near_partners(episodes, states, matched)) == [2, 0, 1, 4, NOBODY, NOBODY]


def test_a_near_partner_is_as_far_off_in_every_number() -> None:
    """One that moves its gripper alone is no match for one that moves its arm; what falls short is said."""
    episodes = ["a"] * 3 + ["b"]
    states = np.array([[0.0, 0.0], [0.0, 9.0], [0.2, 0.1], [0.2, 0.0]])
    matched = np.array([3, NOBODY, NOBODY, NOBODY])
    near = near_partners(episodes, states, matched)
    assert list(near) == [2, NOBODY, NOBODY, NOBODY]
    here = np.array([0])
    assert list(reaches(states, here, near[here], matched[here])) == [pytest.approx(1.0), np.inf]
    assert list(reaches(states, here, np.array([1]), matched[here])) == [0.0, np.inf]
    assert set(reaches(states, here, np.array([1]), here)) == {np.inf}


def test_a_partner_by_state_has_another_value() -> None:
    """The nearest that has, of another episode; of the own one likewise."""
    states = [[0.0], [0.1], [0.02], [0.11], [0.0]]
    episodes, told = ["a", "a", "b", "b", "c"], ["x", "y", "x", "x", "y"]
    matched = matched_partners(episodes, states, told, within=1.0)
    assert list(matched) == [4, 3, 4, 1, 0]
    assert list(near_partners(episodes, states, matched, told)) == [1, 0, NOBODY, NOBODY, NOBODY]
    assert set(matched_partners(episodes, states, ["x"] * 5)) == {NOBODY}
    with pytest.raises(ValueError, match="5 episodes and 1 values"):
        matched_partners(episodes, states, ["x"])
