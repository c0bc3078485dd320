"""One model's scene estimates of every picture and its reflection, and the ground truth."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eyechart.calls import CallKey, Reply
from eyechart.cameras import Distances
from eyechart.errors import BankError
from eyechart.frames import Frame, FrameBank, Scalar
from eyechart.perception.forward import worlds_distances
from eyechart.spaces.scene import HIGHWAY, SCENES, Estimate, SceneDecision, SceneSpace
from eyechart.studies.battery import read_columns

Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]

FAULTS = {
    "no estimate": 4.0,
    "close is wrong": 3.0,
    "no lead told": 2.0,
    "a lead that is not there": 2.0,
    "left is wrong": 1.0,
    "right is wrong": 1.0,
    "the reflection differs": 1.0,
}
"""The weight of each fault of an estimate; a gap error counts in thresholds, at most two."""
_MOST_OF_GAP = 2.0


@dataclass(frozen=True)
class SceneAnswers:
    """A model's replies as scenes. ``replies[condition]`` follows ``frames``; None without a reply.

    ``gap_m`` is the true gap of each frame in the bank's ``unit``, infinite without a lead.
    ``close`` says whether it is below the bank's threshold; ``visible`` whether a lead is in the
    picture. ``before`` marks the frames before any collision of their episode; it is None where the
    bank does not record collisions. ``distances`` define near in the world. ``finished`` counts the
    calls whose reply is final.
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
        return tuple(None if reply is None else reply.action for reply in self.replies_to(condition))

    def replies_to(self, condition: str) -> tuple[SceneDecision | None, ...]:
        """Return the reply about each frame, None where there is none."""
        return self.replies.get(condition, (None,) * len(self.frames))

    @cached_property
    def reasons(self) -> dict[str, int]:
        """Return how many replies lack an estimate, by reason; ``unparsed`` ones by their fault."""
        every = (one for column in self.replies.values() for one in column if one is not None and one.missing)
        return dict(sorted(Counter(str(one.why or one.missing) for one in every).items()))

    @cached_property
    def repairs(self) -> dict[str, int]:
        """Return how many replies needed each repair of their syntax."""
        every = (one for column in self.replies.values() for one in column if one is not None)
        return dict(sorted(Counter(str(name) for one in every for name in one.repairs).items()))


def read_scene_answers(
    model: str, replies: Iterable[tuple[CallKey, Reply]], bank: FrameBank, frames: tuple[Frame, ...]
) -> SceneAnswers:
    """Read every reply of a model about these frames as a scene estimate.

    The bank's version of the reader is used. Raises BankError where the bank records no gap.
    """
    gap = bank.manifest.gap
    if gap is None:
        raise BankError(f"the bank {bank.root} records no gap, so it is unknown which leads are close")
    gap_m = np.array([gap.of(frame) for frame in frames], dtype=np.float64)
    answers = scene_answers_of(replies, frames, gap_m, gap.threshold, scenes_of(bank).in_world(worlds_distances(bank)))
    return replace(answers, model=model, before=before_collision(bank, frames), unit=gap.unit)


def scenes_of(bank: FrameBank) -> SceneSpace:
    """Return the space of estimates for a bank, with the bank's version of the reader."""
    return SCENES.by(bank.manifest.action_space.reader)


def scene_answers_of(
    replies: Iterable[tuple[CallKey, Reply]], frames: tuple[Frame, ...], gap_m: Floats, close: float, space: SceneSpace
) -> SceneAnswers:
    """Return the replies as scenes; gaps below ``close`` are close, and ``space`` reads replies."""
    found, finished = read_columns(replies, frames, lambda _, reply: space.read(reply))
    there = np.array([frame.truth.get("lead_visible") is not False for frame in frames], dtype=np.bool_)
    visible = np.isfinite(gap_m) & there
    return SceneAnswers(
        "", frames, found, gap_m, gap_m < close, visible, None, distances=space.distances, finished=finished
    )


def before_collision(bank: FrameBank, frames: tuple[Frame, ...]) -> Mask | None:
    """Return the frames before any collision of their episode; None without recorded collisions.

    All frames of the bank count for that, whether the run has them or not.
    """
    if any("crashed" not in frame.truth for frame in bank):
        return None
    first: dict[str, int] = {}
    for frame in bank:
        if frame.truth["crashed"]:
            first[frame.drive] = min(first.get(frame.drive, frame.step), frame.step)
    return np.array([frame.step < first.get(frame.drive, frame.step + 1) for frame in frames], dtype=np.bool_)


def faults(answers: SceneAnswers, place: int) -> list[str]:
    """Return the faults of a model's estimate of a frame; empty where there was no call."""
    reply = answers.replies_to("real")[place]
    if reply is None:
        return []
    one, other = reply.action, answers.estimates("mirrored")[place]
    if one is None:
        return ["no estimate"]
    truth, seen = answers.frames[place].truth, bool(answers.visible[place])
    checks: dict[str, Callable[[], bool]] = {
        "close is wrong": lambda: one.close != bool(answers.close[place]),
        "no lead told": lambda: seen and one.gap_m is None,
        "a lead that is not there": lambda: not seen and one.gap_m is not None,
        "left is wrong": lambda: _contradicts(truth.get("left_clear"), said=one.left_clear),
        "right is wrong": lambda: _contradicts(truth.get("right_clear"), said=one.right_clear),
        "the reflection differs": lambda: (
            answers.replies_to("mirrored")[place] is not None and (other is None or one.mirrored() != other)
        ),
    }
    return [name for name, holds in checks.items() if holds()]


def weight(answers: SceneAnswers, place: int) -> float:
    """Return how bad a model's estimate of a frame is: the sum of its faults and gap error."""
    error = gap_error_m(answers, place)
    threshold = answers.distances.close_m
    return sum(FAULTS[name] for name in faults(answers, place)) + min((error or 0.0) / threshold, _MOST_OF_GAP)


def gap_error_m(answers: SceneAnswers, place: int) -> float | None:
    """Return the error of an estimated gap for a lead in the picture; None without one."""
    one = answers.estimates("real")[place]
    if one is None or one.gap_m is None or not answers.visible[place] or answers.unit != "m":
        return None
    return abs(one.gap_m - float(answers.gap_m[place]))


def _contradicts(truth: Scalar, *, said: bool) -> bool:
    return isinstance(truth, bool) and truth != said
