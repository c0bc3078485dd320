"""The forms of annotations: each becomes the one table of photographs and their objects."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from eyechart.edits import coco, nuscenes
from eyechart.edits.annotations import (
    BOXES,
    LEAD,
    OTHER,
    Annotations,
    ObjectBox,
    Photo,
    read_annotations,
    read_photos,
    require_one_lead,
)
from eyechart.edits.geometry import Lines
from eyechart.edits.lines import Sight
from eyechart.edits.text_labels import PICTURES, read_kitti, read_mot, read_yolo
from eyechart.errors import SourceError, SpecError, require_known
from eyechart.importing.faults import Faults

TABLE = "table"


@dataclass(frozen=True)
class AnnotationFormat:
    """A form of annotations: what reads it, what ``--objects`` is, and what it does not say."""

    read: Callable[[Path, Path, Faults], Annotations]
    objects: str
    lacks: str


ANNOTATION_FORMATS: Mapping[str, AnnotationFormat] = {
    "kitti": AnnotationFormat(read_kitti, "the folder label_2, with calib beside it", "masks"),
    "nuscenes": AnnotationFormat(nuscenes.read, "the folder of its tables, as v1.0-mini", "masks"),
    "coco": AnnotationFormat(
        coco.read, "the JSON file; CVAT, Label Studio and Roboflow export it", "a horizon; distance_m is an attribute"
    ),
    "yolo": AnnotationFormat(
        read_yolo, "the folder of its text files", "a horizon; distance_m is one column more than usual"
    ),
    "mot": AnnotationFormat(read_mot, "gt.txt or det.txt", "distances and a horizon"),
}
"""Every form but the two tables, by its name in ``--format``."""


def read_format(name: str, folder: Path, objects: Path, table: Path | None) -> Annotations:
    """Read annotations in one of `ANNOTATION_FORMATS`, for the rows of a table if there is one.

    A table's row says what the form does not: the horizon, the free side, the episode. Raises
    SourceError with all faults.
    """
    if not folder.is_dir():
        raise SourceError(f"{folder} is no folder of photographs")
    faults = Faults()
    found = ANNOTATION_FORMATS[name].read(folder, objects, faults)
    seen: dict[str, Photo] = {}
    for one in found.photos:
        require_one_lead(one, faults)
        if seen.setdefault(one.file, one) is not one:
            faults.add(f"{one.where}: '{one.file}' is already in {seen[one.file].where}; a picture is annotated once")
    faults.require_none(str(objects))
    if not found.photos:
        raise SourceError(f"{objects} annotates no picture of {folder}")
    if table is None and name != "nuscenes":  # its folder has pictures of other cameras too
        pictures = sum(path.suffix.lower() in PICTURES for path in folder.rglob("*"))
        found = replace(found, left_out=pictures - len(found.photos))
    return found if table is None else _joined(found, read_photos(folder, table, faults), objects, faults)


def _joined(found: Annotations, rows: Annotations, objects: Path, faults: Faults) -> Annotations:
    """Return the photographs of a table with the things of another form."""
    by_file = {one.file: one for one in found.photos}
    photos = []
    for row in rows.photos:
        one = by_file.get(row.file)
        if one is None:
            faults.add(f"{row.where}: '{row.file}' is not annotated in {objects}")
            continue
        photos.append(
            replace(
                row,
                cells={**one.cells, **row.cells},
                horizon=one.horizon if row.horizon is None else row.horizon,
                vanishing=one.vanishing if row.vanishing is None else row.vanishing,
                things=one.things,
            )
        )
    faults.require_none(objects.name)
    return Annotations(tuple(photos), tuple(dict.fromkeys((*found.columns, *rows.columns))))


def with_leads(photos: Sequence[Photo], sights: Mapping[str, Sight], lane_m: float, eye_m: float) -> Iterator[Photo]:
    """Yield photographs whose lead is the nearest thing on the own way, where none has the role.

    A thing is on it if the middle of its foot is less than half a way's width from the line to the
    vanishing point.
    """
    for photo in photos:
        lines = sights[photo.file].lines
        if photo.lead is not None or lines is None:
            yield photo
            continue
        on_way = [one for one in photo.of(OTHER) if _is_ahead(one, lines, lane_m / eye_m)]
        lead = max(on_way, key=lambda one: one.box.y1, default=None)
        yield replace(photo, things=tuple(replace(one, role=LEAD) if one is lead else one for one in photo.things))


def _is_ahead(thing: ObjectBox, lines: Lines, lane_per_eye: float) -> bool:
    below = thing.box.y1 - lines.horizon
    return below > 1 and abs((thing.box.x0 + thing.box.x1) / 2 - lines.column) < lane_per_eye * below / 2


def annotations_of(form: str, photos: Path, objects: Path, table: Path | None, boxes: str) -> Annotations:
    """Return the annotations of two tables (the ``form`` "table"), or of one of `ANNOTATION_FORMATS`.

    Raises SpecError for an unknown form, and for boxes or a missing table that do not fit it.
    """
    require_known(f"--format '{form}'", form, (TABLE, *ANNOTATION_FORMATS))
    require_known(f"--boxes '{boxes}'", boxes, BOXES)
    if form != TABLE:
        if boxes != BOXES[0]:
            raise SpecError(f"--boxes is for the table of objects: --format {form} says itself what its boxes are")
        return read_format(form, photos, objects, table)
    if table is None:
        raise SpecError("give --table, the table of the photographs with a row each, or the --format of the objects")
    return read_annotations(photos, table, objects, boxes)
