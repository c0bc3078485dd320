"""The interval of a share over frames in episodes: exact where nothing differs, and wide where episodes do."""

import numpy as np
import pytest
from scipy import integrate, special, stats

from eyechart.stats import agreement
from eyechart.stats import episodes as room
from eyechart.stats.episodes import share_over_episodes


def ends(hits: list[int], frames: list[int], **options: float) -> tuple[float, float]:
    """Return the interval of a share."""
    statistic = share_over_episodes(hits, frames, **options)
    assert statistic.ci is not None
    return statistic.ci


@pytest.mark.parametrize(("hits", "share"), [(0, 0.0), (12, 1.0), (6, 0.5)])
def test_episodes_that_are_all_equal_give_an_exact_bound_over_episodes(hits: int, share: float) -> None:
    """If more than q of all episodes differed, six without one that does would be rarer than 1 in 20."""
    statistic = share_over_episodes([hits] * 6, [12] * 6)
    differ = 1 - 0.05 ** (1 / 6)
    assert stats.binom.pmf(0, 6, differ) == pytest.approx(0.05)
    assert statistic.ci == pytest.approx((share * (1 - differ), share + (1 - share) * differ))
    assert (statistic.value, statistic.n, statistic.detail) == (share, 72, {"k": 6 * hits, "episodes": 6})
    assert "exact" in statistic.method


def test_an_interval_holds_the_rates_that_the_integrated_likelihood_does_not_rule_out() -> None:
    """At both ends the likelihood ratio, integrated by quadrature over the prior of the correlation, is at its cut."""
    hits, frames = np.array([0, 1, 2, 0, 3, 0, 0, 12, 2, 0, 0, 1]), 12

    def log_likelihood(rate: float) -> float:
        def at(angle: float) -> float:
            both = (1 / np.tan(angle) ** 2) * np.array([rate, 1 - rate])
            each = special.betaln(both[0] + hits, both[1] + frames - hits) - special.betaln(*both)
            return float(np.exp(each.sum() + 25) * np.cos(angle) ** (-1 / 3))

        return float(np.log(integrate.quad(at, 1e-6, np.pi / 2 - 1e-6, limit=200)[0]))

    low, high = ends(hits.tolist(), [frames] * 12)
    best = max(log_likelihood(rate) for rate in np.linspace(0.1, 0.3, 81))
    value = hits.sum() / 144
    freedom = 11 + 6 * (1 / (4 * value * (1 - value)) - 1)
    cut = stats.f.ppf(0.95, 1, freedom) / 2
    assert best - log_likelihood(low) == pytest.approx(cut, abs=0.02)
    assert best - log_likelihood(high) == pytest.approx(cut, abs=0.02)


def test_exchanging_hits_and_misses_reflects_the_interval() -> None:
    """What is said of a share and of its complement is the same."""
    hits, frames = [3, 0, 1, 7, 2], [7, 9, 8, 7, 12]
    low, high = ends(hits, frames)
    misses = [n - k for k, n in zip(hits, frames, strict=True)]
    assert ends(misses, frames) == pytest.approx((1 - high, 1 - low), abs=1e-6)


def test_long_episodes_are_counted_as_short_ones_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sums of logarithms and log gamma give one interval."""
    hits, frames = [3, 0, 1, 40, 2], [30, 50, 44, 60, 20]
    summed = ends(hits, frames)
    monkeypatch.setattr(room, "_SUMMED", 1)
    assert ends(hits, frames) == pytest.approx(summed, abs=1e-7)


def test_episodes_that_differ_more_are_worth_less() -> None:
    """The same share with whole episodes of hits has a wider interval than hits spread evenly, and than Wilson's."""
    even, lumped = ends([3, 4, 3, 4, 3, 4, 3, 4], [12] * 8), ends([12, 12, 4, 0, 0, 0, 0, 0], [12] * 8)
    wilson = agreement.rate(28, 96).ci
    assert wilson is not None
    assert lumped[1] - lumped[0] > 2 * (even[1] - even[0]) > 0
    assert even[1] - even[0] > wilson[1] - wilson[0]


def test_a_few_long_episodes_do_not_make_many() -> None:
    """Five episodes of two frames beside one of a hundred count as little more than one."""
    low, high = ends([100, 0, 0, 0, 0, 0], [100, 2, 2, 2, 2, 2])
    assert low < 0.5
    assert high > 100 / 110


def test_the_value_lies_within_and_a_higher_level_is_wider() -> None:
    """The interval at 98 % holds the one at 95 %, and both hold the share."""
    hits, frames = [5, 9, 2, 0, 7, 1], [12] * 6
    (low, high), (lower, higher) = ends(hits, frames), ends(hits, frames, level=0.98)
    assert 0 <= lower < low < 24 / 72 < high < higher <= 1


def test_episodes_of_one_frame_get_the_interval_of_independent_frames() -> None:
    """Then there is nothing within an episode."""
    assert ends([1, 0, 0, 1, 0, 0, 0], [1] * 7) == agreement.rate(2, 7).ci


def test_one_episode_has_no_interval_and_no_frames_no_share() -> None:
    """Nothing can be said of how episodes differ; episodes without frames do not count."""
    statistic = share_over_episodes([3, 0], [12, 0])
    assert (statistic.value, statistic.n, statistic.ci) == (0.25, 12, None)
    assert "one episode" in statistic.note
    assert share_over_episodes([], []).value is None


@pytest.mark.parametrize(
    ("hits", "frames", "level"), [([3], [2], 0.95), ([-1], [2], 0.95), ([1], [2, 3], 0.95), ([1], [2], 1.0)]
)
def test_counts_that_cannot_be_are_refused(hits: list[int], frames: list[int], level: float) -> None:
    """More hits than frames, negative ones, lists of two lengths, and a level outside (0, 1)."""
    with pytest.raises(ValueError, match="need 0 <= hits <= frames"):
        share_over_episodes(hits, frames, level=level)


@pytest.mark.parametrize(("episodes", "correlation", "rate"), [(6, 0.5, 0.3), (12, 0.3, 0.95), (24, 0.5, 0.9)])
def test_it_covers_where_percentile_intervals_did_not(episodes: int, correlation: float, rate: float) -> None:
    """In the beta-binomial model, 200 data sets; `make long-coverage` has every row with 2000."""
    rng = np.random.default_rng(5)
    beta = 1 / correlation - 1
    hits = rng.binomial(12, rng.beta(rate * beta, (1 - rate) * beta, size=(200, episodes)))
    found = [ends(one.tolist(), [12] * episodes) for one in hits]
    assert sum(low <= rate <= high for low, high in found) >= 0.90 * len(found)


def test_it_covers_where_a_few_long_episodes_weigh_nearly_all() -> None:
    """As where most drives end in a crash: three of 30 frames beside three of 2."""
    rng, frames = np.random.default_rng(5), [2, 2, 2, 30, 30, 30]
    beta = 1 / 0.9 - 1
    hits = rng.binomial(frames, rng.beta(0.5 * beta, 0.5 * beta, size=(200, 6)))
    found = [ends(one.tolist(), frames) for one in hits]
    assert sum(low <= 0.5 <= high for low, high in found) >= 0.92 * len(found)
