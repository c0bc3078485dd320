"""Objects as lines of text: of KITTI (Geiger et al. 2012), of YOLO, and of MOT (Leal-Taixé et al. 2015)."""

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, TypeVar

import msgspec

from eyechart.edits.annotations import IGNORED, OTHER, Annotations, ObjectBox, Photo
from eyechart.edits.geometry import Box
from eyechart.errors import SourceError, plain_file, raising, read_at_most
from eyechart.frames import read_bounded, size_of
from eyechart.importing.faults import Faults
from eyechart.importing.tables import text_lines
from eyechart.records import parse_json

_OF_KITTI = 15
"""Type, truncated, occluded, alpha, 4 of the box, height, width, length, x, y, z, rotation."""

_UNMARKED = "dontcare"


def read_kitti(folder: Path, objects: Path, faults: Faults) -> Annotations:
    """Read a folder of labels; the horizon and the vanishing column are those of ``calib``, if it is there."""
    photos = []
    for file, labels in pictures_of(folder, objects, faults):
        things = []
        for number, line in enumerate(text_lines(labels, None), 1):
            if line.strip():
                with faults.noted():
                    things.append(_of_kitti(line.split(), f"{labels.name}, line {number}"))
        column, row = None, None
        calibration = objects.parent / "calib" / labels.name
        if calibration.is_file():
            with faults.noted():
                column, row = _middle(calibration)
        photos.append(Photo(file, {}, row, column, things=tuple(things), where=labels.name))
    return Annotations(tuple(photos), ())


