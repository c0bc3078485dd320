"""Admission and structured runs, and the online run, as studies."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Unpack

from eyechart.gate import ADMISSION, ONLINE, Gate, Terms, hold_admission, hold_online
from eyechart.integrity import unfinished
from eyechart.manifest import read_manifest
from eyechart.stats.statistic import Statistic
from eyechart.studies import NO_DRIVES, BundledRun, ModelSummary, ReadOptions, StudyReport, Tell
from eyechart.studies.battery import FrameStudy
from eyechart.studies.closed_loop import NO_LEDGER, EpisodeStudy
from eyechart.studies.structured import online
from eyechart.studies.structured.online import VETTING
from eyechart.studies.structured.plans import STUDIES
from eyechart.studies.structured.scores import StructuredScore, require_scorable, score, score_run
from eyechart.verdicts import Ruling
from eyechart.verdicts.admission import ADMITS
from eyechart.verdicts.labels import ADMITTED

if TYPE_CHECKING:
    from eyechart.report.charts import Drawing
    from eyechart.report.table import Table
    from eyechart.studies.closed_loop.page import StudyIntroduction
    from eyechart.studies.structured.tables import Estimates

_UNSAID = "admission_cannot_be_said"
_NO_VERDICT = "is a run of scene estimates, which has clauses and no verdict: use 'eyechart score' or 'eyechart gate'"


class StructuredStudy(FrameStudy[StructuredScore]):
    """Scene estimates of frames and of their reflections."""

    names = STUDIES
    runs_are = "estimates"
    counted = ("admitted", "estimator")
    requirements = ADMISSION
    required = "admission"
    refuses: ClassVar = {**NO_DRIVES, **dict.fromkeys(("verdict", "compare"), _NO_VERDICT)}

    def score(self, folder: Path, reading: ReadOptions) -> StructuredScore:
        result = score(folder, reread=reading.reread)
        if reading.prices is None:
            return result
        return replace(result, accounting=self.took_run(folder, reading.prices).accounts)

    def findings(self, score: StructuredScore) -> Mapping[str, ModelSummary]:
        result = {}
        for spec, model in score.models.items():
            state = unfinished(model.answered, model.planned)
            result[spec] = _finding(model.statistics, state, score.marks(spec))
        return result

    def printed(self, score: StructuredScore) -> "Iterator[Table | str]":
        from eyechart.report.table import marked
        from eyechart.studies.structured import tables

        everyone = [(spec, model, score.marks(spec)) for spec, model in score.models.items()]
        yield tables.controller_table(everyone)
        yield from (line for spec in score.models for line in marked(spec, score.marks(spec)))
        for table in tables.clauses_table(everyone).split():
            yield table
            yield from tables.reading_words(score.models[table.caption])
        yield from tables.figures_table(everyone).split()

    def gate(self, score: StructuredScore, require: Sequence[str], **terms: Unpack[Terms]) -> Gate:
        return hold_admission(score, require, **terms)

    def report(self, runs: Sequence[Path], banks: Sequence[Path], reading: ReadOptions, tell: Tell) -> StudyReport:
        from eyechart.studies.battery.subjects import read_evidence

        return _made(read_evidence(runs, banks, score=partial(self.score, reading=reading), tell=tell), tell)

    def paper(
        self, runs: Sequence[Path], banks: Sequence[Path], reading: ReadOptions, tell: Tell
    ) -> "Iterator[Table | Drawing]":
        from eyechart.studies.battery.subjects import read_evidence
        from eyechart.studies.structured.page import interface
        from eyechart.studies.structured.tables import paper_tables

        evidence = read_evidence(runs, banks, score=partial(self.score, reading=reading), tell=tell)
        yield from paper_tables({one.name: one.score for one in evidence})
        yield from interface(evidence)

    def require_scorable(self, run: Path, reading: ReadOptions) -> None:
        require_scorable(run, read_manifest(run), reread=reading.reread)

    def derive(self, run: BundledRun, reading: ReadOptions, tell: Tell) -> tuple[StructuredScore, StudyReport]:
        del reading  # nothing is drawn at random
        from eyechart.studies.battery.subjects import SHOWN, evidence_of

        found = score_run(run.manifest, run.bank, run.ledger)
        return found, _made([evidence_of(run.name, found, run.ledger, run.pictures, SHOWN)], tell)


def _finding(statistics: Mapping[str, Statistic], state: str, marks: Sequence[str] = ()) -> ModelSummary:
    """Return whether an estimator is admitted, with its first failed clause; or cannot say."""
    ruling = ADMITS.evaluate(statistics) if statistics else Ruling(_UNSAID, "", "the drives have no frame")
    ruling = replace(ruling, label=_UNSAID) if state else ruling
    return ModelSummary.of(ruling, ADMITTED[ruling.label], state, marks)


def _made(evidence: "Sequence[Estimates]", tell: Tell) -> StudyReport:
    from eyechart.report.accounts import deployment_tables
    from eyechart.studies.battery.subjects import accounts_of, subjects
    from eyechart.studies.structured.page import make_estimates_page
    from eyechart.studies.structured.tables import scored_of, tables_of

    page = make_estimates_page(evidence, tell=tell)
    everyone = subjects(evidence)
    return StudyReport(page, [*tables_of(scored_of(everyone)), *deployment_tables(accounts_of(everyone))], page.notes)


class OnlineStudy(EpisodeStudy[online.OnlineScore]):
    """Estimators that drive through the safety policy; a report shows their drives."""

    refuses: ClassVar = {
        **{name: why for name, why in NO_LEDGER.items() if name != "gate"},
        "score --against": NO_DRIVES["score --against"],
    }
    counted = ("admitted", "estimator")
    requirements = ONLINE
    required = "admission"

    def holds(self, folder: Path) -> bool:
        return (folder / VETTING).is_file()

    def score(self, folder: Path, reading: ReadOptions) -> online.OnlineScore:
        del reading
        return online.score(folder)

    def gate(self, score: online.OnlineScore, require: Sequence[str], **terms: Unpack[Terms]) -> Gate:
        return hold_online(score, require, **terms)

    def findings(self, score: online.OnlineScore) -> Mapping[str, ModelSummary]:
        result = {}
        for spec in score.manifest.models:
            seen, why = score.frames(spec)
            state = unfinished(*score.left(spec), "episodes") or ("" if seen else why)
            result[spec] = _finding(score.driven[spec].statistics, state)
        return result

    def whole(self, folder: Path, reading: ReadOptions, tell: Tell) -> tuple[online.OnlineScore, StudyReport]:
        return online.score(folder), self.report([folder], [], reading, tell)

    def first(self, runs: Sequence[Path]) -> "StudyIntroduction | None":
        from eyechart.studies.structured.page import first_of

        if not all(map(self.holds, runs)):
            return None
        return first_of({run.resolve().name: online.score(run) for run in runs})

    def paper(self, runs: Sequence[Path], banks: Sequence[Path], reading: ReadOptions, tell: Tell) -> "Iterator[Table]":
        from eyechart.studies.structured.tables import crashes_table

        del banks
        yield crashes_table(dict(self.scored(runs, reading, tell)))

    def printed(self, score: online.OnlineScore) -> "Iterator[Table | str]":
        from eyechart.studies.closed_loop.tables import served_words
        from eyechart.studies.structured.tables import met_table, online_table

        yield from served_words(score.served)
        yield online_table(score)
        yield met_table(score)
        yield from (f"{spec}: {score.frames(spec)[1]}" for spec in score.manifest.models)
        yield from (
            f"refused: {check.scenario}/{check.seed}: {check.why}" for check in score.vetted if check.why is not None
        )
