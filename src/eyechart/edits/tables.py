"""The two tables of photographs and objects as files, as an edit reads them."""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from eyechart.edits.annotations import OF_OBJECTS, OF_PHOTOS, ObjectBox, Photo
from eyechart.frames import encode

PHOTOS, OBJECTS = "photos.csv", "objects.csv"


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
