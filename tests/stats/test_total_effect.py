"""Total-effect shares: by hand, by another way of computing, and on worlds whose share is known."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from eyechart.stats.partners import balanced_partners
from eyechart.stats.total_effect import (
    LEVEL,
    Pairs,
    dispersion_change,
    distance_from_log,
    held_still,
    misfit_share,
    noise_share,
    permutation_p,
    responding,
    rounding_tolerance,
    share_beyond,
    share_difference,
    shares_of_parts,
    squared_distance,
    total_effect,
)

EPISODES, EACH = 12, 6


def world(share: float, rng: np.random.Generator, noise: float = 0.0, answers: int = 1) -> tuple[np.ndarray, ...]:
    """Return answers to own and swapped pictures, places of partners and episodes; the picture carries ``share``."""
    episodes = np.repeat(np.arange(EPISODES), EACH)
    seen, other = (
        0.9 * rng.normal(size=(EPISODES, 3))[episodes] + 0.44 * rng.normal(size=(len(episodes), 3)) for _ in range(2)
    )
    partners = balanced_partners(list(episodes), list(range(len(episodes))), seed=int(rng.integers(1 << 30)))

    def answer(picture: np.ndarray) -> np.ndarray:
        plain = np.sqrt(share) * picture + np.sqrt(1 - share) * other
        return np.stack([plain + np.sqrt(noise) * rng.normal(size=plain.shape) for _ in range(answers)])

    return answer(seen), answer(seen[partners]), partners, episodes


def estimate(own: np.ndarray, swapped: np.ndarray, partners: np.ndarray, episodes: np.ndarray):  # noqa: ANN201
    """Return the share of a world."""
    owner, partner = episodes, episodes[partners]
    effect = Pairs(squared_distance(own, swapped), owner, partner)
    return total_effect(effect, Pairs(squared_distance(own, own[:, partners]), owner, partner), sampled=len(own) > 1)


def test_half_squares_are_by_hand() -> None:
    """One answer: ½ of the mean of 1, 4 and 1; two: ½ of the mean product of the two differences."""
    one, other = np.array([[[1.0, 2.0, 3.0]]]), np.array([[[2.0, 4.0, 4.0]]])
    assert squared_distance(one, other) == pytest.approx([(1 + 4 + 1) / 3 / 2])
    r, s = np.array([[[1.0, 0.0]], [[3.0, 1.0]]]), np.array([[[0.0, 0.0]], [[1.0, 2.0]]])
    assert squared_distance(r, s) == pytest.approx([(1 * 2 + 0 * -1) / 2 / 2])
    with pytest.raises(ValueError, match="one shape"):
        squared_distance(one, other[:, :, :2])


def test_several_answers_are_the_mean_over_ordered_pairs_of_different_answers() -> None:
    """The closed form equals the double loop that defines it."""
    rng = np.random.default_rng(1)
    r, s = rng.normal(size=(4, 5, 8, 3)), rng.normal(size=(4, 5, 8, 3))
    pairs = [(r[a] - s[a]) * (r[b] - s[b]) for a, b in itertools.permutations(range(4), 2)]
    assert squared_distance(r, s) == pytest.approx(np.mean(pairs, axis=0).mean(axis=(1, 2)) / 2)


def test_the_interval_is_that_of_a_jackknife_written_out() -> None:
    """Leaving an episode out as owner and as partner, in a loop over frames, gives the same standard error."""
    own, swapped, partners, episodes = world(0.3, np.random.default_rng(5))
    found = estimate(own, swapped, partners, episodes)
    x, v = squared_distance(own, swapped), squared_distance(own, own[:, partners])
    left = []
    for index in range(EPISODES):
        keep = [i for i in range(len(x)) if episodes[i] != index and episodes[partners[i]] != index]
        left.append(x[keep].mean() / v[keep].mean())
    error = np.sqrt((EPISODES - 1) / EPISODES * np.sum((left - np.mean(left)) ** 2))
    share = x.mean() / v.mean()
    wide = stats.t.ppf((1 + LEVEL) / 2, EPISODES - 1) * error / share
    assert found.value == pytest.approx(share)
    assert found.ci == pytest.approx((share * np.exp(-wide), share * np.exp(wide)))
    assert found.n == len(x)


def test_it_finds_the_share_of_a_known_world_and_holds_its_level() -> None:
    """At .10 the upper end falls below .10 hardly more often than in .01 of the worlds, and at .02 nothing is used."""
    rng = np.random.default_rng(8)
    tenth = [estimate(*world(0.10, rng)) for _ in range(600)]
    assert np.mean([one.value for one in tenth]) == pytest.approx(0.10, abs=0.01)
    assert np.mean([one.ci[1] < 0.10 for one in tenth]) <= 0.025
    none = [estimate(*world(0.02, rng)) for _ in range(600)]
    assert np.mean([one.ci[0] > 0.02 for one in none]) <= 0.025
    assert np.mean([one.ci[1] < 0.10 for one in none]) >= 0.75


def test_noise_does_not_count_where_answers_are_repeated() -> None:
    """With noise as large as the signal, one answer says that half of the variation is the picture's; two say none."""
    rng = np.random.default_rng(3)
    one = [estimate(*world(0.0, rng, noise=1.0)).value for _ in range(60)]
    two = [estimate(*world(0.0, rng, noise=1.0, answers=2)) for _ in range(60)]
    assert np.mean(one) == pytest.approx(0.5, abs=0.05)
    assert np.mean([each.value for each in two]) == pytest.approx(0.0, abs=0.05)
    assert all(each.ci[0] == min(0.0, each.value) or each.ci[0] > 0 for each in two)
    assert any(each.value < 0 for each in two)


