"""Reading a bank from disk, and checking it against what its manifest recorded."""

import hashlib
import json
import math
from collections import Counter
from collections.abc import Collection
from dataclasses import fields
from pathlib import Path
from typing import Any, cast, get_args

from eyechart.errors import BankError, SpecError
from eyechart.frames.nouns import (
    FILE_SUFFIX,
    FORMAT,
    BankManifest,
    Frame,
    FrameBank,
    MirrorAxis,
    Scalar,
    alone,
    files_of,
    is_reserved,
    rounded_truth,
)
from eyechart.frames.pictures import decode, inside, read_bounded
from eyechart.records import build


def open_bank(root: Path) -> FrameBank:
    """Open a bank from its manifest and metadata; raises BankError naming the file and line at fault.

    Only text is read. The geometry is checked against the manifest's fingerprint here, the pictures by ``check``.
    """
    manifest = _read_manifest(root / "manifest.json")
    bank = FrameBank(root=root, frames=read_metadata(root / "metadata.jsonl", manifest), manifest=manifest)
    problems = _geometry_problems(bank)
    if problems:
        raise BankError("; ".join(problems[:3]))
    for frame in bank:
        for file in files_of(frame):
            inside(root, file)
    return bank


def _read_manifest(path: Path) -> BankManifest:
    try:
        raw = _plain(path.read_text(encoding="utf-8"))
        if raw.get("format") != FORMAT:
            raise BankError(f"{path} has format {raw.get('format')!r}; this eyechart reads {FORMAT!r}")
        kept = {one.name: raw[one.name] for one in fields(BankManifest) if one.name in raw}
        manifest = build(BankManifest, kept)
        recorded, declared = raw["fingerprint"], raw["declaration"]
    except FileNotFoundError as error:
        raise BankError(
            f"{path} does not exist: is {path.parent} a frame bank? 'eyechart frames build' makes one"
        ) from error
    except OSError as error:
        raise BankError(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError, ArithmeticError, RecursionError, SpecError) as error:
        raise BankError(f"{path} is no bank manifest: {error!r}") from error
    if recorded != manifest.fingerprint:
        raise BankError(f"{path}: the fingerprint does not match the geometry that the manifest lists")
    if declared != manifest.declaration:
        raise BankError(
            f"{path}: what the bank declares of itself (picture, gap, actions or settings) was changed after it was "
            "made; make it anew with what it should declare"
        )
    return manifest


def _plain(text: str) -> Any:  # noqa: ANN401 - whatever stands in the file; its reader checks it
    """Read JSON; raises ValueError also for a lone surrogate, which no file and no terminal can hold."""
    value = json.loads(text)
    json.dumps(value, ensure_ascii=False).encode()
    return value


def read_metadata(path: Path, manifest: BankManifest) -> tuple[Frame, ...]:
    """Read a bank's ``metadata.jsonl``; raises BankError with the line at fault."""
    frames: list[Frame] = []
    try:
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise BankError(f"{path} cannot be read: {error.strerror}") from error
    for number, line in enumerate(lines, 1):
        try:
            frames.append(_frame_from_row(_plain(line.decode()), manifest))
        except BankError as error:
            raise BankError(f"{path}, line {number}: {error}") from error
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise BankError(f"{path}, line {number}: {error!r}") from error
    if not frames:
        raise BankError(f"{path} holds no frame")
    for frame_id, count in Counter(frame.id for frame in frames).items():
        if count > 1:
            raise BankError(f"{path}: frame '{frame_id}' stands there {count} times")
    return tuple(frames)


def read_axis(value: Scalar) -> MirrorAxis:
    """Return a word as a mirror axis; raises ValueError where it is none."""
    for axis in get_args(MirrorAxis):
        if value == axis:
            return cast("MirrorAxis", axis)
    raise ValueError(f"mirror_axis is {value!r}, not vertical, horizontal or none")


