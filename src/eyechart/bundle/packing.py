"""Packing a run into one file: the same run gives the same bytes, and nothing half-written stays."""

import hashlib
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from eyechart.bundle.contents import FORMAT, INDEX, RUN_FOLDER, Recipe, as_json, derive
from eyechart.bundle.unpacking import check_names
from eyechart.destination import require_free, whole
from eyechart.errors import BundleError
from eyechart.frames import FrameBank, inside, open_bank, read_bounded
from eyechart.ledger import Ledger
from eyechart.manifest import BANK, BANK_TEXT, LEDGER, RUN, RunManifest, asked_of, read_run
from eyechart.studies import Reading, study_of
from eyechart.studies.battery.subjects import Tell, find_pictures, used_pictures

_EPOCH = (1980, 1, 1, 0, 0, 0)
_PACKED = {".png", ".jpg", ".jpeg", ".webp"}
"""Pictures that are small already."""


def write_bundle(
    run: Path,
    out: Path,
    *,
    banks: Sequence[Path] = (),
    independent: bool = False,
    reread: bool = False,
    resamples: int = 5000,
    tell: Tell = lambda _: None,
) -> int:
    """Write a run with its pictures and all that follows from it as one ZIP file; return how many files it holds.

    Raises LedgerError or BankError where the folder is no run, BundleError where its pictures are
    not at hand, and OutputError where ``out`` may not be written.
    """
    require_free(out, "bundle")
    manifest, bank = read_run(run)
    study_of(run, "bundle").require_scorable(run, Reading(independent, reread))
    tell("looking for the pictures")
    pictures, about = find_pictures(manifest, bank, run, banks)
    if pictures is None:
        raise BundleError(f"the pictures of {run} are not at hand: {about}; give the bank with --frames")
    name, reader = run.resolve().name or "run", manifest.prompt.asks(bank.manifest.action_space).reader
    recipe = Recipe.here(name, resamples=resamples, independent=independent, reader=reader)
    with tempfile.TemporaryDirectory(prefix="eyechart-bundle-") as work:
        folder = Path(work) / "bundle"
        _snapshot(run, folder / RUN_FOLDER, manifest, pictures)
        manifest, bank = read_run(folder / RUN_FOLDER)
        held = open_bank(folder / RUN_FOLDER / BANK)
        derived = derive(folder / RUN_FOLDER, manifest, (bank, held), recipe, tell)
        for name, content in derived.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        files = {path.relative_to(folder).as_posix(): _digest(path) for path in _files(folder)}
        index = {"format": FORMAT, **recipe.as_dict(), "files": dict(sorted(files.items()))}
        (folder / INDEX).write_bytes(as_json(index))
        tell("packing")
        _pack(folder, out)
    return len(files) + 1


def _snapshot(run: Path, copy: Path, manifest: RunManifest, pictures: FrameBank) -> None:
    """Copy a run as it stands, with the pictures that it used, and without the place where they lay."""
    (copy / BANK).mkdir(parents=True)
    (copy / RUN).write_text(replace(manifest, bank_path=BANK).as_text(), encoding="utf-8")
    with Ledger(run / LEDGER) as ledger:
        ledger.copy_to(copy / LEDGER)
    for name in BANK_TEXT:
        shutil.copyfile(run / BANK / name, copy / BANK / name)
    for file in used_pictures(manifest, asked_of(pictures, manifest.prompt)):
        path = inside(copy / BANK, file)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(read_bounded(pictures.root, file))


def _files(folder: Path) -> Iterator[Path]:
    return (path for path in sorted(folder.rglob("*")) if path.is_file())


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _pack(folder: Path, out: Path) -> None:
    with whole(out, "bundle") as partial:
        with zipfile.ZipFile(partial, "w") as packed:
            for path in _files(folder):
                entry = zipfile.ZipInfo(path.relative_to(folder).as_posix(), _EPOCH)
                entry.create_system = 3
                entry.external_attr = 0o644 << 16
                small = path.suffix.lower() in _PACKED
                entry.compress_type = zipfile.ZIP_STORED if small else zipfile.ZIP_DEFLATED
                entry.file_size = path.stat().st_size
                with path.open("rb") as source, packed.open(entry, "w") as target:
                    shutil.copyfileobj(source, target, 1 << 20)
        check_names(partial)  # what could not be opened again is not written
