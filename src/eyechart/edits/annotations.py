"""What is known of photographs: their table, and the boxes, masks and distances of what they show."""

import csv
import io
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from eyechart.conditions import CONTROLS, COUNTERFACTUALS
from eyechart.edits.geometry import Box, Mask
from eyechart.errors import SourceError, suggestion
from eyechart.frames import DISTANCES, encode
from eyechart.importing.cells import Cell, Row, is_nothing, read_key, read_number
from eyechart.importing.columns import no_column
from eyechart.importing.faults import Faults
from eyechart.importing.photographs import Photographs
from eyechart.importing.tables import SourceTable, open_table

LEAD, OTHER, OWN, IGNORED = "lead", "", "own", "ignored"
ROLES = (LEAD, OTHER, OWN, IGNORED)
"""What an object is: what is ahead on the own way, another thing, a part of the own vehicle that is
in the picture, or a region in which things were not annotated."""

BOXES = ("xyxy", "xywh", "cxcywh", "percent")
"""What the four numbers of a box are: two corners; a corner and the size; the middle and the size;
or a corner and the size as percent of the picture's."""

PHOTOS, OBJECTS = "photos.csv", "objects.csv"
"""The files of the two tables that an edit writes."""

SIDES = ("left", "right")

OF_OBJECTS = ("file", "role", "x0", "y0", "x1", "y1", "distance_m", "mask", "truncated", "occluded")
_NEEDED = ("file", "x0", "y0", "x1", "y1")
OF_PHOTOS = ("horizon", "vanishing", "beside", "clear_to_m")
"""Columns of the photographs that only an edit reads."""

MADE = frozenset({"gap", *CONTROLS, *COUNTERFACTUALS, *DISTANCES, "lead_near_m", "lead_far_m"})
"""Columns that an edit makes, so that a table must not have them."""


@dataclass(frozen=True)
class ObjectBox:
    """One object of a photograph.

    ``box`` is in pixels, as in its row; ``distance_m`` is along the road to its near side, None if
    unknown. ``mask`` is a PNG file or corners ``x,y x,y …``, or empty. ``cut_out`` is a mask (h, w)
    that is at hand. ``truncated`` is the share outside of the picture. ``occluded`` is 0 for
    visible, 1 for partly, 2 for largely covered, 3 for unknown. ``where`` names its row. Raises
    SourceError for other shares and numbers.
    """

    role: str
    box: Box
    distance_m: float | None
    mask: str = ""
    truncated: float = 0.0
    occluded: float = 0.0
    where: str = ""
    cut_out: Mask | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if not 0 <= self.truncated <= 1:
            share = "it is the share outside of the picture, from 0 to 1"
            raise SourceError(f"{self.where}: truncated is {self.truncated:g}; {share}")
        if self.occluded not in range(4):
            known = "it is 0 for visible, 1 for partly, 2 for largely covered, 3 for unknown"
            raise SourceError(f"{self.where}: occluded is {self.occluded:g}; {known}")


@dataclass(frozen=True)
class Photo:
    """A photograph of the table with its objects.

    ``cells`` are the row's other cells. ``horizon`` and ``vanishing`` are the row and the column of
    the vanishing point, None if not given. ``beside`` are the sides whose way is free, and
    ``clear_to_m`` how far the ground is. ``size`` is the width and the height in pixels of the
    picture that was annotated, None if the annotation does not say.
    """

    file: str
    cells: Mapping[str, Cell]
    horizon: float | None = None
    vanishing: float | None = None
    beside: tuple[str, ...] = ()
    clear_to_m: float | None = None
    things: tuple[ObjectBox, ...] = ()
    where: str = ""
    size: tuple[int, int] | None = None

    @property
    def lead(self) -> ObjectBox | None:
        """Return what is ahead on the own way, None if nothing is."""
        return next((one for one in self.things if one.role == LEAD), None)

    def of(self, role: str) -> tuple[ObjectBox, ...]:
        """Return the things of a role."""
        return tuple(one for one in self.things if one.role == role)


@dataclass(frozen=True)
class Annotations:
    """All photographs in their order, and the columns of their table that are kept.

    ``left_out`` counts pictures of the folder that a form other than the tables does not name.
    """

    photos: tuple[Photo, ...]
    columns: tuple[str, ...]
    left_out: int = 0


