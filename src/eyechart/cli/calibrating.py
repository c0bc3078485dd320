"""``eyechart calibrate``: the instrument tested on known answers. ``eyechart plan``: what a bank can decide."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.options import Json
from eyechart.cli.terminal import print_json, progress


def calibrate(
    replications: Annotated[int, typer.Option(min=1, help="Simulated banks of each setting.")] = 40,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything that is drawn.")] = 0,
    processes: Annotated[int, typer.Option(min=1, help="Processes; the result does not depend on it.")] = 2,
    setting: Annotated[list[str] | None, typer.Option(help="Only this setting; give it again for more.")] = None,
    json: Json = False,
) -> None:
    """Test the battery's tests and both sets of rules on simulated controllers whose answer is known.

    Prints confusion matrices, error rates, power and the share of undecided verdicts; see docs/calibration.md.
    Exit 0: all targets hold, 1: one is missed. Example: eyechart calibrate --replications 200
    """
    from eyechart.calibrate import calibrate as run
    from eyechart.calibrate.table import tables

    with progress("banks", "banks") as move:
        found = run(replications=replications, seed=seed, processes=processes, settings=setting or None, progress=move)
    if json:
        print_json(found.as_dict())
    else:
        typer.echo(tables(found))
    if found.misses():
        raise typer.Exit(1)


def plan(
    bank: Annotated[Path, typer.Argument(help="Folder of the bank.")],
    model: Annotated[list[str] | None, typer.Option(help="A model's SPEC; give it again for more models.")] = None,
    json: Json = False,
) -> None:
    """Say what a bank can and cannot decide, and what asking costs, before a call is made.

    Example: eyechart plan bank --model scripted:depth
    """
    from eyechart.frames import open_bank
    from eyechart.models import open_model
    from eyechart.studies.battery.power import power_of

    specs = list(dict.fromkeys(model or ()))
    for spec in specs:
        open_model(spec)
    found = power_of(open_bank(bank))
    if json:
        print_json({**found.as_dict(), "models": {spec: found.asked(spec) for spec in specs}})
        return
    for line in found.lines(specs):
        typer.echo(line)
