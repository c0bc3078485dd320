"""``eyechart run prompts`` asks the same frames under several prompts; ``eyechart score`` prints its table."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import asking, before
from eyechart.cli.options import NO_LIMIT, Spending, expanded
from eyechart.cli.terminal import progress, resumable, say

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eyechart.limits import Spent
    from eyechart.modes import RequestMode
    from eyechart.studies.prompts import PromptStudy


@expanded
def prompts(
    frames: Annotated[Path, typer.Option(help="Folder of the frame bank.")],
    out: Annotated[Path, typer.Option(help="Folder of the study, one run a cell; the same one resumes it.")],
    model: Annotated[list[str] | None, typer.Option(help="A model's SPEC; give it again for more models.")] = None,
    mode: asking.Mode = None,
    prompt: Annotated[
        list[str] | None, typer.Option(help="A prompt's name or FILE.toml; again for more. Default: the six built-in.")
    ] = None,
    budget: Annotated[list[int] | None, typer.Option(min=1, help="Tokens of a reply; again to compare.")] = None,
    json_mode: Annotated[
        list[str] | None, typer.Option(help="none, json_object or json_schema; again to compare them.")
    ] = None,
    conditions: Annotated[str, typer.Option(help="With commas; 'all' for a whole battery a cell.")] = "real,blank",
    limit: Annotated[int, typer.Option(min=1, help="Frames a cell, the same in each.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of stimuli, sampling and the order of calls.")] = 0,
    concurrency: Annotated[int, typer.Option(min=1, help="Calls under way at once, a model.")] = 8,
    how: asking.Addressing = asking.ADDRESSED,
    spending: Spending = NO_LIMIT,
    no_probe: asking.NoProbe = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan and make no call.")] = False,
) -> None:
    """Run the prompt study: diversity, and beside it the scene dependence that diversity is not (Table t:prompts).

    A model that is served elsewhere, and that no --mode file says how to ask, is probed first with all of the prompts.
    Exit 1: calls are unfinished; 3: stopped at --max-calls or --max-cost.
    Example: eyechart run prompts --model scripted:depth --frames bank --out prompts --prompt baseline --prompt minimal
    """
    from itertools import product

    from eyechart.errors import SpecError
    from eyechart.modes import STRUCTURED
    from eyechart.prompts import PROMPTS
    from eyechart.studies import prompts as study
    from eyechart.studies.battery import keep_probes, sample_of

    for one in json_mode or ():
        if one not in STRUCTURED:
            raise SpecError(f"--json-mode '{one}' is none of {', '.join(STRUCTURED)}")
    given = how.given()
    asked, table = asking.read_modes(model, mode, given), spending.table()

    def planned_for(modes: "Sequence[RequestMode]", probes: "Mapping[str, Spent]") -> "PromptStudy":
        return study.plan(
            frames,
            modes,
            out,
            prompts=prompt or tuple(PROMPTS),
            factors=[study.Factor(*setting) for setting in product(budget or (None,), json_mode or (None,))],
            conditions=() if conditions == "all" else [name.strip() for name in conditions.split(",")],
            limit=limit,
            seed=seed,
            probes=probes,
        )

    planned, failed = before.plan_probed(
        asked,
        before.Study(
            planned_for,
            lambda one: study.as_recorded(out, one, given, budget=bool(budget)),
            lambda one: sample_of(one.cells.values()),
            lambda known: study.spent_on(out, known),
            lambda one, probes: keep_probes(next(iter(one.cells.values())), probes),
        ),
        before.Allowed(no_probe, dry_run, spending.max_calls, spending.max_cost),
        table,
        {"structured": "none"},  # the form of an answer is a factor of this study
    )
    calls, finished, unknown = planned.counts()
    say(
        f"{len(planned.cells)} cells × {len(asked.modes) - len(failed)} models: {calls} calls, {finished} finished, "
        f"{unknown} sent with unknown outcome, {calls - finished} to make"
    )
    for line in planned.expected(table, concurrency=concurrency):
        say(line)
    if dry_run:
        return
    with resumable(), progress("calls", "calls") as move:
        outcome = study.run(
            planned,
            concurrency=concurrency,
            calls=spending.max_calls,
            cost_usd=spending.max_cost,
            prices=table,
            progress=move,
        )
    for spec, why in {**failed, **outcome.set_aside}.items():
        say(f"set aside: {spec}: {why}")
    before.say_uncounted(outcome)
    left = calls - planned.counts()[1]
    if outcome.stopped is not None:
        say(f"stopped: {outcome.stopped}; {left} calls are left; a higher limit resumes")
        raise typer.Exit(3)
    if left:
        say(f"{left} calls are unfinished: their last error may pass, and the same command tries them again")
        raise typer.Exit(1)
    if failed:
        before.tell_none({})
    say(f"done: 'eyechart score {out}' prints the table, 'eyechart score {out}/CELL' every statistic of a cell")
