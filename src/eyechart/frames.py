"""A frame bank is a Hugging Face imagefolder with a manifest that fixes its geometry and its pictures."""

import hashlib
import io
import json
import math
import shutil
import tempfile
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any, Literal, Self, cast, get_args

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from eyechart.actions import ActionSpace
from eyechart.errors import BankError, SpecError

MirrorAxis = Literal["vertical", "horizontal", "none"]
"""The flip that exchanges left and right: vertical for a top-down horizontal road, horizontal for a forward camera."""

Scalar = str | int | float | bool | None
RGB = NDArray[np.uint8]

IMPORTED = "import"
"""The simulator's name in a bank whose pictures were taken from elsewhere."""

FORMAT = "eyechart-bank/1"
_EXACT = 2**53
MAX_PIXELS = 25_000_000
MAX_IMAGE_BYTES = 64_000_000
_FILE_SUFFIX = "_file_name"
_RESERVED = {"file_name", "frame_id", "scenario", "episode", "step", "mirror_axis"}


@dataclass(frozen=True, slots=True)
class Gap:
    """Which column of ground truth the battery's gap tests read, in what unit, and what counts as near."""

    column: str
    threshold: float
    unit: str


LEAD_GAP = Gap(column="lead_gap_m", threshold=18.0, unit="m")
"""The paper's gap: centre to centre to the lead vehicle, near below 18 m."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A rendered image with its place in the bank and its ground truth, which no model sees.

    ``truth`` maps a name with its unit (``lead_gap_m``) to a number, a flag, a word, or None for "there is
    none" (no lead). ``file`` and ``counterfactuals`` are paths inside the bank. ``fields`` maps the bank's prompt
    columns to what a prompt may say of the frame; they are no ground truth.
    """

    id: str
    scenario: str
    episode: str
    step: int
    mirror_axis: MirrorAxis
    file: str
    truth: Mapping[str, Scalar] = field(default_factory=dict)
    counterfactuals: Mapping[str, str] = field(default_factory=dict)
    fields: Mapping[str, Scalar] = field(default_factory=dict)

    def geometry(self) -> str:
        """Return the digest of the frame's identity and its ground truth to 3 decimals (docs/decisions/0007)."""
        truth = {name: _canonical(self.truth[name]) for name in sorted(self.truth)}
        parts = [self.id, self.scenario, self.episode, self.step, self.mirror_axis, truth]
        if self.fields:
            parts.append({name: _canonical(self.fields[name]) for name in sorted(self.fields)})
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


def _canonical(value: Scalar) -> Scalar | list[str]:
    """Return a number as a list with its decimals, so that 5 is 5.0 and no word; all else as it is."""
    if value is None or isinstance(value, bool | str):
        return value
    return [f"{value}.000" if isinstance(value, int) else f"{round(value, 3) + 0.0:.3f}"]


def is_reserved(name: str) -> bool:
    """Return whether a bank needs this column's name for itself."""
    return name in _RESERVED or name.endswith(_FILE_SUFFIX)


def rounded_truth(truth: Mapping[str, object], frame_id: str) -> dict[str, Scalar]:
    """Return ground truth as plain values, floats to 3 decimals.

    Raises BankError for NaN, infinity, whole numbers above 2**53, and other types.
    """
    plain: dict[str, Scalar] = {}
    for name, raw in truth.items():
        value = raw.item() if isinstance(raw, np.generic) else raw
        if isinstance(value, float):
            if not math.isfinite(value):
                raise BankError(f"frame '{frame_id}': truth '{name}' is {value}; use None for 'there is none'")
            value = round(value, 3) + 0.0
        if isinstance(value, int) and abs(value) > _EXACT:
            raise BankError(f"frame '{frame_id}': truth '{name}' is too large a number to be exact; write it as a word")
        if not isinstance(value, str | int | float | bool | None):
            raise BankError(f"frame '{frame_id}': truth '{name}' is a {type(value).__name__}, not a plain value")
        plain[name] = value
    return plain


