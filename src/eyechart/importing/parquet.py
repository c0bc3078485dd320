"""Parquet files, read in small batches after a check of their unpacked size.

A few kilobytes of Parquet can stand for gigabytes: repeated values, compressed pages, prefixes that
all strings share. A file is therefore opened only within the bounds of `eyechart.importing.pages`.
Text stays in its dictionary until its length is checked.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from eyechart.errors import SourceError
from eyechart.importing.cells import MOST_CELL, Cell
from eyechart.importing.pages import BATCH_ROWS, MOST_FOOTER, require_bounded

MOST_ROWS = 20_000_000
"""Rows of one table."""
_FEW_ROWS = 16
"""Rows of pictures that are read at a time."""
_NUMBERS, _WORDS = ("integer", "floating", "boolean"), ("string", "large_string")
_OTHERS, _LISTS = ("decimal", "date", "timestamp", "null"), ("list", "large_list", "fixed_size_list")
_OPENING: dict[str, Any] = {"buffer_size": 1 << 20, "thrift_string_size_limit": MOST_FOOTER}


def require(module: str, package: str, extra: str) -> Any:  # noqa: ANN401 - a module of an extra, without types
    """Import a module of an extra; raises SourceError with the extra's name if it is missing."""
    try:
        return import_module(module)
    except ImportError as error:
        raise SourceError(f"this needs {package}: pip install 'eyechart[{extra}]'") from error


@dataclass(frozen=True)
class ParquetTable:
    """A Parquet file's plain columns, and its ``vectors`` with the names of their components.

    ``unread`` are the other columns, each with its type.
    """

    path: Path
    plain: tuple[str, ...]
    count: int
    vectors: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    words: tuple[str, ...] = ()
    extra: str = "parquet"
    unread: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Return the column names of its rows, with the vectors' components."""
        return (*self.plain, *(name for names in self.vectors.values() for name in names))

    def rows(self) -> Iterator[dict[str, Cell]]:
        """Yield the rows in order, a batch at a time; raises SourceError for a bad file."""
        pa, pq = require("pyarrow", "pyarrow", self.extra), require("pyarrow.parquet", "pyarrow", self.extra)
        try:
            with pq.ParquetFile(self.path, read_dictionary=list(self.words), **_OPENING) as file:
                before = 0
                names = [*self.plain, *self.vectors]
                for group in range(file.num_row_groups if names else 0):  # a batch would go over several
                    for batch in file.iter_batches(BATCH_ROWS, row_groups=[group], columns=names, use_threads=False):
                        yield from self._unpack(batch, before)
                        before += batch.num_rows
        except (pa.ArrowException, OSError, ValueError, ArithmeticError, LookupError) as error:  # a date of no calendar
            raise SourceError(f"{self.path} cannot be read as Parquet: {_first_line(error)}") from error

    def _unpack(self, batch: Any, before: int) -> Iterator[dict[str, Cell]]:  # noqa: ANN401 - of pyarrow
        values: dict[str, list[Cell]] = {}
        for name in self.plain:
            column = batch.column(batch.schema.get_field_index(name))
            values[name] = (
                self._said(name, column, before) if name in self.words else [*map(_plain, column.to_pylist())]
            )
        for name, components in self.vectors.items():
            column = batch.column(batch.schema.get_field_index(name))
            self._check_lengths(name, column, len(components), before)
            listed = [value if value is not None else [None] * len(components) for value in column.to_pylist()]
            for place, component in enumerate(components):
                values[component] = [vector[place] for vector in listed]
        for place in range(batch.num_rows):
            yield {name: values[name][place] for name in self.columns}

    def _said(self, name: str, column: Any, before: int) -> list[Cell]:  # noqa: ANN401 - of pyarrow
        """Return a column of text; each used word is made once, after a check of its length."""
        compute = require("pyarrow.compute", "pyarrow", self.extra)
        indices = column.indices.to_pylist()
        used = sorted({index for index in indices if index is not None})
        words = column.dictionary.take(require("pyarrow", "pyarrow", self.extra).array(used, "int64"))
        for index, length in zip(used, compute.binary_length(words).to_pylist(), strict=True):
            if length is not None and length > MOST_CELL:
                row = before + indices.index(index) + 1
                raise SourceError(f"{self.path}, row {row}: '{name}' has more than {MOST_CELL} characters")
        made = dict(zip(used, map(_plain, words.to_pylist()), strict=True))
        return [None if index is None else made[index] for index in indices]

    def _check_lengths(self, name: str, column: Any, length: int, before: int) -> None:  # noqa: ANN401 - of pyarrow
        compute = require("pyarrow.compute", "pyarrow", self.extra)
        for row, found in enumerate(compute.list_value_length(column).to_pylist(), before + 1):
            if found not in {None, length}:
                raise SourceError(f"{self.path}, row {row}: '{name}' has {found} components, not {length}")