def test_a_controller_that_never_changes_with_the_channel_has_a_share_of_exactly_0() -> None:
    """And one that does not vary at all has none."""
    own, _, partners, episodes = world(0.3, np.random.default_rng(2))
    found = estimate(own, own.copy(), partners, episodes)
    assert (found.value, found.ci) == (0.0, (0.0, 0.0))
    still = estimate(np.zeros_like(own), np.zeros_like(own), partners, episodes)
    assert still.value is None
    assert "do not vary" in still.note


def test_an_episode_responds_where_its_own_share_is_large_under_any_condition() -> None:
    """Three episodes of two frames, a variation of 1: the second responds to one condition, the third to both."""
    owner = np.repeat(np.arange(3), 2)
    first, second = (
        Pairs(np.array(values), owner, owner) for values in ([0, 0.1, 0, 0, 1, 0], [0, 0, 0.05, 0.15, 1, 1])
    )
    variation = Pairs(np.ones(6), owner, owner)
    assert responding([first, second], variation, 0.1) == (2, 3)
    assert responding([first], variation, 0.1) == (1, 3)
    assert responding([first], variation, 0.05) == (2, 3)
    assert responding([], variation, 0.1) == (0, 0)
    assert responding([first], Pairs(np.zeros(6), owner, owner), 0.1) == (0, 0)


def test_two_episodes_cannot_say() -> None:
    """Without one of them nothing is left."""
    pairs = Pairs(np.ones(4), np.array([0, 0, 1, 1]), np.array([1, 1, 0, 0]))
    assert total_effect(pairs, pairs).value is None
    with pytest.raises(ValueError, match="finite"):
        Pairs(np.array([np.nan]), np.array([0]), np.array([1]))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.1, 50))
def test_the_share_has_no_unit_and_no_order(seed: int, unit: float) -> None:
    """Answers in other units, frames in another order and episodes with other numbers give the same."""
    rng = np.random.default_rng(seed)
    own, swapped, partners, episodes = world(0.4, rng)
    plain, scaled = estimate(own, swapped, partners, episodes), estimate(own * unit, swapped * unit, partners, episodes)
    assert scaled.value == pytest.approx(plain.value)
    assert scaled.ci == pytest.approx(plain.ci)
    order, names = rng.permutation(len(episodes)), rng.permutation(EPISODES)
    where = np.argsort(order)
    turned = estimate(own[:, order], swapped[:, order], where[partners[order]], names[episodes[order]])
    assert turned.value == pytest.approx(plain.value)
    assert turned.ci == pytest.approx(plain.ci)


