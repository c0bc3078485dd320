"""Scoring a run: ledger and bank to decisions to statistics; it only reads, and gives the same bytes every time."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from eyechart.costs import Account, accounts
from eyechart.errors import LedgerError, SpecError
from eyechart.frames import FrameBank
from eyechart.integrity import Guard, guards
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, RunManifest, read_run
from eyechart.models.prices import Prices, read_prices
from eyechart.reader import READER
from eyechart.run import Plan
from eyechart.stats.resampling import holm
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.answers import Answers, read_answers
from eyechart.studies.battery.calibrated import Calibrated
from eyechart.studies.battery.planning import plan_of
from eyechart.studies.battery.published import Published, Resampling

Took = tuple[dict[str, dict[str, Account]], dict[str, tuple[Guard, ...]]]
"""By model: accounts by condition, and guards."""

HOLM = ("cramers_v", "cramers_v.decision", "obstacle", "mutual_information", "mutual_information.decision")
"""The tests whose p is corrected over the models of a run (Holm 1979)."""


@dataclass(frozen=True)
class ModelScore:
    """One model's decisions and statistics. ``holm`` maps a test to its p corrected over the run's models.

    ``planned`` and ``answered`` count calls; a verdict on fewer than planned says so.
    """

    model: str
    version: str
    planned: int
    answered: int
    answers: Answers
    statistics: Mapping[str, Statistic]
    holm: Mapping[str, float | None]


@dataclass(frozen=True)
class BatteryScore:
    """Everything that the ledger of one battery says, and, apart from it, what the calls took."""

    manifest: RunManifest
    bank: FrameBank
    models: Mapping[str, ModelScore]
    accounting: Mapping[str, Mapping[str, Account]]
    guards: Mapping[str, tuple[Guard, ...]]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values; what two runs may differ in (timing, attempts) is ``accounting`` and ``guards``."""
        return {
            "study": self.manifest.study,
            "bank": self.bank.name,
            "fingerprint": self.manifest.fingerprint,
            "prompt": self.manifest.prompt.key,
            "seed": self.manifest.seed,
            "reader": READER,
            "models": {
                spec: {
                    "version": score.version,
                    "planned": score.planned,
                    "answered": score.answered,
                    "statistics": {name: value.as_dict() for name, value in score.statistics.items()},
                    "holm": dict(score.holm),
                }
                for spec, score in self.models.items()
            },
            "accounting": {
                spec: {name: one.as_dict() for name, one in found.items()} for spec, found in self.accounting.items()
            },
            "guards": {spec: [one.as_dict() for one in found] for spec, found in self.guards.items()},
        }


def score(
    path: Path,
    *,
    resamples: int = 5000,
    independent: bool = False,
    reread: bool = False,
    prices: Prices | None = None,
) -> BatteryScore:
    """Score the battery in a run's folder, finished or not.

    ``independent`` declares that frames outside episodes are independent draws, as a bank's manifest may. ``reread``
    allows the replies of a run that was begun under another version of the reader to be read by today's; ``prices``
    are those of the package by default. Raises
    LedgerError or BankError where the folder is no run, or needs ``reread``, and SpecError where independence is
    declared of a bank with episodes.
    """
    manifest, bank = read_run(path)
    if manifest.reader != READER and not reread:
        raise LedgerError(
            f"{path} was begun under version {manifest.reader} of the reader of replies, and this is version {READER}: "
            "its decisions may differ from those seen before; read its replies anew with --reread"
        )
    if (
        independent
        and max(Counter(frame.episode for frame in bank).values()) > 1
        and "episode" not in bank.manifest.absent
    ):
        raise SpecError(
            f"{path}: the frames of an episode are not independent draws, and this bank records episodes; "
            "leave out --independent"
        )
    independent = independent or bank.manifest.independent
    how = Resampling(resamples=resamples, seed=manifest.seed)
    plan, told = plan_of(manifest, bank), bool(manifest.prompt.fields)
    with Ledger(path / LEDGER) as ledger:
        answers = {
            spec: read_answers(spec, ledger.replies(spec), bank, plan.frames, independent=independent, told=told)
            for spec in manifest.models
        }
        spent, kept = _took(ledger, manifest, plan, prices or read_prices())
    statistics = {spec: statistics_of(one, how, independent=independent) for spec, one in answers.items()}
    corrected = _corrected(statistics)
    models = {
        spec: ModelScore(
            model=spec,
            version=version,
            planned=sum(1 for _ in plan.keys_of(spec)),
            answered=answers[spec].finished,
            answers=answers[spec],
            statistics=statistics[spec],
            holm=corrected[spec],
        )
        for spec, version in manifest.models.items()
    }
    return BatteryScore(manifest, bank, models, spent, kept)


def took(path: Path, *, prices: Prices | None = None) -> Took:
    """Return what every model's calls took, and whether the guards hold, without the statistics."""
    manifest, bank = read_run(path)
    with Ledger(path / LEDGER) as ledger:
        return _took(ledger, manifest, plan_of(manifest, bank), prices or read_prices())


def _took(ledger: Ledger, manifest: RunManifest, plan: Plan, prices: Prices) -> Took:
    spent: dict[str, dict[str, Account]] = {}
    kept: dict[str, tuple[Guard, ...]] = {}
    for spec in manifest.models:
        sent, mode = list(ledger.attempts(spec)), manifest.mode(spec)
        spent[spec] = accounts(sent, mode, plan.bank.manifest.action_space, prices)
        kept[spec] = guards(sent, list(plan.keys_of(spec)), mode, manifest.fingerprint)
    return spent, kept


def statistics_of(answers: Answers, how: Resampling, *, independent: bool = False) -> dict[str, Statistic]:
    """Return the paper's statistics and the calibrated tests of one model's answers, by name."""
    return Published(answers, how).statistics() | Calibrated(answers, how, independent).statistics()


def _corrected(statistics: Mapping[str, Mapping[str, Statistic]]) -> dict[str, dict[str, float | None]]:
    """Correct each test over the models; a constant model enters with p = 1."""
    by_model: dict[str, dict[str, float | None]] = {spec: {} for spec in statistics}
    for test in HOLM:
        corrected = holm([found[test].p for found in statistics.values()])
        for spec, p in zip(statistics, corrected, strict=True):
            by_model[spec][test] = p
    return by_model
