"""``eyechart run admission``, ``structured`` and ``online``: scene estimates of pictures and of their reflections."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import asking
from eyechart.cli.options import NO_LIMIT, Spending, expanded
from eyechart.cli.running import sizes, tell
from eyechart.cli.terminal import progress, resumable, say

if TYPE_CHECKING:
    from eyechart.modes import RequestMode
    from eyechart.studies.battery import Battery

Frames = Annotated[Path, typer.Option(help="Folder of the frame bank.")]
Out = Annotated[Path, typer.Option(help="Folder of the run; the same one resumes it.")]
Model = Annotated[list[str] | None, typer.Option(help="A model's SPEC; give it again for more models.")]
View = Annotated[
    str | None, typer.Option(help="calibrated or none; default: calibrated where the pictures have such a view.")
]
Concurrency = Annotated[int, typer.Option(min=1, help="Calls under way at once, a model.")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Print the plan and make no call.")]


@expanded
def admission(
    frames: Frames,
    out: Out,
    model: Model = None,
    mode: asking.Mode = None,
    view: View = None,
    seed: Annotated[int, typer.Option(min=0, help="Chooses the pairs, and the order of calls.")] = 0,
    concurrency: Concurrency = 8,
    how: asking.Options = asking.AS_USUAL,
    spending: Spending = NO_LIMIT,
    dry_run: DryRun = False,
) -> None:
    """Ask for scene estimates of 16 balanced frame/mirror pairs, and hold them against the clauses of admission.

    'eyechart score OUT' prints each clause with its value, interval and n. Exit 1: calls are unfinished; 3: stopped at
    --max-calls or --max-cost. Example: eyechart run admission --model scripted:scene_side_blind --frames bank --out adm
    """
    modes = asking.read_modes(
        model,
        mode,
        how.given(),
    ).modes
    from eyechart.studies import structured as study

    planned = study.plan(study.ADMISSION, frames, modes, out, view=view, seed=seed)
    _run(planned, modes, spending, concurrency=concurrency, dry_run=dry_run)


@expanded
def structured(
    frames: Frames,
    out: Out,
    model: Model = None,
    mode: asking.Mode = None,
    view: View = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the order of calls and of sampling.")] = 0,
    limit: Annotated[int | None, typer.Option(help="So many frames, from every episode in turn.")] = None,
    concurrency: Concurrency = 8,
    how: asking.Options = asking.AS_USUAL,
    spending: Spending = NO_LIMIT,
    dry_run: DryRun = False,
) -> None:
    """Ask for scene estimates of every frame of a bank and of its reflection (Table t:controller-local).

    The paper has 288 pairs: 'frames build highway --steps 24'. Exit 1: calls are unfinished; 3: stopped at --max-calls
    or --max-cost. Example: eyechart run structured --model scripted:scene_positive_control --frames bank --out scenes
    """
    modes = asking.read_modes(
        model,
        mode,
        how.given(),
    ).modes
    from eyechart.studies import structured as study

    planned = study.plan(study.STRUCTURED, frames, modes, out, view=view, seed=seed, limit=limit)
    _run(planned, modes, spending, concurrency=concurrency, dry_run=dry_run)


@expanded
def online(
    out: Out,
    simulator: Annotated[str, typer.Option(help="See 'eyechart list simulators'.")] = "highway",
    model: Model = None,
    mode: asking.Mode = None,
    view: View = None,
    episodes: Annotated[int, typer.Option(min=1, help="So many worlds, from every scenario in turn.")] = 12,
    seed: Annotated[int, typer.Option(min=0, help="Of the order of episodes and of sampling.")] = 0,
    concurrency: Annotated[int, typer.Option(min=1, help="Episodes of a model under way at once.")] = 8,
    how: asking.Options = asking.AS_USUAL,
    spending: Spending = NO_LIMIT,
    dry_run: DryRun = False,
) -> None:
    """Let scene estimates drive through the safety policy, in worlds that the positive control has driven first.

    Each world must pass renderer integrity and the positive control, or another takes its place. 'eyechart score OUT'
    prints crash rates, decisions and fail-safes. Exit 1: episodes are unfinished or ended in an error; 3: stopped at
    --max-calls or --max-cost. Example: eyechart run online --model scripted:scene_side_blind --out online
    """
    from eyechart import episodes as closed_loop
    from eyechart.studies.structured import online as study

    modes = asking.read_modes(
        model,
        mode,
        how.given(),
    ).modes
    table = spending.table()
    with resumable("nothing was asked yet; the same command begins anew"), progress("vetting", "worlds") as move:
        planned = study.plan(simulator, modes, out, view=view, episodes=episodes, seed=seed, progress=move)
    for one in planned.vetted:
        if one.why is not None:
            say(f"refused: {one.scenario}/{one.seed}: {one.why}")
    drives, left = planned.episodes, len(planned.episodes.left())
    say(f"view: {drives.manifest.view}")
    say(f"{len(drives.keys)} episodes in worlds that pass the checks, {left} to drive")
    for line in (*_bound(modes), *(one.words for one in closed_loop.expected(drives, table, concurrency=concurrency))):
        say(line)
    if dry_run:
        return
    limits = closed_loop.within(drives, table, calls=spending.max_calls, cost_usd=spending.max_cost)
    with (
        resumable("finished episodes and calls are kept; the same command resumes"),
        progress("episodes", "episodes") as move,
    ):
        outcome = study.run(planned, bounds=closed_loop.Bounds(concurrency=concurrency, limits=limits), progress=move)
    tell(outcome, len(drives.left()), what="episodes")
    if failed := sum(one.errors for one in study.score(out).driven.values()):
        say(f"{failed} episodes ended in an error; they count in nothing")
        raise typer.Exit(1)
    say(f"done: 'eyechart score {out}' prints crash rates, decisions and fail-safes")


def _run(
    planned: "Battery",
    modes: "Sequence[RequestMode]",
    spending: Spending,
    *,
    concurrency: int,
    dry_run: bool,
) -> None:
    """Say what is planned and make the calls."""
    from eyechart.studies import battery

    table = spending.table()
    estimates = (one.words for one in battery.expected(planned, table, concurrency=concurrency))
    for line in (f"view: {planned.manifest.view}", *sizes(planned), *_bound(modes), *estimates):
        say(line)
    if dry_run:
        return
    limits = battery.within(planned, table, calls=spending.max_calls, cost_usd=spending.max_cost)
    with resumable(), progress("calls", "calls") as move:
        outcome = battery.run(planned, concurrency=concurrency, limits=limits, progress=move)
    tell(outcome, planned.left())
    say(f"done: 'eyechart score {planned.out}' prints the table, the clauses and every figure")


def _bound(modes: "Sequence[RequestMode]") -> list[str]:
    """Say of each model whether its server is told the schema, and warn where a probe found that it does not bind."""
    lines = []
    for mode in modes:
        if mode.spec.startswith("scripted:"):
            continue
        if mode.spec.startswith("hf:"):
            lines.append(f"{mode.spec}: replies are read strictly; a checkpoint run here binds no schema")
        elif mode.structured != "json_schema":
            lines.append(f"{mode.spec}: replies are read strictly; --json-mode json_schema binds the schema")
        elif mode.measured is not None and mode.measured.schema_binds is False:
            lines.append(f"warning: {mode.spec}: the schema is sent, but a probe found that this server ignores it")
    return lines
