"""Intervals over episodes: they hold their own value, say no more than their parts, and show no false certainty."""

import random
from dataclasses import replace

import numpy as np
import pytest

from eyechart.stats.association import information_of_tables
from eyechart.stats.episodes import (
    difference_over_episodes,
    mean_of_shares,
    median_over_episodes,
    share_over_episodes,
)
from eyechart.stats.jackknife import FEW, association_interval, excess_over_half, mean_of_frames, over_tables
from eyechart.stats.paired_tests import SignTest
from eyechart.stats.resamples import permute_agreement
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.scores import statistics_of
from eyechart_organisms.calibration import SETTINGS
from eyechart_organisms.calibration.known_answers import KNOWN
from eyechart_organisms.calibration.replication import answers_of
from eyechart_organisms.calibration.world import make_world


def test_of_a_coin_the_interval_of_information_holds_none_and_its_own_value() -> None:
    """In nearly every data set, where resamples of the same tables held neither."""
    rng, held = np.random.default_rng(0), 0
    for _ in range(60):
        tables = rng.multinomial(3, np.full(5, 0.2), size=(12, 4)).astype(float)
        statistic = over_tables(tables, information_of_tables, 2.0)
        assert statistic.ci is not None
        assert statistic.value is not None
        assert statistic.ci[0] <= statistic.value <= statistic.ci[1]
        held += statistic.ci[0] <= 0
    assert held >= 57


@pytest.mark.parametrize("seed", range(40))
def test_no_interval_excludes_its_own_value(seed: int) -> None:
    """Whatever the counts are, also where Yates' correction makes a V of 0."""
    rng = random.Random(seed)  # noqa: S311 - no secret
    draw = np.random.default_rng(seed)
    episodes, rows, columns = rng.choice([2, 6, 12]), rng.choice([2, 4]), rng.choice([2, 5])
    tables = draw.poisson(rng.choice([0.3, 2, 8]), (episodes, rows, columns)).astype(float)
    tables[0, 0, 0] += 1
    frames = draw.integers(1, 13, episodes)
    one, other = (draw.binomial(frames, rng.choice([0, 0.1, 0.5, 1.0])) for _ in range(2))
    found = [
        over_tables(tables, information_of_tables, 3.0),
        association_interval(tables, 0.0),
        share_over_episodes(one, frames),
        difference_over_episodes((one, frames), (other, frames)),
        mean_of_shares((one, frames), (other, frames)),
        median_over_episodes(draw.integers(0, 4, 5 * episodes), np.repeat(np.arange(episodes), 5)),
    ]
    for each in found:
        if each.ci is not None and each.value is not None:
            assert each.ci[0] <= each.value <= each.ci[1], each
        else:
            assert each.note, each


def test_a_difference_to_nothing_has_the_interval_of_what_is_left() -> None:
    """An IDI of 1 with s of 0 is one number, and has one interval."""
    every, none = np.full(12, 12), np.zeros(12)
    idi = share_over_episodes(every, every)
    assert difference_over_episodes((every, every), (none, every)).ci == idi.ci


def test_the_mean_of_two_shares_is_no_surer_than_they_are() -> None:
    """Balanced accuracy beside a specificity of few frames."""
    near, far = (np.full(12, 10), np.full(12, 11)), (np.full(12, 2), np.full(12, 2))
    one, other, both = share_over_episodes(*near), share_over_episodes(*far), mean_of_shares(near, far)
    assert one.ci is not None
    assert other.ci is not None
    assert both.ci == pytest.approx(((one.ci[0] + other.ci[0]) / 2, (one.ci[1] + other.ci[1]) / 2))


def test_few_episodes_have_no_interval_and_the_reason() -> None:
    """It was measured from six on."""
    tables = np.ones((5, 2, 2))
    for found in (over_tables(tables, information_of_tables, 1.0), association_interval(tables, 0.0)):
        assert (found.ci, found.note) == (None, FEW)