@dataclass(frozen=True, slots=True)
class BankManifest:
    """What a bank says of itself: where its pictures come from, and the digests that fix them.

    ``picture`` is the kind of picture in words, for the scope of every verdict. ``geometry`` maps a frame id
    to its digest, ``images`` a file to its SHA-256. ``prompt_columns`` are the columns that prompts may say,
    ``absent`` the places that the source did not record (scenario, episode, step), and ``independent`` its
    owner's word that the frames are independent draws; a bank that says none of these is as it always was.
    """

    simulator: str
    preset: str
    picture: str
    action_space: ActionSpace
    gap: Gap | None
    settings: Mapping[str, object] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    geometry: Mapping[str, str] = field(default_factory=dict)
    images: Mapping[str, str] = field(default_factory=dict)
    prompt_columns: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()
    independent: bool = False

    @property
    def fingerprint(self) -> str:
        """Return the digest of the geometry of every frame in order; pixels have no part in it."""
        lines = "\n".join(f"{frame}\x1f{digest}" for frame, digest in self.geometry.items())
        return hashlib.sha256(lines.encode()).hexdigest()

    @property
    def declaration(self) -> str:
        """Return the digest of what the bank declares of itself: its picture in words, gap, actions and settings."""
        words = {name: value for name, value in self._declared().items() if name != "versions"}
        return hashlib.sha256(json.dumps(words, sort_keys=True).encode()).hexdigest()

    def as_dict(self) -> dict[str, object]:
        """Return the manifest as plain JSON values."""
        return {
            "format": FORMAT,
            "fingerprint": self.fingerprint,
            "declaration": self.declaration,
            **self._declared(),
            "geometry": dict(self.geometry),
            "images": dict(self.images),
        }

    def _declared(self) -> dict[str, object]:
        gap = (
            None
            if self.gap is None
            else {"column": self.gap.column, "threshold": self.gap.threshold, "unit": self.gap.unit}
        )
        return {
            "simulator": self.simulator,
            "preset": self.preset,
            "picture": self.picture,
            "action_space": self.action_space.as_dict(),
            "gap": gap,
            **({"prompt_columns": list(self.prompt_columns)} if self.prompt_columns else {}),
            **({"absent": list(self.absent)} if self.absent else {}),
            **({"independent": True} if self.independent else {}),
            "settings": dict(self.settings),
            "versions": dict(self.versions),
        }


@dataclass(frozen=True)
class FrameBank:
    """Frames on disk with their manifest. Opening one reads text only; pictures are read when asked for."""

    root: Path
    frames: tuple[Frame, ...]
    manifest: BankManifest

    def __post_init__(self) -> None:
        object.__setattr__(self, "_by_id", {frame.id: frame for frame in self.frames})
        grouped: dict[str, list[Frame]] = {}
        for frame in self.frames:
            grouped.setdefault(frame.scenario, []).append(frame)
        object.__setattr__(self, "_by_scenario", {name: tuple(frames) for name, frames in grouped.items()})

    def __iter__(self) -> Iterator[Frame]:
        return iter(self.frames)

    def __len__(self) -> int:
        return len(self.frames)

    def frame(self, frame_id: str) -> Frame:
        """Return the frame of this id; raises BankError where the bank has none."""
        by_id: dict[str, Frame] = self.__dict__["_by_id"]
        if frame_id not in by_id:
            raise BankError(f"the bank {self.root} has no frame '{frame_id}'")
        return by_id[frame_id]

    def image(self, frame: Frame, counterfactual: str | None = None) -> bytes:
        """Return the encoded picture of a frame, or of one of its counterfactuals.

        Raises BankError for a missing counterfactual, a file outside the bank, or one that is too large.
        """
        if counterfactual is None:
            return read_bounded(self.root, frame.file)
        if counterfactual not in frame.counterfactuals:
            raise BankError(f"frame '{frame.id}' has no counterfactual picture '{counterfactual}'")
        return read_bounded(self.root, frame.counterfactuals[counterfactual])

    @property
    def scenarios(self) -> Mapping[str, tuple[Frame, ...]]:
        """Return the frames of each scenario, in the bank's order."""
        by_scenario: dict[str, tuple[Frame, ...]] = self.__dict__["_by_scenario"]
        return by_scenario

    @property
    def name(self) -> str:
        """Return the bank's short name: its preset and the head of its fingerprint."""
        return f"{self.manifest.simulator}-{self.manifest.preset}@{self.manifest.fingerprint[:8]}"


