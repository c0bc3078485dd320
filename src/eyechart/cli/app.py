"""The tree of commands."""

from typing import Annotated

import typer

from eyechart import __version__
from eyechart.cli import (
    auditing,
    bundling,
    calibrating,
    comparing,
    demo,
    driving,
    frames,
    guarding,
    intending,
    listing,
    probing,
    prompting,
    reporting,
    results,
    running,
    scenes,
    serving,
)

app = typer.Typer(
    name="eyechart",
    help="Find out whether a vision-language controller's decisions come from its camera.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    epilog="Start with 'eyechart demo'. Bad input prints one line and exits 2; --debug shows where it arose.",
)
app.command()(probing.doctor)
app.command()(probing.probe)
app.add_typer(frames.app, name="frames")
running.app.command()(prompting.prompts)
running.app.command()(driving.closed_loop)
running.app.command()(intending.hierarchy)
running.app.command()(scenes.admission)
running.app.command()(scenes.structured)
running.app.command()(scenes.online)
app.add_typer(running.app, name="run")
app.add_typer(listing.app, name="list")
app.command()(demo.demo)
app.command()(running.merge)
app.command()(results.score)
app.command()(results.verdict)
app.command()(results.costs)
app.command()(results.gate)
app.command()(comparing.compare)
app.command()(comparing.transfer)
app.command()(calibrating.plan)
app.command()(calibrating.calibrate)
app.add_typer(guarding.app, name="guardian")
app.command()(serving.serve)
app.command()(reporting.report)
app.command()(auditing.ladder)
app.command()(auditing.audit)
app.command()(auditing.film)
app.command()(bundling.bundle)
app.command()(bundling.validate)


def _version(value: bool) -> None:
    if value:
        typer.echo(f"eyechart {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print it.")] = False,
) -> None:
    del version
