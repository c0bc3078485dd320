"""How runs of episodes ask a model already, so that their rest is asked alike, and what a probe before them asks."""

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from eyechart.calls import Reply
from eyechart.costs import Account, Book
from eyechart.episodes import Episodes, first_shown, read_manifest
from eyechart.ledger import Ledger
from eyechart.limits import Spent, added
from eyechart.manifest import LEDGER, is_run
from eyechart.models.prices import Prices
from eyechart.modes import RequestMode
from eyechart.probe import Sample
from eyechart.studies.battery import as_probed

_PICTURES = 3


def as_recorded(runs: Iterable[Path], mode: RequestMode, given: Collection[str]) -> RequestMode | None:
    """Return the mode in which the first of these runs that knows a model asks it; None where none of them does.

    Fields that a probe set before the run are taken from its manifest, unless they are ``given`` now.
    """
    for out in runs:
        if is_run(out) and mode.spec in (manifest := read_manifest(out)).models:
            return as_probed(manifest.mode(mode.spec), mode, given)
    return None


def sample_of(planned: Episodes) -> Sample:
    """Return what a run of episodes will ask: its words, with the first picture of each of its first worlds.

    Raises SpecError where no world shows a picture.
    """
    drivers = planned.drivers
    return Sample([(drivers.prompt, seen) for seen in first_shown(planned, _PICTURES)], drivers.space)


def spent_on(runs: Iterable[Path], prices: Prices) -> Spent:
    """Return what the calls and the probes of these runs took so far; nothing for those that are not begun."""
    made = Spent()
    for out in runs:
        if is_run(out):
            manifest = read_manifest(out)
            made = Spent.together([made, manifest.spent_before()])
            if (out / LEDGER).is_file():
                with Ledger(out / LEDGER) as ledger:
                    for spec in manifest.models:
                        for one in ledger.attempts(spec):
                            cost = None if one.reply is None else prices.cost(manifest.mode(spec), one.reply)[0]
                            made = made.plus(one.reply or Reply(), cost)
    return made


def took(runs: Mapping[str, Path], *, prices: Prices) -> tuple[dict[str, dict[str, Account]], dict[str, Spent]]:
    """Return what the calls of these runs took by model and condition, and what probing each model took.

    ``runs`` are the folders by name; one that stands alone has none: ``""``.
    """
    found: dict[str, dict[str, Account]] = {}
    probes: dict[str, Spent] = {}
    for name, out in runs.items():
        manifest = read_manifest(out)
        probes |= added(probes, manifest.probes)
        if not (out / LEDGER).is_file():
            continue
        with Ledger(out / LEDGER) as ledger:
            for spec in manifest.models:
                book = Book(manifest.mode(spec), manifest.action_space, prices, scene=manifest.prompt.scene)
                for one in ledger.attempts(spec):
                    book.add(one)
                found[f"{spec} in {name}" if name else spec] = book.accounts()
    return found, probes
