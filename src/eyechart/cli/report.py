"""``eyechart report`` writes one page that shows a run's evidence; it makes no call and changes nothing."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli.options import Against, Independent, Reread
from eyechart.cli.terminal import patience, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eyechart.report.page import Page
    from eyechart.report.table import Table
    from eyechart.studies.battery.subjects import Tell


def report(
    runs: Annotated[list[Path], typer.Argument(help="Folders of the runs.", metavar="RUN...")],
    out: Annotated[Path, typer.Option(help="HTML file to write.")],
    frames: Annotated[list[Path] | None, typer.Option(help="The bank, if it has moved; again for another.")] = None,
    figures: Annotated[Path | None, typer.Option(help="Folder for each figure as SVG and PDF.")] = None,
    tables: Annotated[Path | None, typer.Option(help="Folder for the tables: CSV, Markdown, LaTeX.")] = None,
    independent: Independent = False,
    reread: Reread = False,
    against: Against = None,
) -> None:
    """Write one self-contained HTML page with verdicts, figures, statistics and every reply.

    Of batteries, of episodes, of a whole study of the hierarchy, or of scene estimates: the clauses of admission and
    the worst frames with what was told of them. It needs no network and shows in any browser.
    Example: eyechart report run --out report.html
    """
    from eyechart.destination import require_free
    from eyechart.errors import SpecError
    from eyechart.report.page import write_figures, write_page
    from eyechart.report.table import write_tables

    require_free(out, "report")
    kind = _kind_of(runs)
    if against is not None and kind != "drives":
        raise SpecError("--against names a policy of a run of drives, and these are none")
    with patience("report") as tell:
        if kind == "hierarchy":
            made = _of_hierarchy(runs[0], tell)
        elif kind == "drives":
            made = _of_drives(runs, against, tell)
        elif kind == "estimates":
            made = _of_estimates(runs, frames or [], tell, reread=reread)
        else:
            made = _of_batteries(runs, frames or [], tell, independent=independent, reread=reread)
        write_page(made.page, out)
        if figures is not None:
            tell("files of figures")
            say(f"{len(write_figures(made.page.drawings, figures))} files of figures in {figures}")
    if tables is not None:
        say(f"{len(write_tables(made.tables, tables))} tables in {tables}")
    for line in made.lines:
        say(line)
    say(f"wrote {out}, {len(made.page.html) / 1e6:.1f} MB")


@dataclass(frozen=True)
class _Made:
    """A page, its tables, and what is to be said of it."""

    page: "Page"
    tables: "Sequence[Table]"
    lines: "Sequence[str]"


def _kind_of(runs: "Sequence[Path]") -> str:
    """Return which kind of run these are; raises SpecError where they are of several."""
    from eyechart.errors import SpecError
    from eyechart.studies import study_of
    from eyechart.studies.closed_loop import study as drives
    from eyechart.studies.hierarchy.study import Hierarchy
    from eyechart.studies.structured.study import Structured

    def kind_of(run: Path) -> str:
        match study_of(run, "report"):
            case Hierarchy():
                return "hierarchy"
            case drives.OfEpisodes():
                return "drives"
            case Structured():
                return "estimates"
        return "batteries"

    kinds = {run: kind_of(run) for run in runs}
    if len(set(kinds.values())) > 1:
        told = ", ".join(f"{run} of {kind}" for run, kind in kinds.items())
        raise SpecError(f"a report is about one kind of run ({told}): make one of each")
    kind = kinds[runs[0]]
    if kind == "hierarchy" and len(runs) > 1:
        raise SpecError("a report is about one hierarchy: make one of each study")
    return kind


def _of_batteries(
    runs: "Sequence[Path]", banks: "Sequence[Path]", tell: "Tell", *, independent: bool, reread: bool
) -> _Made:
    from eyechart.studies.battery.page import make_page
    from eyechart.studies.battery.subjects import read_evidence, subjects
    from eyechart.studies.battery.tables import judged_of, tables_of

    evidence = read_evidence(runs, banks, independent=independent, reread=reread, tell=tell)
    lacking = [
        f"{run.name}: without pictures, because {run.about_pictures}; give the bank with --frames"
        for run in evidence
        if run.pictures is None
    ]
    return _Made(make_page(evidence, tell=tell), tables_of(judged_of(subjects(evidence))), lacking)


def _of_estimates(runs: "Sequence[Path]", banks: "Sequence[Path]", tell: "Tell", *, reread: bool) -> _Made:
    from eyechart.studies.structured.estimates import estimators, read_estimates
    from eyechart.studies.structured.page import make_estimates_page
    from eyechart.studies.structured.tables import scored_of, tables_of

    evidence = read_estimates(runs, banks, reread=reread, tell=tell)
    page = make_estimates_page(evidence, tell=tell)
    return _Made(page, tables_of(scored_of(estimators(evidence))), page.notes)


def _of_drives(runs: "Sequence[Path]", against: str | None, tell: "Tell") -> _Made:
    from eyechart.studies.closed_loop import score
    from eyechart.studies.closed_loop.page import make_drives_page
    from eyechart.studies.closed_loop.tables import tables_of

    tell("scoring")
    scored = score(runs, against_policy=against)
    page = make_drives_page(runs, scored, tell=tell)
    return _Made(page, tables_of(scored), page.notes)


def _of_hierarchy(study: Path, tell: "Tell") -> _Made:
    from eyechart.studies.hierarchy import score
    from eyechart.studies.hierarchy.page import make_hierarchy_page
    from eyechart.studies.hierarchy.tables import tables_of

    tell("scoring")
    scored = score(study)
    page = make_hierarchy_page(study, scored, tell=tell)
    return _Made(page, tables_of(scored), page.notes)
