"""Write a bundle: a run, its pictures and all its results, packed into one file."""

import shutil
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from eyechart.bundle.contents import FORMAT, INDEX, RUN_FOLDER, DerivedResults, Recipe, as_json, derive, digest_of
from eyechart.bundle.parts import copy_drives, derive_parts, has_parts
from eyechart.bundle.reader import check_names
from eyechart.destination import require_free, whole
from eyechart.errors import BundleError, SpecError
from eyechart.frames import FrameBank, inside, open_bank, read_bounded
from eyechart.kept import FOLDER as READINGS
from eyechart.ledger import Ledger
from eyechart.manifest import BANK, BANK_TEXT, LEDGER, RUN, RunManifest, asked_of, read_run
from eyechart.scratch import scratch
from eyechart.studies import ReadOptions, Study, Tell, is_episodes, study_of
from eyechart.studies.battery.subjects import find_pictures, used_pictures

_EPOCH = (1980, 1, 1, 0, 0, 0)
_PACKED = {".png", ".jpg", ".jpeg", ".webp"}
"""Pictures are compressed already."""


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
    """Write a run with its pictures and results as one ZIP file; return the number of files.

    Raises LedgerError or BankError if the folder is no run, BundleError if its pictures are
    missing, and OutputError if ``out`` may not be written.
    """
    require_free(out, "bundle")
    study, reading = study_of(run, "bundle"), ReadOptions(independent, reread, resamples=resamples)
    with scratch("bundle") as work:
        folder = Path(work) / "bundle"
        if has_parts(run):
            recipe, derived = _of_parts(study, run, folder, banks, reading, tell)
        else:
            recipe, derived = _of_bank(study, run, folder, banks, reading, tell)
        for name, content in derived.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        files = {path.relative_to(folder).as_posix(): digest_of(path) for path in _files(folder)}
        index = {"format": FORMAT, **recipe.as_dict(), "files": dict(sorted(files.items()))}
        (folder / INDEX).write_bytes(as_json(index))
        tell("packing")
        _pack(folder, out)
    return len(files) + 1


def _of_bank(
    study: Study[Any], run: Path, folder: Path, banks: Sequence[Path], reading: ReadOptions, tell: Tell
) -> tuple[Recipe, DerivedResults]:
    """Copy a run on a bank; return the copy's recipe and results."""
    study.require_scorable(run, reading)
    manifest, bank = _copied(run, folder / RUN_FOLDER, banks, tell, reread=reading.reread)
    reader = manifest.prompt.asks(bank.manifest.action_space).reader
    recipe = Recipe.here(_name(run), resamples=reading.resamples, independent=reading.independent, reader=reader)
    manifest, bank = read_run(folder / RUN_FOLDER, reread=reading.reread)
    return recipe, derive(folder / RUN_FOLDER, manifest, (bank, open_bank(folder / RUN_FOLDER / BANK)), recipe, tell)


def _of_parts(
    study: Study[Any], run: Path, folder: Path, banks: Sequence[Path], reading: ReadOptions, tell: Tell
) -> tuple[Recipe, DerivedResults]:
    """Copy drives, or every run of a folder; return the copies' recipe and results."""
    if reading.reread:
        raise SpecError(f"{run} holds {study.runs_are}: --reread is for one run on a bank")
    for name, part in study.runs(run).items():
        copy = folder / RUN_FOLDER / name
        if is_episodes(part):
            copy_drives(part, copy)
        else:
            _copied(part, copy, banks, tell)
    recipe = Recipe.here(_name(run), resamples=reading.resamples, independent=reading.independent)
    return recipe, derive_parts(folder / RUN_FOLDER, recipe, tell)


def _name(run: Path) -> str:
    return run.resolve().name or "run"


def _copied(
    run: Path, copy: Path, banks: Sequence[Path], tell: Tell, *, reread: bool = False
) -> tuple[RunManifest, FrameBank]:
    """Copy a run with the pictures that it used; raises BundleError if they are missing."""
    manifest, bank = read_run(run, reread=reread)
    tell("looking for the pictures")
    pictures, about = find_pictures(manifest, bank, run, banks)
    if pictures is None:
        raise BundleError(f"the pictures of {run} are missing: {about}; give the bank with --frames")
    _snapshot(run, copy, manifest, pictures)
    return manifest, bank


def _snapshot(run: Path, copy: Path, manifest: RunManifest, pictures: FrameBank) -> None:
    """Copy a run with the pictures that it used, without its bank's path."""
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
    """Return the files of a bundle: what a command keeps of its readings is none."""
    return (path for path in sorted(folder.rglob("*")) if path.is_file() and path.parent.name != READINGS)


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
        check_names(partial)  # a bundle that cannot be opened again is not kept
