"""A table is read row by row within bounds of memory, whatever its format and its size.

Parquet is read in small batches after its footer was asked how much a page may unpack to.

A few kilobytes of Parquet can stand for gigabytes: repeated values, compressed pages, prefixes shared by all
strings. So a column is refused that unpacks to more than `MOST_UNPACKED` in one row group, words stay in their
dictionary until their length was checked, and the one encoding whose size no footer tells is not read.
"""

import csv
import io
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any

from eyechart.errors import SourceError

Cell = str | int | float | bool | None
Row = Mapping[str, Cell]
Progress = Callable[[int, int], None]
"""Called with (done, in all) while a long work goes on."""

MOST_LINE = 4_000_000
"""Characters of one line of a table; more is no table of frames."""
MOST_CELL = 100_000
"""Characters of one cell."""
MOST_COLUMNS = 2_000
MOST_UNPACKED = 256_000_000
"""Bytes of one column in one row group."""
MOST_COMPONENTS = 64
"""Components of a vector that become columns of their own; longer ones are left out."""
BATCH_ROWS = 1024
_NUMBERS, _WORDS = ("integer", "floating", "boolean"), ("string", "large_string")
_OTHERS, _LISTS = ("decimal", "date", "timestamp", "null"), ("list", "large_list", "fixed_size_list")

_DELIMITERS = ",;\t"
_REPORT_EVERY = 5_000


@dataclass(frozen=True)
class Table:
    """A table's columns, and its rows in order; an empty cell is None.

    ``typed`` says whether its numbers are numbers; in a CSV file every cell is text. ``count`` is the number of
    rows, None where only reading tells.
    """

    name: str
    columns: tuple[str, ...]
    rows: Iterator[Row]
    typed: bool
    count: int | None = None


def open_table(path: Path, progress: Progress | None = None) -> Table:
    """Open a table by its ending: .csv, .tsv, .jsonl, .ndjson or .parquet. ``progress`` counts what was read of it.

    Raises SourceError, also while its rows are read, that names the table, the row and what is wrong.
    """
    if path.suffix.lower() not in OPENERS:
        raise SourceError(f"{path} is no table that can be read; known endings are {', '.join(OPENERS)}")
    if not path.is_file():
        raise SourceError(f"{path} does not exist or is no file; --table names the table of the frames")
    return OPENERS[path.suffix.lower()](path, progress)


def _csv(path: Path, progress: Progress | None) -> Table:
    lines = _lines(path, progress)
    head = next(lines, "")
    delimiter = max(_DELIMITERS, key=head.count)
    reader = csv.reader(filter(None, chain([head], lines)), delimiter=delimiter)
    try:
        columns = tuple(name.strip() for name in next(reader, []))
    except csv.Error as error:
        raise SourceError(f"{path}: the first line is no header: {error}") from error
    _check_columns(path, columns)
    return Table(path.name, columns, _csv_rows(path, reader, columns), typed=False)


def _csv_rows(path: Path, reader: "Iterator[list[str]]", columns: tuple[str, ...]) -> Iterator[Row]:
    number = 0
    try:
        for cells in reader:
            if not cells:
                continue
            number += 1
            if len(cells) != len(columns):
                raise SourceError(f"{path}, row {number} has {len(cells)} cells; the header has {len(columns)}")
            yield {name: cell if cell.strip() else None for name, cell in zip(columns, cells, strict=True) if name}
    except csv.Error as error:
        raise SourceError(f"{path}, row {number + 1}: {error}; is a quote not closed?") from error


def _check_columns(path: Path, columns: tuple[str, ...]) -> None:
    if not any(columns):
        raise SourceError(f"{path} is empty; its first line must name the columns")
    if len(columns) > MOST_COLUMNS:
        raise SourceError(f"{path} has {len(columns)} columns; the limit is {MOST_COLUMNS}")
    for name in columns:
        if name and columns.count(name) > 1:
            raise SourceError(f"{path} has two columns '{name}'; rename one")


def _json_lines(path: Path, progress: Progress | None) -> Table:
    lines = (line for line in _lines(path, progress) if line.strip())
    head = next(lines, None)
    if head is None:
        raise SourceError(f"{path} is empty; each line must be a JSON object")
    columns = tuple(_json_row(path, 1, head))
    _check_columns(path, columns)
    return Table(path.name, columns, _json_rows(path, chain([head], lines), columns), typed=True)


