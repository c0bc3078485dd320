"""How a run asks a model already, so that its rest is asked alike, and what a probe before a run should ask."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from filelock import FileLock, Timeout

from eyechart.calls import Reply
from eyechart.conditions import show
from eyechart.errors import LedgerError
from eyechart.ledger import Ledger
from eyechart.limits import Spent, added
from eyechart.manifest import LEDGER, is_run, read_manifest, write_run
from eyechart.models.prices import Prices
from eyechart.modes import RequestMode
from eyechart.perception.view import through
from eyechart.probe import Sample
from eyechart.run import spread
from eyechart.studies.battery.planning import Battery

PROBED = ("token_field", "max_tokens", "structured", "temperature", "seed")
"""The fields of a mode that a probe may set, where no option did."""

_PICTURES = 5


def as_recorded(out: Path, mode: RequestMode, given: Collection[str]) -> RequestMode | None:
    """Return the mode in which a run in ``out`` asks this model, changed by the options ``given``; None if it asks not.

    Fields that a probe set before the run are taken from its manifest, unless they are given now.
    """
    if not is_run(out):
        return None
    manifest = read_manifest(out)
    if mode.spec not in manifest.models:
        return None
    return as_probed(manifest.mode(mode.spec), mode, given)


def as_probed(before: RequestMode, mode: RequestMode, given: Collection[str]) -> RequestMode:
    """Return a mode with what a probe set and measured in an earlier one; the fields ``given`` now stay as they are."""
    if before.measured is None:
        return mode
    kept = {name: getattr(before, name) for name in PROBED if name not in given}
    return replace(mode, measured=before.measured, **kept)


def sample_of(planned: Iterable[Battery]) -> Sample:
    """Return what batteries of one bank will ask: a few of their pictures, with the words of each battery in turn.

    Pictures are shown through the view of the first.
    """
    held = list(planned)
    plan = held[0].plan
    asked = []
    for number, frame in enumerate(spread(plan.frames, max(_PICTURES, len(held)))):
        seen = through(plan.view, show("real", frame, plan.bank, plan.seed), frame.id)
        asked.append((held[number % len(held)].plan.prompt, seen))
    return Sample(asked, plan.bank.manifest.action_space)


def spent_on(out: Path, prices: Prices) -> Spent:
    """Return what the calls and the probes of a run took so far; nothing where there is no run yet."""
    if not is_run(out):
        return Spent()
    manifest = read_manifest(out)
    made = manifest.spent_before()
    if (out / LEDGER).is_file():
        with Ledger(out / LEDGER) as ledger:
            for spec in manifest.models:
                for one in ledger.attempts(spec):
                    reply = one.reply or Reply()
                    made = made.plus(reply, None if one.reply is None else prices.cost(manifest.mode(spec), reply)[0])
    return made


def keep_probes(battery: Battery, probes: Mapping[str, Spent]) -> None:
    """Write into the run's manifest what was spent on probing models that are not asked; the run's limits count it.

    A run that is not begun yet begins without a model, so that they are probed anew.
    """
    battery.out.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(battery.out / ".lock", timeout=0):
            manifest = replace(battery.manifest, models={}, modes={}, facts={})
            if is_run(battery.out):
                manifest = read_manifest(battery.out)
            known = {**manifest.probes, **added(manifest.probes, probes)}
            write_run(battery.out, replace(manifest, probes=known), battery.plan.bank)
    except Timeout as error:
        raise LedgerError(
            f"another process is writing to {battery.out}; wait for it, or choose another --out"
        ) from error
