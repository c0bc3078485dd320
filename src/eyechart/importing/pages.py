"""The unpacked size of a Parquet file's pages, from their headers, before any is unpacked.

A footer may make any claim about the pages, and a reader believes each page's header. All headers
are therefore read here. Their format is that of github.com/apache/parquet-format,
``parquet.thrift``, in Thrift's compact protocol. A file with a repeated field or one of a wrong
type is refused, because readers differ in which value they take.
"""

from bisect import bisect_left
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import SEEK_END
from itertools import accumulate
from pathlib import Path
from typing import Any, BinaryIO

from eyechart.errors import SourceError, plain_file, raising

BATCH_ROWS = 1024
"""Rows that are read at a time."""
MOST_UNPACKED = 192_000_000
"""Bytes of the pages in memory at a time, of all columns; text counts three times, as a reader
copies it."""
MOST_LISTED = 16_000_000
"""Numbers in the vectors of one row group: a file may put all of them into one row."""
MOST_FOOTER = 8_000_000
"""Bytes of the footer."""
MOST_STRUCTS = 200_000
"""Structs of a footer; a reader needs up to a kilobyte for each."""
MOST_COMPONENTS = 128
"""The most components of a vector that become columns; longer vectors are left out."""
_MOST_ELEMENTS, _MOST_NESTED = 10_000, 32
_MOST_PAGES = 2_000_000
_MOST_WIDTH = 64
"""Bytes of a value of fixed length; a null takes as many."""
_HEADER, _MOST_HEADER = 4_096, 1_000_000
_MAGIC, _TAIL = b"PAR1", 8

_TRUE, _FALSE, _BYTE, _I16, _I32, _I64, _DOUBLE, _BINARY, _LIST, _SET, _, _STRUCT = range(1, 13)
_DATA, _DICTIONARY, _DATA_2 = 0, 2, 3
_WORDS, _FIXED = 6, 7
_REPEATED = 2
_ENCODINGS = {0, 2, 3, 5, 8, 9}
"""PLAIN, PLAIN_DICTIONARY, RLE, DELTA_BINARY_PACKED, RLE_DICTIONARY and BYTE_STREAM_SPLIT, whose
values take no more bytes than their page. The size of strings in DELTA encodings is known only
after reading."""

Fields = Mapping[int, tuple[int, Any]]
"""A Thrift struct: the type and the value of each field by its number."""


class _MalformedError(Exception):
    """A header is no struct of Thrift's compact protocol, or asks for more than is allowed."""


class _TruncatedError(_MalformedError):
    """The struct continues behind the given bytes."""


@dataclass(slots=True)
class _CompactProtocol:
    """Reads Thrift's compact protocol from bytes, within a number of structs."""

    data: bytes
    structs: int
    at: int = 0

    def struct(self, depth: int = 0) -> dict[int, tuple[int, Any]]:
        """Return a struct; raises _MalformedError for a repeated field.

        Readers differ in which of two values they take.
        """
        self.structs -= 1
        if self.structs < 0:
            raise _MalformedError(f"it has more than {MOST_STRUCTS} parts")
        result: dict[int, tuple[int, Any]] = {}
        number = 0
        while head := self._take(1)[0]:
            number = number + (head >> 4) if head >> 4 else self._whole()
            kind = head & 15
            if number in result:
                raise _MalformedError(f"it says field {number} twice")
            result[number] = (kind, kind == _TRUE if kind in {_TRUE, _FALSE} else self._value(kind, depth))
        return result

    def _value(self, kind: int, depth: int) -> Any:  # noqa: ANN401 - of any type
        if depth > _MOST_NESTED:
            raise _MalformedError("its parts are nested too deep")
        if kind in {_I16, _I32, _I64}:
            return self._whole()
        if kind in {_TRUE, _FALSE, _BYTE}:
            return self._take(1)[0]
        if kind in {_DOUBLE, _BINARY}:
            return self._take(8 if kind == _DOUBLE else self._unsigned())
        if kind in {_LIST, _SET}:
            head = self._take(1)[0]
            size = head >> 4 if head >> 4 != 15 else self._unsigned()
            if size > len(self.data) - self.at:
                raise _TruncatedError("it ends before its end")  # each element has a byte or more
            return [self._value(head & 15, depth + 1) for _ in range(size)]
        if kind == _STRUCT:
            return self.struct(depth + 1)
        raise _MalformedError(f"it holds a value of type {kind}")  # a map too: the format has none

    def _whole(self) -> int:
        number = self._unsigned()
        return (number >> 1) ^ -(number & 1)

    def _unsigned(self) -> int:
        number = 0
        for shift in range(0, 70, 7):
            one = self._take(1)[0]
            number |= (one & 127) << shift
            if one < 128:
                return number
        raise _MalformedError("it holds a number of more than 64 bits")

    def _take(self, count: int) -> bytes:
        if self.at + count > len(self.data):
            raise _TruncatedError("it ends before its end")
        self.at += count
        return self.data[self.at - count : self.at]