def test_an_interval_that_excludes_its_value_is_told_from_a_sound_one() -> None:
    """Rounding apart, and also where a number was changed afterwards."""
    statistic = Statistic(0.5, 3, (0.4, 0.6))
    odd = (
        Statistic(0.5, 3, (0.6, 0.7)),
        Statistic(0.5, 3, (0.1, 0.49)),
        Statistic(0.5, 3, (float("nan"), 0.6)),
        replace(statistic, value=0.7),
        SignTest(0.5, 3, (0.6, 0.7), wins=1, losses=1, ties=1),
    )
    assert not any(each.is_sound for each in odd)
    sound = (statistic, statistic.less(0.1), Statistic(0.5, 3, (0.5 + 1e-12, 0.6)), Statistic(None, 3, (0.1, 0.2)))
    assert all(each.is_sound for each in sound)


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_no_statistic_of_a_score_excludes_its_own_value(name: str) -> None:
    """Of every statistic that a battery has, of every controller of known answer."""
    world = make_world(SETTINGS["default"], np.random.default_rng(1))
    answered = answers_of(KNOWN[name], SETTINGS["default"], world, random.Random(1))  # noqa: S311 - no secret
    for test, statistic in statistics_of(answered, Resampling(resamples=99)).items():
        assert statistic.is_sound, test


def test_the_agreement_of_random_orders_lies_in_its_interval_also_where_hardly_any_agrees() -> None:
    """Of one decision that stands once in each of two long series."""
    table = np.zeros((3, 3), dtype=int)
    table[0, 1], table[2, 0], table[2, 1] = 1, 1, 198
    statistic = permute_agreement(table, seed=0, resamples=500)
    assert statistic.ci is not None
    assert statistic.value is not None
    assert statistic.ci[0] <= statistic.value <= statistic.ci[1]


def test_a_mean_of_frames_has_the_interval_of_its_episodes() -> None:
    """By hand: episodes of means 1, 1, 1, 0, 0, 0 of four frames each; t of 5 degrees at .95 is 2.015."""
    scores = np.repeat([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], 4)
    statistic = mean_of_frames(scores, np.repeat(np.arange(6), 4))
    left = np.array([2 / 5] * 3 + [3 / 5] * 3)
    wide = 2.015048373 * np.sqrt(5 / 6 * ((left - 0.5) ** 2).sum())
    assert statistic.value == 0.5
    assert statistic.ci == pytest.approx((0.5 - wide, 0.5 + wide))


def test_frames_that_do_not_differ_leave_open_what_was_not_seen() -> None:
    """Of 36 frames without an effect .0799 of all may have one, and one on which each has it is bounded likewise."""
    none = mean_of_frames(np.zeros(36), np.repeat(np.arange(3), 12), fewest=2)
    assert none.ci == pytest.approx((-(1 - 0.05 ** (1 / 36)), 1 - 0.05 ** (1 / 36)))
    every = mean_of_frames(np.ones(36), np.repeat(np.arange(6), 6))
    assert every.ci == pytest.approx((1 - 2 * (1 - 0.05 ** (1 / 36)), 1.0))


def test_a_mean_of_frames_needs_episodes_and_answers() -> None:
    """A frame without a score is left out; five episodes have a mean and no interval."""
    scores = [1.0, np.nan, 0.0, 1.0, 1.0, 1.0]
    few = mean_of_frames(scores, list("abcdef"))
    assert (few.value, few.n, few.ci) == (0.8, 5, None)
    assert mean_of_frames([np.nan], ["a"]).value is None


@pytest.mark.parametrize("episodes", [6, 12, 24])
def test_either_end_covers_a_share_of_frames(episodes: int) -> None:
    """One-sided .95 of 400 banks of 12 frames an episode that read on three tenths of their frames."""
    rng, names = np.random.default_rng(episodes), np.repeat(np.arange(episodes), 12)
    ends = [mean_of_frames((rng.random(len(names)) < 0.3).astype(float), names).ci or (1.0, 0.0) for _ in range(400)]
    lows, highs = np.array(ends).T
    assert np.mean(lows <= 0.3) > 0.92
    assert np.mean(highs >= 0.3) > 0.91


def test_a_rate_less_half_of_another_has_the_interval_of_its_episodes() -> None:
    """By hand: 6 of 24 against 12 of 24 in six episodes, of which the first holds all six; and what cannot be said."""
    first = np.array([[4, 2, 0, 0, 0, 0], [4] * 6])
    second = np.array([[2] * 6, [4] * 6])
    statistic = excess_over_half(first, second, np.arange(6))
    left = np.array([2 / 20, 4 / 20, *[6 / 20] * 4]) - 1 / 4
    wide = 2.015048373 * np.sqrt(5 / 6 * ((left - left.mean()) ** 2).sum())
    assert (statistic.value, statistic.n) == (0.0, 24)
    assert statistic.ci == pytest.approx((-wide, wide))
    assert excess_over_half(first[:, :5], second[:, :5], np.arange(5)).ci is None
    assert excess_over_half(0 * first, second, np.arange(6)).value is None
