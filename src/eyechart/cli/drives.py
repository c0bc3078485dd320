"""What the commands that drive share: their models are probed first, their drives bounded, and their end is told."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from eyechart.cli import asking, before
from eyechart.cli.options import Spending
from eyechart.cli.terminal import progress, resumable, say

if TYPE_CHECKING:
    from eyechart.episodes import Bounds, Episodes
    from eyechart.limits import Outcome, Spent
    from eyechart.models.prices import Prices
    from eyechart.modes import RequestMode

MOST_SEEDS = 100_000
"""So many worlds of a scenario may be asked for."""

KEPT = "finished episodes and calls are kept; the same command resumes"


@dataclass(frozen=True)
class Wanted:
    """Who is asked to drive, how models among them are asked, and what that may take.

    ``policies`` are as they were given, models among them; ``alone`` says that nobody else drives in the command.
    """

    policies: Sequence[str]
    mode: Sequence[Path] | None
    how: asking.Options
    spending: Spending
    no_probe: bool
    dry_run: bool
    alone: bool = True


def plan_drives(
    wanted: Wanted, out: Path, plan: "Callable[[Sequence[str | RequestMode], Mapping[str, Spent]], Episodes]"
) -> "tuple[Episodes, dict[str, str]]":
    """Plan drives, probe the models among their drivers that are to be, and plan anew with what was found.

    Returns the plan, and why models were left out of it.
    """
    from eyechart.episodes import keep_probes
    from eyechart.policies import is_policy
    from eyechart.studies import closed_loop

    given = wanted.how.given()
    asked = asking.read_modes(
        [spec for spec in wanted.policies if ":" in spec and not is_policy(spec)], wanted.mode, given
    )
    names = list(dict.fromkeys([*wanted.policies, *(mode.spec for mode in asked.modes)]))
    models = {mode.spec for mode in asked.modes}

    def planned(modes: "Sequence[RequestMode]", probes: "Mapping[str, Spent]") -> "Episodes":
        by_spec = {mode.spec: mode for mode in modes}
        return plan([by_spec.get(spec, spec) for spec in names if spec in by_spec or spec not in models], probes)

    return before.plan_probed(
        asked,
        before.Study(
            planned,
            lambda one: closed_loop.as_recorded([out], one, given),
            closed_loop.sample_of,
            lambda known: closed_loop.spent_on([out], known),
            keep_probes,
            others=not wanted.alone or len(models) < len(names),
        ),
        before.Allowed(wanted.no_probe, wanted.dry_run, wanted.spending.max_calls, wanted.spending.max_cost),
        wanted.spending.table(),
    )


def drive(planned: "Episodes", bounds: "Bounds", spending: Spending, *, engine: str = "local") -> "Outcome":
    """Drive what is left within what it may take, with a bar; an interrupt says what is kept."""
    from dataclasses import replace

    from eyechart import episodes as study

    limits = study.within(planned, spending.table(), calls=spending.max_calls, cost_usd=spending.max_cost)
    with resumable(KEPT), progress("episodes", "episodes") as move:
        return study.run(planned, engine=engine, bounds=replace(bounds, limits=limits), progress=move)


def say_expected(planned: "Episodes", prices: "Prices", concurrency: int, margin: str = "") -> None:
    """Say what the models' calls that are still to be made are expected to take, or why nobody can say."""
    from eyechart import episodes as study
    from eyechart.errors import DriveError

    try:
        estimates = study.expected(planned, prices, concurrency=concurrency)
    except DriveError as error:
        say(f"{margin}cannot estimate what the models' calls take: {error}")
        return
    for one in estimates:
        say(f"{margin}{one.words}")


def tell_left(parts: "Mapping[str, Episodes]", outcome: "Outcome", failed: Mapping[str, str]) -> None:
    """Say what is left of drives and why; raise Exit 3 where a limit stopped them, 1 where anything else did.

    ``parts`` are the runs of a study by name, one alone has none: ``""``. ``failed`` says why models were left out of
    the plan.
    """
    from eyechart.episodes import unfinished

    for spec, why in {**failed, **outcome.set_aside}.items():
        say(f"set aside: {spec}: {why}")
    before.say_uncounted(outcome)
    left = 0
    for name, planned in parts.items():
        mine = planned.unfinished()
        left += len(mine)
        for one in unfinished(planned.out, mine, planned.drivers.models):
            say(f"{_named(name)}{one.policy}: {one.words}")
    waiting = sum(len(planned.left()) for planned in parts.values())  # also what was to be driven anew
    if outcome.stopped is not None and waiting:
        say(f"stopped: {outcome.stopped}; {count(waiting)} left; a higher limit resumes")
        raise typer.Exit(3)
    if left:
        say(f"{count(left)} unfinished; the same command goes on where they were cut")
        raise typer.Exit(1)
    if failed:
        before.tell_none({})


def tell_errors(parts: "Mapping[str, Episodes]", bound: str = "--max-steps") -> None:
    """Say which episodes ended in an error, by what; raise Exit 1 where any did.

    ``bound`` is the option that lets an episode go on for longer, or nothing where there is none.
    """
    from eyechart.episodes import read_episodes

    found = []
    for name, planned in parts.items():
        keys = set(planned.keys)
        over = {one.key: one for one in read_episodes(planned.out) if one.key in keys}
        found += [(name, over[key]) for key in planned.keys if key in over and over[key].ended == "error"]
    if not found:
        return
    from eyechart.errors import printable

    failed = [one for _, one in found]
    bounded = [one for one in failed if one.max_steps is not None and len(one.steps) >= one.max_steps]
    say(
        f"{len(failed)} episode{'' if len(failed) == 1 else 's'} ended in an error, first {_named(found[0][0])}"
        f"{failed[0].key.policy} in {failed[0].key.world}: {printable(failed[0].detail)}; "
        f"--again drives {'it' if len(failed) == 1 else 'them'} anew"
        + (f", and with a larger {bound} those that the bound ended go on" if bounded and bound else "")
    )
    raise typer.Exit(1)


def require_drives(runs: Sequence[Path]) -> None:
    """Raise SpecError that names the runs of a study where one of these folders holds several."""
    from eyechart.errors import SpecError
    from eyechart.studies import hierarchy

    for run in runs:
        if parts := hierarchy.runs_of(run):
            named = ", ".join(map(str, parts.values()))
            raise SpecError(f"{run} is a study of the hierarchy, not one run: name one of its runs: {named}")


def _named(part: str) -> str:
    """Return the name of a run of a study before what is said of it."""
    return f"{part}: " if part else ""


def count(episodes: int) -> str:
    """Return a number of episodes with its verb."""
    return f"{episodes} episode is" if episodes == 1 else f"{episodes} episodes are"