def _may(fields: Fields, number: int, kind: int) -> Any:  # noqa: ANN401 - of this type, or None
    """Return a field, None if it is missing; raises _MalformedError for another type."""
    found, value = fields.get(number, (kind, None))
    if found != kind:
        raise _MalformedError(f"its field {number} is of type {found}, not {kind}")
    return value


def _get(fields: Fields, number: int, kind: int) -> Any:  # noqa: ANN401 - of this type
    """Return a required field; a number must be 0 or more."""
    value = _may(fields, number, kind)
    if value is None or (kind in {_I32, _I64} and value < 0):
        raise _MalformedError(f"its field {number} is {value}")
    return value


@dataclass(frozen=True, slots=True)
class _Leaf:
    """A column of the schema: its path, physical type and width, and whether it repeats."""

    path: str
    type: int
    width: int
    repeated: bool

    def is_read(self, names: Collection[str]) -> bool:
        """Return whether a reader of these names reads it."""
        parts = self.path.split(".")
        return any(".".join(parts[:count]) in names for count in range(1, len(parts) + 1))


def require_bounded(path: Path, names: Collection[str], *, rows: int = BATCH_ROWS) -> None:
    """Raise SourceError if reading the named columns could take more memory than allowed.

    ``rows`` are read at a time. Each page's header is read, and no page is unpacked. OSError passes
    through.
    """
    with (
        raising(SourceError, f"{path} cannot be read as Parquet", of=_MalformedError),
        plain_file(path).open("rb") as file,
    ):
        size = file.seek(0, SEEK_END)
        footer = _footer(file, size)
        schema = iter(_get(footer, 2, _LIST)[:_MOST_ELEMENTS])
        root: Fields = next(schema, {})
        leaves = [*_leaves(schema, _may(root, 5, _I32) or 0, "", repeated=False, depth=1)]
        groups = _get(footer, 4, _LIST)
        if _get(footer, 3, _I64) != sum(_get(group, 3, _I64) for group in groups):
            raise _MalformedError("its row groups have other rows than it says")
        for number, group in enumerate(groups, 1):
            read = [(leaf, leaf.is_read(names)) for leaf in leaves]
            _check_group(_Pages(file, size), f"row group {number}", group, read, rows)


def _footer(file: BinaryIO, size: int) -> Fields:
    if size < len(_MAGIC) + _TAIL:
        raise _MalformedError("the file is too short")
    file.seek(size - _TAIL)
    tail = file.read(_TAIL)
    length = int.from_bytes(tail[:4], "little")
    if tail[4:] != _MAGIC or length > size - len(_MAGIC) - _TAIL:
        raise _MalformedError("it has no footer that can be read")
    if length > MOST_FOOTER:
        raise _MalformedError(f"its footer has {length} bytes; the limit is {MOST_FOOTER}; write larger row groups")
    file.seek(size - _TAIL - length)
    with raising(_MalformedError, "its footer", of=_MalformedError):
        return _CompactProtocol(file.read(length), MOST_STRUCTS).struct()


def _leaves(schema: Iterator[Fields], count: int, above: str, *, repeated: bool, depth: int) -> Iterator[_Leaf]:
    """Yield the columns below ``count`` elements of a schema, in a row group's order."""
    if depth > _MOST_NESTED:
        raise _MalformedError("its schema is nested too deep")
    for _ in range(count):
        element = next(schema, None)
        if element is None:
            raise _MalformedError(f"its schema ends before its end, or has more than {_MOST_ELEMENTS} elements")
        path = above + _get(element, 4, _BINARY).decode(errors="replace")
        often = repeated or _may(element, 3, _I32) == _REPEATED
        children = _may(element, 5, _I32)
        if children:
            yield from _leaves(schema, children, f"{path}.", repeated=often, depth=depth + 1)
        else:
            yield _Leaf(path, _may(element, 1, _I32) or 0, _may(element, 2, _I32) or 0, often)


