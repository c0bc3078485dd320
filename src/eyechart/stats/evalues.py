"""Evidence that is valid after every frame: betting e-processes under Ville's inequality.

An e-process is nonnegative and starts at 1 or below. Under its null, its expectation at any
stopping time is at most 1. So the chance that it ever reaches 1/alpha is at most alpha, however
often one looks (Ville 1939).

Sources: Waudby-Smith & Ramdas (2024), Estimating means of bounded random variables by betting;
Wasserman, Ramdas & Balakrishnan (2020), Universal inference; Krichevsky & Trofimov (1981).
"""

import math
from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Protocol

from eyechart.stats.statistic import Statistic

BETS: tuple[tuple[float, float], ...] = ((1.0, 0.5), (0.7, 0.2), (0.4, 0.15), (0.15, 0.15))
"""(share of the largest bet that cannot ruin, weight): a mixture, so no bet depends on the data.

Half of the stake is bet whole, because the clearest controllers never contradict a claim.
"""

_CERTAIN = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class EValue(Statistic):
    """The e-value of the claim ``says``; reaching ``threshold`` (1 / ``alpha``) settles it."""

    threshold: float
    alpha: float
    settled: bool
    says: str = field(repr=False)


class EProcess(Protocol):
    """Evidence against a null; ``log_e`` is its logarithm, infinite for an impossible null."""

    log_e: float


class MeanProcess:
    """Evidence against "the mean of bounded payoffs over a bank's ``frames`` is 0 or less".

    Frames come in random order, and ``low`` is the smallest possible payoff. Let m_t = -(sum so
    far) / (frames left), the mean of the rest if the whole bank's mean were 0. Each bet g
    multiplies its wealth by 1 + g (payoff - m_t) / (m_t - low).

    With ``bank`` it bets against m_t: the null is about these frames alone, drawn without
    replacement. Otherwise it bets against max(0, m_t). It then also holds under "each payoff has
    mean 0 or less given the past", in any order. That is so for independent draws, or for a null
    within every frame.
    """

    def __init__(self, frames: int, low: float, *, bank: bool = False) -> None:
        if frames < 1 or not math.isfinite(low):
            raise ValueError(f"a mean over {frames} frames with payoffs from {low} is no design")
        self._left, self._low, self._bank = frames, low, bank
        self._sum = 0.0
        self._log_wealth = [math.log(weight) for _, weight in BETS]
        self.log_e = math.inf if self._is_certain() else 0.0

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
        if self._is_certain() or (room < _CERTAIN < payoff - mean):
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

    def _is_certain(self) -> bool:
        """Return whether no payoffs of the frames left can bring the sum to 0 (``bank`` only)."""
        return self._bank and self._sum + self._left * self._low > _CERTAIN


class SymmetryProcess:
    """Evidence against "the two labels of a frame are exchangeable", with frames in any order.

    Given the past and a frame's two different labels, either order has chance 1/2 under the null.
    For each unordered pair of labels it bets on an order, by the Krichevsky-Trofimov estimate from
    the frames before.
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
    """Evidence against "the second label does not depend on the first", each with a wanted second.

    It is universal inference, a ratio of two chances of the observed answers. The first comes from
    bets on the wanted answer, by the Krichevsky-Trofimov estimate from the frames before. The
    second is the largest under any one distribution over ``labels`` second labels.
    """

    def __init__(self, labels: int) -> None:
        if labels < 2:
            raise ValueError(f"{labels} label cannot depend on anything")
        self._labels = labels
        self._second: Counter[Hashable] = Counter()
        self._hits, self._misses, self._log_bet = 0, 0, 0.0
        self.log_e = 0.0

    def add(self, wanted: Hashable, second: Hashable) -> None:
        """Add the second label of the next frame, and the wanted one for its first."""
        share = (self._hits + 0.5) / (self._hits + self._misses + 1)
        hit = wanted == second
        self._log_bet += math.log(share if hit else (1 - share) / (self._labels - 1))
        self._hits, self._misses = self._hits + hit, self._misses + (not hit)
        self._second[second] += 1
        n = self._hits + self._misses
        self.log_e = self._log_bet - sum(count * math.log(count / n) for count in self._second.values())
