"""Parquet files written byte by byte, so that their footers and page headers can say what is not so."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

I32, I64, BINARY, LIST, STRUCT = 5, 6, 8, 9, 12
DATA, DICTIONARY, DATA_V2 = 0, 2, 3
PLAIN, RLE, DELTA_BINARY, DELTA_LENGTH, DELTA_BYTES, RLE_DICTIONARY = 0, 3, 5, 6, 7, 8
INT64, BYTES, FIXED = 2, 6, 7
NONE, ZSTD = 0, 6


def varint(number: int) -> bytes:
    """Return a number as ULEB128."""
    out = bytearray()
    while number > 127:
        out.append(number & 127 | 128)
        number >>= 7
    return bytes([*out, number])


def whole(number: int) -> bytes:
    """Return a signed number as Thrift's compact protocol has it."""
    return varint(number << 1 if number >= 0 else (-number << 1) - 1)


class Long(int):
    """A number of 64 bits; others have 32."""


@dataclass(frozen=True)
class Struct:
    """A Thrift struct: its fields by their numbers, each a number, bytes, a struct, or a list of one kind."""

    fields: Mapping[int, object]

    def __bytes__(self) -> bytes:
        out, before = bytearray(), 0
        for number, value in sorted(self.fields.items()):
            kind = kind_of(value)
            gap = number - before
            out += bytes([gap << 4 | kind]) if gap < 16 else bytes([kind]) + whole(number)
            out += encoded(value)
            before = number
        return bytes([*out, 0])


def kind_of(value: object) -> int:
    """Return the compact protocol's number of a value's kind."""
    return {int: I32, Long: I64, bytes: BINARY, list: LIST, Struct: STRUCT}[type(value)]


def encoded(value: object) -> bytes:
    """Return a value without its kind."""
    if isinstance(value, int):
        return whole(value)
    if isinstance(value, bytes):
        return varint(len(value)) + value
    if isinstance(value, list):
        kind = kind_of(value[0]) if value else STRUCT
        head = bytes([len(value) << 4 | kind]) if len(value) < 15 else bytes([240 | kind]) + varint(len(value))
        return head + b"".join(map(encoded, value))
    return bytes(value)  # type: ignore[call-overload,no-any-return]


def page(body: bytes, *, kind: int = DATA, unpacked: int, values: int, encoding: int = PLAIN) -> bytes:
    """Return a page with a header that says what it is told to."""
    inner = Struct({1: values, 2: encoding, 3: RLE, 4: RLE} if kind == DATA else {1: values, 2: encoding})
    place = {DATA: 5, DICTIONARY: 7}[kind]
    return bytes(Struct({1: kind, 2: unpacked, 3: len(body), place: inner})) + body


def twice(whole: bytes, header: int, second: bytes) -> bytes:
    """Return a page whose header, of so many bytes, says one thing more at its end."""
    return whole[: header - 1] + second + whole[header - 1 :]


@dataclass(frozen=True)
class Column:
    """A column of one row group, with what the footer says of it."""

    name: str
    pages: bytes
    values: int
    kind: int = BYTES
    width: int = 0
    optional: bool = False
    codec: int = ZSTD
    says_unpacked: int = 100
    dictionary: int = 0
    """How many bytes of the pages are a dictionary's, which stands first."""
    listed: bool = False
    """Whether it is a list, with one level of repetition."""


def write(path: Path, columns: Sequence[Column], rows: int, *, extra: Sequence[Struct] = ()) -> Path:
    """Write a file of one row group; ``extra`` elements stand behind the schema's own."""
    out, chunks = bytearray(b"PAR1"), []
    for column in columns:
        start = len(out)
        out += column.pages
        names = [column.name.encode(), b"list", b"element"] if column.listed else [column.name.encode()]
        said: dict[int, object] = {
            1: column.kind,
            2: [PLAIN, RLE],
            3: names,
            4: column.codec,
            5: Long(column.values),
            6: Long(column.says_unpacked),
            7: Long(len(column.pages)),
            9: Long(start + column.dictionary),
        }
        if column.dictionary:
            said[11] = Long(start)
        chunks.append(Struct({2: Long(start), 3: Struct(said)}))
    schema = [Struct({4: b"schema", 5: len(columns) + (1 if extra else 0)})]
    for column in columns:
        schema += elements(column)
    footer = bytes(
        Struct(
            {
                1: 1,
                2: [*schema, *extra],
                3: Long(rows),
                4: [Struct({1: chunks, 2: Long(sum(one.says_unpacked for one in columns)), 3: Long(rows)})],
            }
        )
    )
    path.write_bytes(bytes(out) + footer + len(footer).to_bytes(4, "little") + b"PAR1")
    return path


def elements(one: Column) -> list[Struct]:
    """Return a column's elements of the schema: required and plain, or a list of such."""
    words: dict[int, object] = {6: 0} if one.kind == BYTES else {}
    if one.kind == FIXED:
        words = {2: one.width, 6: 5, 7: 2, 8: 5}  # a decimal
    if not one.listed:
        return [Struct({1: one.kind, 3: int(one.optional), 4: one.name.encode(), **words})]
    return [
        Struct({3: 0, 4: one.name.encode(), 5: 1, 6: 3}),
        Struct({3: 2, 4: b"list", 5: 1}),
        Struct({1: one.kind, 3: 0, 4: b"element", **words}),
    ]
