"""Evidence that may be looked at after every frame: betting e-processes, whose sup obeys Ville's inequality.

An e-process is nonnegative, starts at 1 or below, and under its null its expectation at any
stopping time is at most 1, so the chance that it ever reaches 1/alpha is at most alpha, however
long one goes on looking (Ville 1939). Sources: Waudby-Smith & Ramdas (2024), Estimating means of
bounded random variables by betting; Wasserman, Ramdas & Balakrishnan (2020), Universal inference;
Krichevsky & Trofimov (1981).
"""

import math
from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Protocol

from eyechart.stats.statistic import Statistic

BETS: tuple[tuple[float, float], ...] = ((1.0, 0.5), (0.7, 0.2), (0.4, 0.15), (0.15, 0.15))
"""(share of the largest bet that cannot ruin, weight): a mixture, so that no bet has to be chosen by looking.

Half of the stake is bet whole, because the clearest controllers never contradict a claim.
"""

_CERTAIN = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class EValue(Statistic):
    """The e-value of a claim, ``says``, that is settled once it reaches ``threshold``, which is 1 / ``alpha``."""

    threshold: float
    alpha: float
    settled: bool
    says: str = field(repr=False)


class EProcess(Protocol):
    """Evidence against a null; ``log_e`` is its natural logarithm, infinite where the null has become impossible."""

    log_e: float


class MeanProcess:
    """Evidence against "the mean of bounded payoffs over a bank's ``frames`` is 0 or less", frames in random order.

    ``low`` is the smallest payoff that there can be. With m_t = -(sum so far) / (frames left), the
    mean that the rest would have were the whole bank's mean 0, each bet g multiplies its wealth by
    1 + g (payoff - m_t) / (m_t - low). ``bank`` bets against m_t: its null is about these frames
    alone, drawn without replacement. Otherwise it bets against max(0, m_t), and holds under that
    null and under "each payoff has mean 0 or less given the past" (frames that are independent
    draws, or a null within every frame), in whatever order.
    """

    def __init__(self, frames: int, low: float, *, bank: bool = False) -> None:
        if frames < 1 or not math.isfinite(low):
            raise ValueError(f"a mean over {frames} frames with payoffs from {low} is no design")
        self._left, self._low, self._bank = frames, low, bank
        self._sum = 0.0
        self._log_wealth = [math.log(weight) for _, weight in BETS]
        self.log_e = math.inf if self._certain() else 0.0

    def add(self, payoff: float) -> None:
        """Add the payoff of the next frame; ValueError below ``low``, or after the last frame."""
        if self._left < 1 or payoff < self._low - _CERTAIN:
            raise ValueError(f"payoff {payoff} with {self._left} frames left: none is below {self._low}")
        rest = -self._sum / self._left
        mean = rest if self._bank else max(0.0, rest)
        self._left -= 1
        self._sum += payoff
        if self.log_e == math.inf:
            return
        room = mean - self._low
        if self._certain() or (room < _CERTAIN < payoff - mean):
            self.log_e = math.inf
        elif room >= _CERTAIN and payoff != mean:
            self._bet((payoff - mean) / room)

    def _bet(self, edge: float) -> None:
        self._log_wealth = [
            wealth + (math.log1p(share * edge) if share * edge > -1 else -math.inf)
            for (share, _), wealth in zip(BETS, self._log_wealth, strict=True)
        ]
        most = max(self._log_wealth)
        self.log_e = most + math.log(sum(math.exp(one - most) for one in self._log_wealth))

    def _certain(self) -> bool:
        """Return whether no payoffs of the frames that are left could bring the bank's sum to 0 (of ``bank`` alone)."""
        return self._bank and self._sum + self._left * self._low > _CERTAIN


class SymmetryProcess:
    """Evidence against "the two labels of a frame might as well be exchanged", frames in whatever order.

    Given the past and which two different labels a frame got, either order has chance 1/2 under the
    null; for each unordered pair of labels it bets on an order by the Krichevsky-Trofimov estimate
    from the frames before.
    """

    def __init__(self) -> None:
        self._seen: Counter[tuple[Hashable, Hashable]] = Counter()
        self.log_e = 0.0

    def add(self, first: Hashable, second: Hashable) -> None:
        """Add the two labels of the next frame; equal ones are no evidence."""
        if first == second:
            return
        same, other = self._seen[first, second], self._seen[second, first]
        self.log_e += math.log(2 * (same + 0.5) / (same + other + 1))
        self._seen[first, second] += 1


class PairingProcess:
    """Evidence against "the second label does not depend on the first", for an answer that is wanted of each first.

    Universal inference: the chance that bets on the wanted answer give to what came, by the
    Krichevsky-Trofimov estimate from the frames before, over the largest chance that any one
    distribution of second labels over ``labels`` labels gives to it.
    """

    def __init__(self, labels: int) -> None:
        if labels < 2:
            raise ValueError(f"{labels} label cannot depend on anything")
        self._labels = labels
        self._second: Counter[Hashable] = Counter()
        self._hits, self._misses, self._log_bet = 0, 0, 0.0
        self.log_e = 0.0

    def add(self, wanted: Hashable, second: Hashable) -> None:
        """Add the second label of the next frame, and the one that was wanted of its first."""
        share = (self._hits + 0.5) / (self._hits + self._misses + 1)
        hit = wanted == second
        self._log_bet += math.log(share if hit else (1 - share) / (self._labels - 1))
        self._hits, self._misses = self._hits + hit, self._misses + (not hit)
        self._second[second] += 1
        n = self._hits + self._misses
        self.log_e = self._log_bet - sum(count * math.log(count / n) for count in self._second.values())
