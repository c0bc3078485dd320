"""What each statistic says of itself where it stands in a table: method, reason, counts, unit and level, word by word.

A reader who sees a number without its test, or a dash without its reason, cannot judge it; so these words are pinned.
"""

import re
from collections.abc import Callable

import numpy as np
import pytest

from eyechart.stats import (
    agreement,
    association,
    correlation,
    episode_permutation,
    episodes,
    forced_choice,
    order,
    paired_tests,
    resamples,
    risk_bounds,
    sign_flip,
    total_effect,
)
from eyechart.stats.statistic import Statistic, not_available

Said = dict[str, object]
Case = tuple[Callable[[], Statistic], Said]

FISHER = "Pearson correlation, two-sided t test, 90% Fisher interval"
BONETT = "Spearman's rank correlation, two-sided p (exact over 24 orders), 90% interval of Bonett and Wright"
FLIPPED = "two-sided test by flipping the signs of paired differences"
FOLLOWED = "share of what follows fully, one-sided test by flipping the signs of episodes"
RISE = "greatest rise between neighbouring windows, in its standard errors; p: permutation of frames"
SIGN = "one-sided exact sign test, 90% Clopper-Pearson interval"
TANGO = "paired difference of proportions, 90% Tango score interval"
WITHIN = "equal within group; p: exact conditional test over the groups' tables, one-sided"
CHI2 = "chi-squared test of independence, Yates"
MI = "mutual information in bits, i.i.d. permutation, B=99"
TREND = "one-sided trend, whole episodes exchanged within scenario"
BITS = "mutual information in bits, whole episodes exchanged within scenario"
OWN = "share of own variation, jackknife over owners and partners, 90% interval"
APART = "difference of shares, jackknife over owners and partners, 90% interval"
FIT = "squared error over the variance of the logged actions, 90% interval over episodes"
TWO_ANSWERS = "squared distance of two answers to one frame, over that to another episode's"
NO_VARIATION = "the answers do not vary from episode to episode"
LONE = "one row or one column: nothing can depend on it"
POOLED = "pooled kappa, 98% Wilson interval of the agreement, chance held fixed"


def _pairs(values: list[float], owner: list[int], partner: list[int]) -> total_effect.Pairs:
    return total_effect.Pairs(np.array(values), np.array(owner), np.array(partner))


RING = ([0, 1, 2, 0, 1, 2], [1, 2, 0, 2, 0, 1])
MOVES = _pairs([1.0, 2.0, 3.0, 1.5, 2.5, 2.0], *RING)
TWICE_AS_FAR = _pairs([2.0, 4.0, 6.0, 3.0, 5.0, 4.0], *RING)
STILL = _pairs([0.0] * 6, *RING)
TWO = _pairs([1.0, 2.0], [0, 1], [1, 0])