def read_annotations(folder: Path, table: Path, objects: Path, boxes: str = BOXES[0]) -> Annotations:
    """Read a table of photographs and a table of their objects; raises SourceError with all faults.

    Boxes in per cent stay so until the picture's size is known (`in_pixels`).
    """
    faults = Faults()
    found = read_photos(folder, table, faults)
    things = _read_objects(Photographs(folder, objects.parent), objects, boxes, found.photos, faults)
    photos = tuple(replace(one, things=tuple(things[one.file])) for one in found.photos)
    for one in photos:
        require_one_lead(one, faults)
    faults.require_none(f"{table.name} with {objects.name}")
    return replace(found, photos=photos)


def read_photos(folder: Path, table: Path, faults: Faults) -> Annotations:
    """Read the table of photographs without their objects; what is wrong is added to the faults."""
    pictures, source = Photographs(folder, table.parent), open_table(table)
    _require_columns(source, ("file",), faults)
    for name in source.columns:
        if name in MADE:
            faults.add(f"{table.name} has the column '{name}', which an edit makes: rename it, or leave it out")
    photos: list[Photo] = []
    rows: dict[str, int] = {}
    for number, row in enumerate(source.rows, 1):
        if not row:  # its number of cells is a fault already
            continue
        where = f"{table.name}, row {number}"
        with faults.noted():
            one = _read_photo(pictures, row, where)
            if one.file in rows:
                raise SourceError(f"{where}: '{one.file}' is already in row {rows[one.file]}; a picture is one row")
            rows[one.file] = number
            photos.append(one)
    faults.join(source.faults)
    if not photos and not faults:
        faults.add(f"{table.name} has no rows; each row is a photograph")
    faults.require_none(table.name)
    return Annotations(tuple(photos), tuple(name for name in source.columns if name not in {"file", *OF_PHOTOS}))


def _require_columns(source: SourceTable, needed: Collection[str], faults: Faults) -> None:
    for name in needed:
        if name not in source.columns:
            faults.add(no_column(name, source.columns, source.name))
    faults.require_none(source.name)


def _read_photo(pictures: Photographs, row: Row, where: str) -> Photo:
    file = _file_of(row, pictures, where)
    if not (pictures.folder / file).is_file():
        raise SourceError(f"{where}: there is no picture '{file}' in {pictures.folder}")
    horizon, vanishing = (_number(row, name, where) for name in ("horizon", "vanishing"))
    return Photo(
        file=file,
        cells={name: cell for name, cell in row.items() if name not in {"file", *OF_PHOTOS}},
        horizon=horizon,
        vanishing=vanishing,
        beside=_read_sides(row.get("beside"), where),
        clear_to_m=_positive(row, "clear_to_m", where),
        where=where,
    )


def _file_of(row: Row, pictures: Photographs, where: str) -> str:
    """Return the path of a row's photograph below the folder; raises SourceError."""
    cell, what = row.get("file"), f"{where}: the file"
    if is_nothing(cell, "none"):
        raise SourceError(f"{what} is empty; each row names its photograph")
    return pictures.locate(read_key(cell, what), what)


def _read_sides(cell: Cell, where: str) -> tuple[str, ...]:
    """Return the sides whose way is declared free: left, right, or both."""
    if is_nothing(cell, "none"):
        return ()
    words = str(cell).lower().replace(",", " ").split()
    if words == ["both"]:
        return SIDES
    if not set(words) <= set(SIDES):
        raise SourceError(f"{where}: beside is {str(cell)[:40]!r}, not left, right, both or empty")
    return tuple(side for side in SIDES if side in words)


def _read_objects(
    pictures: Photographs, objects: Path, boxes: str, photos: Sequence[Photo], faults: Faults
) -> dict[str, list[ObjectBox]]:
    """Return the things of each photograph by its file."""
    things: dict[str, list[ObjectBox]] = {one.file: [] for one in photos}
    source = open_table(objects)
    _require_columns(source, _NEEDED, faults)
    for name in source.columns:
        if name not in OF_OBJECTS:
            faults.add(f"{source.name} has a column '{name}'{suggestion(name, OF_OBJECTS)}; it may have {_list()}")
    for number, row in enumerate(source.rows, 1):
        if not row:
            continue
        where = f"{source.name}, row {number}"
        with faults.noted():
            file = _file_of(row, pictures, where)
            if file not in things:
                near = suggestion(file, things)
                raise SourceError(f"{where}: '{file}' is no row of the photographs' table{near}")
            things[file].append(_read_thing(row, boxes, where))
    faults.join(source.faults)
    return things


def _list() -> str:
    return ", ".join(OF_OBJECTS)


