"""Of what a look is: a bank that is there, one made once of photographs or of a data set, or one of our own worlds."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from eyechart.errors import SourceError, SpecError, finite_number, raising
from eyechart.formats import FORMATS
from eyechart.importing.bank import Choices
from eyechart.importing.lerobot import Ahead, read_dataset
from eyechart.importing.photographs import Convert
from eyechart.loops import Progress
from eyechart.records import parse_json
from eyechart.simulators import open_bank_simulator

BANK, RECORD = "bank", "look.json"
FORMAT = "eyechart-look/1"

WORLD, STEPS = "highway", 18
"""Our own bank for a model: 216 frames of 12 episodes, the fewest on which each answer is found with power .8."""
TABLE, TABLE_STEPS = "tabletop", 6
"""Our own bank for a policy: 72 frames of 12 episodes."""
SEEDS = (0, 1, 2)

TAKEN = 300
"""About so many frames are taken of a data set: every Nth, so that all of its episodes are among them."""


_LONG_WAY = "; or make the bank with 'eyechart frames import', which takes these options, and give it with --frames"


@dataclass(frozen=True)
class Pictures:
    """Where frames come from; nothing given is a bank of our own.

    ``frames`` is a bank, ``photos`` a folder with its ``table``, ``dataset`` a LeRobotDataset. Of the last two
    ``columns`` maps places to columns, and below ``threshold`` in ``unit`` a distance is near. Raises SpecError where
    these contradict each other.
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
            raise SpecError(f"{' and '.join(several)} are two places for frames: give one")
        if (self.photos is None) != (self.table is None):
            raise SpecError("--photos FOLDER and --table FILE belong together: a row of the table is a photograph")
        said = {"--map": self.columns, "--threshold": self.threshold, "--unit": self.unit}
        lost = [name for name, one in said.items() if one not in (None, {})]
        if lost and self.photos is None and self.dataset is None:
            raise SpecError(f"{', '.join(lost)} is said of --photos or --dataset, and neither is given")
        if self.threshold is not None:
            finite_number("--threshold", self.threshold)

    @property
    def are_brought(self) -> bool:
        """Return whether a bank is made of photographs or of a data set, of which the import has something to say."""
        return self.photos is not None or self.dataset is not None

    def bank(self, out: Path, move: Progress, steps: int | None = None) -> Path:
        """Return where the bank lies: the one that was given, or that of the look's folder, which is made once.

        ``steps`` are those of a motion, where a policy is asked; ``move`` is told of the progress. Raises SpecError
        where the folder holds a bank of other pictures, and what the import or the build raises.
        """
        if self.frames is not None:
            return self.frames
        place = out / BANK
        if place.exists():
            self._require_same(out, steps)
            return place
        out.mkdir(parents=True, exist_ok=True)
        self._make(place, move, steps)
        said = {"format": FORMAT, "frames": self._said(steps)}
        (out / RECORD).write_text(json.dumps(said, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        return place

    def _make(self, place: Path, move: Progress, steps: int | None) -> None:
        choices = Choices(columns=self.columns, threshold=self.threshold, unit=self.unit, convert=Convert())
        if self.photos is not None and self.table is not None:
            FORMATS["table"].importer()(self.photos, table=self.table, out=place, choices=choices, progress=move)
        elif self.dataset is not None:
            frames = sum(one or 0 for one in read_dataset(self.dataset, None, every=True).episodes.lengths.values())
            ahead, every = None if steps is None else Ahead(steps), max(1, frames // TAKEN)
            own = Choices(columns=self.columns, threshold=self.threshold, unit=self.unit, every=every)
            with raising(SourceError, f"{self.dataset}", _LONG_WAY, of=SourceError):
                FORMATS["lerobot"].importer()(self.dataset, out=place, choices=own, ahead=ahead, progress=move)
        elif steps is None:
            open_bank_simulator(WORLD).build(place, seeds=SEEDS, steps=STEPS, progress=move)
        else:
            open_bank_simulator(TABLE).build(place, seeds=SEEDS, steps=TABLE_STEPS, progress=move)

    def _said(self, steps: int | None) -> dict[str, object]:
        """Return in plain values of what the folder's bank is made."""
        table = None if self.table is None else hashlib.sha256(self.table.read_bytes()).hexdigest()
        places = {"photos": self.photos, "dataset": self.dataset}
        found: dict[str, object] = {name: str(path.resolve()) for name, path in places.items() if path is not None}
        return {
            **(found or {"world": WORLD if steps is None else TABLE}),
            "table_sha256": table,
            "columns": dict(self.columns),
            "threshold": self.threshold,
            "unit": self.unit,
            "steps": steps if self.dataset is not None else None,
        }

    def made_with(self, out: Path) -> int | None:
        """Return of how many steps the motions of the look's folder's bank are; None where it holds no such bank."""
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
            raise SpecError(f"{record} does not say of what the bank is made; give another --out")
        return frames

    def _require_same(self, out: Path, steps: int | None) -> None:
        before, now = self._record(out), self._said(steps)
        if other := [name for name in now.keys() | before.keys() if before.get(name) != now.get(name)]:
            raise SpecError(
                f"{out} holds a bank of other pictures ({', '.join(sorted(other))}): give what it was made with, or "
                "another --out"
            )
