"""Banks as folders: written completely or not at all, and compared with the manifest on reading."""

import errno
import hashlib
import json
import os
import shutil
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast, get_args

from eyechart.errors import BankError, EyechartError, SpecError, raising, text_file, why
from eyechart.frames.control_draws import drawn_otherwise
from eyechart.frames.nouns import (
    DISTANCES,
    FILE_SUFFIX,
    FORMAT,
    IMPORTED,
    PATCHED,
    BankManifest,
    Controls,
    Frame,
    FrameBank,
    MirrorAxis,
    Provenance,
    Scalar,
    alone,
    files_of,
    is_reserved,
    rounded_truth,
)
from eyechart.frames.pictures import digest_of_sound, inside, read_bounded
from eyechart.records import LARGEST, build, parse_json, plain, shown, to_json_fields
from eyechart.spaces.motion import MotionSpace

MOTION = "motion"
"""The column of logged motions, in a bank that declares its motions."""
PAST = "past"
"""The column of the instants before a frame, in a bank that declares a history."""


_LOCK = ".lock"
_NO_LOCKS = {errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOTSUP}
"""The system's error codes for a file system without locks."""


@contextmanager
def own_folder(out: Path, error: type[EyechartError]) -> Iterator[Path]:
    """Yield an empty work folder beside ``out``, which is removed at the end of the context.

    Files of a killed process are removed from it. Raises ``error`` if another process writes there
    now, or if the folder with that name is not eyechart's.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    work = out.with_name(f".{out.name[:50]}.part")
    if work.is_symlink() or (work.exists() and not (work / _LOCK).is_file()):
        raise error(f"{work} exists, and eyechart did not make it: remove it, or choose another place")
    fresh = not work.exists()
    work.mkdir(exist_ok=True)
    taken = error(f"another process is writing {out}; wait for it, or choose another place")
    with _removed_unless_locked(work, fresh=fresh), locked(work / _LOCK, taken):
        try:
            _clear(work, keep=_LOCK)
            yield work
        finally:
            with suppress(OSError):  # the lock goes last: it marks files that cannot be removed as eyechart's
                _clear(work, keep=_LOCK)
                shutil.rmtree(work)


@contextmanager
def _removed_unless_locked(work: Path, *, fresh: bool) -> Iterator[None]:
    """Remove a fresh folder without a lock; a later call would not recognise it as eyechart's."""
    try:
        yield
    finally:
        if fresh and not (work / _LOCK).exists():
            with suppress(OSError):
                work.rmdir()


