"""Probes of remote models without a mode file: once, before the run that uses the modes found."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from eyechart import episodes
from eyechart.calls import UNASKED, Reply
from eyechart.episodes import EpisodesManifest
from eyechart.errors import SpecError
from eyechart.ledger import Ledger, accept_loss
from eyechart.ledger.counter import WrittenCounts
from eyechart.limits import Usage
from eyechart.manifest import LEDGER, RunManifest, alone_in, is_run, read_manifest
from eyechart.models import find_mode
from eyechart.models.prices import Prices
from eyechart.modes import RequestMode, mode_of
from eyechart.planned_run import PlannedRun, RunAllowance
from eyechart.studies import is_episodes

if TYPE_CHECKING:  # reading the costs of a run needs no probe
    from eyechart.probe import ProbeError, ProbeResult, Sample

PROBED = ("token_field", "max_tokens", "structured", "temperature", "seed", "system", "stream")
"""The mode fields that a probe may set, unless an option did."""

_LEDGERS = ("", "*/", "*/*/")
"""The places of a run's ledgers in its folder: a study of prompts has one per cell."""

P = TypeVar("P", bound=PlannedRun)
"""The plan of a study."""

Ask = Callable[[RequestMode, "Sample", float | None, Callable[[Usage], None]], "ProbeResult | ProbeError"]
"""Probes a model with a sample, for at most so many US dollars, and reports the spending.

Returns a ProbeError to leave the model out.
"""


@dataclass(frozen=True)
class RunModes:
    """The modes of a run's models; ``by_option`` names models without a mode file.

    ``given`` are the fields that the options set.
    """

    modes: Sequence[RequestMode]
    by_option: frozenset[str]
    given: Mapping[str, object]


def read_modes(
    specs: Sequence[str] | None,
    files: Sequence[Path] | None,
    given: Mapping[str, object],
    tell: Callable[[str], None] = lambda _: None,
) -> RunModes:
    """Return the request modes of a command: from its files, and from options for all other SPECs.

    Raises SpecError if two files are for one model, or options would apply to no model.
    """
    by_file: dict[str, RequestMode] = {}
    for file in files or ():
        mode = find_mode(file)
        if mode.about.get("tested") == "no" and mode.measured is None:
            then = f"'eyechart probe {file} --out FILE.toml' tries it"
            tell(f"note: the mode {file} of {mode.spec} was never tried; {then}")
        if mode.spec in by_file:
            raise SpecError(f"{file}: another --mode is for '{mode.spec}' too: give one of them")
        by_file[mode.spec] = mode
    names = list(dict.fromkeys([*(specs or ()), *by_file]))
    rest = [spec for spec in names if spec not in by_file]
    if given and not rest:
        raise SpecError(
            f"{', '.join(given)} would change no model: those with a --mode file are asked as the file says"
        )
    by_option = {spec: mode_of(spec, given) for spec in rest}
    return RunModes([by_file.get(spec) or by_option[spec] for spec in names], frozenset(rest), given)


NOBODY = RunModes((), frozenset(), {})
"""The modes of a run without models."""


@dataclass(frozen=True)
class Planner(Generic[P]):
    """How a study plans a run of models, and the ``runs`` that may exist already.

    ``others`` is set where something besides the models is run. With ``whole``, a recorded mode
    counts only if its replies were measured.
    """

    plan: Callable[[Sequence[RequestMode]], P]
    runs: Sequence[Path]
    others: bool = False
    whole: bool = False


def plan_probed(
    study: Planner[P],
    run_modes: RunModes,
    allowed: RunAllowance,
    ask: Ask,
    tell: Callable[[str], None] = lambda _: None,
) -> tuple[P | None, dict[str, str]]:
    """Plan a study, probe the models that need it, and plan again with the modes found.

    Returns the plan (None where no model is left), and why each left-out model was left out. A
    model is probed if it is served elsewhere, has no mode file, and no run of the study knows it.
    The cost of a probe is recorded in the run before its calls come back, so a killed process loses
    nothing. Raises SpecError where the limits leave no room for a probe.
    """
    if allowed.moved and not allowed.dry_run:
        move(study.runs, run_modes.modes)
    modes, unprobed = _known(study, run_modes, allowed)
    planned = study.plan(modes)
    if not unprobed:
        return planned, {}
    if allowed.dry_run:
        tell(f"not probed yet, so that nothing is known of its replies: {', '.join(unprobed)}")
        return planned, {}
    allowed.require_room(unprobed, usage := spent_on(study.runs, allowed.prices))
    found = _found(planned, [mode for mode in modes if mode.spec in unprobed], ask, allowed, usage.cost_usd)
    why = {spec: f"it cannot be probed: {one}" for spec, one in found.items() if not isinstance(one, RequestMode)}
    pinned = [one for mode in modes if isinstance(one := found.get(mode.spec, mode), RequestMode)]
    return (study.plan(pinned) if pinned or study.others else None), why


