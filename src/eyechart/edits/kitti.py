"""Objects of KITTI (Geiger et al. 2012): a text file a picture, with boxes in the picture and in space."""

import math
from pathlib import Path

from eyechart.edits.annotations import IGNORED, OTHER, Annotations, ObjectBox, Photo
from eyechart.edits.geometry import Box
from eyechart.edits.numbers import numbers_of, pictures_of
from eyechart.errors import SourceError
from eyechart.importing.faults import Faults
from eyechart.importing.tables import text_lines

_FIELDS = 15
"""Type, truncated, occluded, alpha, 4 of the box, height, width, length, x, y, z, rotation."""

_UNMARKED = "DontCare"


def read(folder: Path, objects: Path, faults: Faults) -> Annotations:
    """Read a folder of labels; the horizon and the vanishing column are those of ``calib``, if it is there."""
    photos = []
    for file, labels in pictures_of(folder, objects, faults):
        things = []
        for number, line in enumerate(text_lines(labels, None), 1):
            if line.strip():
                with faults.noted():
                    things.append(_thing(line.split(), f"{labels.name}, line {number}"))
        column, row = None, None
        calibration = objects.parent / "calib" / labels.name
        if calibration.is_file():
            with faults.noted():
                column, row = _middle(calibration)
        photos.append(Photo(file, {}, row, column, things=tuple(things), where=labels.name))
    return Annotations(tuple(photos), ())


def _thing(words: list[str], where: str) -> ObjectBox:
    values = numbers_of(words[1:], where, _FIELDS - 1, f"{_FIELDS} fields of KITTI's labels")
    truncated, occluded, _, x0, y0, x1, y1, _, width, length, _, _, ahead, turned = values[: _FIELDS - 1]
    if words[0] == _UNMARKED:
        return ObjectBox(IGNORED, Box(x0, y0, x1, y1), None, where=where)
    if x1 <= x0 or y1 <= y0:
        raise SourceError(f"{where}: its box is empty")
    near = ahead - (length * abs(math.sin(turned)) + width * abs(math.cos(turned))) / 2
    return ObjectBox(
        OTHER,
        Box(x0, y0, x1, y1),
        near if near > 0 else None,
        truncated=max(truncated, 0.0),
        occluded=max(occluded, 0.0),
        where=where,
    )


def _middle(calibration: Path) -> tuple[float, float]:
    """Return column and row of the optical axis of camera 2: a level camera's vanishing point."""
    for line in text_lines(calibration, None):
        if line.startswith("P2:"):
            values = numbers_of(line.split()[1:], calibration.name, 12, "twelve numbers of P2")
            return values[2], values[6]
    raise SourceError(f"{calibration.name} has no line 'P2:' with twelve numbers")
