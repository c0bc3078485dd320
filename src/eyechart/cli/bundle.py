"""``eyechart bundle`` packs a run with what follows from it; ``eyechart validate`` recomputes all of it."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.options import Independent, Reread
from eyechart.cli.terminal import patience, print_json, say

_SHOWN = 40


def bundle(
    run: Annotated[Path, typer.Argument(help="Folder of the run.")],
    out: Annotated[Path, typer.Option(help="ZIP file to write.")],
    frames: Annotated[Path | None, typer.Option(help="The bank, if it has moved.")] = None,
    independent: Independent = False,
    reread: Reread = False,
) -> None:
    """Pack a run, the pictures that it used, its results, tables and report into one file.

    The same run gives the same bytes. Example: eyechart bundle run --out run.zip
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
) -> None:
    """Recompute every figure of a bundle from its ledger and its bank, without trusting what it prints.

    Exit 0: everything follows; 1: something differs, by name; 2: no bundle, damaged, harmful, or of another version or
    drawn with other libraries, so that not all could be compared, which is said. Numbers are the same within 1e-9 of
    the larger of them; a printed number must have the same digits, but for a tie of rounding; places in drawings may be
    0.02 points apart. Example: eyechart validate run.zip
    """
    from eyechart.bundle import validate as check

    with patience("validate") as tell:
        found = check(file, tell=tell)
    if json:
        print_json(found.as_dict())
    else:
        for one in found.differences[:_SHOWN]:
            typer.echo(f"differs: {one}")
        if len(found.differences) > _SHOWN:
            typer.echo(f"and {len(found.differences) - _SHOWN} more differences (--json prints all)")
        for one in found.otherwise[:_SHOWN]:
            typer.echo(f"computed otherwise here: {one}")
        for note in found.notes:
            typer.echo(f"note: {note}")
        compared = ", ".join(f"{count} {name}" for name, count in found.compared.items())
        typer.echo(f"{found.outcome}: {compared}")
    if found.differences:
        raise typer.Exit(1)
    if found.uncompared and not allow_uncompared:
        raise typer.Exit(2)