@contextmanager
def locked(file: Path, taken: EyechartError) -> Iterator[None]:
    """Hold a lock for the context; raises ``taken`` if another process holds it.

    Raises an error of the same class if the file system has no locks, as some network mounts do.
    """
    from filelock import FileLock, Timeout  # noqa: PLC0415 - only writers need it

    lock = FileLock(file, timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        raise taken from error
    except OSError as error:
        words = f"{file} cannot be locked: {why(error)}"
        without = f"{words}; its file system has no locks: choose a place on a disk of this machine"
        raise type(taken)(without if error.errno in _NO_LOCKS else words) from error
    try:
        yield
    finally:
        lock.release()


@contextmanager
def whole_folder(out: Path, error: type[EyechartError]) -> Iterator[Path]:
    """Yield a folder that replaces ``out`` after success; after an error nothing of it stays.

    ``out`` does not exist, or is an empty folder, or a link to either. Raises ``error`` as
    `own_folder` does, and if ``out`` cannot be replaced.
    """
    place = _place(out, error)
    with own_folder(place, error) as work:
        made = work / "made"
        made.mkdir()
        yield made
        if place.exists():
            place.rmdir()
        made.replace(place)


def _place(out: Path, error: type[EyechartError]) -> Path:
    place = Path(os.path.realpath(out))
    if place.is_symlink():
        raise error(f"{out} is a link that leads to itself; choose another place")
    if place.is_dir() and (place.is_mount() or place == Path.cwd()):
        stays = "a mount" if place.is_mount() else "the folder that this command runs in"
        raise error(f"{out} is {stays} and cannot be replaced: name a folder in it, such as {out / 'NAME'}")
    return place


def _clear(folder: Path, *, keep: str) -> None:
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.name != keep:
            path.unlink()


def open_bank(root: Path) -> FrameBank:
    """Open a bank from its manifest and metadata; raises BankError with the faulty file and line.

    Only text is read. The geometry is compared with the manifest's fingerprint here, the pictures
    by ``check``.
    """
    bank = open_unchecked(root)
    if problems := _geometry_problems(bank):
        raise BankError("; ".join(problems[:3]))
    for frame in bank:
        for file in files_of(frame):
            inside(root, file)
    return replace(bank, unchecked=False)


def read_bank_manifest(root: Path) -> BankManifest:
    """Read a bank's manifest without its frames; raises BankError with the file at fault."""
    path = root / "manifest.json"
    try:
        raw = _plain(text_file(path).read_text(encoding="utf-8"))
        if raw.get("format") != FORMAT:
            raise BankError(f"{path} has format {raw.get('format')!r}; this eyechart reads {FORMAT!r}")
        kept = {field.name: raw[field.name] for field in fields(BankManifest) if field.name in raw}
        manifest = build(BankManifest, kept)
        recorded, declared = raw["fingerprint"], raw["declaration"]
    except FileNotFoundError as error:
        made = f"is {root} a frame bank? 'eyechart frames build' makes one"
        if (root / "meta" / "info.json").is_file():
            command = f"'eyechart frames import {root} --format lerobot --horizon N --out BANK'"
            made = f"{root} is a LeRobotDataset, and {command} makes a bank of it"
        raise BankError(f"{path} does not exist: {made}") from error
    except OSError as error:
        raise BankError(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError, ArithmeticError, RecursionError, SpecError) as error:
        raise BankError(f"{path} is no bank manifest: {error!r}") from error
    if recorded != manifest.fingerprint:
        raise BankError(f"{path}: the fingerprint does not match the geometry that the manifest lists")
    if declared != manifest.declaration:
        raise BankError(
            f"{path}: the bank's declaration (picture, gap, actions or settings) was changed after it was made; "
            "make the bank again with the declaration that it should have"
        )
    return manifest


def _plain(text: str) -> Any:  # noqa: ANN401 - any value; the caller checks it
    """Read JSON; raises ValueError also for a lone surrogate, which cannot be written as UTF-8."""
    value = parse_json(text)
    json.dumps(value, ensure_ascii=False).encode()
    return value


def read_metadata(path: Path, manifest: BankManifest) -> tuple[Frame, ...]:
    """Read a bank's ``metadata.jsonl``; raises BankError with the line at fault."""
    frames: list[Frame] = []
    with raising(BankError, f"{path} cannot be read"):
        lines = text_file(path).read_bytes().splitlines()
    for number, line in enumerate(lines, 1):
        try:
            frames.append(_frame_with_past(_plain(line.decode()), manifest))
        except BankError as error:
            raise BankError(f"{path}, line {number}: {error}") from error
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise BankError(f"{path}, line {number}: {error!r}") from error
    if not frames:
        raise BankError(f"{path} has no frames")
    for frame_id, count in Counter(frame.id for frame in frames).items():
        if count > 1:
            raise BankError(f"{path}: frame '{frame_id}' occurs {count} times")
    return tuple(frames)


def read_axis(value: Scalar) -> MirrorAxis:
    """Return a word as a mirror axis; raises ValueError if it is none."""
    if value in get_args(MirrorAxis):
        return cast("MirrorAxis", value)
    raise ValueError(f"mirror_axis is {value!r}, not vertical, horizontal or none")


def _frame_with_past(row: dict[str, Any], manifest: BankManifest) -> Frame:
    """Return a frame and the instants before it; raises ValueError for another number of them."""
    if not manifest.history:
        return _frame_from_row(row, manifest)
    instants, place = row.pop(PAST), {name: row[name] for name in ("scenario", "episode")}
    if not isinstance(instants, list) or len(instants) != manifest.history:
        raise ValueError(f"'{PAST}' must list {manifest.history} instants before the frame, as the manifest declares")
    past = tuple(_frame_from_row({**one, **place}, manifest).instant() for one in instants)
    return replace(_frame_from_row(row, manifest), past=past)


def _frame_from_row(row: dict[str, Any], manifest: BankManifest) -> Frame:
    cameras = manifest.cameras or alone(read_axis(row["mirror_axis"]))
    row = {**row, **manifest.added.get(str(row["frame_id"]), {})}
    first, *others = (one.name for one in cameras)
    pictures = {first: str(row["file_name"]), **{name: str(row[f"{name}{FILE_SUFFIX}"]) for name in others}}
    drawn: dict[str, dict[str, str]] = {}
    for column, file in row.items():
        name, over, camera = column.removesuffix(FILE_SUFFIX).partition("@")
        if column.endswith(FILE_SUFFIX) and file and name not in others:
            drawn.setdefault(name, {})[camera if over else first] = str(file)
    frame_id = str(row["frame_id"])
    truth = {name: row[name] for name in row if not is_reserved(name)}
    placed = manifest.controls.distances.get(frame_id, {})
    truth |= placed
    state = {name: read_state(truth.pop(name), f"the state '{name}'") for name in manifest.state}
    fields = {name: truth.pop(name) for name in manifest.prompt_columns}
    motion = read_motion(truth.pop(MOTION, []), manifest.motion) if manifest.motion is not None else ()
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
        motion=motion,
        placed=frozenset(placed),
        strata=manifest.strata.get(frame_id, {}),
    )