def inside(root: Path, file: str) -> Path:
    """Return the path of a bank's file; raises BankError where it would lead outside the bank."""
    pure = PurePosixPath(file)
    path = root / pure
    try:
        outside = pure.is_absolute() or ".." in pure.parts or not path.resolve().is_relative_to(root.resolve())
    except (OSError, ValueError, RuntimeError) as error:  # a name too long, with a NUL, or a loop of links
        raise BankError(f"{file!r} is no file of the bank {root}: {error}") from error
    if outside:
        raise BankError(f"'{file}' leads outside the bank {root}; a bank's pictures must lie inside it")
    return path


def read_bounded(root: Path, file: str) -> bytes:
    """Return a bank file's bytes; raises BankError if it is missing, no file, outside the bank, or above 64 MB."""
    path = inside(root, file)
    try:
        if path.exists() and not path.is_file():
            raise BankError(f"'{file}' of the bank {root} is no file")
        if path.stat().st_size > MAX_IMAGE_BYTES:
            raise BankError(f"'{file}' has {path.stat().st_size} bytes; the limit is {MAX_IMAGE_BYTES}")
        return path.read_bytes()
    except OSError as error:
        raise BankError(f"'{file}' of the bank {root} cannot be read: {error.strerror}") from error


def decode(picture: bytes, name: str) -> RGB:
    """Decode a picture to RGB, shape (h, w, 3), uint8; its size is checked before a pixel is decoded.

    Raises BankError, naming the picture, if it is no picture, is truncated, or has more than 25 megapixels.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            opened = Image.open(io.BytesIO(picture), formats=("PNG", "JPEG", "WEBP", "BMP"))
        with opened:
            width, height = opened.size
            if width * height > MAX_PIXELS:
                raise BankError(
                    f"'{name}' has {width}×{height} pixels; the limit is {MAX_PIXELS // 1_000_000} megapixels"
                )
            return np.asarray(opened.convert("RGB"), dtype=np.uint8)
    except Image.DecompressionBombError as error:
        raise BankError(f"'{name}' has more than {MAX_PIXELS // 1_000_000} megapixels") from error
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        raise BankError(f"'{name}' is damaged or no picture: {error}") from error


def encode(rgb: RGB) -> bytes:
    """Encode an RGB picture, shape (h, w, 3), uint8, as PNG."""
    buffer = io.BytesIO()
    Image.fromarray(rgb, mode=None).save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()


def open_bank(root: Path) -> FrameBank:
    """Open a bank from its manifest and metadata; raises BankError naming the file and line at fault.

    Only text is read. The geometry is checked against the manifest's fingerprint here, the pictures by ``check``.
    """
    manifest = _read_manifest(root / "manifest.json")
    frames = read_metadata(root / "metadata.jsonl", manifest.prompt_columns)
    bank = FrameBank(root=root, frames=frames, manifest=manifest)
    problems = _geometry_problems(bank)
    if problems:
        raise BankError("; ".join(problems[:3]))
    for frame in frames:
        for file in (frame.file, *frame.counterfactuals.values()):
            inside(root, file)
    return bank


def _read_manifest(path: Path) -> BankManifest:
    try:
        raw = _plain(path.read_text(encoding="utf-8"))
        if raw.get("format") != FORMAT:
            raise BankError(f"{path} has format {raw.get('format')!r}; this eyechart reads {FORMAT!r}")
        manifest = BankManifest(
            simulator=str(raw["simulator"]),
            preset=str(raw["preset"]),
            picture=str(raw["picture"]),
            action_space=ActionSpace.from_dict(raw["action_space"]),
            gap=None if raw["gap"] is None else _gap(raw["gap"]),
            settings=dict(raw["settings"]),
            versions=_words(raw["versions"]),
            geometry=_words(raw["geometry"]),
            images=_words(raw["images"]),
            prompt_columns=tuple(map(str, _listed(raw, "prompt_columns"))),
            absent=tuple(map(str, _listed(raw, "absent"))),
            independent=_flag(raw, "independent"),
        )
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


def _gap(raw: Mapping[str, object]) -> Gap:
    threshold = raw["threshold"]
    if isinstance(threshold, bool) or not isinstance(threshold, int | float) or not math.isfinite(threshold):
        raise ValueError(f"the gap's threshold is {threshold!r}, not a number")
    return Gap(str(raw["column"]), float(threshold), str(raw["unit"]))


def _listed(raw: Mapping[str, object], name: str) -> list[object]:
    value = raw.get(name, [])
    if not isinstance(value, list):
        raise TypeError(f"{name} is {value!r}, not a list")
    return value


def _flag(raw: Mapping[str, object], name: str) -> bool:
    value = raw.get(name, False)
    if not isinstance(value, bool):
        raise TypeError(f"{name} is {value!r}, neither true nor false")
    return value


def _words(raw: Mapping[str, object]) -> dict[str, str]:
    for name, value in raw.items():
        if not isinstance(value, str):
            raise TypeError(f"{name!r} stands with {value!r}, not with a string")
    return {name: str(value) for name, value in raw.items()}


def read_metadata(path: Path, prompt_columns: tuple[str, ...] = ()) -> tuple[Frame, ...]:
    """Read a bank's ``metadata.jsonl``; raises BankError with the line at fault."""
    frames: list[Frame] = []
    try:
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise BankError(f"{path} cannot be read: {error.strerror}") from error
    for number, line in enumerate(lines, 1):
        try:
            frames.append(_frame_from_row(_plain(line.decode()), prompt_columns))
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