def _frame_from_row(row: dict[str, Any], manifest: BankManifest) -> Frame:
    cameras = manifest.cameras or alone(read_axis(row["mirror_axis"]))
    first, *others = (one.name for one in cameras)
    pictures = {first: str(row["file_name"]), **{name: str(row[f"{name}{FILE_SUFFIX}"]) for name in others}}
    drawn: dict[str, dict[str, str]] = {}
    for column, file in row.items():
        name, over, camera = column.removesuffix(FILE_SUFFIX).partition("@")
        if column.endswith(FILE_SUFFIX) and file and name not in others:
            drawn.setdefault(name, {})[camera if over else first] = str(file)
    truth = {name: row[name] for name in row if not is_reserved(name)}
    frame_id = str(row["frame_id"])
    state = {name: read_state(truth.pop(name), f"the state '{name}'") for name in manifest.state}
    fields = {name: truth.pop(name) for name in manifest.prompt_columns}
    return Frame(
        id=frame_id,
        scenario=str(row["scenario"]),
        episode=str(row["episode"]),
        step=int(str(row["step"])),
        cameras=cameras,
        pictures=pictures,
        truth=rounded_truth(truth, frame_id),
        counterfactuals=drawn,
        fields=rounded_truth(fields, frame_id),
        state=state,
    )


def read_state(value: object, what: str) -> tuple[float, ...]:
    """Return a list of numbers that a controller may see; raises ValueError, beginning with ``what``, for any other."""
    if not isinstance(value, list | tuple) or not value:
        raise ValueError(f"{what} is {value!r}, not a list of numbers")
    for one in value:
        if isinstance(one, bool) or not isinstance(one, int | float) or not math.isfinite(one):
            raise ValueError(f"{what} has {one!r}, not a finite number")
    return tuple(map(float, value))


def _geometry_problems(bank: FrameBank) -> list[str]:
    path, recorded = bank.root / "metadata.jsonl", dict(bank.manifest.geometry)
    problems = []
    for frame in bank:
        digest = recorded.pop(frame.id, None)
        if digest is None:
            problems.append(f"{path}: frame '{frame.id}' is not in the manifest")
        elif digest != frame.geometry():
            problems.append(f"{path}: the ground truth of frame '{frame.id}' differs from the manifest's fingerprint")
    problems += [f"{path}: frame '{frame_id}' of the manifest is missing" for frame_id in recorded]
    if not problems and [frame.id for frame in bank] != list(bank.manifest.geometry):
        problems.append(f"{path}: the frames stand in another order than in the manifest")
    return problems


def open_unchecked(root: Path) -> FrameBank:
    """Open a bank whose ground truth may differ from what its manifest recorded; ``check`` says how."""
    manifest = _read_manifest(root / "manifest.json")
    return FrameBank(root=root, frames=read_metadata(root / "metadata.jsonl", manifest), manifest=manifest)


def check(root: Path, files: Collection[str] | None = None) -> list[str]:
    """Recompute a bank's fingerprint and the hash of every picture; return what differs, one line each, by name.

    ``files`` are the pictures to look at, all if none are given. An empty list means that the bank is what its
    manifest says. Raises BankError if it cannot be opened at all.
    """
    bank = open_unchecked(root)
    manifest, problems = bank.manifest, _geometry_problems(bank)
    used = [file for frame in bank for file in files_of(frame)]
    for file in used if files is None else [file for file in used if file in files]:
        try:
            picture = read_bounded(root, file)
            decode(picture, file)
        except BankError as error:
            problems.append(str(error))
            continue
        if file not in manifest.images:
            problems.append(f"'{file}' is not in the manifest")
        elif hashlib.sha256(picture).hexdigest() != manifest.images[file]:
            problems.append(f"'{file}' is not the picture that the manifest recorded: its SHA-256 differs")
    problems += [f"'{file}' of the manifest belongs to no frame" for file in sorted(manifest.images.keys() - set(used))]
    return problems or _misplaced(bank)


def _misplaced(bank: FrameBank) -> list[str]:
    """Return the first frame that shows another frame's picture: a digest of a file does not know whose it is."""
    recorded = iter(bank.manifest.images)
    for frame in bank:
        for file in files_of(frame):
            own = next(recorded, None)
            if own != file:
                return [f"{bank.root / 'metadata.jsonl'}: frame '{frame.id}' shows '{file}', the manifest says '{own}'"]
    return []
