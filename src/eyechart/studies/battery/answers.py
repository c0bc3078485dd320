"""What one model answered: its decisions, frame by frame and condition by condition, beside the ground truth."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eyechart.actions import ActionSpace, Decision, read_decision
from eyechart.calls import TRANSIENT, CallKey, Reply
from eyechart.errors import BankError
from eyechart.frames import Frame, FrameBank, Gap

Symbols = NDArray[np.str_]
Mask = NDArray[np.bool_]

ABSENT = ""
"""The symbol of a call that was not planned or has not come back."""


@dataclass(frozen=True)
class Answers:
    """A model's decisions. ``decisions[condition]`` is aligned with ``frames``; None where there is no reply.

    ``finished`` counts the calls about these frames whose reply is final.
    """

    model: str
    frames: tuple[Frame, ...]
    space: ActionSpace
    gap: Gap | None
    decisions: Mapping[str, tuple[Decision | None, ...]]
    finished: int = 0

    def responses(self, condition: str) -> Symbols:
        """Return response-level symbols, one per frame: the action, UNPARSED, or ``ABSENT``."""
        given = self.decisions.get(condition, (None,) * len(self.frames))
        return np.array([ABSENT if one is None else one.symbol for one in given], dtype=np.str_)

    def actions(self, condition: str) -> Symbols:
        """Return decision-level symbols, one per frame: the action, or ``ABSENT`` where there is no decision."""
        given = self.decisions.get(condition, (None,) * len(self.frames))
        return np.array([ABSENT if one is None or one.action is None else one.action for one in given], dtype=np.str_)

    def symbols(self, condition: str, level: str) -> Symbols:
        """Return the symbols of a condition at level ``response`` or ``decision``."""
        return self.responses(condition) if level == "response" else self.actions(condition)

    def both(self, first: str, second: str, level: str) -> tuple[Symbols, Symbols, Mask]:
        """Return two conditions' symbols on the frames that have both, and which frames these are."""
        one, other = self.symbols(first, level), self.symbols(second, level)
        have = (one != ABSENT) & (other != ABSENT)
        return one[have], other[have], have

    def levels(self, actions: Symbols) -> NDArray[np.int64]:
        """Return braking levels, 0 for what does not brake and -1 for what is no decision."""
        table = {action: self.space.braking_level(action) for action in self.space.actions}
        return np.array([table.get(str(action), -1) for action in actions], dtype=np.int64)

    @property
    def episodes(self) -> Symbols:
        """Return each frame's episode."""
        return np.array([frame.episode for frame in self.frames], dtype=np.str_)

    @property
    def scenarios(self) -> Symbols:
        """Return each frame's scenario."""
        return np.array([frame.scenario for frame in self.frames], dtype=np.str_)

    @property
    def steps(self) -> NDArray[np.int64]:
        """Return each frame's step."""
        return np.array([frame.step for frame in self.frames], dtype=np.int64)

    @property
    def gaps(self) -> NDArray[np.float64] | None:
        """Return each frame's gap, infinite where there is no lead; None where the bank records no gap."""
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


def read_answers(
    model: str,
    replies: Iterable[tuple[CallKey, Reply]],
    bank: FrameBank,
    frames: tuple[Frame, ...],
) -> Answers:
    """Read every reply of a model as a decision; replies about frames that are not asked for are left out."""
    place = {frame.id: index for index, frame in enumerate(frames)}
    space = bank.manifest.action_space
    decisions: dict[str, list[Decision | None]] = {}
    shared: dict[Decision, Decision] = {}
    finished = 0
    for key, reply in replies:
        if key.frame in place:
            column = decisions.setdefault(key.condition, [None] * len(frames))
            decision = read_decision(reply.text, reply.finish_reason, reply.error, space)
            column[place[key.frame]] = shared.setdefault(decision, decision)
            finished += reply.error not in TRANSIENT
    return Answers(
        model=model,
        frames=frames,
        space=space,
        gap=bank.manifest.gap,
        decisions={condition: tuple(column) for condition, column in sorted(decisions.items())},
        finished=finished,
    )
