"""A loss that somebody accepts: the counter of a ledger says so from then on, and a run goes on without it."""

from pathlib import Path

from eyechart.errors import LedgerError
from eyechart.ledger.counter import NOTHING, Count, Written, read_counter, write_counter
from eyechart.ledger.ledger import Ledger
from eyechart.ledger.schema import is_bare


def accept_loss(path: Path) -> Written:
    """Accept that rows that were written to a ledger are missing from it; return how many.

    A ledger that holds no table, or is not there, has lost all of them: what is left of it is kept under another name,
    and a run makes a new one. Nobody else may write to it meanwhile. Raises LedgerError where it is damaged.
    """
    count, held, empty = read_counter(path), NOTHING, not path.exists() or is_bare(path)
    if not empty:
        with Ledger(path, accepting=True) as ledger:
            held = ledger.held()
    lost = count.expected.without(held)
    if empty:
        _set_aside(path)
    if any(lost):
        write_counter(path, Count(held, count.lost.plus(lost)))
    return lost


def _set_aside(path: Path) -> None:
    """Give what is left of a ledger, and its log, which SQLite would take for a new one's, other names."""
    for one in (path, path.with_name(f"{path.name}-wal")):
        if one.exists():
            kept = one.with_name(f"{one.name}.lost.bak")
            if kept.exists() and kept.stat().st_size:
                raise LedgerError(f"{kept} is in the way of what is left of a ledger: give it another name")
            one.replace(kept)
    path.with_name(f"{path.name}-shm").unlink(missing_ok=True)
