"""Remote models without a mode file are probed before a run, once; its rest is asked in the mode that it recorded."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from eyechart import episodes
from eyechart.calls import UNASKED, Reply
from eyechart.episodes import EpisodesManifest
from eyechart.ledger import Ledger, accept_loss
from eyechart.ledger.counter import Written
from eyechart.limits import Spent
from eyechart.manifest import LEDGER, RunManifest, alone_in, is_run, read_manifest
from eyechart.models.prices import Prices
from eyechart.modes import RequestMode
from eyechart.planned import Allowed, Planned
from eyechart.studies import is_episodes

if TYPE_CHECKING:  # who reads what a run took probes nothing
    from eyechart.probe import Found, ProbeError, Sample

PROBED = ("token_field", "max_tokens", "structured", "temperature", "seed", "system", "stream")
"""The fields of a mode that a probe may set, where no option did."""

_LEDGERS = ("", "*/", "*/*/")
"""Where the ledgers of a run stand in its folder: a study of prompts has one a cell."""

P = TypeVar("P", bound=Planned)
"""A study's plan."""

Ask = Callable[[RequestMode, "Sample", float | None, Callable[[Spent], None]], "Found | ProbeError"]
"""Probes a model with a sample for at most so many US dollars; what that takes is told as it is spent.

A ProbeError that is returned leaves the model out.
"""


@dataclass(frozen=True)
class Asked:
    """The modes of a run's models. ``by_option`` names those that no file gave, ``given`` what the options set."""

    modes: Sequence[RequestMode]
    by_option: frozenset[str]
    given: Mapping[str, object]


NOBODY = Asked((), frozenset(), {})
"""Of a run without models."""


@dataclass(frozen=True)
class Planner(Generic[P]):
    """How a study plans a run of models, and the ``runs`` that may be there already.

    ``others`` says that something is run beside the models, ``whole`` that modes without measured replies do not count.
    """

    plan: Callable[[Sequence[RequestMode]], P]
    runs: Sequence[Path]
    others: bool = False
    whole: bool = False


def plan_probed(
    study: Planner[P], asked: Asked, allowed: Allowed, ask: Ask, tell: Callable[[str], None] = lambda _: None
) -> tuple[P | None, dict[str, str]]:
    """Plan a study, probe what is to be probed first, and plan it anew with what was found.

    Returns the plan, None where no model is left to ask, and why models were left out of it. A model is probed where it
    is served elsewhere, no file says how it is asked, and no run of the study knows it. What a probe takes is in the
    run before its calls come back, so that no end of this process loses it. Raises SpecError where there is no room for
    a probe.
    """
    if allowed.moved and not allowed.dry_run:
        move(study.runs, asked.modes)
    modes, unprobed = _known(study, asked, allowed)
    planned = study.plan(modes)
    if not unprobed:
        return planned, {}
    if allowed.dry_run:
        tell(f"not probed yet, so that nothing is known of its replies: {', '.join(unprobed)}")
        return planned, {}
    allowed.require_room(unprobed, made := spent_on(study.runs, allowed.prices))
    found = _found(planned, [one for one in modes if one.spec in unprobed], ask, allowed, made.cost_usd)
    why = {spec: f"it cannot be probed: {one}" for spec, one in found.items() if not isinstance(one, RequestMode)}
    pinned = [one for mode in modes if isinstance(one := found.get(mode.spec, mode), RequestMode)]
    return (study.plan(pinned) if pinned or study.others else None), why


def _found(
    planned: Planned, unprobed: Sequence[RequestMode], ask: Ask, allowed: Allowed, cost: float
) -> "dict[str, RequestMode | ProbeError]":
    """Probe models one after another; return the mode of each, or why it has none. ``cost`` was spent before."""
    from eyechart.probe import ProbeError  # noqa: PLC0415 - who reads what a run took probes nothing

    found: dict[str, RequestMode | ProbeError] = {}
    sample = replace(planned.sample(), at_once=allowed.concurrency)
    keeper = planned.keeper
    with alone_in(keeper.out):
        begun, took = keeper.begin(), dict[str, Spent]()
        for mode in unprobed:

            def spend(spent: Spent, spec: str = mode.spec) -> None:
                took[spec] = spent
                begun.counting(took).write(keeper.out)

            most = None if allowed.max_cost is None else max(0.0, allowed.max_cost - cost)
            one = ask(mode, sample, most, spend)
            cost += one.spent.cost_usd
            found[mode.spec] = one if isinstance(one, ProbeError) else one.mode
    return found


