"""The evidence of a run, for its report: scores, verdicts, verbatim replies, and pictures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Generic

import numpy as np

from eyechart.calls import Reply
from eyechart.costs import ALL, Account
from eyechart.errors import BankError
from eyechart.frames import Frame, FrameBank, check, open_bank
from eyechart.ledger import Ledger
from eyechart.manifest import BANK, LEDGER, RunManifest, asked_of
from eyechart.studies import Tell, names_of
from eyechart.studies.battery.plans import plan_of
from eyechart.studies.battery.scores import CallsScore, M, ModelScore
from eyechart.studies.battery.stages import widest
from eyechart.verdicts import Verdict, judge

SHOWN = "every picture is the one that the run recorded (SHA-256), and the geometry is the same"

Replies = Mapping[tuple[str, str], Reply]
"""A model's replies by frame and condition."""


@dataclass(frozen=True)
class RunEvidence(Generic[M]):
    """One scored run, with its verbatim ``replies`` by model: their text, end and error.

    ``pictures`` is None where the bank's pictures cannot be shown, and ``about_pictures`` then
    gives the reason. Otherwise it says that they are the pictures that the run recorded.
    """

    name: str
    score: CallsScore[M]
    replies: Mapping[str, Replies]
    pictures: FrameBank | None
    about_pictures: str

    @property
    def conditions(self) -> tuple[str, ...]:
        """Return the run's conditions, with the controls of any of its models."""
        return self.score.conditions

    @cached_property
    def frames(self) -> tuple[Frame, ...]:
        """Return the frames of the run."""
        return plan_of(self.score.manifest, self.score.bank).frames if self.score.models else ()

    @cached_property
    def verdicts(self) -> Mapping[str, Verdict]:
        """Return the verdict on each model."""
        return judge(self.score)


@dataclass(frozen=True)
class ModelInRun(Generic[M]):
    """A model in a run. ``label`` names the run too where a report holds several runs."""

    label: str
    spec: str
    run: RunEvidence[M]

    @property
    def model(self) -> M:
        """Return the model's score."""
        return self.run.score.models[self.spec]

    @property
    def verdict(self) -> Verdict:
        """Return the model's verdict."""
        return self.run.verdicts[self.spec]


Evidence = RunEvidence[ModelScore]
Subject = ModelInRun[ModelScore]
"""A battery, and a model in it."""


def read_evidence(
    runs: Sequence[Path],
    banks: Sequence[Path] = (),
    *,
    score: Callable[[Path], CallsScore[M]],
    tell: Tell = lambda _: None,
) -> list[RunEvidence[M]]:
    """Score runs, and find their pictures: in one of ``banks``, or at the recorded place.

    Raises LedgerError or BankError where a folder is no run. Missing or different pictures raise
    nothing.
    """
    result = []
    for path, name in zip(runs, names_of(runs), strict=True):
        tell(f"scoring {name}")
        scored = score(path)
        tell(f"checking the pictures of {name}")
        result.append(
            evidence_of(name, scored, path / LEDGER, *find_pictures(scored.manifest, scored.bank, path, banks))
        )
    return result


def evidence_of(
    name: str, scored: CallsScore[M], ledger_path: Path, pictures: FrameBank | None, about: str
) -> RunEvidence[M]:
    """Return the evidence of a scored run with its pictures, if they were found."""
    with Ledger(ledger_path) as ledger:
        replies = {
            spec: {(key.frame, key.condition): reply for key, reply in ledger.replies(spec, whole=False)}
            for spec in scored.models
        }
    return RunEvidence(name, scored, replies, pictures, about)


def used_pictures(manifest: RunManifest, bank: FrameBank) -> set[str]:
    """Return the files of the bank's pictures that the calls need, controls included."""
    plan = widest(manifest, plan_of(manifest, bank))
    shown: dict[str, set[int]] = {}
    for spec in plan.models:
        for (name, _), cells in plan.cells(spec).items():
            shown.setdefault(name, set()).update(np.flatnonzero(cells).tolist())
    return {file for name, places in shown.items() for at in places for file in plan.sources(name, plan.frames[at])}


def accounts_of(everyone: Sequence[ModelInRun[M]]) -> dict[str, Account]:
    """Return the cost of all calls of each model, by its label."""
    return {who.label: who.run.score.accounting[who.spec][ALL] for who in everyone}


def subjects(evidence: Sequence[RunEvidence[M]]) -> list[ModelInRun[M]]:
    """Return every model of every run, in order."""
    several = len(evidence) > 1
    return [
        ModelInRun(f"{run.name} · {spec}" if several else spec, spec, run)
        for run in evidence
        for spec in run.score.models
    ]


def find_pictures(
    manifest: RunManifest, run_bank: FrameBank, run: Path, banks: Sequence[Path] = ()
) -> tuple[FrameBank | None, str]:
    """Return the bank with the pictures of the run, or None with the reason in words."""
    why = "no bank was given"
    for place in banks or _usual_places(manifest, run_bank, run):
        try:
            bank = open_bank(place)
            problem = _problem(bank, manifest, run_bank)
        except BankError:
            problem = f"the bank '{place.name}' is not there or cannot be opened"
        if problem is None:
            return asked_of(bank, manifest.prompt), SHOWN
        why = problem
    return None, why


def _usual_places(manifest: RunManifest, bank: FrameBank, run: Path) -> list[Path]:
    """Return where a run's pictures may be: its own copy of the bank, and the recorded place."""
    own = run / BANK
    held = [own] if any((own / file).is_file() for file in used_pictures(manifest, bank)) else []
    return [*held, Path(manifest.bank_path)]


def _problem(bank: FrameBank, run: RunManifest, run_bank: FrameBank) -> str | None:
    mine, recorded = bank.manifest, run_bank.manifest
    if mine.fingerprint != run.fingerprint:
        return (
            f"the bank '{bank.root.name}' has fingerprint {mine.fingerprint[:16]}, the run was made on "
            f"{run.fingerprint[:16]}"
        )
    if mine.images != recorded.images:
        return f"the bank '{bank.root.name}' has other pictures of the same geometry than the run was made on"
    problems = check(bank.root, used_pictures(run, run_bank))
    return f"the bank '{bank.root.name}' is damaged: {len(problems)} differences" if problems else None
