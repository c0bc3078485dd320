"""Votes are read for the commands of a guardian: from the folders of runs, or from tables."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eyechart.studies.guardian import Frozen, VoteTable


def read(
    votes: "Sequence[Path]",
    frames: Path | None,
    hazard: str,
    about: Path | None,
    columns: list[str] | None,
    *,
    reread: bool = False,
) -> "VoteTable":
    """Read the votes of runs and tables as one table; ``frames`` is their bank."""
    from eyechart.studies.guardian import join

    return join([_read_one(one, frames, hazard, about, columns, reread=reread) for one in votes])


def _read_one(
    votes: Path, frames: Path | None, hazard: str, about: Path | None, columns: list[str] | None, *, reread: bool
) -> "VoteTable":
    from eyechart.errors import VoteError
    from eyechart.frames import open_bank
    from eyechart.studies.guardian import read_votes, votes_of_run

    if not votes.exists():
        raise VoteError(f"{votes} does not exist: give the folder of a run of scene estimates, or a table of votes")
    bank = None if frames is None else open_bank(frames)
    if votes.is_dir():
        if about is not None or columns:
            raise VoteError(
                f"{votes} is a run, which says itself how its votes came about: leave out --about and --map"
            )
        _require_run(votes)
        table = votes_of_run(votes, hazard=hazard, reread=reread)
        if bank is not None and bank.manifest.fingerprint != table.about.bank:
            raise VoteError(
                f"{votes} is a run on the bank {table.about.bank_name}, and {frames} is another one: the bank differs; "
                "give its own to --frames, or leave that out"
            )
        return table
    named = {}
    for one in columns or ():
        role, sign, column = one.partition("=")
        if not sign or not column:
            raise VoteError(f"--map is given as ROLE=COLUMN; got '{one[:40]}'")
        named[role] = column
    return read_votes(votes, bank=bank, about=about, columns=named, hazard=hazard)


def _require_run(folder: Path) -> None:
    """Raise VoteError where a folder is no run, and say what is missing where it is a bank."""
    from eyechart.errors import BankError, VoteError
    from eyechart.frames import open_bank
    from eyechart.manifest import is_run

    if is_run(folder):
        return
    try:
        open_bank(folder)
    except BankError:
        return  # what reads the run says what is wrong with it
    raise VoteError(
        f"{folder} is a bank, which holds no votes: ask models with 'eyechart run admission --frames {folder}' or "
        f"'eyechart run structured --frames {folder}', and give the run's folder"
    )


def ids_of(path: Path) -> list[str]:
    """Read ids of frames, one a line."""
    from eyechart.errors import VoteError

    try:
        return [line.strip() for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip()]
    except (OSError, ValueError) as error:
        raise VoteError(f"{path} is no list of frame ids, one a line: {error}") from error


def left(table: "VoteTable", frozen: "Frozen", *, unseen: bool) -> "VoteTable":
    """Return what of a table a guardian is scored on, without the frames that chose it where these are ``unseen``."""
    from eyechart.errors import GuardianError

    if not unseen:
        return table
    kept = frozen.unseen(table)
    if table.frames and not kept.frames:
        raise GuardianError(
            f"all {len(table.frames)} frames of {table.name} chose this guardian, so none is left to score: give votes "
            "on other frames, as 'eyechart run structured' asks for"
        )
    return kept


def part(table: "VoteTable", name: str) -> "VoteTable":
    """Return the rows that a table's column ``split`` gives to a part, or all where it has no such column."""
    return table if table.split is None else table.part(name)
