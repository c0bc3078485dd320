"""``eyechart run hierarchy``: intents above a model-predictive controller, scripted ones and a model's own."""

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import asking, before
from eyechart.cli.drives import say_expected, tell_errors, tell_left
from eyechart.cli.options import NO_LIMIT, Json, Spending, expanded
from eyechart.cli.terminal import print_json, progress, resumable, say, table_console

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

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
    silence: Annotated[
        str, typer.Option(help="What a call that hangs or keeps failing is: fail-safe (STOP), or unfinished.")
    ] = "fail-safe",
    how: asking.Options = asking.AS_USUAL,
    spending: Spending = NO_LIMIT,
    no_probe: asking.NoProbe = False,
    again: Annotated[bool, typer.Option("--again", help="Drive anew what ended in an error.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan; drive nothing, ask nothing.")] = False,
    json: Json = False,
) -> None:
    """Let sources of intent plan for a rover under a model-predictive controller, beside the paper's tables.

    Scripted sources always, a model where one is given: with real, mirrored and blank pictures and with those of other
    worlds; one that is served elsewhere is probed first. A planner that says nothing within --timeout stops the rover.
    Interrupt it at will: it resumes. Exit 1: episodes are unfinished, or ended in an error; 3: stopped at --max-calls
    or --max-cost.
    Example: eyechart run hierarchy --policy scripted:clear_side --out hierarchy
    """
    from eyechart import episodes as study
    from eyechart.studies import closed_loop
    from eyechart.studies.hierarchy import PARTS, plan, run, score

    given, table = how.given(), spending.table()
    runs = [out / name for name in PARTS]
    planned, failed = before.plan_probed(
        asking.read_modes(policy or [], mode, given),
        before.Study(
            lambda modes, probes: plan(
                out, modes, seed=seed, prompt=prompt, silence=silence, again=again, probes=probes
            ),
            lambda one: closed_loop.as_recorded(runs, one, given),
            lambda parts: closed_loop.sample_of(next(parts[name] for name in parts if PARTS[name].models)),
            lambda known: closed_loop.spent_on(runs, known),
            lambda parts, probes: study.keep_probes(next(iter(parts.values())), probes),
            others=True,
        ),
        before.Allowed(no_probe, dry_run, spending.max_calls, spending.max_cost),
        table,
    )
    for name, part in planned.items():
        say(f"{name}: {len(part.keys)} episodes in {part.manifest.simulator}, {len(part.left())} to drive")
        say_expected(part, table, concurrency, "  ")
    if dry_run:
        return
    outcome = run(
        planned,
        table,
        bounds=study.Bounds(processes=processes, concurrency=concurrency),
        calls=spending.max_calls,
        cost_usd=spending.max_cost,
        watch=_watched,
    )
    found = score(out)
    if json:
        print_json(found.as_dict())
    else:
        print_hierarchy(found)
    tell_left(planned, outcome, failed)
    tell_errors(planned, bound="")


@contextmanager
def _watched(part: str) -> "Iterator[Callable[[int, int], None]]":
    with (
        resumable("finished episodes and calls are kept; the same command resumes"),
        progress(part, "episodes") as move,
    ):
        yield move


def print_hierarchy(found: "HierarchyScore") -> None:
    """Print both ablations, the tests against the controller alone, the positive control, and the words."""
    from eyechart.report.hierarchy import tables_of
    from eyechart.report.rungs import unfinished_words

    console = table_console(160)
    for table in tables_of(found):
        console.print(table)
    if found.oracle_mirrored is not None:
        goals = found.oracle_mirrored.differences["success_rate"]
        shown = "—" if goals.value is None else f"{100 * goals.value:+.0f} points"
        console.print(
            f"Positive control: the oracle's lateral intent less the same one mirrored: goals {shown}, "
            f"p {'—' if goals.p is None else f'{goals.p:.2g}'}, {found.oracle_mirrored.worlds} worlds.",
            markup=False,
        )
    for line in (*found.words, *unfinished_words(found.unfinished)):
        console.print(line, markup=False)
