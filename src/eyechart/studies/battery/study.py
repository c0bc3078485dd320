"""The battery as a study, and what all studies of a bank's frames share."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Unpack

from eyechart.calls import DecisionReader, read_in
from eyechart.frames import read_bank_manifest
from eyechart.gate import REQUIREMENTS, Gate, Terms, hold
from eyechart.manifest import BANK, RunManifest, asked_space, read_manifest, read_run
from eyechart.models.prices import Prices
from eyechart.spaces.space import AnySpace
from eyechart.studies import (
    NO_DRIVES,
    BundledRun,
    ModelSummary,
    ReadOptions,
    RunCosts,
    S,
    Study,
    StudyReport,
    Tell,
    run_json,
)
from eyechart.studies.battery.plans import STUDY, plan_of
from eyechart.studies.battery.scores import BatteryScore, require_scorable, score, score_run, took
from eyechart.studies.battery.series import SERIES, results
from eyechart.verdicts import LABELS, Verdict, judge, words_of

if TYPE_CHECKING:
    from rich.text import Text

    from eyechart.report.charts import Drawing
    from eyechart.report.table import Table
    from eyechart.studies.battery.subjects import Evidence


class FrameStudy(Study[S]):
    """A study whose runs are calls about a bank's frames; ``names`` are its names in manifests."""

    names: ClassVar[Sequence[str]]
    refuses = NO_DRIVES

    def holds(self, folder: Path) -> bool:
        return run_json(folder).get("study") in self.names

    def manifest(self, run: Path) -> RunManifest:
        return read_manifest(run)

    def manifest_and_space(self, run: Path) -> tuple[RunManifest, AnySpace]:
        manifest = read_manifest(run)
        space = asked_space(read_bank_manifest(run / BANK), manifest.prompt, manifest.reader)
        return manifest, manifest.prompt.asks(space)

    def reader(self, run: Path) -> DecisionReader:
        space = self.manifest_and_space(run)[1]
        return plan_of(*read_run(run)).read if space.columns else read_in(space)

    def took_run(self, run: Path, prices: Prices, *, fresh: bool = False) -> RunCosts:
        return RunCosts(*took(run, prices=prices, fresh=fresh), probes=dict(read_manifest(run).probes))

    def require_scorable(self, run: Path, reading: ReadOptions) -> None:
        manifest, bank = read_run(run, reread=reading.reread)
        reader = manifest.prompt.asks(bank.manifest.action_space).reader
        manifest.require_reader(run, (reader,), reread=reading.reread)


class BatteryStudy(FrameStudy[BatteryScore]):
    """The input-ablation battery."""

    names = (STUDY,)
    runs_are = "batteries"
    requirements = REQUIREMENTS
    required = "depth"

    def score(self, folder: Path, reading: ReadOptions) -> BatteryScore:
        found = score(
            folder,
            independent=reading.independent,
            reread=reading.reread,
            fresh=reading.fresh,
            resamples=reading.resamples,
            frames=reading.frames,
        )
        return found if reading.prices is None else replace(found, accounting=took(folder, prices=reading.prices)[0])

    def verdicts(self, score: BatteryScore) -> Mapping[str, Verdict]:
        return judge(score)

    def verdict_json(self, score: BatteryScore) -> Mapping[str, object]:
        made = {spec: verdict.as_dict() for spec, verdict in self.verdicts(score).items()}
        for spec, found in made.items():
            ended = results(score.models[spec].statistics)
            if ended:
                found[SERIES] = {one.name: {"step": one.reached, "words": one.words} for one in ended}
        return {"models": made}

    def findings(self, score: BatteryScore) -> Mapping[str, ModelSummary]:
        result = {}
        for spec, one in judge(score).items():
            said = ModelSummary.of(one.calibrated, LABELS[one.calibrated.label], one.state, one.marks)
            result[spec] = replace(said, answer=one.answer)
        return result

    def printed(self, score: BatteryScore) -> "Iterator[Table | str]":
        from eyechart.report.accounts import costs_table
        from eyechart.report.table import marked
        from eyechart.studies.battery.tables import frontier_table, group_tables, judged, verdict_table

        verdicts = judge(score)
        everyone = judged(score, verdicts)
        yield from (verdict_table(everyone), *group_tables(everyone), frontier_table(everyone))
        yield from (line for spec, verdict in verdicts.items() for line in marked(spec, verdict.marks))
        yield costs_table(score.accounting, every=False)

    def brief(self, score: BatteryScore) -> "Iterator[Table | str]":
        from eyechart.report.table import marked
        from eyechart.studies.battery.tables import deciding_table, judged

        verdicts = judge(score)
        for label, model, one in judged(score, verdicts):
            yield deciding_table(label, model, one)
            yield from marked(label, one.marks)

    def verdict_printed(self, score: BatteryScore) -> "Iterator[Table | Text | str]":
        from rich.text import Text

        from eyechart.studies.battery.tables import verdicts_printed

        verdicts = judge(score)
        yield from verdicts_printed(score, verdicts)
        for part in filter(None, words_of(verdicts).split("\n\n")):
            title, *lines = part.split("\n")
            yield Text(title, style="bold")
            yield from lines

    def gate(self, score: BatteryScore, require: Sequence[str], **terms: Unpack[Terms]) -> Gate:
        return hold(score, require, **terms)

    def report(self, runs: Sequence[Path], banks: Sequence[Path], reading: ReadOptions, tell: Tell) -> StudyReport:
        from eyechart.studies.battery.subjects import read_evidence

        return _made(read_evidence(runs, banks, score=partial(self.score, reading=reading), tell=tell), tell)

    def paper(
        self, runs: Sequence[Path], banks: Sequence[Path], reading: ReadOptions, tell: Tell
    ) -> "Iterator[Table | Drawing]":
        from eyechart.report.charts import style
        from eyechart.studies.battery.figures import agreement, information
        from eyechart.studies.battery.subjects import read_evidence, subjects
        from eyechart.studies.battery.tables import paper_tables

        evidence = read_evidence(runs, banks, score=partial(self.score, reading=reading), tell=tell)
        everyone = subjects(evidence)
        yield from paper_tables(everyone)
        with style():
            yield agreement(everyone, as_paper=True).labelled("fgr:bicb")
            yield from (drawing.labelled("mi-of-frames") for drawing in information(everyone))

    def require_scorable(self, run: Path, reading: ReadOptions) -> None:
        require_scorable(
            run, *read_run(run, reread=reading.reread), independent=reading.independent, reread=reading.reread
        )

    def derive(self, run: BundledRun, reading: ReadOptions, tell: Tell) -> tuple[BatteryScore, StudyReport]:
        from eyechart.studies.battery.subjects import SHOWN, evidence_of

        resamples, independent = reading.resamples, reading.independent
        found = score_run(run.manifest, run.bank, run.ledger, resamples=resamples, independent=independent)
        return found, _made([evidence_of(run.name, found, run.ledger, run.pictures, SHOWN)], tell)


def _made(evidence: "Sequence[Evidence]", tell: Tell) -> StudyReport:
    from eyechart.report.accounts import deployment_tables
    from eyechart.studies.battery.page import make_page
    from eyechart.studies.battery.subjects import accounts_of, subjects
    from eyechart.studies.battery.tables import judged_of, tables_of

    lacking = [
        f"{run.name}: without pictures, because {run.about_pictures}; give the bank with --frames"
        for run in evidence
        if run.pictures is None
    ]
    everyone = subjects(evidence)
    tables = [*tables_of(judged_of(everyone)), *deployment_tables(accounts_of(everyone))]
    return StudyReport(make_page(evidence, tell=tell), tables, lacking)
