"""Add the control pictures that a bank of an older eyechart lacks.

The bank's moments are staged again and compared with the bank. Its existing files stay as they are.
New pictures are written before the manifest that names them is replaced, in one step, so an
interrupted call leaves the bank unchanged.
"""

import hashlib
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from eyechart.conditions import CONTROLS
from eyechart.errors import BankError, SpecError
from eyechart.frames import (
    FILE_SUFFIX,
    BankManifest,
    Controls,
    Frame,
    FrameBank,
    check,
    decode,
    files_of,
    inside,
    open_bank,
    own_folder,
    replace_manifest,
    require_free,
    whole_folder,
)
from eyechart.simulators import SIMULATORS, open_bank_simulator
from eyechart.simulators.banks import (
    DOZEN,
    BankMaker,
    BankOrigin,
    Preset,
    ShownPictures,
    built_of,
    encode_pictures,
    frames_of,
)

Progress = Callable[[int, int], None]


@dataclass
class _AddedPictures:
    """The frames of a bank as they are now, with the columns and digests of the new files."""

    frames: list[Frame] = field(default_factory=list)
    columns: dict[str, dict[str, str]] = field(default_factory=dict)
    digests: dict[str, str] = field(default_factory=dict)


def add_missing(root: Path, out: Path | None = None, progress: Progress | None = None) -> tuple[FrameBank, int]:
    """Draw the control pictures that the bank at ``root`` lacks.

    They are added to a copy at ``out``, or to the bank itself if ``out`` is None. Returns the bank
    and the number of added pictures. Raises SpecError if no known simulator made the bank. Raises
    BankError if the bank is damaged, if its moments are drawn differently today, or if ``out``
    is taken. After an error the bank is unchanged.
    """
    bank = open_bank(root)
    why = f"nothing can be added to {root}: "
    if problems := check(root):
        raise BankError(f"{why}it is damaged: {problems[0]} ({len(problems)} in all, 'eyechart frames check')")
    simulator, how = _maker(bank, why)
    if out is not None:
        require_free(out)
    with _place(bank, out) as folder:
        added = _draw(bank, folder, simulator, how, why, progress)
        if added.columns or out is not None:
            replace_manifest(folder, _manifest(bank.manifest, simulator.open_preset(how.preset), how, added))
    return open_bank(root if out is None else out), len(added.digests)


def _maker(bank: FrameBank, why: str) -> tuple[BankMaker, BankOrigin]:
    """Return the simulator that made a bank, and the settings of the build."""
    made = bank.manifest
    if made.simulator not in SIMULATORS or not {"seeds", "steps"} <= made.settings.keys():
        raise SpecError(f"{why}it was not built by 'eyechart frames build' from a known simulator")
    simulator, how = open_bank_simulator(made.simulator), built_of(bank)
    if not isinstance(simulator, BankMaker) or how.preset not in simulator.declared.presets:
        raise SpecError(f"{why}simulator '{made.simulator}' has no preset '{how.preset}'")
    if "staging" not in made.settings and how.steps > DOZEN:
        raise BankError(
            f"{why}an older eyechart staged its episodes of {how.steps} steps differently; build the bank again"
        )
    return simulator, how


@contextmanager
def _place(bank: FrameBank, out: Path | None) -> Iterator[Path]:
    """Yield the folder for the new pictures: the bank's own, or a copy that is kept on success."""
    if out is None:
        with own_folder(bank.root.resolve(), BankError):
            yield bank.root
        return
    with whole_folder(out, BankError) as made:
        for file in ("manifest.json", "metadata.jsonl", *bank.manifest.images):
            to = inside(made, file)
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(bank.root / file, to)
        yield made


def _draw(
    bank: FrameBank, folder: Path, simulator: BankMaker, how: BankOrigin, why: str, progress: Progress | None
) -> _AddedPictures:
    """Draw the missing pictures into the folder, frame by frame."""
    added = _AddedPictures()
    drawn = frames_of(simulator.declared, simulator.open_preset(how.preset), how)
    for number, (frame, (anew, picture, pictures)) in enumerate(zip(bank, drawn, strict=True), 1):
        if not _is_same(bank, frame, anew, picture, pictures):
            now = ", ".join(f"{name} {version}" for name, version in simulator.versions().items())
            raise BankError(f"{why}{now} draw frame '{frame.id}' differently from the bank; build the bank again")
        lacking = [name for name in pictures if name not in frame.counterfactuals]
        files = {name: anew.counterfactuals[name] for name in lacking}
        for name in lacking:
            for camera, content in encode_pictures(pictures[name]).items():
                _write(inside(folder, files[name][camera]), content)
                added.digests[files[name][camera]] = hashlib.sha256(content).hexdigest()
        added.columns |= {frame.id: _columns(files, frame)} if files else {}
        added.frames.append(_joined(frame, anew, files))
        if progress is not None:
            progress(number, len(bank))
    return added


def _is_same(
    bank: FrameBank, frame: Frame, anew: Frame, picture: ShownPictures, pictures: Mapping[str, ShownPictures]
) -> bool:
    """Return whether a moment is drawn today as it is in the bank, apart from its controls."""
    if (frame.id, frame.geometry()) != (anew.id, anew.geometry()):
        return False
    kept = {name: files for name, files in frame.counterfactuals.items() if name not in CONTROLS}
    if not kept.keys() <= pictures.keys():
        return False
    sides = [(frame.pictures, picture), *((files, pictures[name]) for name, files in kept.items())]
    return all(
        np.array_equal(decode(bank.read(file), file), seen[camera] if isinstance(seen, Mapping) else seen)
        for files, seen in sides
        for camera, file in files.items()
    )


def _joined(frame: Frame, anew: Frame, files: Mapping[str, Mapping[str, str]]) -> Frame:
    """Return a frame with its added pictures; distances that it already has stay."""
    truth = {name: anew.truth[name] for name in anew.placed - frame.placed}
    return replace(
        frame,
        truth={**frame.truth, **truth},
        placed=frame.placed | truth.keys(),
        counterfactuals={**frame.counterfactuals, **files},
        strata=frame.strata or anew.strata,
    )


def _columns(files: Mapping[str, Mapping[str, str]], frame: Frame) -> dict[str, str]:
    """Return the columns of pictures as in a row of metadata."""
    first = frame.cameras[0].name
    return {
        f"{name if camera == first else f'{name}@{camera}'}{FILE_SUFFIX}": file
        for name, one in files.items()
        for camera, file in one.items()
    }


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.part")
    partial.write_bytes(content)
    partial.replace(path)


def _manifest(before: BankManifest, preset: Preset, how: BankOrigin, added: _AddedPictures) -> BankManifest:
    """Return the manifest of a bank after the addition."""
    digests = {**before.images, **added.digests}
    distances = {
        frame.id: {name: round(float(str(frame.truth[name])), 3) for name in sorted(frame.placed)}
        for frame in added.frames
    }
    columns = {
        frame.id: {**before.added.get(frame.id, {}), **added.columns.get(frame.id, {})} for frame in added.frames
    }
    return replace(
        before,
        images={file: digests[file] for frame in added.frames for file in files_of(frame)},
        controls=Controls(how.controls_seed, {name: distance for name, distance in distances.items() if distance}),
        span=preset.span,
        strata={frame.id: frame.strata for frame in added.frames if frame.strata},
        added={name: column for name, column in columns.items() if column},
    )
