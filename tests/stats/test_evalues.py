"""E-processes: nonnegative supermartingales under their nulls, by enumeration; Ville's bound, by simulation."""

import itertools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eyechart.stats.agreement import clopper_pearson
from eyechart.stats.evalues import BETS, MeanProcess, PairingProcess, SymmetryProcess

TOLERANCE = 1e-9


def e_after(make: Callable[[], MeanProcess], payoffs: Sequence[float]) -> float:
    """Return the e-value after these payoffs."""
    process = make()
    for payoff in payoffs:
        process.add(payoff)
    return math.exp(process.log_e) if process.log_e < math.inf else math.inf


@pytest.mark.parametrize("chances", [(0.3, 0.4, 0.3), (0.5, 0.0, 0.5), (0.1, 0.85, 0.05), (0.6, 0.1, 0.3)])
def test_independent_payoffs_of_mean_0_or_less_give_a_supermartingale(chances: tuple[float, ...]) -> None:
    """From every past, over all that may come next, the expected e-value is at most the present one."""
    values = (-1.0, 0.0, 1.0)

    def make() -> MeanProcess:
        return MeanProcess(9, -1.0)

    for n in range(6):
        for past in itertools.product(values, repeat=n):
            now = e_after(make, past)
            following = sum(
                chance * e_after(make, (*past, value)) for chance, value in zip(chances, values, strict=True)
            )
            assert now >= 0
            assert following <= now * (1 + TOLERANCE)


BANKS = {
    "half for, half against": ((1.0, 1.0, 1.0, -1.0, -1.0, -1.0), -1.0),
    "ties": ((1.0, 0.0, 0.0, 0.0, 0.0, -1.0), -1.0),
    "at a margin of one in five": ((0.2, 0.2, 0.2, 0.2, -0.8), -0.8),
    "one large against many small": ((0.75, -0.25, -0.25, -0.25), -0.25),
    "below 0": ((1.0, -1.0, -1.0, 0.0, 1.0, -1.0), -1.0),
}


@pytest.mark.parametrize("bank", [False, True])
@pytest.mark.parametrize("name", BANKS)
def test_a_bank_of_mean_0_or_less_in_random_order_gives_a_supermartingale(name: str, *, bank: bool) -> None:
    """Without replacement: from every past, over the frames that are left, however they are correlated in time."""
    payoffs, low = BANKS[name]

    def make() -> MeanProcess:
        return MeanProcess(len(payoffs), low, bank=bank)

    for n in range(len(payoffs)):
        for past in set(itertools.permutations(payoffs, n)):
            left = Counter(payoffs) - Counter(past)
            total = sum(left.values())
            following = sum(count / total * e_after(make, (*past, value)) for value, count in left.items())
            assert following <= e_after(make, past) * (1 + TOLERANCE)


def test_wins_alone_give_the_mixture_of_the_bets() -> None:
    """Ten wins: half the stake has doubled ten times, and the other bets have grown by theirs."""
    expected = sum(weight * (1 + share) ** 10 for share, weight in BETS)
    assert e_after(lambda: MeanProcess(100, -1.0), [1.0] * 10) == pytest.approx(expected)
    assert sum(weight for _, weight in BETS) == pytest.approx(1.0)


def test_the_whole_bet_on_a_bank_is_the_hypergeometric_chance() -> None:
    """None of 4 bad frames of 20 among the first 8: the bet that is whole pays the inverse of that chance."""
    chance = math.comb(16, 8) / math.comb(20, 8)
    process = MeanProcess(20, 0.2 - 1, bank=True)
    for _ in range(8):
        process.add(0.2)
    assert math.exp(process._log_wealth[0]) == pytest.approx(BETS[0][1] / chance)


def test_what_can_no_longer_be_is_certain() -> None:
    """Once the frames left cannot bring a bank's sum back to 0, the e-value is infinite, and stays so."""
    process = MeanProcess(5, -0.25, bank=True)
    process.add(0.75)
    assert process.log_e < math.inf
    process.add(0.75)
    assert process.log_e == math.inf
    process.add(-0.25)
    assert process.log_e == math.inf
    assert MeanProcess(3, 9 / 3 - 1, bank=True).log_e == math.inf


def test_independent_frames_never_become_certain() -> None:
    """A null about draws yet to come cannot be ruled out by what came."""
    process = MeanProcess(3, -1.0)
    for _ in range(3):
        process.add(1.0)
    assert process.log_e == pytest.approx(math.log(sum(weight * (1 + share) ** 3 for share, weight in BETS)))


@given(payoffs=st.lists(st.floats(-0.9, 1.5), min_size=1, max_size=60), bank=st.booleans())
@settings(max_examples=80)
def test_no_payoffs_break_it(payoffs: list[float], bank: bool) -> None:  # noqa: FBT001
    """Whatever comes within bounds, the e-value is a number of 0 or more, or certainty."""
    process = MeanProcess(len(payoffs), -0.9, bank=bank)
    for payoff in payoffs:
        process.add(payoff)
        assert not math.isnan(process.log_e)


def test_a_long_run_neither_overflows_nor_forgets() -> None:
    """Five thousand wins, then five thousand losses: the logarithm goes up and comes down again."""
    process = MeanProcess(10_000, -1.0)
    for _ in range(5000):
        process.add(1.0)
    high = process.log_e
    assert high == pytest.approx(5000 * math.log(2) + math.log(0.5), rel=1e-6)
    for _ in range(5000):
        process.add(-1.0)
    assert process.log_e < high - 1000


