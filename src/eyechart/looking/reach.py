"""Which answers so many frames of a bank can give, and on how many frames a look is made."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from eyechart.errors import SpecError
from eyechart.frames import FrameBank
from eyechart.run import spread
from eyechart.studies.battery.odds import NOISE, odds_of

POWER = 0.80
SMALL = 216
"""Of a bank with no more frames all are asked; of a larger one the fewest on which every answer is in reach."""
GROWTH = 1.5
LEAST = 8
"""With fewer frames nothing is told from chance."""
_DRAWS = 200


@dataclass(frozen=True)
class Reach:
    """How often each answer is found on so many frames of a bank; None where the bank has not what it needs."""

    frames: int
    found: Mapping[str, float | None]

    @classmethod
    def of(cls, bank: FrameBank, frames: int) -> "Reach":
        """Return the reach of so many frames of a bank, of models that disagree with themselves as is planned for."""
        odds = odds_of(replace(bank, frames=spread(bank.frames, frames)), draws=_DRAWS)
        return cls(frames, {"Yes": odds.depth["1"], "No": odds.image_invariant})

    @property
    def is_whole(self) -> bool:
        """Return whether every answer that the bank can give at all is found often enough."""
        return all(one is None or one >= POWER for one in self.found.values())

    def lines(self) -> Iterator[str]:
        """Yield which answers are in reach, and which are not and why."""
        held = [f"{name} ({one:.2f})" for name, one in self.found.items() if one is not None and one >= POWER]
        if held:
            yield f"in reach on {self.frames} frames, with its power at a noise floor of {NOISE:g}: {', '.join(held)}"
        for name, one in self.found.items():
            if one is None:
                lacks = "the bank has no pictures of one moment with what is ahead near and far" * (name == "Yes")
                yield f"out of reach: {name}: {lacks or 'the bank has nothing to exchange a frame for'}"
            elif one < POWER:
                yield f"out of reach: {name}: found {one:.2f} of the time on {self.frames} frames; more frames find it"


def fewest(bank: FrameBank, most: int) -> Reach:
    """Return the reach of the fewest frames on which every answer is in reach; of ``most`` where none is fewer."""
    frames = min(SMALL, most)
    while True:
        found = Reach.of(bank, frames)
        if found.is_whole or frames == most:
            return found
        frames = min(most, round(frames * GROWTH))


def affordable(frames: int, most: Callable[[int], int], budget: int) -> int:
    """Return on how many of the frames a look takes at most ``budget`` calls; ``most`` says how many so many take.

    Raises SpecError where that is fewer than tell anything.
    """
    low, high = 0, frames
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if most(middle) <= budget else (low, middle - 1)
    if low < min(LEAST, frames):
        least = most(min(LEAST, frames))
        raise SpecError(
            f"no answer is within reach of so few calls: {LEAST} frames take up to {least}, beside those that find out "
            "how a model is asked; raise --budget"
        )
    return low
