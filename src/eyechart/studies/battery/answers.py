"""What one model answered: its decisions, frame by frame and condition by condition, beside the ground truth."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eyechart.calls import UNFINISHED, CallKey, Reply
from eyechart.errors import BankError
from eyechart.frames import Frame, FrameBank, Gap
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.space import Decision
from eyechart.verdicts import DECIDED

Symbols = NDArray[np.str_]
Mask = NDArray[np.bool_]

ABSENT = ""
"""The symbol of a call that was not planned or has not come back."""

NO_GAP = "the bank records no gap"
NO_EPISODES = "the bank records no episodes, and nobody declared its frames independent (--independent)"


@dataclass(frozen=True)
class Answers:
    """A model's decisions. ``decisions[condition]`` is aligned with ``frames``; None where there is no reply.

    ``finished`` counts the calls about these frames whose reply is final; ``no_gap`` says why there is no gap to
    test, where ``gap`` is None. ``told`` says whether the prompt said something of each frame.
    """

    model: str
    frames: tuple[Frame, ...]
    space: Discrete
    gap: Gap | None
    decisions: Mapping[str, tuple[Decision[str] | None, ...]]
    finished: int = 0
    no_gap: str = NO_GAP
    told: bool = False

    def responses(self, condition: str) -> Symbols:
        """Return response-level symbols, one per frame: the action, UNPARSED, or ``ABSENT``."""
        return self.symbols(condition, "response")

    def actions(self, condition: str) -> Symbols:
        """Return decision-level symbols, one per frame: the action, or ``ABSENT`` where there is no decision."""
        return self.symbols(condition, "decision")

    def symbols(self, condition: str, level: str) -> Symbols:
        """Return the symbols of a condition at level ``response`` or ``decision``; they are not to be written to."""
        if (condition, level) not in self._symbols:
            given = self.decisions.get(condition, (None,) * len(self.frames))
            symbol = _response if level == "response" else _action
            made = np.array([symbol(one) for one in given], dtype=np.str_)
            made.flags.writeable = False
            self._symbols[condition, level] = made
        return self._symbols[condition, level]

    @cached_property
    def _symbols(self) -> dict[tuple[str, str], Symbols]:
        return {}

    def both(self, first: str, second: str, level: str) -> tuple[Symbols, Symbols, Mask]:
        """Return two conditions' symbols on the frames that have both, and which frames these are."""
        one, other = self.symbols(first, level), self.symbols(second, level)
        have = (one != ABSENT) & (other != ABSENT)
        return one[have], other[have], have

    def levels(self, actions: Symbols) -> NDArray[np.int64]:
        """Return the braking level of each symbol of an array: 0 where it does not brake, -1 for no decision."""
        levels = np.full(len(actions), -1, dtype=np.int64)
        for action in self.space.actions:
            levels[actions == action] = self.space.project(action, "brake") or 0
        return levels

    def directions(self) -> dict[str, int]:
        """Return how often each direction was given to real pictures and to their reflections."""
        given = [*self.actions("real"), *self.actions("mirrored")]
        return {direction: sum(one == direction for one in given) for direction in self.space.directional}

    def counts(self) -> dict[str, Counter[str]]:
        """Return, by condition, how many replies hold a decision, and how many none, by the reason."""
        return {
            name: Counter(one.reason or DECIDED for one in column if one is not None)
            for name, column in self.decisions.items()
        }

    @cached_property
    def episodes(self) -> Symbols:
        """Return each frame's episode."""
        return np.array([frame.episode for frame in self.frames], dtype=np.str_)

    @cached_property
    def scenarios(self) -> Symbols:
        """Return each frame's scenario."""
        return np.array([frame.scenario for frame in self.frames], dtype=np.str_)

    @cached_property
    def steps(self) -> NDArray[np.int64]:
        """Return each frame's step."""
        return np.array([frame.step for frame in self.frames], dtype=np.int64)

    @cached_property
    def gaps(self) -> NDArray[np.float64] | None:
        """Return each frame's gap in the bank's unit, infinite where there is no lead; None where it records no gap.

        Raises BankError, naming the frame, where the declared column is missing or holds no number.
        """
        if self.gap is None:
            return None
        column, values = self.gap.column, []
        for frame in self.frames:
            if column not in frame.truth:
                raise BankError(f"frame '{frame.id}' has no column '{column}', which the bank declares as its gap")
            value = frame.truth[column]
            if value is not None and (isinstance(value, bool | str)):
                raise BankError(f"frame '{frame.id}': the gap '{column}' is {value!r}, not a number")
            values.append(math.inf if value is None else float(value))
        return np.array(values, dtype=np.float64)


def _response(decision: Decision[str] | None) -> str:
    return ABSENT if decision is None else decision.symbol


def _action(decision: Decision[str] | None) -> str:
    return ABSENT if decision is None or decision.action is None else decision.action


def read_answers(
    model: str,
    replies: Iterable[tuple[CallKey, Reply]],
    bank: FrameBank,
    frames: tuple[Frame, ...],
    *,
    independent: bool = False,
    told: bool = False,
) -> Answers:
    """Read every reply of a model as a decision; replies about frames that are not asked for are left out.

    Where the bank records no episodes, its gap is read only if the frames were declared ``independent``.
    """
    place = {frame.id: index for index, frame in enumerate(frames)}
    space = bank.manifest.action_space
    decisions: dict[str, list[Decision[str] | None]] = {}
    finished = 0
    for key, reply in replies:
        if key.frame in place:
            if key.condition not in decisions:
                decisions[key.condition] = [None] * len(frames)
            decisions[key.condition][place[key.frame]] = space.read(reply)
            finished += reply.error not in UNFINISHED
    gap, silent = bank.manifest.gap, "episode" in bank.manifest.absent and not independent
    return Answers(
        model=model,
        frames=frames,
        space=space,
        gap=None if silent else gap,
        decisions={condition: tuple(column) for condition, column in sorted(decisions.items())},
        finished=finished,
        no_gap=NO_EPISODES if silent and gap is not None else NO_GAP,
        told=told,
    )
