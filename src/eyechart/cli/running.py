"""``eyechart run`` makes calls and only appends; ``eyechart merge`` joins shards."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.terminal import progress, resumable, say

app = typer.Typer(help="Run a study: make its calls and append them to a ledger.", no_args_is_help=True)


@app.command(epilog="Example: eyechart run battery --model scripted:depth --frames bank --out run")
def battery(
    model: Annotated[list[str], typer.Option(help="A model's SPEC; give it again for more models.")],
    frames: Annotated[Path, typer.Option(help="Folder of the frame bank.")],
    out: Annotated[Path, typer.Option(help="Folder of the run; the same one resumes it.")],
    prompt: Annotated[
        str | None,
        typer.Option(help="A name of 'eyechart list prompts', or FILE.toml; default: one that suits the bank."),
    ] = None,
    conditions: Annotated[str | None, typer.Option(help="With commas; default: all that the bank has.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of stimuli, sampling and the order of calls.")] = 0,
    limit: Annotated[int | None, typer.Option(help="So many frames, from every episode in turn.")] = None,
    shard: Annotated[str | None, typer.Option(help="i/n: make only these calls; join with 'merge'.")] = None,
    concurrency: Annotated[int, typer.Option(min=1, help="Calls under way at once, a model.")] = 8,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan and make no call.")] = False,
) -> None:
    """Run the input-ablation battery. Interrupt it at will: the same command goes on where it stopped."""
    from eyechart.run import read_shard
    from eyechart.studies import battery as study

    planned = study.plan(
        frames,
        model,
        out,
        prompt=prompt,
        conditions=None if conditions is None else [name.strip() for name in conditions.split(",")],
        seed=seed,
        limit=limit,
        shard=None if shard is None else read_shard(shard),
    )
    for name, why in planned.left_out.items():
        say(f"left out: {name}, because {why}")
    calls, finished, unknown = planned.counts()
    plan = planned.plan
    say(
        f"{len(plan.models)} models × {len(plan.frames)} frames × {len(plan.conditions)} conditions: {calls} calls, "
        f"{finished} finished, {unknown} sent with unknown outcome, {calls - finished} to make"
    )
    if dry_run:
        return
    with resumable(), progress("calls", "calls") as move:
        study.run(planned, concurrency=concurrency, progress=move)
    if left := calls - planned.counts()[1]:
        say(f"{left} calls are unfinished: their last error may pass, and the same command tries them again")
        raise typer.Exit(1)
    say(f"done: 'eyechart verdict {out}' judges, 'eyechart score {out}' prints every statistic")


def merge(
    shards: Annotated[list[Path], typer.Argument(help="Folders of the shards.")],
    out: Annotated[Path, typer.Option(help="Folder of the merged run.")],
) -> None:
    """Merge the shards of one run into a new run. Example: eyechart merge run-1 run-2 --out run."""
    from eyechart.studies import battery as study

    calls = study.merge(shards, out)
    say(f"{calls} calls from {len(shards)} shards in {out}")