def _frame_from_row(row: dict[str, Scalar], prompt_columns: tuple[str, ...]) -> Frame:
    axis = read_axis(row["mirror_axis"])
    pictures = {
        name.removesuffix(_FILE_SUFFIX): str(row[name]) for name in row if name.endswith(_FILE_SUFFIX) and row[name]
    }
    truth = {name: row[name] for name in row if name not in _RESERVED and not name.endswith(_FILE_SUFFIX)}
    frame_id = str(row["frame_id"])
    fields = {name: truth.pop(name) for name in prompt_columns}
    return Frame(
        id=frame_id,
        scenario=str(row["scenario"]),
        episode=str(row["episode"]),
        step=int(str(row["step"])),
        mirror_axis=axis,
        file=str(row["file_name"]),
        truth=rounded_truth(truth, frame_id),
        counterfactuals=pictures,
        fields=rounded_truth(fields, frame_id),
    )


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


def check(root: Path) -> list[str]:
    """Recompute a bank's fingerprint and the hash of every picture; return what differs, one line each, by name.

    An empty list means that the bank is what its manifest says. Raises BankError if it cannot be opened at all.
    """
    manifest = _read_manifest(root / "manifest.json")
    bank = FrameBank(
        root=root, frames=read_metadata(root / "metadata.jsonl", manifest.prompt_columns), manifest=manifest
    )
    problems = _geometry_problems(bank)
    used = [file for frame in bank for file in _files(frame)]
    for file in used:
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


def _files(frame: Frame) -> list[str]:
    """Return a frame's files in the order in which a manifest lists them."""
    return [frame.file, *(frame.counterfactuals[name] for name in sorted(frame.counterfactuals))]


def _misplaced(bank: FrameBank) -> list[str]:
    """Return the first frame that shows another frame's picture: a digest of a file does not know whose it is."""
    recorded = iter(bank.manifest.images)
    for frame in bank:
        for file in _files(frame):
            own = next(recorded, None)
            if own != file:
                return [f"{bank.root / 'metadata.jsonl'}: frame '{frame.id}' shows '{file}', the manifest says '{own}'"]
    return []


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
        """Add a frame with its encoded pictures; ``frame.file`` and ``frame.counterfactuals`` name where they go."""
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
        for file, one in zip(_files(frame), pictures, strict=True):
            self._store(file, one)
        row |= {f"{name}{_FILE_SUFFIX}": file for name, file in frame.counterfactuals.items()}
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