def _found(
    planned: PlannedRun, unprobed: Sequence[RequestMode], ask: Ask, allowed: RunAllowance, cost: float
) -> "dict[str, RequestMode | ProbeError]":
    """Probe models one after another; return their modes or errors. ``cost`` was spent before."""
    from eyechart.probe import ProbeError  # noqa: PLC0415 - reading the costs of a run needs no probe

    result: dict[str, RequestMode | ProbeError] = {}
    sample = replace(planned.sample(), at_once=allowed.concurrency)
    keeper = planned.keeper
    with alone_in(keeper.out):
        begun, took = keeper.begin(), dict[str, Usage]()
        for mode in unprobed:

            def spend(spent: Usage, spec: str = mode.spec) -> None:
                took[spec] = spent
                begun.counting(took).write(keeper.out)

            most = None if allowed.max_cost is None else max(0.0, allowed.max_cost - cost)
            one = ask(mode, sample, most, spend)
            cost += one.spent.cost_usd
            result[mode.spec] = one if isinstance(one, ProbeError) else one.mode
    return result


def _known(study: Planner[P], run_modes: RunModes, allowed: RunAllowance) -> tuple[list[RequestMode], list[str]]:
    """Return the modes, as the runs know them, and the models that must be probed first."""
    from eyechart.probe import is_served  # noqa: PLC0415 - reading the costs of a run needs no probe

    modes, unprobed = [], []
    for mode in run_modes.modes:
        before = (
            recorded(study.runs, mode, run_modes.given, whole=study.whole) if mode.spec in run_modes.by_option else None
        )
        modes.append(before or mode)
        if mode.spec in run_modes.by_option and before is None and is_served(mode) and not allowed.no_probe:
            unprobed.append(mode.spec)
    return modes, unprobed


def recorded(
    runs: Iterable[Path], mode: RequestMode, given: Collection[str], *, whole: bool = False
) -> RequestMode | None:
    """Return the mode that one of these runs uses for a model, preferably one as probed; else None.

    Fields that a probe set are taken from the run's manifest, unless they are ``given`` now.
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
    """Record in the runs already begun that their models have the addresses of these modes now."""
    for run in runs:
        if is_run(run):
            with alone_in(run):
                manifest_of(run).moved(modes).write(run)


def accept_losses(out: Path) -> Iterator[tuple[Path, WrittenCounts]]:
    """Accept that calls are missing under ``out``; yield each ledger that lacks some, and how many.

    Raises LedgerError where a ledger is damaged, or another process writes to it.
    """
    found = {path.with_name(LEDGER) for where in _LEDGERS for path in out.glob(f"{where}{LEDGER}*")}
    for ledger in sorted(found):
        with alone_in(ledger.parent):
            lost = accept_loss(ledger)
        if any(lost):
            yield ledger, lost


def spent_on(runs: Iterable[Path], prices: Prices) -> Usage:
    """Return the cost of the calls and probes of these runs so far; a run not begun counts 0."""
    return Usage.together(spent(run, manifest_of(run), prices) for run in runs if is_run(run))


def beside(runs: Iterable[Path], part: PlannedRun, how: RunAllowance) -> RunAllowance:
    """Return the limits of one ``part``, where limits bound all of a study's runs together."""
    bounded = (how.max_calls, how.max_cost) != (None, None)
    return replace(how, before=spent_on((run for run in runs if bounded and run != part.out), how.prices))


def spent(run: Path, manifest: RunManifest | EpisodesManifest, prices: Prices) -> Usage:
    """Return the cost of a run's probes and attempts; an unknown outcome has no known cost."""
    made = manifest.spent_before()
    with Ledger(run / LEDGER, absent=True) as ledger:
        for spec in manifest.models:
            for attempt in ledger.attempts(spec):
                if attempt.reply is None or attempt.reply.error not in UNASKED:  # UNASKED attempts were never sent
                    cost = None if attempt.reply is None else prices.cost(manifest.mode(spec), attempt.reply)[0]
                    made = made.plus(attempt.reply or Reply(), cost)
    return made


def manifest_of(run: Path) -> RunManifest | EpisodesManifest:
    """Read the manifest of a run, of frames or of episodes; raises LedgerError where it is none."""
    return episodes.read_manifest(run) if is_episodes(run) else read_manifest(run)
