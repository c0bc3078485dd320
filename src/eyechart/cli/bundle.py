"""``eyechart report``, ``paper``, ``bundle`` and ``validate``."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.options import Against, Fresh, Independent, Json, PriceFile, Reread, Steps
from eyechart.cli.terminal import patience, print_json, print_line, processors, say
from eyechart.errors import SpecError


def report(
    runs: Annotated[
        list[Path], typer.Argument(help="Folders of the runs, or one folder that holds them.", metavar="RUN...")
    ],
    out: Annotated[Path, typer.Option(help="HTML file to write.")],
    frames: Annotated[list[Path] | None, typer.Option(help="The bank, if it has moved; repeat for more.")] = None,
    figures: Annotated[Path | None, typer.Option(help="Folder for the figures, each as SVG and as PDF.")] = None,
    tables: Annotated[Path | None, typer.Option(help="Folder for the tables: CSV, Markdown, LaTeX.")] = None,
    prices: PriceFile = None,
    independent: Independent = False,
    reread: Reread = False,
    against: Against = None,
    step: Steps = None,
    fresh: Fresh = False,
) -> None:
    """Write one HTML page with verdicts, figures, statistics and every reply.

    It reads runs of any kind: batteries, drives, policies, scene estimates or a whole hierarchy
    study. For scene estimates the page shows the clauses of admission and the worst frames. For a
    folder of runs it writes an index that compares models side by side and over time. The page
    needs no network.
    Example: eyechart report run --out report.html
    """
    from eyechart.destination import require_free
    from eyechart.models.prices import read_prices
    from eyechart.overview import holds_runs, make_index
    from eyechart.report.page import write_figures, write_page
    from eyechart.report.table import write_tables
    from eyechart.studies import ReadOptions, each_once, read_steps, study_of

    require_free(out, "report")
    runs = each_once(runs)
    listed = len(runs) == 1 and holds_runs(runs[0])
    of_runs = {"--frames": frames, "--figures": figures, "--against": against, "--step": step}
    if listed and (given := [name for name, value in of_runs.items() if value]):
        raise SpecError(f"an index of runs does not take {', '.join(given)}: give the runs themselves")
    studies = [] if listed else [study_of(run, "report" if against is None else "report --against") for run in runs]
    if len({study.runs_are for study in studies}) > 1:
        kinds = ", ".join(f"{run} of {study.runs_are}" for run, study in zip(runs, studies, strict=True))
        raise SpecError(f"a report needs runs of one kind ({kinds}): make one report for each kind")
    priced = None if prices is None else read_prices(prices)
    reading = ReadOptions(independent, reread, against, steps=read_steps(step, studies), fresh=fresh, prices=priced)
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
        typer.Argument(help="Runs of any kind, or a folder of them; with --guardian, votes too.", metavar="RUN..."),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write in.")],
    frames: Annotated[list[Path] | None, typer.Option(help="The bank, if it has moved; repeat for more.")] = None,
    guardian: Annotated[
        Path | None, typer.Option(help="A guardian to score on those of the given votes that did not choose it.")
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
    """Write every table and figure of the paper that the runs allow, and say what the others lack.

    Files have the paper's labels, as t-frontier.tex. Tables are CSV, Markdown and LaTeX with label
    and caption, at most one column wide; figures are SVG and PDF. Files of an earlier call that
    this one does not write are removed, unless they were changed since. costs.tex has the costs,
    latency and energy of all models, corpus.tex the calls and episodes of each study, and
    replication.tex the repeated questions.
    Example: eyechart paper run-hosted run-drives --out artefacts
    """
    from eyechart.overview import find_runs, holds_runs
    from eyechart.paper import artefacts, write
    from eyechart.studies import ReadOptions
    from eyechart.studies.prompts import may_be_study

    runs = [run for one in runs for run in (find_runs(one) if holds_runs(one) and not may_be_study(one) else [one])]
    with patience("paper") as tell:
        reading = ReadOptions(independent, reread, against)
        found = artefacts(runs, frames or [], reading, tell, guardian=guardian, prices=prices, scores=scores)
        written = write(found, out)
    if json:
        names = {what: [path.name for path in getattr(written, what)] for what in ("files", "removed", "kept")}
        print_json({**names, "missing": dict(found.missing)})
        return
    print_line(*written.lines(), *(f"missing  {label}: {why}" for label, why in found.missing.items()))


def bundle(
    run: Annotated[Path, typer.Argument(help="Folder of the run.")],
    out: Annotated[Path, typer.Option(help="ZIP file to write.")],
    frames: Annotated[Path | None, typer.Option(help="The bank, if it has moved.")] = None,
    independent: Independent = False,
    reread: Reread = False,
) -> None:
    """Pack a run, its pictures, results, tables and report into one file.

    For drives, a hierarchy or an online run it holds every episode's record and replies, and the
    source of the controllers that ship. For a prompt study it holds all cells. The same run gives
    the same bytes.
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
        typer.Option("--allow-uncompared", help="Exit 0 even if not all could be compared."),
    ] = False,
    processes: Annotated[
        int | None, typer.Option(min=1, help="Processes that drive episodes again; default: one per processor.")
    ] = None,
    sample: Annotated[
        int | None,
        typer.Option(
            min=1, help="Drive and vet again only this many episodes and worlds of each run, chosen at random."
        ),
    ] = None,
) -> None:
    """Recompute every figure of a bundle from its ledger and its bank.

    It trusts nothing that the bundle prints. It drives every episode again from its record, with
    the models' answers from the ledger. That covers only worlds and policies that ship; with other
    library versions it compares to 3 decimals and says so. The work is bounded and announced.
    Numbers agree within 1e-9 of the larger one. Printed numbers have the same digits, except for a
    tie in rounding. Positions in drawings may differ by 0.02 points.
    Exit 0: everything follows; 1: something differs, by name; 2: the file is no bundle, or is
    damaged or harmful. Exit 2 also means that not everything could be compared, as with another
    version or other drawing libraries.
    Example: eyechart validate run.zip
    """
    from eyechart.bundle import ReplayCheck
    from eyechart.bundle import validate as check

    with patience("validate") as tell:
        found = check(file, tell=tell, again=ReplayCheck(processes or processors(), sample, say))
    if json:
        print_json(found.as_dict())
    else:
        print_line(*found.lines())
    if found.differences:
        raise typer.Exit(1)
    if found.uncompared and not allow_uncompared:
        raise typer.Exit(2)