def _known(study: Planner[P], asked: Asked, allowed: Allowed) -> tuple[list[RequestMode], list[str]]:
    """Return the modes that were asked for, as the runs know them, and the models that are to be probed first."""
    from eyechart.probe import is_served  # noqa: PLC0415 - who reads what a run took probes nothing

    modes, unprobed = [], []
    for mode in asked.modes:
        before = recorded(study.runs, mode, asked.given, whole=study.whole) if mode.spec in asked.by_option else None
        modes.append(before or mode)
        if mode.spec in asked.by_option and before is None and is_served(mode) and not allowed.no_probe:
            unprobed.append(mode.spec)
    return modes, unprobed


def recorded(
    runs: Iterable[Path], mode: RequestMode, given: Collection[str], *, whole: bool = False
) -> RequestMode | None:
    """Return the mode in which one of these runs asks a model already, one as it was probed first; None if none does.

    Fields that a probe set before the run are taken from its manifest, unless they are ``given`` now.
    """
    found = []
    for run in runs:
        if is_run(run) and mode.spec in (manifest := manifest_of(run)).models:
            before = manifest.mode(mode.spec)
            kept = {name: getattr(before, name) for name in PROBED if name not in given}
            found.append(mode if before.measured is None else replace(mode, measured=before.measured, **kept))
    measured = [one for one in found if one.measured is None or one.measured.seconds is not None]
    return next(iter([*measured, *(() if whole else found)]), None)


def move(runs: Iterable[Path], modes: Sequence[RequestMode]) -> None:
    """Record in runs that are begun that their models are now asked at the addresses of these modes."""
    for run in runs:
        if is_run(run):
            with alone_in(run):
                manifest_of(run).moved(modes).write(run)


def accept_losses(out: Path) -> Iterator[tuple[Path, Written]]:
    """Accept that calls are missing from what ``out`` holds; yield each ledger that lacks some, and how many.

    Raises LedgerError where a ledger is damaged, or another process writes to it.
    """
    found = {one.with_name(LEDGER) for where in _LEDGERS for one in out.glob(f"{where}{LEDGER}*")}
    for ledger in sorted(found):
        with alone_in(ledger.parent):
            lost = accept_loss(ledger)
        if any(lost):
            yield ledger, lost


def spent_on(runs: Iterable[Path], prices: Prices) -> Spent:
    """Return what the calls and the probes of these runs took so far; nothing for those that are not begun."""
    return Spent.together(spent(run, manifest_of(run), prices) for run in runs if is_run(run))


def beside(runs: Iterable[Path], part: Planned, how: Allowed) -> Allowed:
    """Return how one of a study's ``runs`` may be made, where limits bound all of them together, planned now or not."""
    bounded = (how.max_calls, how.max_cost) != (None, None)
    return replace(how, before=spent_on((one for one in runs if bounded and one != part.out), how.prices))


def spent(run: Path, manifest: RunManifest | EpisodesManifest, prices: Prices) -> Spent:
    """Return what a run's probes and the attempts in its ledger took; one of unknown outcome has no known cost."""
    made = manifest.spent_before()
    with Ledger(run / LEDGER, absent=True) as ledger:
        for spec in manifest.models:
            for one in ledger.attempts(spec):
                if one.reply is None or one.reply.error not in UNASKED:  # which never went out
                    cost = None if one.reply is None else prices.cost(manifest.mode(spec), one.reply)[0]
                    made = made.plus(one.reply or Reply(), cost)
    return made


def manifest_of(run: Path) -> RunManifest | EpisodesManifest:
    """Read the manifest of a run, of frames or of episodes; raises LedgerError where it is none."""
    return episodes.read_manifest(run) if is_episodes(run) else read_manifest(run)
