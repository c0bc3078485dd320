"""Drives as a study, and what studies whose runs are drives share."""

from pathlib import Path

from eyechart import episodes
from eyechart.costs import Book
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.models.prices import Prices
from eyechart.studies import Reading, S, Study, Took
from eyechart.studies.closed_loop.scoring import ClosedLoopScore, score
from eyechart.studies.probed import is_episodes

_DRIVES = "holds drives, which are compared world by world: use 'eyechart score'"
NO_LEDGER = {
    **dict.fromkeys(("verdict", "compare", "transfer", "gate"), _DRIVES),
    "bundle": "holds drives, and no bundle holds runs of episodes; 'eyechart report' shows all of them in one file",
}
"""What is refused of drives, which a ledger does not hold, and why."""


class OfEpisodes(Study[S]):
    """A study whose runs are drives."""

    refuses = NO_LEDGER

    def took_run(self, run: Path, prices: Prices) -> Took:
        manifest = episodes.read_manifest(run)
        found = Took(probes=dict(manifest.probes))
        if (run / LEDGER).is_file():
            with Ledger(run / LEDGER) as ledger:
                for spec in manifest.models:
                    book = Book(manifest.mode(spec), manifest.prompt.asks(manifest.action_space), prices)
                    for one in ledger.attempts(spec):
                        book.add(one)
                    found.accounts[spec] = book.accounts()
        return found


class ClosedLoop(OfEpisodes[ClosedLoopScore]):
    """Policies and models that drive."""

    def holds(self, folder: Path) -> bool:
        return is_episodes(folder)

    def score(self, folder: Path, reading: Reading) -> ClosedLoopScore:
        return score(folder, against_policy=reading.against)