def read_motion(rows: object, space: MotionSpace) -> tuple[tuple[float, ...], ...]:
    """Return a logged motion, empty for an empty list; raises ValueError for a wrong shape."""
    steps = rows if isinstance(rows, list | tuple) else [rows]
    result = tuple(read_state(row, f"step {number} of the logged motion") for number, row in enumerate(steps))
    shapes = {(len(result), len(row)) for row in result}
    if shapes - {space.shape}:
        raise ValueError(f"the logged motion has the shape {sorted(shapes)}, but the bank's motions have {space.shape}")
    return result


def read_state(value: object, what: str) -> tuple[float, ...]:
    """Return a state's numbers; raises ValueError, beginning with ``what``, for any other value."""
    if not isinstance(value, list | tuple) or not value:
        raise ValueError(f"{what} is {value!r}, not a list of numbers")
    for one in value:
        if isinstance(one, bool) or not isinstance(one, int | float) or not abs(one) <= LARGEST:
            raise ValueError(f"{what} has {shown(one)}, not a number up to {LARGEST:g}")
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
    for one in (bank.manifest.controls.distances, bank.manifest.strata, bank.manifest.added):
        recorded |= dict.fromkeys(sorted(one.keys() - bank.manifest.geometry.keys()), "")
    problems += [f"{path}: frame '{frame_id}' of the manifest is missing" for frame_id in recorded]
    if not problems and [frame.id for frame in bank] != list(bank.manifest.geometry):
        problems.append(f"{path}: the frames are in another order than in the manifest")
    return problems


def open_unchecked(root: Path) -> FrameBank:
    """Open a bank without comparing it with its manifest; ``check`` does that."""
    manifest = read_bank_manifest(root)
    frames = read_metadata(root / "metadata.jsonl", manifest)
    return FrameBank(root=root, frames=frames, manifest=manifest, unchecked=True)


def check(root: Path, files: Collection[str] | None = None) -> list[str]:
    """Recompute a bank's fingerprint, picture hashes and drawn distances; return differences.

    Each line names its frame or file. ``files`` are the pictures to check, by default all. An empty
    list means that the bank agrees with its manifest. Raises BankError if it cannot be opened at
    all.
    """
    bank = open_unchecked(root)
    manifest, problems = bank.manifest, _geometry_problems(bank)
    used = [*dict.fromkeys(file for frame in bank for file in files_of(frame))]
    for file in used if files is None else [file for file in used if file in files]:
        try:
            digest = digest_of_sound(read_bounded(root, file), file)
        except BankError as error:
            problems.append(str(error))
            continue
        if file not in manifest.images:
            problems.append(f"'{file}' is not in the manifest")
        elif digest != manifest.images[file]:
            problems.append(f"'{file}' is not the picture in the manifest: its SHA-256 differs")
    problems += [f"'{file}' of the manifest belongs to no frame" for file in sorted(manifest.images.keys() - set(used))]
    return problems or _misplaced(bank) or drawn_otherwise(bank)


