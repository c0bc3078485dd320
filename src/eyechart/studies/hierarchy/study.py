"""The hierarchy as a study."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from eyechart.errors import SpecError
from eyechart.studies import NO_DRIVES, ModelSummary, ReadOptions, StudyReport, Tell
from eyechart.studies.closed_loop import NO_LEDGER, EpisodeStudy
from eyechart.studies.hierarchy.scores import HierarchyScore, runs_of, score

if TYPE_CHECKING:
    from eyechart.report.table import Table


class Hierarchy(EpisodeStudy[HierarchyScore]):
    """Sources of intent above a controller: up to seven runs of drives in one folder."""

    runs_are = "hierarchy"
    counted = ("complete by their pictures", "planner")
    refuses: ClassVar = {**NO_LEDGER, **NO_DRIVES}

    def holds(self, folder: Path) -> bool:
        return bool(runs_of(folder))

    def runs(self, folder: Path) -> Mapping[str, Path]:
        return runs_of(folder)

    def score(self, folder: Path, reading: ReadOptions) -> HierarchyScore:
        return score(folder, resamples=reading.resamples)

    def printed(self, score: HierarchyScore) -> "Iterator[Table | str]":
        from eyechart.studies.closed_loop.tables import served_words, unfinished_words
        from eyechart.studies.hierarchy.tables import tables_of

        yield from served_words(score.served)
        yield from tables_of(score)
        if score.oracle_mirrored is not None:
            goals = score.oracle_mirrored.differences["success_rate"]
            shown = "—" if goals.value is None else f"{100 * goals.value:+.0f} points"
            yield (
                f"Positive control: the oracle's lateral intent less the same one mirrored: goals {shown}, "
                f"p {'—' if goals.p is None else f'{goals.p:.2g}'}, {score.oracle_mirrored.worlds} worlds."
            )
        yield from (*score.words, *unfinished_words(score.unfinished))

    def findings(self, score: HierarchyScore) -> Mapping[str, ModelSummary]:
        from eyechart.studies.hierarchy.visual_dependence import findings

        return findings(score)

    def paper(self, runs: Sequence[Path], banks: Sequence[Path], reading: ReadOptions, tell: Tell) -> "Iterator[Table]":
        from eyechart.studies.hierarchy.tables import paper_tables

        del banks
        yield from paper_tables(dict(self.scored(runs, reading, tell)))

    def report(self, runs: Sequence[Path], banks: Sequence[Path], reading: ReadOptions, tell: Tell) -> StudyReport:
        del banks
        if len(runs) > 1:
            raise SpecError("a report is about one hierarchy: make one report for each study")
        return self.whole(runs[0], reading, tell)[1]

    def whole(self, folder: Path, reading: ReadOptions, tell: Tell) -> tuple[HierarchyScore, StudyReport]:
        from eyechart.studies.hierarchy.page import make_hierarchy_page
        from eyechart.studies.hierarchy.tables import tables_of

        tell("scoring")
        scored = self.score(folder, reading)
        costs = [table for table in (self.deployment([folder], reading),) if table is not None]
        page = make_hierarchy_page(folder, scored, costs=costs, tell=tell)
        return scored, StudyReport(page, [*tables_of(scored), *costs], page.notes)
