"""Merging the shards of one battery into one run."""

import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from eyechart.errors import LedgerError
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, RunManifest, read_run, write_run


def merge(shards: Sequence[Path], out: Path) -> int:
    """Merge shards of one run into a new run at ``out``; return the number of calls in it.

    Shards may be unfinished: the merged run is resumed as a whole. Raises LedgerError, and leaves nothing at
    ``out``, where they are not parts of one run or hold the same finished call twice.
    """
    if not shards:
        raise LedgerError("merge needs the folders of one or more shards")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise LedgerError(f"{out} exists and is not empty; choose another --out for the merged run")
    manifest, bank = _whole(shards)
    out.parent.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    try:
        write_run(work, manifest, bank)
        calls = 0
        with Ledger(work / LEDGER, create=True) as merged:
            for shard in shards:
                with Ledger(shard / LEDGER) as ledger:
                    calls += merged.absorb(ledger)
        work.chmod(0o755)
        if out.exists():
            out.rmdir()
        work.replace(out)
    except BaseException:
        shutil.rmtree(work, ignore_errors=True)
        raise
    return calls


def _whole(shards: Sequence[Path]) -> tuple[RunManifest, FrameBank]:
    """Return the manifest and the bank of the run that the shards are parts of."""
    read = [read_run(shard) for shard in shards]
    manifests, bank = [manifest for manifest, _ in read], read[0][1]
    whole = replace(manifests[0], shard=None)
    for shard, (manifest, its_bank) in zip(shards, read, strict=True):
        if its_bank.manifest.images != bank.manifest.images and manifest.fingerprint == whole.fingerprint:
            raise LedgerError(f"{shard} is no part of the run in {shards[0]}: it was run on other pictures")
        try:
            whole = whole.extended(replace(manifest, shard=None))
        except LedgerError as error:
            raise LedgerError(f"{shard} is no part of the run in {shards[0]}: {error}") from error
    return replace(whole, created=min(manifest.created for manifest in manifests)), bank
