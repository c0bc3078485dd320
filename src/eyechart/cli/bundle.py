"""``eyechart report`` shows a run's evidence on a page; ``bundle`` packs it, ``validate`` recomputes what it says."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.options import Against, Independent, Json, PriceFile, Reread, Steps, read_steps
from eyechart.cli.terminal import patience, print_json, print_line, processors, say
from eyechart.errors import SpecError

_SHOWN = 40


def report(
    runs: Annotated[
        list[Path], typer.Argument(help="Folders of the runs, or one folder that holds them.", metavar="RUN...")
    ],
    out: Annotated[Path, typer.Option(help="HTML file to write.")],
    frames: Annotated[list[Path] | None, typer.Option(help="The bank, if it has moved; again for another.")] = None,
    figures: Annotated[Path | None, typer.Option(help="Folder for each figure as SVG and PDF.")] = None,
    tables: Annotated[Path | None, typer.Option(help="Folder for the tables: CSV, Markdown, LaTeX.")] = None,
    prices: PriceFile = None,
    independent: Independent = False,
    reread: Reread = False,
    against: Against = None,
    step: Steps = None,
) -> None:
    """Write one self-contained HTML page with verdicts, figures, statistics and every reply.

    Of batteries, of episodes, of a whole study of the hierarchy, or of scene estimates: the clauses of admission and
    the worst frames with what was told of them. It needs no network and shows in any browser. Of a folder that holds
    runs of any kinds: an index of them, models side by side, and each model over time.
    Example: eyechart report run --out report.html
    """
    from eyechart.destination import require_free
    from eyechart.models.prices import read_prices
    from eyechart.overview import holds_runs, make_index
    from eyechart.report.page import write_figures, write_page
    from eyechart.report.table import write_tables
    from eyechart.studies import Reading, each_once, study_of

    require_free(out, "report")
    runs = each_once(runs)
    listed = len(runs) == 1 and holds_runs(runs[0])
    of_runs = {"--frames": frames, "--figures": figures, "--against": against, "--step": step}
    if listed and (given := [name for name, value in of_runs.items() if value]):
        raise SpecError(f"an index of runs takes no {', '.join(given)}: give the runs themselves")
    studies = [] if listed else [study_of(run, "report" if against is None else "report --against") for run in runs]
    if len({one.runs_are for one in studies}) > 1:
        told = ", ".join(f"{run} of {one.runs_are}" for run, one in zip(runs, studies, strict=True))
        raise SpecError(f"a report is about one kind of run ({told}): make one of each")
    priced = None if prices is None else read_prices(prices)
    reading = Reading(independent, reread, against, steps=read_steps(step, studies), prices=priced)
    with patience("report") as tell:
        if studies:
            made = studies[0].report(runs, frames or [], reading, tell)
        else:
            made = make_index(runs[0], reading, tell, out)
        write_page(made.page, out)
        if figures is not None:
            tell("files of figures")
            say(f"{len(write_figures(made.page.drawings, figures))} files of figures in {figures}")
    if tables is not None:
        say(f"{len(write_tables(made.tables, tables))} tables in {tables}")
    say(*made.lines)
    say(f"wrote {out}, {len(made.page.html) / 1e6:.1f} MB")


def paper(
    runs: Annotated[
        list[Path],
        typer.Argument(help="Runs of any kinds, or a folder of them; with --guardian, votes too.", metavar="RUN..."),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write in.")],
    frames: Annotated[list[Path] | None, typer.Option(help="The bank, if it has moved; again for another.")] = None,
    guardian: Annotated[
        Path | None, typer.Option(help="A guardian, scored on the votes given that did not choose it.")
    ] = None,
    scores: Annotated[
        Path | None, typer.Option(help="CSV file with the columns model and score, to correlate with grounding.")
    ] = None,
    prices: PriceFile = None,
    independent: Independent = False,
    reread: Reread = False,
    against: Against = None,
    json: Json = False,
) -> None:
    """Write every table and figure of the paper that runs determine, and say what is missing for the others.

    Files are named by the paper's labels, as t-frontier.tex: tables in CSV, Markdown and LaTeX (with label and caption,
    no wider than a column), figures in SVG and PDF. What an earlier call wrote there, and this one does not, is
    removed where nobody changed it. Costs, latency and energy of all models stand in costs.tex, calls and
    episodes by study in corpus.tex, and what was asked twice in replication.tex.
    Example: eyechart paper run-hosted run-drives --out artefacts
    """
    from eyechart.overview import find_runs, holds_runs
    from eyechart.paper import artefacts, write
    from eyechart.studies import Reading
    from eyechart.studies.prompts import may_be_study

    several = {one for one in runs if holds_runs(one) and not may_be_study(one)}
    runs = [run for one in runs for run in (find_runs(one) if one in several else [one])]
    with patience("paper") as tell:
        reading = Reading(independent, reread, against)
        found = artefacts(runs, frames or [], reading, tell, guardian=guardian, prices=prices, scores=scores)
        written = write(found, out)
    if json:
        names = {what: [path.name for path in getattr(written, what)] for what in ("files", "removed", "kept")}
        print_json({**names, "missing": dict(found.missing)})
        return
    for path in written.files:
        print_line(f"wrote    {path}")
    for path in written.removed:
        print_line(f"removed  {path}: of an earlier call, and nothing of these runs")
    for path in written.kept:
        print_line(f"kept     {path}: of an earlier call, and changed since")
    for label, why in found.missing.items():
        print_line(f"missing  {label}: {why}")


def bundle(
    run: Annotated[Path, typer.Argument(help="Folder of the run.")],
    out: Annotated[Path, typer.Option(help="ZIP file to write.")],
    frames: Annotated[Path | None, typer.Option(help="The bank, if it has moved.")] = None,
    independent: Independent = False,
    reread: Reread = False,
) -> None:
    """Pack a run, the pictures that it used, its results, tables and report into one file.

    Of drives, of a hierarchy and of an online run: every episode's record, its replies, and the source of the
    controllers that ship; of a prompt study: all its cells. The same run gives the same bytes.
    Example: eyechart bundle run --out run.zip
    """
    from eyechart.bundle import write_bundle
    from eyechart.studies import study_of

    study_of(run, "bundle")
    with patience("bundle") as tell:
        count = write_bundle(
            run, out, banks=() if frames is None else (frames,), independent=independent, reread=reread, tell=tell
        )
    say(f"wrote {out}: {count} files, {out.stat().st_size / 1e6:.1f} MB; 'eyechart validate {out}' recomputes it")


def validate(
    file: Annotated[Path, typer.Argument(help="A bundle.")],
    json: Annotated[bool, typer.Option("--json", help="Print JSON, with every difference.")] = False,
    allow_uncompared: Annotated[
        bool,
        typer.Option("--allow-uncompared", help="Exit 0 too where not all could be compared."),
    ] = False,
    processes: Annotated[
        int | None, typer.Option(min=1, help="Processes that drive episodes again; default: one a processor.")
    ] = None,
    sample: Annotated[
        int | None,
        typer.Option(min=1, help="Drive, and vet, only so many episodes and worlds of each run again, by chance."),
    ] = None,
) -> None:
    """Recompute every figure of a bundle from its ledger and its bank, without trusting what it prints.

    Every episode in it is driven again from its record, models answered by the ledger: in worlds and by policies that
    ship alone, and with other versions only to 3 decimals, which is said. The work is bounded, and said beforehand.
    Exit 0: everything follows; 1: something differs, by name; 2: no bundle, damaged, harmful, or of another version or
    drawn with other libraries, so that not all could be compared, which is said. Numbers are the same within 1e-9 of
    the larger of them; a printed number must have the same digits, but for a tie of rounding; places in drawings may be
    0.02 points apart. Example: eyechart validate run.zip
    """
    from eyechart.bundle import Again
    from eyechart.bundle import validate as check

    with patience("validate") as tell:
        found = check(file, tell=tell, again=Again(processes or processors(), sample, say))
    if json:
        print_json(found.as_dict())
    else:
        for one in found.differences[:_SHOWN]:
            print_line(f"differs: {one}")
        if len(found.differences) > _SHOWN:
            print_line(f"and {len(found.differences) - _SHOWN} more differences (--json prints all)")
        for one in found.otherwise[:_SHOWN]:
            print_line(f"computed otherwise here: {one}")
        for note in found.notes:
            print_line(f"note: {note}")
        compared = ", ".join(f"{count} {name}" for name, count in found.compared.items())
        print_line(f"{found.outcome}: {compared}")
    if found.differences:
        raise typer.Exit(1)
    if found.uncompared and not allow_uncompared:
        raise typer.Exit(2)
