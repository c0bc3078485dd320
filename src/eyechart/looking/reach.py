"""Which answers so many frames of a bank can give, and on how many frames a look is made."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from eyechart.errors import SpecError
from eyechart.frames import FrameBank
from eyechart.run import spread
from eyechart.studies.battery.odds import NOISE, odds_of
from eyechart.studies.battery.reach import reach_of

POWER = 0.80
SMALL = 216
"""Of a bank with no more frames all are asked; of a larger one the fewest on which every answer is in reach."""
GROWTH = 1.5
LEAST = 8
"""With fewer frames nothing is told from chance."""
_DRAWS = 200
STANDS_FOR: Mapping[str, tuple[str, ...]] = {
    "Yes": ("depth",),
    "In part": ("content", "depth_associated", "partial_depth"),
    "No": ("image_invariant",),
}
"""The labels by which it is known whether a bank can give an answer; one of them is enough."""


@dataclass(frozen=True)
class Sized:
    """How often each answer is found on so many frames of a bank, and of each that cannot be given what is missing.

    The power is that of the label that stands for the answer, None where nobody knows it.
    """

    frames: int
    power: Mapping[str, float | None]
    lacking: Mapping[str, str]

    @classmethod
    def of(cls, bank: FrameBank, frames: int) -> "Sized":
        """Return this of so many frames of a bank, of models that disagree with themselves as is planned for."""
        some = replace(bank, frames=spread(bank.frames, frames))
        odds = odds_of(some, draws=_DRAWS)
        lacking, reached = {}, reach_of(some)
        for name, labels in STANDS_FOR.items():
            each = [one for one in reached if one.label in labels]
            if not any(one.reached for one in each):
                more = f"; {each[0].words}" if each[0].more is not None else ""
                lacking[name] = f"{each[0].lacks}{more}"
        return cls(frames, {"Yes": odds.depth["1"], "In part": None, "No": odds.image_invariant}, lacking)

    @property
    def is_whole(self) -> bool:
        """Return whether every answer that the bank can give at all is found often enough."""
        return all(one is None or one >= POWER for name, one in self.power.items() if name not in self.lacking)

    def lines(self) -> Iterator[str]:
        """Yield which answers are in reach, and which are not and why."""
        able = {name: one for name, one in self.power.items() if name not in self.lacking}
        rare = {name: one for name, one in able.items() if one is not None and one < POWER}
        held = [name if one is None else f"{name} ({one:.2f})" for name, one in able.items() if name not in rare]
        if held:
            how = f"; in brackets how often, of a model that answers {NOISE:.0%} of repeats otherwise"
            yield f"in reach on {self.frames} frames: {', '.join(held)}{how if '(' in ''.join(held) else ''}"
        yield from (f"out of reach: {name}: {why}" for name, why in self.lacking.items())
        for name, one in rare.items():
            yield f"out of reach: {name}: found {one:.2f} of the time on {self.frames} frames; more frames find it"


def fewest(bank: FrameBank, most: int) -> Sized:
    """Return the reach of the fewest frames on which every answer is in reach; of ``most`` where none is fewer."""
    frames = min(SMALL, most)
    while True:
        found = Sized.of(bank, frames)
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