def open_parquet(
    path: Path, *, vectors: Mapping[str, tuple[str, ...]] | None = None, extra: str = "parquet"
) -> ParquetTable:
    """Open a Parquet file without its nested and binary columns, except the named ``vectors``.

    Raises SourceError if pyarrow is missing, the file is damaged, or its columns would unpack to
    too much.
    """
    pa, pq = require("pyarrow", "pyarrow", extra), require("pyarrow.parquet", "pyarrow", extra)
    try:
        require_bounded(path, ())
        with pq.ParquetFile(path, **_OPENING) as file:
            schema, count = file.schema_arrow, int(file.metadata.num_rows)
        plain = tuple(one.name for one in schema if _is(pa, one.type, (*_NUMBERS, *_WORDS, *_OTHERS)))
        words = tuple(one.name for one in schema if one.name in plain and _is(pa, one.type, _WORDS))
        lists = {name: of for name, of in (vectors or {}).items() if _is_vector(pa, schema, name)}
        require_bounded(path, {*plain, *lists})
    except (pa.ArrowException, OSError, ValueError) as error:
        raise SourceError(f"{path} cannot be read as Parquet: {_first_line(error)}") from error
    if count > MOST_ROWS:
        raise SourceError(f"{path} has more than {MOST_ROWS} rows; cut it into parts")
    unread = tuple(f"'{one.name}' ({one.type})" for one in schema if one.name not in {*plain, *lists})
    return ParquetTable(path, plain, count, lists, words, extra, unread)


def has_column(path: Path, column: str, *, extra: str) -> bool:
    """Return whether a Parquet file has this column; raises SourceError for an unreadable file."""
    pa, pq = require("pyarrow", "pyarrow", extra), require("pyarrow.parquet", "pyarrow", extra)
    try:
        require_bounded(path, ())
        with pq.ParquetFile(path, **_OPENING) as file:
            return column in file.schema_arrow.names
    except (pa.ArrowException, OSError, ValueError) as error:
        raise SourceError(f"{path} cannot be read as Parquet: {_first_line(error)}") from error


def listed_texts(path: Path, key: str, column: str, *, extra: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the numbers of ``key`` with the texts that a column lists beside them.

    Yields nothing if the column is no list of texts. Raises SourceError if it would unpack to too
    much.
    """
    pa, pq = require("pyarrow", "pyarrow", extra), require("pyarrow.parquet", "pyarrow", extra)
    try:
        require_bounded(path, {key, column})
        with pq.ParquetFile(path, **_OPENING) as file:
            place = file.schema_arrow.get_field_index(column)
            kind = None if place < 0 else file.schema_arrow.field(place).type
            if kind is None or not _is(pa, kind, _LISTS) or not _is(pa, kind.value_type, _WORDS):
                return
            for batch in file.iter_batches(_FEW_ROWS, columns=[key, column], use_threads=False):
                numbers, texts = (batch.column(batch.schema.get_field_index(one)).to_pylist() for one in (key, column))
                yield from (
                    (number, [one for one in listed or () if one])
                    for number, listed in zip(numbers, texts, strict=True)
                )
    except (pa.ArrowException, OSError, ValueError, LookupError) as error:
        raise SourceError(f"{path} cannot be read as Parquet: {_first_line(error)}") from error


def binary_cells(paths: Sequence[Path], column: str, rows: Sequence[int]) -> Iterator[bytes | None]:
    """Yield a column's bytes in these rows, a few in memory at a time.

    ``rows`` rise from 1 through all files. ``column`` may be a part of a struct, with a dot. Raises
    SourceError if it does not exist, or would unpack to too much.
    """
    pa, pq = require("pyarrow", "pyarrow", "lerobot"), require("pyarrow.parquet", "pyarrow", "lerobot")
    wanted, before = deque(rows), 0
    for path in paths:
        try:
            require_bounded(path, {column}, rows=_FEW_ROWS)
            with pq.ParquetFile(path, **_OPENING) as file:
                for group in range(file.num_row_groups):
                    count = file.metadata.row_group(group).num_rows
                    if wanted and wanted[0] <= before + count:
                        yield from _cells_of(file, group, column, wanted, before)
                    before += count
        except (pa.ArrowException, OSError, ValueError, LookupError) as error:
            raise SourceError(f"{path} cannot be read as Parquet: {_first_line(error)}") from error


def _cells_of(
    file: Any,  # noqa: ANN401 - of pyarrow
    group: int,
    column: str,
    wanted: deque[int],
    before: int,
) -> Iterator[bytes | None]:
    """Yield the wanted rows of a row group, and remove them; ``before`` rows precede it."""
    for batch in file.iter_batches(_FEW_ROWS, row_groups=[group], columns=[column], use_threads=False):
        if not batch.num_columns:
            raise LookupError(f"it has no column '{column}'")
        while wanted and wanted[0] <= before + batch.num_rows:
            cell = batch.column(0)[wanted.popleft() - before - 1].as_py()
            while isinstance(cell, dict):
                cell = next(iter(cell.values()), None)
            if cell is not None and type(cell) is not bytes:
                raise ValueError(f"column '{column}' holds no bytes")
            yield cell
        before += batch.num_rows


def _is(pa: Any, kind: Any, names: tuple[str, ...]) -> bool:  # noqa: ANN401 - of pyarrow
    """Return whether a type has one of pyarrow's names; a dictionary counts as its values."""
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
    """Return a cell as a plain value: a date or a decimal as text, an empty text as None."""
    if value is None or value == "":
        return None
    return value if isinstance(value, str | int | float | bool) else str(value)


def _first_line(error: BaseException) -> str:
    return str(error).partition("\n")[0]