def test_payoffs_out_of_bounds_are_refused() -> None:
    """Too small, one too many, or no frames at all."""
    process = MeanProcess(1, -0.5)
    with pytest.raises(ValueError, match=r"none is below -0\.5"):
        process.add(-0.6)
    process.add(0.0)
    with pytest.raises(ValueError, match="0 frames left"):
        process.add(0.0)
    with pytest.raises(ValueError, match="no design"):
        MeanProcess(0, -1.0)
    with pytest.raises(ValueError, match="cannot depend"):
        PairingProcess(1)


def test_exchanged_labels_give_a_martingale() -> None:
    """Over both orders of each frame's labels the mean e-value is exactly 1, for pairs of three labels."""
    pairs = [("a", "b"), ("b", "c"), ("a", "b"), ("a", "a"), ("c", "a"), ("a", "b"), ("b", "c")]
    total = 0.0
    for flips in itertools.product((False, True), repeat=len(pairs)):
        process = SymmetryProcess()
        for (one, other), flip in zip(pairs, flips, strict=True):
            process.add(*((other, one) if flip else (one, other)))
        total += math.exp(process.log_e)
    assert total / 2 ** len(pairs) == pytest.approx(1.0)


@pytest.mark.parametrize("n", [1, 4, 10, 30])
def test_one_order_alone_gives_the_krichevsky_trofimov_value(n: int) -> None:
    """2^n times C(2n, n) / 4^n, and the other labels' direction makes no difference."""
    process = SymmetryProcess()
    for _ in range(n):
        process.add("STOP", "SLOW")
    assert process.log_e == pytest.approx(math.log(math.comb(2 * n, n)) - n * math.log(2))


@pytest.mark.parametrize("right", [0.0, 0.2, 0.5, 0.9])
@pytest.mark.parametrize("first", ["LLRR", "LRLRL", "LLLLL", "LRRRRR"])
def test_second_labels_that_do_not_depend_on_the_first_give_an_expectation_of_1_at_most(
    right: float, first: str
) -> None:
    """For any one distribution of second labels and any first ones, over all second ones, at every length."""
    other = {"L": "R", "R": "L"}
    for n in range(1, len(first) + 1):
        total = 0.0
        for second in itertools.product("LR", repeat=n):
            process = PairingProcess(2)
            for one, two in zip(first, second, strict=False):
                process.add(other[one], two)
            total += math.prod(right if two == "R" else 1 - right for two in second) * math.exp(process.log_e)
        assert total <= 1 + TOLERANCE


def test_one_direction_only_is_no_evidence_of_exchange() -> None:
    """LEFT always and RIGHT always in the mirror could be a habit: the e-value stays at 1 or below."""
    process = PairingProcess(2)
    for _ in range(40):
        process.add("RIGHT", "RIGHT")
    assert process.log_e <= 0
    balanced = PairingProcess(2)
    for place in range(12):
        balanced.add("LR"[place % 2], "LR"[place % 2])
    assert balanced.log_e > math.log(100)


def test_villes_bound_holds_for_every_process() -> None:
    """Of 1000 runs of 100 coins at most .05 ever reach 20, within chance; and the bound is not idle."""
    rng = np.random.default_rng(12)
    runs, ever = 1000, Counter[str]()
    for coins in rng.random((runs, 100)) < 0.5:
        mean, symmetry = MeanProcess(100, -1.0), SymmetryProcess()
        most = dict.fromkeys(("mean", "symmetry"), 0.0)
        for coin in coins.tolist():
            mean.add(1.0 if coin else -1.0)
            symmetry.add(*("ab" if coin else "ba"))
            most = {"mean": max(most["mean"], mean.log_e), "symmetry": max(most["symmetry"], symmetry.log_e)}
        ever.update(name for name, one in most.items() if one >= math.log(20))
    for name in ("mean", "symmetry"):
        low, high = clopper_pearson(ever[name], runs)
        assert low <= 0.05, (name, ever[name])
        assert high > 0.01, (name, ever[name])


@pytest.mark.parametrize("bank", [False, True])
def test_the_wealth_of_the_bets_is_that_of_exact_fractions(*, bank: bool) -> None:
    """Each bet multiplies by 1 + g (x - m)/(m - low), m the mean that the rest would have: written out in fractions."""
    frames, low = 12, Fraction(-1)
    payoffs = [Fraction(one) for one in (1, 0, -1, 1, 1, 0, 1)]
    wealth = [Fraction(weight).limit_denominator(100) for _, weight in BETS]
    total = Fraction()
    for number, payoff in enumerate(payoffs):
        mean = -total / (frames - number)
        mean = mean if bank else max(Fraction(0), mean)
        for place, (bet, _) in enumerate(BETS):
            wealth[place] *= 1 + Fraction(bet).limit_denominator(100) * (payoff - mean) / (mean - low)
        total += payoff
    found = e_after(lambda: MeanProcess(frames, float(low), bank=bank), [float(one) for one in payoffs])
    assert found == pytest.approx(float(sum(wealth)), rel=1e-12)


def test_the_value_of_a_pairing_is_that_of_exact_fractions() -> None:
    """Hits and misses by Krichevsky and Trofimov, over the largest chance of the second labels alone."""
    process, seen = PairingProcess(2), [("L", "L"), ("R", "R"), ("L", "R"), ("R", "R"), ("L", "L"), ("R", "R")]
    bet, hits = Fraction(1), 0
    for number, (wanted, second) in enumerate(seen):
        share = (hits + Fraction(1, 2)) / (number + 1)
        bet *= share if wanted == second else 1 - share
        hits += wanted == second
        process.add(wanted, second)
    largest = Fraction(2, 6) ** 2 * Fraction(4, 6) ** 4
    assert math.exp(process.log_e) == pytest.approx(float(bet / largest), rel=1e-12)
