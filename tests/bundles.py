"""Bundles that were changed by somebody who mended every digest of a file, for the tests of what a validation finds."""

import hashlib
import json
import re
import sqlite3
import zipfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from eyechart.ledger import schema
from eyechart.ledger.rows import checksum

Change = Callable[[Path], None]


def repacked(packed: Path, folder: Path, change: Change) -> Path:
    """Return a bundle after a change, whose author has mended every digest of a file."""
    unpacked, out = folder / "open", folder / "changed.zip"
    with zipfile.ZipFile(packed) as file:
        file.extractall(unpacked)
    change(unpacked)
    index = json.loads((unpacked / "bundle.json").read_text())
    names = [path.relative_to(unpacked).as_posix() for path in sorted(unpacked.rglob("*")) if path.is_file()]
    digests = {name: hashlib.sha256((unpacked / name).read_bytes()).hexdigest() for name in names}
    index["files"] = {name: digest for name, digest in digests.items() if name != "bundle.json"}
    (unpacked / "bundle.json").write_text(json.dumps(index))
    with zipfile.ZipFile(out, "w") as file:
        for name in names:
            file.write(unpacked / name, name)
    return out


def edited(name: str, pattern: str, new: str) -> Change:
    """Return a change of what a file first has of a pattern, which has to be there."""

    def change(folder: Path) -> None:
        text, count = re.subn(pattern, new, (folder / name).read_text(), count=1)
        assert count == 1
        (folder / name).write_text(text)

    return change


def in_results(change: Callable[[Any], None]) -> Change:
    """Return a change of what the results print."""

    def apply(folder: Path) -> None:
        values = json.loads((folder / "results.json").read_text())
        change(values)
        (folder / "results.json").write_text(json.dumps(values, indent=1, ensure_ascii=False) + "\n")

    return apply


def checked(ledger: sqlite3.Connection) -> None:
    """Give every reply of a ledger without triggers the checksum of what it says, as whoever means harm can."""
    rows = ledger.execute(schema._EVERY_ROW).fetchall()
    digests = [(checksum(row[schema._BEFORE :]), row[0]) for row in rows]
    ledger.executemany("UPDATE replies SET row_sha256 = ? WHERE attempt = ?", digests)


@contextmanager
def opened_ledger(folder: Path) -> Iterator[sqlite3.Connection]:
    """Yield the ledger of an open bundle without its triggers, which are put back at the end."""
    with closing(sqlite3.connect(folder / "run" / "ledger.sqlite")) as ledger:
        triggers = [row[0] for row in ledger.execute("SELECT sql FROM sqlite_master WHERE type = 'trigger'")]
        for trigger in triggers:
            ledger.execute(f"DROP TRIGGER {trigger.split()[2]}")
        yield ledger
        for trigger in triggers:
            ledger.execute(trigger)
        ledger.commit()
