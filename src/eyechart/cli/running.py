"""``eyechart run`` makes calls and only appends; ``eyechart merge`` joins shards."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import asking, before
from eyechart.cli.options import NO_LIMIT, Spending, expanded
from eyechart.cli.terminal import progress, resumable, say

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eyechart.limits import Outcome, Spent
    from eyechart.modes import RequestMode
    from eyechart.studies.battery import Battery

app = typer.Typer(help="Run a study: make its calls and append them to a ledger.", no_args_is_help=True)


@app.command(
    epilog="Example: eyechart run battery --model scripted:depth --frames bank --out run. With --stop-early, for each "
    "model, a false early verdict has a chance of at most .05 however often one looks (.01 for each of not_scorable, "
    "depth by intervention, presence_only, refusal_effect and image_invariant; that the whole run would have been "
    "not_scorable, .02); success at following the gap by observation never stops a run. Try it with --dry-run first."
)
@expanded
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
    how: asking.Options = asking.AS_USUAL,
    spending: Spending = NO_LIMIT,
    stop_early: Annotated[
        bool, typer.Option("--stop-early", help="Ask a model no more once its verdict is settled; see below.")
    ] = False,
    no_probe: asking.NoProbe = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan and make no call.")] = False,
) -> None:
    """Run the input-ablation battery. Interrupt it at will: the same command goes on where it stopped.

    The options from --base-url to --option are for the models without a --mode file; of these, one that is served
    elsewhere is probed first (as 'eyechart probe' does), and what is found is kept in the run. Exit 1: calls are
    unfinished; 3: stopped at --max-calls or --max-cost.
    """
    from eyechart.run import read_shard
    from eyechart.studies import battery as study

    given = how.given()
    asked = asking.read_modes(model, mode, given)
    table = spending.table()

    def planned_for(modes: "Sequence[RequestMode]", probes: "Mapping[str, Spent]") -> "Battery":
        return study.plan(
            frames,
            modes,
            out,
            prompt=prompt,
            conditions=None if conditions is None else [name.strip() for name in conditions.split(",")],
            seed=seed,
            limit=limit,
            shard=None if shard is None else read_shard(shard),
            stop_early=stop_early,
            probes=probes,
        )

    planned, failed = before.plan_probed(
        asked,
        before.Study(
            planned_for,
            lambda one: study.as_recorded(out, one, given),
            lambda one: study.sample_of([one]),
            lambda known: study.spent_on(out, known),
            study.keep_probes,
        ),
        before.Allowed(no_probe, dry_run, spending.max_calls, spending.max_cost, shard),
        table,
    )
    for line in (*sizes(planned), *(one.words for one in study.expected(planned, table, concurrency=concurrency))):
        say(line)
    for line in _before(planned) if stop_early else ():
        say(line)
    if dry_run:
        return
    limits = study.within(planned, table, calls=spending.max_calls, cost_usd=spending.max_cost)
    with resumable(), progress("calls", "calls") as move:
        outcome = study.run(planned, concurrency=concurrency, limits=limits, progress=move)
    for line in _after(planned) if stop_early else ():
        say(line)
    tell(replace(outcome, set_aside={**failed, **outcome.set_aside}), planned.left())
    say(f"done: 'eyechart verdict {out}' judges, 'eyechart score {out}' prints every statistic")


def sizes(planned: "Battery") -> list[str]:
    """Say what is left out and why, how many calls there are, and what the models themselves give to think about."""
    plan, (calls, finished, unknown) = planned.plan, planned.counts()
    to_make = f"{'at most ' if planned.manifest.stop_early else ''}{planned.left()}"
    facts = planned.manifest.facts
    size = f"{len(plan.models)} models × {len(plan.frames)} frames × {len(plan.conditions)} conditions"
    return [
        *(f"left out: {name}, because {why}" for name, why in planned.left_out.items()),
        f"{size}: {calls} calls, {finished} finished, {unknown} sent with unknown outcome, {to_make} to make",
        *(f"warning: {one}: {facts[one]['warning']}" for one in plan.models if "warning" in facts.get(one, {})),
    ]


def tell(outcome: "Outcome", left: int, what: str = "calls") -> None:
    """Print how a run ended; raise Exit 3 where a limit stopped it, 1 where calls are unfinished."""
    for spec, why in outcome.set_aside.items():
        say(f"set aside: {spec}: {why}")
    before.say_uncounted(outcome)
    if outcome.stopped is not None and left:
        say(f"stopped: {outcome.stopped}; {left} {what} are left; a higher limit resumes")
        raise typer.Exit(3)
    if not left and outcome.set_aside:
        before.tell_none({})
    if left:
        say(f"{left} {what} are unfinished: their last error may pass, and the same command tries them again")
        raise typer.Exit(1)


def _before(planned: "Battery") -> list[str]:
    """Say what stopping early guarantees, and the most and the typical number of calls."""
    from eyechart.verdicts import GUARANTEE, VALIDITY

    most = max(sum(1 for _ in planned.plan.keys_of(model)) for model in planned.plan.models)
    counts = sorted(planned.typical().items(), key=lambda one: one[1])
    typical = ", ".join(f"{count} ({label})" for label, count in counts)
    return [
        f"stop early: {GUARANTEE}",
        f"stop early: {VALIDITY}",
        f"stop early: at most {most} calls a model; of a controller that never wavers {typical or 'as many'}",
    ]


def _after(planned: "Battery") -> list[str]:
    """Say which models were stopped early, and the calls saved."""
    lines, planned_calls, saved = [], 0, 0
    for model, one in planned.progress().items():
        calls = sum(1 for _ in planned.plan.keys_of(model))
        planned_calls += calls
        if one.stopped is None:
            lines.append(f"{model}: not stopped early, {one.left} of {calls} calls left")
            continue
        saved += one.stopped.saved
        beyond = f", {one.stopped.beyond} ended after the stop and do not count" if one.stopped.beyond else ""
        share = f"{one.stopped.saved} calls saved ({one.stopped.saved / calls:.0%})"
        lines.append(f"{model}: {one.stopped.words()}: {share}{beyond}")
    return [*lines, f"calls saved: {saved} of {planned_calls} ({saved / max(planned_calls, 1):.0%})"]


def merge(
    shards: Annotated[list[Path], typer.Argument(help="Folders of the shards.")],
    out: Annotated[Path, typer.Option(help="Folder of the merged run.")],
) -> None:
    """Merge the shards of one run into a new run. Example: eyechart merge run-1 run-2 --out run."""
    from eyechart.studies import battery as study

    calls = study.merge(shards, out)
    say(f"{calls} calls from {len(shards)} shards in {out}")
