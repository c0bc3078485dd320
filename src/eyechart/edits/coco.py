"""Objects of COCO (Lin et al. 2014), which CVAT, Label Studio and Roboflow export: one JSON file.

``attributes`` of an annotation may hold ``distance_m``, ``role``, ``occluded`` and ``truncated``.
"""

from collections import Counter, defaultdict
from pathlib import Path

import msgspec
import numpy as np

from eyechart.edits.annotations import IGNORED, LEAD, OTHER, OWN, ROLES, Annotations, ObjectBox, Photo
from eyechart.edits.geometry import Box, Mask
from eyechart.edits.text_labels import BoundedNumber, read_document
from eyechart.errors import SourceError, suggestion
from eyechart.frames import MAX_PIXELS
from eyechart.importing.faults import Faults
from eyechart.importing.photographs import Photographs


class _Picture(msgspec.Struct):
    id: int | str
    file_name: str
    width: int | None = None
    height: int | None = None

    @property
    def size(self) -> tuple[int, int] | None:
        return None if self.width is None or self.height is None else (self.width, self.height)


class _Runs(msgspec.Struct):
    """A mask as runs of pixels that are out and in by turns, down the columns."""

    size: tuple[int, int]
    counts: list[int] | str


class _Category(msgspec.Struct):
    id: int
    name: str = ""


class _Object(msgspec.Struct):
    image_id: int | str
    bbox: tuple[BoundedNumber, BoundedNumber, BoundedNumber, BoundedNumber]
    id: int | str = 0
    category_id: int | None = None
    segmentation: list[list[BoundedNumber]] | _Runs | None = None
    iscrowd: int = 0
    attributes: dict[str, object] = {}


class _Set(msgspec.Struct):
    images: list[_Picture]
    annotations: list[_Object]
    categories: list[_Category] = []


def read(folder: Path, objects: Path, faults: Faults) -> Annotations:
    """Read a JSON file; a category or a role called ``lead`` or ``own`` says so of its objects."""
    found = read_document(objects, _Set, "COCO file")
    images = Counter(one.id for one in found.images)
    named = {(one.id, one.name.strip().lower()) for one in found.categories}
    for what, ids in (("images", images), ("categories", Counter(one for one, _ in named))):
        faults.take(f"{objects.name}: {many} {what} have the id {one!r}" for one, many in ids.items() if many > 1)
    names: dict[int | None, str] = dict(named)
    pictures, things = Photographs(folder, objects.parent), defaultdict[int | str, list[ObjectBox]](list)
    for one in found.annotations:
        where = f"{objects.name}, annotation {one.id}"
        one.attributes = {name.lower(): value for name, value in one.attributes.items()}
        with faults.noted():
            if one.image_id not in images:  # its picture would pass for an empty road
                raise SourceError(f"{where}: no image has its image_id {one.image_id!r}")
            things[one.image_id].append(_thing(one, names, where))
    photos = []
    for picture in found.images:
        where = f"{objects.name}, image {picture.id}"
        with faults.noted():
            file = pictures.locate(picture.file_name, f"{where}: the file")
            if not (folder / file).is_file():
                raise SourceError(f"{where}: there is no picture '{file}' in {folder}")
            photos.append(Photo(file, {}, things=tuple(things[picture.id]), where=where, size=picture.size))
    return Annotations(tuple(photos), ())


def _thing(one: _Object, names: dict[int | None, str], where: str) -> ObjectBox:
    x, y, width, height = one.bbox
    if width <= 0 or height <= 0:
        raise SourceError(f"{where}: its box is empty")
    role = IGNORED if one.iscrowd else _role(one, names, where)
    corners, cut_out = "", None
    if isinstance(one.segmentation, _Runs):
        cut_out = mask_of_runs(one.segmentation.size, one.segmentation.counts, where)
    elif one.segmentation and role != IGNORED:
        parts = (zip(part[::2], part[1::2], strict=False) for part in one.segmentation if len(part) >= 6)
        corners = "; ".join(" ".join(f"{a:g},{b:g}" for a, b in part) for part in parts)
    return ObjectBox(
        role,
        Box(x, y, x + width, y + height),
        _attribute(one, "distance_m", where) or None,
        corners,
        truncated=_attribute(one, "truncated", where),
        occluded=2.0 if one.attributes.get("occluded") is True else _attribute(one, "occluded", where),
        where=where,
        cut_out=cut_out,
    )


def _role(one: _Object, names: dict[int | None, str], where: str) -> str:
    """Return the attribute ``role``, else what the category's name says; raises SourceError."""
    said = str(one.attributes.get("role") or "").strip().lower()
    if said not in ROLES:
        known = f"lead, own, ignored, or empty for another thing{suggestion(said, ROLES)}"
        raise SourceError(f"{where}: role is '{said[:40]}', not {known}")
    if names and one.category_id not in {None, *names}:
        raise SourceError(f"{where}: no category has its category_id {one.category_id}")
    called = names.get(one.category_id, "")
    return said or (called if called in {LEAD, OWN} else OTHER)


def _attribute(one: _Object, name: str, where: str) -> float:
    """Return an attribute as a number of 0 or more, 0 if it is not there."""
    value = one.attributes.get(name)
    if value in (None, ""):
        return 0.0
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError) as error:
        raise SourceError(f"{where}: {name} is {str(value)[:40]!r}, not a number") from error
    if not 0 <= number < 1e9:
        raise SourceError(f"{where}: {name} is {number:g}, not a number of 0 or more")
    return number


def mask_of_runs(size: tuple[int, int], counts: list[int] | str, where: str) -> Mask:
    """Return the mask (h, w) of COCO's runs, plain or packed as text; raises SourceError."""
    height, width = size
    if not (height > 0 and width > 0 and height * width <= MAX_PIXELS):
        raise SourceError(f"{where}: its mask has {height}×{width} pixels")
    runs = _unpacked(counts, where) if isinstance(counts, str) else counts
    if min(runs, default=0) < 0 or sum(runs) != height * width:
        raise SourceError(f"{where}: the runs of its mask are not the {height * width} pixels of its size")
    values = np.arange(len(runs)) % 2 == 1
    return np.repeat(values, runs).reshape(width, height).T


def _unpacked(text: str, where: str) -> list[int]:
    """Return the runs of a packed text: five bits a sign, differences to the run before the last."""
    runs: list[int] = []
    value = shift = 0
    for sign in text:
        bits = ord(sign) - 48
        if not 0 <= bits < 64 or shift > 30:
            raise SourceError(f"{where}: the runs of its mask are not packed as COCO packs them")
        value |= (bits & 31) << shift
        shift += 5
        if bits & 32:
            continue
        if bits & 16:
            value |= -1 << shift
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
        value = shift = 0
    return runs
