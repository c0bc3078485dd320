"""What one model told of the scenes: its estimate of every picture and of its reflection, beside the ground truth."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eyechart.calls import UNFINISHED, CallKey, Reply
from eyechart.cameras import Distances
from eyechart.errors import BankError
from eyechart.frames import Frame, FrameBank
from eyechart.perception.forward import distances_of
from eyechart.spaces.scene import HIGHWAY, SCENES, Estimate, SceneDecision

Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Told:
    """A model's replies as scenes. ``replies[condition]`` is aligned with ``frames``; None where there is no reply.

    ``gap_m`` is the true gap of each frame in the bank's ``unit``, infinite where there is no lead; ``close`` whether
    it is below the bank's threshold; ``visible`` whether there is a lead in the picture. ``before`` marks the frames
    before any collision of their episode, and is None where the bank does not record collisions. ``distances`` are what
    counts as near in the world. ``finished`` counts the calls whose reply is final.
    """

    model: str
    frames: tuple[Frame, ...]
    replies: Mapping[str, tuple[SceneDecision | None, ...]]
    gap_m: Floats
    close: Mask
    visible: Mask
    before: Mask | None
    unit: str = "m"
    distances: Distances = HIGHWAY
    finished: int = 0

    def estimates(self, condition: str) -> tuple[Estimate | None, ...]:
        """Return the estimate of each frame, None where there is none."""
        return tuple(None if one is None else one.action for one in self.replies_to(condition))

    def replies_to(self, condition: str) -> tuple[SceneDecision | None, ...]:
        """Return what came back about each frame, None where nothing did."""
        return self.replies.get(condition, (None,) * len(self.frames))

    @cached_property
    def reasons(self) -> dict[str, int]:
        """Return how many replies hold no estimate, by reason; ``unparsed`` ones by what is wrong with them."""
        every = (one for column in self.replies.values() for one in column if one is not None and one.missing)
        return dict(sorted(Counter(str(one.why or one.missing) for one in every).items()))

    @cached_property
    def repairs(self) -> dict[str, int]:
        """Return how many replies needed each repair of their syntax."""
        every = (one for column in self.replies.values() for one in column if one is not None)
        return dict(sorted(Counter(str(name) for one in every for name in one.repairs).items()))


def read_told(model: str, replies: Iterable[tuple[CallKey, Reply]], bank: FrameBank, frames: tuple[Frame, ...]) -> Told:
    """Read every reply of a model as a scene estimate; replies about frames that are not asked for are left out.

    Raises BankError where the bank records no gap.
    """
    place = {frame.id: index for index, frame in enumerate(frames)}
    found: dict[str, list[SceneDecision | None]] = {}
    finished = 0
    for key, reply in replies:
        if key.frame in place:
            column = found.setdefault(key.condition, [None] * len(frames))
            column[place[key.frame]] = SCENES.read(reply)
            finished += reply.error not in UNFINISHED
    gaps = [gap_of(frame, bank) for frame in frames]
    return Told(
        model=model,
        frames=frames,
        replies={condition: tuple(column) for condition, column in sorted(found.items())},
        gap_m=np.array(gaps, dtype=np.float64),
        close=np.array([is_close(frame, bank) for frame in frames], dtype=np.bool_),
        visible=np.isfinite(gaps) & np.array([frame.truth.get("lead_visible") is not False for frame in frames], bool),
        before=before_collision(bank, frames),
        unit=bank.manifest.gap.unit if bank.manifest.gap is not None else "",
        distances=worlds_distances(bank),
        finished=finished,
    )


def worlds_distances(bank: FrameBank) -> Distances:
    """Return what counts as near in the bank's world; what is close is what the bank says."""
    distances, gap = distances_of(bank.manifest.simulator), bank.manifest.gap
    return distances if gap is None or gap.unit != "m" else replace(distances, close_m=gap.threshold)


def gap_of(frame: Frame, bank: FrameBank) -> float:
    """Return a frame's true gap, infinite where there is no lead; raises BankError where the bank records none."""
    declared = bank.manifest.gap
    if declared is None:
        raise BankError(f"the bank {bank.root} records no gap, so nobody can say which leads are close")
    if declared.column not in frame.truth:
        raise BankError(f"frame '{frame.id}' has no column '{declared.column}', which the bank declares as its gap")
    value = frame.truth[declared.column]
    if isinstance(value, bool | str):
        raise BankError(f"frame '{frame.id}': the gap '{declared.column}' is {value!r}, not a number")
    return math.inf if value is None else float(value)


def is_close(frame: Frame, bank: FrameBank) -> bool:
    """Return whether a frame's lead is nearer than the bank's threshold; see `gap_of`."""
    gap = bank.manifest.gap
    return gap is not None and gap_of(frame, bank) < gap.threshold


def before_collision(bank: FrameBank, frames: tuple[Frame, ...]) -> Mask | None:
    """Return which frames come before any collision of their episode; None where the bank does not record them.

    All frames of the bank count for that, asked about or not.
    """
    if any("crashed" not in frame.truth for frame in bank):
        return None
    first: dict[str, int] = {}
    for frame in bank:
        if frame.truth["crashed"]:
            first[episode_of(frame)] = min(first.get(episode_of(frame), frame.step), frame.step)
    return np.array([frame.step < first.get(episode_of(frame), frame.step + 1) for frame in frames], dtype=np.bool_)


def episode_of(frame: Frame) -> str:
    """Return the name of a frame's episode among all: an episode's own name may recur in another scenario."""
    return f"{frame.scenario}/{frame.episode}"