def test_relabellings_that_are_drawn_in_parts_are_as_many_as_were_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of equal answers every deal is as far apart, so that p is 1; seven a part, and five in the last."""
    monkeypatch.setattr("eyechart.stats.statistic.CHUNK_BYTES", 8 * 4 * 7)
    equal = np.zeros((2, 4, 1))
    assert permutation_p(equal, equal, seed=0, resamples=19) == 1.0


def test_relabelling_is_exact_and_needs_two_answers() -> None:
    """By hand: one frame, answers 0 and 0 against 1 and 1; of three deals one is as far apart, so p tends to 1/3."""
    r, s = np.zeros((2, 1, 1)), np.ones((2, 1, 1))
    assert permutation_p(r, s, seed=0, resamples=3000) == pytest.approx(1 / 3, abs=0.03)
    assert permutation_p(r[:1], s[:1], seed=0) is None
    rng = np.random.default_rng(4)
    ps = [permutation_p(*rng.normal(size=(2, 2, 20, 3)), seed=turn, resamples=199) for turn in range(300)]
    assert np.mean([p <= 0.05 for p in ps]) <= 0.085
    assert permutation_p(rng.normal(size=(2, 20, 3)), 2 + rng.normal(size=(2, 20, 3)), seed=1) == 1 / 2000


def test_shares_of_dimensions_and_steps_are_ratios_of_their_own() -> None:
    """Only the first dimension follows the picture; a dimension that never varies has no share."""
    rng = np.random.default_rng(6)
    own = rng.normal(size=(1, 40, 8, 3))
    own[..., 2] = 7.0
    swapped, others = own.copy(), own[:, ::-1]
    swapped[..., 0] = others[..., 0]
    shares = shares_of_parts(own, swapped, own, others, [[0], [1], [2]])
    assert shares["dimension"] == pytest.approx((1.0, 0.0, None), abs=1e-12)
    assert len(shares["step"]) == 8
    assert all(0.3 < share < 0.7 for share in shares["step"])


def test_noise_is_a_share_of_what_varies() -> None:
    """A controller that repeats itself has none; one whose answers have nothing to do with frames has all."""
    rng = np.random.default_rng(7)
    a, b, c = rng.normal(size=(3, 4000, 4))
    assert noise_share(a, a, c).value == 0.0
    assert noise_share(a, b, c).value == pytest.approx(1.0, abs=0.05)
    assert noise_share(a[:0], b[:0], c[:0]).value is None
    assert noise_share(np.ones((3, 2)), np.ones((3, 2)), np.ones((3, 2))).value is None


def test_misfit_is_one_minus_r_squared() -> None:
    """As the coefficient of determination has it, over all numbers of equal spread."""
    rng = np.random.default_rng(9)
    logged = rng.normal(size=(60, 2, 2))
    answers = logged + 0.5 * rng.normal(size=logged.shape)
    statistic = misfit_share(answers, logged, np.repeat(np.arange(6), 10))
    spread = ((logged - logged.mean(axis=0)) ** 2).sum()
    assert statistic.value == pytest.approx(((answers - logged) ** 2).sum() / spread)
    assert statistic.ci[0] < statistic.value < statistic.ci[1]
    assert misfit_share(logged, np.ones_like(logged), np.arange(60)).value is None


def test_unlikeness_is_of_the_whole_and_not_of_the_moment() -> None:
    """Answers to other moments are alike; another unit or another zero is not, and the worst dimension counts."""
    rng = np.random.default_rng(1)
    logged = rng.normal([0, 5], [1, 2], (400, 4, 2))

    def sizes(answers: np.ndarray, log: np.ndarray = logged) -> tuple[float, ...]:
        return tuple(size for size, _ in distance_from_log(answers, log))

    assert sizes(logged[::-1]) == pytest.approx((0.0, 1.0))
    assert sizes(logged * [1, 3]) == pytest.approx((5.0, 3.0), rel=0.02)
    assert [which for _, which in distance_from_log(logged * [1, 3], logged)] == [1, 1]
    assert sizes(logged * [0.1, 1]) == pytest.approx((0.0, 10.0), abs=0.02, rel=0.02)
    assert distance_from_log(logged * [0.1, 1], logged)[1][1] == 0
    assert sizes(np.ones((9, 2, 1)), np.zeros((9, 2, 1))) == (1.0, 1.0)
    far = np.full((400, 4, 2), [5.0, 1e12 + 0.1]) / [1, 0.00417]
    assert np.isfinite(sizes(far)).all(), "equal numbers, whose mean in doubles is not quite theirs"
    held = logged * [1, 0] + [0, 5] + 1e-6 * rng.normal(size=logged.shape)
    assert sizes(held) == pytest.approx((0.0, 1.0), abs=0.1), "a gripper that is never closed"


def test_who_scatters_otherwise_is_found_though_its_mean_stays() -> None:
    """By a share of the variation, and a test that deals answers out anew; a moved mean is no scatter."""
    rng = np.random.default_rng(5)
    still, moved = (rng.normal(size=(4, 60, 2, 1)) for _ in range(2))
    assert dispersion_change(still, moved, 1.0, seed=0)[1] > 0.01
    assert dispersion_change(still, moved + 3, 1.0, seed=0)[1] > 0.01
    size, p = dispersion_change(0.1 * still, moved, 2.0, seed=0)
    assert p == 1 / 2000
    assert 0.1 < size < 0.5, "half a variance of 1, less what chance brings about in four answers"
    turn = rng.integers(2, size=(1, 60, 1, 1))
    sides = [np.where(turn == which, 1.0, 0.2) * rng.normal(size=still.shape) for which in (0, 1)]
    assert dispersion_change(*sides, 2.0, seed=0)[1] == 1 / 2000, "of each frame, although as many scatter more as less"
    assert dispersion_change(still[:1], moved[:1], 1.0, seed=0) is None
    assert dispersion_change(still, moved, 0.0, seed=0) is None


def test_answers_within_rounding_are_one() -> None:
    """A ten-thousandth of what each number varies by between moments."""
    answers = np.random.default_rng(3).normal([0, 5], [1, 20], (400, 4, 2))
    assert rounding_tolerance(answers) == pytest.approx([1e-4, 2e-3], rel=0.1)


def skewed(shares: tuple[float, ...], rng: np.random.Generator) -> tuple[Pairs, ...]:
    """Return pairs whose means are these, in the long run: squares of normal numbers that an episode shares."""
    owner = np.repeat(np.arange(EPISODES), EACH)
    partner = np.roll(owner, EACH)
    found = []
    for share in shares:
        own, other = (rng.normal(size=EPISODES), rng.normal(size=(len(owner), 2)))
        numbers = np.sqrt(0.6) * own[owner, None] + np.sqrt(0.4) * other
        found.append(Pairs(share * (numbers**2).mean(axis=1), owner, partner))
    return tuple(found)


def test_how_much_larger_a_share_is_has_the_ends_at_which_the_ratio_leaves_one() -> None:
    """By the definition: at an end, the logarithm of the ratio is t standard errors of its jackknife away from 0."""
    effect, other, variation = skewed((0.4, 0.1, 1.0), np.random.default_rng(3))
    statistic = share_beyond(effect, other, variation)
    assert statistic.value == pytest.approx(effect.values.mean() - other.values.mean(), rel=0.6)
    assert statistic.ci is not None
    for end, side in zip(statistic.ci, (1, -1), strict=True):
        left = []
        for episode in range(EPISODES):
            kept = (effect.owner != episode) & (effect.partner != episode)
            more, less, whole = (one.values[kept].mean() for one in (effect, other, variation))
            left.append(np.log(more / whole) - np.log(less / whole + end))
        error = np.sqrt((EPISODES - 1) * np.var(left))
        more, less, whole = (one.values.mean() for one in (effect, other, variation))
        ratio = np.log(more / whole) - np.log(less / whole + end)
        assert ratio == pytest.approx(side * stats.t.ppf((1 + LEVEL) / 2, EPISODES - 1) * error, abs=0.02)


def test_a_difference_of_two_equal_shares_is_seldom_said_to_be_more() -> None:
    """Both are skewed, so that the plain share's interval on a scale of logarithms, above 0 as it is, passes often."""
    rng, passed, plain = np.random.default_rng(4), 0, 0
    for _ in range(400):
        effect, other, variation = skewed((0.22, 0.20, 1.0), rng)
        statistic = share_beyond(effect, other, variation)
        both = Pairs(effect.values - other.values, effect.owner, effect.partner)
        naive = total_effect(both, variation, sampled=True)
        assert statistic.ci is not None
        assert naive.ci is not None
        passed += statistic.ci[0] > 0.02
        plain += naive.ci[0] > 0.02
    assert passed / 400 < 0.03
    assert plain / 400 > 0.04


