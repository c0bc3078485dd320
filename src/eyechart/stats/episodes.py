"""A share over frames that come in episodes: its interval where the frames of an episode resemble one another."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from eyechart.stats.agreement import rate
from eyechart.stats.statistic import Statistic, cannot_say

Floats = npt.NDArray[np.float64]

_NODES = 32
_ANGLE = np.pi / 2 * (np.arange(_NODES) + 0.5) / _NODES
_CONCENTRATION: Floats = 1 / np.tan(_ANGLE) ** 2
_PRIOR: Floats = -np.log(np.cos(_ANGLE)) / 3
"""The correlation within an episode is sin² of these angles, and a + b of the beta distribution 1/correlation - 1; with
these weights its prior is Beta(1/2, 1/3), but for a constant."""

_FADES = 6.0
"""How fast degrees of freedom grow towards 0 and 1; measured, as the prior is."""

_EDGE = 1e-9
_SUMMED = 64
"""Up to so many frames an episode logarithms are summed; beyond, log gamma is faster."""


def share_over_episodes(hits: npt.ArrayLike, frames: npt.ArrayLike, *, level: float = 0.95) -> Statistic:
    """Return the share of frames that are hits, with an interval that holds where episodes differ from one another.

    ``hits`` and ``frames``, shape (episodes,), count each episode's; ``n`` counts the frames. Hits are beta-binomial,
    the correlation within an episode is integrated out of the likelihood over a Beta(1/2, 1/3) prior, and the interval
    holds the rates whose likelihood ratio stays within that of F(1, episodes - 1), or of more degrees of freedom near 0
    and 1, where rates have little room to spread. An episode weighs as its frames do, and episodes of unequal length
    count as Kish's effective number. Where all episodes have the same share, the bound is exact: so many draws without
    one that differs. Episodes of one frame get Wilson's interval; below two episodes there is none. ValueError for
    counts that cannot be. Measured in docs/decisions/0040-honest-intervals-of-shares.md.
    """
    k, n = np.asarray(hits, dtype=np.float64), np.asarray(frames, dtype=np.float64)
    if k.ndim != 1 or k.shape != n.shape or not ((k >= 0) & (k <= n)).all() or not 0 < level < 1:
        raise ValueError(f"need 0 <= hits <= frames for each episode and a level in (0, 1), got {k} of {n} at {level}")
    k, n = k[n > 0], n[n > 0]
    method = f"share of frames, {100 * level:g}% interval over episodes"
    if not len(n):
        return cannot_say("no frames", method=method)
    total, episodes = int(n.sum()), len(n)
    value = float(k.sum() / n.sum())
    detail = {"k": int(k.sum()), "episodes": episodes}
    if episodes < 2:
        return Statistic(value, total, method=method, note="one episode shows no spread", detail=detail, level=level)
    if n.max() == 1:
        alone = rate(detail["k"], total, level=level)
        return Statistic(value, total, alone.ci, method=alone.method, detail=detail, level=level)
    effective = float(n.sum() ** 2 / (n**2).sum())
    if np.ptp(k / n) < 1e-12:
        differ = 1 - (1 - level) ** (1 / effective)
        ci = (value * (1 - differ), value + (1 - value) * differ)
        method += ", exact: no episode differs"
    else:
        ci = _by_likelihood(k, n, n / n.sum() * effective, _cut(value, effective, level))
        ci = (min(ci[0], value), max(ci[1], value))
        method += " (beta-binomial likelihood, correlation integrated out)"
    return Statistic(value, total, ci, method=method, detail=detail, level=level)


def _cut(value: float, episodes: float, level: float) -> float:
    from scipy import special  # noqa: PLC0415 - slow to import

    freedom = episodes - 1 + _FADES * (1 / (4 * value * (1 - value)) - 1)
    return float(special.stdtrit(freedom, (1 + level) / 2) ** 2)


def _by_likelihood(k: Floats, n: Floats, weight: Floats, cut: float) -> tuple[float, float]:
    """Return the lowest and the highest rate whose log likelihood is within cut/2 of the largest."""
    beyond = -_rising(n, weight)(_CONCENTRATION) + _PRIOR
    hits, others = _rising(k, weight), _rising(n - k, weight)

    def likelihood(angle: Floats) -> Floats:
        """Return the log likelihood of the rates sin² of some angles."""
        one, other = (part**2 * _CONCENTRATION for part in (np.sin(angle)[:, None], np.cos(angle)[:, None]))
        together = hits(one) + others(other) + beyond
        return np.asarray(np.logaddexp.reduce(together, axis=1))

    points = np.linspace(_EDGE, np.pi / 2 - _EDGE, 33)
    coarse = likelihood(points)
    top, step = points[coarse.argmax()], points[1] - points[0]
    for _ in range(4):
        near = np.clip(top + step * np.linspace(-1, 1, 9), points[0], points[-1])
        found = likelihood(near)
        top, step = near[found.argmax()], step / 4
    least = found.max() - cut / 2
    below, above = points[(points < top) & (coarse < least)], points[(points > top) & (coarse < least)]
    inside = np.array([top, top])
    outside = np.array([below.max(initial=points[0]), above.min(initial=points[-1])])
    for _ in range(20):
        middle = (inside + outside) / 2
        within = likelihood(middle) >= least
        inside, outside = np.where(within, middle, inside), np.where(within, outside, middle)
    low, high = (float(rate) for rate in np.sin(outside) ** 2)
    return low, high


def _rising(counts: Floats, weight: Floats) -> Callable[[Floats], Floats]:
    """Return what gives of starts the weighted sum, over episodes, of log (start (start + 1) … (start + count - 1))."""
    most = int(counts.max())
    if most <= _SUMMED:
        i = np.arange(most)
        reaching = (counts[:, None] > i).T @ weight
        return lambda start: np.asarray(np.log(start[..., None] + i) @ reaching)
    from scipy import special  # noqa: PLC0415 - slow to import

    each, place = np.unique(counts, return_inverse=True)
    weights = np.bincount(place, weights=weight)
    return lambda start: np.asarray(
        special.gammaln(start[..., None] + each) @ weights - special.gammaln(start) * weights.sum()
    )