def _of_kitti(words: list[str], where: str) -> ObjectBox:
    values = numbers_of(words[1:], where, _OF_KITTI - 1, f"{_OF_KITTI} fields of KITTI's labels")
    truncated, occluded, _, x0, y0, x1, y1, _, width, length, _, _, ahead, turned = values[: _OF_KITTI - 1]
    if words[0].lower() == _UNMARKED:
        return ObjectBox(IGNORED, Box(x0, y0, x1, y1), None, where=where)
    if x1 <= x0 or y1 <= y0:
        raise SourceError(f"{where}: its box is empty")
    near = ahead - (length * abs(math.sin(turned)) + width * abs(math.cos(turned))) / 2
    return ObjectBox(
        OTHER,
        Box(x0, y0, x1, y1),
        near if near > 0 else None,
        truncated=min(max(truncated, 0.0), 1.0),
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


_OF_BOX = 4


def read_yolo(folder: Path, objects: Path, faults: Faults) -> Annotations:
    """Read a folder of text files, whose numbers are shares of the picture.

    A line is ``class x y width height``, with the middle of the box, or ``class x1 y1 x2 y2 …``. One
    number more is the distance in metres, with a point in one of them at least: a tracker writes
    the number of its track there.
    """
    photos, written = [], set[str]()
    for file, labels in pictures_of(folder, objects, faults):
        things = []
        with faults.noted():
            size = size_of(read_bounded(folder, file), file)
            for number, line in enumerate(text_lines(labels, None), 1):
                if line.strip():
                    with faults.noted():
                        things.append(_of_yolo(words := line.split(), size, f"{labels.name}, line {number}"))
                        written.update(words[-1:] if things[-1].distance_m is not None else [])
        photos.append(Photo(file, {}, things=tuple(things), where=labels.name))
    away = [thing.distance_m for one in photos for thing in one.things if thing.distance_m is not None]
    if away and max(away) <= 1:
        faults.add(
            f"{objects}: no distance is above 1, as if the last number of a line were a confidence: take it away"
        )
    elif written and all(map(str.isdecimal, written)):
        faults.add(
            f"{objects}: every distance is a whole number, as if the last number of a line were that of a track: take "
            "it away, or write distances with a point, as 12.0"
        )
    return Annotations(tuple(photos), ())


def _of_yolo(words: list[str], size: tuple[int, int], where: str) -> ObjectBox:
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


_OF_MOT = 6
"""Frame, track, left, top, width, height; then confidence, class and the visible share."""

_OF_TRUTH = 9
_WHOLE, _PARTLY = 0.9, 0.5


def read_mot(folder: Path, objects: Path, faults: Faults) -> Annotations:
    """Read a sequence's text file; the pictures' names are the numbers of their instants.

    It has neither distances nor a horizon. Its pixels count from 1.
    """
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
                values = numbers_of(line.replace(",", " ").split(), where, _OF_MOT, "six numbers of MOT")
                if not values[0].is_integer() or int(values[0]) not in pictures:
                    raise SourceError(f"{where}: there is no picture of instant {values[0]:g} in {folder}")
                things[int(values[0])].append(_of_mot(values, where))
    name = folder.parent.name if folder.name in {"img1", "images"} else folder.name
    photos = [
        Photo(file, {"episode": name, "step": step}, things=tuple(things[step]), where=f"instant {step}")
        for step, file in pictures.items()
        if step in things
    ]
    return Annotations(tuple(photos), ("episode", "step"))


def _of_mot(values: list[float], where: str) -> ObjectBox:
    left, top, width, height = values[2:_OF_MOT]
    if width <= 0 or height <= 0:
        raise SourceError(f"{where}: its box is empty")
    box = Box(left - 1, top - 1, left - 1 + width, top - 1 + height)
    role, occluded = OTHER, 0.0
    if len(values) == _OF_TRUTH:
        role = IGNORED if values[6] == 0 else OTHER
        occluded = 0.0 if values[8] >= _WHOLE else 1.0 if values[8] >= _PARTLY else 2.0
    return ObjectBox(role, box, None, occluded=occluded, where=where)


PICTURES = (".png", ".jpg", ".jpeg", ".webp")
_GREATEST = 1e9
BoundedNumber = Annotated[float, msgspec.Meta(ge=-_GREATEST, le=_GREATEST)]
"""A number with which geometry does not overflow."""

MOST_BYTES = 2_000_000_000
"""The most bytes of one JSON file; the largest table of nuScenes has about half of it."""

T = TypeVar("T")


def read_document(path: Path, kind: type[T], what: str) -> T:
    """Return a JSON file as a record; what the record does not name is left out.

    Raises SourceError that says that the file is no ``what``.
    """
    with raising(SourceError, f"{path} cannot be read"):
        plain_file(path)
    text = read_at_most(path, MOST_BYTES, SourceError, what)
    with raising(SourceError, f"{path} is no {what}", of=(ValueError, RecursionError, msgspec.ValidationError)):
        return msgspec.convert(parse_json(text), kind)


def numbers_of(words: Sequence[str], where: str, least: int, what: str) -> list[float]:
    """Return words as numbers; raises SourceError for fewer than ``least``, which are ``what``."""
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise SourceError(f"{where}: {error}; it has not the {what}") from error
    if len(values) < least or not all(abs(one) < _GREATEST for one in values):
        raise SourceError(f"{where} has not the {what}")
    return values


def pictures_of(folder: Path, texts: Path, faults: Faults) -> Iterator[tuple[str, Path]]:
    """Yield the file of each picture below a folder with its text file of the same name.

    A picture without a text file is left out; a text file without a picture is a fault.
    """
    if not texts.is_dir():
        raise SourceError(f"{texts} is no folder; --objects is the folder with a text file a picture")
    labels = {
        path.relative_to(texts).with_suffix("").as_posix(): path
        for path in sorted(texts.rglob("*.txt"))
        if path.is_file()
    }
    taken: dict[str, str] = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() in PICTURES and path.is_file():
            file = path.relative_to(folder)
            name = file.with_suffix("").as_posix()
            found = labels.pop(name, None)
            if found is not None:
                taken[name] = file.as_posix()
                yield file.as_posix(), found
            elif name in taken:
                faults.add(f"{folder}: '{taken[name]}' and '{file.as_posix()}' have one text file; keep one")
    for name, path in labels.items():
        if Path(name).name not in {"classes", "obj", "train", "val", "test"}:
            faults.add(f"{path}: there is no picture '{name}' in {folder}")
