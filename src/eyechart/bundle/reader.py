"""Unpack an untrusted file: only plain files, of bounded size, into the given folder only."""

import errno
import re
import shutil
import stat
import struct
import zipfile
import zlib
from pathlib import Path, PurePosixPath
from typing import IO

from eyechart.errors import BundleError
from eyechart.frames import MAX_IMAGE_BYTES

MOST_FILES = 250_000
MOST_BYTES = 4_000_000_000
"""The most bytes of all files together, unpacked."""
MOST_TEXT = 500_000_000
"""The most bytes of a file that is neither a picture nor the ledger."""
MOST_LEDGER = 3_000_000_000
MOST_METADATA = 128_000_000
"""The most bytes of the text of a bank's frames."""
_MOST_JSON = 64_000_000
_AN_ENTRY = 1_000
"""Bytes in a bundle's index for each of its files."""
FAR = 64_000_000
MOST_RATIO = 100
"""Above ``FAR`` bytes, a bundle may not grow by more than this factor when unpacked."""

_MOST = {
    "run/ledger.sqlite": MOST_LEDGER,
    "run/run.json": 16_000_000,
    "run/actions.toml": 64_000,
    "run/vetting.json": 16_000_000,
    "run/seen.json": 16_000_000,
    "run/bank/manifest.json": MOST_METADATA,
    "run/bank/metadata.jsonl": MOST_METADATA,
    "bundle.json": _MOST_JSON,
    "results.json": _MOST_JSON,
}
"""The most bytes of a file; JSON of this size stays below 2 GB in memory."""
_PLAIN = re.compile(r"[^\x00-\x1f\x7f\\]{1,500}")
_DRIVE = re.compile(r"[A-Za-z]:.*")
_FIXED = re.compile(
    r"(bundle|results)\.json|report\.html|README\.txt|tables/[a-z0-9_-]+\.(csv|md|tex)|source/[a-z0-9_/]+\.py|"
    r"run/([^/]+/)?(run\.json|ledger\.sqlite|episodes\.jsonl|vetting\.json|seen\.json|actions\.toml)"
)
_BANK = re.compile(r"run/([^/]+/)?bank/.*")
_PART = re.compile(r"(?<=^run/)[^/]+/(?=(bank/)?[^/]+$)")


_DAMAGE = (zipfile.BadZipFile, zlib.error, struct.error, EOFError, NotImplementedError, RuntimeError, ValueError)


def unpack(file: Path, folder: Path) -> list[str]:
    """Unpack a bundle into a folder; return the names of its files.

    Raises BundleError before it writes anything if the file is no ZIP, or a name leads out of the
    folder or is no part of a bundle. The same holds for links, encrypted files, and sizes beyond
    the bounds above. Damage raises it during unpacking.
    """
    try:
        with zipfile.ZipFile(file) as packed:
            entries = packed.infolist()
            _check(file, entries)
            free = shutil.disk_usage(folder).free
            if sum(entry.file_size for entry in entries) > free:
                raise BundleError(f"{file} needs more room to be unpacked than the {free / 1e6:.0f} MB that are free")
            for entry in entries:
                path = folder.joinpath(*PurePosixPath(entry.filename).parts)
                path.parent.mkdir(parents=True, exist_ok=True)
                with packed.open(entry) as source, path.open("xb") as target:
                    _copy(source, target, entry)
            return [entry.filename for entry in entries]
    except _DAMAGE as error:
        raise BundleError(f"{file} is no bundle, or is damaged: {error}") from error
    except (FileExistsError, NotADirectoryError, IsADirectoryError) as error:
        raise BundleError(f"{file} is no bundle: two of its files have the same path, {error.filename}") from error
    except OSError as error:
        if error.errno == errno.EINVAL:  # an offset before the file's beginning
            raise BundleError(f"{file} is no bundle, or is damaged: {error}") from error
        raise


def check_names(file: Path) -> None:
    """Raise BundleError if a file could not be unpacked; unpacks nothing."""
    with zipfile.ZipFile(file) as packed:
        _check(file, packed.infolist())


def _check(file: Path, entries: list[zipfile.ZipInfo]) -> None:
    if len(entries) > MOST_FILES:
        raise BundleError(f"{file} holds {len(entries)} files, more than the {MOST_FILES} that a bundle may")
    names = [entry.filename for entry in entries]
    if len(set(names)) != len(names):
        raise BundleError(f"{file} is no bundle: it holds a name twice")
    for entry in entries:
        _check_entry(file, entry, len(entries))
    unpacked, here = sum(entry.file_size for entry in entries), file.stat().st_size
    if unpacked > MOST_BYTES or (unpacked > FAR and unpacked > MOST_RATIO * here):
        raise BundleError(f"{file} would grow from {here / 1e6:.1f} MB to {unpacked / 1e6:.0f} MB; it is not unpacked")


def _check_entry(file: Path, entry: zipfile.ZipInfo, count: int) -> None:
    name, parts = entry.filename, entry.filename.split("/")
    leads_out = any(part in {"", ".", ".."} or len(part.encode()) > 255 or _DRIVE.fullmatch(part) for part in parts)
    if leads_out or not _PLAIN.fullmatch(name):
        raise BundleError(f"{file} is no bundle: {name[:200]!r} is not a plain file name")
    bank = bool(_BANK.fullmatch(name))
    if not bank and not _FIXED.fullmatch(name):
        raise BundleError(f"{file} is no bundle: it holds {name[:200]!r}, which is not part of a bundle")
    mode = entry.external_attr >> 16
    if entry.is_dir() or (mode and stat.S_IFMT(mode) not in {0, stat.S_IFREG}):
        raise BundleError(f"{file} is no bundle: {name[:200]!r} is a link or a folder, not a file")
    if entry.flag_bits & 0x1 or entry.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
        raise BundleError(f"{file} is no bundle: {name[:200]!r} is encrypted, or packed in an unknown way")
    most = _MOST.get(name if name in _MOST else _PART.sub("", name), MOST_TEXT if not bank else MAX_IMAGE_BYTES)
    if name == "bundle.json":
        most = min(most, _AN_ENTRY * (count + 100))
    if entry.file_size > most:
        raise BundleError(f"{file}: {name[:200]!r} has {entry.file_size} bytes, more than the {most} that are allowed")


def _copy(source: IO[bytes], target: IO[bytes], entry: zipfile.ZipInfo) -> None:
    """Copy only as many bytes as the entry declares."""
    left = entry.file_size
    while block := source.read(min(1 << 20, left + 1)):
        left -= len(block)
        if left < 0:
            raise BundleError(f"{entry.filename!r} is longer than it says; it is not unpacked")
        target.write(block)
