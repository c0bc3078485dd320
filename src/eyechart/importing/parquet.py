"""Parquet is read in small batches after its footer was asked how much a page may unpack to.

A few kilobytes of Parquet can stand for gigabytes: repeated values, compressed pages, prefixes shared by all
strings. So a column is refused that unpacks to more than `MOST_UNPACKED` in one row group, words stay in their
dictionary until their length was checked, and the one encoding whose size no footer tells is not read.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from eyechart.errors import SourceError

Cell = str | int | float | bool | None

MOST_UNPACKED = 256_000_000
"""Bytes of one column in one row group."""
MOST_CELL = 100_000
MOST_COMPONENTS = 64
"""Components of a vector that become columns of their own; longer ones are left out."""
BATCH_ROWS = 1024


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
            plain = tuple(one.name for one in schema if _is_plain(pa, one.type))
            words = tuple(one.name for one in schema if one.name in plain and _is_words(pa, one.type))
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


def _is_plain(pa: Any, kind: Any) -> bool:  # noqa: ANN401 - of pyarrow
    types = pa.types
    if types.is_dictionary(kind):
        kind = kind.value_type
    return bool(
        types.is_integer(kind)
        or types.is_floating(kind)
        or types.is_boolean(kind)
        or types.is_decimal(kind)
        or types.is_date(kind)
        or types.is_timestamp(kind)
        or types.is_null(kind)
        or _is_words(pa, kind)
    )


def _is_words(pa: Any, kind: Any) -> bool:  # noqa: ANN401 - of pyarrow
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def _is_vector(pa: Any, schema: Any, name: str) -> bool:  # noqa: ANN401 - of pyarrow
    place = schema.get_field_index(name)
    if place < 0:
        return False
    kind = schema.field(place).type
    if not (pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)):
        return False
    return bool(
        pa.types.is_integer(kind.value_type)
        or pa.types.is_floating(kind.value_type)
        or pa.types.is_boolean(kind.value_type)
    )


def _plain(value: object) -> Cell:
    """Return a cell as a plain value: a date or a decimal as its text, an empty text as None."""
    if value is None or value == "":
        return None
    return value if isinstance(value, str | int | float | bool) else str(value)


def _first_line(error: BaseException) -> str:
    return str(error).partition("\n")[0]
