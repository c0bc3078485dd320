"""``eyechart run admission``, ``structured`` and ``online``: scene estimates of pictures and of their reflections."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eyechart.cli import asking, before
from eyechart.cli.drives import KEPT, say_expected, tell_left
from eyechart.cli.options import NO_LIMIT, Spending, expanded
from eyechart.cli.running import sizes, tell
from eyechart.cli.terminal import progress, resumable, say

if TYPE_CHECKING:
    from eyechart.limits import Spent
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
    no_probe: asking.NoProbe = False,
    dry_run: DryRun = False,
) -> None:
    """Ask for scene estimates of 16 balanced frame/mirror pairs, and hold them against the clauses of admission.

    'eyechart score OUT' prints each clause with its value, interval and n. A model that is served elsewhere, and that
    no --mode file says how to ask, is probed first. Exit 1: calls are unfinished; 3: stopped at --max-calls or
    --max-cost. Example: eyechart run admission --model scripted:scene_side_blind --frames bank --out adm
    """
    from eyechart.studies import structured as study

    def planned_for(modes: "Sequence[RequestMode]", probes: "Mapping[str, Spent]") -> "Battery":
        return study.plan(study.ADMISSION, frames, modes, out, view=view, seed=seed, probes=probes)

    given = how.given()
    _run(asking.read_modes(model, mode, given), planned_for, out, spending, _How(concurrency, no_probe, dry_run))


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
    no_probe: asking.NoProbe = False,
    dry_run: DryRun = False,
) -> None:
    """Ask for scene estimates of every frame of a bank and of its reflection (Table t:controller-local).

    The paper has 288 pairs: 'frames build highway --steps 24'. A model that is served elsewhere, and that no --mode
    file says how to ask, is probed first. Exit 1: calls are unfinished; 3: stopped at --max-calls or --max-cost.
    Example: eyechart run structured --model scripted:scene_positive_control --frames bank --out scenes
    """
    from eyechart.studies import structured as study

    def planned_for(modes: "Sequence[RequestMode]", probes: "Mapping[str, Spent]") -> "Battery":
        return study.plan(study.STRUCTURED, frames, modes, out, view=view, seed=seed, limit=limit, probes=probes)

    given = how.given()
    _run(asking.read_modes(model, mode, given), planned_for, out, spending, _How(concurrency, no_probe, dry_run))


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
    no_probe: asking.NoProbe = False,
    dry_run: DryRun = False,
) -> None:
    """Let scene estimates drive through the safety policy, in worlds that the positive control has driven first.

    Each world must pass renderer integrity and the positive control, or another takes its place. 'eyechart score OUT'
    prints crash rates, decisions and fail-safes. A model that is served elsewhere, and that no --mode file says how to
    ask, is probed between the two. Exit 1: episodes are unfinished or ended in an error; 3: stopped at --max-calls or
    --max-cost. Example: eyechart run online --model scripted:scene_side_blind --out online
    """
    from eyechart import episodes as closed_loop
    from eyechart.studies import closed_loop as drives_study
    from eyechart.studies.structured import online as study
    from eyechart.studies.structured.vetting import Vetted

    given = how.given()
    asked = asking.read_modes(model, mode, given)
    table = spending.table()
    vetted: list[tuple[Vetted, ...]] = []

    def planned_for(modes: "Sequence[RequestMode]", probes: "Mapping[str, Spent]") -> study.Online:
        driven = vetted[0] if vetted else None
        with resumable("nothing was asked yet; the same command begins anew"), progress("vetting", "worlds") as move:
            made = study.plan(
                simulator,
                modes,
                out,
                view=view,
                episodes=episodes,
                seed=seed,
                progress=move,
                vetted=driven,
                probes=probes,
            )
        vetted.append(made.vetted)
        return made

    planned, unprobed = before.plan_probed(
        asked,
        before.Study(
            planned_for,
            lambda one: drives_study.as_recorded([out], one, given),
            lambda one: drives_study.sample_of(one.episodes),
            lambda known: drives_study.spent_on([out], known),
            study.keep_probes,
        ),
        before.Allowed(no_probe, dry_run, spending.max_calls, spending.max_cost),
        table,
    )
    for one in planned.vetted:
        if one.why is not None:
            say(f"refused: {one.scenario}/{one.seed}: {one.why}")
    drives, left = planned.episodes, len(planned.episodes.left())
    say(f"view: {drives.manifest.view}")
    say(f"{len(drives.keys)} episodes in worlds that pass the checks, {left} to drive")
    modes = list(drives.manifest.modes.values())
    for line in _bound(modes):
        say(line)
    say_expected(drives, table, concurrency)
    if dry_run:
        return
    limits = closed_loop.within(drives, table, calls=spending.max_calls, cost_usd=spending.max_cost)
    with resumable(KEPT), progress("episodes", "episodes") as move:
        outcome = study.run(planned, bounds=closed_loop.Bounds(concurrency=concurrency, limits=limits), progress=move)
    tell_left({"": drives}, outcome, unprobed)
    if failed := sum(one.errors for one in study.score(out).driven.values()):
        say(f"{failed} episodes ended in an error; they count in nothing")
        raise typer.Exit(1)
    say(f"done: 'eyechart score {out}' prints crash rates, decisions and fail-safes")


@dataclass(frozen=True)
class _How:
    """How much at once, and whether a run is only planned, or begun without a probe."""

    concurrency: int
    no_probe: bool
    dry_run: bool


def _run(
    asked: asking.Asked,
    plan: "Callable[[Sequence[RequestMode], Mapping[str, Spent]], Battery]",
    out: Path,
    spending: Spending,
    how: _How,
) -> None:
    """Probe the models that are to be, say what is planned, and make the calls."""
    from eyechart.studies import battery

    table = spending.table()
    planned, failed = before.plan_probed(
        asked,
        before.Study(
            plan,
            lambda one: battery.as_recorded(out, one, asked.given),
            lambda one: battery.sample_of([one]),
            lambda known: battery.spent_on(out, known),
            battery.keep_probes,
        ),
        before.Allowed(how.no_probe, how.dry_run, spending.max_calls, spending.max_cost),
        table,
    )
    modes = [planned.manifest.mode(spec) for spec in planned.plan.models]
    estimates = (one.words for one in battery.expected(planned, table, concurrency=how.concurrency))
    for line in (f"view: {planned.manifest.view}", *sizes(planned), *_bound(modes), *estimates):
        say(line)
    if how.dry_run:
        return
    limits = battery.within(planned, table, calls=spending.max_calls, cost_usd=spending.max_cost)
    with resumable(), progress("calls", "calls") as move:
        outcome = battery.run(planned, concurrency=how.concurrency, limits=limits, progress=move)
    tell(replace(outcome, set_aside={**failed, **outcome.set_aside}), planned.left())
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
