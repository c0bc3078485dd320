"""``eyechart report`` writes one page that shows a run's evidence; it makes no call and changes nothing."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.terminal import patience, say


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
) -> None:
    """Write one self-contained HTML page with verdicts, figures, statistics and every reply.

    Of runs of scene estimates: the clauses of admission, and the worst frames with what was told of them. It needs no
    network and shows in any browser. Example: eyechart report run --out report.html
    """
    from eyechart.destination import require_free
    from eyechart.errors import SpecError
    from eyechart.report.evidence import read_evidence, subjects
    from eyechart.report.figures import write_figures
    from eyechart.report.page import make_page, write_page
    from eyechart.report.sheets import write_sheets
    from eyechart.studies import closed_loop, structured

    require_free(out, "report")
    if any(drove := [closed_loop.is_episodes(run) for run in runs]):
        if not all(drove):
            raise SpecError("a report is about batteries or about episodes: make one of each kind of run")
        _report_drives(runs, out, figures, tables)
        return
    if any(told := [structured.is_structured(run) for run in runs]):
        if not all(told):
            raise SpecError("a report is about batteries or about scene estimates: make one of each kind of run")
        _report_estimates(runs, out, frames or [], figures=figures, tables=tables, reread=reread)
        return
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


def _report_estimates(
    runs: list[Path], out: Path, banks: list[Path], *, figures: Path | None, tables: Path | None, reread: bool
) -> None:
    """Write the report of admission and structured runs."""
    from eyechart.report.estimates import estimators, read_estimates
    from eyechart.report.estimates_page import make_estimates_page
    from eyechart.report.estimates_sheets import write_estimates_sheets
    from eyechart.report.figures import write_figures
    from eyechart.report.page import write_page

    with patience("report") as tell:
        evidence = read_estimates(runs, banks, reread=reread, tell=tell)
        page = make_estimates_page(evidence, tell=tell)
        write_page(page, out)
    if figures is not None:
        say(f"{len(write_figures(page.drawings, figures))} files of figures in {figures}")
    if tables is not None:
        say(f"{len(write_estimates_sheets(estimators(evidence), tables))} tables in {tables}")
    for note in page.notes:
        say(note)
    say(f"wrote {out}, {len(page.html) / 1e6:.1f} MB")


def _report_drives(runs: list[Path], out: Path, figures: Path | None, tables: Path | None) -> None:
    """Write the report of runs of episodes."""
    from eyechart.report.drives_page import make_drives_page
    from eyechart.report.drives_sheets import write_drives_sheets
    from eyechart.report.figures import write_figures
    from eyechart.report.page import write_page
    from eyechart.studies.closed_loop import score

    with patience("report") as tell:
        tell("scoring")
        scored = score(runs)
        page = make_drives_page(runs, scored, tell=tell)
        write_page(page, out)
    if figures is not None:
        say(f"{len(write_figures(page.drawings, figures))} files of figures in {figures}")
    if tables is not None:
        say(f"{len(write_drives_sheets(scored, tables))} tables in {tables}")
    for note in page.notes:
        say(note)
    say(f"wrote {out}, {len(page.html) / 1e6:.1f} MB")
