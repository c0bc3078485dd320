"""Arrays of an HDF5 file, read in parts after a check of their unpacked size.

A small HDF5 file can declare an array of any size, unpack to gigabytes, or show the arrays of
another file. An array is therefore read only if the file holds all of it, and a compressed chunk
only if it unpacks to its declared size.
"""

import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from eyechart.errors import SourceError, plain_file, printable, raising
from eyechart.importing.parquet import MOST_ROWS, require

MOST_CHUNK = 64_000_000
"""Bytes of one unpacked chunk."""
MOST_MEMBERS = 100_000
"""Members of one group."""
MOST_TEXT = 1_000_000
"""Characters of one attribute."""
_GZIP, _SHUFFLE, _CHECKSUM = 1, 2, 3
_SPARE = 8
"""Bytes that a checksum adds to a chunk."""
_MALFORMED: tuple[type[Exception], ...] = (OSError, RuntimeError, ValueError, LookupError, TypeError)
_HARD = 0
"""The type of a member that is no link."""


@dataclass(frozen=True)
class Hdf5Array:
    """One array of an open file: its name in messages, its shape and its type.

    ``shape[0]`` counts the rows.
    """

    name: str
    data: Any
    _checked: list[tuple[int, int]] = field(default_factory=list)

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the size along each axis."""
        return tuple(self.data.shape)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Return the type of its numbers."""
        result: np.dtype[Any] = self.data.dtype
        return result

    def rows(self, start: int, stop: int) -> npt.NDArray[Any]:
        """Return rows from ``start`` to before ``stop``; raises SourceError for a faulty chunk."""
        with raising(SourceError, self.name, of=_MALFORMED):
            self._require_chunks(start, stop)
            return np.asarray(self.data[start:stop])

    def _require_chunks(self, start: int, stop: int) -> None:
        """Raise ValueError if a compressed chunk of these rows unpacks to more than it declares."""
        sizes, filters = self.data.chunks, _filters(self.data)
        if sizes is None or _GZIP not in filters:
            return
        place, size = filters.index(_GZIP), prod(sizes) * self.dtype.itemsize + _SPARE
        rows = range(start // sizes[0] * sizes[0], stop, sizes[0])
        span = (rows.start, stop)
        if self._checked and self._checked[0][0] <= span[0] and span[1] <= self._checked[0][1]:
            return
        others = [range(0, length, step) for length, step in zip(self.shape[1:], sizes[1:], strict=True)]
        for offset in product(rows, *others):
            stored = self.data.id.get_chunk_info_by_coord(offset).size
            if stored <= 2 * size:
                skipped, raw = self.data.id.read_direct_chunk(offset)
                packed = not skipped >> place & 1
                stored = len(zlib.decompressobj().decompress(raw, size + 1)) if packed else len(raw)
            if stored > size:
                raise ValueError(f"the chunk at row {offset[0]} unpacks to more than its {size - _SPARE} bytes")
        self._checked[:] = [(span[0], rows.start + len(rows) * sizes[0])]


@dataclass(frozen=True)
class Hdf5Group:
    """A group of an open file; ``name`` is the file and the path inside it."""

    path: Path
    name: str
    group: Any

    @property
    def label(self) -> str:
        """Return its place for messages."""
        return f"{self.path}: {self.name or 'the file'}"

    def members(self) -> list[str]:
        """Return the names of its members; raises SourceError for too many."""
        with raising(SourceError, self.label, of=_MALFORMED):
            if len(self.group) > MOST_MEMBERS:
                raise ValueError(f"it has {len(self.group)} members; the limit is {MOST_MEMBERS}")
            names = [*self.group.keys()]
            if odd := next((name for name in names if not isinstance(name, str)), None):
                raise ValueError(f"the name of its member {odd[:60]!r} is no UTF-8 text")
            return names

    def child(self, name: str) -> "Hdf5Group | None":
        """Return a group in it, None without; raises SourceError for a link."""
        found = self._member(name)
        return Hdf5Group(self.path, self._inner(name), found) if isinstance(found, Mapping) else None

    def array(self, name: str) -> Hdf5Array | None:
        """Return an array in it, None without.

        Raises SourceError for a link, for an array that is not wholly in the file, for values that
        are no numbers, and for chunks that are too large.
        """
        found = self._member(name)
        if type(found).__name__ != "Dataset":
            return None
        where = f"{self.path}: '{self._inner(name)}'"
        with raising(SourceError, where, of=_MALFORMED):
            _require_plain(found)
        return Hdf5Array(where, found)

    def text(self, name: str) -> str:
        """Return an attribute as text, empty without it; raises SourceError for a long one."""
        with raising(SourceError, f"{self.label}: the attribute '{name}'", of=_MALFORMED):
            if name not in self.group.attrs:
                return ""
            stored = self.group.attrs.get_id(name)
            if stored.shape not in {(), (1,)} or stored.get_storage_size() > MOST_TEXT:
                raise ValueError("it is no single text")
            value = self.group.attrs[name]
            value = value[0] if isinstance(value, np.ndarray) and value.shape == (1,) else value
            said = value.decode() if isinstance(value, bytes) else str(value)
            if len(said) > MOST_TEXT:
                raise ValueError(f"it has {len(said)} characters; the limit is {MOST_TEXT}")
            return said

    def has_attribute(self, name: str) -> bool:
        """Return whether it has an attribute."""
        return name in self.group.attrs

    def _inner(self, name: str) -> str:
        return f"{self.name}/{printable(name)}" if self.name else printable(name)

    def _member(self, name: str) -> Any:  # noqa: ANN401 - of h5py
        where = f"{self.path}: '{self._inner(name)}'"
        with raising(SourceError, where, of=_MALFORMED):
            links, key = self.group.id.links, name.encode()
            if not links.exists(key):
                return None
            if links.get_info(key).type != _HARD:
                raise ValueError("it is a link to another place or file, which is not followed; copy the data here")
            return self.group[name]


@contextmanager
def opened(path: Path) -> Iterator[Hdf5Group]:
    """Open a file; raises SourceError if it is no HDF5 file, or h5py is missing."""
    h5py = require("h5py", "h5py", "hdf5")
    with raising(SourceError, f"{path} cannot be read as HDF5", of=(OSError, RuntimeError, ValueError)):
        file = h5py.File(plain_file(path), "r", locking=False, rdcc_nbytes=MOST_CHUNK)
    with file:
        yield Hdf5Group(path, "", file)


def _filters(data: Any) -> Sequence[int]:  # noqa: ANN401 - of h5py
    created = data.id.get_create_plist()
    return [created.get_filter(place)[0] for place in range(created.get_nfilters())]


def _require_plain(data: Any) -> None:  # noqa: ANN401 - of h5py
    """Raise ValueError for an array that is not all in this file, or is no array of numbers."""
    if data.is_virtual or data.external:
        raise ValueError("its values are in other files, which are not read; copy them into this file")
    if data.dtype.kind not in "biuf" or data.dtype.subdtype is not None:
        raise ValueError(f"its values are no numbers but of type {printable(str(data.dtype))[:60]}; leave it out")
    if not data.shape or data.shape[0] > MOST_ROWS:
        raise ValueError(f"its shape is {data.shape}; the limit is {MOST_ROWS} rows")
    if data.chunks is None:
        stored, needed = data.id.get_storage_size(), prod(data.shape) * data.dtype.itemsize
        whole = stored >= needed
    else:
        _require_chunked(data)
        stored = data.id.get_num_chunks()
        needed = prod(-(-length // step) for length, step in zip(data.shape, data.chunks, strict=True))
        whole = stored == needed
    if not whole:
        unit = "bytes" if data.chunks is None else "chunks"
        raise ValueError(f"it declares {needed} {unit} of values, and the file holds {stored}")


def _require_chunked(data: Any) -> None:  # noqa: ANN401 - of h5py
    """Raise ValueError for chunks that are too large, or packed in another way than by gzip."""
    size = prod(data.chunks) * data.dtype.itemsize
    if size > MOST_CHUNK:
        raise ValueError(f"its chunks have {size} bytes; the limit is {MOST_CHUNK}: write smaller chunks")
    filters = _filters(data)
    if len(set(filters)) < len(filters) or not {*filters} <= {_GZIP, _SHUFFLE, _CHECKSUM}:
        raise ValueError(
            "it is not compressed by gzip alone (with shuffle or a checksum): write it so, as h5repack does"
        )