CASES: dict[str, Case] = {
    "rate of nothing": (
        lambda: agreement.rate(0, 0, level=0.9),
        {"value": None, "n": 0, "method": "share, 90% Wilson interval", "note": "no observations"},
    ),
    "rate": (
        lambda: agreement.rate(3, 4, level=0.9),
        {"n": 4, "method": "share, 90% Wilson interval", "level": 0.9, "detail": {"k": 3}},
    ),
    "kappa of nothing": (
        lambda: agreement.cohens_kappa([], []),
        {"value": None, "n": 0, "method": "Cohen's kappa", "note": "no observations"},
    ),
    "kappa of one constant": (
        lambda: agreement.cohens_kappa([1, 1], [1, 1]),
        {
            "value": None,
            "n": 2,
            "method": "Cohen's kappa",
            "note": "both sequences are the same constant: chance agreement is 1",
        },
    ),
    "kappa": (
        lambda: agreement.cohens_kappa([0, 1, 1, 0], [0, 1, 0, 1], level=0.9),
        {"n": 4, "method": "Cohen's kappa, 90% asymptotic interval", "level": 0.9},
    ),
    "kappa of equals": (
        lambda: agreement.cohens_kappa([0, 1, 1, 0], [0, 1, 1, 0], level=0.9),
        {
            "value": 1.0,
            "method": "Cohen's kappa, 90% Wilson interval of the agreement, marginals held fixed",
            "level": 0.9,
            "detail": {"agreement": 1.0, "chance": 0.5, "standard_error": 0.0},
        },
    ),
    "pooled kappa of one frame": (
        lambda: agreement.pooled_kappa([[0, 1], [-1, 1]]),
        {"value": None, "n": 0, "method": POOLED, "note": "0 frames have two answers to compare"},
    ),
    "pooled kappa of a constant": (
        lambda: agreement.pooled_kappa([[1, 1], [1, 1], [1, 1]]),
        {"value": None, "n": 3, "method": POOLED, "note": "all answers are the same: chance agreement is 1"},
    ),
    "swaps of nobody": (
        lambda: agreement.swap_test(["STAY"], ["STAY"], {"LEFT": "RIGHT", "RIGHT": "LEFT"}, seed=0, level=0.9),
        {
            "value": None,
            "n": 0,
            "method": "share, 90% Wilson interval",
            "note": "no directional decisions",
            "detail": {"directions": {"LEFT": 0, "RIGHT": 0}},
            "level": 0.9,
        },
    ),
    "balanced accuracy of one class": (
        lambda: agreement.binary_metrics(tp=2, fn=1, tn=0, fp=0)["bal"],
        {"value": None, "n": 3, "method": "balanced accuracy", "note": "one of the two classes is empty"},
    ),
    "balanced accuracy": (
        lambda: agreement.binary_metrics(tp=2, fn=2, tn=1, fp=0)["bal"],
        {"value": 0.75, "n": 5, "method": "mean of sensitivity and specificity", "ci": None},
    ),
    "chi squared of nothing": (
        lambda: association.chi2_test([[0, 0], [0, 0]]),
        {"value": None, "n": 0, "method": CHI2, "note": "the table is empty"},
    ),
    "chi squared of one row": (
        lambda: association.chi2_test([[3, 4], [0, 0]]),
        {
            "value": 0.0,
            "n": 7,
            "p": 1.0,
            "method": CHI2,
            "note": LONE,
            "detail": {"dof": 0, "shape": [1, 2], "smallest_expected": None},
        },
    ),
    "chi squared": (
        lambda: association.chi2_test([[3, 1], [1, 3]], correction=False),
        {
            "value": 2.0,
            "n": 8,
            "method": "chi-squared test of independence",
            "detail": {"dof": 1, "shape": [2, 2], "smallest_expected": 2.0},
        },
    ),
    "Cramér's V of nothing": (
        lambda: association.cramers_v([[0]]),
        {"value": None, "n": 0, "method": "Cramér's V", "note": "the table is empty"},
    ),
    "Cramér's V of one column": (
        lambda: association.cramers_v([[3], [4]]),
        {"value": 0.0, "n": 7, "p": 1.0, "method": f"Cramér's V, {CHI2}", "note": LONE},
    ),
    "entropy of nothing": (
        lambda: association.entropy_bits([]),
        {"value": None, "n": 0, "method": "plug-in entropy, bits", "note": "no observations"},
    ),
    "entropy": (
        lambda: association.entropy_bits(["a", "b", "a", "b"]),
        {"value": 1.0, "n": 4, "method": "plug-in entropy, bits", "unit": "bits", "detail": {"labels": 2}},
    ),
    "mode of nothing": (
        lambda: association.modal_share([]),
        {"value": None, "n": 0, "method": "share of the most frequent label", "note": "no observations"},
    ),
    "mode": (
        lambda: association.modal_share(["b", "a", "a", "b"]),
        {"value": 0.5, "n": 4, "method": "share of the most frequent label", "detail": {"mode": "a"}},
    ),
    "Pearson of two pairs": (
        lambda: correlation.pearson_p(0.5, 2, level=0.9),
        {
            "value": 0.5,
            "n": 2,
            "p": None,
            "ci": None,
            "method": FISHER,
            "note": "three pairs are needed for a test",
        },
    ),
    "Pearson of a line": (
        lambda: correlation.pearson_p(-1, 3, level=0.9),
        {"value": -1, "n": 3, "p": 0.0, "ci": None, "method": FISHER, "note": ""},
    ),
    "Pearson of two points on a line": (
        lambda: correlation.pearson_p(1, 2, level=0.9),
        {"value": 1, "n": 2, "p": None, "method": FISHER, "note": "three pairs are needed for a test"},
    ),
    "Pearson of three pairs": (
        lambda: correlation.pearson_p(0.5, 3, level=0.9),
        {"value": 0.5, "n": 3, "p": pytest.approx(2 / 3), "ci": None, "method": FISHER},
    ),
    "Pearson": (
        lambda: correlation.pearson_p(0.0, 4, level=0.9),
        {"n": 4, "p": pytest.approx(1.0), "method": FISHER, "level": 0.9},
    ),
    "Pearson of three pairs given": (
        lambda: correlation.pearson([1, 2, 3], [1, 2, 4]),
        {
            "value": None,
            "n": 3,
            "method": "Pearson correlation",
            "note": "3 pairs are too few for a correlation; 4 are the least",
        },
    ),
    "Pearson of a constant": (
        lambda: correlation.pearson([1, 1, 1, 1], [1, 2, 4, 3]),
        {"value": None, "n": 4, "method": "Pearson correlation", "note": "one of the two columns is constant"},
    ),
    "Spearman of a constant": (
        lambda: correlation.spearman([1, 2, 4, 3], [1, 1, 1, 1], level=0.9),
        {"value": None, "n": 4, "method": BONETT, "note": "one of the two columns is constant"},
    ),
    "Spearman": (
        lambda: correlation.spearman([1, 2, 3, 4], [1, 2, 4, 3], level=0.9),
        {"value": pytest.approx(0.8), "n": 4, "p": pytest.approx(8 / 24), "method": BONETT, "level": 0.9},
    ),
    "Spearman of ten": (
        lambda: correlation.spearman(range(10), [1, 0, *range(2, 10)]),
        {
            "n": 10,
            "method": "Spearman's rank correlation, two-sided p (t approximation), 95% interval of Bonett and Wright",
        },
    ),
    "share over no episodes": (
        lambda: episodes.share_over_episodes([0], [0], level=0.9),
        {"value": None, "n": 0, "method": "share of frames, 90% interval over episodes", "note": "no frames"},
    ),
    "share over one episode": (
        lambda: episodes.share_over_episodes([1, 0], [4, 0], level=0.9),
        {
            "value": 0.25,
            "n": 4,
            "ci": None,
            "method": "share of frames, 90% interval over episodes",
            "note": "one episode shows no spread",
            "detail": {"k": 1, "episodes": 1},
            "level": 0.9,
        },
    ),
    "share over episodes of one frame": (
        lambda: episodes.share_over_episodes([1, 0, 1], [1, 1, 1], level=0.9),
        {"n": 3, "method": "share, 90% Wilson interval", "detail": {"k": 2, "episodes": 3}, "level": 0.9},
    ),
    "share over equal episodes": (
        lambda: episodes.share_over_episodes([1, 1, 1], [4, 4, 4], level=0.9),
        {
            "n": 12,
            "method": "share of frames, 90% interval over episodes, exact: no episode differs",
            "detail": {"k": 3, "episodes": 3},
            "level": 0.9,
        },
    ),
    "share over unequal episodes": (
        lambda: episodes.share_over_episodes([1, 2, 1], [4, 4, 4], level=0.9),
        {
            "n": 12,
            "method": "share of frames, 90% interval over episodes"
            " (beta-binomial likelihood, correlation integrated out)",
            "detail": {"k": 4, "episodes": 3},
            "level": 0.9,
        },
    ),
    "trend of one frame": (
        lambda: episode_permutation.iid_trend_test([1], [1.0], seed=0, resamples=9),
        {
            "value": None,
            "n": 1,
            "method": "one-sided trend, frames permuted, B=9",
            "note": "two decisions are needed to permute",
        },
    ),
    "trend": (
        lambda: episode_permutation.iid_trend_test([2, 1, 0], [1.0, 1.0, 1.0], seed=0, resamples=9),
        {"value": 3.0, "n": 3, "p": 1.0, "null_mean": 3.0, "null_sd": 0.0},
    ),
    "exchange without decisions": (
        lambda: episode_permutation.exchange_test(
            [-1] * 12, range(12), [0] * 12, [0, 1, 2, 3, 4, 5] * 2, range(12), seed=0
        ),
        {"value": None, "n": 0, "method": TREND, "note": "no decisions"},
    ),
    "exchange of too few episodes": (
        lambda: episode_permutation.exchange_test(
            [1, 0, 1, 0], [1, 2, 3, 4], [0] * 4, [0, 0, 1, 1], [0, 1, 0, 1], seed=0
        ),
        {
            "value": None,
            "n": 4,
            "p": None,
            "method": TREND,
            "note": "exchanging 2 episodes per scenario gives a p of 0.5 at best, above 0.01",
            "detail": {
                "episodes": [2],
                "truncated_frames": 0,
                "shifted_frames": 0,
                "excluded": [],
                "smallest_p": 0.5,
            },
        },
    ),
    "exchange": (
        lambda: episode_permutation.exchange_mi_test(
            ["a", "b"] * 5, ["x", "y"] * 5, [0] * 10, np.repeat(np.arange(5), 2), [0, 1] * 5, seed=0
        ),
        {
            "value": 1.0,
            "n": 10,
            "p": 1.0,
            "method": f"{BITS}, all 120 arrangements",
            "unit": "bits",
            "detail": {
                "episodes": [5],
                "truncated_frames": 0,
                "shifted_frames": 0,
                "excluded": [],
                "smallest_p": 1 / 120,
            },
        },
    ),
    "flips of no pairs": (
        lambda: sign_flip.sign_flip_test([], [], seed=0),
        {"value": None, "n": 0, "method": FLIPPED, "note": "no pairs"},
    ),
    "flips of equals": (
        lambda: sign_flip.sign_flip_test([1, 2], [1, 2], seed=0),
        {
            "value": 0.0,
            "n": 2,
            "p": 1.0,
            "method": FLIPPED,
            "note": "all pairs are equal",
            "detail": {
                "larger": 0,
                "smaller": 0,
                "equal": 2,
                "first_mean": 1.5,
                "second_mean": 1.5,
                "smallest_p": 1.0,
            },
        },
    ),
    "flips": (
        lambda: sign_flip.sign_flip_test([3, 2, 5], [1, 2, 6], seed=0),
        {
            "value": pytest.approx(1 / 3),
            "n": 3,
            "p": 1.0,
            "method": f"{FLIPPED}, all 4 patterns",
            "detail": {
                "larger": 1,
                "smaller": 1,
                "equal": 1,
                "first_mean": pytest.approx(10 / 3),
                "second_mean": 3.0,
                "smallest_p": 0.5,
            },
        },
    ),
    "flips of many": (
        lambda: sign_flip.sign_flip_test(range(1, 16), [0] * 15, seed=0, resamples=19),
        {"n": 15, "p": 0.05, "method": f"{FLIPPED}, B=19"},
    ),
    "nothing to follow": (
        lambda: sign_flip.follow([1.0, 2.0], [0.0, 0.0], [0, 1], seed=0),
        {"value": None, "n": 2, "method": FOLLOWED, "note": "nothing was moved that could be followed"},
    ),
    "one episode that follows": (
        lambda: sign_flip.follow([1.0, 2.0], [2.0, 4.0], [0, 0], seed=0),
        {
            "value": 0.5,
            "n": 2,
            "p": 0.5,
            "ci": None,
            "method": FOLLOWED,
            "note": "one episode shows no spread",
            "episodes": 1,
            "smallest_p": 0.5,
        },
    ),
    "two episodes that follow": (
        lambda: sign_flip.follow([1.0, 2.0], [2.0, 4.0], [0, 1], seed=0),
        {
            "value": 0.5,
            "n": 2,
            "p": 0.25,
            "method": FOLLOWED,
            "note": "",
            "episodes": 2,
            "smallest_p": 0.25,
            "level": 0.98,
        },
    ),
    "bound over no episodes": (
        lambda: risk_bounds.share_bound(0, 0, confidence=0.9),
        {
            "value": None,
            "n": 0,
            "method": "one-sided exact upper bound at confidence 0.9 (Clopper–Pearson), over episodes",
            "note": "no episodes",
        },
    ),
    "bound of a share": (
        lambda: risk_bounds.share_bound(5, 5, confidence=0.9),
        {
            "value": 1.0,
            "n": 5,
            "ci": (0.0, 1.0),
            "method": "one-sided exact upper bound at confidence 0.9 (Clopper–Pearson), over episodes",
            "detail": {"k": 5},
            "level": 0.9,
        },
    ),
    "bound of a mean of nothing": (
        lambda: risk_bounds.mean_bound([], confidence=0.9),
        {
            "value": None,
            "n": 0,
            "method": "one-sided upper bound at confidence 0.9 (Hoeffding–Bentkus), over episodes",
            "note": "no episodes",
        },
    ),
    "bound of a mean": (
        lambda: risk_bounds.mean_bound([0, 0, 0], confidence=0.875),
        {
            "value": 0.0,
            "n": 3,
            "ci": (0.0, pytest.approx(0.5, abs=2e-9)),
            "method": "one-sided upper bound at confidence 0.875 (Hoeffding–Bentkus), over episodes",
            "level": 0.875,
        },
    ),
    "bound of a ratio of nothing": (
        lambda: risk_bounds.ratio_bound([0], [0], 3, confidence=0.9),
        {
            "value": None,
            "n": 0,
            "method": "one-sided upper bound at confidence 0.9 (bets on episodes), over frames of whole episodes",
            "note": "no frames",
        },
    ),
    "bound of a ratio": (
        lambda: risk_bounds.ratio_bound([2, 0, 3], [2, 0, 3], 3, confidence=0.9),
        {
            "value": 1.0,
            "n": 5,
            "ci": (0.0, 1.0),
            "detail": {"events": 5, "episodes": 2, "longest": 3},
            "level": 0.9,
        },
    ),
    "no question": (
        lambda: forced_choice.right([]),
        {
            "value": None,
            "n": 0,
            "method": "share right; exact randomisation p; Clopper–Pearson, 95 % at each end",
            "note": "no question was answered",
        },
    ),
    "questions": (
        lambda: forced_choice.right([forced_choice.Block(2, [0, 1], [0, 1])]),
        {
            "value": 1.0,
            "n": 2,
            "p": 0.5,
            "right": 2,
            "expected": 1.0,
            "method": "share right; exact randomisation p; Clopper–Pearson, 95 % at each end",
            "level": pytest.approx(0.9),
        },
    ),
    "too few answers along a scale": (
        lambda: order.greatest_rise([range(11)], [range(11)], seed=0),
        {"value": None, "n": 11, "method": RISE, "note": "11 answers; 12 are needed"},
    ),
    "alike along a scale": (
        lambda: order.greatest_rise([range(12)], [[2.0] * 12], seed=0),
        {"value": 0.0, "n": 12, "p": 1.0, "method": RISE, "note": "all levels are alike"},
    ),
    "rising along a scale": (
        lambda: order.greatest_rise([range(12)], [range(12)], seed=0, resamples=19),
        {"n": 12, "method": RISE, "nearer": (0.0, 5.0), "farther": (6.0, 11.0)},
    ),
    "signs of nothing": (
        lambda: paired_tests.sign_test([], [], level=0.9),
        {
            "value": None,
            "n": 0,
            "p": 1.0,
            "method": SIGN,
            "note": "no discordant pairs",
            "detail": {"mean_difference": None},
            "level": 0.9,
            "wins": 0,
            "losses": 0,
            "ties": 0,
        },
    ),
    "signs": (
        lambda: paired_tests.sign_test([3, 1, 2, 5], [1, 2, 2, 1], level=0.9),
        {
            "value": pytest.approx(2 / 3),
            "n": 3,
            "p": 0.5,
            "method": SIGN,
            "note": "",
            "detail": {"mean_difference": 1.25},
            "level": 0.9,
            "wins": 2,
            "losses": 1,
            "ties": 1,
        },
    ),
    "net effect of nothing": (
        lambda: paired_tests.net_effect(0, 0, 0, alpha=0.05),
        {"value": None, "n": 0, "method": TANGO, "note": "no pairs"},
    ),
    "net effect": (
        lambda: paired_tests.net_effect(3, 1, 8, alpha=0.05),
        {"value": 0.25, "n": 8, "method": TANGO, "detail": {"margin": 0.1}, "level": 0.9, "b": 3, "c": 1},
    ),
    "bounded": (
        lambda: paired_tests.bounded_below([1, 0, 0], [0, 0, 0], alpha=0.05),
        {
            "n": 3,
            "method": TANGO,
            "detail": {"margin": 0.1, "alpha": 0.05, "bounded": False},
            "level": 0.9,
            "b": 1,
            "c": 0,
        },
    ),
    "no group varies": (
        lambda: paired_tests.stratified_association([1, 1], [0, 1], ["a", "a"], level=0.9),
        {
            "value": None,
            "n": 0,
            "p": 1.0,
            "method": WITHIN,
            "note": "in no group do both outcomes vary",
            "level": 0.9,
        },
    ),
    "one group varies": (
        lambda: paired_tests.stratified_association([1, 0, 1], [1, 0, 0], ["a", "a", "b"], level=0.9),
        {"value": 1.0, "n": 2, "p": pytest.approx(0.5), "method": WITHIN, "level": 0.9},
    ),
    "McNemar of nothing": (
        lambda: paired_tests.mcnemar_exact(0, 0),
        {"value": None, "n": 0, "p": 1.0, "method": "two-sided exact McNemar test", "note": "no discordant pairs"},
    ),
    "McNemar": (
        lambda: paired_tests.mcnemar_exact(1, 3),
        {"value": 0.25, "n": 4, "p": 0.625, "method": "two-sided exact McNemar test", "b": 1, "c": 3},
    ),
    "labels of no pairs": (
        lambda: paired_tests.label_swap_test([], [], seed=0),
        {"value": None, "n": 0, "method": "within-frame label swap", "note": "no pairs"},
    ),
    "labels": (
        lambda: paired_tests.label_swap_test(["a", "a", "b"], ["b", "b", "b"], seed=0),
        {
            "value": 8.0,
            "n": 3,
            "p": 0.5,
            "method": "within-frame label swap, enumerated",
            "detail": {"labels": ["a", "b"], "discordant": 2},
            "first": (2, 1),
            "second": (0, 3),
        },
    ),
    "information of nothing": (
        lambda: resamples.permute_mutual_information([[0, 0], [0, 0]], seed=0, resamples=99),
        {"value": None, "n": 0, "method": MI, "note": "the table is empty"},
    ),
    "information of one row": (
        lambda: resamples.permute_mutual_information([[3, 4]], seed=0, resamples=99),
        {"value": 0.0, "n": 7, "p": 1.0, "method": MI, "note": LONE, "unit": "bits"},
    ),
    "information": (
        lambda: resamples.permute_mutual_information([[1, 0], [0, 1]], seed=0, resamples=99),
        {"value": 1.0, "n": 2, "p": 1.0, "method": MI, "unit": "bits", "detail": {"resample_mean": 1.0}},
    ),
    "effect of two episodes": (
        lambda: total_effect.total_effect(TWO, TWO, level=0.9),
        {"value": None, "n": 2, "method": OWN, "note": "2 episodes have both answers, and three are needed"},
    ),
    "effect of one pair for each episode": (
        lambda: total_effect.total_effect(MOVES, _pairs([1.0, 2.0, 3.0], [0, 1, 1], [1, 0, 0]), level=0.9),
        {
            "value": None,
            "n": 6,
            "method": OWN,
            "note": "too few pairs of episodes: without one of them none is left",
        },
    ),
    "effect of what stands still": (
        lambda: total_effect.total_effect(MOVES, STILL, level=0.9),
        {"value": None, "n": 6, "method": OWN, "note": NO_VARIATION},
    ),
    "effect": (
        lambda: total_effect.total_effect(MOVES, TWICE_AS_FAR, level=0.9),
        {
            "value": 0.5,
            "n": 6,
            "ci": (0.5, 0.5),
            "method": OWN,
            "episodes": 3,
            "detail": {"standard_error": 0.0, "effect": 2.0, "variation": 4.0},
            "level": 0.9,
        },
    ),
    "difference of two episodes": (
        lambda: total_effect.share_difference((TWO, TWO), (TWO, TWO), level=0.9),
        {"value": None, "n": 2, "method": APART, "note": "2 episodes have both answers, and three are needed"},
    ),
    "difference of what stands still": (
        lambda: total_effect.share_difference((MOVES, MOVES), (MOVES, STILL), level=0.9),
        {"value": None, "n": 6, "method": APART, "note": NO_VARIATION},
    ),
    "difference": (
        lambda: total_effect.share_difference((MOVES, TWICE_AS_FAR), (MOVES, MOVES), level=0.9),
        {
            "value": 0.5,
            "n": 6,
            "ci": (0.5, 0.5),
            "p": 0.0,
            "method": APART,
            "detail": {"episodes": 3, "standard_error": 0.0},
            "level": 0.9,
        },
    ),
    "no difference": (
        lambda: total_effect.share_difference((MOVES, MOVES), (MOVES, MOVES), level=0.9),
        {"value": 0.0, "n": 6, "p": 1.0},
    ),
    "noise of no frame": (
        lambda: total_effect.noise_share([], [], []),
        {"value": None, "n": 0, "method": TWO_ANSWERS, "note": "no frame was answered twice"},
    ),
    "noise of what stands still": (
        lambda: total_effect.noise_share([[1.0]], [[2.0]], [[1.0]]),
        {"value": None, "n": 1, "method": TWO_ANSWERS, "note": NO_VARIATION},
    ),
    "noise": (
        lambda: total_effect.noise_share([[1.0], [1.0]], [[2.0], [1.0]], [[3.0], [1.0]]),
        {"value": 0.25, "n": 2, "method": TWO_ANSWERS},
    ),
    "fit to no log": (
        lambda: total_effect.misfit_share([], [], np.zeros(0, np.intp), level=0.9),
        {"value": None, "n": 0, "method": FIT, "note": "no frame has an answer and a logged action"},
    ),
    "fit to a log that stands still": (
        lambda: total_effect.misfit_share([[[1.0]]], [[[2.0]]], np.zeros(1, np.intp), level=0.9),
        {"value": None, "n": 1, "method": FIT, "note": "the logged actions are all the same"},
    ),
    "fit to two episodes": (
        lambda: total_effect.misfit_share([[[1.0]], [[2.0]]], [[[2.0]], [[-2.0]]], np.arange(2), level=0.9),
        {"value": 2.125, "n": 2, "ci": None, "method": FIT, "note": "fewer than three episodes"},
    ),
    "fit to three episodes": (
        lambda: total_effect.misfit_share(
            [[[1.0]], [[2.0]], [[1.0]]], [[[2.0]], [[0.0]], [[1.0]]], np.arange(3), level=0.9
        ),
        {"value": pytest.approx(2.5), "n": 3, "method": OWN, "level": 0.9},
    ),
    "cannot say": (lambda: not_available("why"), {"value": None, "n": 0, "method": "", "note": "why"}),
}


