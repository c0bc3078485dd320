"""Writing a bank: all of it, or nothing."""

import hashlib
import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

from eyechart.errors import BankError
from eyechart.frames.nouns import FILE_SUFFIX, BankManifest, Frame, alone, is_reserved, rounded_truth
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

    def add(
        self, frame: Frame, pictures: Mapping[str, bytes], counterfactuals: Mapping[str, Mapping[str, bytes]]
    ) -> None:
        """Add a frame with its encoded pictures by camera; the frame's own mappings name the files where they go.

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
        if clash := sorted(name for name in (*truth, *frame.state) if is_reserved(name)):
            raise BankError(f"frame '{frame.id}': truth may not use the reserved names {clash}")
        if frame.counterfactuals.keys() != counterfactuals.keys():
            raise BankError(
                f"frame '{frame.id}' names the counterfactuals {sorted(frame.counterfactuals)}, "
                f"but the pictures given are {sorted(counterfactuals)}"
            )
        self._check_cameras(frame, [pictures, *counterfactuals.values()])
        row: dict[str, object] = {
            "file_name": frame.file,
            "frame_id": frame.id,
            "scenario": frame.scenario,
            "episode": frame.episode,
            "step": frame.step,
            "mirror_axis": frame.mirror_axis,
            **truth,
            **{name: list(numbers) for name, numbers in frame.state.items()},
        }
        sides = [(frame.pictures, pictures)]
        sides += [(frame.counterfactuals[name], counterfactuals[name]) for name in sorted(counterfactuals)]
        for files, encoded in sides:
            for camera, file in files.items():
                self._store(file, encoded[camera])
        first, *others = frame.pictures
        row |= {f"{name}{FILE_SUFFIX}": frame.pictures[name] for name in others}
        for name, files in frame.counterfactuals.items():
            row |= {f"{name if one == first else f'{name}@{one}'}{FILE_SUFFIX}": file for one, file in files.items()}
        self._rows.append(json.dumps(row, ensure_ascii=False))
        self._geometry[frame.id] = frame.geometry()

    def _check_cameras(self, frame: Frame, given: Sequence[Mapping[str, bytes]]) -> None:
        """Raise BankError unless a frame has the cameras and the state that its manifest declares, and all pictures."""
        declared = self._manifest.cameras or alone(frame.cameras[0].mirror_axis)
        names = [one.name for one in declared]
        told = frame.truth.keys() | frame.fields
        if frame.cameras != declared or frame.state.keys() != set(self._manifest.state) or frame.state.keys() & told:
            raise BankError(
                f"frame '{frame.id}' has the cameras {[one.name for one in frame.cameras]} and the state "
                f"{sorted(frame.state)}, the manifest declares {names} and {sorted(self._manifest.state)}"
            )
        for one in (frame.pictures, *frame.counterfactuals.values(), *given):
            if list(one) != names:
                raise BankError(f"frame '{frame.id}' has pictures of {list(one)}; its cameras are {names}")

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
