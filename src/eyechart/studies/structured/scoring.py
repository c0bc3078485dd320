"""Scoring a structured run: ledger and bank to estimates to figures; it only reads, and gives the same bytes always."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eyechart.costs import Account
from eyechart.errors import LedgerError
from eyechart.frames import FrameBank
from eyechart.integrity import Guard
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, RunManifest, read_run
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.scene import SCENE_READER
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery import plan_of, took_run
from eyechart.studies.structured.figures import Figures, How
from eyechart.studies.structured.planning import STUDIES
from eyechart.studies.structured.told import Told, episode_of, read_told
from eyechart.verdicts import Evidence
from eyechart.verdicts.admission import Held, hold


@dataclass(frozen=True)
class EstimatorScore:
    """One model's estimates and figures: over all frames, and over those before any collision of their episode.

    ``before`` is None where the bank does not record collisions. ``clauses`` are held against ``statistics``.
    """

    model: str
    version: str
    planned: int
    answered: int
    told: Told
    statistics: Mapping[str, Statistic]
    before: Mapping[str, Statistic] | None
    clauses: tuple[Held, ...]

    @property
    def admitted(self) -> bool:
        """Return whether every planned call is answered and every clause is met."""
        return self.answered >= self.planned and all(one.passes for one in self.clauses)

    @property
    def failed(self) -> frozenset[str]:
        """Return the names of the clauses that are not met."""
        return frozenset(one.name for one in self.clauses if not one.passes)

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        before = None if self.before is None else {name: one.as_dict() for name, one in self.before.items()}
        return {
            "version": self.version,
            "planned": self.planned,
            "answered": self.answered,
            "admitted": self.admitted,
            "clauses": [one.as_dict() for one in self.clauses],
            "unread": self.told.reasons,
            "repairs": self.told.repairs,
            "statistics": {name: one.as_dict() for name, one in self.statistics.items()},
            "before_collision": before,
        }


@dataclass(frozen=True)
class StructuredScore:
    """Everything that the ledger of an admission or a structured run says, and, apart from it, what the calls took."""

    manifest: RunManifest
    bank: FrameBank
    pairs: int
    models: Mapping[str, EstimatorScore]
    accounting: Mapping[str, Mapping[str, Account]]
    guards: Mapping[str, tuple[Guard, ...]]

    def __repr__(self) -> str:
        return f"<StructuredScore of {', '.join(self.models) or 'no model'} on {self.pairs} pairs of {self.bank.name}>"

    def evidence(self) -> dict[str, Evidence]:
        """Return what there is to hold every model to."""
        return {
            spec: Evidence(
                model=spec,
                statistics=one.statistics,
                planned=one.planned,
                answered=one.answered,
                replies={"": one.told.reasons},
                guards=self.guards[spec],
            )
            for spec, one in self.models.items()
        }

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values; what two runs may differ in (timing, attempts) is ``accounting`` and ``guards``."""
        return {
            "study": self.manifest.study,
            "bank": self.bank.name,
            "fingerprint": self.manifest.fingerprint,
            "prompt": self.manifest.prompt.key,
            "view": self.manifest.view,
            "seed": self.manifest.seed,
            "reader": SCENE_READER,
            "pairs": self.pairs,
            "frames": list(self.manifest.frames),
            "models": {spec: one.as_dict() for spec, one in self.models.items()},
            "accounting": {
                spec: {name: one.as_dict() for name, one in found.items()} for spec, found in self.accounting.items()
            },
            "guards": {spec: [one.as_dict() for one in found] for spec, found in self.guards.items()},
        }


def score(path: Path, *, resamples: int = 5000, reread: bool = False) -> StructuredScore:
    """Score the admission or structured run in a folder, finished or not.

    ``reread`` allows the replies of a run that was begun under another version of the reader to be read by today's.
    Raises LedgerError or BankError where the folder is no such run, or needs ``reread``.
    """
    manifest, bank = read_run(path)
    require_scorable(path, manifest, reread=reread)
    return score_run(manifest, bank, path / LEDGER, resamples=resamples)


def require_scorable(path: Path, manifest: RunManifest, *, reread: bool = False) -> None:
    """Raise LedgerError where a run may not be scored as was asked, see ``score``."""
    if manifest.study not in STUDIES:
        raise LedgerError(f"{path} is a run of the study '{manifest.study}', not one of {', '.join(STUDIES)}")
    if manifest.reader != SCENE_READER and not reread:
        raise LedgerError(
            f"{path} was begun under version {manifest.reader} of the reader of scenes, and this is version "
            f"{SCENE_READER}: its estimates may differ from those seen before; read its replies anew with --reread"
        )


def score_run(manifest: RunManifest, bank: FrameBank, ledger_path: Path, *, resamples: int = 5000) -> StructuredScore:
    """Score the calls in a ledger by a run's manifest and its bank, whoever vouches for these."""
    plan = plan_of(manifest, bank)
    with Ledger(ledger_path) as ledger:
        told = {spec: read_told(spec, ledger.replies(spec), bank, plan.frames) for spec in manifest.models}
    accounting, guards = took_run(manifest, bank, ledger_path)
    silent = "episode" in bank.manifest.absent and not bank.manifest.independent
    episodes = None if silent else np.array([episode_of(frame) for frame in plan.frames])
    how = How(episodes, manifest.seed, resamples)
    models = {
        spec: _scored(told[spec], how, version, sum(1 for _ in plan.keys_of(spec)))
        for spec, version in manifest.models.items()
    }
    return StructuredScore(manifest, bank, len(plan.frames), models, accounting, guards)


def _scored(told: Told, how: How, version: str, planned: int) -> EstimatorScore:
    """Score one model; the safety policy's actions are the five of driving, whatever space the bank is of."""
    every = np.ones(len(told.frames), dtype=np.bool_)
    statistics = Figures(told, DRIVING, every, how).statistics()
    return EstimatorScore(
        model=told.model,
        version=version,
        planned=planned,
        answered=told.finished,
        told=told,
        statistics=statistics,
        before=None if told.before is None else Figures(told, DRIVING, told.before, how).statistics(),
        clauses=hold(statistics),
    )
