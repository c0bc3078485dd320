"""The distances of vehicles in control pictures, drawn by a seed over the visible range.

The distance of the lead alone covers the whole range. The distance of the exchange keeps away from
the ends, and differs from the lead's by a factor. Both are spread evenly in the logarithm, and
stratified over a bank's frames. If a frame cannot show a distance, others of the whole range are
tried, so the distances shown are drawn from the possible ones.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from eyechart.frames.nouns import Frame, FrameBank
from eyechart.seeds import key_seed

LEAD, EXCHANGE = "lead_drawn_m", "exchange_m"
APART = 1.5
"""The least factor between the two distances of a frame."""

NEAREST, FARTHEST = 1.12, 0.82
"""The limits of the exchange, as factors of the lowest and of the farthest distance."""

TRIES = 60
"""The number of distances that are tried for a frame."""

Span = tuple[float, float]


def exchanged(span: Span) -> Span:
    """Return the range of the exchange's distances for the lead's range."""
    return NEAREST * span[0], FARTHEST * span[1]


@dataclass(frozen=True, slots=True)
class Draws:
    """The distances to try for one frame; the first is at the frame's own share (0 to 1).

    Without a span there are none.
    """

    seed: int
    frame: str
    span: Span | None
    shares: tuple[float, float]

    def lead(self) -> Iterator[float]:
        """Yield the distances of the lead alone."""
        if self.span is not None:
            yield from self._spread(LEAD, self.span, self.shares[0])

    def exchange(self, lead_m: float | None) -> Iterator[float]:
        """Yield the distances of the exchange that are apart from the lead's ``lead_m``, if any."""
        found = () if self.span is None else self._spread(EXCHANGE, exchanged(self.span), self.shares[1])
        yield from (one for one in found if lead_m is None or _is_apart(one, lead_m))

    def _spread(self, column: str, span: Span, share: float) -> Iterator[float]:
        rng = np.random.default_rng(key_seed("drawn", column, self.seed, self.frame))
        for one in (share, *rng.random(TRIES - 1).tolist()):
            yield round(span[0] * (span[1] / span[0]) ** one, 3)


def _is_apart(one: float, other: float) -> bool:
    return max(one, other) >= APART * min(one, other)


def draws_of(seed: int, span: Span | None, frames: Sequence[str]) -> dict[str, Draws]:
    """Return the distances to try for each frame; each has its own share of the range."""
    rng, count = np.random.default_rng(key_seed("drawn", seed, *frames)), len(frames)
    lead, exchange = ((rng.permutation(count) + rng.random(count)) / count for _ in range(2))
    return {
        frame: Draws(seed, frame, span, (float(one), float(other)))
        for frame, one, other in zip(frames, lead, exchange, strict=True)
    }


def drawn_otherwise(bank: FrameBank) -> list[str]:
    """Return one line for each distance that the bank's seed does not draw."""
    controls, span = bank.manifest.controls, bank.manifest.span
    if controls.seed is None or span is None:
        return []
    draws = draws_of(controls.seed, span, [frame.id for frame in bank])
    return [line for frame in bank for line in _problems(frame, draws[frame.id])]


def _problems(frame: Frame, draws: Draws) -> Iterator[str]:
    lead_m, exchange_m = number_of(frame.truth.get(LEAD)), number_of(frame.truth.get(EXCHANGE))
    for column, recorded, tried in ((LEAD, lead_m, draws.lead()), (EXCHANGE, exchange_m, draws.exchange(lead_m))):
        if recorded is not None and recorded not in tried:
            yield f"frame '{frame.id}': '{column}' is {recorded:g}, which the bank's seed does not draw"
    for name, recorded in (("lead_drawn", lead_m), ("exchange_own", exchange_m), ("exchange_beside", exchange_m)):
        if (name in frame.counterfactuals) != (recorded is not None):
            column = LEAD if name == "lead_drawn" else EXCHANGE
            yield f"frame '{frame.id}' has only one of the picture {name} and its distance '{column}'"


def number_of(value: object) -> float | None:
    """Return a number as a float, None for anything else."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