def replace_manifest(folder: Path, manifest: BankManifest) -> None:
    """Replace a bank's manifest in one step, after a check that the bank can be read with it."""
    read_metadata(folder / "metadata.jsonl", manifest)
    path = folder / "manifest.json"
    partial = path.with_name(".manifest.json.part")
    try:
        with raising(BankError, f"{path} cannot be replaced", "; it is as it was"):
            with partial.open("w", encoding="utf-8") as file:
                file.write(json.dumps(manifest.as_dict(), indent=1, ensure_ascii=False) + "\n")
                file.flush()
                os.fsync(file.fileno())
            partial.replace(path)
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def declare(root: Path, made: Provenance) -> Provenance:
    """Declare in place how a bank's control pictures were made; return what was said before.

    Fingerprint and declaration stay, so runs on the bank stay valid. Raises BankError as
    `may_declare` does, if another process writes to the bank, and if it cannot be written.
    """
    with raising(BankError, f"nothing can be written beside {root}"), own_folder(root.resolve(), BankError):
        before = may_declare(root, made)
        if before.provenance != made:
            replace_manifest(root, replace(before, made=made))
    return before.provenance


def may_declare(root: Path, made: Provenance) -> BankManifest:
    """Return a bank's manifest; raises BankError if a simulator or an edit's record contradicts."""
    bank = open_bank(root)
    before = bank.manifest
    if before.simulator != IMPORTED and made != "rendered":
        raise BankError(f"the simulator '{before.simulator}' rendered the pictures of {root}; they are not {made}")
    if made != "edited" and (before.edit or any(PATCHED in frame.counterfactuals for frame in bank)):
        raise BankError(f"{root} has pictures of the kind '{PATCHED}', which an edit makes; they are not {made}")
    return before


def _misplaced(bank: FrameBank) -> list[str]:
    """Return the first frame with another frame's picture, which a file's digest cannot reveal."""
    recorded, where, seen = iter(bank.manifest.images), bank.root / "metadata.jsonl", set[str]()
    for frame in bank:
        for file in files_of(frame):
            if bank.manifest.history and file in seen:
                continue
            seen.add(file)
            own = next(recorded, None)
            if own != file:
                return [f"{where}: frame '{frame.id}' shows '{file}', the manifest says '{own}'"]
    return _unlike_instants(bank) if bank.manifest.history else []


def _unlike_instants(bank: FrameBank) -> list[str]:
    """Return the first frame whose instant has other pictures than the same step elsewhere."""
    shown, steps = dict[object, object](), dict[object, object]()
    for frame in bank:
        for one in frame.window:
            step, files = (one.drive, one.step), tuple(one.pictures.values())
            if shown.setdefault(step, files) != files or steps.setdefault(files, step) != step:
                where = f"{bank.root / 'metadata.jsonl'}: frame '{frame.id}'"
                return [f"{where} shows {', '.join(files)} at step {one.step}, and another frame does not"]
    return []