def _json_rows(path: Path, lines: Iterator[str], columns: tuple[str, ...]) -> Iterator[Row]:
    for number, line in enumerate(lines, 1):
        row = _json_row(path, number, line)
        for name, cell in row.items():
            if name not in columns:
                raise SourceError(f"{path}, row {number} has a column '{name}' that the first row has not")
            if not isinstance(cell, str | int | float | bool | None):
                raise SourceError(f"{path}, row {number}: '{name}' is a {type(cell).__name__}, not a plain value")
        yield {name: None if row.get(name) == "" else row.get(name) for name in columns}


def _json_row(path: Path, number: int, line: str) -> dict[str, Cell]:
    try:
        row = json.loads(line)
        if "\\u" in line:
            json.dumps(row, ensure_ascii=False).encode()  # half of a surrogate pair is no text that a file can hold
    except (ValueError, RecursionError) as error:
        raise SourceError(f"{path}, row {number} is no JSON object: {error}") from error
    if not isinstance(row, dict):
        raise SourceError(f"{path}, row {number} is a {type(row).__name__}, no JSON object")
    return row


def _parquet(path: Path, progress: Progress | None) -> Table:
    opened = open_parquet(path)
    _check_columns(path, opened.columns)
    return Table(path.name, opened.columns, _counted(opened.rows(), opened.count, progress), True, opened.count)


def _counted(rows: Iterator[Row], count: int, progress: Progress | None) -> Iterator[Row]:
    for number, row in enumerate(rows):
        if progress is not None and number % _REPORT_EVERY == 0:
            progress(number, count)
        yield row


def _lines(path: Path, progress: Progress | None) -> Iterator[str]:
    """Yield a text file's lines, none longer than `MOST_LINE`, without its byte order mark."""
    size, number = path.stat().st_size, 0
    try:
        with path.open("rb") as raw:
            encoding = json.detect_encoding(raw.read(4))
            raw.seek(0)
            file = io.TextIOWrapper(raw, encoding, newline="")
            while line := file.readline(MOST_LINE + 1):
                number += 1
                if len(line) > MOST_LINE:
                    raise SourceError(
                        f"{path}, line {number} is longer than {MOST_LINE} characters: no table of frames"
                    )
                if progress is not None and number % _REPORT_EVERY == 0:
                    progress(raw.tell(), size)
                yield line
    except UnicodeError as error:
        raise SourceError(f"{path} is no {encoding} text after line {number}; save the table as UTF-8") from error
    except OSError as error:
        raise SourceError(f"{path} cannot be read: {error.strerror}") from error


def require(module: str, package: str, extra: str) -> Any:  # noqa: ANN401 - a module of an extra, without types
    """Import a module of an extra; raises SourceError that names the extra where it is not installed."""
    try:
        return import_module(module)
    except ImportError as error:
        raise SourceError(f"this needs {package}: pip install 'eyechart[{extra}]'") from error


@dataclass(frozen=True)
class ParquetTable:
    """A Parquet file's plain columns. ``vectors`` maps a column of vectors to the names of its components."""

    path: Path
    plain: tuple[str, ...]
    count: int
    vectors: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    words: tuple[str, ...] = ()
    extra: str = "parquet"

    @property
    def columns(self) -> tuple[str, ...]:
        """Return the names that its rows have, the vectors' components among them."""
        return (*self.plain, *(name for names in self.vectors.values() for name in names))

    def rows(self) -> Iterator[dict[str, Cell]]:
        """Yield the rows in order, a batch in memory at a time; raises SourceError where the file cannot be read."""
        pa, pq = require("pyarrow", "pyarrow", self.extra), require("pyarrow.parquet", "pyarrow", self.extra)
        try:
            with pq.ParquetFile(self.path, read_dictionary=list(self.words), buffer_size=1 << 20) as file:
                before = 0
                names = [*self.plain, *self.vectors]
                for batch in file.iter_batches(BATCH_ROWS, columns=names, use_threads=False):
                    yield from self._unpack(batch, before)
                    before += batch.num_rows
        except (pa.ArrowException, OSError, ValueError) as error:
            raise SourceError(f"{self.path} cannot be read as Parquet: {_first_line(error)}") from error

    def _unpack(self, batch: Any, before: int) -> Iterator[dict[str, Cell]]:  # noqa: ANN401 - of pyarrow
        values: dict[str, list[Cell]] = {}
        for name in self.plain:
            column = batch.column(batch.schema.get_field_index(name))
            self._check_words(name, column, before)
            values[name] = [_plain(value) for value in column.to_pylist()]
        for name, components in self.vectors.items():
            column = batch.column(batch.schema.get_field_index(name))
            self._check_lengths(name, column, len(components), before)
            listed = [value if value is not None else [None] * len(components) for value in column.to_pylist()]
            for place, component in enumerate(components):
                values[component] = [vector[place] for vector in listed]
        for place in range(batch.num_rows):
            yield {name: values[name][place] for name in self.columns}

    def _check_words(self, name: str, column: Any, before: int) -> None:  # noqa: ANN401 - of pyarrow
        if name not in self.words:
            return
        compute = require("pyarrow.compute", "pyarrow", self.extra)
        lengths = compute.binary_length(column.dictionary).to_pylist()
        for row, word in enumerate(column.indices.to_pylist(), before + 1):
            if word is not None and lengths[word] > MOST_CELL:
                raise SourceError(f"{self.path}, row {row}: '{name}' has more than {MOST_CELL} characters")

    def _check_lengths(self, name: str, column: Any, length: int, before: int) -> None:  # noqa: ANN401 - of pyarrow
        compute = require("pyarrow.compute", "pyarrow", self.extra)
        for row, found in enumerate(compute.list_value_length(column).to_pylist(), before + 1):
            if found not in {None, length}:
                raise SourceError(f"{self.path}, row {row}: '{name}' has {found} components, not {length}")