def _read_thing(row: Row, boxes: str, where: str) -> ObjectBox:
    role = "" if is_nothing(row.get("role")) else str(row["role"]).strip().lower()
    if role not in ROLES:
        known = "lead, own, ignored, or empty for another thing"
        raise SourceError(f"{where}: role is '{role[:40]}', not {known}{suggestion(role, ROLES)}")
    numbers = [_number(row, name, where) for name in ("x0", "y0", "x1", "y1")]
    whole = [one for one in numbers if one is not None]
    if len(whole) < len(numbers):
        raise SourceError(f"{where}: a box needs its four numbers x0, y0, x1 and y1")
    mask = "" if is_nothing(row.get("mask")) else str(row["mask"]).strip()
    return ObjectBox(
        role=role,
        box=corners(whole, boxes, where),
        distance_m=_positive(row, "distance_m", where),
        mask=mask,
        truncated=_number(row, "truncated", where) or 0.0,
        occluded=_number(row, "occluded", where) or 0.0,
        where=where,
    )


def corners(numbers: Sequence[float], boxes: str, where: str) -> Box:
    """Return a box of its four numbers; raises SourceError if it has no size."""
    one, two, three, four = numbers
    if boxes in {"xywh", "percent"}:
        three, four = one + three, two + four
    elif boxes == "cxcywh":
        one, two, three, four = one - three / 2, two - four / 2, one + three / 2, two + four / 2
    if three <= one or four <= two:
        raise SourceError(
            f"{where}: the box {one:g}, {two:g} to {three:g}, {four:g} is empty; --boxes {' or '.join(BOXES)} says "
            "what its numbers are"
        )
    return Box(one, two, three, four)


def in_pixels(photo: Photo, boxes: str, width: int, height: int) -> Photo:
    """Return a photograph whose boxes in per cent are pixels of a picture of this size."""
    if boxes != "percent":
        return photo
    by = (width / 100, height / 100, width / 100, height / 100)
    made = (replace(one, box=Box(*(a * b for a, b in zip(one.box, by, strict=True)))) for one in photo.things)
    return replace(photo, things=tuple(made))


def require_one_lead(photo: Photo, faults: Faults) -> None:
    """Add a fault if several objects of a photograph lead."""
    leads = photo.of(LEAD)
    if len(leads) > 1:
        faults.add(f"{leads[1].where}: '{photo.file}' has its lead in {leads[0].where} already; one object leads")


def _number(row: Row, name: str, where: str) -> float | None:
    cell = row.get(name)
    return None if is_nothing(cell, "none") else read_number(cell, f"{where}: {name}", marks=False)


def _positive(row: Row, name: str, where: str) -> float | None:
    """Return a distance of more than 0 m, None for an empty cell."""
    found = _number(row, name, where)
    if found is not None and found <= 0:
        raise SourceError(f"{where}: {name} is {found:g}; a distance is more than 0, and an empty cell is unknown")
    return found


def csv_of(rows: Sequence[Mapping[str, object]], columns: Sequence[str]) -> bytes:
    """Return rows as a CSV file; an unknown cell is empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: "" if cell is None else cell for name, cell in row.items()} for row in rows)
    return text.getvalue().encode()


def as_tables(photos: Sequence[Photo], columns: Sequence[str]) -> dict[str, bytes]:
    """Return the files of the two tables, and of the masks that no file holds yet."""
    files: dict[str, bytes] = {}
    rows = []
    for photo in photos:
        for number, thing in enumerate(photo.things):
            mask = thing.mask
            if thing.cut_out is not None:
                mask = f"masks/{photo.file}-{number}.png"
                files[mask] = encode(np.repeat(thing.cut_out[..., None] * np.uint8(255), 3, axis=2))
            rows.append(_row(photo.file, thing, mask))
    of_photos = [{"file": one.file, **one.cells, **dict(_of_photo(one))} for one in photos]
    return {
        PHOTOS: csv_of(of_photos, ("file", *columns, *OF_PHOTOS)),
        OBJECTS: csv_of(rows, OF_OBJECTS),
        **files,
    }


def _of_photo(photo: Photo) -> Iterator[tuple[str, object]]:
    yield "horizon", photo.horizon
    yield "vanishing", photo.vanishing
    yield "beside", " ".join(photo.beside)
    yield "clear_to_m", photo.clear_to_m


def _row(file: str, thing: ObjectBox, mask: str) -> dict[str, object]:
    distance_m = None if thing.distance_m is None else round(thing.distance_m, 3)
    corners = {name: round(value, 2) for name, value in zip(("x0", "y0", "x1", "y1"), thing.box, strict=True)}
    seen = {"truncated": thing.truncated or None, "occluded": thing.occluded or None}
    return {"file": file, "role": thing.role, **corners, "distance_m": distance_m, "mask": mask, **seen}
