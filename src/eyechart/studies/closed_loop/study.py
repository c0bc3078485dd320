"""Drives as a study, and what studies whose runs are drives share."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from eyechart import episodes
from eyechart.costs import Book
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.models.prices import Prices
from eyechart.studies import Made, Reading, S, Study, Tell, Took
from eyechart.studies.closed_loop.scoring import ClosedLoopScore, score
from eyechart.studies.probed import is_episodes

if TYPE_CHECKING:
    from eyechart.report.table import Table

NO_LEDGER = {
    **dict.fromkeys(
        ("verdict", "compare", "transfer", "gate"),
        "holds drives, which are compared world by world: use 'eyechart score'",
    ),
    "bundle": "holds drives, and no bundle holds runs of episodes; 'eyechart report' shows all of them in one file",
}
"""What is refused of drives, which no ledger holds, and why."""


class OfEpisodes(Study[S]):
    """A study whose runs are drives."""

    runs_are = "drives"
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

    def report(self, runs: Sequence[Path], banks: Sequence[Path], reading: Reading, tell: Tell) -> Made:
        from eyechart.studies.closed_loop.page import make_drives_page
        from eyechart.studies.closed_loop.tables import tables_of

        del banks
        tell("scoring")
        scored = score(runs, against_policy=reading.against)
        more = self.beside_drives(runs)
        page = make_drives_page(runs, scored, more, tell=tell)
        return Made(page, [*tables_of(scored), *more], page.notes)

    def beside_drives(self, runs: Sequence[Path]) -> "Sequence[Table]":
        """Return what a study tells of its runs beside the drives; nothing where they are all."""
        del runs
        return ()


class ClosedLoop(OfEpisodes[ClosedLoopScore]):
    """Policies and models that drive."""

    def holds(self, folder: Path) -> bool:
        return is_episodes(folder)

    def score(self, folder: Path, reading: Reading) -> ClosedLoopScore:
        return score(folder, against_policy=reading.against)

    def printed(self, score: ClosedLoopScore) -> "Iterator[Table | str]":
        from eyechart.studies.closed_loop import tables

        yield from tables.ladder_printed(score)
        yield from tables.unfinished_words(score.unfinished)
        if score.blind:
            yield tables.blind_table(score.blind)
            yield from (one.sentence for one in score.blind)
        yield from tables.audit_printed(score)
        yield from tables.long_tables(score)
