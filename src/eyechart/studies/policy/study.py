"""Runs of policies as a study."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Unpack

from eyechart.channels import CAMERAS
from eyechart.gate import Gate, Terms, hold_policies
from eyechart.manifest import read_manifest
from eyechart.models.prices import Prices
from eyechart.studies import (
    NO_DRIVES,
    BundledRun,
    CheckpointSeries,
    ModelSummary,
    ReadOptions,
    RunCosts,
    StudyReport,
    Tell,
)
from eyechart.studies.battery import FrameStudy
from eyechart.studies.policy.plans import STUDY
from eyechart.studies.policy.scores import PolicyScore, judge, judged_json, require_scorable, score, score_run, took
from eyechart.verdicts.policy_verdict import REQUIREMENTS

if TYPE_CHECKING:
    from rich.text import Text

    from eyechart.report.table import Table


_OPEN = f"T.matched@{CAMERAS}"
"""The statistic shown for the cameras if none decided."""


class Policies(FrameStudy[PolicyScore]):
    """Policies: every frame with each of their channels exchanged."""

    names = (STUDY,)
    runs_are = "policies"
    callables = True
    requirements = REQUIREMENTS
    required = "camera:camera_content"
    refuses: ClassVar = NO_DRIVES

    def score(self, folder: Path, reading: ReadOptions) -> PolicyScore:
        return score(folder, reread=reading.reread)

    def took_run(self, run: Path, prices: Prices, *, fresh: bool = False) -> RunCosts:
        del fresh  # of policies and drives no columns are kept
        return RunCosts(*took(run, prices), probes=dict(read_manifest(run).probes))

    def require_scorable(self, run: Path, reading: ReadOptions) -> None:
        require_scorable(run, read_manifest(run), reread=reading.reread)

    def findings(self, score: PolicyScore) -> Mapping[str, ModelSummary]:
        from eyechart.studies.policy.tables import mark

        result = {}
        for spec, one in judge(score).items():
            said, motions = mark(one.camera.label), score.models[spec].motions
            left = motions.planned - motions.finished
            state = f"unfinished: {motions.finished} of {motions.planned} calls" if left else ""
            guards = [f"{name}: {why}" for name, why in one.guards.items()]
            by, statistics = one.camera.by or _OPEN, score.models[spec].statistics
            result[spec] = ModelSummary(said.text, said.tone, by, statistics.get(by), state, guards, one.answer)
        return result

    def printed(self, score: PolicyScore) -> "Iterator[Table | str]":
        from eyechart.report.accounts import costs_table
        from eyechart.studies.policy import tables

        verdicts = judge(score)
        yield tables.verdict_table(verdicts)
        yield tables.channel_table(verdicts)
        yield from tables.statistics_table(score).split()
        yield tables.parts_table(score)
        yield tables.steps_table(score)
        yield costs_table(score.accounting, every=False).known()

    def brief(self, score: PolicyScore) -> "Iterator[Table | str]":
        from eyechart.studies.policy import tables

        verdicts = judge(score)
        yield tables.verdict_table(verdicts)
        for spec, verdict in verdicts.items():
            yield tables.deciding_table(spec, score.models[spec].statistics, verdict)

    def verdict_json(self, score: PolicyScore) -> Mapping[str, object]:
        return {"policies": judged_json(score)}

    def verdict_printed(self, score: PolicyScore) -> "Iterator[Table | Text | str]":
        from rich.text import Text

        from eyechart.studies.policy import tables

        verdicts = judge(score)
        yield tables.verdict_table(verdicts)
        yield tables.channel_table(verdicts)
        for spec, verdict in verdicts.items():
            yield Text(spec, style="bold")
            yield from (f"  {name}: {why}" for name, why in verdict.guards.items())
            for name, judged in verdict.axes.items() if not verdict.guards else ():
                yield f"  {name}: {judged.label}. {judged.because}"
                yield from [f"    not more, because {judged.why_not}"] if judged.why_not else []
            yield from (f"  ! {remark}" for remark in verdict.remarks)
            yield f"  {verdict.scope}"

    def gate(self, score: PolicyScore, require: Sequence[str], **terms: Unpack[Terms]) -> Gate:
        left = {spec: model.motions.planned - model.motions.finished for spec, model in score.models.items()}
        return hold_policies(judge(score), require, left, score.guards, **terms)

    def course(self, scores: Sequence[PolicyScore], reading: ReadOptions) -> CheckpointSeries | None:
        from eyechart.studies.policy.training_curve import course_of

        return course_of(scores, reading.steps)

    def report(self, runs: Sequence[Path], banks: Sequence[Path], reading: ReadOptions, tell: Tell) -> StudyReport:
        from eyechart.studies.battery.subjects import find_pictures
        from eyechart.studies.policy.page import made

        found, notes = [], []
        for run in runs:
            tell(f"scoring {run.name}")
            scored = self.score(run, reading)
            pictures, about = find_pictures(scored.manifest, scored.bank, run, banks)
            notes += [] if pictures is not None else [f"{run.name}: without pictures, because {about}; give --frames"]
            found.append((scored, pictures))
        return made(found, notes, reading.steps)

    def derive(self, run: BundledRun, reading: ReadOptions, tell: Tell) -> tuple[PolicyScore, StudyReport]:
        from eyechart.studies.policy.page import made

        del reading, tell
        found = score_run(run.manifest, run.bank, run.ledger)
        return found, made([(found, run.pictures)])
