"""``eyechart report`` writes one page that shows a run's evidence; it makes no call and changes nothing."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli.auditing import Against
from eyechart.cli.terminal import patience, say

if TYPE_CHECKING:
    from eyechart.report.page import Page


def report(
    runs: Annotated[list[Path], typer.Argument(help="Folders of the runs.", metavar="RUN...")],
    out: Annotated[Path, typer.Option(help="HTML file to write.")],
    frames: Annotated[list[Path] | None, typer.Option(help="The bank, if it has moved; again for another.")] = None,
    figures: Annotated[Path | None, typer.Option(help="Folder for each figure as SVG and PDF.")] = None,
    tables: Annotated[Path | None, typer.Option(help="Folder for the tables: CSV, Markdown, LaTeX.")] = None,
    independent: Annotated[
        bool, typer.Option("--independent", help="Declare that frames outside episodes are independent draws.")
    ] = False,
    reread: Annotated[
        bool, typer.Option("--reread", help="Read the replies of a run anew that another version of the reader read.")
    ] = False,
    against: Against = None,
) -> None:
    """Write one self-contained HTML page with verdicts, figures, statistics and every reply.

    Of a battery, of episodes, or of a whole study of the hierarchy. It needs no network and shows in any browser.
    Example: eyechart report run --out report.html
    """
    from eyechart.destination import require_free
    from eyechart.errors import SpecError
    from eyechart.report.evidence import read_evidence, subjects
    from eyechart.report.figures import write_figures
    from eyechart.report.page import make_page, write_page
    from eyechart.report.sheets import write_sheets
    from eyechart.studies import closed_loop, hierarchy

    require_free(out, "report")
    if any(studied := [hierarchy.is_hierarchy(run) for run in runs]):
        if len(studied) > 1:
            raise SpecError("a report is about one hierarchy: make one of each study")
        _report_hierarchy(runs[0], out, figures, tables)
        return
    if any(drove := [closed_loop.is_episodes(run) for run in runs]):
        if not all(drove):
            raise SpecError("a report is about batteries or about episodes: make one of each kind of run")
        _report_drives(runs, out, figures, tables, against)
        return
    if against is not None:
        raise SpecError("--against names a policy of a run of drives, and these are none")
    with patience("report") as tell:
        evidence = read_evidence(runs, frames or (), independent=independent, reread=reread, tell=tell)
        page = make_page(evidence, tell=tell)
        write_page(page, out)
        if figures is not None:
            tell("files of figures")
            say(f"{len(write_figures(page.drawings, figures))} files of figures in {figures}")
    for run in evidence:
        if run.pictures is None:
            say(f"{run.name}: without pictures, because {run.about_pictures}; give the bank with --frames")
    if tables is not None:
        say(f"{len(write_sheets(subjects(evidence), tables))} tables in {tables}")
    say(f"wrote {out}, {len(page.html) / 1e6:.1f} MB")


def _report_drives(runs: list[Path], out: Path, figures: Path | None, tables: Path | None, against: str | None) -> None:
    """Write the report of runs of episodes."""
    from eyechart.report.drives_page import make_drives_page
    from eyechart.report.drives_sheets import write_drives_sheets
    from eyechart.report.figures import write_figures
    from eyechart.report.page import write_page
    from eyechart.studies.closed_loop import score

    with patience("report") as tell:
        tell("scoring")
        scored = score(runs, against_policy=against)
        page = make_drives_page(runs, scored, tell=tell)
        write_page(page, out)
    if figures is not None:
        say(f"{len(write_figures(page.drawings, figures))} files of figures in {figures}")
    if tables is not None:
        say(f"{len(write_drives_sheets(scored, tables))} tables in {tables}")
    _told(page, out)


def _report_hierarchy(study: Path, out: Path, figures: Path | None, tables: Path | None) -> None:
    """Write the report of a study of the hierarchy."""
    from eyechart.report.figures import write_figures
    from eyechart.report.hierarchy_page import make_hierarchy_page
    from eyechart.report.hierarchy_sheets import write_hierarchy_sheets
    from eyechart.report.page import write_page
    from eyechart.studies.hierarchy import score

    with patience("report") as tell:
        tell("scoring")
        scored = score(study)
        page = make_hierarchy_page(study, scored, tell=tell)
        write_page(page, out)
    if figures is not None:
        say(f"{len(write_figures(page.drawings, figures))} files of figures in {figures}")
    if tables is not None:
        say(f"{len(write_hierarchy_sheets(scored, tables))} tables in {tables}")
    _told(page, out)


def _told(page: "Page", out: Path) -> None:
    for note in page.notes:
        say(note)
    say(f"wrote {out}, {len(page.html) / 1e6:.1f} MB")
