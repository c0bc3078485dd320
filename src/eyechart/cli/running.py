"""``eyechart run`` makes calls and only appends; ``eyechart merge`` joins shards."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import asking
from eyechart.cli.terminal import progress, resumable, say

if TYPE_CHECKING:
    from eyechart.limits import Outcome

app = typer.Typer(help="Run a study: make its calls and append them to a ledger.", no_args_is_help=True)


@app.command(epilog="Example: eyechart run battery --model scripted:depth --frames bank --out run")
def battery(
    frames: Annotated[Path, typer.Option(help="Folder of the frame bank.")],
    out: Annotated[Path, typer.Option(help="Folder of the run; the same one resumes it.")],
    model: Annotated[list[str] | None, typer.Option(help="A model's SPEC; give it again for more models.")] = None,
    mode: asking.Mode = None,
    prompt: Annotated[
        str | None,
        typer.Option(help="A name of 'eyechart list prompts', or FILE.toml; default: one that suits the bank."),
    ] = None,
    conditions: Annotated[str | None, typer.Option(help="With commas; default: all that the bank has.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of stimuli, sampling and the order of calls.")] = 0,
    limit: Annotated[int | None, typer.Option(help="So many frames, from every episode in turn.")] = None,
    shard: Annotated[str | None, typer.Option(help="i/n: make only these calls; join with 'merge'.")] = None,
    concurrency: Annotated[int, typer.Option(min=1, help="Calls under way at once, a model.")] = 8,
    base_url: asking.BaseUrl = None,
    key_env: asking.KeyEnv = None,
    max_tokens: asking.MaxTokens = None,
    temperature: asking.Temperature = None,
    timeout: asking.Timeout = None,
    json_mode: asking.JsonMode = None,
    header: asking.Header = None,
    body: asking.Body = None,
    option: asking.Option = None,
    max_calls: Annotated[int | None, typer.Option(min=1, help="Stop at so many requests of this run.")] = None,
    max_cost: Annotated[float | None, typer.Option(min=0, help="Stop at so many US dollars of this run.")] = None,
    prices: Annotated[Path | None, typer.Option(help="FILE.toml of prices; it comes before the table.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan and make no call.")] = False,
) -> None:
    """Run the input-ablation battery. Interrupt it at will: the same command goes on where it stopped.

    The options from --base-url to --option are for the models without a --mode file. Exit 1: calls are unfinished; 3:
    stopped at --max-calls or --max-cost.
    """
    from eyechart.models.prices import read_prices
    from eyechart.run import read_shard
    from eyechart.studies import battery as study

    modes = asking.read_modes(
        model,
        mode,
        base_url=base_url,
        key_env=key_env,
        max_tokens=max_tokens,
        temperature=temperature,
        timeout=timeout,
        json_mode=json_mode,
        header=header,
        body=body,
        option=option,
    )
    table = read_prices(prices)
    planned = study.plan(
        frames,
        modes,
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
    for spec, facts in planned.manifest.facts.items():
        if "warning" in facts and spec in plan.models:
            say(f"warning: {spec}: {facts['warning']}")
    for expected in study.expected(planned, table, concurrency=concurrency):
        say(expected.words)
    if dry_run:
        return
    limits = study.within(planned, table, calls=max_calls, cost_usd=max_cost)
    with resumable(), progress("calls", "calls") as move:
        outcome = study.run(planned, concurrency=concurrency, limits=limits, progress=move)
    _tell(outcome, calls - planned.counts()[1], out)


def _tell(outcome: "Outcome", left: int, out: Path) -> None:
    """Print how a run ended; raise Exit 3 where a limit stopped it, 1 where calls are unfinished."""
    for spec, why in outcome.set_aside.items():
        say(f"set aside: {spec}: {why}")
    if outcome.stopped is not None and left:
        say(f"stopped: {outcome.stopped}; {left} calls are left; a higher limit resumes")
        raise typer.Exit(3)
    if left:
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
