"""Writing a bank: all of it, or nothing."""

import hashlib
import json
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

from eyechart.errors import BankError
from eyechart.frames.nouns import FILE_SUFFIX, BankManifest, Frame, Scalar, files_of, is_reserved, rounded_truth
from eyechart.frames.pictures import inside
from eyechart.frames.reading import open_bank


class BankWriter:
    """Writes a bank into a folder beside its place and moves it there when all of it is written.

    Use as a context manager; when its body raises, nothing stays. Raises BankError where ``out`` exists and is
    not an empty folder, and where what was added cannot be read back as it was given.
    """

    def __init__(self, out: Path, manifest: BankManifest) -> None:
        _require_free(out)
        self._out = out
        self._manifest = manifest
        self._rows: list[str] = []
        self._geometry: dict[str, str] = {}
        self._images: dict[str, str] = {}

    def __enter__(self) -> Self:
        self._out.parent.mkdir(parents=True, exist_ok=True)
        self._work = Path(tempfile.mkdtemp(prefix=f".{self._out.name}-", dir=self._out.parent))
        return self

    def add(self, frame: Frame, picture: bytes, counterfactuals: Mapping[str, bytes]) -> None:
        """Add a frame with its encoded pictures; ``frame.file`` and ``frame.counterfactuals`` name where they go.

        Raises BankError, naming the frame, where an id or a file is given twice, a picture is missing or leads out of
        the bank, or the truth could not be read back as it is.
        """
        if frame.id in self._geometry:
            raise BankError(f"frame '{frame.id}' was added twice")
        if (given := frame.fields.keys()) != set(self._manifest.prompt_columns) or given & frame.truth.keys():
            raise BankError(
                f"frame '{frame.id}' has the prompt columns {sorted(given)}, the manifest declares "
                f"{sorted(self._manifest.prompt_columns)}; each is given once, and none is ground truth"
            )
        truth = rounded_truth({**frame.truth, **frame.fields}, frame.id)
        if clash := sorted(name for name in truth if is_reserved(name)):
            raise BankError(f"frame '{frame.id}': truth may not use the reserved names {clash}")
        if frame.counterfactuals.keys() != counterfactuals.keys():
            raise BankError(
                f"frame '{frame.id}' names the counterfactuals {sorted(frame.counterfactuals)}, "
                f"but the pictures given are {sorted(counterfactuals)}"
            )
        row: dict[str, Scalar] = {
            "file_name": frame.file,
            "frame_id": frame.id,
            "scenario": frame.scenario,
            "episode": frame.episode,
            "step": frame.step,
            "mirror_axis": frame.mirror_axis,
            **truth,
        }
        pictures = [picture, *(counterfactuals[name] for name in sorted(counterfactuals))]
        for file, one in zip(files_of(frame), pictures, strict=True):
            self._store(file, one)
        row |= {f"{name}{FILE_SUFFIX}": file for name, file in frame.counterfactuals.items()}
        self._rows.append(json.dumps(row, ensure_ascii=False))
        self._geometry[frame.id] = frame.geometry()

    def _store(self, file: str, picture: bytes) -> None:
        if file in self._images:
            raise BankError(f"'{file}' was written already; every picture needs a file of its own")
        path = inside(self._work, file)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(picture)
        self._images[file] = hashlib.sha256(picture).hexdigest()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._finish()
        finally:
            shutil.rmtree(self._work, ignore_errors=True)

    def _finish(self) -> None:
        manifest = replace(self._manifest, geometry=self._geometry, images=self._images)
        (self._work / "metadata.jsonl").write_text("".join(row + "\n" for row in self._rows), encoding="utf-8")
        text = json.dumps(manifest.as_dict(), indent=1, ensure_ascii=False)
        (self._work / "manifest.json").write_text(text + "\n", encoding="utf-8")
        open_bank(self._work)
        self._work.chmod(0o755)
        _require_free(self._out)
        if self._out.exists():
            self._out.rmdir()
        self._work.replace(self._out)


def _require_free(out: Path) -> None:
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise BankError(f"{out} exists already and is not an empty folder; choose another place for the bank")
