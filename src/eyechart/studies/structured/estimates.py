"""The evidence of a run of scene estimates: its score, its replies, and its frames with the worst estimates first."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from eyechart.frames import Frame, FrameBank, Scalar
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.spaces.scene import Estimate
from eyechart.studies import structured as study
from eyechart.studies.battery.subjects import Replies, Tell, find_pictures, names_of
from eyechart.studies.structured import EstimatorScore, StructuredScore, Told

FAULTS = {
    "no estimate": 4.0,
    "close is wrong": 3.0,
    "no lead told": 2.0,
    "a lead that is not there": 2.0,
    "left is wrong": 1.0,
    "right is wrong": 1.0,
    "the reflection differs": 1.0,
}
"""What counts against an estimate, and how much; an error of the gap counts in thresholds, two of them at most."""
_MOST_OF_GAP = 2.0


@dataclass(frozen=True)
class Estimates:
    """One run of scene estimates, scored.

    ``replies`` are verbatim, by model. ``pictures`` is None where the bank's pictures cannot be shown;
    ``about_pictures`` then says why, else that they are those that the run recorded.
    """

    name: str
    score: StructuredScore
    replies: Mapping[str, Replies]
    pictures: FrameBank | None
    about_pictures: str

    @cached_property
    def frames(self) -> tuple[Frame, ...]:
        """Return the frames that the run asks about."""
        return next((one.told.frames for one in self.score.models.values()), ())

    @cached_property
    def worst(self) -> tuple[int, ...]:
        """Return the places of the frames, those with the worst estimates of all models together first."""
        every = [[weight(one.told, place) for place in range(len(self.frames))] for one in self.score.models.values()]
        sums = np.sum(every, axis=0) if every else np.zeros(0)
        return tuple(int(place) for place in np.argsort(-sums, kind="stable"))


@dataclass(frozen=True)
class Estimator:
    """A model in a run. ``label`` names the run too where a report holds several."""

    label: str
    spec: str
    run: Estimates

    @property
    def score(self) -> EstimatorScore:
        """Return the model's score."""
        return self.run.score.models[self.spec]


def read_estimates(
    runs: Sequence[Path], banks: Sequence[Path] = (), *, reread: bool = False, tell: Tell = lambda _: None
) -> list[Estimates]:
    """Score runs of scene estimates, and find their pictures: in one of ``banks``, or where each run's manifest says.

    Raises LedgerError or BankError where a folder is no such run. Pictures that are missing or differ raise nothing.
    """
    found = []
    for path, name in zip(runs, names_of(runs), strict=True):
        tell(f"scoring {name}")
        scored = study.score(path, reread=reread)
        tell(f"checking the pictures of {name}")
        pictures = find_pictures(scored.manifest, scored.bank, path, banks)
        found.append(estimates_of(name, scored, path / LEDGER, *pictures))
    return found


def estimates_of(
    name: str, scored: StructuredScore, ledger_path: Path, pictures: FrameBank | None, about: str
) -> Estimates:
    """Return the evidence of a scored run, whose pictures somebody has looked for."""
    with Ledger(ledger_path) as ledger:
        replies = {
            spec: {(key.frame, key.condition): reply for key, reply in ledger.replies(spec)} for spec in scored.models
        }
    return Estimates(name, scored, replies, pictures, about)


def estimators(evidence: Sequence[Estimates]) -> list[Estimator]:
    """Return every model of every run, in order."""
    several = len(evidence) > 1
    return [
        Estimator(f"{run.name} · {spec}" if several else spec, spec, run)
        for run in evidence
        for spec in run.score.models
    ]


def faults(told: Told, place: int) -> list[str]:
    """Return in words what is wrong with a model's estimate of a frame; nothing where it was not asked about."""
    reply = told.replies_to("real")[place]
    if reply is None:
        return []
    one, other = reply.action, told.estimates("mirrored")[place]
    if one is None:
        return ["no estimate"]
    truth, seen = told.frames[place].truth, bool(told.visible[place])
    checks: dict[str, Callable[[], bool]] = {
        "close is wrong": lambda: one.close != bool(told.close[place]),
        "no lead told": lambda: seen and one.gap_m is None,
        "a lead that is not there": lambda: not seen and one.gap_m is not None,
        "left is wrong": lambda: _contradicts(truth.get("left_clear"), said=one.left_clear),
        "right is wrong": lambda: _contradicts(truth.get("right_clear"), said=one.right_clear),
        "the reflection differs": lambda: (
            told.replies_to("mirrored")[place] is not None and (other is None or one.mirrored() != other)
        ),
    }
    return [name for name, holds in checks.items() if holds()]


def weight(told: Told, place: int) -> float:
    """Return how bad a model's estimate of a frame is: the sum of its faults, and its error of the gap."""
    error = gap_error_m(told, place)
    threshold = told.distances.close_m
    return sum(FAULTS[name] for name in faults(told, place)) + min((error or 0.0) / threshold, _MOST_OF_GAP)


def gap_error_m(told: Told, place: int) -> float | None:
    """Return by how much a told gap differs from that of a lead in the picture; None where nothing can be compared."""
    one = told.estimates("real")[place]
    if one is None or one.gap_m is None or not told.visible[place] or told.unit != "m":
        return None
    return abs(one.gap_m - float(told.gap_m[place]))


def action_of(told: Told, estimate: Estimate | None) -> str | None:
    """Return what the safety policy does by an estimate."""
    return None if estimate is None else estimate.act(told.distances)


def _contradicts(truth: Scalar, *, said: bool) -> bool:
    return isinstance(truth, bool) and truth != said
