"""The bank of a look: a given one, one made from photographs or a data set, or a drawn one."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from eyechart.errors import SourceError, SpecError, finite_number, plain_file, raising
from eyechart.event_loops import Progress
from eyechart.formats import FORMATS, format_of_data_set
from eyechart.importing.bank import Choices
from eyechart.importing.lerobot import Horizon
from eyechart.importing.photographs import Convert
from eyechart.records import parse_json
from eyechart.simulators import open_bank_simulator

BANK, RECORD = "bank", "look.json"
FORMAT = "eyechart-look/1"

WORLD, STEPS = "highway", 18
"""The drawn bank for a model: 216 frames of 12 episodes, the fewest with power .8 per answer."""
TABLE, TABLE_STEPS = "tabletop", 6
"""The drawn bank for a policy: 72 frames of 12 episodes."""
SEEDS = (0, 1, 2)

_FILES, _END_BYTES = "files", 65_536
_CONTENT = frozenset(
    (
        *(".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff", ".gif", ".mp4"),
        *(".parquet", ".json", ".jsonl", ".csv", ".hdf5", ".h5", ".hdf"),
    )
)
"""The files whose content a record covers; a bank is made from no others."""

TAKEN = 300
"""About this many frames of a data set are used: every Nth, from all episodes."""


_OF_IMPORT = ("--no-lead", "no_lead=", "--numbers", "numbers=")
"""Options that an error about a table names, and that a look does not have."""
LONG_WAY = "; for an option that this names, make the bank with 'eyechart frames import', and give it with --frames"
"""The end of an error of a data set that needs options of its import."""


@dataclass(frozen=True)
class Pictures:
    """The source of a look's frames; without one, eyechart draws a bank.

    ``frames`` is a bank, ``photos`` a folder with its ``table``, ``dataset`` a
    LeRobotDataset or demonstrations in HDF5. For the last two, ``columns`` maps places to columns,
    and a distance below ``threshold`` in ``unit`` is near. Raises SpecError if these contradict
    each other.
    """

    frames: Path | None = None
    photos: Path | None = None
    table: Path | None = None
    dataset: Path | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    threshold: float | None = None
    unit: str | None = None

    def __post_init__(self) -> None:
        given = {"--frames": self.frames, "--photos": self.photos, "--dataset": self.dataset}
        several = [name for name, path in given.items() if path is not None]
        if len(several) > 1:
            raise SpecError(f"{' and '.join(several)} both give frames: give one")
        if (self.photos is None) != (self.table is None):
            raise SpecError("--photos FOLDER and --table FILE belong together: each row of the table is a photograph")
        said = {"--map": self.columns, "--threshold": self.threshold, "--unit": self.unit}
        lost = [name for name, one in said.items() if one not in (None, {})]
        if lost and self.photos is None and self.dataset is None:
            raise SpecError(f"{', '.join(lost)} needs --photos or --dataset: give one of them")
        if self.threshold is not None:
            finite_number("--threshold", self.threshold)

    @property
    def are_brought(self) -> bool:
        """Return whether a bank is imported, so that the import's notes are printed."""
        return self.photos is not None or self.dataset is not None

    def bank(self, out: Path, move: Progress, steps: int | None = None, history: int = 0) -> Path:
        """Return the bank's path: the given one, or the look's own, which is made once.

        ``steps`` is the length of a policy's motions, and ``history`` the number of instants before
        a data set's frames that it needs. ``move`` gets the progress. Raises SpecError if the
        folder holds a bank of other pictures, and what the import or the build raises.
        """
        if self.frames is not None:
            return self.frames
        place = out / BANK
        if place.exists():
            self._require_same(out, steps, history)
            return place
        out.mkdir(parents=True, exist_ok=True)
        said = {"format": FORMAT, "frames": self._said(out, steps, history)}
        (out / RECORD).write_text(json.dumps(said, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        self._make(place, move, steps, history)  # last: a bank without a record would be refused later
        return place

    def _make(self, place: Path, move: Progress, steps: int | None, history: int) -> None:
        choices = Choices(columns=self.columns, threshold=self.threshold, unit=self.unit, convert=Convert())
        if self.photos is not None and self.table is not None:
            try:
                FORMATS["table"].importer()(self.photos, table=self.table, out=place, choices=choices, progress=move)
            except SourceError as error:
                named = any(option in str(error) for option in _OF_IMPORT)
                raise SourceError(f"{error}{LONG_WAY if named else ''}") from error
        elif self.dataset is not None:
            form, ahead = format_of_data_set(self.dataset), None if steps is None else Horizon(steps, rotations=None)
            with raising(SourceError, f"{self.dataset}", LONG_WAY, of=SourceError):
                every = max(1, form.length(self.dataset) // TAKEN)
                own = replace(choices, every=every, history=history, convert=None)
                form.importer()(self.dataset, out=place, choices=own, ahead=ahead, progress=move)
        elif steps is None:
            open_bank_simulator(WORLD).build(place, seeds=SEEDS, steps=STEPS, progress=move)
        else:
            open_bank_simulator(TABLE).build(place, seeds=SEEDS, steps=TABLE_STEPS, progress=move)

    def _said(self, out: Path, steps: int | None, history: int) -> dict[str, object]:
        """Return in plain values what the bank in the folder ``out`` is made from."""
        table = None if self.table is None else hashlib.sha256(self.table.read_bytes()).hexdigest()
        places = {"photos": self.photos, "dataset": self.dataset}
        found: dict[str, object] = {name: str(path.resolve()) for name, path in places.items() if path is not None}
        given = next((path for path in places.values() if path is not None), None)
        return {
            **({} if given is None else {_FILES: _digest(given, out)}),
            **(found or {"world": WORLD if steps is None else TABLE}),
            "table_sha256": table,
            "columns": dict(self.columns),
            "threshold": self.threshold,
            "unit": self.unit,
            "steps": steps if self.dataset is not None else None,
            **({"history": history} if history and self.dataset is not None else {}),
        }

    def made_with(self, out: Path) -> int | None:
        """Return the number of steps of the motions in the look's own bank; None if it has none."""
        if not (out / BANK).exists():
            return None
        steps = self._record(out).get("steps")
        return steps if isinstance(steps, int) else None

    def _record(self, out: Path) -> dict[str, object]:
        record = out / RECORD
        with raising(SpecError, f"{record} cannot be read", "; give another --out", of=(OSError, ValueError)):
            found = parse_json(record.read_bytes())
        frames = found.get("frames") if isinstance(found, dict) else None
        if not isinstance(frames, dict):
            raise SpecError(f"{record} does not say what the bank is made from; give another --out")
        return frames

    def _require_same(self, out: Path, steps: int | None, history: int) -> None:
        before, now = self._record(out), self._said(out, steps, history)
        now = now if _FILES in before else {name: one for name, one in now.items() if name != _FILES}  # an older look
        if other := [name for name in now.keys() | before.keys() if before.get(name) != now.get(name)]:
            raise SpecError(
                f"{out} holds a bank of other pictures ({', '.join(sorted(other))}): give the same options as "
                "before, or another --out"
            )


def _digest(place: Path, out: Path) -> str:
    """Return the SHA-256 of a file's, or of a folder's files', names, sizes and ends, without those in ``out``.

    The ends of a file are its first and last bytes: a data set may have gigabytes.
    """
    found, own = hashlib.sha256(), out.resolve()
    for path in sorted(place.rglob("*")) if place.is_dir() else [place]:
        if path.suffix.lower() in _CONTENT and path.is_file() and not path.resolve().is_relative_to(own):
            with plain_file(path).open("rb") as file:
                size = path.stat().st_size
                found.update(f"{path.relative_to(place).as_posix()}\x1f{size}\x1f".encode())
                found.update(file.read(_END_BYTES))
                file.seek(max(0, size - _END_BYTES))
                found.update(file.read(_END_BYTES))
    return found.hexdigest()
