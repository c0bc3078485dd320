"""Photographs become a folder with control pictures, a table for the import, a sheet and a record."""

import hashlib
import json
import re
import shlex
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from eyechart import __version__
from eyechart.edits import checks
from eyechart.edits.annotations import (
    BOXES,
    IGNORED,
    OTHER,
    OWN,
    Annotations,
    ObjectBox,
    Photo,
    as_tables,
    csv_of,
    in_pixels,
)
from eyechart.edits.controls import EVERY, PICTURES, Edit, Editor, Moves
from eyechart.edits.formats import with_leads
from eyechart.edits.geometry import Box, Mask, box_of, grown
from eyechart.edits.lines import Ground, Sight, Size, sights_of, with_distances
from eyechart.edits.masks import BOX, PRICE, from_box, mask_of, usual_cut
from eyechart.edits.scene import CopyPlace, Cutout, EditScene, with_shadow
from eyechart.errors import BankError, SourceError, SpecError, counted
from eyechart.frames import (
    EXCHANGE,
    LEAD,
    RGB,
    Draws,
    decode,
    draws_of,
    encode,
    read_bounded,
    require_plain,
    size_of,
    whole_folder,
)
from eyechart.importing.faults import Faults
from eyechart.records import to_json_fields
from eyechart.report.contact_sheet import SheetCell, draw_sheet, small

METHOD = "edit/1"
"""The method and its version: another one makes other pictures of the same photographs."""

TABLE, RECORD, TAKEN = "table.csv", "edit.json", "taken"
_DISTANCES = ("lead_near_m", "lead_far_m", "lead_drawn_m", "exchange_m")
_SHOWN = 12
"""Reasons are printed up to this number; edit.json has every one."""
_NUMBERS = re.compile(r"\d+(\.\d+)?")
Copy = dict[str, float]
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Refusal:
    """A control picture that was not made, of one photograph or of all of its, and why."""

    file: str
    picture: str
    reason: str


@dataclass
class EditResult:
    """What an edit made: counts by picture, refusals, copies by file, masks by kind, and notes.

    ``copies`` are the distance, the metres to the left and the scale of every copy of a lead.
    """

    photographs: int
    parameters: dict[str, object]
    grounds: list[Ground]
    pictures: Counter[str] = field(default_factory=Counter)
    refused: list[Refusal] = field(default_factory=list)
    copies: dict[str, dict[str, list[Copy]]] = field(default_factory=dict)
    masks: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    digests: dict[str, str] = field(default_factory=dict)

    def as_dict(self) -> dict[str, object]:
        """Return the plain values of the record's file."""
        head = {"made": "edited", "method": METHOD, "eyechart": __version__, "scales": self.scales()}
        pictures = {name: self.pictures[name] for name in PICTURES}
        names = "parameters photographs refused copies masks notes digests"
        return head | to_json_fields(self, names, pictures=pictures, horizon=self.grounds)

    def scales(self) -> dict[str, list[float]]:
        """Return the smallest and the largest scale of the copies in each kind of picture."""
        found: dict[str, list[float]] = {}
        for pictures in self.copies.values():
            for name, copies in pictures.items():
                found.setdefault(name, []).extend(one["scale"] for one in copies)
        return {name: [min(many), max(many)] for name, many in found.items()}

    def lines(self, out: Path) -> list[str]:
        """Return what was made into ``out`` and what was refused, a line each."""
        lines = [f"{counted(count, 'photograph')} with {name}" for name, count in self.pictures.items()]
        reasons = self.by_reason()
        refused = [
            f"not made, {counted(count, 'picture')} or all of a photograph: {why}"
            for why, count in [*reasons.items()][:_SHOWN]
        ]
        more = [f"and {len(reasons) - _SHOWN} more reasons, in {out / RECORD}"] if len(reasons) > _SHOWN else []
        return [*lines, *refused, *more, *self.notes, f"look at {out / 'sheet.png'} before you go on"]

    def by_reason(self) -> dict[str, int]:
        """Return how many pictures were refused, by one of the reasons that differ in numbers only."""
        first: dict[str, str] = {}
        alike = [first.setdefault(_NUMBERS.sub("0", one.reason), one.reason) for one in self.refused]
        return dict(Counter(alike).most_common())


@dataclass(frozen=True)
class EditSource:
    """Where photographs and what is known of them come from.

    ``boxes`` says what the numbers of a box are, and ``cut`` how an object without a mask is cut
    out. ``from_foot`` is focal length times camera height in px·m, for unknown distances.
    ``beside`` is a further folder in which masks are sought. ``finds_leads`` says that no role is
    annotated: what is nearest on the own way leads, and the tables of what was found are written.
    """

    folder: Path
    annotations: Annotations
    beside: Path
    boxes: str = BOXES[0]
    cut: str = field(default_factory=usual_cut)
    from_foot: float | None = None
    finds_leads: bool = False


