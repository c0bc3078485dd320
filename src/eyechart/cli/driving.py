"""``eyechart run closed-loop`` lets policies and models drive, and appends their episodes to a run."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import asking
from eyechart.cli.drives import MOST_SEEDS, Wanted, drive, plan_drives, say_expected, tell_errors, tell_left
from eyechart.cli.options import NO_LIMIT, Json, Spending, expanded
from eyechart.cli.terminal import print_json, say, table_console

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eyechart.episodes import Episodes, Row
    from eyechart.limits import Spent
    from eyechart.modes import RequestMode


@expanded
def closed_loop(
    out: Annotated[Path, typer.Option(help="Folder of the run; the same one resumes it.")],
    simulator: Annotated[str, typer.Option(help="See 'eyechart list simulators'; or gym:ENV_ID.")] = "highway",
    policy: Annotated[
        list[str] | None,
        typer.Option(
            help="Who drives; again for more: constant:ACTION, random, marginal:RUN, oracle, positive_control, or a "
            "model's SPEC."
        ),
    ] = None,
    mode: asking.Mode = None,
    scenarios: Annotated[str | None, typer.Option(help="With commas; default: all of the simulator.")] = None,
    seeds: Annotated[str, typer.Option(help="So many worlds a scenario; or which ones, with commas.")] = "8",
    condition: Annotated[
        list[str] | None,
        typer.Option(help="real, blank, noise, shuffled, frozen or mirrored; again for more. Default: real."),
    ] = None,
    processes: Annotated[
        int | None, typer.Option(min=1, help="Processes that hold worlds; default: one a processor.")
    ] = None,
    engine: Annotated[str, typer.Option(help="Where the worlds are: local, or ray for a cluster.")] = "local",
    actions: Annotated[Path | None, typer.Option(help="FILE.toml: the action map of gym:ENV_ID.")] = None,
    prompt: Annotated[str | None, typer.Option(help="A name of 'eyechart list prompts', or FILE.toml.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of stimuli, sampling and the order of episodes.")] = 0,
    concurrency: Annotated[int, typer.Option(min=1, help="Episodes of a model under way at once.")] = 8,
    how: asking.Options = asking.AS_USUAL,
    max_steps: Annotated[int, typer.Option(min=1, help="An episode that goes on for longer is an error.")] = 1000,
    silence: Annotated[
        str, typer.Option(help="What a call that hangs or keeps failing is: unfinished, or fail-safe (executed).")
    ] = "unfinished",
    spending: Spending = NO_LIMIT,
    again: Annotated[bool, typer.Option("--again", help="Drive anew what ended in an error.")] = False,
    no_probe: asking.NoProbe = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan; drive nothing, ask nothing.")] = False,
    json: Json = False,
) -> None:
    """Let policies and models drive: policies × scenarios × seeds × conditions. Interrupt it at will.

    The options from --base-url to --option are for the models without a --mode file; of these, one that is served
    elsewhere is probed first, with the first pictures of the first worlds. Exit 1: episodes are unfinished, or ended in
    an error; 3: stopped at --max-calls or --max-cost.
    Example: eyechart run closed-loop --policy constant:SLOW --policy oracle --policy scripted:depth_lateral
    --condition real --condition blank --out drives
    """
    from eyechart import episodes as study

    if not dry_run:
        study.require_engine(engine)

    def planned_for(drivers: "Sequence[str | RequestMode]", probes: "Mapping[str, Spent]") -> "Episodes":
        return study.plan(
            simulator,
            drivers,
            out,
            scenarios=None if scenarios is None else [name.strip() for name in scenarios.split(",")],
            seeds=_seeds(seeds),
            conditions=condition or ("real",),
            prompt=prompt,
            actions=actions,
            seed=seed,
            max_steps=max_steps,
            silence=silence,
            again=again,
            probes=probes,
        )

    planned, failed = plan_drives(Wanted(policy or (), mode, how, spending, no_probe, dry_run), out, planned_for)
    say(_planned(planned))
    say_expected(planned, spending.table(), concurrency)
    if dry_run:
        return
    bounds = study.Bounds(processes=processes or _processors(), concurrency=concurrency)
    outcome = drive(planned, bounds, spending, engine=engine)
    keys = set(planned.keys)
    driven = {one.key: one for one in study.read_episodes(out) if one.key in keys}
    _show(study.summarise(driven[key] for key in planned.keys if key in driven), planned, json=json)
    tell_left({"": planned}, outcome, failed)
    tell_errors({"": planned})
    say(f"done: 'eyechart score {out}' compares who drove, 'eyechart report {out} --out page.html' shows every drive")


def _planned(planned: "Episodes") -> str:
    parts = {
        name: len({getattr(key, name) for key in planned.keys}) for name in ("policy", "scenario", "seed", "condition")
    }
    size = " × ".join(f"{count} {_plural(name, count)}" for name, count in parts.items())
    left = len(planned.left())
    return f"{size}: {len(planned.keys)} episodes, {len(planned.keys) - left} finished, {left} to drive"


def _plural(name: str, count: int) -> str:
    return name if count == 1 else f"{name[:-1]}ies" if name.endswith("y") else f"{name}s"


def _seeds(given: str) -> list[int]:
    from eyechart.errors import SpecError

    try:
        numbers = [int(one) for one in given.split(",") if one.strip()]
    except ValueError as error:
        raise SpecError(
            f"--seeds takes a number of worlds, or seeds with commas such as 0,3,5; got '{given}'"
        ) from error
    if "," in given:
        return numbers
    if len(numbers) != 1 or not 1 <= numbers[0] <= MOST_SEEDS:
        raise SpecError(f"--seeds takes a number from 1 to {MOST_SEEDS}, or seeds with commas; got '{given}'")
    return list(range(numbers[0]))


def _processors() -> int:
    import os

    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _show(rows: "Sequence[Row]", planned: "Episodes", *, json: bool) -> None:
    """Print a row for each policy and condition: means over episodes, as JSON or as a table."""
    if json:
        from eyechart.episodes import unfinished

        left = planned.unfinished()
        why = [one.as_dict() for one in unfinished(planned.out, left, planned.drivers.models)]
        told = {"run": str(planned.out), "left": len(left), "unfinished": why}
        print_json({**told, "rows": [row.as_dict() for row in rows]})
        return
    from rich.table import Table

    table = Table(title=f"{planned.manifest.simulator}: means over episodes")
    for name in ("policy", "condition"):
        table.add_column(name, no_wrap=True)
    for name in ("episodes", "distance m", "reward", "speed m/s", "crashed", "no decision", "errors"):
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(
            row.policy,
            row.condition,
            str(row.episodes),
            _number(row.distance_m, ".1f"),
            _number(row.reward, ".2f"),
            _number(row.speed_mps, ".1f"),
            _number(row.crash_rate, ".1%"),
            _number(row.without_decision, ".1%"),
            str(row.errors),
        )
    table_console().print(table)


def _number(value: float | None, form: str) -> str:
    return "—" if value is None else format(value, form)
