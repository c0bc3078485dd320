"""``eyechart report`` writes one page that shows a run's evidence; it makes no call and changes nothing."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.options import Against, Independent, Reread
from eyechart.cli.terminal import patience, say


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
    from eyechart.studies import Reading, study_of

    require_free(out, "report")
    studies = [study_of(run, "report" if against is None else "report --against") for run in runs]
    if len({one.runs_are for one in studies}) > 1:
        told = ", ".join(f"{run} of {one.runs_are}" for run, one in zip(runs, studies, strict=True))
        raise SpecError(f"a report is about one kind of run ({told}): make one of each")
    with patience("report") as tell:
        made = studies[0].report(runs, frames or [], Reading(independent, reread, against), tell)
        write_page(made.page, out)
        if figures is not None:
            tell("files of figures")
            say(f"{len(write_figures(made.page.drawings, figures))} files of figures in {figures}")
    if tables is not None:
        say(f"{len(write_tables(made.tables, tables))} tables in {tables}")
    for line in made.lines:
        say(line)
    say(f"wrote {out}, {len(made.page.html) / 1e6:.1f} MB")