def edit_photographs(source: EditSource, moves: Moves, out: Path, progress: Progress | None = None) -> EditResult:
    """Write the control pictures of photographs into the new folder ``out``, and return the record.

    The folder has the photographs as taken, a folder for each control picture, ``table.csv`` as
    the import reads it, ``sheet.png`` and ``edit.json``. ``progress`` gets the number of
    photographs done. Raises SourceError with all faults if a photograph cannot be read,
    and if no control picture could be made; nothing is written then.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise SourceError(f"{out} exists already and is not an empty folder; choose another place for --out")
    sizes = _sizes(source)
    photos = [in_pixels(one, source.boxes, *sizes[one.file]) for one in source.annotations.photos]
    if source.from_foot is not None:
        photos = with_distances(photos, source.from_foot)
    sights, grounds = sights_of(photos, sizes)
    if source.finds_leads:
        photos = [*with_leads(photos, sights, *_of_way(moves))]
    record = EditResult(len(photos), _parameters(source, moves), grounds)
    draws = draws_of(moves.seed, moves.span, [one.file for one in photos])
    with whole_folder(out, SourceError) as work:
        work_on = _EditFolder(work, source, moves, record)
        rows = []
        for number, photo in enumerate(photos, 1):
            row = work_on.edit(photo, sights[photo.file], draws[photo.file])
            rows += [] if row is None else [row]
            if progress is not None:
                progress(number, len(photos))
        if source.finds_leads:
            work_on.write_tables(photos)
        work_on.finish(rows)
    return record


def _of_way(moves: Moves) -> tuple[float, float]:
    """Return the width of a way and the height of the camera, by which a lead is found."""
    if moves.lane_m is None or moves.eye_m is None:
        raise SpecError("no object has a role in this form: --lane and --eye say how wide the own way is")
    return moves.lane_m, moves.eye_m


def _sizes(source: EditSource) -> dict[str, Size]:
    """Return the size of each photograph, after a check that all programs show it alike."""
    faults, sizes = Faults(), {}
    files = {one.file for one in source.annotations.photos}
    for one in source.annotations.photos:
        with faults.noted():
            stored = read_bounded(source.folder, one.file)
            try:
                require_plain(stored, one.file)
            except BankError as error:
                raise SourceError(f"{one.where}: {error}; its boxes must be those of the picture as saved") from error
            size = sizes[one.file] = size_of(stored, one.file)
            if one.size not in {None, size}:
                raise SourceError(
                    f"{one.where}: it was annotated as a picture of {'×'.join(map(str, one.size or ()))} pixels, and "
                    f"'{one.file}' has {'×'.join(map(str, size))}; give the pictures that were annotated"
                )
            if not one.file.lower().endswith(".png") and f"{one.file}.png" in files:
                raise SourceError(
                    f"{one.where}: '{one.file}' and '{one.file}.png' would have pictures of one name; rename one"
                )
    faults.require_none(str(source.folder))
    return sizes


def _parameters(source: EditSource, moves: Moves) -> dict[str, object]:
    return {
        "near_m": list(moves.near),
        "far_m": list(moves.far),
        "lane_m": moves.lane_m,
        "eye_m": moves.eye_m,
        "seed": moves.seed,
        "shadow": moves.shadow,
        "limits": asdict(moves.limits),
        "boxes": source.boxes,
        "cut": source.cut,
        "from_foot_px_m": source.from_foot,
    }


Row = dict[str, object]

_LEADLESS = (
    "no photograph has an object with the role lead",
    "nothing stands on the own way by --lane, --eye, the horizon, and boxes in pixels; or annotate a lead",
)
"""What is wrong where nothing leads: with roles that are given, and with leads that are found."""


@dataclass
class _EditFolder:
    """The new folder while it is filled, a photograph at a time."""

    folder: Path
    source: EditSource
    moves: Moves
    record: EditResult

    def __post_init__(self) -> None:
        self._sheets = Sheets(self.folder)

    def edit(self, photo: Photo, sight: Sight, draws: Draws) -> Row | None:
        """Write a photograph and its control pictures; return its row, None if it has no place."""
        stored = read_bounded(self.source.folder, photo.file)
        lead = photo.lead
        if unknown := self._unknown(photo, sight, size_of(stored, photo.file)):
            self._refuse(photo, "real", unknown)
            return None
        self._write(f"{TAKEN}/{photo.file}", stored)
        gap = None if lead is None else lead.distance_m
        row: Row = {"file": f"{TAKEN}/{photo.file}", "gap": gap, **photo.cells}
        if lead is None:
            return row
        pixels = decode(stored, photo.file)
        scene, reasons = self._scene(photo, lead, pixels, sight)
        made = Edit() if reasons or scene is None else Editor(scene, photo, self.moves, draws, sight.fit).edit()
        for why in reasons:
            self._refuse(photo, EVERY, why)
        for name, why in made.refused.items():
            self._refuse(photo, name, why)
        for name, picture in made.pictures.items():
            file = f"{name}/{_as_png(photo.file)}"
            self._write(file, encode(picture))
            row[name] = file
            self.record.pictures[name] += 1
        if made.places and scene is not None:
            self.record.copies[photo.file] = {
                name: [_copied(scene, one) for one in places] for name, places in made.places.items()
            }
        self._sheets.add(photo, pixels, scene, made, reasons)
        return row | made.distances

    def _unknown(self, photo: Photo, sight: Sight, size: Size) -> str:
        """Return why nobody knows how far away the lead of a photograph is seen; "" where it is known.

        An empty gap would say that nothing is ahead, and a gap that the photograph shows it.
        """
        lead = photo.lead
        if lead is None:
            return sight.why if self.source.finds_leads and sight.lines is None else ""
        if lead.distance_m is None:
            return "the distance of its lead is not known: give distance_m, or --from-foot K"
        return "" if from_box(lead.box, *size).any() else f"{lead.where}: the box of its lead is outside of the picture"

    def _scene(self, photo: Photo, lead: ObjectBox, pixels: RGB, sight: Sight) -> tuple[EditScene | None, list[str]]:
        """Return the photograph taken apart, and why it cannot be edited."""
        rows, columns = pixels.shape[:2]
        if sight.lines is None:
            return None, [sight.why]
        try:
            own = self._cutout(lead, pixels)
            others = [self._cutout(one, pixels) for one in photo.of(OTHER)]
            hood = [self._cutout(one, pixels) for one in photo.of(OWN)]
        except SourceError as error:
            return None, [str(error)]
        reasons = [*checks.of_annotation(photo, own, rows, columns, self.moves.limits)]
        empty = np.zeros((rows, columns), np.bool_)
        hidden = _union([one.mask for one in hood], empty)
        apart = tuple(_without(one, own.mask) for one in others)
        apart = tuple(one for one in apart if one.mask.any())
        free = ~(_union([one.mask for one in apart], empty) | hidden)
        scene = EditScene(
            picture=pixels.astype(np.float32),
            lead=own,
            share=with_shadow(own.mask, free, self.moves.shadow),
            others=apart,
            own=hidden & ~own.mask,
            lines=sight.lines,
            eye_m=self.moves.eye_m,
        )
        ignored: Sequence[Box] = [one.box for one in photo.of(IGNORED)]
        return scene, [*reasons, *checks.of_scene(scene, ignored, sight.fit, self.moves.limits)]

    def _cutout(self, thing: ObjectBox, pixels: RGB) -> Cutout:
        mask, kind = mask_of(thing, pixels, [self.source.folder, self.source.beside], self.source.cut)
        self.record.masks[kind] += 1
        if not mask.any():
            raise SourceError(f"{thing.where}: its box is outside of the picture")
        return Cutout(mask, Box(*box_of(mask)), thing.distance_m, thing.where)

    def _refuse(self, photo: Photo, picture: str, why: str) -> None:
        self.record.refused.append(Refusal(photo.file, picture, why))

    def _write(self, file: str, content: bytes) -> None:
        place = self.folder / file
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)
        self.record.digests[file] = hashlib.sha256(content).hexdigest()

    def write_tables(self, photos: Sequence[Photo]) -> None:
        """Write what was found as two tables, which may be corrected and given in its place."""
        for file, content in as_tables(photos, self.source.annotations.columns).items():
            self._write(file, content)

    def finish(self, rows: Sequence[Row]) -> None:
        """Write table, sheet and record; raises SourceError if no control picture was made."""
        record = self.record
        if not record.pictures:
            few = [f"{why} ({counted(count, 'time')})" for why, count in [*record.by_reason().items()][:8]]
            said = "; ".join(few) or _LEADLESS[self.source.finds_leads]
            raise SourceError(f"no control picture could be made, and nothing was written: {said}")
        if left_out := self.source.annotations.left_out:
            record.notes.append(f"{counted(left_out, 'picture', 'are')} in no annotation, and left out")
        if record.masks[BOX]:
            record.notes.append(f"{counted(record.masks[BOX], 'object', 'are')} {PRICE}")
        record.notes += [
            f"the given horizons were not checked, so metres may be off where copies stand: {one.unchecked}"
            for one in record.grounds
            if one.unchecked
        ]
        self._write(TABLE, csv_of(rows, ("file", "gap", *self.source.annotations.columns, *PICTURES, *_DISTANCES)))
        for file in self._sheets.finish():
            record.digests[file.name] = hashlib.sha256(file.read_bytes()).hexdigest()
        text = json.dumps(record.as_dict(), indent=1, ensure_ascii=False)
        (self.folder / RECORD).write_text(f"{text}\n", encoding="utf-8")


def _copied(scene: EditScene, place: CopyPlace) -> Copy:
    """Return the plain values of a copy's place."""
    scale = round(scene.scale(place), 4)
    return {"distance_m": round(place.distance_m, 3), "left_m": round(place.left_m, 3), "scale": scale}


