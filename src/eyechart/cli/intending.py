"""``eyechart run hierarchy``: intents above a model-predictive controller, scripted ones and a model's own."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import asking
from eyechart.cli.options import NO_LIMIT, Json, Spending, expanded
from eyechart.cli.terminal import print_json, progress, resumable, say, table_console

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eyechart.episodes import Bounds, Episodes
    from eyechart.models.prices import Prices
    from eyechart.studies.hierarchy import HierarchyScore


@expanded
def hierarchy(
    out: Annotated[Path, typer.Option(help="Folder of the study; the same one resumes it.")] = Path("hierarchy"),
    policy: Annotated[
        list[str] | None, typer.Option(help="A model's SPEC as the source of intent; again for more.")
    ] = None,
    mode: asking.Mode = None,
    prompt: Annotated[str | None, typer.Option(help="A name of 'eyechart list prompts', or FILE.toml.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of stimuli, sampling and the order of episodes.")] = 0,
    processes: Annotated[int, typer.Option(min=1, help="Processes that hold the worlds.")] = 2,
    concurrency: Annotated[int, typer.Option(min=1, help="Episodes of a model under way at once.")] = 8,
    how: asking.Options = asking.AS_USUAL,
    spending: Spending = NO_LIMIT,
    again: Annotated[bool, typer.Option("--again", help="Drive anew what ended in an error.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan; drive nothing, ask nothing.")] = False,
    json: Json = False,
) -> None:
    """Let sources of intent plan for a rover under a model-predictive controller, beside the paper's tables.

    Scripted sources always, a model where one is given: with real, mirrored and blank pictures and with those of other
    worlds. Interrupt it at will: it resumes. Exit 1: episodes are unfinished; 3: stopped at --max-calls or --max-cost.
    Example: eyechart run hierarchy --policy scripted:clear_side --out hierarchy
    """
    from eyechart import episodes as study
    from eyechart.studies.hierarchy import plan, score

    modes = asking.read_modes(
        policy or [],
        mode,
        how.given(),
    ).modes
    planned, table = plan(out, modes, seed=seed, prompt=prompt, again=again), spending.table()
    for name, part in planned.items():
        say(f"{name}: {len(part.keys)} episodes in {part.manifest.simulator}, {len(part.left())} to drive")
        for estimate in study.expected(part, table, concurrency=concurrency):
            say(f"  {estimate.words}")
    if dry_run:
        return
    stopped = _drive(planned, table, study.Bounds(processes=processes, concurrency=concurrency), spending)
    found = score(out)
    if json:
        print_json(found.as_dict())
    else:
        print_hierarchy(found)
    left = sum(len(part.left()) for part in planned.values())
    if left and stopped is not None:
        say(f"stopped: {stopped}; {left} episodes are left; a higher limit resumes")
        raise typer.Exit(3)
    if left:
        say(f"{left} episodes are unfinished; the same command goes on where they were cut")
        raise typer.Exit(1)


def _drive(planned: "Mapping[str, Episodes]", table: "Prices", bounds: "Bounds", spending: Spending) -> str | None:
    """Drive what is left of each part; return which limit stopped one of them, None where none did."""
    from dataclasses import replace

    from eyechart import episodes as study

    stopped = None
    for name, part in planned.items():
        if part.left():
            limits = study.within(part, table, calls=spending.max_calls, cost_usd=spending.max_cost)
            kept = "finished episodes and calls are kept; the same command resumes"
            with resumable(kept), progress(name, "episodes") as move:
                outcome = study.run(part, bounds=replace(bounds, limits=limits), progress=move)
            for spec, why in outcome.set_aside.items():
                say(f"set aside: {spec}: {why}")
            stopped = stopped or outcome.stopped
    return stopped


def print_hierarchy(found: "HierarchyScore") -> None:
    """Print both ablations, the tests against the controller alone, the positive control, and the words."""
    from eyechart.report.hierarchy import against_table, source_table

    console = table_console(160)
    console.print(source_table(found.sources, primary=True))
    console.print(against_table(found.against_mpc_only))
    console.print(source_table(found.sources, primary=False))
    if found.oracle_mirrored is not None:
        goals = found.oracle_mirrored.differences["success_rate"]
        shown = "—" if goals.value is None else f"{100 * goals.value:+.0f} points"
        console.print(
            f"Positive control: the oracle's lateral intent less the same one mirrored: goals {shown}, "
            f"p {'—' if goals.p is None else f'{goals.p:.2g}'}, {found.oracle_mirrored.worlds} worlds.",
            markup=False,
        )
    for line in found.words:
        console.print(line, markup=False)
