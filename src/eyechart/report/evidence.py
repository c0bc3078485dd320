"""The evidence of a run is all that a report shows: scores, verdicts, verbatim replies, and pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from eyechart.actions import Decision
from eyechart.calls import Reply
from eyechart.errors import BankError
from eyechart.frames import FrameBank, check, open_bank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.studies import battery as study
from eyechart.studies.battery import BatteryScore, ModelScore
from eyechart.verdicts import Verdict, judge

Replies = Mapping[tuple[str, str], Reply]
"""A model's replies by frame and condition."""


@dataclass(frozen=True)
class Evidence:
    """One run, scored and judged.

    ``pictures`` is None where the bank's pictures cannot be shown; ``about_pictures`` then says why, else that they
    are those that the run recorded. ``unknown`` counts each model's calls that were sent and whose outcome is not
    known.
    """

    name: str
    score: BatteryScore
    verdicts: Mapping[str, Verdict]
    replies: Mapping[str, Replies]
    unknown: Mapping[str, int]
    pictures: FrameBank | None
    about_pictures: str

    @property
    def conditions(self) -> tuple[str, ...]:
        """Return the run's conditions."""
        return self.score.manifest.conditions


@dataclass(frozen=True)
class Subject:
    """A model in a run. ``label`` names the run too where a report holds several."""

    label: str
    spec: str
    run: Evidence

    @property
    def model(self) -> ModelScore:
        """Return the model's score."""
        return self.run.score.models[self.spec]

    @property
    def verdict(self) -> Verdict:
        """Return the model's verdict."""
        return self.run.verdicts[self.spec]

    def decision(self, condition: str, frame: int) -> Decision | None:
        """Return the decision on the frame of this number, None where there is no reply."""
        given = self.model.answers.decisions.get(condition)
        return None if given is None else given[frame]


def read_evidence(runs: Sequence[Path], banks: Sequence[Path] = (), *, independent: bool = False) -> list[Evidence]:
    """Score and judge runs, and find their pictures: in one of ``banks``, or where each run's manifest says.

    Raises LedgerError or BankError where a folder is no run. Pictures that are missing or differ raise nothing.
    """
    names = _names(runs)
    return [_read_one(path, name, banks, independent=independent) for path, name in zip(runs, names, strict=True)]


def subjects(evidence: Sequence[Evidence]) -> list[Subject]:
    """Return every model of every run, in order."""
    several = len(evidence) > 1
    return [
        Subject(f"{run.name} · {spec}" if several else spec, spec, run) for run in evidence for spec in run.score.models
    ]


def _names(runs: Sequence[Path]) -> list[str]:
    """Return the runs' folder names, numbered where two are the same."""
    names = [path.resolve().name or "run" for path in runs]
    return [
        name if names.count(name) == 1 else f"{name} ({1 + names[:place].count(name)})"
        for place, name in enumerate(names)
    ]


def _read_one(path: Path, name: str, banks: Sequence[Path], *, independent: bool) -> Evidence:
    scored = study.score(path, independent=independent)
    with Ledger(path / LEDGER) as ledger:
        replies = {
            spec: {(key.frame, key.condition): reply for key, reply in ledger.replies(spec)} for spec in scored.models
        }
        unknown = [key.model for key in ledger.unknown()]
    pictures, about = _find_pictures(scored, banks)
    counts = {spec: unknown.count(spec) for spec in scored.models}
    return Evidence(name, scored, judge(scored), replies, counts, pictures, about)


def _find_pictures(scored: BatteryScore, banks: Sequence[Path]) -> tuple[FrameBank | None, str]:
    """Return the bank with the pictures that the run was made on, or None with the reason in words."""
    why = "no bank was given"
    for place in banks or (Path(scored.manifest.bank_path),):
        try:
            bank = open_bank(place)
            problem = _problem(bank, scored)
        except BankError:
            problem = f"the bank '{place.name}' is not there or cannot be opened"
        if problem is None:
            return bank, "every picture is the one that the run recorded (SHA-256), and the geometry is the same"
        why = problem
    return None, why


def _problem(bank: FrameBank, scored: BatteryScore) -> str | None:
    mine, recorded = bank.manifest, scored.bank.manifest
    if mine.fingerprint != scored.manifest.fingerprint:
        return (
            f"the bank '{bank.root.name}' has fingerprint {mine.fingerprint[:16]}, the run was made on "
            f"{scored.manifest.fingerprint[:16]}"
        )
    if mine.images != recorded.images:
        return f"the bank '{bank.root.name}' has other pictures of the same geometry than the run was made on"
    problems = check(bank.root)
    return f"the bank '{bank.root.name}' is damaged: {len(problems)} differences" if problems else None
