"""Objects of YOLO: a text file a picture, with boxes or polygons as shares of the picture.

A line is ``class x y width height``, with the middle of the box, or ``class x1 y1 x2 y2 …``. One
number more is the distance in metres.
"""

from pathlib import Path

from eyechart.edits.annotations import OTHER, Annotations, ObjectBox, Photo
from eyechart.edits.geometry import Box
from eyechart.edits.numbers import numbers_of, pictures_of
from eyechart.errors import SourceError
from eyechart.frames import read_bounded, size_of
from eyechart.importing.faults import Faults
from eyechart.importing.tables import text_lines

_OF_BOX = 4


def read(folder: Path, objects: Path, faults: Faults) -> Annotations:
    """Read a folder of text files."""
    photos = []
    for file, labels in pictures_of(folder, objects, faults):
        things = []
        with faults.noted():
            size = size_of(read_bounded(folder, file), file)
            for number, line in enumerate(text_lines(labels, None), 1):
                if line.strip():
                    with faults.noted():
                        things.append(_thing(line.split(), size, f"{labels.name}, line {number}"))
        photos.append(Photo(file, {}, things=tuple(things), where=labels.name))
    return Annotations(tuple(photos), ())


def _thing(words: list[str], size: tuple[int, int], where: str) -> ObjectBox:
    values = numbers_of(words, where, 1 + _OF_BOX, "class and four numbers of a box")[1:]
    distance_m = values.pop() if len(values) % 2 else None
    if not all(-0.5 <= one <= 1.5 for one in values):
        raise SourceError(f"{where}: its numbers must be shares of the picture, from 0 to 1")
    if distance_m is not None and distance_m <= 0:
        raise SourceError(f"{where}: the distance is {distance_m:g}; it is more than 0, and none is left out")
    width, height = size
    if len(values) == _OF_BOX:
        x, y, w, h = values
        box, mask = Box((x - w / 2) * width, (y - h / 2) * height, (x + w / 2) * width, (y + h / 2) * height), ""
    else:
        corners = [(x * width, y * height) for x, y in zip(values[::2], values[1::2], strict=True)]
        columns, rows = zip(*corners, strict=True)
        box, mask = (
            Box(min(columns), min(rows), max(columns), max(rows)),
            " ".join(f"{x:.2f},{y:.2f}" for x, y in corners),
        )
    if box.x1 <= box.x0 or box.y1 <= box.y0:
        raise SourceError(f"{where}: its box is empty")
    return ObjectBox(OTHER, box, distance_m, mask, where=where)
