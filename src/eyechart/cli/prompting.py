"""``eyechart run prompts`` asks the same frames under several prompts; ``eyechart score`` prints its table."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.terminal import progress, resumable, say


def prompts(
    model: Annotated[list[str], typer.Option(help="A model's SPEC; give it again for more models.")],
    frames: Annotated[Path, typer.Option(help="Folder of the frame bank.")],
    out: Annotated[Path, typer.Option(help="Folder of the study, one run a cell; the same one resumes it.")],
    prompt: Annotated[
        list[str] | None, typer.Option(help="A prompt's name or FILE.toml; again for more. Default: the six built-in.")
    ] = None,
    budget: Annotated[list[int] | None, typer.Option(min=1, help="Tokens of a reply; again to compare.")] = None,
    structured: Annotated[
        list[str] | None, typer.Option(help="none, json_object or json_schema; again to compare them.")
    ] = None,
    conditions: Annotated[str, typer.Option(help="With commas; 'all' for a whole battery a cell.")] = "real,blank",
    limit: Annotated[int, typer.Option(min=1, help="Frames a cell, the same in each.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of stimuli, sampling and the order of calls.")] = 0,
    concurrency: Annotated[int, typer.Option(min=1, help="Calls under way at once, a model.")] = 8,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan and make no call.")] = False,
) -> None:
    """Run the prompt study: diversity, and beside it the scene dependence that diversity is not (Table t:prompts).

    Example: eyechart run prompts --model scripted:depth --frames bank --out prompts --prompt baseline --prompt minimal
    """
    from itertools import product

    from eyechart.modes import STRUCTURED
    from eyechart.prompts import PROMPTS
    from eyechart.studies import prompts as study

    for one in structured or ():
        if one not in STRUCTURED:
            raise typer.BadParameter(f"{one!r} is none of {', '.join(STRUCTURED)}", param_hint="--structured")
    planned = study.plan(
        frames,
        model,
        out,
        prompts=prompt or tuple(PROMPTS),
        factors=[study.Factor(*setting) for setting in product(budget or (None,), structured or (None,))],
        conditions=() if conditions == "all" else [name.strip() for name in conditions.split(",")],
        limit=limit,
        seed=seed,
    )
    calls, finished, unknown = planned.counts()
    models = len(dict.fromkeys(model))
    say(
        f"{len(planned.cells)} cells × {models} models: {calls} calls, {finished} finished, "
        f"{unknown} sent with unknown outcome, {calls - finished} to make"
    )
    if dry_run:
        return
    with resumable(), progress("calls", "calls") as move:
        study.run(planned, concurrency=concurrency, progress=move)
    if left := calls - planned.counts()[1]:
        say(f"{left} calls are unfinished: their last error may pass, and the same command tries them again")
        raise typer.Exit(1)
    say(f"done: 'eyechart score {out}' prints the table, 'eyechart score {out}/CELL' every statistic of a cell")