def _as_png(file: str) -> str:
    return file if file.lower().endswith(".png") else f"{file}.png"


def _union(masks: Sequence[Mask], empty: Mask) -> Mask:
    made = empty.copy()
    for one in masks:
        made |= one
    return made


def _without(one: Cutout, mask: Mask) -> Cutout:
    return Cutout(one.mask & ~mask, one.box, one.distance_m, one.where)


ROWS = 40
"""The photographs of one sheet; more are on further sheets."""

_CELL_PX = 260
_RED, _BLUE, _YELLOW = (255, 0, 0), (0, 0, 255), (255, 255, 0)
_METRES = {"lead_near": "lead_near_m", "lead_far": "lead_far_m", "lead_drawn": LEAD, "exchange_own": EXCHANGE}
_GREY = 200


@dataclass
class Sheets:
    """Sheets in a folder: ``sheet.png``, then ``sheet-2.png`` and so on."""

    folder: Path
    _rows: list[list[SheetCell]] = field(default_factory=list)
    _files: list[Path] = field(default_factory=list)

    def add(self, photo: Photo, pixels: RGB, scene: EditScene | None, made: Edit, reasons: list[str]) -> None:
        """Add a photograph: as taken with its annotation, and each control picture or its reason."""
        lead = photo.lead
        metres = "" if lead is None else f"  {lead.distance_m:.1f} m"
        why = [*reasons, *filter(None, [made.refused.get(EVERY)])][:1]
        row = [SheetCell((f"{photo.file}{metres}", *why), small(_annotated(pixels, scene), _CELL_PX))]
        empty = small(np.full_like(pixels, _GREY), _CELL_PX)
        for name in PICTURES if made.pictures else ():
            away = made.distances.get(_METRES.get(name, ""))
            words = f"{name}{'' if away is None else f'  {away:.1f} m'}"
            picture = made.pictures.get(name)
            row.append(
                SheetCell(
                    (words, made.refused.get(name, made.refused.get(EVERY, ""))),
                    empty if picture is None else small(picture, _CELL_PX),
                )
            )
        self._rows.append(row)
        if len(self._rows) == ROWS:
            self._write()

    def finish(self) -> list[Path]:
        """Write the last sheet, and return all of them."""
        if self._rows:
            self._write()
        return self._files

    def _write(self) -> None:
        number = len(self._files) + 1
        file = self.folder / ("sheet.png" if number == 1 else f"sheet-{number}.png")
        draw_sheet(self._rows, file, cell_px=_CELL_PX)
        self._files.append(file)
        self._rows = []


def _annotated(pixels: RGB, scene: EditScene | None) -> RGB:
    """Return a photograph with the outline of its lead, of other things, and its horizon."""
    shown = pixels.copy()
    if scene is None:
        return shown
    for colour, masks in ((_BLUE, [one.mask for one in scene.others]), (_RED, [scene.lead.mask])):
        for mask in masks:
            shown[grown(mask, 1) & ~mask] = colour
    row = round(scene.lines.horizon)
    if 0 <= row < len(shown):
        shown[row] = _YELLOW
    return shown


def import_command(out: Path, moves: Moves) -> str:
    """Return the command that makes a bank of an edited folder."""
    table, threshold = str(out / TABLE), f"{moves.between:g}"
    words = ["eyechart", "frames", "import", str(out), "--table", table, "--threshold", threshold]
    return shlex.join([*words, "--unit", "m", "--mirror", "horizontal", "--out", "bank"])