class BankWriter:
    """Writes a bank into a work folder and moves it to its place when it is complete.

    Use as a context manager; after an error nothing stays. Raises BankError if ``out`` exists and
    is not an empty folder, and if the bank cannot be read back as it was given.
    """

    def __init__(self, out: Path, manifest: BankManifest) -> None:
        require_free(out)
        self._folder = whole_folder(out, BankError)
        self._out = out
        self._manifest = manifest
        self._rows: dict[str, str] = {}
        self._geometry: dict[str, str] = {}
        self._images: dict[str, str] = {}
        self._distances: dict[str, dict[str, float]] = {}
        self._strata: dict[str, Mapping[str, Scalar]] = {}
        self._files: dict[str, list[str]] = {}

    def __enter__(self) -> Self:
        self._work = self._folder.__enter__()
        return self

    def add(
        self, frame: Frame, pictures: Mapping[str, bytes], counterfactuals: Mapping[str, Mapping[str, bytes]]
    ) -> None:
        """Add a frame with its encoded pictures by camera, under the files that the frame names.

        The pictures of its past are those of frames and instants that were added before. Raises
        BankError with the frame's id if an id or a file is given twice, or a picture is missing or
        leads out of the bank. It does so too if the truth cannot be read back unchanged.
        """
        if frame.id in self._geometry:
            raise BankError(f"frame '{frame.id}' was added twice")
        if (given := frame.fields.keys()) != set(self._manifest.prompt_columns) or given & frame.truth.keys():
            raise BankError(
                f"frame '{frame.id}' has the prompt columns {sorted(given)}, but the manifest declares "
                f"{sorted(self._manifest.prompt_columns)}; give each once, and none as ground truth"
            )
        truth = rounded_truth({**frame.truth, **frame.fields}, frame.id)
        logged = self._logged(frame)
        own = {*logged, *([PAST] if self._manifest.history else [])}
        if clash := sorted(name for name in (*truth, *frame.state) if is_reserved(name) or name in own):
            raise BankError(f"frame '{frame.id}': ground truth may not use the reserved names {clash}")
        if frame.counterfactuals.keys() != counterfactuals.keys():
            raise BankError(
                f"frame '{frame.id}' names the counterfactuals {sorted(frame.counterfactuals)}, "
                f"but the pictures given are {sorted(counterfactuals)}"
            )
        self._check_cameras(frame, [pictures, *counterfactuals.values()])
        past = self._past_of(frame)
        frame = self._put_aside(frame, truth)
        row: dict[str, object] = {
            "file_name": frame.file,
            "frame_id": frame.id,
            **to_json_fields(frame, "scenario episode step mirror_axis"),
            **truth,
            **plain(frame.state),
            **logged,
            **past,
        }
        sides = [(frame.pictures, pictures)]
        sides += [(frame.counterfactuals[name], counterfactuals[name]) for name in sorted(counterfactuals)]
        for files, encoded in sides:
            for camera, file in files.items():
                self._store(file, encoded[camera])
        row |= _other_files(frame)
        first = next(iter(frame.pictures))
        for name, files in frame.counterfactuals.items():
            row |= {f"{name if one == first else f'{name}@{one}'}{FILE_SUFFIX}": file for one, file in files.items()}
        self._rows[frame.id] = json.dumps(row, ensure_ascii=False)
        self._geometry[frame.id] = frame.geometry()
        self._files[frame.id] = files_of(frame)

    def add_instant(self, instant: Frame, pictures: Mapping[str, bytes]) -> None:
        """Add the pictures of an instant that may come before a frame, and is none itself.

        A picture of no frame is left out of the bank. Raises BankError as `add` does.
        """
        self._check_cameras(instant, [pictures])
        for camera, file in instant.pictures.items():
            self._store(file, pictures[camera])

    def _past_of(self, frame: Frame) -> dict[str, object]:
        """Return the past's column of a frame's row, empty if the manifest declares no history."""
        if len(frame.past) != self._manifest.history:
            raise BankError(
                f"frame '{frame.id}' has {len(frame.past)} instants before it, but the manifest declares "
                f"{self._manifest.history}"
            )
        for one in frame.past:
            self._check_cameras(one, [])
            if one != one.instant() or one.drive != frame.drive or one.fields.keys() != frame.fields.keys():
                raise BankError(f"frame '{frame.id}': '{one.id}' is no instant of its episode: see Frame.instant")
            if lacking := [file for file in one.pictures.values() if file not in self._images]:
                raise BankError(f"frame '{frame.id}': the picture '{lacking[0]}' of its past was not added before it")
        rows = [
            {
                "file_name": one.file,
                "frame_id": one.id,
                **to_json_fields(one, "step mirror_axis"),
                **rounded_truth(one.fields, one.id),
                **plain(one.state),
                **_other_files(one),
            }
            for one in frame.past
        ]
        return {PAST: rows} if rows else {}

    def _put_aside(self, frame: Frame, truth: dict[str, Scalar]) -> Frame:
        """Move distances and strata to the manifest; return the frame with its distances' names."""
        names = [*(name for name in DISTANCES if name in truth), *sorted(frame.placed - {*DISTANCES})]
        if distances := {name: truth.pop(name) for name in names}:
            self._distances[frame.id] = _numbers(distances, frame.id)
        if frame.strata:
            self._strata[frame.id] = rounded_truth(frame.strata, frame.id)
        return replace(frame, placed=frozenset(names))

    def read(self, file: str) -> bytes:
        """Return an encoded picture that was added."""
        return read_bounded(self._work, file)

    def digest(self, file: str) -> str:
        """Return the digest of an encoded picture that was added."""
        return self._images[file]

    def leave_out(self, frame: Frame) -> None:
        """Remove an added frame from the bank, and its pictures unless another frame has them."""
        del self._rows[frame.id], self._geometry[frame.id], self._files[frame.id]
        self._distances.pop(frame.id, None)
        self._strata.pop(frame.id, None)

    def _remove(self, files: Collection[str]) -> None:
        """Remove pictures that no frame shows."""
        for file in files:
            path = self._work / file
            path.unlink()
            with suppress(OSError):  # the folder holds other pictures
                path.parent.rmdir()

    def _logged(self, frame: Frame) -> dict[str, object]:
        """Return the motion column of a frame's row, empty if the manifest declares no motions."""
        if self._manifest.motion is None:
            return {}
        with raising(BankError, f"frame '{frame.id}'", of=ValueError):
            return {MOTION: read_motion(frame.motion, self._manifest.motion)}

    def note(self, name: str, value: object) -> None:
        """Add a setting that is known only after all frames; the fingerprint leaves it out."""
        self._manifest = replace(self._manifest, settings={**self._manifest.settings, name: value})

    def _check_cameras(self, frame: Frame, given: Sequence[Mapping[str, bytes]]) -> None:
        """Raise BankError unless a frame has the declared cameras and state, and all pictures."""
        declared = self._manifest.cameras or alone(frame.cameras[0].mirror_axis)
        names = [camera.name for camera in declared]
        columns = frame.truth.keys() | frame.fields
        if frame.cameras != declared or frame.state.keys() != set(self._manifest.state) or frame.state.keys() & columns:
            raise BankError(
                f"frame '{frame.id}' has the cameras {[camera.name for camera in frame.cameras]} and the state "
                f"{sorted(frame.state)}, but the manifest declares {names} and {sorted(self._manifest.state)}"
            )
        for one in (frame.pictures, *frame.counterfactuals.values(), *given):
            if list(one) != names:
                raise BankError(f"frame '{frame.id}' has pictures of {list(one)}; its cameras are {names}")

    def _store(self, file: str, picture: bytes) -> None:
        if file in self._images:
            raise BankError(f"'{file}' is already written; every picture needs a file of its own")
        path = inside(self._work, file)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(picture)
        self._images[file] = hashlib.sha256(picture).hexdigest()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            try:
                self._finish()
            except BaseException as failed:
                self._folder.__exit__(type(failed), failed, failed.__traceback__)
                raise
        self._folder.__exit__(kind, error, trace)

    def _finish(self) -> None:
        controls = replace(self._manifest.controls, distances=self._distances) if self._distances else Controls()
        images = {file: self._images[file] for files in self._files.values() for file in files}
        self._remove(self._images.keys() - images.keys())
        manifest = replace(
            self._manifest, geometry=self._geometry, images=images, controls=controls, strata=self._strata
        )
        (self._work / "metadata.jsonl").write_text("".join(row + "\n" for row in self._rows.values()), encoding="utf-8")
        text = json.dumps(manifest.as_dict(), indent=1, ensure_ascii=False)
        (self._work / "manifest.json").write_text(text + "\n", encoding="utf-8")
        open_bank(self._work)
        require_free(self._out)


def _other_files(frame: Frame) -> dict[str, object]:
    """Return the columns of the pictures of all cameras but the first."""
    return {f"{name}{FILE_SUFFIX}": file for name, file in [*frame.pictures.items()][1:]}


def _numbers(distances: Mapping[str, Scalar], frame_id: str) -> dict[str, float]:
    """Return the known distances; raises BankError with the frame's id for a non-number."""
    found = {name: value for name, value in distances.items() if value is not None}
    for name, value in found.items():
        if isinstance(value, str | bool):
            raise BankError(f"frame '{frame_id}': '{name}' is {value!r}, not a distance")
    return {name: float(value) for name, value in found.items()}


def require_free(out: Path) -> None:
    """Raise BankError if the place of a bank is not free."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise BankError(f"{out} exists already and is not an empty folder; choose another place for the bank")
