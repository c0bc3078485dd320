"""An exact test of whether replies to randomly dealt questions beat guessing."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import comb, factorial

import numpy as np
import numpy.typing as npt

from eyechart.stats.statistic import Statistic, not_available

LEVEL = 0.95
"""The one-sided level of each end of the interval."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ForcedChoice(Statistic):
    """How many replies are right, and how many are ``expected`` from guessing."""

    right: int
    expected: float


@dataclass(frozen=True, slots=True)
class Block:
    """Questions of one kind: ``choices`` answers, and the right ones ``dealt``, all different.

    Answers are numbers below ``choices``. ``said`` holds the replies, None for one that is no such
    answer. Raises ValueError if the deal repeats an answer, or the two differ in length.
    """

    choices: int
    dealt: Sequence[int]
    said: Sequence[int | None]

    def __post_init__(self) -> None:
        if len(self.dealt) != len(self.said) or len(set(self.dealt)) != len(self.dealt):
            raise ValueError(f"a deal holds each answer once and meets one reply each; got {self.dealt}, {self.said}")
        if any(not 0 <= one < self.choices for one in (*self.dealt, *(one for one in self.said if one is not None))):
            raise ValueError(f"answers are numbers below {self.choices}; got {self.dealt} and {self.said}")

    @property
    def right(self) -> int:
        """Return how many replies are right."""
        return sum(one == other for one, other in zip(self.dealt, self.said, strict=True))

    def chances(self) -> npt.NDArray[np.float64]:
        """Return the chance of each number right, 0 to n, of these replies under a new deal.

        Deals are counted by inclusion and exclusion (rook polynomials, Riordan 1958).
        """
        n, of = len(self.dealt), self.choices
        named = Counter(one for one in self.said if one is not None)
        # Ways to choose questions whose replies name different answers, by number of questions.
        ways = [1]
        for times in named.values():
            ways = [one + times * fewer for one, fewer in zip([*ways, 0], [0, *ways], strict=True)]
        # Deals in which at least the chosen ones are right.
        deals = [way * factorial(of - at) for at, way in enumerate(ways[: n + 1])]
        exactly = [
            sum((-1) ** (at - k) * comb(at, k) * deals[at] for at in range(k, len(deals))) for k in range(len(deals))
        ]
        return np.array([one / factorial(of) for one in exactly] + [0.0] * (n + 1 - len(exactly)))


def right(blocks: Iterable[Block]) -> Statistic:
    """Return the share of right replies, with the exact p against guessing and an exact interval.

    p is the share of all deals under which these very replies are right at least as often. Whatever
    a guesser does, it cannot know the deal (Fisher's randomisation test). Each end of the
    Clopper–Pearson interval is a one-sided bound of 95 %. Binomial bounds hold for questions of
    different difficulty too (Hoeffding 1956). The value is None without questions.
    """
    held = tuple(blocks)
    method = "share right; exact randomisation p; Clopper–Pearson, 95 % at each end"
    n = sum(len(block.dealt) for block in held)
    if n == 0:
        return not_available("no question was answered", method=method)
    k = sum(block.right for block in held)
    chances = np.ones(1)
    for one in held:
        chances = np.convolve(chances, one.chances())
    expected = float(chances @ np.arange(len(chances)))
    p = min(1.0, float(chances[k:].sum()))
    return ForcedChoice(k / n, n, bounds(k, n), p, method, level=2 * LEVEL - 1, right=k, expected=expected)


def fewer_p(right: int, n: int, others_right: int, others: int) -> float:
    """Return the chance of so few right, or fewer, among ``n``, if all are dealt at random.

    Fisher's exact test, one-sided, of ``right`` of ``n`` against ``others_right`` of ``others``.
    """
    known, whole = right + others_right, n + others
    ways = sum(comb(known, k) * comb(whole - known, n - k) for k in range(right + 1) if n - k <= whole - known)
    return ways / comb(whole, n)


def bounds(k: int, n: int) -> tuple[float, float]:
    """Return the lower and upper bound, each one-sided at 95 %, of a rate seen as k of n.

    Source: Clopper and Pearson 1934.
    """
    from scipy.stats import beta  # noqa: PLC0415 - slow to import

    low = 0.0 if k == 0 else float(beta.ppf(1 - LEVEL, k, n - k + 1))
    return low, 1.0 if k == n else float(beta.ppf(LEVEL, k + 1, n - k))