def _check_group(pages: "_Pages", where: str, group: Fields, leaves: Sequence[tuple[_Leaf, bool]], batch: int) -> None:
    """Raise _MalformedError if a row group's read columns hold too much in ``batch`` rows."""
    rows, chunks = _get(group, 3, _I64), _get(group, 1, _LIST)
    if len(chunks) != len(leaves):
        raise _MalformedError(f"{where} has {len(chunks)} columns, but the schema has {len(leaves)}")
    held = listed = 0
    for (leaf, is_read), chunk in zip(leaves, chunks, strict=True):
        if not is_read:
            continue
        column = f"column '{leaf.path}' of {where}"
        if leaf.type == _FIXED and leaf.width > _MOST_WIDTH:
            raise _MalformedError(f"{column} has values of {leaf.width} bytes; the limit is {_MOST_WIDTH}")
        with raising(_MalformedError, column, of=_MalformedError):
            unpacked = pages.of(_get(chunk, 3, _STRUCT), words=leaf.type == _WORDS)
        if leaf.repeated:
            listed += unpacked.values
        elif unpacked.values != rows:
            raise _MalformedError(f"{column} has {unpacked.values} values for {rows} rows")
        size = unpacked.held(batch * (MOST_COMPONENTS if leaf.repeated else 1))
        held += size * (3 if leaf.type == _WORDS else 1)
        if held > MOST_UNPACKED or listed > MOST_LISTED:
            much = f"{listed} numbers in vectors" if listed > MOST_LISTED else f"{size} bytes at a time"
            raise _MalformedError(
                f"{column} unpacks to {much}, with the columns before it more than the limit of "
                f"{MOST_LISTED if listed > MOST_LISTED else MOST_UNPACKED}. Write smaller pages and row groups, or "
                "leave the column out"
            )


@dataclass(frozen=True, slots=True)
class _UnpackedColumn:
    """A column's unpacked size: its dictionary's bytes, and its other pages' values and bytes."""

    dictionary: int
    pages: Sequence[tuple[int, int]]

    @property
    def values(self) -> int:
        """Return the number of its values."""
        return sum(values for values, _ in self.pages)

    def held(self, count: int) -> int:
        """Return the most bytes of pages for ``count`` values in a row, with the dictionary."""
        values = [0, *accumulate(values for values, _ in self.pages)]
        sizes = [0, *accumulate(size for _, size in self.pages)]
        most = 0
        for before, last in zip(sizes, values[1:], strict=False):  # from the last value of each page on
            end = min(bisect_left(values, last - 1 + count), len(self.pages))
            most = max(most, sizes[end] - before)
        return self.dictionary + most


@dataclass(slots=True)
class _Pages:
    """Reads the headers of a file's pages."""

    file: BinaryIO
    size: int
    left: int = _MOST_PAGES

    def of(self, chunk: Fields, *, words: bool) -> _UnpackedColumn:
        """Return the unpacked size of a column of a row group, page by page."""
        starts = [_get(chunk, 9, _I64), _may(chunk, 11, _I64) or 0]
        at = min(start for start in starts if start > 0 or start == starts[0])
        end = at + _get(chunk, 7, _I64)
        if at < len(_MAGIC) or end > self.size:
            raise _MalformedError("it lies outside the file")
        dictionary, pages = 0, []
        while at < end:
            header, length = self._header(at, end)
            packed, unpacked = _get(header, 3, _I32), _get(header, 2, _I32)
            at += length + packed
            if at > end:
                raise _MalformedError("a page goes on behind its end")
            kind = _get(header, 1, _I32)
            if kind == _DICTIONARY:
                dictionary += max(packed, unpacked)
            elif kind in {_DATA, _DATA_2}:
                page_header = _get(header, 5 if kind == _DATA else 8, _STRUCT)
                encoding = _get(page_header, 2 if kind == _DATA else 4, _I32)
                if encoding not in _ENCODINGS or (words and encoding in {5, 9}):
                    raise _MalformedError(
                        "it has an encoding whose size is known only after reading, such as DELTA_BYTE_ARRAY; write "
                        "it as PLAIN or with a dictionary"
                    )
                pages.append((_get(page_header, 1, _I32), max(packed, unpacked)))
        return _UnpackedColumn(dictionary, pages)

    def _header(self, at: int, end: int) -> tuple[Fields, int]:
        """Return the page's header at this place, and its length in bytes."""
        self.left -= 1
        if self.left < 0:
            raise _MalformedError(f"the file has more than {_MOST_PAGES} pages")
        length = _HEADER
        while True:
            self.file.seek(at)
            given = self.file.read(min(length, end - at))
            compact = _CompactProtocol(given, _HEADER)
            try:
                return compact.struct(), compact.at
            except _TruncatedError:
                if len(given) == end - at or length > _MOST_HEADER:
                    raise
            length *= 16
