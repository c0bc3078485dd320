"""The probe before a run: models that are served elsewhere, and that nobody has said how to ask, are probed first."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, NoReturn, TypeVar

import typer

from eyechart.cli import asking
from eyechart.cli.probing import draw_seed, lines_of, probe_one
from eyechart.cli.terminal import say

if TYPE_CHECKING:
    from eyechart.limits import Outcome, Spent
    from eyechart.models.prices import Prices
    from eyechart.modes import RequestMode
    from eyechart.probe import Sample


P = TypeVar("P")
"""A study's plan."""


@dataclass(frozen=True)
class Probed:
    """The modes of a run after its probes, what each probe took, and which models could not be probed and why."""

    modes: "list[RequestMode]"
    spent: "dict[str, Spent]"
    failed: dict[str, str]


def to_probe(
    asked: asking.Asked, recorded: "Callable[[RequestMode], RequestMode | None]", *, no_probe: bool
) -> "tuple[list[RequestMode], list[str]]":
    """Return the modes of a run, those that it has recorded as it has them, and which models are to be probed first.

    A model is probed once: where it is served elsewhere, no file says how it is asked, and the run does not know it.
    """
    from eyechart.probe import is_served

    modes, unprobed = [], []
    for mode in asked.modes:
        before = recorded(mode) if mode.spec in asked.by_option else None
        modes.append(before or mode)
        if mode.spec in asked.by_option and before is None and is_served(mode) and not no_probe:
            unprobed.append(mode.spec)
    return modes, unprobed


def require_room(unprobed: Sequence[str], *, max_calls: int | None, made: int, shard: str | None = None) -> None:
    """Raise SpecError where a run cannot probe: its limit is too small, or its shards would not ask alike."""
    from eyechart.errors import SpecError
    from eyechart.probe.pinning import MOST_CALLS

    names, most = ", ".join(unprobed), MOST_CALLS * len(unprobed)
    if shard is not None:
        raise SpecError(
            f"the shards of a run must ask alike: let 'eyechart probe' find a mode of {names} once, and give it to all "
            "of them with --mode, or use --no-probe"
        )
    if max_calls is not None and max_calls - made < most:
        raise SpecError(
            f"--max-calls {max_calls} leaves no room to probe {names}, which may take {most} calls: raise it, give a "
            "--mode file, or use --no-probe"
        )


def probe_each(
    modes: "Sequence[RequestMode]",
    unprobed: Sequence[str],
    sample: "Sample",
    given: Mapping[str, object],
    prices: "Prices",
    *,
    left: float | None,
) -> Probed:
    """Probe the models that are to be, and return how all of them are asked; one that cannot be probed is left out.

    ``left`` is how many US dollars may be spent on it, or None for any.
    """
    from eyechart.probe import ProbeError

    done = Probed([], {}, {})
    for mode in modes:
        if mode.spec not in unprobed:
            done.modes.append(mode)
            continue
        say(f"{mode.spec} is probed first, in at most 60 calls; --no-probe leaves that out")
        bound = None if left is None else max(0.0, left - sum(one.cost_usd for one in done.spent.values()))
        try:
            found = probe_one(mode, given, sample, prices, seed=draw_seed(None), max_cost=bound)
        except ProbeError as error:
            done.failed[mode.spec] = f"it cannot be probed: {error}"
            done.spent[mode.spec] = error.spent
            continue
        done.modes.append(found.mode)
        done.spent[mode.spec] = found.spent
        for line in lines_of(found):
            say(line)
        if found.sight.outcome == "blind":
            say(f"warning: {mode.spec} did not see the probe's pictures: guard 'picture' will mark its verdict")
    return done


@dataclass(frozen=True)
class Allowed:
    """What a command allows before its run: whether to probe at all, and the limits of the whole run."""

    no_probe: bool
    dry_run: bool
    max_calls: int | None
    max_cost: float | None
    shard: str | None = None


@dataclass(frozen=True)
class Study(Generic[P]):
    """A study as a probe before its run needs it: how it is planned, asked already, sampled, and paid for so far.

    ``keep`` writes into its folder what probes took whose models are left out, so that a limit holds over repeats.
    ``others`` says that something is run beside the models, which goes on where none of these can be probed.
    """

    plan: "Callable[[Sequence[RequestMode], Mapping[str, Spent]], P]"
    recorded: "Callable[[RequestMode], RequestMode | None]"
    sample: "Callable[[P], Sample]"
    spent: "Callable[[Prices], Spent]"
    keep: "Callable[[P, Mapping[str, Spent]], None]"
    others: bool = False


def plan_probed(
    asked: asking.Asked, study: Study[P], allowed: Allowed, prices: "Prices", fixed: Mapping[str, object] | None = None
) -> tuple[P, dict[str, str]]:
    """Plan a study, probe what is to be probed first, and plan it anew with what was found.

    Returns the plan, and why models were left out of it; exits 1 where none is left. Fields that are ``fixed``, and
    those that options give, are not changed by a probe.
    """
    modes, unprobed = to_probe(asked, study.recorded, no_probe=allowed.no_probe)
    planned = study.plan(modes, {})
    if unprobed and allowed.dry_run:
        say(f"not probed yet, so that nothing is known of its replies: {', '.join(unprobed)}")
    if not unprobed or allowed.dry_run:
        return planned, {}
    made = study.spent(prices)
    require_room(unprobed, max_calls=allowed.max_calls, made=made.calls, shard=allowed.shard)
    left = None if allowed.max_cost is None else max(0.0, allowed.max_cost - made.cost_usd)
    given = {**asked.given, **(fixed or {})}
    probed = probe_each(modes, unprobed, study.sample(planned), given, prices, left=left)
    if probed.failed:
        study.keep(planned, {spec: probed.spent[spec] for spec in probed.failed})
    if not probed.modes and not study.others:
        tell_none(probed.failed)
    found = {spec: one for spec, one in probed.spent.items() if spec not in probed.failed}
    return study.plan(probed.modes, found), probed.failed


def tell_none(failed: "Mapping[str, str]") -> NoReturn:
    """Say which models were not asked at all, and exit 1."""
    for spec, why in failed.items():
        say(f"set aside: {spec}: {why}")
    say("models that were set aside were not asked: mend what is wrong, and the same command asks them")
    raise typer.Exit(1)


def say_uncounted(outcome: "Outcome") -> None:
    """Say of how many attempts a bounded cost knows nothing: failed ones may have cost too."""
    if outcome.uncounted:
        say(f"{outcome.uncounted} attempts failed without telling what they cost: --max-cost does not count them")
