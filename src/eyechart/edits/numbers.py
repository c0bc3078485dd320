"""What forms of annotations are written in: numbers of text files, a text file a picture, JSON."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, TypeVar

import msgspec

from eyechart.errors import SourceError, plain_file, raising, read_at_most
from eyechart.importing.faults import Faults
from eyechart.records import parse_json

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
        raise SourceError(f"{where}: {error}") from error
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
