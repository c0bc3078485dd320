"""The record of an edit beside a table: how its control pictures were made, and their digests.

A bank of edited pictures is such a record of its own.
"""

import hashlib
from collections import Counter
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import msgspec

from eyechart.errors import BankError, SourceError, raising, text_file
from eyechart.frames import Provenance, open_bank, read_bank_manifest

RECORD = "edit.json"
"""The file of the record, in the folder of the table."""
_MANIFEST = "manifest.json"


class RefusedPicture(msgspec.Struct, frozen=True):
    """A control picture that was not made, and why."""

    file: str
    picture: str
    reason: str


class RecordedEdit(msgspec.Struct, frozen=True):
    """What an edit made: its method, counts by picture, refusals, and the SHA-256 of each file."""

    made: Literal["edited"]
    method: str
    parameters: dict[str, Any]
    pictures: dict[str, int]
    refused: tuple[RefusedPicture, ...]
    digests: dict[str, str]
    scales: dict[str, tuple[float, float]] = {}

    @property
    def name(self) -> str:
        """Return the name of the file that says so."""
        return RECORD

    def agreed(self, said: Provenance, table: Path) -> Provenance:
        """Return that its pictures are edited; raises SourceError if something else was ``said``."""
        if said not in {"", self.made}:
            raise SourceError(
                f"{table.parent / self.name} says that the control pictures are edited, and --made says {said}: "
                "leave out --made, or import the table of other pictures"
            )
        return self.made

    def makes(self, file: str) -> bool:
        """Return whether a picture, named from the record's folder, is a control picture of the edit."""
        return file in self.digests and file.partition("/")[0] in self.pictures

    def summary(self) -> dict[str, object]:
        """Return what a bank's manifest keeps, as plain JSON values; refusals are counts by picture."""
        refused = dict(sorted(Counter(one.picture for one in self.refused).items()))
        kept = {"method": self.method, "parameters": self.parameters, "pictures": self.pictures, "refused": refused}
        return {**kept, "scales": {name: list(ends) for name, ends in self.scales.items()}}

    def require_recorded(self, file: str, picture: bytes) -> None:
        """Raise SourceError unless a picture, named from the table's folder, is as the edit left it."""
        recorded = self.digests.get(file)
        if recorded is None:
            raise SourceError(f"'{file}' is no picture that {self.name} names; edit the photographs again")
        if recorded != hashlib.sha256(picture).hexdigest():
            raise SourceError(f"'{file}' is not the picture that {self.name} names: its SHA-256 differs")


class BankedEdit(RecordedEdit, frozen=True, kw_only=True):
    """An edit as a bank keeps it: the files of its control pictures, and the manifest's summary."""

    controls: frozenset[str]
    kept: dict[str, object]

    @property
    def name(self) -> str:
        """Return the name of the file that says so."""
        return _MANIFEST

    def makes(self, file: str) -> bool:
        """Return whether a picture, named from the bank's folder, is a control picture."""
        return file in self.controls

    def summary(self) -> dict[str, object]:
        """Return what the bank's manifest keeps."""
        return self.kept


def edit_above(place: Path, home: Path) -> tuple[str, RecordedEdit] | None:
    """Return a picture's name in the nearest record above it within ``home``, and the record; None without one."""
    for folder in place.parents:
        if not folder.is_relative_to(home):
            return None
        if (found := read_edit(folder)) is not None:
            return place.relative_to(folder).as_posix(), found
    return None


def read_edit(folder: Path) -> RecordedEdit | None:
    """Read the record in the folder of a table, else that of an edited bank there; None without one.

    Raises SourceError if it is damaged.
    """
    path, bank = folder / RECORD, folder / _MANIFEST
    if path.exists():
        return _read(path, path.stat().st_mtime_ns)
    return _banked(folder, bank.stat().st_mtime_ns) if bank.is_file() else None


@lru_cache(maxsize=4)
def _read(path: Path, changed: int) -> RecordedEdit:
    """Read a record that was ``changed`` then: it is asked for by each picture of its folder."""
    del changed
    with raising(SourceError, f"{path} is no record of an edit", of=(OSError, msgspec.MsgspecError, RecursionError)):
        return msgspec.json.decode(text_file(path).read_bytes(), type=RecordedEdit)


@lru_cache(maxsize=4)
def _banked(folder: Path, changed: int) -> RecordedEdit | None:
    """Return the record of a bank whose manifest ``changed`` then; None if its pictures are not edited."""
    del changed
    try:
        manifest = read_bank_manifest(folder)
    except BankError:  # another program's manifest
        return None
    if manifest.provenance != "edited":
        return None
    with raising(SourceError, f"{folder} is a bank of edited pictures that cannot be read", of=BankError):
        bank = open_bank(folder)
    controls = frozenset(file for frame in bank for many in frame.counterfactuals.values() for file in many.values())
    digests, kept = dict(manifest.images), dict(manifest.edit)
    return BankedEdit("edited", "", {}, {}, (), digests, controls=controls, kept=kept)