@pytest.mark.parametrize("name", CASES)
def test_a_statistic_says_what_it_is(name: str) -> None:
    """What stands beside a number, or in place of it, is this and no other; what is not named here has no note."""
    make, said = CASES[name]
    found = make()
    expected = {"note": "", **said}
    assert {one: getattr(found, one) for one in expected} == expected


REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "more hits than trials": (
        lambda: agreement.rate(3, 2),
        "a rate needs 0 <= k <= n, got k=3 of n=2: check what is counted",
    ),
    "IDI above 1": (
        lambda: agreement.clears_floor(1.5, 0.5),
        "IDI=1.5 is not a rate: give a share between 0 and 1",
    ),
    "s below 0": (lambda: agreement.clears_floor(0.5, -0.5), "s=-0.5 is not a rate: give a share between 0 and 1"),
    "a negative count": (
        lambda: agreement.binary_metrics(tp=0, fn=-1, tn=0, fp=0),
        "fn=-1 is no count: give the number of frames",
    ),
    "lengths of labels": (
        lambda: agreement.cohens_kappa([1], [1, 2]),
        "1 labels against 2: give both for the same frames",
    ),
    "kinds of labels": (
        lambda: agreement.cohens_kappa([1], ["a"]),
        "labels of type int64 against <U1: encode both alike",
    ),
    "a level of 1": (lambda: agreement.rate(1, 2, level=1), "level=1 must lie between 0 and 1, for example 0.95"),
    "a tail of nothing": (
        lambda: agreement.binomial_tail(3, 2, 0.5),
        "a binomial tail needs 0 <= k <= n and a chance in [0, 1], got 3, 2, 0.5",
    ),
    "lengths of tables": (
        lambda: association.contingency(["a"], ["a", "b"]),
        "1 labels against 2: give both for the same frames",
    ),
    "labels in a matrix": (
        lambda: association.contingency([["a"]], ["a"]),
        "the first labels have shape (1, 1): give one label per frame",
    ),
    "labels of numbers": (
        lambda: association.contingency(["a"], [0.5]),
        (
            "the second labels are of type float64: give strings or integers, "
            "a missing one dropped or as a label of its own"
        ),
    ),
    "no bin": (lambda: association.quantile_bins([1.0], 0), "bins=0: ask for at least one"),
    "a gap of less than nothing": (
        lambda: association.quantile_bins([1.0, -np.inf]),
        "gap number 1 is -inf: a gap is a distance in metres",
    ),
    "no correlation": (
        lambda: correlation.pearson_p(1.5, 9),
        "r=1.5 is no correlation: give a number between -1 and 1",
    ),
    "columns that do not fit": (
        lambda: correlation.pearson([1, 2], [1, 2, 3]),
        "two columns of finite numbers of one length are needed, got (2,) and (3,)",
    ),
    "lengths of pairs": (
        lambda: sign_flip.sign_flip_test([1], [1, 2], seed=0),
        "1 values against 2: give both for the same worlds",
    ),
    "first is not finite": (
        lambda: sign_flip.sign_flip_test([np.inf], [1], seed=0),
        "the first values must be one finite number per world: leave out the worlds without one",
    ),
    "second is not finite": (
        lambda: sign_flip.sign_flip_test([1], [np.nan], seed=0),
        "the second values must be one finite number per world: leave out the worlds without one",
    ),
    "gains are not finite": (
        lambda: sign_flip.follow([np.nan], [1], [0], seed=0),
        "the gains values must be one finite number per world: leave out the worlds without one",
    ),
    "full is not finite": (
        lambda: sign_flip.follow([1], [np.nan], [0], seed=0),
        "the full values must be one finite number per world: leave out the worlds without one",
    ),
    "lengths of what follows": (
        lambda: sign_flip.follow([1], [1, 2], [0], seed=0),
        "1 gains, 2 full ones and 1 episodes: give one a frame",
    ),
    "no pairs and no repeats": (lambda: order.order_violation_p(0, 0, 0, 0), "no pairs, or no repeats"),
    "no episodes to lose": (
        lambda: risk_bounds.share_bound(2, 1),
        "need 0 <= k <= n and a confidence in (0, 1), got 2 of 1 at 0.95",
    ),
    "losses above 1": (
        lambda: risk_bounds.mean_bound([1.5]),
        "losses must be one share in [0, 1] for each episode",
    ),
    "more events than frames": (
        lambda: risk_bounds.ratio_bound([2], [1], 3),
        "events must be at most the frames of each episode, and these at most the longest",
    ),
    "more hits than frames": (
        lambda: episodes.share_over_episodes([2], [1]),
        "need 0 <= hits <= frames for each episode and a level in (0, 1), got [2.] of [1.] at 0.95",
    ),
    "a margin of 1": (
        lambda: paired_tests.net_effect(1, 0, 2, margin=1),
        "margin=1 must lie in (0, 1) and alpha=0.1 in (0, .5)",
    ),
    "counts that do not fit": (
        lambda: paired_tests.paired_difference_from_counts(2, 1, 2),
        "b=2 and c=1 discordant pairs do not fit into n=2 pairs",
    ),
    "negative discordant counts": (
        lambda: paired_tests.mcnemar_exact(-1, 2),
        "discordant counts b=-1 and c=2 must not be negative",
    ),
    "first is missing": (
        lambda: paired_tests.sign_test([np.nan], [1]),
        "the first values must be one number per frame: drop the frames without one",
    ),
    "second is missing": (
        lambda: paired_tests.sign_test([1], [np.nan]),
        "the second values must be one number per frame: drop the frames without one",
    ),
    "lengths within frames": (
        lambda: paired_tests.sign_test([1], [1, 2]),
        "1 values against 2: give both for the same frames",
    ),
    "outcomes that are none": (
        lambda: paired_tests.paired_difference([2], [1]),
        "a paired difference of proportions needs outcomes 0 or 1",
    ),
    "labels that are numbers": (
        lambda: paired_tests.label_swap_test([0.5], [1], seed=0),
        "the first labels must be one string or integer per frame, got float64",
    ),
    "a p above 1": (
        lambda: resamples.holm([0.5, 1.5]),
        "p value number 1 is 1.5: it must lie between 0 and 1",
    ),
    "no resamples": (
        lambda: resamples.permute_mutual_information([[1, 2], [3, 4]], seed=0, resamples=0),
        "resamples=0: ask for at least one",
    ),
    "strata of another length": (
        lambda: episode_permutation.iid_trend_test([1, 0], [1, 2], [0], seed=0),
        "1 strata for 2 frames: give one per frame",
    ),
    "ranks of another length": (
        lambda: episode_permutation.iid_trend_test([1, 0], [1], seed=0),
        "2 levels against 1 gap ranks: give both for the same frames",
    ),
    "a level below none": (
        lambda: episode_permutation.iid_trend_test([-2], [1], seed=0),
        "level must hold one braking level per frame, an integer of 0 or more, -1 for none",
    ),
    "a rank that is none": (
        lambda: episode_permutation.iid_trend_test([1], [np.inf], seed=0),
        "gap_rank must hold one finite number per frame: rank a missing lead as the farthest",
    ),
    "no stratum": (
        lambda: episode_permutation.episodes_needed(0),
        "strata=0 must be at least 1 and alpha=0.01 in (0, 1)",
    ),
    "answers of two shapes": (
        lambda: total_effect.squared_distance([[[1.0]]], [[1.0]]),
        "need two arrays of one shape (answers, frames, numbers…), got (1, 1, 1) and (1, 1)",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_refused_in_whole_words(name: str) -> None:
    """The message says what is wrong, which one it is, and what to give."""
    ask, words = REFUSED[name]
    with pytest.raises(ValueError, match=f"^{re.escape(words)}$"):
        ask()