def test_a_share_that_nothing_is_taken_from_is_itself() -> None:
    """And of a share that is none the difference is below all."""
    effect, _, variation = skewed((0.4, 0.1, 1.0), np.random.default_rng(5))
    none = Pairs(np.zeros(len(effect.values)), effect.owner, effect.partner)
    whole, found = total_effect(effect, variation), share_beyond(effect, none, variation)
    assert found.value == pytest.approx(whole.value)
    assert found.ci == pytest.approx(whole.ci, rel=0.15)
    assert share_beyond(none, none, variation).ci == (0.0, 0.0)
    assert share_beyond(none, effect, variation).ci == pytest.approx((-whole.value, 0.0))
    few = Pairs(effect.values[: 2 * EACH], effect.owner[: 2 * EACH], effect.partner[: 2 * EACH])
    assert "three are needed" in share_beyond(few, few, few).note
    assert "do not vary" in share_beyond(effect, effect, none).note


def test_a_number_that_is_held_still_is_named() -> None:
    """The same in every answer but for rounding, where the log moves it; one that the log holds still is none."""
    rng = np.random.default_rng(0)
    log, answers = rng.normal(size=(20, 4, 3)), rng.normal(size=(20, 4, 3))
    answers[..., 1] = 0.5 + 1e-7 * answers[..., 1]
    answers[..., 2], log[..., 2] = 0.5, 0.5
    assert held_still(answers, log) == (1,)


def test_a_partner_may_be_of_an_episode_that_was_not_asked() -> None:
    """Of a run on a few frames, whose partners are any of the bank's."""
    rng = np.random.default_rng(2)
    owner = np.repeat(np.arange(4), 3)
    effect = Pairs(rng.uniform(0.1, 0.2, 12), owner, rng.integers(4, 9, 12))
    variation = Pairs(rng.uniform(1, 2, 12), owner, (owner + 1) % 4)
    statistic = total_effect(effect, variation)
    assert statistic.value == pytest.approx(effect.values.mean() / variation.values.mean())
    assert statistic.ci is not None
    assert share_difference((effect, variation), (effect, variation)).value == 0