def open_parquet(
    path: Path, *, vectors: Mapping[str, tuple[str, ...]] | None = None, extra: str = "parquet"
) -> ParquetTable:
    """Open a Parquet file by its footer; nested and binary columns are left out, except the ``vectors`` named.

    Raises SourceError where pyarrow is missing, the file is damaged, or a column would unpack to too much.
    """
    pa, pq = require("pyarrow", "pyarrow", extra), require("pyarrow.parquet", "pyarrow", extra)
    try:
        with pq.ParquetFile(path) as file:
            schema, footer = file.schema_arrow, file.metadata
            plain = tuple(one.name for one in schema if _is(pa, one.type, (*_NUMBERS, *_WORDS, *_OTHERS)))
            words = tuple(one.name for one in schema if one.name in plain and _is(pa, one.type, _WORDS))
            lists = {name: of for name, of in (vectors or {}).items() if _is_vector(pa, schema, name)}
            _check_size(path, footer, {*plain, *lists})
    except (pa.ArrowException, OSError, ValueError) as error:
        raise SourceError(f"{path} cannot be read as Parquet: {_first_line(error)}") from error
    return ParquetTable(path, plain, int(footer.num_rows), lists, words, extra)


def _check_size(path: Path, footer: Any, names: set[str]) -> None:  # noqa: ANN401 - of pyarrow
    for group in range(footer.num_row_groups):
        for place in range(footer.num_columns):
            chunk = footer.row_group(group).column(place)
            if chunk.path_in_schema.partition(".")[0] not in names and chunk.path_in_schema not in names:
                continue
            size = max(chunk.total_uncompressed_size, chunk.total_compressed_size)
            if size > MOST_UNPACKED:
                raise SourceError(
                    f"{path}: column '{chunk.path_in_schema}' unpacks to {size} bytes in one row group; the limit is "
                    f"{MOST_UNPACKED}; write smaller row groups, or leave the column out"
                )
            if "DELTA_BYTE_ARRAY" in chunk.encodings:
                raise SourceError(
                    f"{path}: column '{chunk.path_in_schema}' is encoded as DELTA_BYTE_ARRAY, whose size is known only "
                    "after reading; write it with another encoding"
                )


def _is(pa: Any, kind: Any, names: tuple[str, ...]) -> bool:  # noqa: ANN401 - of pyarrow
    """Return whether a type is one of those that pyarrow calls so; a dictionary is what its values are."""
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    return any(getattr(pa.types, f"is_{name}")(kind) for name in names)


def _is_vector(pa: Any, schema: Any, name: str) -> bool:  # noqa: ANN401 - of pyarrow
    place = schema.get_field_index(name)
    if place < 0:
        return False
    kind = schema.field(place).type
    return _is(pa, kind, _LISTS) and _is(pa, kind.value_type, _NUMBERS)


def _plain(value: object) -> Cell:
    """Return a cell as a plain value: a date or a decimal as its text, an empty text as None."""
    if value is None or value == "":
        return None
    return value if isinstance(value, str | int | float | bool) else str(value)


def _first_line(error: BaseException) -> str:
    return str(error).partition("\n")[0]


OPENERS: dict[str, Callable[[Path, Progress | None], Table]] = {
    ".csv": _csv,
    ".tsv": _csv,
    ".jsonl": _json_lines,
    ".ndjson": _json_lines,
    ".parquet": _parquet,
}
