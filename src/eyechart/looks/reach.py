"""Which answers a bank can give on a number of frames, and how many frames a look needs."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from eyechart.errors import SpecError
from eyechart.frames import FrameBank
from eyechart.run import spread
from eyechart.studies.battery.odds import NOISE, odds_of
from eyechart.studies.battery.reach import _reach

POWER = 0.80
SMALL = 216
"""A bank up to this size is used whole; of a larger one, the fewest frames for every answer."""
GROWTH = 1.5
LEAST = 8
"""With fewer frames no effect differs from chance."""
_DRAWS = 200
_OF_MOVED = (
    "the bank has no pictures of the same moments with the lead moved; how to take or edit them: "
    "docs/bring-your-own-frames.md"
)
STANDS_FOR: Mapping[str, tuple[str, ...]] = {
    "Yes": ("depth",),
    "In part": ("partial_depth", "depth_associated", "content"),
    "No": ("image_invariant",),
}
"""The labels that show whether a bank can give an answer; one of them is enough."""


@dataclass(frozen=True)
class SampleReach:
    """The power of each answer on some frames of a bank, and what others lack.

    The power is that of the label that stands for the answer; None if it is unknown.
    """

    frames: int
    power: Mapping[str, float | None]
    lacking: Mapping[str, str]

    @classmethod
    def of(cls, bank: FrameBank, frames: int) -> "SampleReach":
        """Return the reach of ``frames`` frames, for models with the planned noise floor."""
        some = replace(bank, frames=spread(bank.frames, frames))
        odds = odds_of(some, draws=_DRAWS, reads=(1.0,))
        lacking = {}
        for name, labels in STANDS_FOR.items():
            first = _reach(labels[0], some)
            if not first.reached and not any(_reach(label, some).reached for label in labels[1:]):
                more = f"; {first.words}" if first.more is not None else ""
                lacking[name] = f"{first.lacks}{more}"
        return cls(frames, {"Yes": odds.depth["1"], "In part": None, "No": odds.image_invariant}, lacking)

    @property
    def is_whole(self) -> bool:
        """Return whether every answer that the bank can give has enough power."""
        return all(one is None or one >= POWER for name, one in self.power.items() if name not in self.lacking)

    def lines(self) -> Iterator[str]:
        """Yield the answers that are in reach, and why others are not."""
        able = {name: one for name, one in self.power.items() if name not in self.lacking}
        rare = {name: one for name, one in able.items() if one is not None and one < POWER}
        held = [name if one is None else f"{name} ({one:.2f})" for name, one in able.items() if name not in rare]
        model = f"for a model that answers {NOISE:.0%} of repeats differently"
        if held:
            how = f"; in brackets the power, {model}" if "(" in "".join(held) else ""
            yield f"in reach on {self.frames} frames: {', '.join(held)}{how}"
        for name, why in self.lacking.items():
            yield f"out of reach: {name}: {_OF_MOVED if 'lead_near,' in why else why}"
        for name, one in rare.items():
            yield f"out of reach: {name}: power {one:.2f} on {self.frames} frames, {model}; more frames raise it"


def fewest(bank: FrameBank, most: int) -> SampleReach:
    """Return the reach of the fewest frames that give every answer, or of ``most`` frames."""
    frames = min(SMALL, most)
    while True:
        result = SampleReach.of(bank, frames)
        if result.is_whole or frames == most:
            return result
        frames = min(most, round(frames * GROWTH))


def affordable(frames: int, most: Callable[[int], int], budget: int) -> int:
    """Return how many frames a look can use with ``budget`` calls.

    ``most`` gives the most calls for a number of frames. Raises SpecError if too few remain.
    """
    low, high = 0, frames
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if most(middle) <= budget else (low, middle - 1)
    if low < min(LEAST, frames):
        least = most(min(LEAST, frames))
        raise SpecError(
            f"so few calls can give no answer: {LEAST} frames take up to {least}, in addition to those that "
            "find the request mode; raise --budget"
        )
    return low
