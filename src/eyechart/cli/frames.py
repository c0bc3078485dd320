"""``eyechart frames``: build, check and show frame banks."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.terminal import print_json, progress, say

app = typer.Typer(help="Build, check and show frame banks.", no_args_is_help=True)


@app.command(epilog="Example: eyechart frames build highway --preset balanced --out bank")
def build(
    simulator: Annotated[str, typer.Argument(help="See 'eyechart list simulators'.")],
    out: Annotated[Path, typer.Option(help="Folder of the new bank.")],
    preset: Annotated[str, typer.Option(help="Which moments; see 'eyechart list simulators'.")] = "balanced",
    seeds: Annotated[str, typer.Option(help="Seeds of the episodes, with commas.")] = "0,1,2",
    steps: Annotated[int, typer.Option(help="Frames an episode.")] = 12,
) -> None:
    """Render a frame bank: scenarios × seeds × steps, with ground truth and counterfactual pictures."""
    from eyechart.simulators import open_simulator

    chosen = _seeds(seeds)
    with progress("frames", "frames") as move:
        bank = open_simulator(simulator).build(out, preset=preset, seeds=chosen, steps=steps, progress=move)
    say(f"{len(bank)} frames in {out}, fingerprint {bank.manifest.fingerprint[:16]}")


@app.command(epilog="Example: eyechart frames check bank")
def check(
    bank: Annotated[Path, typer.Argument(help="Folder of the bank.")],
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Recompute fingerprint and picture hashes; name what differs. Exit 0: as recorded, 1: something differs."""
    from eyechart.frames import check as check_bank

    problems = check_bank(bank)
    if json:
        print_json({"bank": str(bank), "ok": not problems, "problems": problems})
    elif problems:
        for problem in problems:
            say(f"eyechart: {problem}")
    else:
        say(f"{bank} is what its manifest recorded")
    if problems:
        raise typer.Exit(1)


@app.command(epilog="Example: eyechart frames show bank --out sheet.png")
def show(
    bank: Annotated[Path, typer.Argument(help="Folder of the bank.")],
    out: Annotated[Path, typer.Option(help="PNG file to write.")],
    counterfactual: Annotated[str | None, typer.Option(help="lead_near, lead_far or recoloured.")] = None,
    limit: Annotated[int | None, typer.Option(help="At most so many frames, from every episode in turn.")] = None,
) -> None:
    """Write a contact sheet: one row an episode, each frame with its gap and what it demands."""
    from dataclasses import replace

    from eyechart.frames import open_bank
    from eyechart.report.contact_sheet import contact_sheet
    from eyechart.run import spread

    opened = open_bank(bank)
    contact_sheet(replace(opened, frames=spread(opened.frames, limit)), out, counterfactual=counterfactual)
    say(f"wrote {out}")


def _seeds(text: str) -> tuple[int, ...]:
    from eyechart.errors import SpecError

    try:
        seeds = tuple(int(part) for part in text.split(","))
    except ValueError as error:
        raise SpecError(f"--seeds takes whole numbers with commas, for example 0,1,2; got '{text}'") from error
    if len(set(seeds)) != len(seeds) or min(seeds) < 0:
        raise SpecError(f"--seeds takes different numbers of 0 or more; got '{text}'")
    return seeds
