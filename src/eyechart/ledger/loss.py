"""Accept a ledger's loss: its counter records it, and the run continues."""

from pathlib import Path

from eyechart.errors import LedgerError
from eyechart.ledger.counter import NOTHING, LedgerCount, WrittenCounts, read_counter, write_counter
from eyechart.ledger.ledger import Ledger
from eyechart.ledger.schema import is_bare


def accept_loss(path: Path) -> WrittenCounts:
    """Accept that written rows of a ledger are missing; return how many.

    A ledger that is absent or holds no table has lost all rows; its remains get another name, and a
    run makes a new one. No other process may write to it meanwhile. Raises LedgerError if it is
    damaged.
    """
    count, held, empty = read_counter(path), NOTHING, not path.exists() or is_bare(path)
    if not empty:
        with Ledger(path, accepting=True) as ledger:
            held = ledger.held()
    lost = count.expected.without(held)
    if empty:
        _set_aside(path)
    if any(lost):
        write_counter(path, LedgerCount(held, count.lost.plus(lost)))
    return lost


def _set_aside(path: Path) -> None:
    """Rename the remains of a ledger, and its log, which SQLite would take for a new ledger's."""
    for one in (path, path.with_name(f"{path.name}-wal")):
        if one.exists():
            kept = one.with_name(f"{one.name}.lost.bak")
            if kept.exists() and kept.stat().st_size:
                raise LedgerError(f"{kept} exists, but the remains of the ledger need this name: rename it")
            one.replace(kept)
    path.with_name(f"{path.name}-shm").unlink(missing_ok=True)
