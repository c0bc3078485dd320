"""Tables in CSV, JSON lines or Parquet, read row by row within bounds of memory."""

import csv
import io
import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from eyechart.errors import SourceError, raising
from eyechart.importing.cells import Cell, Progress, Row, plain_name
from eyechart.importing.faults import Faults
from eyechart.importing.parquet import open_parquet
from eyechart.records import parse_json

MOST_LINE = 4_000_000
"""Characters of one line or one row of a table; a longer one is no table of frames."""
MOST_COLUMNS = 2_000

_DELIMITERS = ",;\t"
_QUOTED = re.compile(r'"[^"]*"')
_REPORT_EVERY = 5_000


@dataclass(frozen=True)
class SourceTable:
    """A table's columns, and its rows in order; an empty cell is None.

    ``typed`` says whether its numbers are numbers; in a CSV file every cell is text. ``count`` is
    the number of rows, None if only reading tells. A broken row is noted in ``faults`` and comes
    without columns, so that all faults are found. The caller must check ``faults``. ``unread`` are
    columns without plain values, with their types.
    """

    name: str
    columns: tuple[str, ...]
    rows: Iterator[Row]
    typed: bool
    count: int | None = None
    faults: Faults = field(default_factory=Faults)
    unread: tuple[str, ...] = ()


def open_table(path: Path, progress: Progress | None = None, *, optional: Sequence[str] = ()) -> SourceTable:
    """Open a table by its ending: .csv, .tsv, .jsonl, .ndjson or .parquet.

    ``progress`` counts the part that was read. A row of JSON lines has the columns of the first,
    and may have ``optional`` ones, in any case. Raises SourceError with table, row and fault, also
    while rows are read. A fault of one row alone is noted in ``faults``.
    """
    if path.suffix.lower() not in OPENERS:
        raise SourceError(f"{path} is not a readable table; known endings are {', '.join(OPENERS)}")
    if not path.is_file():
        raise SourceError(f"{path} does not exist or is not a file; --table names the table of the frames")
    return OPENERS[path.suffix.lower()](path, progress, optional)


def _csv(path: Path, progress: Progress | None, _: Sequence[str]) -> SourceTable:
    lines = text_lines(path, progress)
    head = next(lines, "")
    delimiter = max(_DELIMITERS, key=_QUOTED.sub("", head).count)
    row = _OneRow(path, chain([head], lines))
    reader = csv.reader(row, delimiter=delimiter, strict=True)  # else an unclosed quote takes all later rows
    with raising(SourceError, f"{path}: the first line is no header", of=csv.Error):
        columns = tuple(name.strip() for name in next(reader, []))
    _check_columns(path, columns)
    faults = Faults()
    return SourceTable(path.name, columns, _csv_rows(path, reader, row, columns, faults), typed=False, faults=faults)


class _OneRow:
    """Passes lines on, and counts the characters of a row, which may cover several lines."""

    def __init__(self, path: Path, lines: Iterator[str]) -> None:
        self._path, self._lines, self._taken = path, lines, 0

    def __iter__(self) -> Iterator[str]:
        for line in self._lines:
            self._taken += len(line)
            if self._taken > MOST_LINE:
                raise SourceError(f"{self._path}: a row is longer than {MOST_LINE} characters; is a quote not closed?")
            if line:
                yield line

    def begin(self) -> None:
        """Start the next row."""
        self._taken = 0


def _csv_rows(
    path: Path, reader: Iterator[list[str]], row: _OneRow, columns: tuple[str, ...], faults: Faults
) -> Iterator[Row]:
    number = 0
    try:
        for cells in reader:
            row.begin()
            if not cells:
                continue
            number += 1
            if len(cells) != len(columns):
                faults.add(f"{path}, row {number} has {len(cells)} cells; the header has {len(columns)}")
                yield {}
                continue
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


def _json_lines(path: Path, progress: Progress | None, optional: Sequence[str]) -> SourceTable:
    lines = (line for line in text_lines(path, progress) if line.strip())
    head = next(lines, None)
    if head is None:
        raise SourceError(f"{path} is empty; each line must be a JSON object")
    columns = tuple(_json_row(path, 1, head))
    _check_columns(path, columns)
    faults = Faults()
    rows = _json_rows(path, chain([head], lines), (columns, frozenset(optional)), faults)
    return SourceTable(path.name, tuple(dict.fromkeys([*columns, *optional])), rows, typed=True, faults=faults)


_KnownColumns = tuple[tuple[str, ...], frozenset[str]]
"""The columns of a table's first row, and the plain names of columns that other rows may add."""


def _json_rows(path: Path, lines: Iterator[str], columns: _KnownColumns, faults: Faults) -> Iterator[Row]:
    for number, line in enumerate(lines, 1):
        row: Row = {}
        with faults.noted():
            row = _plain_row(path, number, line, columns)
        yield row


def _plain_row(path: Path, number: int, line: str, known: _KnownColumns) -> Row:
    row, (columns, optional) = _json_row(path, number, line), known
    for name, cell in row.items():
        if name not in columns and plain_name(name) not in optional:
            raise SourceError(f"{path}, row {number} has a column '{name}' that the first row does not have")
        if not isinstance(cell, str | int | float | bool | None):
            raise SourceError(f"{path}, row {number}: '{name}' is a {type(cell).__name__}, not a plain value")
    return {name: None if cell == "" else cell for name, cell in {**dict.fromkeys(columns), **row}.items()}


def _json_row(path: Path, number: int, line: str) -> dict[str, Cell]:
    with raising(SourceError, f"{path}, row {number} is no JSON object", of=(ValueError, RecursionError)):
        row = parse_json(line, object_pairs_hook=_each_once)
        if "\\u" in line:
            json.dumps(row, ensure_ascii=False).encode()  # half a surrogate pair cannot be written
    if not isinstance(row, dict):
        raise SourceError(f"{path}, row {number} is a {type(row).__name__}, no JSON object")
    return row


def _each_once(pairs: list[tuple[str, Cell]]) -> dict[str, Cell]:
    """Return an object of these pairs; raises ValueError for a repeated name."""
    result = dict(pairs)
    if len(result) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"it has '{twice}' twice; leave out one")
    return result


def _parquet(path: Path, progress: Progress | None, _: Sequence[str]) -> SourceTable:
    opened = open_parquet(path)
    _check_columns(path, opened.columns)
    rows = _counted(opened.rows(), opened.count, progress)
    return SourceTable(path.name, opened.columns, rows, typed=True, count=opened.count, unread=opened.unread)


def _counted(rows: Iterator[Row], count: int, progress: Progress | None) -> Iterator[Row]:
    for number, row in enumerate(rows):
        if progress is not None and number % _REPORT_EVERY == 0:
            progress(number, count)
        yield row


def text_lines(path: Path, progress: Progress | None) -> Iterator[str]:
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


OPENERS: dict[str, Callable[[Path, Progress | None, Sequence[str]], SourceTable]] = {
    ".csv": _csv,
    ".tsv": _csv,
    ".jsonl": _json_lines,
    ".ndjson": _json_lines,
    ".parquet": _parquet,
}
