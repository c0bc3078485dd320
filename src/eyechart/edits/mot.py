"""Objects of MOT (Leal-Taixé et al. 2015): one text file of a sequence, a line an object and instant.

It has neither distances nor a horizon. Its pixels count from 1.
"""

from collections import defaultdict
from pathlib import Path

from eyechart.edits.annotations import IGNORED, OTHER, Annotations, ObjectBox, Photo
from eyechart.edits.geometry import Box
from eyechart.edits.numbers import PICTURES, numbers_of
from eyechart.errors import SourceError
from eyechart.importing.faults import Faults
from eyechart.importing.tables import text_lines

_FIELDS = 6
"""Frame, track, left, top, width, height; then confidence, class and the visible share."""

_OF_TRUTH = 9
_WHOLE, _PARTLY = 0.9, 0.5


def read(folder: Path, objects: Path, faults: Faults) -> Annotations:
    """Read a sequence's text file; the pictures' names are the numbers of their instants."""
    if not objects.is_file():
        raise SourceError(f"{objects} is no file; --objects is the gt.txt or det.txt of a sequence")
    pictures: dict[int, str] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in PICTURES and path.stem.isdecimal():
            other = pictures.setdefault(int(path.stem), path.name)
            if other != path.name:
                faults.add(f"{folder}: '{other}' and '{path.name}' are both of instant {int(path.stem)}; keep one")
    things: dict[int, list[ObjectBox]] = defaultdict(list)
    for number, line in enumerate(text_lines(objects, None), 1):
        if line.strip():
            where = f"{objects.name}, line {number}"
            with faults.noted():
                values = numbers_of(line.replace(",", " ").split(), where, _FIELDS, "six numbers of MOT")
                if not values[0].is_integer() or int(values[0]) not in pictures:
                    raise SourceError(f"{where}: there is no picture of instant {values[0]:g} in {folder}")
                things[int(values[0])].append(_thing(values, where))
    name = folder.parent.name if folder.name in {"img1", "images"} else folder.name
    photos = [
        Photo(file, {"episode": name, "step": step}, things=tuple(things[step]), where=f"instant {step}")
        for step, file in pictures.items()
        if step in things
    ]
    return Annotations(tuple(photos), ("episode", "step"))


def _thing(values: list[float], where: str) -> ObjectBox:
    left, top, width, height = values[2:_FIELDS]
    if width <= 0 or height <= 0:
        raise SourceError(f"{where}: its box is empty")
    box = Box(left - 1, top - 1, left - 1 + width, top - 1 + height)
    role, occluded = OTHER, 0.0
    if len(values) == _OF_TRUTH:
        role = IGNORED if values[6] == 0 else OTHER
        occluded = 0.0 if values[8] >= _WHOLE else 1.0 if values[8] >= _PARTLY else 2.0
    return ObjectBox(role, box, None, occluded=occluded, where=where)
